"""Straight lines from rest to rest, by a trapezoid of speed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.kinematics import make_poses
from pips_drake.cable_robot.platform_motion import MotionLimits, PlatformMotion
from pips_drake.errors import InputError

POSES = make_poses(
    [[0, 0, 0], [2, 0, 0], [2, 0.01, 0], [2, 0.01, 0]],
    [[0, 0, 0], [0.3, 0.1, 0], [0, 0, 0], [0, 0.5, 0]],
)
LIMITS = MotionLimits(
    speed=0.5, acceleration=0.25, turn_speed=0.2, turn_acceleration=0.4, dwell=1.0
)
MOTION = PlatformMotion(POSES, [0.0, 0.1, -0.8, -0.8], LIMITS)


def test_way_points_are_reached_when_it_says_and_rested_at():
    for k, arrival in enumerate(MOTION.arrivals):
        for past in (0.0, 0.5, 0.999):
            at = MOTION.at(arrival + past)
            # The last line's end is a sum of its parts.
            np.testing.assert_allclose(at.position, POSES.position[k], atol=1e-12)
            np.testing.assert_allclose(at.rotation, POSES.rotation[k], atol=1e-12)
            assert (at.way_point, at.standing) == (k, True)
            assert not at.twist.any() and at.tilt == MOTION.tilts[k]
    assert not MOTION.at(MOTION.arrivals[0] + 1.5).standing
    assert MOTION.at(MOTION.duration + 9.0).way_point == 3
    assert MOTION.duration == pytest.approx(MOTION.arrivals[-1] + 1.0)


def test_long_line_takes_the_time_of_a_trapezoid():
    """2 m at 0.5 m/s and 0.25 m/s2: 2 / 0.5 + 0.5 / 0.25 s, and the rest before it."""
    assert MOTION.arrivals[1] == pytest.approx(1.0 + 6.0)


def test_twist_is_the_rate_of_the_pose_and_within_the_limits():
    """By central differences; accelerations by differences of the twist."""
    times = np.arange(0.003, MOTION.duration, 0.02)
    step = 1e-5
    twists = np.array([MOTION.at(t).twist for t in times])
    for t, twist in zip(times, twists, strict=True):
        before, after = MOTION.at(t - step), MOTION.at(t + step)
        turned = Rotation.from_matrix(after.rotation @ before.rotation.T).as_rotvec()
        rate = np.concatenate([after.position - before.position, turned]) / (2.0 * step)
        # A corner of the speed within the two steps: acceleration times step.
        np.testing.assert_allclose(rate, twist, atol=1e-5)
    speeds = np.linalg.norm(twists[:, :3], axis=1), np.linalg.norm(twists[:, 3:], axis=1)
    assert speeds[0].max() <= 0.5 + 1e-12 and speeds[1].max() <= 0.2 + 1e-12
    assert speeds[0].max() == pytest.approx(0.5)
    slopes = np.linalg.norm(np.diff(twists, axis=0), axis=1) / 0.02
    assert slopes.max() <= np.hypot(0.25, 0.4) + 1e-9
    assert trapezoid(speeds[0], times) == pytest.approx(2.01, abs=1e-3)


def test_tilt_takes_as_long_as_it_must():
    """The third way is 1 cm, but the tilt turns by 0.9 rad at 0.2 rad/s and 0.4 rad/s2."""
    assert MOTION.arrivals[2] - MOTION.arrivals[1] == pytest.approx(1.0 + 0.9 / 0.2 + 0.2 / 0.4)


def test_one_way_point_is_a_rest():
    still = PlatformMotion(make_poses([1, 2, 3]))
    assert still.at(100.0).standing
    np.testing.assert_array_equal(still.at(0.1).position, [1, 2, 3])


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="motion: speed = 0; must be > 0"):
        MotionLimits(speed=0.0)
    with pytest.raises(InputError, match="way points and tilts"):
        PlatformMotion(POSES, [0.0])
    with pytest.raises(InputError, match="must be finite numbers"):
        PlatformMotion(POSES, [0.0, np.nan, 0.0, 0.0])
