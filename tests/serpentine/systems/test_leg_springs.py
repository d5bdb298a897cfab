"""What the plant's springs are asked for, and the force that they answer with."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from pips_drake.serpentine.systems.leg_springs import LegSprings

STEP = 1.0 / 512.0
#: README of the prototype: damping over stiffness, s.
LEAD = 5e-3


def test_ports(arm, port_sizes):
    inputs, outputs = port_sizes(LegSprings(arm, period=STEP))
    assert inputs == {"leg_command": 32, "joint_state": 36}
    assert outputs == {"free_length": 16, "leg_force": 16}


def test_the_request_hangs_on_the_command_alone_and_the_force_on_the_joints_alone(arm):
    system = LegSprings(arm, period=STEP)
    through = {(i, o) for i in range(2) for o in range(2) if system.HasDirectFeedthrough(i, o)}
    assert through == {(0, 0), (1, 1)}


def test_a_moving_leg_is_asked_for_the_length_that_its_damping_holds_back(arm, evaluate):
    lengths, rates = np.linspace(0.1, 0.4, 16), np.linspace(-0.025, 0.025, 16)
    asked = evaluate(
        LegSprings(arm, period=STEP), "free_length", leg_command=np.append(lengths, rates)
    )
    np.testing.assert_allclose(asked, lengths + LEAD * rates, rtol=1e-15)


def spring_force(arm, q, rates, applied):
    """Force of the first large actuator by the law of cosines: 40 MN/m, pins at 9 in, 90 deg."""
    pin = 9.0 * 0.0254
    length = pin * np.sqrt(2.0 - 2.0 * np.cos(np.pi / 2.0 + q))
    rate = pin**2 * np.sin(np.pi / 2.0 + q) / length * rates
    return 4e7 * (applied - length) - 4e7 * LEAD * rate


@pytest.mark.parametrize("theta", [-0.5, 0.0, 0.5])
@pytest.mark.parametrize("rate", [0.0, 0.1])
def test_the_force_is_that_of_a_damped_spring_between_the_pins(arm, theta, rate):
    system = LegSprings(arm, period=STEP)
    context = system.CreateDefaultContext()
    state = np.zeros(36)
    state[2], state[18 + 2] = theta, rate
    system.GetInputPort("joint_state").FixValue(context, state)
    context.SetDiscreteState(np.full(16, 0.3))
    force = system.GetOutputPort("leg_force").Eval(context)
    # Stiffness times the roundings of lengths of 0.3 m.
    assert force[0] == pytest.approx(spring_force(arm, theta, rate, 0.3), rel=0, abs=1e-8)


def test_the_force_is_that_of_the_length_with_which_the_step_was_made(arm):
    # A command that changes by a tenth of a millimetre a step, and a still arm.
    builder = DiagramBuilder()
    system = builder.AddNamedSystem("springs", LegSprings(arm, period=STEP))
    command = builder.AddSystem(ConstantVectorSource(np.append(np.full(16, 0.3), np.zeros(16))))
    joints = builder.AddSystem(ConstantVectorSource(np.zeros(36)))
    builder.Connect(command.get_output_port(), system.GetInputPort("leg_command"))
    builder.Connect(joints.get_output_port(), system.GetInputPort("joint_state"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.Initialize()
    context = simulator.get_mutable_context()
    mine = command.GetMyMutableContextFromRoot(context)
    for k in range(4):
        longer = np.append(np.full(16, 0.3 + 1e-4 * k), np.zeros(16))
        command.get_mutable_source_value(mine).SetFromVector(longer)
        simulator.AdvanceTo((k + 0.5) * STEP)
        applied = system.GetMyContextFromRoot(context).get_discrete_state_vector().value()
        np.testing.assert_array_equal(applied, 0.3 + 1e-4 * k)
        force = system.GetOutputPort("leg_force").Eval(system.GetMyContextFromRoot(context))
        assert force[0] == pytest.approx(spring_force(arm, 0.0, 0.0, 0.3 + 1e-4 * k), abs=1e-8)
