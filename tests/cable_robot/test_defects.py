"""Seeded defects: where they may be, how large their shapes are, what a mission changes."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from pips_drake.cable_robot.defects import (
    EDGE_GAP,
    KINDS,
    LEAST_GAP,
    Defect,
    defect_patches,
    next_mission,
    seeded_defects,
)
from pips_drake.cable_robot.panels import radiator_panels
from pips_drake.errors import InputError

PANELS = radiator_panels()
DEFECTS = seeded_defects(3, PANELS, 120)


def outlines(defects):
    return [np.concatenate([p.points for p in defect_patches(d)]) for d in defects]


def test_the_same_seed_gives_the_same_defects_and_another_one_others():
    assert seeded_defects(3, PANELS, 120) == DEFECTS
    assert seeded_defects(4, PANELS, 120) != DEFECTS
    assert set(Counter(d.kind for d in DEFECTS)) == set(KINDS)


def test_shapes_are_as_large_as_stated_about_their_place():
    for defect, points in zip(DEFECTS, outlines(DEFECTS), strict=True):
        # A ding is a polygon of 24 corners, whose opposite corners are its size apart.
        assert pdist(points).max() == pytest.approx(defect.size_m, rel=1e-3)
        # The area's middle, from points strewn over the box round it that are in a triangle.
        corners = np.concatenate([p.points[p.triangles] for p in defect_patches(defect)])
        a, b, c = corners.swapaxes(0, 1)
        area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
        assert np.all(area > 0.0)  # all the same way round
        middle = area @ corners.mean(axis=1) / area.sum()
        np.testing.assert_allclose(middle, [defect.u, defect.v], atol=1e-9)


def test_the_middle_of_a_shape_is_where_strewn_points_say():
    defect = Defect(
        kind="scratch", panel="port_1", u=1.0, v=2.0, size_m=0.04, width_m=0.004, shape=5
    )
    (patch,) = defect_patches(defect)
    low, high = patch.points.min(axis=0), patch.points.max(axis=0)
    points = np.random.default_rng(0).uniform(low, high, (20000, 2))
    inside = np.zeros(len(points), dtype=bool)
    for a, b, c in patch.points[patch.triangles]:
        weights = np.linalg.solve(np.column_stack([b - a, c - a]), (points - a).T)
        inside |= np.all(weights >= 0.0, axis=0) & (weights.sum(axis=0) <= 1.0)
    # Some 4000 points of a strip 40 mm long: 0.2 mm of standard error at most.
    np.testing.assert_allclose(points[inside].mean(axis=0), [1.0, 2.0], atol=0.6e-3)


def test_defects_keep_apart_and_off_the_edges():
    shapes = outlines(DEFECTS)
    sizes = {p.name: (p.length, p.width) for p in PANELS}
    for i, (defect, points) in enumerate(zip(DEFECTS, shapes, strict=True)):
        room = np.array(sizes[defect.panel])
        assert points.min() > EDGE_GAP and np.all(room - points > EDGE_GAP)
        for other, more in zip(DEFECTS[:i], shapes[:i], strict=True):
            if other.panel == defect.panel:
                assert np.linalg.norm(points[:, None] - more[None], axis=2).min() > LEAST_GAP


def test_a_mission_adds_grows_and_cleans_as_many_as_asked():
    after = next_mission(DEFECTS, 9, PANELS, new=7, grown=6, cleaned=3)
    assert len(after) == 120 + 7 - 3
    before = {(d.panel, d.u, d.v): d for d in DEFECTS}
    there = {(d.panel, d.u, d.v): d for d in after}
    grown = [(before[k], d) for k, d in there.items() if k in before and before[k] != d]
    assert len(grown) == 6 and len(set(there) - set(before)) == 7
    assert all(new.size_m >= 1.4 * old.size_m and new.kind != "debris" for old, new in grown)
    assert all(before[k].kind == "debris" for k in set(before) - set(there))
    assert next_mission(DEFECTS, 9, PANELS, new=7, grown=6, cleaned=3) == after


def test_bad_defects_are_refused():
    with pytest.raises(InputError, match="defect kind = hole"):
        Defect(kind="hole", panel="port_1", u=1.0, v=1.0, size_m=0.01, width_m=0.01)
    with pytest.raises(InputError, match=r"width of a ding = 0\.02 m of 0\.01 m"):
        Defect(kind="ding", panel="port_1", u=1.0, v=1.0, size_m=0.01, width_m=0.02)
    with pytest.raises(InputError, match=r"sizes of defects = 0\.02 \.\. 0\.01 m"):
        seeded_defects(0, PANELS, 3, (0.02, 0.01))
    with pytest.raises(InputError, match=r"must be fewer: \d+ have room"):
        seeded_defects(0, PANELS[:1], 400, (0.3, 0.4))
    with pytest.raises(InputError, match="debris to clean = 500"):
        next_mission(DEFECTS, 0, PANELS, cleaned=500)
    with pytest.raises(InputError, match="defects to grow = 500"):
        next_mission(DEFECTS, 0, PANELS, grown=500)
    assert math.isclose(sum(d.size_m >= 0.005 for d in DEFECTS) / 120, 0.8, abs_tol=0.15)
