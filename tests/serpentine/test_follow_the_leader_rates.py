"""The joints' rates along the path: smooth on the arcs, jumps on the table."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.path_geometry import START
from pips_drake.serpentine.tip_path import TipPath

INCH = 0.0254
DEGREE = math.pi / 180.0


def crossing_jumps(ftl: FollowTheLeader, path: TipPath, h: float) -> np.ndarray:
    """Changes (C, joints - 1) of the angles' rates, rad/m, from `h` m before to `h` m after each
    tip position at which a spine point crosses a joint between two pieces."""
    s = path.samples(0.25 * INCH)
    arcs = ftl.solve(path, s).spine_arc_lengths
    jumps = []
    for joint in path.pieces[1:, START]:
        for spine in range(arcs.shape[1]):
            for i in np.flatnonzero((arcs[:-1, spine] < joint) & (arcs[1:, spine] >= joint)):
                low, high = s[i], s[i + 1]
                while high - low > 1e-12:
                    middle = 0.5 * (low + high)
                    at = ftl.solve(path, middle).spine_arc_lengths[0, spine]
                    low, high = (middle, high) if at < joint else (low, middle)
                around = ftl.solve(path, [low - 2 * h, low - h, high + h, high + 2 * h])
                rates = ftl.rates(path, around.joints, around.spine_arc_lengths)
                jumps.append((rates[2] - rates[1])[1:])
                # The same without `rates`: one-sided differences, good to the joints' second
                # derivative (20 rad/m^2) times h and their error (1e-10 rad) over h.
                slopes = np.diff(around.joints, axis=0)[[0, 2], 1:] / h
                np.testing.assert_allclose(
                    slopes[1] - slopes[0], jumps[-1], rtol=0, atol=40.0 * h + 4e-10 / h
                )
    return np.array(jumps)


def test_on_the_arcs_the_rates_do_not_jump(ftl):
    """Bound: the joints' second derivatives, below 20 rad/m^2 on arcs of 28 in (turning 30 deg in
    0.3 m and back takes 2 * 0.5 / 0.3^2 = 12), times the 2 h between the two sides."""
    h = 1e-6
    jumps = crossing_jumps(ftl, load_path("trajectory_4_arcs"), h)
    assert len(jumps) >= 8  # every spine point but those on the base line crosses home
    assert np.abs(jumps).max() < 20.0 * 2.0 * h
    # And it is the distance that makes the difference: a tenth of it, a tenth of the change.
    closer = crossing_jumps(ftl, load_path("trajectory_4_arcs"), 0.1 * h)
    assert np.abs(closer).max() < 20.0 * 0.2 * h


def test_on_the_table_the_rates_jump_at_every_vertex(ftl):
    jumps = np.abs(crossing_jumps(ftl, load_path("trajectory_4"), 1e-6)).max(axis=1)
    jumps *= INCH / DEGREE  # deg per inch of tip travel
    assert np.sum(jumps > 0.2) == len(jumps) == 44
    assert jumps.max() == pytest.approx(2.05, abs=0.01)  # in the fastest-changing angle
