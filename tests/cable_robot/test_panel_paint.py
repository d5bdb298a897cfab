"""Painted panels: the mesh beside the surface, and what Drake's renderer shows of it."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from pips_drake.cable_robot.defects import Defect, seeded_defects
from pips_drake.cable_robot.panel_paint import (
    BRIGHTNESS,
    CHORD_HEIGHT,
    PATCH_HEIGHT,
    PanelLook,
    panel_texture,
    write_panel,
)
from pips_drake.cable_robot.panels import panel_coordinates, panel_normals, radiator_panels
from pips_drake.cable_robot.panels import panel_points as points_of
from pips_drake.cable_robot.survey_camera import (
    SurveyCamera,
    camera_poses,
    view_pose,
    world_pixels,
)
from pips_drake.errors import InputError
from pips_drake.scene.meshes import read_obj

from .survey_scene import painted

PANELS = radiator_panels()
COARSE = PanelLook(pixel=0.02)


@pytest.mark.parametrize("panel", [PANELS[0], PANELS[5]], ids=lambda p: p.name)
def test_the_mesh_is_the_surface_with_defects_just_above_it(tmp_path: Path, panel):
    defects = [d for d in seeded_defects(1, PANELS, 60) if d.panel == panel.name]
    mesh = read_obj(write_panel(tmp_path, panel, defects, COARSE))
    uvh = panel_coordinates(panel, mesh.vertices)
    on = np.abs(uvh[:, 2]) < 1e-6  # the file's digits
    np.testing.assert_allclose(uvh[~on, 2], PATCH_HEIGHT, atol=1e-6)
    assert np.all(uvh[:, :2] > -1e-6) and np.all(uvh[:, :2] < [4.572 + 1e-6, 3.231 + 1e-6])
    # Inside triangles too: chords stand out by as much as stated, well below the defects.
    of_surface = on[mesh.triangles].all(axis=1)
    middle = mesh.corners.mean(axis=1)
    height = panel_coordinates(panel, middle)[:, 2]
    assert height[of_surface].max() < CHORD_HEIGHT + 1e-6 < PATCH_HEIGHT / 5
    assert height[~of_surface].min() > PATCH_HEIGHT - 1e-6
    a, b, c = mesh.corners.swapaxes(0, 1)
    facing = np.cross(b - a, c - a)
    along = panel_normals(panel, panel_coordinates(panel, middle)[:, :2])
    assert np.all(np.einsum("ij,ij->i", facing, along) > 0.0)
    areas = 0.5 * np.linalg.norm(facing, axis=1)
    assert areas[of_surface].sum() == pytest.approx(panel.area, rel=1e-5)  # chords are shorter


def test_texture_is_as_bright_as_stated_and_as_seeded():
    texture = panel_texture(PANELS[2])
    assert texture.shape == (round(3.231 / 0.002), round(4.572 / 0.002))
    inner = texture[10:-10, 10:-10] / 255.0
    assert inner.mean() == pytest.approx(BRIGHTNESS, rel=0.02)  # some 900 patches of 2 %
    assert 0.01 < inner.std() / BRIGHTNESS < 0.05
    np.testing.assert_array_equal(
        panel_texture(PANELS[2], COARSE), panel_texture(PANELS[2], COARSE)
    )
    other = panel_texture(PANELS[2], PanelLook(pixel=0.02, seed=1))
    assert np.any(other != panel_texture(PANELS[2], COARSE))
    assert np.any(panel_texture(PANELS[6], COARSE) != panel_texture(PANELS[2], COARSE))


def test_a_panel_is_the_same_file_again_and_leaves_no_part(tmp_path: Path):
    defects = seeded_defects(1, PANELS, 20)
    texts = [write_panel(tmp_path / n, PANELS[3], defects, COARSE).read_bytes() for n in "ab"]
    assert texts[0] == texts[1] and len(texts[0]) > 1000
    names = {f.name for f in (tmp_path / "a").iterdir()}
    expected = {"starboard_4.obj", "starboard_4.mtl", "starboard_4.png", "paint_ramp.png"}
    assert names == expected
    saved = matplotlib.image.imread(tmp_path / "a" / "starboard_4.png")
    np.testing.assert_array_equal(
        np.rint(255 * saved[..., 0]).astype(np.uint8), panel_texture(PANELS[3], COARSE)
    )


def test_bad_textures_are_refused():
    with pytest.raises(InputError, match=r"pixel of the panels' texture = 0\.1 m"):
        PanelLook(pixel=0.1)


@pytest.mark.render
@pytest.mark.parametrize("panel", [PANELS[1], PANELS[6]], ids=lambda p: p.name)
def test_defects_are_rendered_where_the_pinhole_camera_says(tmp_path: Path, panel):
    camera = SurveyCamera(width=640, height=480)
    places = [(1.0, 2.0), (1.2, 2.1), (0.85, 1.87), (1.28, 1.86)]
    sizes = (0.02, 0.015, 0.03, 0.012)
    defects = [
        Defect(
            kind="debris",
            panel=panel.name,
            u=u,
            v=v,
            size_m=size,
            width_m=0.7 * size,
            angle=0.3 * k,
            contrast=-0.7,
            shape=k,
        )
        for k, ((u, v), size) in enumerate(zip(places, sizes, strict=True))
    ]
    shoot = painted(tmp_path, [panel], defects)
    poses = camera_poses(camera, *view_pose(camera, panel, 1.06, 1.98))
    grey = shoot(camera, poses, 0).mean(axis=2)
    dark = grey < 0.5 * BRIGHTNESS * 255.0
    assert grey[~dark].mean() == pytest.approx(255.0 * BRIGHTNESS, rel=0.05)
    rows, columns = np.indices(dark.shape)
    counted = 0
    for defect in defects:
        expected = world_pixels(camera, poses, 0, points_of(panel, [[defect.u, defect.v]]))[0]
        here = dark & (np.hypot(columns - expected[0], rows - expected[1]) < 40.0)
        found = np.array([columns[here].mean(), rows[here].mean()])
        # Whole pixels of a region of 50 to 400: its middle is good to some tenths. An error of
        # half a pixel, as of a principal point counted from elsewhere, would not pass.
        assert np.linalg.norm(found - expected) < 0.3
        counted += int(here.sum())
    assert counted == dark.sum()  # and nothing else is dark
