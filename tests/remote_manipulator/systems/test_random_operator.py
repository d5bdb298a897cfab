"""The random operator as a system: the hand's own decisions, in volts, from state alone."""

from __future__ import annotations

import pytest
from pydrake.systems.analysis import Simulator

from pips_drake.remote_manipulator.analog_inputs import angle_scaling, decode_frame
from pips_drake.remote_manipulator.autopilot import Seen
from pips_drake.remote_manipulator.phases import Phase
from pips_drake.remote_manipulator.random_operator import RandomOperator as Hand
from pips_drake.remote_manipulator.systems.random_operator import RandomOperator

from ..program_world import CONFIG, STOWED, arm_over, cae_pose


def test_the_system_is_the_hand_seen_a_frame_later():
    hand = Hand(CONFIG, 4)
    arm = arm_over(STOWED, up=0.3)
    system = RandomOperator(hand, angles=arm[1:7])
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    for name, values in (
        ("phase", [float(Phase.STOWED)]),
        ("arm_measured", arm),
        ("payload_pose", [1.0, 0.0, 0.0, 0.0, *STOWED[1]]),
        ("cae_pose", [1.0, 0.0, 0.0, 0.0, *cae_pose()[1]]),
    ):
        system.GetInputPort(name).FixValue(context, values)
    scaling = angle_scaling(CONFIG.arm)
    first = decode_frame(system.GetOutputPort("channels").Eval(context), scaling)
    # Full scale is ten volts: one rounding of it.
    assert first.angles == pytest.approx(arm[1:7], abs=1e-14)
    simulator.AdvanceTo(1.01)
    inputs = decode_frame(system.GetOutputPort("channels").Eval(context), scaling)
    seen = Seen(phase=Phase.STOWED, arm=arm, X_RP=STOWED, X_RC=cae_pose())
    state = hand.first_state(arm[1:7])
    for _ in range(21):
        state, expected = hand.advance(state, seen)
    assert inputs.angles == pytest.approx(expected.angles, abs=1e-14)
    assert inputs.prong == expected.prong
    assert not system.HasAnyDirectFeedthrough()
