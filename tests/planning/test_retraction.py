"""How far an arm draws back: what slides into what, and that snakes then agree."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from pydrake.geometry import Box, Cylinder, Sphere
from pydrake.math import RigidTransform, RollPitchYaw

from pips_drake.errors import InputError
from pips_drake.planning.grid import Grid
from pips_drake.planning.grid_search import NoPathError, find_path
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.planner import PlannerSettings
from pips_drake.planning.quick_pull import pull_quickly
from pips_drake.planning.retraction import Candidate, candidate_from, neighbours, retraction_point
from pips_drake.planning.sliding import can_slide, equal_shares, path_length, what_they_meet
from pips_drake.planning.snake import make_snake
from pips_drake.planning.snake_motion import settle
from pips_drake.planning.string_pull import pull
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import (
    PlacedShape,
    SignedDistanceField,
    read_distance_field,
)

from .gap import ARM, FACE, PAYLOAD, at, bare_gap, post


def gap_with(*posts, shape=(80, 110, 6)):
    corners = np.array([[-4.0, -np.pi, PAYLOAD], [4.0, np.pi, FACE]])
    grid = Grid(lower=corners[0], upper=corners[1], shape=shape, unfolded=True)
    return Occupancy.of(bare_gap().with_shapes(posts), grid, ARM)


def along_gap(*corners):
    """A path over the surface through (around, along), straight on it between them."""
    q = np.concatenate([np.linspace(a, b, 40) for a, b in pairwise(corners)])
    return np.stack([at(*row) for row in q])


@pytest.fixture(scope="module")
def one_post():
    return gap_with(post("post", 0.0, 0.0, 0.5, 0.6))


def test_paths_on_one_side_of_a_post_slide_and_on_two_do_not(one_post):
    ends = (0.0, -2.0), (0.0, 2.0)
    left, farther = along_gap(ends[0], (0.4, 0.0), ends[1]), along_gap(ends[0], (1.5, 0.3), ends[1])
    right = along_gap(ends[0], (-0.4, 0.0), ends[1])
    assert can_slide(one_post, left, farther)
    assert can_slide(one_post, farther, left)
    met = what_they_meet(one_post, left, right)
    assert met.label == "post"
    assert one_post.field.distances(met.point[None])[0] < 0.0
    assert 0.0 < met.share < 1.0


def test_sliding_around_the_payload_is_not_a_straight_line_through_it(one_post):
    """Half around: in the world the middle would be deep in the payload."""
    a, b = (along_gap((0.8, -1.5), corner, (3.8, 1.5)) for corner in ((3.8, -1.5), (0.8, 1.5)))
    straight = 0.5 * (equal_shares(a, 50) + equal_shares(b, 50))
    assert one_post.field.distances(straight).min() < -0.2
    assert can_slide(one_post, a, b)


def test_angles_are_counted_on_over_the_seam_and_turns_are_told_apart(one_post):
    start, goal = (2.9, -1.0), (3.5, 1.0)
    over = along_gap(start, goal)
    aside = along_gap(start, (3.3, -0.5), goal)
    assert can_slide(one_post, over, aside)
    other_way = along_gap(start, (3.5 - 2.0 * np.pi, 1.0))
    met = what_they_meet(one_post, over, other_way)
    assert met.label == "a turn around the axis"
    assert np.isnan(met.point).all()


@pytest.mark.parametrize("radius", [0.02, 0.005])
def test_nothing_is_too_thin_to_be_met(one_post, radius):
    """A wire across the gap, between paths in cells 0.1 m wide; and none that is not between."""

    def wired(around, along):
        X_WG = RigidTransform(RollPitchYaw(0.0, 0.5 * math.pi, around), at(around, along))
        wire = PlacedShape("wire", "", Cylinder(radius, 0.6), X_WG)
        return one_post.updated(one_post.field.with_shapes([wire]))

    a = along_gap((1.0, -2.0), (1.6, 0.0), (1.0, 2.0))
    b = along_gap((1.0, -2.0), (1.0, 2.0))
    rng = np.random.default_rng(3)
    for _ in range(5):
        around, along = rng.uniform(1.02, 1.2), rng.uniform(-0.3, 0.3)
        met = what_they_meet(wired(around, along), a, b)
        assert met is not None
        assert met.label == "wire"
        assert can_slide(wired(0.9, along), a, b)


def test_in_space_a_box_between_is_met_and_one_beside_is_not():
    box = PlacedShape("box", "", Box(0.4, 0.6, 0.7), RigidTransform([2.0, 1.5, 1.0]))
    grid = Grid(lower=[0.0, 0.0, 0.0], upper=[4.0, 3.0, 2.0], shape=(40, 30, 20))
    room = Occupancy.of(SignedDistanceField.of([box]), grid, ARM)
    ends = np.array([[0.4, 1.5, 1.0], [3.6, 1.5, 1.0]])
    over, under = (np.array([ends[0], [2.0, 1.5, 1.0 + z], ends[1]]) for z in (0.7, -0.7))
    higher = np.array([ends[0], [2.0, 1.2, 1.9], ends[1]])
    assert what_they_meet(room, over, under).label == "box"
    assert can_slide(room, over, higher)


def test_an_arm_is_drawn_back_to_before_the_post_that_stands_between(one_post):
    """Its line goes by the post on the left; the goal is behind it on the right: from the base the
    way goes by on the right, and from far enough out around the post's other end."""

    def passes(path):
        around = np.unwrap(np.arctan2(path[:, 1], path[:, 0]))
        return np.interp(0.0, path[:, 2], around)

    line = along_gap((-0.5, -3.0), (0.3, -0.6), (0.3, 3.0))
    goal = at(-0.5, 0.8)
    found = retraction_point(one_post, line, goal, places=12)
    assert found.stopped_by.label == "post"
    assert 0.0 < found.origin < 0.75 * path_length(line)
    assert found.origin == found.chosen.origin == found.candidates[-2].origin
    assert path_length(found.chosen.line) <= path_length(found.candidates[-2].line)
    pull(one_post.field, found.chosen.path, ARM)  # refuses what is not clear
    assert passes(found.chosen.line) < -0.1
    assert passes(found.candidates[-1].line) > 0.1
    np.testing.assert_allclose(found.chosen.line[[0, -1]], [line[0], goal], rtol=0, atol=1e-12)


def test_ways_of_one_class_slide_past_a_post_that_straight_surfaces_cut(one_post):
    """Both on the post's right, one with a corner below it. A ball between them that leaves room
    above itself keeps them apart: no class knows of it."""
    start, goal = (-0.4, -0.2), (0.3, 0.5)
    near = along_gap(start, (-0.2, 0.1), (-0.3, 0.3), goal)
    far = along_gap(start, (0.3, -1.2), (-0.6, 0.4), goal)
    assert what_they_meet(one_post, near, far).label == "post"
    ball = PlacedShape("ball", "", Sphere(0.04), RigidTransform(at(-0.015, -0.7)))
    with_ball = one_post.updated(one_post.field.with_shapes([ball]))
    found = [
        neighbours(room, far, Candidate(0.0, near, near), Candidate(0.0, far, far))
        for room in (one_post, with_ball)
    ]
    assert found[0].same
    assert found[1].met.label == "ball"


def test_with_nothing_between_it_need_not_be_drawn_back():
    """The snake slides to where it would lie from the base."""
    line = along_gap((0.0, -3.0), (0.8, 0.0), (0.3, 2.0))
    found = retraction_point(gap_with(), line, at(1.2, -1.0))
    assert found.stopped_by is None
    assert found.origin == pytest.approx(path_length(line))
    assert len(found.candidates) == 8


def test_lines_and_goals_of_no_use_are_refused(one_post):
    line = along_gap((0.5, -3.0), (0.5, 2.0))
    with pytest.raises(InputError, match=r"arm's line of shape \(3,\); must be \(N, 3\)"):
        retraction_point(one_post, line[0], at(1.0, 0.0))
    with pytest.raises(InputError, match=r"places on the arm's line = 1; must be 2 or more"):
        retraction_point(one_post, line, at(1.0, 0.0), places=1)
    with pytest.raises(InputError, match=r"goal .* inside post"):
        retraction_point(one_post, line, at(0.0, 0.0))
    with pytest.raises(InputError, match=r"first path of shape \(3,\); must be \(N, 3\)"):
        can_slide(one_post, line[0], line)
    wall = PlacedShape("across", "", Box(9.0, 9.0, 0.2), RigidTransform([0.0, 0.0, 3.0]))
    blocked = one_post.updated(one_post.field.with_shapes([wall]))
    with pytest.raises(NoPathError, match="in the way: across"):
        retraction_point(blocked, line, at(1.0, 3.6))


def test_a_quick_pull_is_as_clear_and_as_tight_as_a_thorough_one(one_post):
    rng = np.random.default_rng(2)
    for _ in range(4):
        around, along = rng.uniform(-1.0, 1.0, 2), rng.uniform(-3.0, 3.0, 2)
        path = find_path(one_post, at(around[0], along[0]), at(around[1], along[1])).points
        quick, thorough = (p(one_post.field, path, ARM) for p in (pull_quickly, pull))
        pull(one_post.field, quick, ARM)  # refuses what is not clear
        # Each may be a percent longer than a taut string.
        assert path_length(quick) <= 1.01 * path_length(thorough)
    with pytest.raises(InputError, match=r"path is not clear"):
        pull_quickly(one_post.field, [at(0.0, -2.0), at(0.0, 2.0)], ARM)


class Pairs:
    """Neighbouring candidates from random lines in gaps with obstacles, and snakes laid on them."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        bay = Grid(
            lower=np.array([4.8, -np.pi, 1.5]),
            upper=np.array([14.0, np.pi, 2.28]),
            shape=(92, 128, 8),
            unfolded=True,
            origin=np.array([-1.621, 0.0, 0.0]),
        )
        field = read_distance_field(find_scene_file("cargo_bay"))
        self.workspaces = [Occupancy.of(field, bay, 0.12)]
        for _ in range(3):
            posts = [
                post(f"post_{n}", *self.rng.uniform([-np.pi, -3, 0.2, 0.2], [np.pi, 3, 0.9, 0.9]))
                for n in range(6)
            ]
            self.workspaces.append(gap_with(*posts))

    def place(self, occupancy):
        grid = occupancy.grid
        while True:
            q = self.rng.uniform(grid.lower, grid.upper)
            q[2] = self.rng.uniform(1.95, 2.1)
            point = grid.to_world(q[None])
            if occupancy.field.distances(point)[0] > 0.2:
                return point[0]

    def of(self, occupancy):
        """All neighbours of eight candidates along one random line to one random goal."""
        while True:
            base, old, goal = (self.place(occupancy) for _ in range(3))
            try:
                path = find_path(occupancy, base, old).points
                line = pull_quickly(occupancy.field, path, occupancy.radius)
                arcs = np.linspace(0.0, path_length(line), 8)
                ways = [candidate_from(occupancy, line, arc, goal) for arc in arcs]
            except (InputError, NoPathError):  # no way, or the line passes where no cell is free
                continue
            return [neighbours(occupancy, line, near, far) for near, far in pairwise(ways)]

    @staticmethod
    def settled(occupancy, path):
        """As the planner does it."""
        settings = PlannerSettings()

        def distances(points):
            return occupancy.field.blended(
                points, blend=settings.blend, within=settings.repulsion.reach
            )

        snake = make_snake(path, settings.snake)
        return settle(snake, distances, settings.repulsion, max_steps=2000).snake.points


@pytest.mark.slow
def test_settled_snakes_agree_where_paths_slide_and_do_not_where_they_do_not(capsys):
    """95 of 100 pairs: half of them predicted to be of one class; of the other half at most 15 go
    round the axis differently, the rest round an obstacle. As many of each as come first."""
    pairs, wanted = Pairs(7), {"same": 50, "turn": 15, "obstacle": 35}
    right = dict.fromkeys(wanted, 0)
    left, turn = dict(wanted), 0
    while any(left.values()):
        occupancy = pairs.workspaces[turn % len(pairs.workspaces)]
        turn += 1
        by_kind = {kind: [] for kind in wanted}
        for pair in pairs.of(occupancy):
            kind = "same" if pair.same else "obstacle"
            if pair.met is not None and pair.met.label.startswith("a turn"):
                kind = "turn"
            by_kind[kind].append(pair)
        for kind, found in by_kind.items():
            if not found or not left[kind]:
                continue
            pair = found[pairs.rng.integers(len(found))]
            left[kind] -= 1
            ends = [pairs.settled(occupancy, p) for p in (pair.path_near, pair.path_far)]
            apart = np.linalg.norm(np.subtract(*(equal_shares(p, 200) for p in ends)), axis=1).max()
            right[kind] += bool((apart <= 0.2) == (kind == "same"))
    with capsys.disabled():
        print("\nretraction:", ", ".join(f"{kind} {right[kind]}/{wanted[kind]}" for kind in wanted))
    assert sum(right.values()) >= 95
    # No kind is right by chance.
    assert all(right[kind] >= 0.85 * wanted[kind] for kind in wanted)
