"""The tracking error and the largest share of a limit, and no NaN lost among numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pips_drake.serpentine import kinematics
from pips_drake.serpentine.drives import drive_limits
from pips_drake.serpentine.tracking import largest_share, tracking_error


def test_the_tracking_error_is_the_farthest_spine_points(arm, random_postures):
    wanted, reached = random_postures(arm, 20), random_postures(arm, 40)[20:]
    points = [kinematics.spine_points(arm, q) for q in (wanted, reached)]
    distances = np.linalg.norm(points[0] - points[1], axis=-1)
    spine = np.array(arm.spine_indices)
    for i in range(20):
        error, joint = tracking_error(arm.dh_table, spine, wanted[i], reached[i])
        # Metres of sums of products.
        assert error == pytest.approx(distances[i].max(), abs=1e-13)
        assert joint == spine[np.argmax(distances[i])]


def test_one_nan_among_many_numbers_is_not_lost(arm):
    q, spine = np.zeros(18), np.array(arm.spine_indices)
    limits = drive_limits(arm)[3]
    for j in range(17):  # the last joint turns about its own spine point
        bad = q.copy()
        bad[j] = np.nan
        assert math.isnan(tracking_error(arm.dh_table, spine, q, bad)[0]), j
        share, drive = largest_share(np.where(np.arange(18) == j, np.nan, 2.0 * limits), limits)
        assert math.isnan(share) and drive == j


def test_the_largest_share_is_found_whatever_its_sign(arm):
    limits = drive_limits(arm)[3]
    efforts = 0.3 * limits
    efforts[7] = -0.9 * limits[7]
    share, drive = largest_share(efforts, limits)
    assert (share, drive) == (pytest.approx(0.9, rel=1e-15), 7)
