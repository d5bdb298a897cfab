"""The machine's shapes: prisms are exactly their boxes, and nothing that stands still overlaps."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pips_drake.remote_manipulator import geometry
from pips_drake.remote_manipulator.configuration import load_configuration
from pips_drake.remote_manipulator.geometry import Part

CONFIG = load_configuration()
HULL = geometry.payload_parts(CONFIG)[0]


def corners(part: Part) -> np.ndarray:
    """Of a box, (8, 3) m in its body's frame."""
    signs = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    turn = Rotation.from_euler("xyz", part.rpy)
    return turn.apply(signs * np.array(part.size)) + part.position


def test_the_boxes_of_a_prism_have_its_corners():
    expected = geometry.prism_corners(*HULL.size)
    found = np.concatenate([corners(box) for box in HULL.boxes()])
    for corner in found:
        assert np.linalg.norm(expected - corner, axis=1).min() < 1e-12
    for corner in expected:
        assert np.linalg.norm(found - corner, axis=1).min() < 1e-12


def test_a_point_is_in_the_prism_if_and_only_if_it_is_in_one_of_its_boxes():
    across, length = HULL.size
    points = np.random.default_rng(2).uniform(-0.6, 0.6, (20000, 3)) * [length, across, across]
    angles = np.arange(8) * math.pi / 4
    normals = np.column_stack([np.zeros(8), np.cos(angles), np.sin(angles)])
    inside = np.all(points @ normals.T <= 0.5 * across, axis=1)
    inside &= np.abs(points[:, 0]) <= 0.5 * length
    in_boxes = np.zeros(len(points), dtype=bool)
    for box in HULL.boxes():
        local = Rotation.from_euler("xyz", box.rpy).inv().apply(points - box.position)
        in_boxes |= np.all(np.abs(local) <= 0.5 * np.array(box.size), axis=1)
    assert 0.2 < inside.mean() < 0.8
    np.testing.assert_array_equal(in_boxes, inside)


def test_the_flat_sides_are_above_and_beside():
    found = np.concatenate([corners(box) for box in HULL.boxes()])
    for axis in (1, 2):
        assert np.abs(found[:, axis]).max() == pytest.approx(0.5 * CONFIG.payload.across_flats_m)


def test_the_caes_flat_front_has_the_port_on_it():
    core = geometry.cae_parts(CONFIG)[0]
    found = np.concatenate([corners(box) for box in core.boxes()])
    port = geometry.docking_port(CONFIG)
    assert found[:, 0].max() == pytest.approx(port[0])
    assert found[:, 2].max() == pytest.approx(0.5 * CONFIG.central_assembly_element.height_m)
    assert abs(port[2]) < found[:, 2].max()


def test_the_bar_stands_on_the_payload_and_the_probe_ahead_of_it():
    _, probe, bar = geometry.payload_parts(CONFIG)
    payload = CONFIG.payload
    assert corners(bar)[:, 2].max() == pytest.approx(-0.5 * payload.across_flats_m)
    assert corners(probe)[:, 0].max() == pytest.approx(-0.5 * payload.length_m)
    assert corners(probe)[:, 0].min() == pytest.approx(geometry.probe_tip(CONFIG)[0])


def test_the_bays_inner_faces_are_where_the_configuration_has_them():
    bay = CONFIG.cargo_bay
    walls = {part.name: corners(part) for part in geometry.bay_parts(CONFIG)}
    x, y, z = bay.location_m
    assert walls["wall_forward"][:, 0].max() == pytest.approx(x)
    assert walls["wall_aft"][:, 0].min() == pytest.approx(x + bay.length_m)
    assert walls["wall_port"][:, 1].min() == pytest.approx(y + 0.5 * bay.width_m)
    assert walls["wall_starboard"][:, 1].max() == pytest.approx(y - 0.5 * bay.width_m)
    assert walls["floor"][:, 2].min() == pytest.approx(z + bay.depth_m)


def test_the_prongs_inner_face_is_the_gap_away_from_the_fingers():
    effector, arm = CONFIG.effector, CONFIG.arm
    _, finger = geometry.effector_parts(effector, arm.arm_2_m)
    prong = geometry.prong_part(effector, arm.arm_2_m)
    for gap in (effector.prong_closed_gap_m, effector.prong_open_gap_m):
        inner = corners(prong)[:, 1].min() + geometry.prong_position(effector, gap)
        assert inner - corners(finger)[:, 1].max() == pytest.approx(gap)


def test_the_closed_fingers_hold_the_bar_with_room_and_within_the_tolerance():
    effector, bar = CONFIG.effector, CONFIG.receptacle
    assert effector.prong_closed_gap_m > bar.width_m
    assert bar.width_m < CONFIG.acquisition.prong_gap_m <= effector.prong_open_gap_m
    # The fingers end above the payload's top when the palm touches the bar.
    assert effector.finger.length_m < bar.height_m


def test_the_stand_is_free_of_cabin_and_bay():
    radius = 0.5 * CONFIG.arm.diameter_m
    for part in (geometry.cabin_part(CONFIG), *geometry.bay_parts(CONFIG)):
        low, high = corners(part).min(axis=0), corners(part).max(axis=0)
        nearest = np.clip([0.0, 0.0], low[:2], high[:2])
        assert np.linalg.norm(nearest) > radius + 0.05, part.name
