"""What a camera saw of a surface: strips by closed form, holes, and what obstacles hide."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose
from pydrake.geometry import Box, Cylinder, Sphere
from pydrake.math import RigidTransform

from pips_drake.errors import InputError
from pips_drake.planning.coverage import (
    CameraPoses,
    blockers,
    camera_poses,
    cover,
    view_rotation,
)
from pips_drake.planning.coverage_figure import draw_coverage
from pips_drake.planning.scan_target import CylinderTarget, ScanCamera
from pips_drake.planning.scanning import helix, raster, swath_along, swath_around
from pips_drake.scene.signed_distance import PlacedShape, SignedDistanceField
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.twin.camera import camera_rotation

RADIUS, STANDOFF = 1.79, 0.244
#: A square picture, so that a strip is as wide whichever way the camera is turned.
SQUARE = ScanCamera(aspect=1.0, roll=0.0)
WIDE = swath_along(SQUARE, STANDOFF)


def target(length, turn=(0.0, 1.0)):
    return CylinderTarget(radius=RADIUS, along=(0.0, length), around=turn)


def straight_down(where, pattern):
    """Poses of a camera that looks straight at the surface, upright along the axis."""
    ahead = pattern.views
    right = np.cross([0.0, 0.0, 1.0], ahead)
    rotations = np.stack([right, np.cross(ahead, right), ahead], axis=-1)
    return CameraPoses(positions=where, rotations=rotations, off=np.zeros(len(where)))


def seen_by(pattern, *, shape=None, size=0.01):
    scene = None if shape is None else SignedDistanceField.of(shape)
    poses = straight_down(pattern.points, pattern)
    return cover(pattern.target, SQUARE, poses, passes=pattern.passes, field=scene, size=size)


def test_one_line_sees_a_strip_of_the_width_that_the_fields_angle_gives():
    # One line in the middle of a target that is three strips wide.
    line = raster(target(WIDE), SQUARE, standoff=STANDOFF, overlap=0.0)
    wide = CylinderTarget(radius=RADIUS, along=(-WIDE, 2.0 * WIDE), around=(0.0, 1.0))
    poses = straight_down(line.points, line)
    found = cover(wide, SQUARE, poses, size=WIDE / 60.0)
    middle = found.seen[:, found.seen.shape[1] // 2]
    # On the line the edges are exactly half a strip away; what stands lower beside it, farther.
    assert found.share == pytest.approx(1.0 / 3.0, abs=0.03)
    assert middle.sum() in (60, 61, 62)
    assert_allclose(np.flatnonzero(middle)[[0, -1]], [60, 119], atol=1)


def test_strips_without_overlap_cover_all_and_hardly_anything_twice():
    found = seen_by(raster(target(4.0 * WIDE), SQUARE, standoff=STANDOFF, overlap=0.0))
    assert found.share == 1.0
    assert found.holes == ()
    assert found.area == pytest.approx(4.0 * WIDE * RADIUS)
    # Away from the joints at the lines' ends, exactly once: strips touch.
    assert (found.passes[:, 25:-25] == 1).all()


def test_at_half_the_spacing_each_place_is_seen_twice():
    found = seen_by(raster(target(4.0 * WIDE), SQUARE, standoff=STANDOFF, overlap=0.5))
    rows = found.passes.shape[0]
    inner = found.passes[rows // 8 + 1 : -rows // 8 - 1, 25:-25]
    assert inner.min() == 2
    assert (inner == 2).mean() > 0.85


def test_lines_along_the_axis_cover_their_angles_and_no_more():
    turn = swath_around(SQUARE, STANDOFF, RADIUS)
    line = raster(target(2.0, (0.0, turn)), SQUARE, standoff=STANDOFF, lines="along", overlap=0.0)
    wide = target(2.0, (-turn, 2.0 * turn))
    found = cover(wide, SQUARE, straight_down(line.points, line), size=0.005)
    columns = np.flatnonzero(found.seen[found.seen.shape[0] // 2])
    share = found.passes.shape[1] / 3.0
    assert_allclose(columns[[0, -1]], [share, 2.0 * share - 1.0], atol=1.0)


def test_a_helix_leaves_nothing_unseen_all_the_way_around():
    whole = CylinderTarget(radius=RADIUS, along=(0.0, 0.6))
    found = seen_by(helix(whole, SQUARE, standoff=STANDOFF, overlap=0.1), size=0.025)
    assert found.share == 1.0


def test_a_skipped_line_is_a_hole_of_a_strips_width_also_across_the_seam():
    whole = CylinderTarget(radius=RADIUS, along=(0.0, 3.0 * WIDE))
    lines = raster(whole, SQUARE, standoff=STANDOFF, overlap=0.0, step=0.05)
    poses = straight_down(lines.points, lines)
    kept = np.abs(lines.points[:, 2] - 1.5 * WIDE) > 0.6 * WIDE
    poses = CameraPoses(
        positions=poses.positions[kept], rotations=poses.rotations[kept], off=poses.off[kept]
    )
    found = cover(whole, SQUARE, poses, size=0.02)
    hole = found.holes[0]
    assert hole.along == pytest.approx(WIDE, abs=0.04)
    assert hole.around == pytest.approx(2.0 * math.pi * RADIUS)
    assert hole.area == pytest.approx(2.0 * math.pi * RADIUS * WIDE, rel=0.1)
    assert len(found.holes) == 1
    assert found.sentences()[1].startswith("largest hole")


def test_what_a_box_hides_is_its_shadow_and_bears_its_name():
    flat = raster(target(WIDE, (0.4, 0.6)), SQUARE, standoff=STANDOFF, overlap=0.0)
    middle = len(flat.points) // 2
    # A square plate of 40 mm halfway to the surface, under a camera that stands still.
    place = flat.points[middle] + 0.5 * STANDOFF * flat.views[middle]
    R = np.column_stack([np.cross([0.0, 0.0, 1.0], flat.views[middle]), [0, 0, 1], np.zeros(3)])
    R[:, 2] = np.cross(R[:, 0], R[:, 1])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, place
    plate = PlacedShape("plate", "", Box(0.04, 0.04, 1e-3), RigidTransform(pose))
    shell = PlacedShape("payload", "shell", Cylinder(RADIUS, 10.0), RigidTransform())
    poses = straight_down(flat.points[middle][None], flat)
    poses = CameraPoses(
        positions=poses.positions,
        rotations=poses.rotations[middle][None],
        off=np.zeros(1),
    )
    found = cover(
        flat.target, SQUARE, poses, field=SignedDistanceField.of([plate, shell]), size=2e-3
    )
    # At half the way a shadow is twice as large; across, the surface falls away by 0.4 mm there.
    assert found.obstacles == ("plate",)
    assert found.hidden_areas["plate"] == pytest.approx(0.08**2, rel=0.05)
    assert "always behind plate" in found.sentences()[-1]


def test_what_lies_on_the_surface_is_not_counted_and_hides_what_is_behind_it():
    ball = PlacedShape("ball", "", Sphere(0.1), RigidTransform([RADIUS, 0.0, 0.5 * WIDE]))
    shell = PlacedShape("payload", "shell", Cylinder(RADIUS, 10.0), RigidTransform())
    lines = raster(target(WIDE, (-0.3, 0.3)), SQUARE, standoff=STANDOFF, overlap=0.0)
    found = seen_by(lines, shape=[ball, shell], size=5e-3)
    # The ball's foot is a disc of its radius, on a surface that is all but flat there.
    assert found.covered.sum() * found.patch_area == pytest.approx(math.pi * 0.1**2, rel=0.05)
    assert found.area == pytest.approx(found.target.area - math.pi * 0.1**2, rel=0.01)
    assert not (found.seen & found.covered).any()


def test_rays_end_at_the_first_shape_and_pass_beside_the_others():
    shapes = [
        PlacedShape("near", "", Sphere(0.1), RigidTransform([1.0, 0.0, 0.0])),
        PlacedShape("far", "", Sphere(0.1), RigidTransform([2.0, 0.0, 0.0])),
    ]
    # Straight through both; past both by a millimetre; short of both; away.
    ends = np.array([[3.0, 0.0, 0.0], [3.0, 0.31, 0.0], [0.8, 0.0, 0.0], [0.0, 1.0, 0.0]])
    found = blockers(
        SignedDistanceField.of(shapes), np.zeros(3), ends, np.linalg.norm(ends, axis=1)
    )
    assert found.tolist() == [0, -1, -1, -1]


def test_views_are_turned_as_the_twins_camera_is():
    rng = np.random.default_rng(3)
    for pan, tilt, roll in rng.uniform(-1.4, 1.4, (20, 3)):
        assert_allclose(
            view_rotation(pan, tilt, roll), camera_rotation(pan, tilt, roll), rtol=0, atol=1e-14
        )


@pytest.mark.parametrize("name", ["cmu_92", "prototype", "mirrored"])
def test_pan_and_tilt_turn_the_view_to_the_nearest_point_as_far_as_they_go(name):
    mirrored = name == "mirrored"
    arm = replace(load_arm("prototype" if mirrored else name), mirrored=mirrored)
    rng = np.random.default_rng(5)
    q = arm.joint_home + rng.uniform(-0.2, 0.2, (12, arm.joints))
    q[:, 0] = arm.joint_home[0] + 0.5
    tip = camera_poses(arm, q, target(1.0), ScanCamera()).positions
    # A thin cylinder about a metre ahead of the tips' mean, across the view.
    ahead = tip.mean(axis=0) + np.array([0.3, 0.2, 1.0])
    R = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    thin = CylinderTarget(radius=0.05, along=(-0.5, 0.5), origin=ahead, rotation=R)
    free = ScanCamera(pan_limit=math.pi, tilt_limit=0.5 * math.pi)
    poses = camera_poses(arm, q, thin, free)
    assert_allclose(poses.off, 0.0, rtol=0, atol=1e-9)
    for rotation in poses.rotations:
        assert_allclose(rotation.T @ rotation, np.eye(3), rtol=0, atol=1e-12)
    # Without pan and tilt it looks along the last link, from a head's length before the tip.
    fixed = camera_poses(arm, q, thin, ScanCamera(pan_limit=0.0, tilt_limit=0.0))
    last = kinematics.frames(arm, q)[:, -1, :3]
    assert_allclose(fixed.rotations[:, :, 2], last[:, :, 0], rtol=0, atol=1e-12)
    head = arm.bodies[-1].size[0]
    assert_allclose(fixed.positions, last[:, :, 3] + head * last[:, :, 0], rtol=0, atol=1e-12)


def test_the_picture_has_what_was_seen_and_the_way():
    lines = raster(target(4.0 * WIDE), SQUARE, standoff=STANDOFF, overlap=0.5)
    found = seen_by(lines, size=0.025)
    axes = Figure().add_subplot()
    draw_coverage(axes, found, track=lines.points)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert "seen again" in labels
    assert "the tip's way" in labels
    image = np.asarray(axes.images[0].get_array())
    assert image.shape == found.passes.T.shape
    assert (image == 4).sum() == (found.passes > 1).sum()


def test_numbers_that_mean_nothing_are_refused():
    lines = raster(target(WIDE), SQUARE, standoff=STANDOFF)
    poses = straight_down(lines.points, lines)
    with pytest.raises(InputError, match=r"patch size = nan m; must be > 0"):
        cover(lines.target, SQUARE, poses, size=math.nan)
    with pytest.raises(InputError, match=r"patches = \d+; must be <= 4000000"):
        cover(lines.target, SQUARE, poses, size=1e-5)
    with pytest.raises(InputError, match="one for each pose"):
        cover(lines.target, SQUARE, poses, passes=[1, 0])
