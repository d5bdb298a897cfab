"""The solver's converged answers are those of an algorithm that shares nothing with it."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from pips_drake.scene.packages import find_path_file
from pips_drake.serpentine.follow_the_leader import FollowTheLeader, Solution
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.solver import CONVERGED
from pips_drake.serpentine.tip_path import PathBuilder, TipPath, polyline_path

from .random_paths import KINDS, bent_path, random_bends
from .torus_oracle import Chain, March, Path, Piece, march, piece_crossings, solve

INCH = 0.0254
TABLES = ["trajectory_1", "trajectory_2", "trajectory_3", "trajectory_4"]
ARCS = ["trajectory_1_arcs", "trajectory_4_arcs"]
#: The issue's: rad and m. The solver leaves 1e-9 in, which over modules of 0.3 m is 1e-10 rad.
AGREEMENT = 1e-8

#: Arms for the random paths: the prototype for every other, else these in turn.
VARIANTS = [
    dict(mirrored=True),
    dict(base="gimbal"),
    dict(lengths=[20.0, 18.0], offsets=[1.0]),
    dict(lengths=[13.0] * 12, offsets=[1.0] * 12),
    dict(lengths=[15.0] * 8, offsets=[0.0] * 8),
    dict(lengths=[22.0, 14.0, 18.0, 10.0], offsets=[3.0, 0.0, 2.0], base="gimbal", mirrored=True),
]


@pytest.fixture(scope="module")
def prototype(table_a1) -> Chain:
    """FTL-95 Table A.1 as printed, with home from Table A.2 and Figure 2.1."""
    rows = np.column_stack([np.nan_to_num(table_a1), np.isnan(table_a1[:, 2])])
    home = np.zeros(18)
    home[:2] = 24.9 * INCH, -math.pi / 2
    return Chain(rows, home)


@pytest.fixture(scope="module")
def random_case(arm, arm_variant):
    """The arm and path of a number: the same in every run."""

    def make(number: int):
        rng = np.random.default_rng([1995, number])
        used = arm if number % 2 == 0 else arm_variant(**VARIANTS[number // 2 % len(VARIANTS)])
        # Up to 1.1: the base leaves the base line, so that its inverse is tried off it too.
        reach = float(rng.uniform(0.3, 1.1))
        path = bent_path(used, random_bends(rng), reach=reach, kind=KINDS[number % len(KINDS)])
        return used, path

    return make


def oracle_path(path: TipPath, *, mirrored: bool = False) -> Path:
    """The path's numbers; for a mirrored arm the drawn hand on the mirrored path."""
    table = path.pieces.copy()
    if mirrored:
        table[:, [4, 7, 10]] *= -1.0
    return Path.of_table(table)


def shipped(name: str) -> Path:
    """A shipped path; a table is read here, point by point."""
    if name in ARCS:
        return oracle_path(load_path(name))
    lines = find_path_file(name).read_text().splitlines()
    rows = [line for line in lines if not line.startswith("#")][1:]
    return Path.through(INCH * np.array([list(map(float, row.split(","))) for row in rows]))


def assert_agrees(solution: Solution, marches: list[March]) -> None:
    assert np.all(solution.status == CONVERGED)
    for i, found in enumerate(marches):
        # One exit each: which one is right is no question.
        assert np.all(found.exits == 1)
        np.testing.assert_allclose(solution.joints[i], found.joints, rtol=0, atol=AGREEMENT)
        np.testing.assert_allclose(
            solution.spine_arc_lengths[i], found.arc_lengths, rtol=0, atol=AGREEMENT
        )


# The oracle itself


def test_a_march_puts_the_chain_on_the_path(prototype):
    """Products of FTL-95's matrices with the angles found give the points that were aimed at."""
    path = shipped("trajectory_4_arcs")
    for s4 in (1.5, 2.2, 2.9):
        found = march(prototype, path, s4)
        wanted = [path.point(s) for s in found.arc_lengths]
        # A crossing that rounding puts off a piece is moved onto it by up to 1e-12 m.
        np.testing.assert_allclose(prototype.spine_points(found.joints), wanted, rtol=0, atol=3e-12)
        assert np.all(np.diff(found.arc_lengths) > 0.2)


@pytest.mark.parametrize("radius", [0.0, 0.35, 0.8])
@pytest.mark.parametrize("offset", [0.0, 0.001, 0.2, 0.45])
def test_torus_crossings_are_where_a_fine_search_finds_them(radius, offset):
    """Lines and arcs anyhow through a torus: every crossing of the outer sheet, and none else."""
    rng = np.random.default_rng(4)
    length, fine, counts = 0.5, 1e-3, []
    for _ in range(40):
        u, v, axis = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        axis = axis + rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        start = rng.uniform(-0.5, 0.5, 3) - (0.0 if radius else 1.2) * u
        piece = Piece(0.0, 2.0, radius, start, u, v)

        def outside(t: np.ndarray, piece: Piece = piece, axis: np.ndarray = axis) -> np.ndarray:
            p = np.array([piece.point(x) for x in t]).reshape(-1, 3)
            rho = np.linalg.norm(np.cross(p, axis), axis=1)
            return np.hypot(rho - offset, p @ axis) - length

        t = np.arange(0.0, 2.0, fine)
        changes = np.flatnonzero(np.diff(np.sign(outside(t))))
        found = piece_crossings(piece, 0.0, np.zeros(3), axis, offset, length)
        assert len(found) == len(changes)
        np.testing.assert_allclose(found, t[changes] + 0.5 * fine, rtol=0, atol=0.51 * fine)
        # Newton's last step: rounding of numbers near 1.
        assert np.max(np.abs(outside(np.array(found))), initial=0.0) < 1e-14
        counts.append(len(changes))
    assert {0, 1, 2} <= set(counts)


# The four trajectories, and random ones


@pytest.mark.parametrize("name", TABLES + ARCS)
def test_the_solver_agrees_with_the_oracle_on_the_reports_trajectories(arm, prototype, name):
    path, own = load_path(name), shipped(name)
    tips = path.marks if name in TABLES else path.samples(7.0 * INCH)
    assert_agrees(FollowTheLeader(arm).solve(path, tips), [solve(prototype, own, s) for s in tips])


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES + ARCS)
def test_the_solver_agrees_with_the_oracle_between_the_points_too(arm, prototype, name):
    path, own = load_path(name), shipped(name)
    tips = path.samples(0.5 * INCH)
    assert_agrees(FollowTheLeader(arm).solve(path, tips), [solve(prototype, own, s) for s in tips])


@pytest.mark.parametrize("radius", [0.75, 30.0, 1.5e3, 1e5])
def test_the_solver_agrees_with_the_oracle_on_arcs_that_are_all_but_straight(
    arm, prototype, radius
):
    """Blending a table whose rows are rounded to 0.001 in makes arcs of kilometres."""
    builder = PathBuilder(start=[16.255 * INCH, 0.0, 0.0], direction=[0.0, 0.0, 1.0])
    builder.line(174.902 * INCH)
    for toward in (1.0, -1.0):
        builder.arc(radius=radius, angle=0.6 / radius, toward=[toward, 0.6, 0.0])
    path = builder.build("nearly straight")
    tips = path.samples(0.2)
    found = [solve(prototype, oracle_path(path), s) for s in tips]
    assert_agrees(FollowTheLeader(arm).solve(path, tips), found)


def agrees_on_random_path(case, number: int, tips: int) -> None:
    arm, path = case(number)
    chain, own = Chain(arm.dh_table, arm.joint_home), oracle_path(path, mirrored=arm.mirrored)
    # The end, where the path has bent most, and others.
    s = np.linspace(path.length, path.home_arc_length, tips, endpoint=False)
    solution = FollowTheLeader(arm).solve(path, s)
    assert_agrees(solution, [solve(chain, own, x) for x in s])


@pytest.mark.parametrize("number", range(50))
def test_the_solver_agrees_with_the_oracle_on_random_paths(random_case, number):
    agrees_on_random_path(random_case, number, 2)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(300))
def test_the_solver_agrees_with_the_oracle_on_many_random_paths(random_case, number):
    agrees_on_random_path(random_case, number, 12)


# What must not change the converged answer


@pytest.fixture(scope="module")
def invariant_cases(arm, random_case):
    """The reports' trajectories, tables and arcs, and twelve random paths; tips 4 in apart."""
    cases = [(arm, load_path(name)) for name in TABLES + ARCS]
    cases += [random_case(number) for number in range(12)]
    return [(FollowTheLeader(used), path, path.samples(4.0 * INCH)) for used, path in cases]


def split(path: TipPath, rng: np.random.Generator) -> TipPath:
    """The same path with every line and arc cut at two random places, or at the same one twice
    but for a micrometre."""
    rows = []
    for row in path.pieces:
        length, radius = row[1], row[2]
        first = rng.uniform(0.01, 0.98) * length
        second = first + (1e-6 if rng.uniform() < 0.3 else rng.uniform(0.1, 0.9)) * (length - first)
        cuts = [0.0, first, second, length]
        for low, high in itertools.pairwise(cuts):
            part = row.copy()
            part[0], part[1] = row[0] + low, high - low
            if radius:
                c, s = math.cos(low / radius), math.sin(low / radius)
                part[6:9], part[9:12] = c * row[6:9] + s * row[9:12], c * row[9:12] - s * row[6:9]
            else:
                part[3:6] = row[3:6] + low * row[6:9]
            rows.append(part)
    return TipPath(
        name="split", pieces=np.array(rows), home_arc_length=path.home_arc_length, marks=path.marks
    )


def test_splitting_segments_changes_nothing(invariant_cases):
    rng = np.random.default_rng(11)
    for solver, path, tips in invariant_cases:
        whole = solver.solve(path, tips)
        parts = solver.solve(split(path, rng), tips)
        assert np.all(whole.solved)
        assert np.all(parts.solved)
        np.testing.assert_allclose(parts.joints, whole.joints, rtol=0, atol=AGREEMENT)


def test_inserting_points_into_the_tables_changes_nothing(arm):
    """Through the door that a user takes: a table with more rows on the same lines."""
    solver, rng = FollowTheLeader(arm), np.random.default_rng(12)
    for name in TABLES:
        path = load_path(name)
        points = np.vstack([path.point(0.0), path.point(path.marks)])
        rows = [points[:1]]
        for a, b in itertools.pairwise(points):
            # A micrometre apart at least: nearer, a table's points are refused as repeated.
            fractions = np.sort(rng.uniform(0.001, 0.999, 5)) * [0.999, 1, 1, 1, 1]
            rows.append(a + np.append(fractions, 1.0)[:, None] * (b - a))
        more = polyline_path(np.vstack([*rows[:1], points[1:2], *rows[2:]]), "more")
        tips = path.samples(4.0 * INCH)
        found, expected = solver.solve(more, tips), solver.solve(path, tips)
        assert np.all(found.solved)
        np.testing.assert_allclose(found.joints, expected.joints, rtol=0, atol=AGREEMENT)


def test_the_order_of_the_tips_changes_nothing(invariant_cases):
    rng = np.random.default_rng(13)
    for solver, path, tips in invariant_cases:
        out = solver.solve(path, tips)
        for order in (np.arange(len(tips))[::-1], rng.permutation(len(tips))):
            again = solver.solve(path, tips[order])
            assert np.all(again.solved)
            np.testing.assert_allclose(again.joints, out.joints[order], rtol=0, atol=AGREEMENT)


def test_cold_or_warm_start_changes_nothing(invariant_cases):
    """Started from the shortest and longest modules there are, from the next tip's and the first
    tip's lengths, and from lengths up to a tenth too short."""
    rng = np.random.default_rng(14)
    for solver, path, tips in invariant_cases:
        cold = solver.solve(path, tips)
        chain = solver.arm.chain
        for i, tip in enumerate(tips):
            starts = [
                np.abs(chain[:, 1] - chain[:, 0]),
                chain.sum(axis=1),
                cold.module_lengths[(i + 1) % len(tips)],
                cold.module_lengths[0],
                solver.initial_module_lengths * rng.uniform(0.9, 1.0, len(chain)),
            ]
            for start in starts:
                warm = solver.solve(path, [tip], module_lengths=start)
                assert warm.status[0] == CONVERGED
                assert warm.spine_error[0] <= solver.tolerance
                np.testing.assert_allclose(warm.joints[0], cold.joints[i], rtol=0, atol=AGREEMENT)
