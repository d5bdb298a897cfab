"""What the plant's springs are asked for, and the force that they answer with."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.faults import make_drive_faults
from pips_drake.serpentine.systems.leg_springs import LegSprings

STEP = 1.0 / 512.0
#: README of the prototype: damping over stiffness, s.
LEAD = 5e-3


def test_ports(arm, port_sizes):
    inputs, outputs = port_sizes(LegSprings(arm, period=STEP))
    assert inputs == {"leg_command": 32, "joint_state": 36}
    assert outputs == {"free_length": 16, "leg_force": 16, "stiffness_share": 16}


def test_the_request_hangs_on_the_command_alone_and_the_force_on_the_joints_alone(arm):
    system = LegSprings(arm, period=STEP)
    through = {(i, o) for i in range(2) for o in range(3) if system.HasDirectFeedthrough(i, o)}
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
    context.SetDiscreteState(np.repeat([0.3, 1.0], 16))
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
        np.testing.assert_array_equal(applied, np.repeat([0.3 + 1e-4 * k, 1.0], 16))
        force = system.GetOutputPort("leg_force").Eval(system.GetMyContextFromRoot(context))
        assert force[0] == pytest.approx(spring_force(arm, 0.0, 0.0, 0.3 + 1e-4 * k), abs=1e-8)


def test_a_weak_leg_asks_for_less_stiffness_and_makes_as_much_less_force_from_its_start_on(arm):
    faults = make_drive_faults(
        arm,
        [
            FaultConfig(kind="weak", drive="L4", size=0.5, start_s=2.5 * STEP),
            FaultConfig(kind="weak", drive="L4", size=0.5, start_s=2.5 * STEP, duration_s=1.0),
            FaultConfig(kind="jam", drive="L5"),
        ],
    )
    system = LegSprings(arm, period=STEP, faults=faults)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("leg_command").FixValue(context, np.repeat([0.3, 0.0], 16))
    system.GetInputPort("joint_state").FixValue(context, np.zeros(36))
    sound = spring_force(arm, 0.0, 0.0, 0.3)
    simulator.Initialize()
    for step in range(5):
        simulator.AdvanceTo((step + 0.75) * STEP)
        # The step from 2 to 3 began before the fault, and is made without it.
        made = 1.0 if step < 3 else 0.25
        force = system.GetOutputPort("leg_force").Eval(context)
        np.testing.assert_allclose(force[:7], sound * np.array([1.0, made] + [1.0] * 5), rtol=1e-13)
        asked = system.GetOutputPort("stiffness_share").Eval(context)
        assert asked.tolist() == [1.0, 1.0 if step < 2 else 0.25] + [1.0] * 14
