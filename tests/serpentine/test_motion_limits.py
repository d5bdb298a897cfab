"""The fastest motion along the report's trajectories keeps what the drives allow, and no slower."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.serpentine.drives import (
    drive_efforts,
    drive_limits,
    drive_names,
    drives_from_joints,
)
from pips_drake.serpentine.dynamics import inverse_dynamics
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.motion_limits import (
    fastest_motion,
    motion_limits,
    path_motion,
    profile_shares,
)
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.time_optimal import fastest_squared_speed, travel_time
from pips_drake.serpentine.tip_path import PathBuilder, polyline_path
from pips_drake.units import INCH

from .least_duration import least_duration

#: In frame {0} of the pad mounting, m/s^2.
GRAVITY = np.array([9.81, 0.0, 0.0])


def with_quick_rail(arm):
    """A rail eight times as fast, so that the truss's actuators bind."""
    return replace(arm, base_speed_limit=arm.base_speed_limit * [8.0, 1.0])


@pytest.fixture(scope="module")
def path():
    return load_path("trajectory_4_arcs")


@pytest.fixture(scope="module")
def motion(arm, path):
    return path_motion(arm, path, GRAVITY)


@pytest.fixture(scope="module")
def quick_motion(arm, path):
    return path_motion(with_quick_rail(arm), path, GRAVITY)


@pytest.mark.parametrize("smoothing", [0.0, 0.5])
@pytest.mark.parametrize("quick", [False, True])
def test_the_motion_keeps_every_limit(arm, path, motion, quick_motion, quick, smoothing):
    """Differences in time of postures alone, at other places than the grid's."""
    found = fastest_motion(quick_motion if quick else motion, share=0.9, smoothing=smoothing)
    arm = found.motion.arm
    rng, step = np.random.default_rng(4), 2e-3
    times = rng.uniform(2 * step, found.profile.duration - 2 * step, 400)
    q = []
    for offset in (-step, 0.0, step):
        travel = found.profile.motion(times + offset)[0]
        solution = FollowTheLeader(arm).solve(path, path.home_arc_length + travel)
        assert solution.solved.all()
        q.append(solution.joints)
    y = [drives_from_joints(arm, joints) for joints in q]
    _, _, speed_limit, effort_limit = drive_limits(arm)
    speed = np.abs(y[2] - y[0]) / (2 * step) / speed_limit
    acceleration = np.abs(y[2] - 2 * y[1] + y[0]) / step**2
    acceleration /= speed_limit / arm.drive_acceleration_time
    efforts = inverse_dynamics(
        arm, q[1], (q[2] - q[0]) / (2 * step), (q[2] - 2 * q[1] + q[0]) / step**2, GRAVITY
    )
    force = np.abs(drive_efforts(arm, q[1], efforts)) / effort_limit
    # A limit may be exceeded between points of the grid by what it changes over a millimetre (the
    # quick rail's tip crosses one in 3 ms), and joints have roundings of 1e-11 rad, over 4e-6 s^2.
    assert speed.max() <= 0.9 * 1.005
    assert acceleration.max() <= 0.9 * 1.02
    assert force.max() <= 0.9
    # And it is not slow: some limit is used up at most instants.
    used = np.max([speed, acceleration], axis=(0, 2))
    assert np.mean(used > 0.9 * (0.9 if smoothing else 0.99)) > (0.6 if smoothing else 0.95)


@pytest.mark.parametrize("quick", [False, True])
def test_nothing_is_faster(quick, motion, quick_motion):
    limits = motion_limits(quick_motion if quick else motion)
    # Every fifth point is enough for the linear program; the passes have the same points.
    count = (len(limits.travel) - 1) // 5
    coarse = replace(
        limits,
        travel=limits.travel[::5][: count + 1],
        speed=limits.speed[::5][: count + 1],
        slope=limits.slope[2::5][:count],
        curve=limits.curve[2::5][:count],
        offset=limits.offset[2::5][:count],
    )
    x = fastest_squared_speed(coarse)
    # The two passes are greedy; the issue asks for one percent.
    assert travel_time(coarse.travel, x)[-1] <= 1.01 * least_duration(coarse, x)


def test_a_finer_grid_changes_nothing(arm, path):
    quick = with_quick_rail(arm)
    durations = [
        fastest_motion(path_motion(quick, path, GRAVITY, step=step)).profile.duration
        for step in (4e-3, 2e-3, 1e-3, 0.5e-3)
    ]
    changes = np.abs(np.diff(durations))
    # Limits jump where spine points pass from line to arc, so that the error falls with the grid.
    assert changes[-1] < 1e-3 * durations[-1]
    assert changes[-1] < 0.75 * changes[0]


def test_the_rail_holds_trajectory_4_back(motion):
    """Its speed limit is twice the default tip speed, and the truss's actuators have more left."""
    found = fastest_motion(motion)
    assert set(found.binding_time) == {"d1 speed", "d1 acceleration"}
    assert [part.name for part in found.segments] == [
        "d1 acceleration",
        "d1 speed",
        "d1 acceleration",
    ]
    assert found.segments[0].start == 0.0
    assert found.segments[-1].end == pytest.approx(motion.travel[-1])
    assert sum(part.duration for part in found.segments) == pytest.approx(found.profile.duration)
    # In the two intervals in which one limit hands over to the next, neither is used up.
    used = found.binding[1]
    assert np.count_nonzero(used < 1.0 - 1e-9) <= 2
    assert used.min() > 0.97
    # At least the rail's travel over its speed.
    q = FollowTheLeader(motion.arm).solve(
        load_path("trajectory_4_arcs"), load_path("trajectory_4_arcs").marks[[0, -1]]
    )
    way = abs(q.joints[1, 0] - q.joints[0, 0])
    assert found.profile.duration > way / motion.arm.base_speed_limit[0]
    assert found.profile.duration < way / motion.arm.base_speed_limit[0] + 1.0


def test_with_a_quick_rail_the_actuators_take_turns(quick_motion):
    found = fastest_motion(quick_motion)
    actuators = {name.split()[0] for name in found.binding_time} - {"d1", "tip"}
    assert len(actuators) >= 5
    assert actuators <= set(drive_names(quick_motion.arm))


def test_forces_bind_where_they_are_scarce(arm, path):
    """With 1.05 times the force that holds it, an arm must be gentle."""
    heavy = with_quick_rail(arm)
    held = np.abs(path_motion(heavy, path, GRAVITY).hold).max(axis=0)
    first = arm.first_actuated_joint
    linkage = replace(
        arm.linkage, force_limit=np.maximum(1.02 * held[first:], 20.0), speed_limit=np.full(16, 1.0)
    )
    heavy = replace(
        heavy,
        linkage=linkage,
        base_effort_limit=1.05 * np.maximum(held[:first], 10.0),
        base_speed_limit=arm.base_speed_limit * 100.0,
        drive_acceleration_time=0.01,
    )
    found = fastest_motion(path_motion(heavy, path, GRAVITY))
    forced = [name for name in found.binding_time if name.endswith("force")]
    assert sum(found.binding_time[name] for name in forced) > 0.5 * found.profile.duration


def test_a_tip_speed_limit_makes_it_the_constant_motion(motion):
    found = fastest_motion(motion, tip_speed=0.025)
    times = np.linspace(0.0, found.profile.duration, 1000)
    speed = found.profile.motion(times)[1]
    assert speed.max() == pytest.approx(0.025, rel=1e-9)
    assert found.binding_time["tip speed"] > 0.98 * found.profile.duration


def test_half_of_the_speeds_take_twice_as_long(arm, path):
    """Speeds k, accelerations k^2, no gravity: the same motion in another time."""
    weightless = path_motion(arm, path, [0.0, 0.0, 0.0])
    slow = replace(
        arm,
        base_speed_limit=0.5 * arm.base_speed_limit,
        linkage=replace(arm.linkage, speed_limit=0.5 * arm.linkage.speed_limit),
        drive_acceleration_time=2.0 * arm.drive_acceleration_time,
    )
    half = path_motion(slow, path, [0.0, 0.0, 0.0])
    assert fastest_motion(half).profile.duration == pytest.approx(
        2.0 * fastest_motion(weightless).profile.duration, rel=1e-9
    )


def test_the_way_back_uses_the_same_of_every_limit(quick_motion):
    """Nothing rubs: a motion run backwards needs the same speeds, accelerations and forces."""
    found = fastest_motion(quick_motion, smoothing=0.5)
    limits = found.limits
    time = np.linspace(0.0, found.profile.duration, 501)
    there = profile_shares(limits, found.profile, time)
    travel, speed, acceleration = found.profile.motion(time[::-1])
    i = np.clip(np.searchsorted(limits.travel, travel, side="right") - 1, 0, None)
    i = np.minimum(i, len(limits.travel) - 2)
    # Backwards s' changes its sign, s'' does not.
    back = limits.slope[i] * acceleration[:, None] + limits.curve[i] * (-speed[:, None]) ** 2
    np.testing.assert_allclose(back + limits.offset[i], there[1][::-1], rtol=1e-12, atol=1e-12)


def test_a_mirrored_arm_is_as_fast(arm, path):
    mirrored = path_motion(replace(arm, mirrored=True), path.mirrored(), GRAVITY)
    assert fastest_motion(mirrored).profile.duration == pytest.approx(
        fastest_motion(path_motion(arm, path, GRAVITY)).profile.duration, rel=1e-9
    )


def test_a_short_way_has_points_enough(arm):
    z = 174.902 * INCH
    home = PathBuilder(start=[16.255 * INCH, 0.0, 0.0], direction=[0.0, 0.0, 1.0]).line(z).home()
    found = fastest_motion(path_motion(arm, home.line(2e-3).build("two millimetres"), GRAVITY))
    # The rail at 0.1 m/s^2, there and back to rest.
    assert found.profile.duration == pytest.approx(2.0 * np.sqrt(2e-3 / 0.1), rel=1e-3)


def test_corners_are_refused_by_name(arm):
    points = np.array([[16.255, 0, 0], [16.255, 0, 174.902], [16.255, 0, 180], [17, 0, 185]])
    with pytest.raises(InputError, match=r"path 'bent' has corners \(up to 8\.4.* deg\)"):
        path_motion(arm, polyline_path(points * INCH, "bent"), GRAVITY)


def test_what_cannot_be_followed_is_said(arm):
    z = 174.902 * INCH
    path = (
        PathBuilder(start=[16.255 * INCH, 0.0, 0.0], direction=[0.0, 0.0, 1.0])
        .line(z)
        .home()
        .arc(radius=0.02, angle=3.1, toward=[1.0, 0.0, 0.0])
        .line(4.0)
        .build("knot")
    )
    with pytest.raises(NotFollowableError, match="tip at"):
        path_motion(arm, path, GRAVITY)


def test_what_cannot_be_held_is_said(arm, path):
    force = arm.linkage.force_limit.copy()
    force[0] = 1000.0
    weak = replace(arm, linkage=replace(arm.linkage, force_limit=force))
    with pytest.raises(NotFollowableError, match=r"at rest .* L3 force stands at \d+"):
        fastest_motion(path_motion(weak, path, GRAVITY))


@pytest.mark.parametrize("share", [0.0, -1.0, 1.01, np.nan])
def test_an_unusable_share_is_refused(motion, share):
    with pytest.raises(InputError, match="must be > 0 and <= 1"):
        motion_limits(motion, share=share)


@pytest.mark.parametrize("speed", [0.0, -1.0, np.nan])
def test_an_unusable_tip_speed_is_refused(motion, speed):
    with pytest.raises(InputError, match="tip speed limit"):
        motion_limits(motion, tip_speed=speed)
