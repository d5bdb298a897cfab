"""Both motion bases put the first spine point where it is wanted, or say how far it is beyond."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pips_drake.serpentine.motion_base import (
    GIMBAL,
    RAIL_CRANE,
    GimbalBase,
    RailCraneBase,
    base_inverse,
    base_roots,
    wrap_angle,
)

INCH = 0.0254
DEGREE = math.pi / 180.0

PROTOTYPE = RailCraneBase(
    a0=11.25 * INCH, a2=8.908 * INCH, d2=-5.005 * INCH, d3=7.078 * INCH, first_length=20.035 * INCH
)
K = math.sqrt(0.5)


def rotation(axis: int, angle: float) -> np.ndarray:
    """Rotation matrix about a coordinate axis."""
    c, s = math.cos(angle), math.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    result = np.eye(3)
    result[i, i] = result[j, j] = c
    result[i, j], result[j, i] = -s, s
    return result


def rail_crane_point(base: RailCraneBase, joints: np.ndarray) -> np.ndarray:
    """Spine point 4 from Fig 2.1: rail along z0, crane about Y0, arm hinge tilted by 45 deg."""
    d1, theta2, theta3 = joints
    crane = rotation(0, -math.pi / 2) @ rotation(2, theta2)
    hinge = rotation(0, -math.pi / 4)
    arm = hinge @ (np.array([0.0, 0.0, base.d3]) + rotation(2, theta3)[:, 0] * base.first_length)
    local = np.array([base.a2, 0.0, 0.0]) + arm
    carried = rotation(0, -math.pi / 2) @ np.array([0.0, 0.0, base.d2])
    return np.array([base.a0, 0.0, d1]) + carried + crane @ local


def gimbal_point(base: GimbalBase, joints: np.ndarray) -> np.ndarray:
    """The first spine point: a rod along the rail, turned about its own x, then about y."""
    d1, tilt, aside = joints
    rod = rotation(1, tilt) @ rotation(0, aside) @ np.array([0.0, 0.0, base.first_length])
    return np.array([base.offset, 0.0, d1]) + rod


@given(st.floats(-1e4, 1e4))
def test_a_wrapped_angle_is_the_same_direction_between_minus_and_plus_pi(angle):
    wrapped = wrap_angle(angle)
    # The remainder of 1e4 rad loses 1e4 / 2 roundings of 1.
    assert -math.pi - 2e-12 <= wrapped <= math.pi + 2e-12
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-12)


def test_half_a_turn_wraps_to_plus_pi():
    assert wrap_angle(-math.pi) == math.pi
    assert wrap_angle(math.pi) == math.pi
    assert wrap_angle(0.0) == 0.0


@given(st.floats(-1.0, 3.0), st.floats(-math.pi, math.pi), st.floats(-1.5, 1.5))
def test_both_rail_crane_roots_reach_the_point(d1, theta2, theta3):
    joints = np.array([d1, theta2, theta3])
    target = rail_crane_point(PROTOTYPE, joints)
    roots, excess = base_roots(RAIL_CRANE, PROTOTYPE.parameters, *target)
    # Where the two roots meet, rounding may push the cosine past 1: then there is nothing to see.
    if excess[1] > 0.0:
        assert excess[1] < 1e-14
        return
    for root in roots:
        # acos near its ends turns one rounding into its square root, yet the point moves with the
        # square of that: metres times a few roundings stay.
        np.testing.assert_allclose(rail_crane_point(PROTOTYPE, root), target, rtol=0, atol=1e-13)
        # asin loses digits towards 90 deg as 1 / cos: at 86 deg, fourteen times.
        assert root[2] == pytest.approx(theta3, abs=1e-13)


def test_one_of_the_rail_crane_roots_is_the_posture_that_made_the_point():
    joints = np.array([1.2, -85.0 * DEGREE, 12.0 * DEGREE])
    roots, _ = base_roots(RAIL_CRANE, PROTOTYPE.parameters, *rail_crane_point(PROTOTYPE, joints))
    gaps = np.abs(roots - joints).max(axis=1)
    assert gaps.min() < 1e-14 < gaps.max()


def test_at_home_the_roots_are_the_reports():
    # FACTS: spine point 4 at the table's home (x = 16.255, y = 0) has these two.
    roots, _ = base_roots(RAIL_CRANE, PROTOTYPE.parameters, 16.255 * INCH, 0.0, 53.843 * INCH)
    theta2 = np.sort(roots[:, 1] / DEGREE)
    # Half a unit of the last decimal printed.
    assert theta2[0] == pytest.approx(-89.999611194, abs=5e-10)
    assert theta2[1] == pytest.approx(70.378546, abs=5e-7)


def test_the_half_angle_forms_division_by_zero_is_no_singularity():
    """Eq 3.14 divides by G - E, which vanishes where theta2 = 180 deg: an ordinary point here."""
    joints = np.array([1.0, math.pi, 0.2])
    target = rail_crane_point(PROTOTYPE, joints)
    roots, excess = base_roots(RAIL_CRANE, PROTOTYPE.parameters, *target)
    assert np.all(excess <= 0.0)
    for root in roots:
        np.testing.assert_allclose(rail_crane_point(PROTOTYPE, root), target, rtol=0, atol=1e-14)
    assert np.min(np.abs(np.abs(roots[:, 1]) - math.pi)) < 1e-12


@pytest.mark.parametrize("beyond", [1e-6, 0.01, 1.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_point_too_far_aside_has_the_sines_excess(beyond, side):
    """y is d2 + K d3 -+ K S1 sin(theta3): beyond K S1 the sine exceeds 1 in proportion."""
    middle = PROTOTYPE.d2 + K * PROTOTYPE.d3
    y = middle + side * K * PROTOTYPE.first_length * (1.0 + beyond)
    roots, excess = base_roots(RAIL_CRANE, PROTOTYPE.parameters, 0.4, y, 1.0)
    assert excess[0] == pytest.approx(beyond, abs=1e-14)
    assert np.all(np.isnan(roots))


@pytest.mark.parametrize("beyond", [1e-6, 0.01, 1.0])
def test_a_point_too_far_from_the_rail_has_the_cosines_excess(beyond):
    """With theta3 = 0 spine point 4 circles hinge 2 at the hypotenuse of S1 + a2 and K d3."""
    reach = math.hypot(PROTOTYPE.first_length + PROTOTYPE.a2, K * PROTOTYPE.d3)
    y = PROTOTYPE.d2 + K * PROTOTYPE.d3
    x = PROTOTYPE.a0 + reach * (1.0 + beyond)
    roots, excess = base_roots(RAIL_CRANE, PROTOTYPE.parameters, x, y, 1.0)
    assert excess[0] < 0.0
    assert excess[1] == pytest.approx(beyond, abs=1e-14)
    assert np.all(np.isnan(roots))


def test_moving_along_the_rail_moves_d1_alone():
    near, _ = base_roots(RAIL_CRANE, PROTOTYPE.parameters, 0.41, 0.02, 1.0)
    far, _ = base_roots(RAIL_CRANE, PROTOTYPE.parameters, 0.41, 0.02, 1.5)
    np.testing.assert_array_equal(near[:, 1:], far[:, 1:])
    np.testing.assert_allclose(far[:, 0] - near[:, 0], 0.5, rtol=0, atol=1e-15)


GIMBAL_BASE = GimbalBase(offset=0.3, first_length=0.5)


@given(st.floats(-1.0, 3.0), st.floats(-math.pi, math.pi), st.floats(-1.5, 1.5))
def test_both_gimbal_roots_reach_the_point(d1, tilt, aside):
    target = gimbal_point(GIMBAL_BASE, np.array([d1, tilt, aside]))
    roots, excess = base_roots(GIMBAL, GIMBAL_BASE.parameters, *target)
    if np.any(excess > 0.0):  # tilt at 90 deg, by rounding
        assert np.max(excess) < 1e-14
        return
    for root in roots:
        np.testing.assert_allclose(gimbal_point(GIMBAL_BASE, root), target, rtol=0, atol=1e-14)


def test_gimbal_roots_are_the_carriage_behind_the_point_and_beyond_it():
    roots, _ = base_roots(GIMBAL, GIMBAL_BASE.parameters, 0.3, 0.0, 2.0)
    np.testing.assert_allclose(roots, [[1.5, 0.0, 0.0], [2.5, math.pi, 0.0]], atol=1e-15)


def test_gimbal_excess_is_the_distance_beyond_the_rods_length():
    length, offset = GIMBAL_BASE.first_length, GIMBAL_BASE.offset
    _, excess = base_roots(GIMBAL, GIMBAL_BASE.parameters, offset, 1.1 * length, 2.0)
    assert excess[0] == pytest.approx(0.1, abs=1e-14)
    _, excess = base_roots(GIMBAL, GIMBAL_BASE.parameters, offset + 1.2 * length, 0.0, 2.0)
    assert excess[1] == pytest.approx(0.2, abs=1e-14)


def test_a_gimbal_rod_square_to_the_rail_is_reached_in_one_way():
    roots, excess = base_roots(GIMBAL, GIMBAL_BASE.parameters, 0.3, -0.5, 2.0)
    assert np.all(excess <= 0.0)
    np.testing.assert_allclose(gimbal_point(GIMBAL_BASE, roots[0]), [0.3, -0.5, 2.0], atol=1e-9)


@pytest.mark.parametrize(
    ("kind", "base", "point", "joints"),
    [
        (RAIL_CRANE, PROTOTYPE, rail_crane_point, [1.0, -90.0 * DEGREE, 0.1]),
        (RAIL_CRANE, PROTOTYPE, rail_crane_point, [1.0, -120.0 * DEGREE, -0.5]),
        (RAIL_CRANE, PROTOTYPE, rail_crane_point, [1.0, 70.0 * DEGREE, 0.1]),
        (GIMBAL, GIMBAL_BASE, gimbal_point, [1.0, 0.4, -0.3]),
        (GIMBAL, GIMBAL_BASE, gimbal_point, [1.0, -175.0 * DEGREE, 0.2]),
    ],
)
def test_the_root_nearest_the_nominal_angle_is_taken_after_wrapping(kind, base, point, joints):
    target = point(base, np.array(joints))
    for turns in (-1, 0, 1):  # a nominal angle a turn away is the same nominal angle
        nominal = joints[1] + 0.05 + 2.0 * math.pi * turns
        d1, c2, s2, c3, s3, *excess = base_inverse(
            kind, base.parameters, *target, math.cos(nominal), math.sin(nominal)
        )
        assert max(excess) <= 0.0
        found = [d1, math.atan2(s2, c2), math.atan2(s3, c3)]
        np.testing.assert_allclose(found, joints, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("base", "point"), [(PROTOTYPE, rail_crane_point), (GIMBAL_BASE, gimbal_point)]
)
def test_a_bases_table_says_what_its_inverse_solves(base, point, report_frames):
    joints = np.array([1.3, -0.4, 0.7])
    table = base.dh_rows()
    rows = table[:, :4].copy()
    variable = np.where(table[:, 4] == 1.0, 2, 3)
    values = joints + rows[np.arange(3), variable]  # offsets: the table's d or theta at zero
    rows[np.arange(3), variable] = np.nan
    last = report_frames(rows, values)[-1]
    reached = last[:3, 3] + base.first_length * last[:3, 0]
    np.testing.assert_allclose(reached, point(base, joints), rtol=0, atol=1e-15)
