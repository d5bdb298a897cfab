"""The radiator panels: a closed door's circle turned about its hinge, rays, boxes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.panels import (
    BAY_RADIUS,
    PANEL_WIDTH,
    find_panel,
    intersect_rays,
    panel_coordinates,
    panel_normals,
    panel_points,
    panel_slabs,
    radiator_panels,
)
from pips_drake.errors import InputError

PANELS = radiator_panels()


def some_uv(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.0, [4.572, 3.231], (count, 2))


def test_eight_panels_have_the_area_of_one_face_of_all():
    assert len({p.name for p in PANELS}) == 8
    # NTRS 19850008616: 175 m2 with both faces of the four forward ones, so 117 of one face of all.
    assert sum(p.area for p in PANELS) == pytest.approx(118.2, abs=0.1)


@pytest.mark.parametrize("door_angle_deg", [95.0, 175.5, 180.0])
@pytest.mark.parametrize("side", [1, -1])
def test_a_panel_is_on_the_closed_doors_circle_turned_about_the_hinge(side, door_angle_deg):
    panel = next(p for p in radiator_panels(math.radians(door_angle_deg)) if p.side == side)
    v = np.linspace(0.0, panel.width, 9)
    # Closed, the door goes up from its hinge to the bay's middle; the panel is in its middle.
    arc = (v + 0.5 * (0.5 * math.pi * BAY_RADIUS - PANEL_WIDTH)) / BAY_RADIUS
    closed = BAY_RADIUS * np.column_stack([0 * v, side * np.cos(arc), np.sin(arc)])
    hinge = np.array([0.0, side * BAY_RADIUS, 0.0])
    turn = Rotation.from_rotvec([-side * math.radians(door_angle_deg), 0.0, 0.0])
    expected = hinge + turn.apply(closed - hinge)
    found = panel_points(panel, np.column_stack([0.3 + 0 * v, v]))
    np.testing.assert_allclose(found[:, 1:], expected[:, 1:], atol=1e-12)
    np.testing.assert_allclose(found[:, 0], -9.144 + 0.3)


def test_panels_follow_each_other_from_forward_to_aft():
    ends = [panel_points(p, [[0.0, 1.0], [p.length, 1.0]])[:, 0] for p in PANELS[:4]]
    np.testing.assert_allclose(np.array(ends)[1:, 0], np.array(ends)[:-1, 1])
    assert ends[0][0] == -9.144 and ends[3][1] == pytest.approx(9.144)
    mirrored = panel_points(PANELS[0], some_uv(5)) * [1.0, -1.0, 1.0]
    np.testing.assert_allclose(panel_points(PANELS[4], some_uv(5)), mirrored)


@pytest.mark.parametrize("name", ["starboard_2", "port_3"])
def test_normals_are_square_to_the_surface_and_handed_as_stated(name):
    panel, uv, h = find_panel(PANELS, name), some_uv(20), 1e-6
    along_u, along_v = (
        (panel_points(panel, uv + step) - panel_points(panel, uv - step)) / (2.0 * h)
        for step in ([h, 0.0], [0.0, h])
    )
    # Central differences of unit-speed coordinates: errors of h^2 and of rounding / h.
    expected = panel.side * np.cross(along_u, along_v)
    np.testing.assert_allclose(panel_normals(panel, uv), expected, atol=1e-8)
    raised = panel_points(panel, uv, 0.5)
    np.testing.assert_allclose(raised, panel_points(panel, uv) + 0.5 * panel_normals(panel, uv))


def test_coordinates_of_points_are_those_they_were_made_of():
    rng = np.random.default_rng(1)
    for panel in PANELS:
        uvh = rng.uniform([-1.0, -1.0, -0.5], [5.0, 4.0, 2.0], (50, 3))
        points = panel_points(panel, uvh[:, :2], uvh[:, 2])
        np.testing.assert_allclose(panel_coordinates(panel, points), uvh, atol=1e-12)


def test_rays_from_within_the_arc_meet_what_they_are_aimed_at():
    rng = np.random.default_rng(2)
    for panel in (PANELS[1], PANELS[6]):
        uv, aimed = some_uv(200, 3), some_uv(200, 4)
        eyes = panel_points(panel, uv, rng.uniform(0.1, 2.0, 200))
        rays = panel_points(panel, aimed) - eyes
        found, distance = intersect_rays(panel, eyes, rays)
        np.testing.assert_allclose(found, aimed, atol=1e-9)
        np.testing.assert_allclose(distance, np.linalg.norm(rays, axis=1), atol=1e-9)


def test_rays_that_miss_or_come_from_behind_meet_nothing():
    panel, uv = PANELS[0], some_uv(40, 5)
    normals, points = panel_normals(panel, uv), panel_points(panel, uv)
    behind = points - 0.3 * normals
    away = points + 0.3 * normals
    along = np.tile([1.0, 0.0, 0.0], (40, 1))
    for origins, directions in [(behind, normals), (away, normals), (away, along)]:
        found, distance = intersect_rays(panel, origins, directions)
        assert np.isnan(found).all() and np.isnan(distance).all()
    edge = panel_points(panel, [[-0.01, 1.0]], 1.0), -panel_normals(panel, [[-0.01, 1.0]])
    assert np.isnan(intersect_rays(panel, *edge)[1]).all()
    uv, _ = intersect_rays(panel, *edge, margin=0.02)
    np.testing.assert_allclose(uv, [[-0.01, 1.0]], atol=1e-12)


@pytest.mark.parametrize("pieces", [1, 5, 24])
def test_boxes_hold_the_panel_and_stand_out_of_it_by_no_more_than_the_sagitta(pieces):
    panel = PANELS[5]
    uv = some_uv(2000, 6)
    samples = np.concatenate([panel_points(panel, uv), panel_points(panel, uv, -0.02)])
    held = np.zeros(len(samples), dtype=bool)
    angle = panel.width / panel.radius / pieces
    sagitta = panel.radius * (1.0 - math.cos(0.5 * angle))
    for size, X_WB in panel_slabs(panel, pieces):
        assert np.linalg.det(X_WB[:3, :3]) == pytest.approx(1.0)
        local = (samples - X_WB[:3, 3]) @ X_WB[:3, :3]
        held |= np.all(np.abs(local) <= 0.5 * size + 1e-9, axis=1)
        face = np.random.default_rng(7).uniform(-0.5, 0.5, (200, 3)) * size
        heights = panel_coordinates(panel, face @ X_WB[:3, :3].T + X_WB[:3, 3])[:, 2]
        assert heights.max() <= sagitta + 1e-9
    assert held.all()


def test_bad_panels_are_refused():
    with pytest.raises(InputError, match=r"door angle = 80 deg; must be 90 \.\. 180 deg"):
        radiator_panels(math.radians(80.0))
    with pytest.raises(InputError, match="unknown panel 'port_9'"):
        find_panel(PANELS, "port_9")
    with pytest.raises(InputError, match="radius"):
        replace(PANELS[0], radius=0.0)
    with pytest.raises(InputError, match="thickness"):
        panel_slabs(PANELS[0], thickness=0.0)
