"""The joints go as they are given, on a clock that starts, stops and turns smoothly."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from pips_drake.errors import InputError
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.motion_words import (
    DONE,
    DWELLING,
    EXTEND,
    EXTENDING,
    HOLD,
    RETRACT,
    RETRACTING,
    RUN,
)
from pips_drake.serpentine.planned_motion import GivenJoints
from pips_drake.serpentine.systems.joint_motion_source import JointMotionSource

PERIOD, RAMP = 1.0 / 64.0, 1.0
# Clock times are sums of a few hundred powers of two and square roots.
ROUNDING = 1e-12
#: The rail goes out 0.4 m in 2 s, then joint 5 turns by 0.3 rad in 4 s.
D1, TURN, FIRST, LAST = 0.4, 0.3, 2.0, 6.0
HINGE = 4


@pytest.fixture(scope="module")
def given():
    arm = load_arm("prototype")
    joints = np.tile(arm.joint_home, (3, 1))
    joints[1:, 0] += D1
    joints[2, HINGE] += TURN
    motion = JointMotion(times=np.array([0.0, FIRST, LAST]), joints=joints)
    return GivenJoints(arm=arm, motion=motion, name="made up")


def clock_out(time):
    """The clock at a time: up to its rate over RAMP, and down in the same way."""
    whole = LAST + RAMP
    if time <= 0.0 or time >= whole:
        return (0.0, 0.0) if time <= 0.0 else (LAST, 0.0)
    if time < RAMP:
        return time**2 / (2.0 * RAMP), time / RAMP
    if time > whole - RAMP:
        left = whole - time
        return LAST - left**2 / (2.0 * RAMP), left / RAMP
    return time - 0.5 * RAMP, 1.0


def posture(given, clock):
    """Joints at a time of the clock, by hand."""
    joints = given.arm.joint_home.copy()
    joints[0] += D1 * min(clock / FIRST, 1.0)
    joints[HINGE] += TURN * max((clock - FIRST) / (LAST - FIRST), 0.0)
    return joints


def run(source, duration, commands=(), share=None):
    """Times (N,) of the last update, joint states (N, 36), tips (N, 2) and phases (N,)."""
    simulator = Simulator(source)
    context = simulator.get_mutable_context()
    if share is not None:
        source.GetInputPort("speed_share").FixValue(context, [share])
    simulator.Initialize()
    times, states, tips, phases = [], [], [], []
    pending = list(commands)
    for k in range(int(np.ceil(duration / PERIOD)) + 1):
        # Midway between updates: the state is what the update at k made of it.
        simulator.AdvanceTo((k + 0.5) * PERIOD)
        times.append((k + 1) * PERIOD)
        states.append(source.GetOutputPort("joint_state").Eval(context).copy())
        tips.append(source.GetOutputPort("tip").Eval(context).copy())
        phases.append(source.GetOutputPort("phase").Eval(context)[0])
        while pending and pending[0][0] <= context.get_time():
            source.GetInputPort("command").FixValue(context, [pending.pop(0)[1]])
    return np.array(times), np.array(states), np.array(tips), np.array(phases)


def make(given, **settings):
    return JointMotionSource(given, **{"hold_ramp": RAMP, "period": PERIOD} | settings)


def test_ports(given, port_sizes):
    inputs, outputs = port_sizes(make(given))
    assert inputs == {"command": 1, "speed_share": 1}
    assert outputs == {"joint_state": 36, "tip": 2, "phase": 1}
    assert not make(given).HasAnyDirectFeedthrough()


def test_it_begins_at_rest_in_the_first_posture(given):
    source = make(given)
    context = source.CreateDefaultContext()
    state = source.GetOutputPort("joint_state").Eval(context)
    np.testing.assert_array_equal(state[:18], given.motion.joints[0])
    np.testing.assert_array_equal(state[18:], 0.0)
    np.testing.assert_array_equal(source.GetOutputPort("tip").Eval(context), 0.0)
    assert source.GetOutputPort("phase").Eval(context)[0] == EXTENDING


def test_the_joints_and_their_rates_are_those_of_the_clock(given):
    source = make(given)
    assert source.duration == LAST + RAMP
    times, states, _, phases = run(source, LAST + RAMP + 0.5)
    clocks = [clock_out(time) for time in times]
    expected = np.array([posture(given, clock) for clock, _ in clocks])
    np.testing.assert_allclose(states[:, :18], expected, rtol=0, atol=ROUNDING)
    for clock, rate, state in zip(*zip(*clocks, strict=True), states, strict=True):
        if abs(clock - FIRST) > PERIOD:  # where the rate jumps
            rail, turn = (D1 / FIRST, 0.0) if clock < FIRST else (0.0, TURN / (LAST - FIRST))
            np.testing.assert_allclose(
                state[[18, 18 + HINGE]], [rail * rate, turn * rate], rtol=0, atol=ROUNDING
            )
    np.testing.assert_array_equal(states[-1], [*given.motion.joints[-1], *np.zeros(18)])
    assert list(dict.fromkeys(phases)) == [EXTENDING, DONE]


def test_the_tip_says_how_far_the_fastest_point_has_gone(given):
    times, _, tips, _ = run(make(given), LAST + RAMP + 0.5)
    for time, (way, rate) in zip(times, tips, strict=True):
        clock, speed = clock_out(time)
        if clock < FIRST - PERIOD:  # every point goes with the rail
            assert way == pytest.approx(D1 * clock / FIRST, abs=ROUNDING)
            assert rate == pytest.approx(D1 / FIRST * speed, abs=ROUNDING)
    assert tips[-1] == pytest.approx([given.end, 0.0])
    # Joint 5's axis: the tip goes on an arc about it, whose chords every 1/16 s (0.0047 rad) are
    # shorter by 1e-6 of it.
    at_home = given.spine([FIRST])[0]
    radius = np.linalg.norm(at_home - at_home[0], axis=1).max()
    assert given.end - D1 == pytest.approx(radius * TURN, rel=0.05)


def test_a_hold_stops_it_on_its_way_and_a_resume_goes_on(given):
    times, states, tips, _ = run(make(given), 12.0, [(3.0, HOLD), (6.0, RUN)])
    held = (times > 3.0 + RAMP + 2 * PERIOD) & (times < 6.0)
    assert np.ptp(states[held], axis=0).max() == 0.0
    assert (tips[held, 1] == 0.0).all()
    # The hold is heard at the update after 3 s: the clock stood at 2.5 s there, and goes on for
    # half a ramp. A period's lag of the command is 1/64 s.
    clock = FIRST + (states[held][0, HINGE] - given.motion.joints[0, HINGE]) / TURN * (LAST - FIRST)
    assert clock == pytest.approx(3.0 - 0.5 * RAMP + 0.5 * RAMP, abs=2.0 * PERIOD)
    # Nothing between rows: each posture is one of the motion's.
    clocks = given.times_at(tips[:, 0])
    np.testing.assert_allclose(states[:, :18], given.motion.at(clocks), rtol=0, atol=1e-9)
    np.testing.assert_array_equal(states[-1, :18], given.motion.joints[-1])
    # Standing or coming to it, no rate jumps by more than the clock's ramp allows.
    rates = tips[:, 1]
    fastest = np.abs(np.diff(rates))[np.abs(tips[1:, 0] - D1) > 0.02].max()
    assert fastest <= max(rates) * PERIOD / RAMP * 1.01


def test_a_retraction_runs_it_backwards_to_its_beginning(given):
    times, states, tips, phases = run(make(given), 9.0, [(3.0, RETRACT)])
    assert list(dict.fromkeys(phases)) == [EXTENDING, RETRACTING, DONE]
    np.testing.assert_array_equal(states[-1], [*given.motion.joints[0], *np.zeros(18)])
    clocks = given.times_at(tips[:, 0])
    np.testing.assert_allclose(states[:, :18], given.motion.at(clocks), rtol=0, atol=1e-9)
    assert tips[:, 1].min() < 0.0
    # From 3 s on: to rest, where the clock stands at 3 s, and from there back as long as out.
    back = times[np.argmax(phases == DONE)]
    assert back == pytest.approx(3.0 + RAMP + 3.0 + RAMP, abs=4.0 * PERIOD)


def test_extending_again_after_a_retraction_goes_to_the_end(given):
    _, states, _, phases = run(make(given), 16.0, [(3.0, RETRACT), (5.0, EXTEND)])
    passed = [phase for phase, _ in itertools.groupby(phases)]
    assert passed == [EXTENDING, RETRACTING, EXTENDING, DONE]
    np.testing.assert_array_equal(states[-1, :18], given.motion.joints[-1])


def test_a_share_of_the_speed_is_a_share_of_the_rates(given):
    times, states, _, phases = run(make(given), 2.0 * LAST + 3.0, share=0.5)
    steady = (times > 1.0) & (times < 3.0)
    np.testing.assert_allclose(states[steady, 18], 0.5 * D1 / FIRST, rtol=1e-12)
    # At half the rate over twice the time, with half ramps of half the height: 12.5 s.
    done = times[np.argmax(phases == DONE)]
    assert done == pytest.approx(2.0 * LAST + 0.5 * RAMP, abs=2.0 * PERIOD)


def test_it_dwells_and_comes_back_if_it_is_to(given):
    source = make(given, dwell=1.5, retract=True)
    assert source.duration == 2.0 * (LAST + RAMP) + 1.5
    times, states, _, phases = run(source, source.duration + 0.5)
    assert list(dict.fromkeys(phases)) == [EXTENDING, DWELLING, RETRACTING, DONE]
    dwelling = np.sum(phases == DWELLING) * PERIOD
    assert dwelling == pytest.approx(1.5, abs=PERIOD)
    np.testing.assert_array_equal(states[-1, :18], given.motion.joints[0])
    assert times[np.argmax(phases == DONE)] <= source.duration + 2.0 * PERIOD


def test_a_motion_shorter_than_its_ramps_gets_there_too(given):
    short = JointMotion(times=np.array([0.0, 0.1]), joints=given.motion.joints[:2])
    source = make(GivenJoints(arm=given.arm, motion=short, name="short"))
    # Up and down at 1 / RAMP: 0.05 s of the clock each take sqrt(2 * 0.05) s.
    assert source.duration == pytest.approx(2.0 * np.sqrt(0.1))
    times, states, _, phases = run(source, source.duration + 0.2)
    np.testing.assert_array_equal(states[-1, :18], short.joints[-1])
    assert times[np.argmax(phases == DONE)] == pytest.approx(source.duration, abs=3.0 * PERIOD)


@pytest.mark.parametrize(
    ("port", "value", "words"),
    [
        ("command", 0.5, "JointMotionSource.command = 0.5; must be 1 \\(run\\)"),
        ("speed_share", 0.0, "JointMotionSource.speed_share = 0.0; must be > 0 and <= 1"),
    ],
)
def test_what_it_does_not_understand_is_refused(given, port, value, words):
    source = make(given)
    simulator = Simulator(source)
    source.GetInputPort(port).FixValue(simulator.get_mutable_context(), [value])
    with pytest.raises(InputError, match=words):
        simulator.AdvanceTo(PERIOD)


@pytest.mark.parametrize("setting", [{"dwell": -1.0}, {"hold_ramp": 0.0}])
def test_times_that_mean_nothing_are_refused(given, setting):
    with pytest.raises(InputError, match=next(iter(setting))):
        make(given, **setting)
