"""Patterns of a scan: strips that touch, overlap, and end with the target, by closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.geometry import Box, Cylinder
from pydrake.math import RigidTransform

from pips_drake.errors import InputError
from pips_drake.planning.scan_target import (
    CylinderTarget,
    ScanCamera,
    check_standoff,
    gap_width,
    others,
)
from pips_drake.planning.scanning import (
    helix,
    pattern_of_points,
    raster,
    read_pattern,
    swath_along,
    swath_around,
)
from pips_drake.scene.signed_distance import PlacedShape, SignedDistanceField
from tests.planning.gap import FACE, PAYLOAD, bare_gap

CAMERA, STANDOFF = ScanCamera(), 0.244
WIDE = 2.0 * STANDOFF * math.tan(math.radians(25.0))


def target(length=2.0, turn=math.pi, **more):
    return CylinderTarget(radius=PAYLOAD, along=(0.0, length), around=(0.0, turn), **more)


def line_places(pattern, coordinate):
    """Where the lines stand: values that many points have."""
    values, counts = np.unique(np.round(coordinate, 9), return_counts=True)
    return values[counts > 10]


def test_without_overlap_strips_touch_and_the_outermost_end_with_the_target():
    found = raster(target(5 * WIDE), CAMERA, standoff=STANDOFF, overlap=0.0)
    along, around, height = found.target.from_world(found.points)
    assert_allclose(height, STANDOFF, rtol=0, atol=1e-12)
    assert_allclose(line_places(found, along), WIDE * (np.arange(5) + 0.5), rtol=0, atol=1e-9)
    assert found.spacing == pytest.approx(WIDE, rel=1e-12)
    assert swath_along(CAMERA, STANDOFF) == pytest.approx(WIDE, rel=1e-12)
    # To half a strip from either edge, around.
    inset = 0.5 * swath_around(CAMERA, STANDOFF, PAYLOAD)
    assert_allclose([around.min(), around.max()], [inset, math.pi - inset], rtol=0, atol=1e-12)


def test_an_overlap_of_half_puts_lines_half_a_strip_apart():
    found = raster(target(5 * WIDE), CAMERA, standoff=STANDOFF, overlap=0.5)
    along, _, _ = found.target.from_world(found.points)
    assert_allclose(np.diff(line_places(found, along)), 0.5 * WIDE, rtol=0, atol=1e-9)
    assert found.passes.max() == 8


@pytest.mark.parametrize("length", [0.1, 1.0, 2.345])
def test_lines_stand_no_farther_apart_than_asked_and_cover_both_edges(length):
    found = raster(target(length), CAMERA, standoff=STANDOFF, overlap=0.2)
    places = np.unique(np.round(found.target.from_world(found.points)[0], 9))
    assert found.spacing <= 0.8 * WIDE + 1e-12
    assert places[0] - 0.5 * WIDE <= 1e-9
    assert places[-1] + 0.5 * WIDE >= length - 1e-9


def test_the_edge_of_a_strip_along_the_axis_is_where_its_ray_meets_the_cylinder():
    turn = swath_around(CAMERA, STANDOFF, PAYLOAD)
    edge = PAYLOAD * np.array([math.cos(0.5 * turn), math.sin(0.5 * turn)])
    view = edge - [PAYLOAD + STANDOFF, 0.0]
    assert math.atan2(view[1], -view[0]) == pytest.approx(math.radians(25.0), abs=1e-12)
    # A camera that would see beyond the horizon stops at its largest incidence.
    all_round = ScanCamera(field_of_view=math.radians(170.0), aspect=1.0)
    half = 0.5 * swath_around(all_round, STANDOFF, PAYLOAD)
    edge = PAYLOAD * np.array([math.cos(half), math.sin(half)])
    view = np.array([PAYLOAD + STANDOFF, 0.0]) - edge
    cosine = view @ edge / (np.linalg.norm(view) * PAYLOAD)
    assert math.degrees(math.acos(cosine)) == pytest.approx(75.0, abs=1e-9)


@pytest.mark.parametrize("lines", ["around", "along"])
def test_a_raster_is_one_unbroken_way_at_its_standoff_that_looks_at_the_surface(lines):
    found = raster(target(), CAMERA, standoff=STANDOFF, lines=lines, step=0.05)
    steps = np.linalg.norm(np.diff(found.points, axis=0), axis=1)
    assert steps.min() > 0.0 and steps.max() <= 0.05 + 1e-12
    assert_allclose(found.points + STANDOFF * found.views, on_surface(found), rtol=0, atol=1e-12)
    assert (np.diff(found.passes) >= 0).all()
    assert found.length == pytest.approx(steps.sum())


def on_surface(found):
    along, around, _ = found.target.from_world(found.points)
    return found.target.to_world(along, around)


def test_a_helix_begins_and_ends_with_a_level_turn_and_climbs_evenly_in_between():
    whole = target(1.0, 2.0 * math.pi)
    found = helix(whole, CAMERA, standoff=STANDOFF, overlap=0.2, step=0.05)
    along, _, height = whole.from_world(found.points)
    assert_allclose(height, STANDOFF, rtol=0, atol=1e-12)
    turns = math.ceil((1.0 - WIDE) / (0.8 * WIDE))
    assert found.spacing == pytest.approx((1.0 - WIDE) / turns)
    assert found.passes.max() == turns + 1
    per_turn = 2.0 * math.pi * (PAYLOAD + STANDOFF)
    flat = np.isclose(along, 0.5 * WIDE, rtol=0, atol=1e-12)
    assert flat.sum() * 0.05 == pytest.approx(per_turn, rel=0.01)
    climbing = math.hypot(per_turn, found.spacing)
    # A chord is shorter than its arc by (0.05 / 2.03)^2 / 24: less than 1e-4.
    assert found.length == pytest.approx(2.0 * per_turn + turns * climbing, rel=1e-4)


def test_a_target_that_is_turned_and_moved_takes_its_pattern_along():
    R = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    moved = target(origin=[1.0, 2.0, 3.0], rotation=R)
    plain = raster(target(), CAMERA, standoff=STANDOFF)
    found = raster(moved, CAMERA, standoff=STANDOFF)
    assert_allclose(found.points, plain.points @ R.T + [1.0, 2.0, 3.0], rtol=0, atol=1e-12)
    assert_allclose(found.views, plain.views @ R.T, rtol=0, atol=1e-12)


def test_a_table_of_points_is_read_and_made_dense(tmp_path):
    file = tmp_path / "pattern.csv"
    file.write_text("x_m,y_m,z_m\n2.0,0.0,0.0\n2.0,0.0,1.0\n2.0,0.5,1.0\n")
    found = read_pattern(file, field=bare_gap(), step=0.1)
    assert found.length == pytest.approx(1.5)
    assert len(found.points) == 16
    # Between payload and wall the payload is nearer: the views go in.
    assert_allclose(found.views[0], [-1.0, 0.0, 0.0], rtol=0, atol=1e-12)
    file.write_text("x_m,y_m,z_m\n2.0,0.0,nan\n2.0,0.0,1.0\n")
    with pytest.raises(InputError, match=r"pattern\.csv: row 1, z = nan; must be finite"):
        read_pattern(file, field=bare_gap())


def test_the_gap_is_measured_and_a_standoff_that_does_not_fit_is_refused():
    field = bare_gap()
    # Straight out to staves: FACE in their middles, more at their edges.
    assert FACE - PAYLOAD <= gap_width(target(), field) <= FACE / math.cos(math.pi / 36) - PAYLOAD
    check_standoff(target(), field, STANDOFF, 0.12)
    words = r"standoff = 0\.4 m; must be 0\.12 m \.\. 0\.36\d m; the gap's middle is 0\.24\d m"
    with pytest.raises(InputError, match=words):
        check_standoff(target(), field, 0.4, 0.12)
    with pytest.raises(InputError, match=r"an arm of radius 0\.3 m does not fit"):
        check_standoff(target(), field, STANDOFF, 0.3)


def test_the_target_itself_is_no_obstacle_to_it_but_what_is_fixed_to_it_is():
    pin = PlacedShape("payload", "pin", Box(0.2, 0.2, 0.2), RigidTransform([PAYLOAD, 0.0, 0.5]))
    shell = PlacedShape("payload", "shell", Cylinder(PAYLOAD, 100.0), RigidTransform())
    left = others(target(), SignedDistanceField.of([pin, shell]))
    assert [placed.name for placed in left.shapes] == ["pin"]
    assert gap_width(target(), SignedDistanceField.of([shell])) == math.inf


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ScanCamera(field_of_view=0.0), "field of view = 0 deg; must be 0 .. 180"),
        (lambda: ScanCamera(near=2.0, far=1.0), "near < far"),
        (lambda: ScanCamera(incidence=math.pi), "incidence = 180 deg"),
        (lambda: ScanCamera(aspect=math.nan), "aspect = nan; must be > 0"),
        (lambda: target(-1.0), "along = 0 .. -1 m; must be finite, from less than to"),
        (lambda: target(turn=7.0), "a whole turn at most"),
        (lambda: CylinderTarget(radius=math.nan, along=(0.0, 1.0)), "radius = nan m; must be > 0"),
        (lambda: raster(target(), CAMERA, standoff=math.nan), "standoff = nan m"),
        (lambda: raster(target(), CAMERA, standoff=5.0), "within the camera's range"),
        (lambda: raster(target(), CAMERA, standoff=0.2, overlap=1.0), "overlap = 1.0"),
        (lambda: raster(target(), CAMERA, standoff=0.2, step=0.0), "step = 0.0 m; must be > 0"),
        (lambda: raster(target(), CAMERA, standoff=0.2, step=1e-9), "number of a scan's points"),
        (lambda: raster(target(1e9), CAMERA, standoff=0.2), "number of a scan's lines"),
        (lambda: raster(target(), CAMERA, standoff=0.2, lines="x"), "must be around or along"),
        (lambda: helix(target(), CAMERA, standoff=0.2), "helix around = 180 deg; must be 360"),
        (lambda: pattern_of_points([[0, 0, 0]], target=target()), "must be .2 or more, 3."),
        (lambda: pattern_of_points([[0, 0, 0], [1, 0, math.inf]]), "must be finite"),
        (lambda: pattern_of_points([[0, 0, 0], [1, 0, 0]]), "must come with a target"),
    ],
)
def test_numbers_that_mean_nothing_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()
