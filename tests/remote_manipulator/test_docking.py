"""Docking and berthing at both sides of each tolerance, and the envelope face by face."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest

from pips_drake.remote_manipulator.docking import (
    FACES,
    DockingTest,
    berthing,
    cae_front_planes,
    in_docking_envelope,
    within_berthing,
    within_docking,
)
from pips_drake.remote_manipulator.geometry import docking_port, probe_tip
from pips_drake.remote_manipulator.kinematics import heading_matrix, pitch_matrix, roll_matrix
from pips_drake.units import FOOT

from .program_world import CONFIG, STOWED, cae_pose, docked_payload

TEST = DockingTest(CONFIG)
LIMIT = CONFIG.docking.distance_ft * FOOT
COSINE = 1.0 - 2.0**-10
ANGLE = math.acos(COSINE)
#: Steps in and out of a tolerance. Places of 20 m are rounded to 4e-15 m, and acos of a cosine near
#: 1 to 2^-53 / sin(angle) = 3e-15 rad; both with a factor of some hundred.
HAIR = 1e-12


def second_axis_too():
    config = copy.deepcopy(CONFIG)
    config.docking.second_axis = True
    return config


def turned(R: np.ndarray, away: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """The payload turned about the middle of its probe's end."""
    _, p = docked_payload(away=away)
    tip = probe_tip(CONFIG)
    return R, p + tip - R @ tip


def test_the_tolerance_is_2_deg_32_min():
    assert math.degrees(ANGLE) == pytest.approx(2.0 + 32.0 / 60.0, abs=1.0 / 60.0 / 2.0)


def test_the_decision_changes_between_neighbouring_numbers():
    config = CONFIG.docking
    assert within_docking(config, LIMIT, COSINE, -1.0)
    assert not within_docking(config, math.nextafter(LIMIT, 1.0), COSINE, -1.0)
    assert not within_docking(config, LIMIT, math.nextafter(COSINE, 0.0), 1.0)
    both = second_axis_too().docking
    assert within_docking(both, LIMIT, COSINE, COSINE)
    assert not within_docking(both, LIMIT, COSINE, math.nextafter(COSINE, 0.0))


@pytest.mark.parametrize("at", [cae_pose(), (heading_matrix(0.3), np.array([1.0, -2.0, 3.0]))])
def test_distance_is_decided_right_at_both_sides(at):
    R, p = at
    for step, expected in ((-HAIR, True), (HAIR, False)):
        _, place = docked_payload(away=LIMIT + step)
        relative = place - cae_pose()[1]
        found = TEST((R, R @ relative + p), at)
        assert found.docked == expected
        assert found.distance == pytest.approx(LIMIT + step, abs=HAIR / 2)


@pytest.mark.parametrize("turn", [heading_matrix, roll_matrix])
def test_the_angle_is_decided_right_at_both_sides(turn):
    # The y axis turns with heading and roll, and not with pitch.
    for way in (-1.0, 1.0):
        assert TEST(turned(turn(way * (ANGLE - HAIR))), cae_pose()).docked
        found = TEST(turned(turn(way * (ANGLE + HAIR))), cae_pose())
        assert not found.docked
        assert found.in_envelope
        assert found.distance < LIMIT
        assert found.angle == pytest.approx(ANGLE, abs=1e-9)


def test_pitch_is_asked_by_the_second_axis_alone():
    pitched = turned(pitch_matrix(2.0 * ANGLE))
    assert TEST(pitched, cae_pose()).docked
    both = DockingTest(second_axis_too())
    found = both(pitched, cae_pose())
    assert not found.docked
    assert found.angle == pytest.approx(2.0 * ANGLE, abs=1e-9)
    for step, expected in ((-HAIR, True), (HAIR, False)):
        assert both(turned(pitch_matrix(ANGLE + step)), cae_pose()).docked == expected


def test_the_envelope_is_face_c_outside_and_the_others_inside():
    planes = dict(zip(FACES, cae_front_planes(CONFIG), strict=True))
    port = docking_port(CONFIG)
    normals = {name: plane[:3] for name, plane in planes.items()}
    np.testing.assert_allclose(normals["c"], [1.0, 0.0, 0.0])
    half = 0.5 * CONFIG.central_assembly_element.across_flats_m
    # Where the envelope ends, in front of the port: on face c, and on b and d prolonged.
    inside = port + np.array([0.1, 0.0, 0.0])
    rows = cae_front_planes(CONFIG)
    assert in_docking_envelope(rows, inside[None])
    for name, plane in planes.items():
        height = float(plane[:3] @ inside - plane[3])
        for step, expected in ((-HAIR, name != "c"), (HAIR, name == "c")):
            # Straight to the face, and a hair before it or beyond.
            point = inside + plane[:3] * (step - height)
            others = [o for o in FACES if o != name]
            fine = all((planes[o][:3] @ point > planes[o][3]) == (o == "c") for o in others)
            if fine:
                assert in_docking_envelope(rows, point[None]) == expected
    # a and e are met where b and d end, so they decide alone nowhere outside of face c.
    assert {round(math.degrees(math.atan2(n[1], n[0]))) for n in normals.values()} == {
        -90,
        -45,
        0,
        45,
        90,
    }
    assert all(plane[3] == pytest.approx(half) for plane in planes.values())


def test_one_vertex_outside_of_the_envelope_is_enough():
    # Within 0.25 ft, but turned so far that a vertex of the probe is in the CAE.
    turned_in = turned(heading_matrix(0.3), away=0.05)
    found = TEST(turned_in, cae_pose())
    assert not found.in_envelope
    assert found.distance < LIMIT


def test_distance_and_angle_are_those_that_were_made():
    rng = np.random.default_rng(5)
    for _ in range(50):
        shift, angle = rng.uniform(-3.0, 3.0, 3), rng.uniform(0.0, 3.0)
        R, p = turned(heading_matrix(angle))
        found = TEST((R, p + shift), cae_pose())
        # `turned` leaves the tip 0.05 m before the port.
        assert found.distance == pytest.approx(
            np.linalg.norm(shift + np.array([0.05, 0.0, 0.0])), abs=1e-12
        )
        assert found.angle == pytest.approx(angle, abs=1e-9)


def test_berthing_changes_between_neighbouring_numbers():
    config = CONFIG.berthing
    far, wide = config.distance_m, math.radians(config.angle_deg)
    assert within_berthing(config, far, wide)
    assert not within_berthing(config, math.nextafter(far, 1.0), wide)
    assert not within_berthing(config, far, math.nextafter(wide, 1.0))


@pytest.mark.parametrize("turn", [heading_matrix, pitch_matrix, roll_matrix])
def test_berthing_is_decided_right_at_both_sides(turn):
    far, wide = CONFIG.berthing.distance_m, math.radians(CONFIG.berthing.angle_deg)
    R, p = STOWED
    way = np.array([2.0, -1.0, 2.0]) / 3.0
    for step, expected in ((-HAIR, True), (HAIR, False)):
        assert berthing(CONFIG, (R, p + way * (far + step))).berthed == expected
        assert berthing(CONFIG, (turn(wide + step), p)).berthed == expected
        assert berthing(CONFIG, (turn(-wide - step), p)).berthed == expected
    assert berthing(CONFIG, (turn(3.0), p)).angle == pytest.approx(3.0, abs=1e-12)
