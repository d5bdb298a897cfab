"""What tests of systems share: their ports, and one output for given inputs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem


@pytest.fixture(scope="session")
def port_sizes() -> Callable[[LeafSystem], tuple[dict[str, int], dict[str, int]]]:
    """Names and sizes of a system's input and output ports, in order; abstract ports have 0."""

    def sizes(system: LeafSystem) -> tuple[dict[str, int], dict[str, int]]:
        inputs = [system.get_input_port(i) for i in range(system.num_input_ports())]
        outputs = [system.get_output_port(i) for i in range(system.num_output_ports())]
        return (
            {port.get_name(): port.size() for port in inputs},
            {port.get_name(): port.size() for port in outputs},
        )

    return sizes


@pytest.fixture(scope="session")
def evaluate() -> Callable[..., np.ndarray]:
    """The value of a vector output port with input ports fixed by name."""

    def value(system: LeafSystem, output: str, **inputs: object) -> np.ndarray:
        context = system.CreateDefaultContext()
        for name, given in inputs.items():
            system.GetInputPort(name).FixValue(context, given)
        return np.array(system.GetOutputPort(output).Eval(context))

    return value
