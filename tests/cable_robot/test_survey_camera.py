"""The survey's camera: Drake's pixels, square views, the way up in the picture."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydrake.systems.sensors import CameraInfo

from pips_drake.cable_robot.kinematics import make_poses
from pips_drake.cable_robot.panels import intersect_rays, panel_points, radiator_panels
from pips_drake.cable_robot.survey_camera import (
    SurveyCamera,
    camera_poses,
    noise_tile,
    view_pose,
    with_noise,
    world_pixels,
    world_rays,
)
from pips_drake.errors import InputError

PANELS = radiator_panels()
CAMERA = SurveyCamera()


def test_pixels_are_those_of_drakes_camera():
    info = CameraInfo(CAMERA.width, CAMERA.height, CAMERA.field_of_view)
    point = np.array([0.1, -0.2, 1.3])
    expected = (info.intrinsic_matrix() @ point / point[2])[:2]
    np.testing.assert_allclose(CAMERA.project(point), [expected], atol=1e-9)
    rays = CAMERA.rays(CAMERA.project(point))
    np.testing.assert_allclose(rays, [point / point[2]], atol=1e-12)
    assert np.isnan(CAMERA.project([0.0, 0.0, -1.0])).all()


def test_five_millimetres_are_at_least_six_pixels_at_the_default_standoff():
    assert CAMERA.pixels_across(0.005, 1.0) > 8.9  # 960 px / (2 tan 15 deg) per m: 8.96


def test_without_tilt_the_camera_looks_down_with_x_to_the_right():
    X_WC = camera_poses(CAMERA, make_poses([1.0, 2.0, 3.0]), 0.0)
    np.testing.assert_allclose(X_WC.position, [[1.0, 2.0, 2.72]])
    np.testing.assert_allclose(X_WC.rotation[0].T, [[1, 0, 0], [0, -1, 0], [0, 0, -1]])


@pytest.mark.parametrize("panel", [PANELS[1], PANELS[7]], ids=lambda p: p.name)
def test_a_view_is_square_at_its_standoff_and_its_way_up_is_as_stated(panel):
    uv = np.random.default_rng(0).uniform(0.3, [4.2, 2.9], (30, 2))
    platform, tilt = view_pose(CAMERA, panel, uv[:, 0], uv[:, 1], 0.8)
    assert np.all(np.abs(tilt) < math.pi / 2)
    poses = camera_poses(CAMERA, platform, tilt)
    np.testing.assert_array_equal(platform.rotation, np.broadcast_to(np.eye(3), (30, 3, 3)))
    for k in range(30):
        ray = world_rays(CAMERA, poses, k, CAMERA.centre)
        found, distance = intersect_rays(panel, poses.position[k], ray)
        np.testing.assert_allclose(found, uv[k : k + 1], atol=1e-12)
        np.testing.assert_allclose(distance, 0.8)
        steps = uv[k] + [[0.01, 0.0], [0.0, 0.01]]
        right, outwards = world_pixels(CAMERA, poses, k, panel_points(panel, steps)) - CAMERA.centre
        assert right[0] > 10.0 and abs(right[1]) < 1e-6
        # v goes up in pictures of the starboard side and down on the port side.
        assert -panel.side * outwards[1] > 10.0 and abs(outwards[0]) < 1e-6


def test_noise_has_its_deviation_and_the_same_seed_gives_the_same_picture():
    picture = np.full((CAMERA.height, CAMERA.width, 3), 150, dtype=np.uint8)
    tile = noise_tile(CAMERA, 1.5, seed=1)
    noisy = with_noise(picture, tile, seed=2)
    # Rounding adds 1/12 of variance; 1.2 million pixels: good to 0.1 %.
    assert noisy[..., 0].std() == pytest.approx(math.sqrt(1.5**2 + 1 / 12), rel=0.01)
    np.testing.assert_array_equal(noisy, with_noise(picture, tile, seed=2))
    assert np.any(noisy != with_noise(picture, tile, seed=3))
    assert with_noise(np.full_like(picture, 255), tile, 2).min() > 240  # no number wraps round


def test_bad_cameras_and_standoffs_are_refused():
    with pytest.raises(InputError, match="field of view = 150 deg"):
        SurveyCamera(field_of_view=math.radians(150.0))
    with pytest.raises(InputError, match="camera width = 0"):
        SurveyCamera(width=0)
    with pytest.raises(InputError, match=r"standoff = 2\.5 m"):
        view_pose(CAMERA, PANELS[0], 1.0, 1.0, 2.5)
