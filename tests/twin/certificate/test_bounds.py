"""The motion bound and the planes, against true displacements and exact distances."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.twin.certificate.bound import bend_of, fixed_bound, turning_bound
from pips_drake.twin.certificate.problem import Prepared
from pips_drake.twin.certificate.tree import REVOLUTE, calc_poses, interpolate

SAMPLES = np.linspace(0.0, 1.0, 25)


def chord_departure(postures, machine, pair) -> float:
    """Largest |p(s) - chord| over s (1 - s) / 2 of a's points as b sees them, m."""
    a, b = (machine.solids[i] for i in pair)
    points = a.points[:: 1 + len(a.points) // 32]  # of a cylinder's circles some will do
    moved = []
    for poses in postures:
        (R_a, p_a), (R_b, p_b) = poses[a.body], poses[b.body]
        moved.append((points @ R_a.T + p_a - p_b) @ R_b)
    s, moved = SAMPLES[1:-1, None, None], np.array(moved)
    away = np.linalg.norm(moved[1:-1] - (1.0 - s) * moved[0] - s * moved[-1], axis=-1)
    return float((away / (0.5 * s[..., 0] * (1.0 - s[..., 0]))).max())


def test_points_stay_as_near_to_their_chords_as_the_motion_bound_says(
    random_machine, random_walk
) -> None:
    nearest = 0.0
    for seed in range(18):
        rng = np.random.default_rng(seed)
        machine, scene, own = random_machine(rng, moving_obstacle=seed % 2 == 0)
        knots = random_walk(rng, machine, 3, [0.02, 0.2, 0.8][seed % 3])
        prepared = Prepared(machine.problem(scene + own, knots))
        for segment in range(2):
            ends = knots[segment], knots[segment + 1]
            postures = [machine.poses(machine.between(*ends, s)) for s in SAMPLES]
            for p, pair in enumerate(scene + own):
                bound = bend_of.py_func(prepared.pairs, prepared.motion, p, segment)
                found = chord_departure(postures, machine, pair)
                # Rounding of metres, divided by s (1 - s) / 2 >= 0.02.
                assert found <= bound + 1e-12, (seed, pair, segment)
                nearest = max(nearest, found / max(bound, 1e-12))
    # Not by being large: somewhere the bound is nearly reached, so half of it would be wrong.
    assert nearest > 0.9


def test_the_motion_bound_of_one_hinge_is_its_centripetal_acceleration(
    random_machine, random_walk
) -> None:
    rng = np.random.default_rng(5)
    machine, scene, _ = random_machine(rng, joints=1, sliding=0.0)
    problem = machine.problem(scene, random_walk(rng, machine, 2, 0.3))
    prepared = Prepared(problem)
    turn = abs(problem.knots[1, 0] - problem.knots[0, 0])
    reach = np.linalg.norm(machine.solids[0].points, axis=1).max()
    bend = bend_of.py_func(prepared.pairs, prepared.motion, 0, 0)
    assert machine.rows[0][1] == REVOLUTE
    # |p''| = theta'^2 r; the reach of a cylinder is that of a box around it, so not less.
    assert turn**2 * reach <= bend * (1.0 + 1e-12) <= 1.5 * turn**2 * reach


def test_bends_that_cancel_are_seen(random_machine) -> None:
    # Two parallel hinges that turn against each other: the second link does not turn.
    rng = np.random.default_rng(1)
    machine, scene, _ = random_machine(rng, joints=2, sliding=0.0)
    for row in range(2):
        parent, kind, _, place, _ = machine.rows[row]
        machine.rows[row] = (parent, kind, np.eye(3), place, np.array([0.0, 1.0, 0.0]))
    pair = [next(pair for pair in scene if pair[0] == 1)]
    turn = 0.05
    against = Prepared(machine.problem(pair, [[0.1, 0.2], [0.1 + turn, 0.2 - turn]]))
    along = Prepared(machine.problem(pair, [[0.1, 0.2], [0.1 + turn, 0.2 + turn]]))
    # What is left per metre of reach is the angular acceleration, second order in the turn.
    assert against.motion.by_reach[0, 0] <= 2.0 * turn**2
    assert along.motion.by_reach[0, 0] >= 4.0 * turn**2 * (1.0 - 1e-9)


def unit(rng) -> np.ndarray:
    n = rng.normal(size=3)
    return n / np.linalg.norm(n)


def test_no_normal_gives_a_bound_above_the_distance(random_machine, random_walk, truth) -> None:
    best, checked = -np.inf, 0
    for seed in range(16):
        rng = np.random.default_rng(seed)
        machine, scene, own = random_machine(rng, moving_obstacle=seed % 3 == 0)
        pairs = scene + own
        knots = random_walk(rng, machine, 3, [0.05, 0.3, 1.0][seed % 3])
        problem = machine.problem(pairs, knots)
        prepared = Prepared(problem)
        p = int(rng.integers(len(pairs)))
        start, end = sorted(rng.uniform(size=2))
        between = [machine.between(knots[0], knots[1], s) for s in np.linspace(start, end, 5)]
        least = min(machine.least(truth, [pairs[p]], q) for q in between)
        over = min(
            machine.least(truth, [pairs[p]], machine.between(knots[k], knots[k + 1], s))
            for k in range(2)
            for s in np.linspace(0.0, 1.0, 5)
        )
        poses = calc_poses(
            problem.tree,
            np.array([interpolate(problem.tree, knots[0], knots[1], s) for s in (start, end)]),
        )
        tree_of = (problem.shapes, prepared.pairs)
        for _ in range(20):
            n0, n1 = unit(rng), unit(rng)
            n1 = n1 if rng.random() < 0.5 else n0 + 0.2 * n1
            n1 /= np.linalg.norm(n1)
            found = turning_bound(*tree_of, poses, prepared.motion, p, 0, 1, n0, n1, 0, end - start)
            assert found <= least, (seed, p)
            still = fixed_bound(*tree_of, prepared.poses, prepared.motion, p, 0, 2, n0, -np.inf)
            assert still <= over, (seed, p)
            best, checked = max(best, found), checked + 1
    assert checked == 320
    assert best > 0.0  # not by being useless


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_half_of_the_motion_bound_proves_what_is_false(random_machine, share) -> None:
    # A point on a long hinge grazes a plane in the middle of a segment: the chord stays clear of
    # it, the arc does not. With all of M the bound holds, with half of it it does not.
    rng = np.random.default_rng(0)
    machine, _, _ = random_machine(rng, joints=1, sliding=0.0)
    parent, kind, _, place, _ = machine.rows[0]
    machine.rows[0] = (parent, kind, np.eye(3), 0.0 * place, np.array([0.0, 1.0, 0.0]))
    for which, height in ((0, 1.0), (1, 1.5)):
        solid = machine.solids[which]
        point = np.array([[0.0, 0.0, height]])
        solid.points, solid.radius = point, 0.1
        shape = {"vertices": point, "bulge": np.zeros((3, 3)), "radius": 0.1, "centre": point[0]}
        solid.shape = type(solid.shape)(**(solid.shape.__dict__ | shape))
    turn = 0.2
    problem = machine.problem([(0, 1)], [[-turn], [turn]])
    prepared = Prepared(problem)
    motion = prepared.motion._replace(
        at_origin=share * prepared.motion.at_origin, by_reach=share * prepared.motion.by_reach
    )
    n = np.array([0.0, 0.0, -1.0])
    found = turning_bound(
        problem.shapes, prepared.pairs, prepared.poses, motion, 0, 0, 1, n, n, 0, 1.0
    )
    true = 0.5 - 0.2  # in the middle, where the hinge is upright
    assert (found <= true) == (share == 1.0)
    # Loose by the fourth order of the turn alone: cos(turn) against 1 - turn^2 / 2.
    if share == 1.0:
        assert true - found < turn**4
