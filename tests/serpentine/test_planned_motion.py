"""What is asked of a motion that is given by joints, and how it is paced."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.joint_motion_limits import limit_sentences, speed_sentences
from pips_drake.serpentine.joint_motion_pacing import paced
from pips_drake.serpentine.motion_extremes import motion_extremes
from pips_drake.serpentine.planned_motion import GivenJoints


@pytest.fixture(scope="module")
def arm():
    return load_arm("prototype")


def moved(arm, changes, times):
    """Home, with each of `changes` (joint, by) added in turn."""
    rows = [arm.joint_home.copy()]
    for joint, by in changes:
        rows.append(rows[-1].copy())
        rows[-1][joint] += by
    return JointMotion(times=np.array(times), joints=np.array(rows))


def test_a_way_goes_on_while_only_the_hand_turns(arm):
    motion = moved(arm, [(0, 0.2), (17, 0.5)], [0.0, 1.0, 3.0])
    given = GivenJoints(arm=arm, motion=motion, name="m")
    # The rail takes every point 0.2 m along; the hand's edge, 0.1 m aside, goes 0.5 rad about.
    assert given.end == pytest.approx(0.2 + 0.1 * 0.5, abs=1e-12)
    assert given.tip_travel == pytest.approx(0.2, abs=1e-12)
    assert given.way(2.0) == pytest.approx((0.225, 0.025), abs=1e-12)
    assert given.way(-1.0)[0] == 0.0
    assert given.way(9.0)[0] == pytest.approx(given.end)
    np.testing.assert_allclose(given.times_at([0.1, 0.2, 0.225]), [0.5, 1.0, 2.0], atol=1e-12)
    assert given.path_deviation(arm, motion.joints, np.zeros(3)) is None


def test_the_line_is_where_the_tip_goes(arm):
    motion = moved(arm, [(0, 0.2), (5, 0.4)], [0.0, 1.0, 3.0])
    given = GivenJoints(arm=arm, motion=motion, name="m")
    tips = kinematics.spine_points(arm, motion.joints)[:, -1]
    np.testing.assert_allclose(given.line[[0, -1]], tips[[0, -1]], atol=1e-12)
    # The corner between both parts is within half a step of the line's 600 points (5 ms) of one.
    assert np.linalg.norm(given.line - tips[1], axis=1).min() < 0.2 * 0.0051
    np.testing.assert_array_equal(given.marks, tips[[0, -1]])


def test_another_arms_joints_are_refused(arm):
    motion = moved(arm, [(0, 0.2)], [0.0, 1.0])
    with pytest.raises(InputError, match=r"'m': 18 joints; must be the 42 of arm 'cmu_92'"):
        GivenJoints(arm=load_arm("cmu_92"), motion=motion, name="m")


def test_equal_motions_have_equal_versions(arm):
    motion = moved(arm, [(0, 0.2)], [0.0, 1.0])
    other = moved(arm, [(0, 0.2 + 1e-15)], [0.0, 1.0])
    one, same, else_ = (
        GivenJoints(arm=arm, motion=m, name=n)
        for m, n in ((motion, "a"), (motion, "b"), (other, "a"))
    )
    assert one.version == same.version != else_.version


def test_what_breaks_a_limit_is_said_with_its_place(arm):
    fine = moved(arm, [(0, 0.2), (4, 0.3)], [0.0, 10.0, 20.0])
    extremes = motion_extremes(arm, fine.times, fine.joints)
    assert limit_sentences(arm, fine, extremes) == ()
    assert speed_sentences(arm, extremes) == ()
    bad = moved(arm, [(0, -0.1), (4, 1.2)], [0.0, 10.0, 20.0])
    rail, hinge, stroke = limit_sentences(arm, bad, motion_extremes(arm, bad.times, bad.joints))
    lowest = arm.joint_lower[0] * 1e3
    assert rail.startswith(f"joint d1 leaves its limits {lowest:.3f} .. ")
    assert rail.endswith(f": {bad.joints[1, 0] * 1e3:.3f} mm at 10.00 s")
    assert hinge.startswith("joint theta5 leaves its limits -30.000 .. 30.000 deg: ")
    assert hinge.endswith("68.755 deg at 20.00 s")
    assert stroke.startswith("actuator L5 would be ")
    assert stroke.endswith("mm beyond its stroke near 10.00 s")


def test_a_drive_that_is_too_fast_is_named_with_its_time(arm):
    limit = float(arm.base_speed_limit[0])
    motion = moved(arm, [(0, 0.1), (0, 0.1)], [0.0, 10.0, 10.0 + 0.1 / (1.5 * limit)])
    extremes = motion_extremes(arm, motion.times, motion.joints)
    assert speed_sentences(arm, extremes) == (
        "drive d1 would need 150 % of its speed limit from 10.00 s on; must be <= 100 %",
    )
    assert speed_sentences(arm, extremes, 1.6) == ()


def test_pacing_keeps_the_postures_and_takes_the_jumps_out(arm):
    motion = moved(arm, [(0, 0.5), (0, -0.5), (5, 0.1)], [0.0, 10.0, 20.0, 30.0])
    jump, ramp = 0.010, 2.0
    slow = paced(arm, motion, jump=jump, ramp=ramp)
    # On the same lines: each row is a posture of the motion at one time or another.
    given = GivenJoints(arm=arm, motion=motion, name="m")
    ways = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(slow.joints, axis=0)).max(axis=1))])
    wanted = np.interp(ways, np.cumsum([0.0, 0.5, 0.5, 0.1]), motion.times)
    np.testing.assert_allclose(slow.joints, motion.at(wanted), atol=1e-12)
    # Neither faster than given, nor with more than the jump; at both ends at rest.
    rates = np.diff(wanted) / np.diff(slow.times)
    assert rates.max() <= 1.0 + 1e-9
    spine = given.spine(wanted)
    speeds = np.diff(spine, axis=0) / np.diff(slow.times)[:, None, None]
    jumps = np.linalg.norm(np.diff(speeds, axis=0), axis=2).max(axis=1)
    # The clock's own change goes by in steps of 1/16 s (0.05 m/s in 2 s), before and after a row.
    assert jumps.max() <= jump + 0.05 / ramp / 16.0 + 1e-9
    first, last = (np.linalg.norm(speeds[k], axis=1).max() for k in (0, -1))
    assert max(first, last) <= 0.05 / ramp / 16.0
    # The turn at 10 s: the rail's velocity jumps by 0.1 m/s, so it is passed at a tenth of it.
    turn = int(np.argmax(ways >= 0.5 - 1e-12))
    assert rates[turn] == pytest.approx(0.1 + 0.5 / 16.0 / ramp, rel=0.2)
    assert slow.duration > motion.duration + 3.0


@pytest.mark.parametrize("setting", [{"jump": 0.0}, {"ramp": -1.0}, {"ramp": float("nan")}])
def test_pacing_refuses_what_means_nothing(arm, setting):
    with pytest.raises(InputError, match=f"pacing: {next(iter(setting))}"):
        paced(arm, moved(arm, [(0, 0.2)], [0.0, 1.0]), **setting)
