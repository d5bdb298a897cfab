"""Any arm on any path it can follow: what must hold of every solution, by independent formulas.

The paths are followable because of how they are made (`random_paths`), so that no draw is thrown
away; and the arms' kinematics is the oracle's product of matrices.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from pips_drake.errors import InputError
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.follow_the_leader import FollowTheLeader, Solution
from pips_drake.serpentine.plan import make_plan
from pips_drake.serpentine.solver import CONVERGED, NOT_CONVERGED
from pips_drake.serpentine.tip_path import TipPath, polyline_path

from .random_paths import KINDS, Bend, bent_path, home_spine
from .torus_oracle import Chain, Path

INCH = 0.0254
#: A few hundred spine points a draw; more draws in the slow run.
FAST, DEEP = settings(max_examples=60), settings(max_examples=1000)


@st.composite
def arm_options(draw: st.DrawFn) -> dict:
    """What `arm_variant` needs: one to eleven modules, offsets from zero up to a fifth."""
    modules = draw(st.integers(1, 11))
    # Below a thousandth of an inch an offset is zero: no hinge is made that way.
    offsets = st.one_of(st.just(0.0), st.floats(0.001, 2.0))
    return dict(
        lengths=draw(st.lists(st.floats(9.0, 22.0), min_size=modules + 1, max_size=modules + 1)),
        offsets=draw(st.lists(offsets, min_size=modules, max_size=modules)),
        base=draw(st.sampled_from(["rail_crane", "gimbal"])),
        mirrored=draw(st.booleans()),
        limit_deg=draw(st.floats(15.0, 45.0)),
    )


BENDS = st.lists(
    st.builds(
        Bend,
        straight=st.floats(0.0, 0.5),
        wideness=st.floats(1.0, 4.0),
        angle=st.floats(0.05, 2.0),
        side=st.floats(-math.pi, math.pi),
    ),
    min_size=1,
    max_size=4,
)
REACH = st.floats(0.2, 1.0)
KIND = st.sampled_from(KINDS)


class Case:
    """An arm and a path that it can follow, solved."""

    def __init__(self, arm_variant, options, bends, reach, kind) -> None:
        self.arm: SerpentineArm = arm_variant(**options)
        self.path: TipPath = bent_path(self.arm, bends, reach=reach, kind=kind)
        self.solver = FollowTheLeader(self.arm)
        self.tips = np.linspace(self.path.home_arc_length, self.path.length, 7)
        self.solution: Solution = self.solver.solve(self.path, self.tips)
        self.drawn = Path.of_table(self.path.pieces)

    def reached(self) -> np.ndarray:
        """Spine points (N, M + 1, 3) m of the solution, by products of FTL-95's matrices."""
        return forward(self.arm, self.solution.joints)


def forward(arm: SerpentineArm, joints: np.ndarray) -> np.ndarray:
    chain = Chain(arm.dh_table, arm.joint_home)
    hand = [1.0, -1.0 if arm.mirrored else 1.0, 1.0]
    points = np.array([chain.spine_points(q) for q in joints])
    return points.reshape(len(joints), arm.modules + 1, 3) * hand


def holds_on_the_path(case: Case) -> None:
    """Every spine point lies on the path, in order, the tip where it was sent."""
    assert np.all(case.solution.solved)
    reached = case.reached()
    for row, arcs in zip(reached, case.solution.spine_arc_lengths, strict=True):
        for point, s in zip(row, arcs, strict=True):
            # The solver's tolerance, and rounding of coordinates up to 10 m.
            assert case.drawn.distance(point) < 1e-9 * INCH + 1e-13
            assert np.linalg.norm(point - case.drawn.point(float(s))) < 1e-9 * INCH + 1e-13
    wanted = case.solution.spine_points
    np.testing.assert_allclose(reached, wanted, rtol=0, atol=1e-9 * INCH + 1e-13)
    np.testing.assert_array_equal(case.solution.spine_arc_lengths[:, -1], case.tips)
    assert np.all(np.diff(case.solution.spine_arc_lengths, axis=1) > 0.0)
    # No spine point goes back while the tip goes on.
    assert np.all(np.diff(case.solution.spine_arc_lengths, axis=0) > 0.0)


def holds_its_lengths(case: Case) -> None:
    """The points asked for are as far apart as the law of cosines says of the odd angles found."""
    arm, solution = case.arm, case.solution
    offset, length = arm.segment_offset[:-1], arm.segment_length[1:]
    odd = solution.joints[:, 4:-1:2]
    # The angle inside the triangle of Delta and S is pi - theta.
    expected = np.sqrt(offset**2 + length**2 - 2.0 * offset * length * np.cos(math.pi - odd))
    chords = np.linalg.norm(np.diff(solution.spine_points, axis=1), axis=2)
    # Both ends within the tolerance.
    np.testing.assert_allclose(chords, expected, rtol=0, atol=2e-9 * INCH + 1e-13)
    np.testing.assert_allclose(solution.module_lengths, expected, rtol=0, atol=1e-14)
    # And the links themselves: from spine point 4 on, offset and length in turn.
    corners = kinematics.centre_line(arm, solution.joints)
    links = np.linalg.norm(np.diff(corners, axis=1), axis=2)
    expected = np.append(arm.segment_length[0], np.column_stack([offset, length]).ravel())
    np.testing.assert_allclose(links, np.broadcast_to(expected, links.shape), rtol=0, atol=1e-14)


def holds_its_margins(case: Case) -> None:
    """The plan's margins are distances to the limits, and the path is followable as it was made."""
    arm = case.arm
    plan = make_plan(arm, case.path, tip_arc_lengths=case.tips)
    assert plan.failures == ()
    for q, margins in zip(plan.joints, plan.joint_margins, strict=True):
        for value, margin, lower, upper in zip(
            q, margins, arm.joint_lower, arm.joint_upper, strict=True
        ):
            middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
            # Rounding of d1's limits, up to 3 m.
            assert margin == pytest.approx(half - abs(value - middle), abs=2e-15)
    # d1's home is its lower limit, so at home its margin is the solver's own error.
    assert plan.joint_margins.min() > -1e-9
    # The centre line ends at the tip and begins on the path, and everything is a number.
    assert np.all(np.isfinite(plan.centre_line_deviation))


def holds_backwards(case: Case) -> None:
    """Retraction is the reversed array."""
    back = case.solver.solve(case.path, case.tips[::-1])
    assert np.all(back.solved)
    # Each is within 1e-9 in of the path; over links of 9 in that is 1e-10 rad, adding up.
    np.testing.assert_allclose(back.joints[::-1], case.solution.joints, rtol=0, atol=1e-8)


def holds_its_rates(case: Case) -> None:
    """Rates are the slopes of the joints, where no spine point goes from piece to piece."""
    h = 1e-5
    exact = FollowTheLeader(case.arm, tolerance=1e-13)
    tips = case.tips[1:-1]
    here, ahead, behind = (exact.solve(case.path, tips + shift) for shift in (0.0, 2 * h, -2 * h))
    starts = case.path.pieces[1:, 0]
    low, high = behind.spine_arc_lengths[:, :, None], ahead.spine_arc_lengths[:, :, None]
    smooth = ~np.any((low <= starts) & (starts <= high), axis=(1, 2))
    ahead, behind = (exact.solve(case.path, tips + shift) for shift in (h, -h))
    slopes = (ahead.joints - behind.joints) / (2.0 * h)
    rates = case.solver.rates(case.path, here.joints, here.spine_arc_lengths)
    event(f"{np.sum(smooth)} of {len(tips)} tips away from the joints between pieces")
    # The iteration leaves 1e-13 m: over links of 0.23 m and h, 4e-8 rad/m, adding up; and
    # h^2 / 6 times a third derivative below 1e4 rad/m^3.
    np.testing.assert_allclose(rates[smooth], slopes[smooth], rtol=0, atol=1e-6)


HOLDS = [holds_on_the_path, holds_its_lengths, holds_its_margins, holds_backwards, holds_its_rates]


@pytest.mark.parametrize("holds", HOLDS)
@FAST
@given(options=arm_options(), bends=BENDS, reach=REACH, kind=KIND)
def test_every_arm_on_every_path_it_can_follow(arm_variant, holds, options, bends, reach, kind):
    holds(Case(arm_variant, options, bends, reach, kind))


@pytest.mark.slow
@pytest.mark.timeout(500)
@pytest.mark.parametrize("holds", HOLDS)
@DEEP
@given(options=arm_options(), bends=BENDS, reach=REACH, kind=KIND)
def test_every_arm_on_many_more_paths(arm_variant, holds, options, bends, reach, kind):
    holds(Case(arm_variant, options, bends, reach, kind))


# Paths that cannot be followed, or only by chance

POINT = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@st.composite
def wild_points(draw: st.DrawFn) -> np.ndarray:
    """Steps anyhow, as offsets (P, 3) m: sharp corners, folds straight back, tiny steps, long."""
    points = [np.array(draw(POINT))]
    for _ in range(draw(st.integers(1, 6))):
        step = np.array(draw(POINT)) * draw(st.sampled_from([0.01, 0.3, 2.0]))
        if len(points) > 1 and draw(st.integers(0, 3)) == 0:
            step = -draw(st.floats(0.1, 1.5)) * (points[-1] - points[-2])
        points.append(points[-1] + step)
    return np.array(points)


def reports_truly(arm: SerpentineArm, solver: FollowTheLeader, path: TipPath, tips) -> None:
    """Solved means finite joints that put every spine point on the path; else there is a reason."""
    solution, own = solver.solve(path, tips), Path.of_table(path.pieces)
    good = solution.solved
    event("solved " + ("all" if good.all() else "some" if good.any() else "none"))
    assert np.all(np.isfinite(solution.joints[good]))
    assert np.all(np.isfinite(solution.spine_arc_lengths[good]))
    assert np.all(solution.spine_error[good] <= solver.tolerance)
    for row in forward(arm, solution.joints[good]):
        # The solver's tolerance, and rounding of coordinates up to 20 m.
        assert max(own.distance(point) for point in row) < 1e-9 * INCH + 1e-13
    for i in np.flatnonzero(~good):
        # Without a fit there are no joints; short of the tolerance there are, with their error.
        assert np.all(np.isnan(solution.joints[i])) == (solution.status[i] != NOT_CONVERGED)
        text = solver.explain(path, solution, int(i))
        assert path.name in text
        assert "nan" not in text
    joint_state, loop = np.empty(2 * arm.joints), np.empty(2)
    for s, status in zip(tips, solution.status, strict=True):
        start = solver.initial_module_lengths
        alone = solver.follow(path, (float(s), 0.025), start, joint_state, loop)
        assert alone == status
        assert alone != CONVERGED or (
            np.all(np.isfinite(joint_state[: arm.joints])) and loop[0] <= solver.tolerance
        )


def wild_path(arm: SerpentineArm, points: np.ndarray) -> TipPath | None:
    """The base line, as long as drawn, and then the steps; None where two points are one."""
    spine = home_spine(arm)
    base, tip = spine[0] - [0.0, 0.0, 0.5 * points[0, 2]], spine[-1]
    try:
        return polyline_path(np.vstack([base, tip, tip + points[1:] - points[0]]), "wild")
    except InputError:
        return None


def holds_on_wild_paths(arm_variant, options, points) -> None:
    arm = arm_variant(**options)
    path = wild_path(arm, points)
    if path is not None:
        tips = np.linspace(0.0, path.length, 12)
        reports_truly(arm, FollowTheLeader(arm), path, tips)


@FAST
@given(options=arm_options(), points=wild_points())
def test_what_is_called_solved_is_solved_and_the_rest_is_explained(arm_variant, options, points):
    holds_on_wild_paths(arm_variant, options, points)


@pytest.mark.slow
@pytest.mark.timeout(500)
@DEEP
@given(options=arm_options(), points=wild_points())
def test_what_is_called_solved_is_solved_on_many_more_paths(arm_variant, options, points):
    holds_on_wild_paths(arm_variant, options, points)


@FAST
@given(
    options=arm_options(),
    corner=st.floats(1.9, math.pi),
    side=st.floats(-math.pi, math.pi),
    beyond=st.floats(1.0, 2.0),
)
def test_a_corner_sharper_than_the_joints_fails_the_plan(
    arm_variant, options, corner, side, beyond
):
    """From 109 deg on no universal joint of +-45 deg each way takes the corner, nor two of them
    that are a module apart, once the tip is a module or two past it."""
    arm = arm_variant(**options)
    spine = home_spine(arm)
    longest = float(np.max(arm.chain.sum(axis=1)))
    toward = np.array([math.cos(side), math.sin(side), 0.0])
    step = math.cos(corner) * np.array([0.0, 0.0, 1.0]) + math.sin(corner) * toward
    base = spine[0] - [0.0, 0.0, 0.3]
    path = polyline_path([base, spine[-1], spine[-1] + beyond * longest * step], "corner")
    plan = make_plan(arm, path)
    assert not plan.followable
    assert all(path.name in sentence for sentence in plan.failures)


def test_the_narrowest_bends_use_the_joints_and_narrower_ones_break_the_limits(arm_variant):
    """So that what holds on followable paths is not said of paths that are all but straight."""
    rng = np.random.default_rng(7)
    arm = arm_variant(lengths=[15.0] * 10, offsets=[0.0] * 9, limit_deg=20.0)
    for kind in KINDS:
        # Towards one joint's own side: it takes the whole bend.
        for side in [0.0, *rng.uniform(-math.pi, math.pi, 4)]:
            plans = [
                make_plan(arm, bent_path(arm, [Bend(0.1, wideness, 1.2, side)], kind=kind))
                for wideness in (1.0, 0.6)
            ]
            assert plans[0].followable
            assert not plans[1].followable
            assert plans[0].joint_margins[:, 3:].min() < 0.4 * arm.joint_upper[-1]
