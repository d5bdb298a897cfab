"""The systems that faults live in: servos, encoders and forces at the tip."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from pips_drake.serpentine.drives import drive_limits, drives_from_joints
from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.faults import make_drive_faults, make_encoder_faults
from pips_drake.serpentine.systems.actuator_servo import ActuatorServo
from pips_drake.serpentine.systems.encoder_bank import EncoderBank
from pips_drake.serpentine.systems.tip_disturbance import TipDisturbance


@pytest.mark.parametrize(("kind", "size"), [("jam", 0.0), ("slow", 0.25), ("late", 0.0)])
def test_a_faulty_servo_goes_no_farther_than_its_fault_lets_it(arm, kind, size):
    named = {} if kind == "late" else {"drive": "L4"}
    faults = make_drive_faults(arm, [FaultConfig(kind=kind, size=size, start_s=0.25, **named)])
    servo, sound = ActuatorServo(arm, faults=faults), ActuatorServo(arm)
    home = drives_from_joints(arm, arm.joint_home)
    far = home + 0.02
    ends = []
    for system in (servo, sound):
        simulator = Simulator(system)
        context = simulator.get_mutable_context()
        command = np.concatenate([home, np.zeros(arm.joints)])
        system.GetInputPort("drive_state").FixValue(context, command)
        simulator.Initialize()
        simulator.AdvanceTo(0.25)
        command[: arm.joints] = far
        system.GetInputPort("drive_state").FixValue(context, command)
        simulator.AdvanceTo(0.5)
        ends.append(system.GetOutputPort("setpoint").Eval(context)[: arm.joints] - home)
    # Updates at 0.25, ..., 0.5 s less a period: 16 of them; what a quarter of the speed comes to.
    way = 0.25 * size * drive_limits(arm)[2][3]
    assert ends[0][3] == pytest.approx(min(way, 0.02), abs=1e-9) and ends[1][3] > way + 1e-4
    others = np.delete(ends[0], 3), np.delete(ends[1], 3)
    np.testing.assert_array_equal(others[0], 0.0 if kind == "late" else others[1])


def test_a_stuck_encoder_stays_where_it_was_and_sound_ones_follow(arm):
    faults = make_encoder_faults(arm, [FaultConfig(kind="stuck", encoder="theta3", start_s=1.0)])
    bank = EncoderBank(arm, faults=faults)
    simulator = Simulator(bank)
    context = simulator.get_mutable_context()
    port, output = bank.GetInputPort("joint_state"), bank.GetOutputPort("reading")
    readings = []
    for time in (0.5, 1.5, 2.5):
        port.FixValue(context, np.full(2 * arm.joints, time))
        simulator.AdvanceTo(time)
        readings.append(output.Eval(context)[[2, 3]].tolist())
    # The input that it sees from 0.5 s on is where it is at 1 s.
    assert readings == [[0.5, 0.5], [1.5, 1.5], [1.5, 2.5]]
    assert bank.GetOutputPort("health").Eval(context).tolist() == [1.0] * arm.joints


def test_a_dead_encoder_says_so(arm):
    bank = EncoderBank(
        arm, faults=make_encoder_faults(arm, [FaultConfig(kind="dead", encoder="d1")])
    )
    simulator = Simulator(bank)
    context = simulator.get_mutable_context()
    bank.GetInputPort("joint_state").FixValue(context, np.ones(2 * arm.joints))
    simulator.AdvanceTo(0.125)
    assert np.flatnonzero(bank.GetOutputPort("health").Eval(context) == 0.0).tolist() == [0]


def test_a_disturbance_acts_in_its_time():
    system = TipDisturbance(5, forces=[(1.0, 2.0, [1.0, 2.0, 3.0])])
    context = system.CreateDefaultContext()
    found = []
    for time in (0.5, 1.0, 1.99, 2.0):
        context.SetTime(time)
        found.append(list(system.GetOutputPort("spatial_force").Eval(context)))
    assert [len(one) for one in found] == [0, 1, 1, 0]
    (force,) = found[1]
    assert int(force.body_index) == 5
    np.testing.assert_array_equal(force.F_Bq_W.translational(), [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(force.F_Bq_W.rotational(), 0.0)
