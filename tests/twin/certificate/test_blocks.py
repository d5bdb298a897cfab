"""Planes over whole blocks: departures bound what bodies do; nothing false is proved."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pips_drake.twin.certificate import search
from pips_drake.twin.certificate.certify import ClearanceCertificate
from pips_drake.twin.certificate.outline import make_outline
from pips_drake.twin.certificate.proof import load_proof, make_proof, save_proof
from pips_drake.twin.certificate.search import certify
from pips_drake.twin.certificate.sweep import chord_bound, make_sweep
from pips_drake.twin.certificate.verify import check_proof, verify_proof

TOLERANCE = 1e-4
#: Rounding: distances of metres in double precision, and nnls's own tolerance.
EXACT = 1e-9


def smooth_knots(rng, random_walk, machine, count: int) -> np.ndarray:
    """A motion that goes gently from posture to posture of a random walk, (count, nq)."""
    posts = random_walk(rng, machine, 4, 0.4)
    share = np.linspace(0.0, len(posts) - 1.0, count)
    first = np.minimum(share.astype(int), len(posts) - 2)
    ease = share - first
    ease = ease * ease * (3.0 - 2.0 * ease)
    return np.array(
        [machine.between(posts[k], posts[k + 1], s) for k, s in zip(first, ease, strict=True)]
    )


def random_problem(seed, random_machine, random_walk, count=70):
    rng = np.random.default_rng(seed)
    machine, scene, own = random_machine(rng, moving_obstacle=seed % 3 == 0)
    return machine, scene + own, smooth_knots(rng, random_walk, machine, count)


def without_blocks(problem, sweep, distances, aim):
    """What `cover_blocks` does for none of the pairs: spans of 64 segments are left to search."""
    planes, _ = BLOCKS(problem, sweep, distances, aim)
    none = {
        field.name: getattr(planes, field.name)[:0] for field in dataclasses.fields(type(planes))
    }
    segments, pairs = len(problem.knots) - 1, len(problem.a)
    first = np.arange(0, segments, 64)
    spans = np.repeat(np.arange(pairs), len(first)), np.tile(first, pairs)
    return type(planes)(**none), (*spans, np.minimum(spans[1] + 64, segments))


BLOCKS = search.cover_blocks


def test_bodies_stay_as_near_to_their_chords_as_departures_say(random_machine, random_walk) -> None:
    tightest = np.inf
    for seed in range(3):
        machine, _, knots = random_problem(seed, random_machine, random_walk, count=38)
        problem = machine.problem([(0, 1)], knots)
        sweep = make_sweep(problem.tree, problem.knots)
        outline = make_outline(problem.tree, problem.shapes, knots, problem.deviation)
        segments = len(knots) - 1
        s = np.arange(0.0, 3.0 * segments + 1) / 3.0
        poses = [
            machine.poses(machine.between(knots[k], knots[k + 1], at - k))
            for at, k in zip(s, np.minimum(s.astype(int), segments - 1), strict=True)
        ]
        for which, solid in enumerate(machine.solids):
            way = np.array(
                [solid.points[::12] @ at[solid.body][0].T + at[solid.body][1] for at in poses]
            )
            for level, start in enumerate(sweep.starts):
                for block in range(-(-segments // 2**level)):
                    first, last = block << level, min((block + 1) << level, segments)
                    share = np.linspace(0.0, 1.0, 3 * (last - first) + 1)[:, None, None]
                    mine = way[3 * first : 3 * last + 1]
                    off = mine - (1.0 - share) * mine[0] - share * mine[-1]
                    bound = sweep.at_origin[start + block, solid.body]
                    bound += sweep.by_reach[start + block, solid.body] * outline.reach[which]
                    found = np.linalg.norm(off, axis=-1).max()
                    assert found <= bound + 1e-12, (seed, which, level, block)
                    if level >= 3 and found > 1e-3:
                        tightest = min(tightest, bound / found)
    # Not by being large: halves of halves overrate a bend by a third, and turns by more.
    assert tightest < 2.0


def test_no_plane_over_a_block_gives_a_bound_above_the_distance(
    random_machine, random_walk, truth
) -> None:
    best, rng = -np.inf, np.random.default_rng(0)
    work = np.empty((3, 4, 3))
    for seed in range(8):
        machine, pairs, knots = random_problem(seed, random_machine, random_walk, count=17)
        problem = machine.problem(pairs, knots)
        sweep = make_sweep(problem.tree, problem.knots)
        outline = make_outline(problem.tree, problem.shapes, knots, problem.deviation)
        for p in rng.choice(len(pairs), 3, replace=False):
            a, b = pairs[p]
            i, j = (machine.solids[shape].body for shape in (a, b))
            level, block = 3, int(rng.integers(2))
            first, last = block << level, (block + 1) << level
            row = sweep.starts[level] + block
            away = sum(
                sweep.at_origin[row, body] + sweep.by_reach[row, body] * outline.reach[shape]
                + problem.shapes.radius[shape]
                for body, shape in ((i, a), (j, b))
            )  # fmt: skip
            postures = [
                machine.between(knots[k], knots[k + 1], s)
                for k in range(first, last)
                for s in (0.0, 0.5, 1.0)
            ]
            least = machine.least_of(truth, [pairs[p]], postures)
            for _ in range(30):
                n0 = rng.normal(size=3)
                n1 = n0 + 0.3 * rng.normal(size=3)
                normals = n0 / np.linalg.norm(n0), n1 / np.linalg.norm(n1)
                found = chord_bound(
                    problem.shapes, sweep.poses, a, b, first, last, *normals, away, work
                )[0]
                assert found <= least, (seed, p)
                best = max(best, found)
    assert best > 0.0  # not by being useless


def check_agreement(seeds, random_machine, random_walk, truth, monkeypatch, step) -> int:
    """Certificates with blocks and without, against samples; how many planes were swept."""
    swept = 0
    for seed in seeds:
        machine, pairs, knots = random_problem(seed, random_machine, random_walk)
        for errors in (0.0, 3e-4):
            deviation = np.full(machine.positions, errors)
            if seed % 3 == 0:
                deviation[6:13] = 0.0  # the free body's
            problem = machine.problem(pairs, knots, deviation=deviation)
            with monkeypatch.context() as patch:
                patch.setattr(search, "cover_blocks", without_blocks)
                slow = certify(problem, tolerance=TOLERANCE)
            fast = certify(problem, tolerance=TOLERANCE)
            assert not slow.planes.swept.any()
            swept += int(fast.planes.swept.sum())
            # Of errors the remainder of second order is left over: section 5.
            loose = TOLERANCE + (3e-3 if errors else 0.0)
            assert abs(fast.lower - slow.lower) <= loose, seed
            assert abs(fast.upper - slow.upper) <= loose, seed
            least = machine.least_of(truth, pairs, knots[::step])
            assert fast.lower <= least + EXACT, seed
            assert check_proof(make_proof(fast)).failures == (), seed
    return swept


def test_blocks_prove_what_a_search_without_them_does(
    random_machine, random_walk, truth, monkeypatch
) -> None:
    assert check_agreement(range(3), random_machine, random_walk, truth, monkeypatch, 5) > 100


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_blocks_prove_what_a_search_without_them_does_on_40_motions(
    random_machine, random_walk, truth, monkeypatch
) -> None:
    assert check_agreement(range(40), random_machine, random_walk, truth, monkeypatch, 1) > 1000


def test_enough_is_proved_and_no_more_is_looked_for(random_machine, random_walk) -> None:
    fewer = 0
    for seed in range(4):
        machine, pairs, knots = random_problem(seed, random_machine, random_walk)
        problem = machine.problem(pairs, knots)
        whole = certify(problem, tolerance=TOLERANCE)
        enough = whole.lower - 0.05
        found = certify(problem, tolerance=TOLERANCE, enough=enough)
        assert enough <= found.lower <= whole.upper
        assert check_proof(make_proof(found)).failures == ()
        fewer += len(whole.planes.pair) - len(found.planes.pair)
        # Where it is not so, the bounds are as near as ever.
        tight = certify(problem, tolerance=TOLERANCE, enough=whole.upper + 1.0)
        assert tight.upper - tight.lower <= TOLERANCE
    assert fewer > 0


@pytest.fixture(scope="module")
def certificate(random_machine, random_walk):
    machine, pairs, knots = random_problem(3, random_machine, random_walk)
    return certify(machine.problem(pairs, knots), tolerance=TOLERANCE)


def changed(proof, w: int, **values):
    """A proof with another value at its plane w."""
    columns = {name: getattr(proof, name).copy() for name in values}
    for name, value in values.items():
        columns[name][w] = value
    return dataclasses.replace(proof, **columns)


def test_a_swept_plane_that_is_moved_shortened_or_gone_is_caught(certificate) -> None:
    proof = make_proof(certificate)
    assert check_proof(proof).failures == ()
    rows = np.flatnonzero(proof.swept & (proof.last - proof.first > 2))
    assert len(rows) > 20
    pairs = len(proof.problem.a)
    for w in rows[:: len(rows) // 10]:
        missing = f"pair {proof.pair[w]} has no plane for some instant"
        assert missing in check_proof(changed(proof, w, last=proof.last[w] - 1)).failures
        assert missing in check_proof(changed(proof, w, pair=(proof.pair[w] + 1) % pairs)).failures
        turned = check_proof(changed(proof, w, normals=-proof.normals[w]))
        assert turned.failures and turned.proved_lower < proof.lower
        assert (
            "not so: planes are for parts of the motion"
            in check_proof(changed(proof, w, end=0.5)).failures
        )
    # The whole motion with the plane of a part of it; and a plane of b's frame taken for one of
    # the world's.
    segments = len(proof.problem.knots) - 1
    short = rows[2 * (proof.last - proof.first)[rows] < segments]
    tight = short[np.argmin(certificate.planes.bounds[short])]
    assert check_proof(changed(proof, tight, first=0, last=segments)).failures
    moving = proof.problem.shapes.body[proof.problem.b[proof.pair]] > 0
    for w in rows[moving[rows]][:5]:
        assert check_proof(changed(proof, w, swept=False)).failures


def test_another_motion_inside_a_block_is_caught(certificate) -> None:
    # Only a knot in a block's middle is another: both of its ends are as they were.
    proof = make_proof(certificate)
    w = certificate.witness
    knots = proof.problem.knots.copy()
    caught = 0
    for joint in range(6):
        for step in (-0.02, 0.02):
            other = knots.copy()
            other[w.segment, joint] += step
            problem = dataclasses.replace(proof.problem, knots=other)
            caught += bool(check_proof(dataclasses.replace(proof, problem=problem)).failures)
    assert caught >= 6


def test_a_file_of_the_first_version_is_still_read(
    tmp_path: Path, random_machine, random_walk, monkeypatch
) -> None:
    monkeypatch.setattr(search, "cover_blocks", without_blocks)
    machine, pairs, knots = random_problem(1, random_machine, random_walk)
    found = certify(machine.problem(pairs, knots), tolerance=TOLERANCE)
    file = tmp_path / "proof.npz"
    save_proof(file, ClearanceCertificate(scene=found, own=None))
    with np.load(file) as packed:
        arrays = {name: packed[name] for name in packed.files if "swept" not in name}
    np.savez(file, **(arrays | {"version": np.array(1)}))
    assert not load_proof(file)["scene"].swept.any()
    assert verify_proof(file).failures == ()
