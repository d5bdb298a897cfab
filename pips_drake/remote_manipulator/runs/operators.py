"""The operator that a scenario asks for, as a system."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import System

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.autopilot import Autopilot as Pilot
from pips_drake.remote_manipulator.configuration import STATIONS
from pips_drake.remote_manipulator.runs.run import Setup
from pips_drake.remote_manipulator.scenario import RemoteManipulatorScenario
from pips_drake.remote_manipulator.systems.autopilot import Autopilot


@dataclass(frozen=True, kw_only=True)
class Operator:
    """An operator, and how long it works, s; 0: until it says that it is done."""

    system: System
    duration: float = 0.0


def make_operator(
    scenario: RemoteManipulatorScenario,
    setup: Setup,
    *,
    folder: Path | None = None,
    meshcat: Meshcat | None = None,
) -> Operator:
    """The operator of a scenario.

    Args:
        folder: where the scenario's relative file names start.
        meshcat: what a person works with, where `operator.kind` is `meshcat`.

    Raises:
        InputError: there is no such recording, or no Meshcat.
    """
    angles = np.asarray(setup.plant.arm_vector)[1:7]
    station = STATIONS.index(scenario.station)
    kind = scenario.operator.kind
    if kind == "autopilot":
        pilot = Pilot(setup.config, scenario.operator.script, station=station)
        return Operator(system=Autopilot(pilot, angles=angles))
    raise InputError(f"operator.kind = {kind}; not there yet")
