"""Extremes over a motion are those that dense sampling approaches from inside, and no more."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.serpentine.drives import drive_limits, levers
from pips_drake.serpentine.motion_extremes import motion_extremes
from pips_drake.serpentine.plan import joint_margins

SUBSTEPS = 2000


def wandering(arm, seed, knots=6, reach=1.0):
    """Knots that may go beyond the joints' limits, and to hinge angles past 0 and pi."""
    rng = np.random.default_rng(seed)
    joints = arm.joint_home + rng.uniform(-reach, reach, (knots, arm.joints))
    return np.cumsum(rng.uniform(0.1, 1.0, knots)), joints


def uneven(arm, seed):
    """The arm with pins at different distances, so that levers peak inside their range."""
    linkage, rng = arm.linkage, np.random.default_rng(seed)
    shape = linkage.anchor_inner.shape
    changed = dataclasses.replace(
        linkage,
        anchor_inner=linkage.anchor_inner * rng.uniform(0.4, 1.6, shape),
        pin_angle=linkage.pin_angle * rng.uniform(0.3, 1.5, shape),
    )
    return dataclasses.replace(arm, linkage=changed)


def sampled(arm, times, joints):
    """Margins, stroke margins and speed fractions at dense samples, from their definitions."""
    parts = np.linspace(0.0, 1.0, SUBSTEPS + 1)[:, None]
    first, linkage = arm.first_actuated_joint, arm.linkage
    margins, strokes, speeds = [], [], []
    for k in range(len(times) - 1):
        q = joints[k] + parts * (joints[k + 1] - joints[k])
        lengths = linkage.length(q[:, first:])
        rates = (joints[k + 1] - joints[k]) / (times[k + 1] - times[k])
        margins.append(joint_margins(arm, q))
        strokes.append(np.minimum(lengths - linkage.length_lower, linkage.length_upper - lengths))
        speeds.append(np.abs(levers(arm, q) * rates) / drive_limits(arm)[2])
    return (
        np.concatenate(margins).min(axis=0),
        np.concatenate(strokes).min(axis=0),
        np.concatenate(speeds).max(axis=0),
    )


@pytest.mark.parametrize("seed", range(12))
def test_extremes_are_what_dense_samples_come_to(arm, seed):
    other = uneven(arm, seed) if seed % 2 else arm
    times, joints = wandering(other, seed, reach=0.4 if seed < 4 else 2.5)
    found = motion_extremes(other, times, joints)
    margin, stroke, speed = sampled(other, times, joints)
    # Joints: the extreme is at a knot, which is a sample.
    np.testing.assert_allclose(found.joint_margin, margin, rtol=0, atol=1e-15)
    # Never on the wrong side of a sample (up to rounding), and near the best one: samples are up to
    # 2.5e-3 rad apart, and where equal pins meet the length has a corner of slope 0.23 m/rad.
    assert np.all(found.stroke_margin <= stroke + 1e-15)
    np.testing.assert_allclose(found.stroke_margin, stroke, rtol=0, atol=3e-4)
    assert np.all(found.speed_fraction >= speed * (1.0 - 1e-12))
    np.testing.assert_allclose(found.speed_fraction, speed, rtol=0.01)


def test_a_lever_that_peaks_between_knots_is_found(arm):
    """Pins at a and b = a / 2: L' is largest, b, where cos(phi) = 1/2."""
    linkage = dataclasses.replace(
        arm.linkage,
        anchor_outer=0.5 * arm.linkage.anchor_inner,
        pin_angle=np.full_like(arm.linkage.pin_angle, np.pi / 3),
    )
    other = dataclasses.replace(arm, linkage=linkage)
    joints = np.tile(arm.joint_home, (2, 1))
    joints[0, 2:], joints[1, 2:] = -0.3, 0.2
    found = motion_extremes(other, [0.0, 0.5], joints)
    expected = 0.5 * arm.linkage.anchor_inner * (0.5 / 0.5) / linkage.speed_limit
    np.testing.assert_allclose(found.speed_fraction[2:], expected, rtol=1e-14)
    assert np.all(found.speed_fraction[:2] == 0.0)


def test_a_deviation_takes_its_share_of_the_margins(arm):
    times, joints = wandering(arm, 3, reach=0.3)
    plain = motion_extremes(arm, times, joints)
    off = np.linspace(0.0, 0.02, arm.joints)
    allowed = motion_extremes(arm, times, joints, deviation=off)
    np.testing.assert_allclose(allowed.joint_margin, plain.joint_margin - off, rtol=0, atol=1e-15)
    assert np.all(allowed.stroke_margin < plain.stroke_margin)
    np.testing.assert_allclose(allowed.speed_fraction, plain.speed_fraction, rtol=1e-14)
    # Whatever motion stays that near keeps the margins that are promised.
    rng = np.random.default_rng(5)
    for _ in range(20):
        moved = joints + rng.choice([-1.0, 1.0], arm.joints) * off
        other = motion_extremes(arm, times, moved)
        assert np.all(other.joint_margin >= allowed.joint_margin - 1e-15)
        assert np.all(other.stroke_margin >= allowed.stroke_margin - 1e-15)


def test_times_are_those_of_the_extremes(arm):
    joints = np.tile(arm.joint_home, (4, 1))
    joints[2, 5] += 0.3  # out in the second segment, back in the third, which is twice as long
    found = motion_extremes(arm, [0.0, 1.0, 2.0, 4.0], joints)
    assert found.joint_time[5] in (1.0, 2.0)
    assert found.speed_time[5] == 1.0
    assert found.stroke_time[3] in (1.0, 2.0)


@pytest.mark.parametrize(
    ("times", "change", "message"),
    [
        ([0.0], {}, "must be"),
        ([0.0, 0.0], {}, "increasing"),
        ([0.0, np.nan], {}, "increasing"),
        ([0.0, 1.0], {"deviation": -1.0}, ">= 0"),
        ([0.0, 1.0], {"deviation": np.nan}, "finite"),
    ],
)
def test_what_is_no_motion_is_refused(arm, times, change, message):
    joints = np.tile(arm.joint_home, (len(times), 1))
    with pytest.raises(InputError, match=message):
        motion_extremes(arm, times, joints, **change)
