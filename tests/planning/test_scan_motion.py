"""The arm scans: its tip goes along the pattern, the rest follows, and nothing is touched."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.geometry import Cylinder
from pydrake.math import RigidTransform, RotationMatrix

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.planning.grid import Grid
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.scan_leader import APPROACH, CHANGE, DETOUR, SCAN
from pips_drake.planning.scan_motion import ScanSettings, camera_lag, plan_scan
from pips_drake.planning.scan_route import route_around
from pips_drake.planning.scan_target import CylinderTarget, ScanCamera
from pips_drake.planning.scanning import helix, pattern_of_points, raster
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import PlacedShape, read_distance_field
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.drives import drive_limits, drives_from_joints
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import load_setup

#: The bay's axis in frame_0, and its payload (`cargo_bay.dmd.yaml`).
AXIS, PAYLOAD, STANDOFF = (-1.621, 0.0, 0.0), 1.79, 0.244
HOME = [0.412877, 0.0, 4.4425]
CAMERA, ON_PATTERN = ScanCamera(), ScanSettings(lag=0.0)


@pytest.fixture(scope="module")
def occupancy():
    """The first half of the bay, unfolded; cells of about half a decimetre around."""
    grid = Grid(
        lower=np.array([4.4, -math.pi, 1.5]),
        upper=np.array([14.0, math.pi, 2.28]),
        shape=(96, 256, 8),
        unfolded=True,
        origin=np.array(AXIS),
    )
    return Occupancy.of(read_distance_field(find_scene_file("cargo_bay")), grid, 0.12)


@pytest.fixture(scope="module")
def arm():
    return load_arm("cmu_92")


def part(along, around_deg):
    low, high = np.radians(around_deg)
    return CylinderTarget(radius=PAYLOAD, along=along, around=(low, high), origin=AXIS)


def lines(along, around_deg, **more):
    return raster(part(along, around_deg), CAMERA, standoff=STANDOFF, overlap=0.0, **more)


def scan(arm, occupancy, pattern, settings=None):
    return plan_scan(
        arm, occupancy, pattern, home_tip=HOME, camera=CAMERA, settings=settings or ScanSettings()
    )


def post(around_deg, along):
    """A bar from payload to wall, 8 cm thick."""
    out = np.array([math.cos(math.radians(around_deg)), math.sin(math.radians(around_deg)), 0.0])
    R = RotationMatrix.MakeFromOneVector(out, 2)
    place = np.array(AXIS) + 2.03 * out + [0.0, 0.0, along]
    return PlacedShape("post", "", Cylinder(0.04, 0.6), RigidTransform(R, place))


def collisions(found, tmp_path, count):
    """How many of `count` postures, at equal times, touch anything by Drake's account."""
    file = tmp_path / "planned.csv"
    points = found.approach.points
    np.savetxt(file, points, delimiter=",", header="x_m,y_m,z_m", comments="")
    scenario = SerpentineScenario(
        arm="cmu_92", path=str(file), scene="cargo_bay", mounting="laboratory"
    )
    placed = place_arm(scenario, load_setup(scenario))
    postures = found.motion.at(np.linspace(0.0, found.motion.duration, count))
    return sum(query.HasCollisions() for query in placed.posed(postures))


def check_motion(found, arm, settings):
    """What holds of every scan: limits, no leaps, speeds, and no contact."""
    q = found.motion.joints
    assert_allclose(q[0], arm.joint_home, rtol=0, atol=1e-9)
    assert (q >= arm.joint_lower - 1e-9).all()
    assert (q <= arm.joint_upper + 1e-9).all()
    filmed = found.stages[1:] == SCAN
    turns = np.abs(np.diff(q, axis=0))[:, 1:].max(axis=1)
    assert turns[filmed].max() <= settings.leap + 1e-12
    # Rows on the way there and back follow a path with a step of 7 cm: at a link's 0.457 m and 45
    # deg a hinge turns by less than 12 deg on it.
    assert turns.max() < math.radians(12.0)
    steps = np.diff(found.motion.times)[:, None]
    speeds = np.abs(np.diff(drives_from_joints(arm, q), axis=0)) / steps
    used = speeds / (settings.drive_share * drive_limits(arm)[2])
    tip = np.linalg.norm(np.diff(found.tips, axis=0), axis=1) / steps[:, 0] / settings.tip_speed
    assert max(used.max(), tip.max()) <= 1.0 + 1e-9
    # It is as fast as that allows, at every step.
    assert np.maximum(used.max(axis=1), tip).min() > 1.0 - 1e-6
    assert 0.0 < found.clearance.lower <= found.clearance.seen


@pytest.fixture(scope="module")
def small(arm, occupancy):
    return scan(arm, occupancy, lines((6.6, 7.0), (-20.0, 25.0)), ON_PATTERN)


def test_the_tip_is_on_every_point_of_the_pattern(small, arm):
    assert small.failures == ()
    assert small.reached.all()
    check_motion(small, arm, ON_PATTERN)
    at = small.rows >= 0
    assert_allclose(small.tips[at], small.pattern.points[small.rows[at]], rtol=0, atol=1e-9)
    spine = kinematics.spine_points(arm, small.motion.joints)[:, -1]
    assert_allclose(spine + small.shift, small.tips, rtol=0, atol=1e-12)
    assert (small.stages[at] == SCAN).all()
    assert small.stages[0] == APPROACH


def test_the_whole_arm_moves_aside_not_only_its_tip(small, arm):
    rows = np.flatnonzero(small.rows >= 0)
    spine = kinematics.spine_points(arm, small.motion.joints[rows[[0, 8]]])
    moved = np.linalg.norm(spine[1] - spine[0], axis=1)
    # Eight steps of a decimetre: a metre behind the tip the arm still moves by centimetres.
    assert moved[-1] > 0.7
    assert moved[-3] > 0.1


def test_the_first_row_that_is_missed_with_the_tip_on_the_pattern_is_seen_when_it_trails(
    small, arm, occupancy
):
    lag = camera_lag(arm, CAMERA, STANDOFF)
    # A head of 5 in, and 30 deg short of straight down.
    head = arm.bodies[-1].size[0]
    assert lag == pytest.approx(head + STANDOFF / math.tan(math.radians(60.0)))
    trailing = scan(arm, occupancy, small.pattern)
    check_motion(trailing, arm, ScanSettings())
    assert small.coverage.share < 0.7
    assert trailing.coverage.share > 0.95
    # What was missed lies where the arm comes from.
    assert small.coverage.holes[0].middle[0] < 6.75
    at = trailing.rows >= 0
    ahead = trailing.pattern.points[trailing.rows[at]] - trailing.tips[at]
    behind = np.linalg.norm(ahead, axis=1)
    # Along a way that bends no more than links can: nearly straight.
    assert behind.max() <= lag + 1e-9
    assert behind.min() > 0.9 * lag


def test_a_post_in_the_way_is_named_gone_around_and_not_touched(arm, occupancy):
    pattern = lines((6.6, 6.8), (-25.0, 25.0))
    assert len(np.unique(pattern.passes)) == 1
    among = occupancy.updated(occupancy.field.with_shapes([post(2.0, 6.7)]))
    found = scan(arm, among, pattern, ON_PATTERN)
    assert found.failures == ()
    check_motion(found, arm, ON_PATTERN)
    # The line runs through the post's middle: refused are points whose camera head may
    # come too near to it.
    _, around, _ = pattern.target.from_world(pattern.points)
    middle = np.array([AXIS[0], 0.0, 6.7])
    out = np.array([math.cos(math.radians(2.0)), math.sin(math.radians(2.0)), 0.0])
    away = pattern.points - middle
    # (5 in of it, half the diagonal of 3 in square, and 2 cm.)
    beyond = 0.127 + math.hypot(0.0381, 0.0381) + 0.02
    near = np.linalg.norm(away - np.outer(away @ out, out), axis=1) < 0.04 + beyond
    assert near.any()
    assert (found.route.refused == near).all()
    assert found.route.blockers == {"post": near.mean()}
    assert (found.reached == ~near).all()
    # Around the side that the arm comes from, so that it is not hooked on the post.
    detour = found.tips[found.stages == DETOUR]
    assert len(detour) > 1
    assert detour[:, 2].max() < 6.7 + 0.11
    assert detour[:, 2].min() < 6.7 - 0.1
    assert any("post" in note for note in found.notes)
    assert np.ptp(around) > 0.6


def test_an_arm_that_is_held_by_a_post_draws_back_and_comes_along_its_other_side(arm, occupancy):
    among = occupancy.updated(occupancy.field.with_shapes([post(2.0, 6.9)]))
    # A line from side to side beyond the post, on which the arm leans as its tip goes on.
    found = scan(arm, among, lines((7.0, 7.2), (-80.0, 80.0)))
    assert found.failures == ()
    check_motion(found, arm, ScanSettings())
    assert found.reached.all()
    changing = found.stages == CHANGE
    assert changing.any()
    assert sum(note.startswith("changed over") for note in found.notes) == 1
    # To get to the other side the tip comes back before the post; while it scans it never does.
    assert found.tips[changing][:, 2].min() < 6.9 - 0.12
    assert found.tips[found.stages == SCAN][:, 2].min() > 6.8


@pytest.mark.slow
def test_a_scan_ends_where_the_arm_is_too_short_and_says_so(arm, occupancy):
    # Along the bay, 0.5 m beyond what the feed exposes.
    way = [[0.412877, 0.0, z] for z in (13.3, 13.9)]
    found = scan(arm, occupancy, pattern_of_points(way, target=part((13.3, 13.9), (-10, 10))))
    assert 0.1 < found.reached_share < 0.9
    assert len(found.failures) == 1
    assert "the arm is too short: d1 = " in found.failures[0]
    # From home the feed exposes 350 in; the snake's end is the lag ahead, on an all but straight
    # way: within a step.
    last = found.pattern.points[np.flatnonzero(found.reached)[-1]]
    lag = camera_lag(arm, CAMERA, found.pattern.standoff)
    assert last[2] - HOME[2] == pytest.approx(350 * 0.0254 + lag, abs=0.12)
    assert 0.0 < found.coverage.share < 1.0


def test_what_no_way_leads_to_is_left_out_and_said(occupancy):
    disc = PlacedShape("wall", "", Cylinder(2.4, 0.04), RigidTransform([AXIS[0], 0.0, 7.0]))
    walled = occupancy.updated(occupancy.field.with_shapes([disc]))
    pattern = lines((6.5, 7.5), (-10.0, 10.0), lines="along")
    route = route_around(pattern, walled, base=HOME)
    beyond = pattern.points[:, 2] > 7.0
    assert (route.cut == (beyond & ~route.refused)).all()
    assert route.blockers.keys() == {"wall"}
    # Half a wall's thickness and the arm's radius to either side of it.
    assert (route.refused == (np.abs(pattern.points[:, 2] - 7.0) < 0.02 + 0.12)).all()
    assert (route.rows[route.rows >= 0] == np.flatnonzero(~route.refused & ~beyond)).all()
    assert "no way leads there" in route.sentences()[-1]


def test_any_surface_is_scanned_point_by_point_without_a_target(arm, occupancy):
    pattern = pattern_of_points([[0.41, -0.3, 6.6], [0.41, 0.3, 6.6]], field=occupancy.field)
    found = scan(arm, occupancy, pattern)
    assert found.reached.all()
    assert found.coverage is None
    assert found.poses is None


def test_what_cannot_be_scanned_is_refused(arm, occupancy):
    pattern = lines((6.6, 7.0), (-20.0, 25.0))
    with pytest.raises(
        InputError, match=r"standoff = 0\.4 m; must be .* the gap's middle is 0\.24"
    ):
        far = raster(pattern.target, CAMERA, standoff=0.4)
        scan(arm, occupancy, far)
    with pytest.raises(InputError, match="all of it is too near to payload"):
        inside = pattern_of_points([[0.0, 0.0, 7.0], [0.0, 0.0, 8.0]], target=pattern.target)
        scan(arm, occupancy, inside)
    # In the workspace, and farther than the feed exposes.
    beyond = pattern_of_points([[0.413, 0.0, 13.8], [0.413, 0.0, 13.9]], target=pattern.target)
    with pytest.raises(NotFollowableError, match="scan's beginning: the arm is too short"):
        scan(arm, occupancy, beyond)


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({"tip_speed": 0.0}, r"tip speed = 0\.0 m/s; must be > 0"),
        ({"drive_share": 1.5}, "drive share = 1.5"),
        ({"lag": math.nan}, "lag = nan m"),
        ({"leap": 0.0}, "leap = 0 deg"),
        ({"changes": -1}, "changes = -1"),
    ],
)
def test_settings_that_mean_nothing_are_refused(numbers, words):
    with pytest.raises(InputError, match=words):
        ScanSettings(**numbers)


@pytest.mark.slow
def test_half_of_the_payloads_girth_is_scanned_without_a_contact(arm, occupancy, tmp_path):
    found = scan(arm, occupancy, lines((6.4, 8.4), (-90.0, 90.0)))
    check_motion(found, arm, ScanSettings())
    assert found.reached.all()
    assert found.coverage.share > 0.99
    assert found.clearance.lower > 0.05
    assert collisions(found, tmp_path, 600) == 0


@pytest.mark.slow
def test_among_pins_pipes_and_housings_nothing_is_touched(arm, occupancy, tmp_path):
    found = scan(arm, occupancy, lines((8.6, 9.9), (-60.0, 60.0)))
    assert found.failures == ()
    check_motion(found, arm, ScanSettings())
    assert (found.reached == ~(found.route.refused | found.route.cut)).all()
    names = " ".join(found.route.blockers)
    assert all(name in names for name in ("cable_tray", "antenna", "pipe"))
    # 7 % lie beside pipe, tray and antenna, where the tip has no room.
    assert 0.9 < found.coverage.share < 0.95
    assert found.coverage.hidden_areas.keys() == {"obstacles::obstacles (antenna)"}
    assert collisions(found, tmp_path, 600) == 0


@pytest.mark.slow
def test_a_helix_goes_all_the_way_around_the_payload(arm, occupancy, tmp_path):
    whole = CylinderTarget(radius=PAYLOAD, along=(6.7, 7.1), origin=AXIS)
    found = scan(arm, occupancy, helix(whole, CAMERA, standoff=STANDOFF, overlap=0.0))
    assert found.failures == ()
    check_motion(found, arm, ScanSettings())
    assert found.reached.all()
    assert found.coverage.share > 0.98
    assert collisions(found, tmp_path, 600) == 0
