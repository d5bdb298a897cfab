"""Certificates hold the truth between their bounds, and are as tight as they were asked to be."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.twin.certificate import search
from pips_drake.twin.certificate.proof import make_proof
from pips_drake.twin.certificate.search import certify
from pips_drake.twin.certificate.verify import check_proof

TOLERANCE = 1e-4
#: Rounding: distances of metres in double precision, and nnls's own tolerance.
EXACT = 1e-9


def least_sampled(machine, truth, pairs, knots, per_segment, errors=None, rng=None):
    """Least exact distance at samples of a path, m; with random errors if there are any."""
    postures = [
        machine.between(q0, q1, s)
        for q0, q1 in pairwise(knots)
        for s in np.linspace(0.0, 1.0, per_segment + 1)
    ]
    if errors is not None:
        postures = [q + errors * rng.choice([-1.0, 1.0], size=errors.size) for q in postures]
    return machine.least_of(truth, pairs, postures)


def random_path(seed, random_machine, random_walk, count=4):
    rng = np.random.default_rng(seed)
    machine, scene, own = random_machine(rng, moving_obstacle=seed % 3 == 0)
    knots = random_walk(rng, machine, count, [0.05, 0.2, 0.5][seed % 3])
    return machine, scene, own, knots


def check_path(seed, random_machine, random_walk, truth, per_segment):
    machine, scene, own, knots = random_path(seed, random_machine, random_walk)
    for pairs in (scene, own):
        found = certify(machine.problem(pairs, knots), tolerance=TOLERANCE)
        least = least_sampled(machine, truth, pairs, knots, per_segment)
        assert found.lower <= least + EXACT, seed
        assert 0.0 <= found.upper - found.lower <= TOLERANCE, seed
        # The witness: the truth's own distance at its instant is what it says.
        w = found.witness
        q = knots[w.segment]
        if w.fraction > 0.0:
            q = machine.between(q, knots[w.segment + 1], w.fraction)
        there = machine.least(truth, [pairs[w.pair]], q)
        polygons = sum(machine.solids[i].shape.disc for i in pairs[w.pair]) * truth.polygon
        assert there - polygons - 2e-7 <= w.distance <= there + 2e-7, seed
        # On the surfaces, as far apart as it says (in penetration: along the normal).
        apart = np.linalg.norm(w.points[0] - w.points[1])
        assert apart == pytest.approx(abs(w.distance), abs=1e-6), seed
        assert check_proof(make_proof(found)).failures == (), seed


def test_the_truth_is_between_the_bounds(random_machine, random_walk, truth) -> None:
    for seed in range(8):
        check_path(seed, random_machine, random_walk, truth, per_segment=12)


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_the_truth_is_between_the_bounds_on_300_paths_sampled_200_times_denser(
    random_machine, random_walk, truth
) -> None:
    for seed in range(300):
        check_path(seed, random_machine, random_walk, truth, per_segment=200)


def test_a_finer_tolerance_is_reached(random_machine, random_walk) -> None:
    for seed in range(6):
        machine, scene, _, knots = random_path(seed, random_machine, random_walk)
        coarse = certify(machine.problem(scene, knots), tolerance=1e-3)
        fine = certify(machine.problem(scene, knots), tolerance=1e-5)
        assert fine.upper - fine.lower <= 1e-5
        # Both are true.
        assert coarse.lower <= fine.upper and fine.lower <= coarse.upper


def test_a_path_backwards_is_as_clear(random_machine, random_walk) -> None:
    for seed in range(6):
        machine, scene, _, knots = random_path(seed, random_machine, random_walk)
        there = certify(machine.problem(scene, knots), tolerance=TOLERANCE)
        back = certify(machine.problem(scene, knots[::-1]), tolerance=TOLERANCE)
        assert back.lower <= there.upper and there.lower <= back.upper
        assert abs(back.upper - there.upper) <= TOLERANCE


def test_knots_in_between_change_nothing(random_machine, random_walk) -> None:
    for seed in range(6):
        machine, scene, _, knots = random_path(seed, random_machine, random_walk)
        more = [knots[0]]
        for q0, q1 in pairwise(knots):
            more += [machine.between(q0, q1, s) for s in (0.3, 0.5, 1.0)]
        once = certify(machine.problem(scene, knots), tolerance=TOLERANCE)
        again = certify(machine.problem(scene, more), tolerance=TOLERANCE)
        assert again.lower <= once.upper and once.lower <= again.upper
        assert abs(again.upper - once.upper) <= TOLERANCE


def test_a_still_posture_has_its_distance(random_machine, random_walk, truth) -> None:
    machine, scene, _, knots = random_path(4, random_machine, random_walk)
    found = certify(machine.problem(scene, knots[[0, 0]]), tolerance=1e-6)
    least = machine.least(truth, scene, knots[0])
    assert found.lower <= least + EXACT
    assert least - 1e-6 - 1e-4 <= found.upper  # the polygons of cylinders: 0.1 mm and less


@pytest.mark.parametrize("step", [0.0, 1e-16, 1e-12, 1e-8, 1e-5])
def test_rounding_proves_nothing_where_hardly_anything_moves(
    random_machine, random_walk, truth, step
) -> None:
    for seed in range(1, 10):
        machine, scene, own, knots = random_path(seed, random_machine, random_walk)
        rng = np.random.default_rng(seed)
        still = knots[0] + step * rng.normal(size=(4, machine.positions))
        for pairs in (scene, own):
            least = machine.least(truth, pairs, knots[0])
            for errors in (0.0, 1e-4):
                deviation = np.full(machine.positions, errors)
                if seed % 3 == 0:
                    deviation[6:13] = 0.0  # the free body's
                problem = machine.problem(pairs, still, deviation=deviation)
                found = certify(problem, tolerance=TOLERANCE)
                # A few metres of arm that each joint moves.
                assert found.lower <= least + EXACT + 30.0 * step, seed
                assert found.lower >= found.upper - TOLERANCE - 30.0 * errors, seed
                assert check_proof(make_proof(found)).failures == (), seed


def test_a_thin_spike_between_samples_is_found(random_machine, random_walk) -> None:
    """Samples at both knots are clear by 0.19 m; between them the arm goes through a needle."""
    rng = np.random.default_rng(0)
    machine, _, _ = random_machine(rng, joints=1, sliding=0.0)
    parent, kind, _, place, _ = machine.rows[0]
    machine.rows[0] = (parent, kind, np.eye(3), 0.0 * place, np.array([0.0, 0.0, 1.0]))
    arm, spike = machine.solids[:2]
    for solid, points, radius in (
        (arm, [[0.2, 0.0, 0.0], [1.0, 0.0, 0.0]], 0.01),
        (spike, [[0.9, 0.0, 0.0], [2.0, 0.0, 0.0]], 1e-4),
    ):
        points = np.array(points)
        change = {
            "vertices": points,
            "bulge": np.zeros((3, 3)),
            "radius": radius,
            "centre": points.mean(axis=0),
            "axes": np.eye(3),
            "half": np.ptp(points, axis=0) / 2.0,
            "disc": 0.0,
        }
        solid.points, solid.radius = points, radius
        solid.shape = type(solid.shape)(**(solid.shape.__dict__ | change))
    found = certify(machine.problem([(0, 1)], [[-0.2], [0.23]]), tolerance=TOLERANCE)
    assert found.upper == pytest.approx(-0.01 - 1e-4, abs=TOLERANCE)
    assert found.lower <= found.upper <= found.lower + TOLERANCE
    assert found.witness.time == pytest.approx(0.2 / 0.43, abs=1e-3)


def test_joint_errors_are_allowed_for(random_machine, random_walk, truth) -> None:
    worst = 0.0
    for seed in range(6):
        machine, scene, own, knots = random_path(seed, random_machine, random_walk)
        rng = np.random.default_rng(seed)
        errors = np.full(machine.positions, 2e-3)
        if seed % 3 == 0:
            errors[6:13] = 0.0  # the free body's
        for pairs in (scene, own):
            found = certify(machine.problem(pairs, knots, deviation=errors), tolerance=TOLERANCE)
            exact = certify(machine.problem(pairs, knots), tolerance=TOLERANCE)
            least = least_sampled(machine, truth, pairs, knots, 30, errors, rng)
            assert found.lower <= least + EXACT, seed
            assert found.lower <= found.upper <= exact.upper + EXACT
            # The witness's errors are among those that are allowed.
            assert (np.abs(found.witness.deviation) <= errors).all()
            assert check_proof(make_proof(found)).failures == (), seed
            worst = max(worst, exact.upper - found.upper)
    assert worst > 2e-3  # the errors do count


def test_a_search_that_gives_up_still_tells_no_lie(
    random_machine, random_walk, monkeypatch
) -> None:
    monkeypatch.setattr(search, "MOST_QUERIES", 2)
    given_up = 0
    for seed in range(6):
        machine, scene, _, knots = random_path(seed, random_machine, random_walk)
        found = certify(machine.problem(scene, knots), tolerance=1e-6)
        assert found.lower <= found.upper
        assert check_proof(make_proof(found)).failures == (), seed
        given_up += not found.tight
    assert given_up > 0


def test_a_free_body_that_turns_too_far_is_refused(random_machine, random_walk) -> None:
    machine, scene, _, knots = random_path(0, random_machine, random_walk)
    knots[1, 6:10] = [-knots[0, 7], knots[0, 6], -knots[0, 9], knots[0, 8]]  # half a turn
    with pytest.raises(InputError, match=r"turns 3.14 rad between two knots; must be < 3"):
        certify(machine.problem(scene, knots))
