"""Three views of a plan: what they draw is the field's and the arm's, and where they draw it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from matplotlib.image import imread
from numpy.testing import assert_allclose
from pydrake.geometry import Box, Cylinder, HalfSpace, Sphere
from pydrake.math import RigidTransform

from pips_drake.planning.grid import Grid
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.runs.outlines import (
    arm_corners,
    blocked_bodies,
    drawn_shapes,
    unfolded_line,
    unfolded_marks,
    unfolded_polygons,
    unfolding,
)
from pips_drake.planning.runs.unfolded_panel import unfolded_panel
from pips_drake.planning.runs.views import ViewedPath, draw_views
from pips_drake.scene.signed_distance import PlacedShape, SignedDistanceField
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm

#: A payload of 1 m radius on the z axis, a bar beside it at 90 deg, and a wall far away.
BAR = 1.35


@pytest.fixture(scope="module")
def field():
    return SignedDistanceField.of(
        [
            PlacedShape("payload", "", Cylinder(1.0, 20.0), RigidTransform()),
            PlacedShape("bar", "", Box(0.2, 0.7, 0.4), RigidTransform([0.0, BAR, 5.0])),
            PlacedShape("floor", "", HalfSpace(), RigidTransform([0.0, 0.0, -50.0])),
            PlacedShape("mast", "", Cylinder(0.1, 40.0), RigidTransform([9.0, 0.0, 0.0])),
        ]
    )


@pytest.fixture(scope="module")
def unfolded(field):
    grid = Grid(
        lower=np.array([2.0, -math.pi, 0.9]),
        upper=np.array([8.0, math.pi, 1.6]),
        shape=(60, 72, 7),
        unfolded=True,
    )
    return Occupancy.of(field, grid, 0.1)


def test_shapes_are_drawn_where_they_stand_and_far_ones_as_surroundings(field, unfolded):
    shapes = drawn_shapes(field, unfolded.grid)
    assert [field.bodies[shape.body] for shape in shapes] == ["payload", "bar", "mast"]
    assert [shape.inside for shape in shapes] == [True, True, False]
    bar = shapes[1]
    assert_allclose(bar.hull.vertices.min(axis=0), [-0.1, BAR - 0.35, 4.8], atol=1e-12)
    assert_allclose(bar.hull.vertices.max(axis=0), [0.1, BAR + 0.35, 5.2], atol=1e-12)
    assert len(bar.edges) == 12  # a box's, without its faces' diagonals
    assert_allclose(
        sorted(np.linalg.norm(np.diff(bar.edges, axis=1)[:, 0], axis=1)),
        [0.2] * 4 + [0.4] * 4 + [0.7] * 4,
        atol=1e-12,
    )


def test_an_obstacle_is_named_where_it_leaves_no_room(field, unfolded):
    """The bar at 90 deg, 5 m, through the whole gap; elsewhere there is room."""
    body, full = blocked_bodies(unfolded)
    along = 2.0 + 0.1 * (np.arange(60) + 0.5)
    around = -180.0 + 5.0 * (np.arange(72) + 0.5)
    there = np.ix_(np.abs(along - 5.0) < 0.2, np.abs(around - 90.0) < 4.0)
    assert full[there].all()
    assert (body[there] == field.bodies.index("bar")).all()
    # The arm's radius and half a cell's diagonal away nothing is taken.
    away = np.ix_(np.abs(along - 5.0) > 0.5, np.abs(around - 90.0) > 25.0)
    assert not full[away].any()
    assert (body[away] == -1).all()


def test_a_box_is_unfolded_around_its_widest_upright_cylinder(field, unfolded):
    lower, upper = np.array([-2.0, -2.0, 2.0]), np.array([2.0, 2.0, 8.0])
    box = Occupancy.of(field, Grid(lower=lower, upper=upper, shape=(20, 20, 30)), 0.1)
    found = unfolding(box, middle=[0.0, -1.5, 3.0])
    assert found.grid.unfolded
    assert found.grid.lower[2] == 1.0
    assert_allclose(found.grid.arrays.origin, 0.0, atol=1e-12)
    # The seam is opposite to the point.
    assert found.grid.lower[1] == pytest.approx(-1.5 * math.pi, abs=1e-12)
    assert unfolding(unfolded) is unfolded
    ball = PlacedShape("ball", "", Sphere(1.0), RigidTransform())
    none = Occupancy.of(SignedDistanceField.of([ball]), box.grid, 0.1)
    assert unfolding(none) is None


def test_lines_are_cut_at_the_seam_and_bent_between_their_points(unfolded):
    """A helix with few points, across the seam: where it is drawn it has the line's own place."""
    angles = np.radians([151.0, 171.0, 193.0, 209.0])
    points = np.column_stack([1.3 * np.cos(angles), 1.3 * np.sin(angles), [3.0, 4.0, 5.0, 6.0]])
    line = unfolded_line(unfolded.grid, points)
    gap = np.flatnonzero(np.isnan(line[:, 0]))
    assert len(gap) == 1
    before, after = line[: gap[0]], line[gap[0] + 1 :]
    assert before[-1, 1] > 180.0 > before[-2, 1]
    assert after[0, 1] < -180.0 < after[1, 1]
    for part in (before, after):
        assert np.abs(np.diff(part[:, 1])).max() < 3.0
    # On a chord of 20 deg the middle is at the middle's angle and height.
    assert_allclose(before[10], [3.5, 161.0], atol=1e-9)
    assert_allclose(line[[0, -1]], [[3.0, 151.0], [6.0, -151.0]], atol=1e-9)


def test_bodies_on_the_seam_are_drawn_on_both_sides(unfolded):
    corner = np.array([[x, y, z] for x in (-1.2, -1.4) for y in (-0.2, 0.2) for z in (3.0, 3.3)])
    first, second = unfolded_polygons(unfolded.grid, corner)
    half = math.degrees(math.atan2(0.2, 1.2))
    for outline, middle in ((first, None), (second, None)):
        assert np.ptp(outline[:, 0]) == pytest.approx(0.3, abs=1e-12)
        assert np.ptp(outline[:, 1]) == pytest.approx(2.0 * half, abs=1e-9)
        assert abs(abs(outline[:, 1].mean()) - 180.0) < half, middle
    assert abs(first[:, 1].mean() - second[:, 1].mean()) == pytest.approx(360.0, abs=1e-6)
    assert len(unfolded_polygons(unfolded.grid, corner * [-1.0, 1.0, 1.0])) == 1


def test_a_goal_on_the_seam_is_marked_on_both_sides(unfolded):
    points, which = unfolded_marks(unfolded.grid, [[-1.3, 1e-3, 4.0], [0.0, 1.3, 5.0]])
    assert which.tolist() == [0, 1, 0]
    assert_allclose(points[1], [5.0, 90.0], atol=1e-9)
    assert points[0, 1] - points[2, 1] == pytest.approx(360.0, abs=1e-9)
    assert 179.0 < points[0, 1] < 180.0


def test_the_pages_arm_goes_where_the_spine_goes(unfolded):
    """A motion along the base line: its last point at each time is the tip's height and angle."""
    arm = load_arm("cmu_92")
    joints = np.repeat(arm.joint_home[None], 5, axis=0)
    joints[:, 0] += np.linspace(0.0, 2.0, 5)
    panel = unfolded_panel(
        unfolded,
        arm,
        times=np.arange(5.0),
        joints=joints,
        shift=-6.0,
        paths=[ViewedPath(points=[[1.2, 0.0, 2.0], [1.2, 0.0, 7.0]])],
        goals=[[0.0, 1.3, 7.0]],
    )
    tips = kinematics.spine_points(arm, joints)[:, -1] + [0.0, 0.0, -6.0]
    ends = np.array([line[-1] for line in panel.moving])
    assert_allclose(ends[:, 0], tips[:, 2], atol=1e-9)
    assert_allclose(ends[:, 1], np.degrees(np.arctan2(tips[:, 1], tips[:, 0])), atol=1e-9)
    assert panel.times.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert panel.picture.shape == (72, 60, 3)
    assert_allclose(panel.lines[-1].points, [[7.0, 90.0]], atol=1e-9)
    for view in panel.views:
        assert_allclose(view.target, [0.0, 0.0, 5.0], atol=1e-9)
    # Without anything upright to unfold around, the page has none.
    ball = PlacedShape("ball", "", Sphere(1.0), RigidTransform())
    box = Grid(lower=np.full(3, -2.0), upper=np.full(3, 2.0), shape=(9, 9, 9))
    none = Occupancy.of(SignedDistanceField.of([ball]), box, 0.1)
    assert unfolded_panel(none, arm, times=np.arange(5.0), joints=joints) is None


def test_the_arm_is_drawn_as_its_boxes_where_its_feed_stands():
    """Straight at home: all around the base line, moved along it by the shift."""
    arm = load_arm("cmu_92")
    corners, boxes = arm_corners(arm, arm.joint_home[None], shift=-2.5)
    spine = kinematics.spine_points(arm, arm.joint_home)[0] + [0.0, 0.0, -2.5]
    links = corners[0][boxes]
    assert boxes.sum() >= 21  # twenty links and the camera's head
    # The head reaches 5 in beyond the last spine point.
    assert links[..., 2].max() == pytest.approx(spine[-1, 2] + 5.0 * 0.0254, abs=1e-9)
    tip = links[links[..., 2].min(axis=1) > spine[-3, 2]]
    assert np.abs(tip[..., :2] - spine[-1, :2]).max() < 0.75 * 4.0 * 0.0254 + 1e-9


@pytest.mark.slow
def test_three_views_are_drawn_of_a_gap_and_of_a_box(field, unfolded, tmp_path):
    """They differ where the arm is, and only there: so it is in the picture."""
    arm = load_arm("cmu_92")
    angles = np.linspace(-1.0, 1.2, 30)
    path = np.column_stack([1.3 * np.cos(angles), 1.3 * np.sin(angles), 5.0 + angles])
    lower, upper = np.array([-2.0, -2.0, 2.0]), np.array([2.0, 2.0, 8.0])
    box = Occupancy.of(field, Grid(lower=lower, upper=upper, shape=(20, 20, 30)), 0.1)
    pictures = []
    for name, occupancy, postures in (
        ("gap", unfolded, None),
        ("arm", unfolded, arm.joint_home[None]),
        ("box", box, arm.joint_home[None]),
    ):
        draw_views(
            tmp_path / f"{name}.png",
            occupancy=occupancy,
            arm=arm,
            paths=[
                ViewedPath(points=path),
                ViewedPath(points=path * [1.0, -1.0, 1.0], label="another", alternative=True),
            ],
            postures=postures,
            shift=-3.0,
            goals=path[-1:],
            title=name,
        )
        pictures.append(imread(tmp_path / f"{name}.png"))
    assert pictures[0].shape[1] == pictures[2].shape[1] == 1500
    changed = np.abs(pictures[0] - pictures[1]).max(axis=2) > 0.1
    height, width = changed.shape
    # On the left above, on the right above, and below.
    above, below = changed[60 : int(0.5 * height)], changed[int(0.55 * height) :]
    assert above[:, : width // 2].any()
    assert above[:, width // 2 :].any()
    assert below.any()
