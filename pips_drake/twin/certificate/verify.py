"""Checks a proof file, without any distance engine and without the code that found it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pips_drake.twin.certificate.problem import Problem
from pips_drake.twin.certificate.proof import Proof, load_proof
from pips_drake.twin.certificate.recheck import proved_lower, proved_upper
from pips_drake.twin.certificate.tree import FIXED, FREE, PRISMATIC, REVOLUTE, Tree

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: A bound may be this much above what is found here, m: rounding differs from code to code. Half of
#: what was taken off every bound for rounding.
ROUNDING = 0.5e-9
MOVING = (REVOLUTE, PRISMATIC, FREE)
#: Unit vectors and rotations may be off by this.
UNIT = 1e-9


@dataclass(frozen=True, kw_only=True)
class GroupReport:
    """What a check found of one group of pairs.

    Attributes:
        lower, upper: claimed, m.
        proved_lower, proved_upper: what the planes and the witness prove, m.
        pair: the witness's bodies.
        time: of the witness, s.
        pairs, planes: how many.
        failures: sentences; empty if and only if the claim is proved.
    """

    lower: float
    upper: float
    proved_lower: float
    proved_upper: float
    pair: tuple[str, str]
    time: float
    pairs: int
    planes: int
    failures: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class ProofReport:
    """What a check of a proof file found, by group."""

    groups: dict[str, GroupReport]

    @property
    def proved(self) -> bool:
        """Whether every claim in the file is proved."""
        return not self.failures

    @property
    def failures(self) -> tuple[str, ...]:
        """Sentences; empty if everything is proved."""
        return tuple(
            f"{name}: {text}" for name, group in self.groups.items() for text in group.failures
        )


def verify_proof(file: Path, problems: dict[str, Problem] | None = None) -> ProofReport:
    """Checks a proof file.

    Args:
        problems: by group, what the proof must be about, as read from a plant
            (`certify.read_problems`); without it, the file's own word for machine, scene and motion
            is taken.

    Raises:
        InputError: not a proof file.
    """
    proofs = load_proof(file)
    groups = {name: check_proof(proof) for name, proof in proofs.items()}
    for name, problem in (problems or {}).items():
        if name in proofs:
            said = _differences(proofs[name].problem, problem)
        else:
            said = ["no proof of this group"]
        if said:
            old = groups.get(name) or _nothing()
            failures = (*old.failures, *said)
            groups[name] = GroupReport(**(old.__dict__ | {"failures": failures}))
    return ProofReport(groups=groups)


def check_proof(proof: Proof) -> GroupReport:
    """Checks one group's claim."""
    problem = proof.problem
    failures = _layout_failures(proof)
    lower, upper, time, pair = -np.inf, np.inf, np.nan, ("", "")
    if not failures:
        failures = _cover_failures(proof)
        lower = proved_lower(proof)
        if not lower >= proof.lower - ROUNDING:
            failures.append(f"planes prove {lower:.9g} m; claimed {proof.lower:.9g} m")
        p, segment, fraction = proof.witness
        upper = proved_upper(proof)
        if not upper <= proof.upper + ROUNDING:
            failures.append(f"witness proves {upper:.9g} m; claimed {proof.upper:.9g} m")
        pair = (problem.bodies[problem.a[p]], problem.bodies[problem.b[p]])
        time = float(problem.times[segment])
        if fraction > 0.0:
            time += fraction * float(problem.times[segment + 1] - problem.times[segment])
    return GroupReport(
        lower=proof.lower,
        upper=proof.upper,
        proved_lower=float(lower),
        proved_upper=float(upper),
        pair=pair,
        time=time,
        pairs=len(problem.a),
        planes=len(proof.pair),
        failures=tuple(failures),
    )


def _nothing() -> GroupReport:
    return GroupReport(
        lower=-np.inf,
        upper=np.inf,
        proved_lower=-np.inf,
        proved_upper=np.inf,
        pair=("", ""),
        time=np.nan,
        pairs=0,
        planes=0,
        failures=(),
    )


def _layout_failures(proof: Proof) -> list[str]:
    """What makes no sense: indices out of range, vectors that are not unit, negative radii."""
    problem = proof.problem
    tree, shapes = problem.tree, problem.shapes
    bodies, count, nq = len(tree.parent), len(shapes.body), problem.knots.shape[1]
    segments, order = len(problem.times) - 1, np.arange(len(tree.parent))
    p, segment, fraction = proof.witness
    pairs = np.concatenate([problem.a, problem.b])
    width = np.where(tree.kind == FREE, 7, 1)
    starts = (tree.start >= 0) & (tree.start + width <= nq)
    indices = {
        "a motion has two knots or more": segments >= 1,
        "there are pairs": len(problem.a) > 0,
        "bodies come after their parents": bodies > 0
        and bool(((tree.parent >= 0) & (tree.parent < np.maximum(order, 1))).all()),
        "joints are of known kinds": bodies > 0
        and bool(tree.kind[0] == FIXED and np.isin(tree.kind[1:], MOVING).all()),
        "positions exist": bool(starts.all()),
        "shapes are on bodies": bool(((shapes.body >= 0) & (shapes.body < bodies)).all()),
        "shapes have vertices": bool(
            shapes.starts[0] == 0
            and shapes.starts[-1] == len(shapes.vertices)
            and (np.diff(shapes.starts) > 0).all()
        ),
        "pairs are of shapes": bool(((pairs >= 0) & (pairs < count)).all()),
        "planes are for parts of the motion": _parts_exist(proof),
        "the witness is on the path": 0 <= p < len(problem.a)
        and 0.0 <= fraction < 1.0
        and (0 <= segment < segments or (segment == segments and fraction == 0.0)),
    }
    failures = [f"not so: {text}" for text, good in indices.items() if not good]
    if failures:
        return failures
    turns = np.concatenate([tree.R_PF, tree.R_MB])
    axes = tree.axis[np.isin(tree.kind, (REVOLUTE, PRISMATIC))]
    free = np.isin(np.arange(nq), _free_positions(tree))
    values = {
        "times go forward": bool((np.diff(problem.times) >= 0.0).all()),
        "each position moves one joint": _positions_once(tree, nq),
        "axes are unit vectors": _are_unit(axes),
        "frames are rotations": bool(
            np.abs(turns @ turns.swapaxes(1, 2) - np.eye(3)).max() < UNIT
            and (np.linalg.det(turns) > 0.0).all()
        ),
        "free bodies have an orientation": all(
            np.linalg.norm(problem.knots[:, i : i + 4], axis=1).min() > 0.5
            for i in tree.start[tree.kind == FREE].tolist()
        ),
        "radii are not negative": bool((shapes.radius >= 0.0).all()),
        "only the second of a pair is a half space": not shapes.half_space[problem.a].any(),
        "deviations are not negative": bool(
            (problem.deviation >= 0.0).all() and not problem.deviation[free].any()
        ),
        "normals are unit vectors": _are_unit(proof.normals),
        "the witness is on its bodies": bool(
            (proof.weights >= 0.0).all()
            and abs(proof.weights.sum() - 1.0) < 1e-12
            and (np.linalg.norm(proof.balls, axis=-1) <= 1.0).all()
            and (np.linalg.norm(proof.hull_balls, axis=-1) <= 1.0).all()
        ),
        "the witness is within the deviation": bool((np.abs(proof.off) <= problem.deviation).all()),
    }
    return [f"not so: {text}" for text, good in values.items() if not good]


def _parts_exist(proof: Proof) -> bool:
    single = proof.last - proof.first == 1
    whole = (proof.start == 0.0) & (proof.end == 1.0)
    inside = (proof.first >= 0) & (proof.last > proof.first)
    inside &= proof.last <= len(proof.problem.times) - 1
    known = (proof.pair >= 0) & (proof.pair < len(proof.problem.a))
    within = (proof.start >= 0.0) & (proof.start < proof.end) & (proof.end <= 1.0)
    parts = whole | (single & ~proof.swept)
    return bool((inside & known & within & parts).all())


def _are_unit(vectors: Array) -> bool:
    return bool((np.abs(np.linalg.norm(vectors, axis=-1) - 1.0) < UNIT).all())


def _free_positions(tree: Tree) -> list[int]:
    return [int(tree.start[b]) + i for b in np.flatnonzero(tree.kind == FREE) for i in range(7)]


def _positions_once(tree: Tree, nq: int) -> bool:
    used = np.zeros(nq, dtype=int)
    for b in range(1, len(tree.parent)):
        first = int(tree.start[b])
        if first < 0:
            return False
        used[first : first + (7 if tree.kind[b] == FREE else 1)] += 1
    return bool((used <= 1).all())


def _cover_failures(proof: Proof) -> list[str]:
    """Pairs and instants without a plane."""
    segments, failures = len(proof.problem.times) - 1, []
    begin, end = proof.first + proof.start, proof.last - 1 + proof.end
    order = np.lexsort((begin, proof.pair))
    pair, begin, end = proof.pair[order], begin[order], end[order]
    for p in range(len(proof.problem.a)):
        low, high = np.searchsorted(pair, [p, p + 1])
        mine, stops = begin[low:high], end[low:high]
        if not len(mine) or mine[0] > 0.0 or stops[-1] < segments or (mine[1:] > stops[:-1]).any():
            failures.append(f"pair {p} has no plane for some instant")
    return failures


def _differences(found: Problem, wanted: Problem) -> list[str]:
    """Where a proof is about something else."""
    said = []
    if set(_keys(wanted)) - set(_keys(found)):
        said.append("some pairs are not in the proof")
    for name, mine, other in (
        ("times", found.times, wanted.times),
        ("positions", found.knots, wanted.knots),
        ("deviation", found.deviation, wanted.deviation),
        *((f"tree ({n})", getattr(found.tree, n), getattr(wanted.tree, n)) for n in Tree._fields),
    ):
        if mine.shape != other.shape or not np.allclose(mine, other, rtol=0.0, atol=1e-9):
            said.append(f"{name} differ from the proof's")
    shapes = {key: row for row, key in enumerate(zip(found.bodies, found.names, strict=True))}
    for row, key in enumerate(zip(wanted.bodies, wanted.names, strict=True)):
        if key in shapes and not _same_shape(found, shapes[key], wanted, row):
            said.append(f"shape {key[1]} of {key[0]} differs from the proof's")
    return said


def _keys(problem: Problem) -> list[tuple[tuple[str, str], tuple[str, str]]]:
    labels = list(zip(problem.bodies, problem.names, strict=True))
    return [(labels[i], labels[j]) for i, j in zip(problem.a, problem.b, strict=True)]


def _same_shape(first: Problem, i: int, second: Problem, j: int) -> bool:
    one, two = first.shapes, second.shapes
    v, w = (
        shapes.vertices[shapes.starts[row] : shapes.starts[row + 1]]
        for shapes, row in ((one, i), (two, j))
    )
    return bool(
        v.shape == w.shape
        and one.body[i] == two.body[j]
        and np.allclose(v, w, rtol=0.0, atol=1e-9)
        and np.allclose(one.bulge[i], two.bulge[j], rtol=0.0, atol=1e-9)
        and np.allclose(one.half_space[i], two.half_space[j], rtol=0.0, atol=1e-9)
        and abs(one.radius[i] - two.radius[j]) <= 1e-9
    )
