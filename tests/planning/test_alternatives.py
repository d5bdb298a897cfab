"""Paths to choose from: known classes and lengths, never two of one class, the shortest first."""

from __future__ import annotations

import math
from itertools import combinations, pairwise

import numpy as np
import pytest
from pydrake.geometry import Box
from pydrake.math import RigidTransform

from pips_drake.errors import InputError
from pips_drake.planning.alternatives import find_alternatives
from pips_drake.planning.grid import Grid
from pips_drake.planning.grid_search import NoPathError, find_path
from pips_drake.planning.line_of_sight import is_clear
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.path_classes import Surface, reduced
from pips_drake.planning.sliding import path_length
from pips_drake.planning.string_pull import pull
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import (
    PlacedShape,
    SignedDistanceField,
    read_distance_field,
)

from .gap import ARM, FACE, MIDDLE, PAYLOAD, at, bare_gap, post, taut_length


def grid(lower=-np.pi, upper=np.pi, shape=(60, 110, 6)):
    corners = np.array([[-3.0, lower, PAYLOAD], [3.0, upper, FACE]])
    return Grid(lower=corners[0], upper=corners[1], shape=shape, unfolded=True)


@pytest.fixture(scope="module")
def bare():
    return Occupancy.of(bare_gap(), grid(), ARM)


def with_posts(bare, *posts):
    return bare.updated(bare.field.with_shapes(posts))


def belt_length(start, goal, circles):
    """Of a taut string in a plane around circles of radius ARM, each passed on its left (1) or
    right (-1): tangents between signed circles and the arcs between them, m."""
    points = [np.array(start), *(np.array(c) for c, _ in circles), np.array(goal)]
    signed = [0.0, *(ARM * side for _, side in circles), 0.0]
    total, directions = 0.0, []
    for (p, q), (a, b) in zip(pairwise(points), pairwise(signed), strict=True):
        way = q - p
        apart = float(np.hypot(*way))
        total += math.sqrt(apart**2 - (a - b) ** 2)
        directions.append(math.atan2(way[1], way[0]) + math.asin((a - b) / apart))
    for before, after in pairwise(directions):
        total += ARM * abs((after - before + np.pi) % (2.0 * np.pi) - np.pi)
    return total


def side_of(path, piece, along):
    """Towards higher (1) or lower (-1) angles than a post's, where a path passes it."""
    q = np.column_stack([path[:, 2], np.unwrap(np.arctan2(path[:, 1], path[:, 0]))])
    return np.sign(np.interp(along, q[:, 0], q[:, 1]) - piece)


def check_common(occupancy, found):
    """Clear, of different classes, in the order of their lengths."""
    surface = Surface.of(occupancy)
    words = [surface.word(one.pulled) for one in found]
    for one, other in combinations(words, 2):
        assert one != other
    for one, word in zip(found, words, strict=True):
        assert one.word == word == surface.word(one.path)
        assert is_clear(occupancy.field, one.pulled, ARM - 1e-5)
        np.testing.assert_array_equal(one.pulled[[0, -1]], found[0].pulled[[0, -1]])
        assert one.length == pytest.approx(
            np.linalg.norm(np.diff(one.pulled, axis=0), axis=1).sum()
        )
    assert [one.length for one in found] == sorted(one.length for one in found)
    assert found[0].words == "the shortest way"
    assert len({one.words for one in found}) == len(found)


def check_turns(bare, turns):
    start, goal = at(0.0, -1.0), at(2.0, 1.5)
    found = find_alternatives(bare, start, goal, count=len(turns), longest=5.0)
    check_common(bare, found)
    radius = PAYLOAD + ARM
    tangent = math.sqrt(MIDDLE**2 - radius**2)
    for one, turn in zip(found, turns, strict=True):
        arc = turn - 2.0 * math.acos(radius / MIDDLE)
        taut = math.hypot(2.0 * tangent + radius * arc, 2.5)
        # Strings are at most 5 % longer than taut ones, and never shorter but for their tolerance.
        assert taut - 1e-4 <= one.length <= 1.05 * taut
    assert found[0].length <= 1.05 * taut_length(start, goal)
    assert found[1].words == "around the payload the other way"
    return found


def test_a_bare_gap_has_a_way_on_either_side(bare):
    check_turns(bare, (2.0, 2.0 * np.pi - 2.0))


@pytest.mark.slow
def test_a_bare_gap_has_ways_with_more_turns(bare):
    """16 m around the payload: pulling takes its time."""
    found = check_turns(bare, (2.0, 2.0 * np.pi - 2.0, 2.0 * np.pi + 2.0))
    assert found[2].words == "around the payload the same way, 1 turn more"


def test_longest_and_count_say_how_many_come(bare):
    start, goal = at(0.0, -1.0), at(2.0, 1.5)
    assert len(find_alternatives(bare, start, goal, count=3, longest=1.2)) == 1
    assert len(find_alternatives(bare, start, goal, count=1, longest=2.2)) == 1


@pytest.mark.parametrize("shift", [0.0, 0.2])
def test_one_post_is_passed_on_either_side_with_the_lengths_of_belts(bare, shift):
    """In the plane x = MIDDLE, in which nothing but the post is in the way."""
    width, height = 0.5, 0.6
    occupancy = with_posts(bare, post("post", shift / MIDDLE, 0.0, width, height))
    start, goal = at(0.0, -1.4), at(0.0, 1.4)
    found = find_alternatives(occupancy, start, goal, count=2)
    check_common(occupancy, found)
    lengths = []
    for side in (1, -1):
        # Along z and y, y on the left; a post on the string's right is passed on its left.
        edge = shift + side * 0.5 * width
        circles = [((-0.5 * height, edge), -side), ((0.5 * height, edge), -side)]
        lengths.append(belt_length((-1.4, 0.0), (1.4, 0.0), circles))
    # The shifted post stands 6 deg askew: a centimetre at its edges, 2 mm of such a length.
    for one, length in zip(found, sorted(lengths), strict=True):
        assert one.length == pytest.approx(length, rel=0.01)
    sides = [side_of(one.pulled, shift / MIDDLE, 0.0) for one in found]
    assert set(sides) == {-1.0, 1.0}
    if shift:
        assert sides[0] == -1.0
    assert found[1].words == "on the other side of post"


def test_two_posts_make_four_classes_with_the_lengths_of_belts(bare):
    width, height = 0.4, 0.4
    places = {"first": -0.8, "second": 0.8}
    occupancy = with_posts(
        bare, *(post(name, 0.02, along, width, height) for name, along in places.items())
    )
    start, goal = at(0.0, -2.2), at(0.0, 2.2)
    found = find_alternatives(occupancy, start, goal, count=4)
    check_common(occupancy, found)
    middle = 0.02 * MIDDLE
    seen = set()
    for one in found:
        sides = [side_of(one.pulled, 0.02, along) for along in places.values()]
        seen.add(tuple(sides))
        circles = []
        for side, along in zip(sides, places.values(), strict=True):
            edge = middle + side * 0.5 * width
            circles += [
                ((along - 0.5 * height, edge), -side),
                ((along + 0.5 * height, edge), -side),
            ]
        # 1 % for the string, and what the payload's roundness takes.
        assert one.length == pytest.approx(belt_length((-2.2, 0.0), (2.2, 0.0), circles), rel=0.015)
    assert len(seen) == 4
    assert seen >= {(-1.0, -1.0), (1.0, 1.0)}
    assert side_of(found[0].pulled, 0.02, -0.8) == side_of(found[0].pulled, 0.02, 0.8) == -1.0
    assert "on the other side of first and of second" in {one.words for one in found}


@pytest.mark.slow
def test_the_first_is_what_an_ordinary_search_finds(bare):
    rng = np.random.default_rng(5)
    posts = [post(f"post_{n}", a, z, 0.5, 0.5) for n, (a, z) in enumerate([(0.5, 0), (1.4, 0.8)])]
    occupancy = with_posts(bare, *posts)
    for _ in range(3):
        start, goal = at(rng.uniform(-0.5, 0.1), -1.5), at(rng.uniform(1.0, 2.0), 2.0)
        alone = find_path(occupancy, start, goal)
        pulled = pull(occupancy.field, alone.points, ARM)
        shortest = path_length(pulled)
        found = find_alternatives(occupancy, start, goal, count=2)
        check_common(occupancy, found)
        # Of two strings of one class each may be a percent too long.
        assert found[0].length <= 1.01 * shortest


def test_an_obstacle_with_room_above_it_makes_no_class(bare):
    """A box 5 cm high on the payload: 0.43 m remain."""
    low = PlacedShape("low", "", Box(0.1, 0.5, 0.5), RigidTransform([PAYLOAD, 0.0, 0.0]))
    occupancy = with_posts(bare, low)
    assert len(Surface.of(occupancy).pieces) == 1  # what counts turns
    found = find_alternatives(occupancy, at(0.0, -1.4), at(0.0, 1.4), count=2, longest=2.0)
    assert len(found) == 1


def test_a_sector_closed_at_its_sides_has_no_way_around():
    sector = Occupancy.of(
        bare_gap().with_shapes([post("post", 0.0, 0.0, 0.5, 0.6)]),
        grid(-1.0, 1.0, (60, 36, 6)),
        ARM,
    )
    found = find_alternatives(sector, at(0.1, -1.4), at(0.1, 1.4), count=5, longest=9.0)
    check_common(sector, found)
    assert len(found) == 2
    assert found[0].length < found[1].length


def test_words_lose_letters_beside_their_inverses_alone():
    assert reduced([1, 2, -2, 3, -3, -1]) == ()
    assert reduced([1, 2, -1, -2]) == (1, 2, -1, -2)  # around one, then the other: not nothing


def test_in_a_room_a_pillar_and_a_floating_box_are_passed_on_all_their_sides():
    """Lengths of belts around the pillar; around the box, left, right, above and below."""
    room = Grid(lower=[0.0, 0.0, 0.0], upper=[4.0, 3.0, 2.0], shape=(40, 30, 20))
    start, goal = np.array([0.4, 1.5, 1.0]), np.array([3.6, 1.5, 1.0])
    pillar = PlacedShape("pillar", "", Box(0.4, 0.6, 3.0), RigidTransform([2.0, 1.6, 1.0]))
    occupancy = Occupancy.of(SignedDistanceField.of([pillar]), room, ARM)
    found = find_alternatives(occupancy, start, goal, count=4, longest=1.5)
    assert [one.words for one in found] == ["the shortest way", "on the other side of pillar"]
    for one, side in zip(found, (-1, 1), strict=True):
        edge = 0.1 + side * 0.3
        circles = [((-0.2, edge), -side), ((0.2, edge), -side)]
        assert one.length == pytest.approx(belt_length((-1.6, 0.0), (1.6, 0.0), circles), rel=0.01)
    box = PlacedShape("box", "", Box(0.4, 0.6, 0.7), RigidTransform([2.0, 1.52, 1.03]))
    occupancy = Occupancy.of(SignedDistanceField.of([box]), room, ARM)
    found = find_alternatives(occupancy, start, goal, count=5, longest=1.5)
    assert len(found) == 4
    sides = set()
    for one in found:
        middle = np.array([np.interp(2.0, one.pulled[:, 0], one.pulled[:, k]) for k in (1, 2)])
        off = (middle - [1.52, 1.03]) / [0.3, 0.35]
        axis = int(np.argmax(np.abs(off)))
        sides.add((axis, np.sign(off[axis])))
    assert len(sides) == 4


@pytest.mark.slow
def test_in_the_cargo_bay_a_trunnion_is_passed_on_its_other_side():
    """The goal is right behind it, seen from the port."""
    bay = Grid(
        lower=np.array([4.4, -np.pi, 1.5]),
        upper=np.array([14.0, np.pi, 2.28]),
        shape=(96, 128, 8),
        unfolded=True,
        origin=np.array([-1.621, 0.0, 0.0]),
    )
    occupancy = Occupancy.of(read_distance_field(find_scene_file("cargo_bay")), bay, 0.12)
    start, goal = np.array([0.412877, 0.0, 4.9425]), np.array([-1.621, 2.034, 12.2])
    found = find_alternatives(occupancy, start, goal, count=2)
    assert [one.words for one in found] == ["the shortest way", "on the other side of trunnion_1"]
    trunnion = next(s for s in occupancy.field.shapes if s.name == "trunnion_1").X_WG.translation()
    origin = bay.arrays.origin
    middle = math.atan2(trunnion[1], trunnion[0] - origin[0])
    sides = []
    for one in found:
        local = one.pulled - origin
        around = np.unwrap(np.arctan2(local[:, 1], local[:, 0]))
        sides.append(np.sign(np.interp(trunnion[2], local[:, 2], around) - middle))
        pull(occupancy.field, one.pulled, 0.12)  # refuses what is not clear
    assert sides == [-1.0, 1.0]


def test_what_cannot_be_chosen_from_is_refused(bare):
    with pytest.raises(InputError, match=r"number of alternatives = 0; must be 1 or more"):
        find_alternatives(bare, at(0, 0), at(1, 0), count=0)
    with pytest.raises(InputError, match=r"longest alternative = 0.5 of the shortest; must be 1"):
        find_alternatives(bare, at(0, 0), at(1, 0), longest=0.5)
    with pytest.raises(InputError, match=r"goal .* is 0.06 m from payload"):
        find_alternatives(bare, at(0, 0), at(1.0, 0.0, PAYLOAD + 0.06))
    wall = PlacedShape("across", "", Box(9.0, 9.0, 0.2), RigidTransform([0.0, 0.0, 0.5]))
    with pytest.raises(NoPathError, match="in the way: across"):
        find_alternatives(with_posts(bare, wall), at(0, -1.0), at(1.0, 2.0))
