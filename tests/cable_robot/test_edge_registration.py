"""A picture's edges say where the camera looks: pictures cast ray by ray, and rendered ones."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.defect_map import (
    Finding,
    compare_with_truth,
    locate,
    merge,
    panel_mask,
    predicted_error,
)
from pips_drake.cable_robot.defects import seeded_defects
from pips_drake.cable_robot.detection import find_defects
from pips_drake.cable_robot.edge_registration import edge_shift, registered
from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.panels import edge_distances, intersect_rays, radiator_panels
from pips_drake.cable_robot.raster import raster_cameras, survey_raster
from pips_drake.cable_robot.survey_camera import (
    SurveyCamera,
    camera_poses,
    noise_tile,
    view_pose,
    with_noise,
    world_rays,
)
from pips_drake.errors import InputError

from .survey_scene import painted

PANELS = radiator_panels()
CAMERA = SurveyCamera(width=640, height=480)
STRIP = 0.008
REACH = 0.015


def cast(panel, poses: Poses, beyond: int = 255) -> np.ndarray:
    """A picture of a panel with its dark strip before something bright or dark, by rays."""
    across, down = np.meshgrid(np.arange(CAMERA.width), np.arange(CAMERA.height))
    rays = world_rays(CAMERA, poses, 0, np.stack([across, down], axis=-1))
    uv, distance = intersect_rays(panel, poses.position[0], rays)
    grey = np.full(len(uv), beyond)
    on = np.isfinite(distance)
    grey[on] = np.where(edge_distances(panel, uv[on]) < STRIP, 92, 153)
    noise = np.random.default_rng(0).normal(0.0, 2.0, len(grey))
    flat = np.clip(grey + noise, 0, 255).astype(np.uint8)
    return np.repeat(flat.reshape(CAMERA.height, CAMERA.width, 1), 3, axis=2)


def turned(poses: Poses, across: float, down: float) -> Poses:
    """The camera turned so that what it sees moves by these pixels, by the pinhole's geometry."""
    f = CAMERA.focal_length
    ahead = np.array([-across / f, -down / f, 1.0])
    axis = np.cross([0.0, 0.0, 1.0], ahead / np.linalg.norm(ahead))
    axis *= math.atan(math.hypot(across, down) / f) / max(np.linalg.norm(axis), 1e-12)
    return Poses(poses.position, poses.rotation @ Rotation.from_rotvec(axis).as_matrix())


@pytest.mark.parametrize("beyond", [255, 120])
@pytest.mark.parametrize("panel", [PANELS[0], PANELS[7]], ids=lambda p: p.name)
@pytest.mark.parametrize("corner", [(0.15, 0.2), (4.4, 3.05)])
def test_the_shift_of_a_corner_is_found_and_the_pose_mended(panel, corner, beyond):
    thought = camera_poses(CAMERA, *view_pose(CAMERA, panel, *corner))
    for across, down in [(0.0, 0.0), (7.0, -5.0), (-9.0, 6.0)]:
        true = turned(thought, across, down)
        picture = cast(panel, true, beyond)
        asked = dict(reach=REACH, strip=STRIP)
        shift = edge_shift(picture, CAMERA, thought, 0, [panel], **asked)
        # Whole pixels, and tan of the half field's slope more away from the picture's middle.
        np.testing.assert_allclose(shift, [across, down], atol=2.0)
        mended = registered(picture, CAMERA, thought, 0, [panel], **asked)
        left = Rotation.from_matrix(true.rotation[0].T @ mended.rotation[0]).magnitude()
        assert left * CAMERA.focal_length < 2.5  # pixels
        before = Rotation.from_matrix(true.rotation[0].T @ thought.rotation[0]).magnitude()
        assert across == 0.0 or left < 0.35 * before


def test_a_picture_without_edges_keeps_its_pose():
    thought = camera_poses(CAMERA, *view_pose(CAMERA, PANELS[2], 2.0, 1.6))
    picture = cast(PANELS[2], thought)
    asked = dict(reach=REACH, strip=STRIP)
    assert np.isnan(edge_shift(picture, CAMERA, thought, 0, PANELS, **asked)).all()
    mended = registered(picture, CAMERA, thought, 0, PANELS, **asked)
    np.testing.assert_array_equal(mended.rotation, thought.rotation)
    # Nor does one in which an edge should be and is not.
    thought = camera_poses(CAMERA, *view_pose(CAMERA, PANELS[2], 0.15, 1.6))
    plain = np.full_like(picture, 153)
    assert np.isnan(edge_shift(plain, CAMERA, thought, 0, PANELS, **asked)).all()


def test_reach_must_be_positive():
    thought = camera_poses(CAMERA, *view_pose(CAMERA, PANELS[2], 2.0, 1.6))
    with pytest.raises(InputError, match="reach of edges = 0 m"):
        edge_shift(np.zeros((480, 640, 3), np.uint8), CAMERA, thought, 0, PANELS, reach=0.0)


@pytest.mark.slow
@pytest.mark.render
def test_edges_of_badly_known_poses_are_no_defects_once_registered(tmp_path: Path):
    # The crossed robot's worst pose for lengths wrong by 1 mm: 2.5 mm and 8.8 mrad.
    position, rotation = 2.5e-3, 8.8e-3
    camera, panel = SurveyCamera(), PANELS[5]
    raster = survey_raster([panel], camera)
    thought = raster_cameras(raster, camera)
    rng = np.random.default_rng(1)
    away, turn = rng.normal(size=(2, len(raster), 3))
    away *= position / np.linalg.norm(away, axis=1)[:, None]
    turn *= rotation / np.linalg.norm(turn, axis=1)[:, None]
    true = Poses(thought.position + away, Rotation.from_rotvec(turn).as_matrix() @ thought.rotation)
    error = predicted_error(camera, 1.0, position_error=position, rotation_error=rotation)
    defects = seeded_defects(31, [panel], 60)
    shoot, tile = painted(tmp_path, [panel], defects), noise_tile(camera, 1.5, 0)
    pictures = [with_noise(shoot(camera, true, k), tile, k) for k in range(len(raster))]

    def mapped(mend: bool) -> list[Finding]:
        sightings = []
        for k, picture in enumerate(pictures):
            poses = (
                registered(picture, camera, thought, k, [panel], reach=error) if mend else thought
            )
            found = find_defects(picture, None, panel_mask(camera, poses, k, [panel]))
            sightings += locate(found, camera, poses, k, [panel])
        return merge(sightings, camera, radius=2.0 * error)

    plain = compare_with_truth(mapped(False), defects, error)
    mended = compare_with_truth(mapped(True), defects, error)
    assert len(plain.false_alarms) > 5  # pieces of edges: what the pictures' poses are mended for
    assert mended.false_alarms == [] and mended.missed_from(0.005) == []
    assert mended.errors.max() < error
    assert np.mean(mended.errors**2) < np.mean(plain.errors**2)
