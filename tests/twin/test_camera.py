"""Pinhole, pan and tilt, focus, and what a camera sees, against Drake and plain geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.sensors import CameraInfo

from pips_drake.errors import InputError
from pips_drake.twin.camera import (
    PinholeCamera,
    camera_rotation,
    pan_and_tilt,
    seen_distances,
)

ANGLES = st.floats(-1.4, 1.4)


@pytest.mark.parametrize(("width", "height", "degrees"), [(640, 480, 50.0), (101, 51, 20.0)])
def test_intrinsics_are_those_of_drakes_camera(width, height, degrees):
    camera = PinholeCamera(width=width, height=height, field_of_view=math.radians(degrees))
    truth = CameraInfo(width, height, math.radians(degrees)).intrinsic_matrix()
    assert camera.focal_length == pytest.approx(truth[1, 1], rel=1e-12)
    np.testing.assert_allclose(camera.centre, truth[:2, 2], rtol=1e-12)
    point = np.array([0.3, -0.2, 1.7])
    pixels, depth = camera.project(point)
    np.testing.assert_allclose(pixels[0], (truth @ point / point[2])[:2], rtol=1e-12)
    assert depth[0] == point[2]


def test_what_is_behind_the_camera_has_no_pixel():
    pixels, _ = PinholeCamera().project([[0.0, 0.0, -1.0], [0.1, 0.0, 0.0]])
    assert np.isnan(pixels).all()
    assert not PinholeCamera().in_picture(pixels).any()


def test_the_field_of_view_is_the_angle_between_the_upper_and_the_lower_edge():
    camera = PinholeCamera(width=100, height=80, field_of_view=math.radians(40.0))
    for share, inside in ((0.999, True), (1.001, False)):
        y = share * math.tan(math.radians(20.0))
        pixels, _ = camera.project([[0.0, y, 1.0], [0.0, -y, 1.0]])
        assert (camera.in_picture(pixels) == inside).all()


def test_zoom_makes_the_picture_larger():
    camera = PinholeCamera()
    assert camera.zoomed(3.0).focal_length == pytest.approx(3.0 * camera.focal_length)
    with pytest.raises(InputError, match=r"zoom = 0\.0; must be > 0"):
        camera.zoomed(0.0)


def test_without_pan_and_tilt_it_looks_along_the_mounts_x_with_z_up():
    R = camera_rotation(0.0, 0.0)
    np.testing.assert_array_equal(R[:, 2], [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(R[:, 1], [0.0, 0.0, -1.0])


@given(pan=st.floats(-3.1, 3.1), tilt=ANGLES, roll=ANGLES)
def test_pan_and_tilt_point_the_view_and_roll_does_not(pan, tilt, roll):
    R = camera_rotation(pan, tilt, roll)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    # Longitude and latitude.
    view = [math.cos(tilt) * math.cos(pan), math.cos(tilt) * math.sin(pan), math.sin(tilt)]
    np.testing.assert_allclose(R[:, 2], view, atol=1e-12)
    np.testing.assert_allclose(pan_and_tilt(R[:, 2]), [pan, tilt], atol=1e-7)
    # The camera's up turns about the view by the roll.
    up, level = -R[:, 1], -camera_rotation(pan, tilt)[:, 1]
    assert up @ level == pytest.approx(math.cos(roll), abs=1e-12)
    assert np.cross(level, up) @ R[:, 2] == pytest.approx(math.sin(roll), abs=1e-12)


def test_blur_is_the_circle_of_confusion_of_a_thin_lens():
    # Lens equation 1 / f = 1 / z + 1 / v with f far below z: an aperture A and a sensor at v0 give
    # a disc of A |v - v0| / v. Here f = 5 mm; the formula neglects f / z, 2.5 % at 0.2 m.
    f, aperture, focus, z = 5e-3, 2e-3, 0.5, np.array([0.2, 0.3, 0.5, 2.0])
    v, v0 = 1.0 / (1.0 / f - 1.0 / z), 1.0 / (1.0 / f - 1.0 / focus)
    camera = PinholeCamera(aperture=aperture)
    truth = aperture * np.abs(v - v0) / v * camera.focal_length / v0
    np.testing.assert_allclose(camera.blur_at(z, focus), truth, rtol=0.03, atol=1e-9)


LOOKING_UP = np.eye(3)


def see(camera, points, normals, **more):
    """From the origin, looking along z."""
    return seen_distances(camera, np.zeros(3), LOOKING_UP, points, normals, **more)


def test_seen_is_in_the_picture_facing_and_in_range():
    camera = PinholeCamera(near=0.5, far=3.0, incidence=math.radians(60.0))
    towards, away, aslant = [0, 0, -1.0], [0, 0, 1.0], [math.sin(1.1), 0, -math.cos(1.1)]
    cases = [
        ([0, 0, 1.0], towards, 1.0),
        ([0, 0, 1.0], away, np.inf),
        ([0, 0, 1.0], aslant, np.inf),  # 63 deg
        ([0, 0, 0.4], towards, np.inf),
        ([0, 0, 3.1], towards, np.inf),
        ([0, 2.0, 1.0], towards, np.inf),
        ([0, 0, -1.0], towards, np.inf),
        ([0.3, 0, 1.0], towards, math.hypot(0.3, 1.0)),
    ]
    points, normals, expected = zip(*cases, strict=True)
    np.testing.assert_allclose(see(camera, points, normals), expected)


def test_half_of_a_sphere_far_away_is_seen():
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(20000, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    camera = PinholeCamera(far=1000.0, incidence=math.radians(89.99))
    seen = np.isfinite(see(camera, normals + np.array([0.0, 0.0, 50.0]), normals))
    # The cap within sight of a point at distance d has (1 - r / d) / 2 of the sphere; three
    # standard deviations of 20000 draws are 1 %.
    assert seen.mean() == pytest.approx(0.5 * (1.0 - 1.0 / 50.0), abs=0.01)
    camera = PinholeCamera(far=1000.0, incidence=math.radians(60.0))
    seen = np.isfinite(see(camera, normals + np.array([0.0, 0.0, 998.0]), normals))
    assert seen.mean() == pytest.approx(0.25, abs=0.01), "a cap of 60 deg has half a hemisphere"


def test_what_stands_before_hides():
    camera = PinholeCamera(width=4, height=2)
    depth = np.full((2, 4), np.inf)
    depth[:, :2] = 0.8
    points = [[-0.1, 0.0, 1.0], [0.1, 0.0, 1.0], [-0.1, 0.0, 0.8]]
    found = see(camera, points, [[0, 0, -1.0]] * 3, depth_image=depth)
    assert np.isfinite(found).tolist() == [False, True, True]


def test_what_is_out_of_focus_is_not_seen():
    points, normals = [[0.0, 0.0, z] for z in (0.2, 0.5, 2.0)], [[0.0, 0.0, -1.0]] * 3
    sharp = PinholeCamera()
    # 515 px: 1 m px of aperture times focal length, so two pixels are a difference of 2 / m.
    fixed = PinholeCamera(aperture=1.0 / sharp.focal_length, focus=0.5, blur=1.9)
    assert np.isfinite(see(sharp, points, normals)).all()
    assert np.isfinite(see(fixed, points, normals)).tolist() == [False, True, True]
    # Focused by itself on what is in the middle: 0.2 m, the first of the three.
    auto = PinholeCamera(aperture=1.0 / sharp.focal_length, blur=1.9)
    assert np.isfinite(see(auto, points, normals)).tolist() == [True, False, False]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"width": 0}, "camera width = 0; must be > 0"),
        ({"field_of_view": math.pi}, r"camera field of view = 180 deg; must be in \(0, 180\)"),
        ({"near": 2.0, "far": 1.0}, r"camera near = 2\.0 m; must be > 0 and < far"),
        ({"aperture": -1.0}, r"camera aperture = -1\.0; must be >= 0"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(wrong, message):
    with pytest.raises(InputError, match=message):
        PinholeCamera(**wrong)
