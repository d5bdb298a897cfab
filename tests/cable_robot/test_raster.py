"""The raster of views: how much of a concave panel is whole in one, order, coverage."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.panels import panel_points, radiator_panels
from pips_drake.cable_robot.raster import coverage, footprint, raster_cameras, survey_raster
from pips_drake.cable_robot.survey_camera import (
    SurveyCamera,
    camera_poses,
    view_pose,
    world_pixels,
)
from pips_drake.errors import InputError

PANELS = radiator_panels()
CAMERA = SurveyCamera()
RASTER = survey_raster(PANELS, CAMERA)


@pytest.mark.parametrize("standoff", [0.5, 1.0, 1.8])
def test_the_footprint_is_the_largest_rectangle_that_a_picture_shows_whole(standoff):
    panel = PANELS[2]
    poses = camera_poses(CAMERA, *view_pose(CAMERA, panel, 2.0, 1.6, standoff))
    size = footprint(CAMERA, panel, standoff)
    for scale, whole in [(0.9999, True), (1.0001, False)]:
        for axis in (0, 1):
            factor = np.where(np.arange(2) == axis, scale, 0.9999)
            corners = [2.0, 1.6] + 0.5 * factor * size * [[-1, -1], [-1, 1], [1, -1], [1, 1]]
            pixels = world_pixels(CAMERA, poses, 0, panel_points(panel, corners))
            # Half a pixel beyond the outermost centres: the rim that the field of view ends at.
            assert CAMERA.in_picture(pixels).all() == whole


def test_a_concave_footprint_is_smaller_than_a_flat_one_which_is_its_limit():
    flat = 2.0 * math.tan(math.radians(15.0)) * np.array([4.0 / 3.0, 1.0])
    concave = footprint(CAMERA, PANELS[0])
    assert np.all(concave < flat) and np.all(concave > 0.95 * flat)
    nearly_flat = replace(PANELS[0], radius=1e5)
    np.testing.assert_allclose(footprint(CAMERA, nearly_flat), flat, rtol=1e-5)


def test_every_cell_of_every_panel_is_seen_and_each_view_is_needed():
    poses = raster_cameras(RASTER, CAMERA)
    for panel in (PANELS[0], PANELS[6]):
        share, counts = coverage(panel, poses, CAMERA, cell=0.05)
        assert share == 1.0 and counts.min() >= 1 and counts.max() <= 4
    kept = np.arange(len(RASTER)) != 100
    missing = PANELS[RASTER.panel[100]]
    fewer = Poses(poses.position[kept], poses.rotation[kept])
    share, counts = coverage(missing, fewer, CAMERA, cell=0.05)
    assert share < 1.0
    u, v = RASTER.uv[100]
    assert (
        counts[int(u / missing.length * counts.shape[0])][int(v / missing.width * counts.shape[1])]
        == 0
    )


def test_coverage_of_one_view_is_its_footprint():
    panel = PANELS[3]
    poses = camera_poses(CAMERA, *view_pose(CAMERA, panel, 2.0, 1.5))
    share, _ = coverage(panel, poses, CAMERA, cell=0.02)
    expected = np.prod(footprint(CAMERA, panel)) / panel.area
    # Cells at the rim are not whole in the picture: one cell less on average along each side.
    assert 0.93 * expected < share < 1.03 * expected
    far = camera_poses(CAMERA, *view_pose(CAMERA, panel, 2.0, 1.5, 2.0))
    assert coverage(panel, far, CAMERA, cell=0.2)[0] == 0.0  # too far away to count


def test_views_overlap_by_a_share_and_more_than_the_largest_defect():
    assert np.all(RASTER.overlap >= 0.1 * RASTER.footprint)
    assert np.all(RASTER.overlap > 0.05)
    wide = survey_raster(PANELS, CAMERA, overlap=0.5)
    assert np.all(wide.overlap >= 0.5 * wide.footprint) and len(wide) > 2 * len(RASTER)


def test_the_camera_goes_to_and_fro_without_jumps():
    assert len(RASTER) == 448
    step = np.linalg.norm(np.diff(RASTER.platform.position, axis=0), axis=1)
    side = np.array([PANELS[i].side for i in RASTER.panel])
    change = np.flatnonzero(np.diff(side))
    assert len(change) == 1
    row = np.diff(RASTER.tilt) == 0.0
    assert step[row].max() < RASTER.footprint[0] and np.delete(step, change).max() < 0.75
    # Rows alternate: the first of each row begins where the last one ended.
    turns = np.flatnonzero(~row)
    assert np.all(np.diff(RASTER.platform.position[:, 0])[turns] == 0.0)
    assert RASTER.path_length == pytest.approx(step.sum())


def test_bad_rasters_are_refused():
    with pytest.raises(InputError, match=r"overlap = 0\.95"):
        survey_raster(PANELS, CAMERA, overlap=0.95)
    with pytest.raises(InputError, match=r"sizes of panels = 2"):
        survey_raster([PANELS[0], replace(PANELS[1], length=2.0)], CAMERA)
    with pytest.raises(InputError, match="panels to survey = 0"):
        survey_raster([], CAMERA)
