"""The six conditions of acquisition: each alone, each broken alone."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from pips_drake.remote_manipulator.acquisition import (
    CONDITIONS,
    Acquisition,
    AcquisitionTest,
    held_pose,
)
from pips_drake.remote_manipulator.kinematics import (
    heading_matrix,
    pitch_matrix,
    roll_matrix,
)
from pips_drake.remote_manipulator.phases import Phase
from pips_drake.units import FOOT

from .program_world import BAR_TOP, CONFIG, DOWN, PALM_TOP, STOWED, arm_over, world

TEST = AcquisitionTest(CONFIG)
CLOSED = CONFIG.effector.prong_closed_gap_m
#: Palm over the bar's middle, 10 mm above it.
WRIST = STOWED[1] - [0.0, 0.0, PALM_TOP + CONFIG.arm.arm_2_m]
ASKEW = np.array([0.01, -0.02, 0.03])
#: Farther than rounding (1e-14 m at these places), nearer than anything that matters, m.
HAIR = 1e-9


def measured(
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0),
    gap: float = CLOSED,
    turn: np.ndarray | None = None,
) -> Acquisition:
    """With the effector shifted in {R}, or turned about the middle of the palm's bottom."""
    R = DOWN if turn is None else turn @ DOWN
    reach = CONFIG.arm.arm_2_m + CONFIG.effector.palm.length_m
    bottom = WRIST + reach * DOWN[:, 0] + shift
    return TEST((R, bottom - reach * R[:, 0]), gap, STOWED)


#: Each breaks one condition and leaves the others: the palm tilted so far along the bar that an end
#: of it is above the palm's bottom; the bar over finger or prong; a prong that is open by more than
#: it may; the palm too high; the palm beyond the bar's end less half a foot.
BREAKS = {
    "bar_below_palm": {"turn": pitch_matrix(math.radians(3.0))},
    "bar_inside_finger": {"shift": (0.0, -0.03, 0.0), "gap": 0.265},
    "bar_inside_prong": {"shift": (0.0, 0.03, 0.0)},
    "prong_closed": {"gap": CONFIG.acquisition.prong_gap_m + 0.02},
    "palm_near_bar": {"shift": (0.0, 0.0, -0.012)},
    "palm_between_ends": {"shift": (0.66, 0.0, 0.0)},
}


def test_all_six_hold_over_the_bars_middle():
    found = measured()
    assert found.conditions == (True,) * 6
    assert found.acquired


@pytest.mark.parametrize("name", CONDITIONS)
def test_a_condition_broken_alone_prevents_acquisition(name):
    found = measured(**BREAKS[name])
    assert [k for k, good in zip(CONDITIONS, found.conditions, strict=True) if not good] == [name]
    assert not found.acquired


@pytest.mark.parametrize("name", CONDITIONS)
def test_a_condition_broken_alone_prevents_mode_2(name, monkeypatch):
    there = world(arm=arm_over(STOWED, gap=CLOSED + 0.01))
    test = there.program._acquisition
    row = CONDITIONS.index(name)

    def broken(*given):
        found = test(*given)
        conditions = tuple(good and k != row for k, good in enumerate(found.conditions))
        return dataclasses.replace(found, conditions=conditions)

    monkeypatch.setattr(there.program, "_acquisition", broken)
    for _ in range(5):
        there.frame()
    assert there.state.phase is Phase.STOWED
    # With that condition as it is, one frame is enough.
    monkeypatch.undo()
    assert there.frame().phase is Phase.EXTRACTION


def limit(**changes) -> dict[str, object]:
    """The conditions by name, with `measured`'s arguments."""
    return dict(zip(CONDITIONS, measured(**changes).conditions, strict=True))


@pytest.mark.parametrize(
    ("name", "inside", "outside"),
    [
        ("palm_near_bar", -FOOT / 16 + 0.01 + HAIR, -FOOT / 16 + 0.01 - HAIR),
        ("bar_below_palm", 0.01 - HAIR, 0.01 + HAIR),
    ],
)
def test_height_is_decided_right_at_both_sides_of_its_tolerance(name, inside, outside):
    assert limit(shift=(0.0, 0.0, inside))[name]
    assert not limit(shift=(0.0, 0.0, outside))[name]


@pytest.mark.parametrize("side", [-1, 1])
def test_the_ends_are_decided_right_at_both_sides_of_half_a_foot(side):
    room = 0.5 * CONFIG.receptacle.length_m - 0.5 * FOOT
    assert limit(shift=(side * (room - HAIR), 0.0, 0.0))["palm_between_ends"]
    assert not limit(shift=(side * (room + HAIR), 0.0, 0.0))["palm_between_ends"]


def test_the_prong_is_decided_right_at_both_sides_of_its_tolerance():
    gap = CONFIG.acquisition.prong_gap_m
    assert limit(gap=math.nextafter(gap, 0.0))["prong_closed"]
    assert not limit(gap=gap)["prong_closed"]


def test_the_fingers_are_decided_right_at_both_sides_of_touching():
    play = CONFIG.effector.finger_offset_m - 0.5 * CONFIG.receptacle.width_m
    # y2 is against y: the finger is at +y of the bar.
    assert limit(shift=(0.0, -play + HAIR, 0.0), gap=0.26)["bar_inside_finger"]
    assert not limit(shift=(0.0, -play - HAIR, 0.0), gap=0.26)["bar_inside_finger"]
    assert limit(shift=(0.0, play - HAIR, 0.0))["bar_inside_prong"]
    assert not limit(shift=(0.0, play + HAIR, 0.0))["bar_inside_prong"]


def test_an_end_of_the_palm_below_the_bars_top_is_a_touch():
    # Half of the palm along the bar: 0.2 m; 4 degrees put its end 14 mm down, of 10.
    assert not measured().edge_touches
    for angle in (-4.0, 4.0):
        tilted = measured(turn=pitch_matrix(math.radians(angle)))
        assert tilted.edge_touches
        assert not tilted.acquired
    # The same angle across the bar moves the sides of the palm, beside the bar: no edge of AQFTST.
    assert not measured(turn=roll_matrix(math.radians(4.0))).edge_touches


def test_what_is_missing_is_measured():
    assert measured().distance == 0.0
    up = measured(shift=(0.0, 0.0, -1.0))
    assert up.distance == pytest.approx(1.01 - FOOT / 16, abs=1e-12)
    beyond = measured(shift=(1.0, 0.0, 0.0))
    room = 0.5 * CONFIG.receptacle.length_m - 0.5 * FOOT
    assert beyond.distance == pytest.approx(1.0 - room, abs=1e-12)
    aside = measured(shift=(0.0, 0.5, -1.0))
    assert aside.distance == pytest.approx(math.hypot(0.5 - 0.02, 1.01 - FOOT / 16), abs=1e-12)


@pytest.mark.parametrize("turn", [heading_matrix, pitch_matrix, roll_matrix])
@pytest.mark.parametrize("angle", [-0.3, 0.02, 1.2])
def test_the_angle_is_that_of_the_turn(turn, angle):
    # acos of a cosine near 1 errs by the root of rounding: 2e-8.
    assert measured(turn=turn(angle)).angle == pytest.approx(abs(angle), abs=1e-7)


def test_the_bar_can_be_taken_both_ways():
    for turn, sign in ((np.eye(3), 1), (heading_matrix(math.pi), -1)):
        # With the fingers exchanged the bar is as far from either: same gap on both sides.
        found = measured(turn=turn)
        assert found.acquired
        assert found.sign == sign
        # UZ2XR decides in the report: z2's x component.
        assert math.copysign(1.0, (turn @ DOWN)[0, 2]) == sign


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_snapped_pose_is_mo2sets_table(sign):
    turn = np.eye(3) if sign > 0 else heading_matrix(math.pi)
    # A little askew, so that snapping changes something.
    R = turn @ heading_matrix(0.02) @ DOWN
    X_R2 = R, WRIST + ASKEW
    R_2P, p_2P = held_pose(X_R2, STOWED, sign, snap=True)
    ux2, uy2, uz2 = R.T
    payload = R @ R_2P
    expected = np.column_stack([sign * uz2, -sign * uy2, ux2])
    np.testing.assert_allclose(payload, expected, atol=1e-15)
    assert np.linalg.det(R_2P) == pytest.approx(1.0)
    # VP1: the payload's middle from the end of arm 1, in {R}, to components along x2, y2, z2.
    x, y, z = STOWED[1] - X_R2[1]
    np.testing.assert_allclose(p_2P, [z, -sign * y, sign * x], atol=1e-12)


def test_the_true_pose_is_held_as_it_is():
    R = heading_matrix(0.02) @ pitch_matrix(0.01) @ DOWN
    p = WRIST + ASKEW
    R_2P, p_2P = held_pose((R, p), STOWED, 1, snap=False)
    np.testing.assert_allclose(R @ R_2P, STOWED[0], atol=1e-15)
    np.testing.assert_allclose(R @ p_2P + p, STOWED[1], atol=1e-12)


def test_the_bars_top_is_where_the_configuration_has_it():
    # Guards the constants of these tests themselves.
    assert pytest.approx(-BAR_TOP) == -CONFIG.payload.across_flats_m / 2 - 0.4
