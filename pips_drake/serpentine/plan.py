"""A plan: postures along a path, and everything that can be said of it without dynamics.

`make_plan` solves follow-the-leader along a path and judges it: is there a posture everywhere, are
the joints and actuators within their limits, how far is the arm's centre line from the path, how
close is home to the base line. Failures are sentences that say where and by how much.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.follow_the_leader import FollowTheLeader, Solution
from pips_drake.serpentine.tip_path import TipPath
from pips_drake.units import DEGREE, INCH, in_inches

Array = NDArray[np.float64]

#: Spacing at which limits are checked between a table's points, m. Joints peak between table rows;
#: at a quarter inch the joint-linear motion stays within 0.02 in of the path (FACTS).
CHECK_STEP = 0.25 * INCH
#: How far row 2 of a path may stand off the base line, m.
BASE_LINE_TOLERANCE = 0.05 * INCH
#: Tables are printed to 0.001 in, so home may ask for this much beyond a limit of d1, m.
HOME_SLACK = 0.001 * INCH
#: Joint values are computed to this, rad and m: a limit is not broken by less.
LIMIT_TOLERANCE = 1e-9
#: At most this many tip positions in a plan (127 m at `CHECK_STEP`): more would fill the memory.
MOST_TIP_POSITIONS = 20_000
#: A spine point that goes back by less (m) from one posture to the next stands still.
GOING_BACK = 1e-6
#: Points a link at which the centre line is compared with the path, 8 mm apart on the longest. The
#: farthest point between them was up to 0.35 mm farther on trajectory 4 (2.7 mm with 9 points).
POINTS_PER_LINK = 65


class PlanFailure(NamedTuple):
    """Why the arm cannot follow a path: a sentence, and where the tip is first, m of arc length."""

    sentence: str
    tip_arc_length: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Postures along a path. `failures` is empty if and only if the arm can follow it.

    They are sorted by where the tip stands.
    `first_failing_tip` is where the tip stands when something fails first, m of arc length.
    """

    arm: SerpentineArm
    path: TipPath
    solver: FollowTheLeader
    solution: Solution
    failures: tuple[str, ...]
    first_failing_tip: float | None = None

    @property
    def followable(self) -> bool:
        """Whether the arm can follow the path."""
        return not self.failures

    @property
    def joints(self) -> Array:
        """(N, joints), m and rad."""
        return self.solution.joints

    @cached_property
    def joint_margins(self) -> Array:
        """Distance to the nearer limit, (N, joints) m and rad; negative beyond it."""
        return joint_margins(self.arm, self.joints)

    @cached_property
    def drive_lengths(self) -> Array:
        """Lengths of the actuators L3 .., (N, A) m."""
        return self.arm.linkage.length(self.joints[:, self.arm.first_actuated_joint :])

    @cached_property
    def centre_line_deviation(self) -> Array:
        """Farthest point of the whole centre line from the path, (N,) m."""
        return centre_line_deviation(self.arm, self.path, self.solution)

    @cached_property
    def rates(self) -> Array:
        """Derivatives of the joints by the tip's arc length, (N, joints) m/m and rad/m."""
        return self.solver.rates(self.path, self.joints, self.solution.spine_arc_lengths)


def make_plan(
    arm: SerpentineArm,
    path: TipPath,
    *,
    tip_arc_lengths: ArrayLike | None = None,
    solver: FollowTheLeader | None = None,
) -> Plan:
    """Solves and judges a path.

    Args:
        tip_arc_lengths: where the tip is put, (N,) m; by default every `CHECK_STEP` from home on.
            Limits are checked every `CHECK_STEP` all the same.
        solver: how the points are solved; converged by default.

    Raises:
        InputError: the path does not begin on the arm's base line.
    """
    check_start(arm, path)
    samples = tip_samples(path, CHECK_STEP)
    solver = solver or FollowTheLeader(arm)
    wanted = samples if tip_arc_lengths is None else np.asarray(tip_arc_lengths)
    solution = solver.solve(path, wanted)
    failures = _solution_failures(path, solver, solution)
    # The fine sweep finds what hides between coarse points; it is always converged.
    fine_solver = FollowTheLeader(arm)
    fine = fine_solver.solve(path, samples)
    if not failures:
        failures = _solution_failures(path, fine_solver, fine)
    failures += fold_failures(arm, path, fine) + limit_failures(arm, path, fine)
    failures.sort(key=lambda failure: failure.tip_arc_length)
    return Plan(
        arm=arm,
        path=path,
        solver=solver,
        solution=solution,
        failures=tuple(failure.sentence for failure in failures),
        first_failing_tip=failures[0].tip_arc_length if failures else None,
    )


def check_start(arm: SerpentineArm, path: TipPath) -> None:
    """Refuses a path whose home tip is not where the arm can start.

    Raises:
        InputError: the base end or the home tip is off the base line, or home asks for a slide (d1)
            outside its limits.
    """
    home = kinematics.spine_points(arm, arm.joint_home)[0]
    tip = home[-1]
    direction = _base_direction(arm)
    for row, s in ((1, 0.0), (2, path.home_arc_length)):
        off = path.point(s) - tip
        aside = float(np.linalg.norm(off - (off @ direction) * direction))
        if aside > BASE_LINE_TOLERANCE:
            raise InputError(
                f"{path.label}: row {row} is {aside / INCH:.3f} in off the base line of arm "
                f"'{arm.name}' (through {in_inches(tip)} along {_vector(direction)}); "
                f"must be within {BASE_LINE_TOLERANCE / INCH:g} in"
            )
    travel = float((path.point(path.home_arc_length) - tip) @ direction)
    d1 = float(arm.joint_home[0]) + travel
    lower, upper = float(arm.joint_lower[0]), float(arm.joint_upper[0])
    if not lower - HOME_SLACK <= d1 <= upper + HOME_SLACK:
        home_tip = in_inches(path.point(path.home_arc_length))
        raise InputError(
            f"{path.label}: the home tip (row 2) at {home_tip}"
            f" needs d1 = {d1 / INCH:.3f} in; must be {lower / INCH:.3f} .. {upper / INCH:.3f} in, "
            f"so move it {(lower - d1) / INCH:+.3f} .. {(upper - d1) / INCH:+.3f} in along z0"
        )
    if path.travel <= 0.0:
        raise InputError(f"{path.label}: ends at the home tip; must have a point beyond row 2")


def tip_samples(path: TipPath, step: float) -> Array:
    """Arc lengths (N,) m from home to the end, `step` (m) apart, the end included.

    Raises:
        InputError: there would be too many of them.
    """
    if not path.travel / MOST_TIP_POSITIONS < step:
        raise InputError(
            f"{path.label}: {path.travel / INCH:.6g} in of tip travel in steps of "
            f"{step / INCH:.3g} in; must be at most {MOST_TIP_POSITIONS} steps"
        )
    return path.samples(step)


def joint_margins(arm: SerpentineArm, joints: ArrayLike) -> Array:
    """Distance of joints (N, joints) to the nearer limit, m and rad; negative beyond it."""
    q = np.asarray(joints)
    return np.minimum(q - arm.joint_lower, arm.joint_upper - q)


def limit_failures(arm: SerpentineArm, path: TipPath, solution: Solution) -> list[PlanFailure]:
    """One sentence for each joint that leaves its limits: where first, where worst, how much."""
    margins = joint_margins(arm, solution.joints)
    margins[0, 0] += HOME_SLACK  # the table's own rounding, at home alone
    found = []
    for j, name in enumerate(arm.joint_names):
        beyond = np.flatnonzero(margins[:, j] < -LIMIT_TOLERANCE)
        if beyond.size == 0:
            continue
        unit, word = (INCH, "in") if arm.is_prismatic[j] else (DEGREE, "deg")
        worst = beyond[np.argmin(margins[beyond, j])]
        first, s = beyond[0], solution.tip_arc_lengths
        sentence = (
            f"joint {name} leaves its limits {arm.joint_lower[j] / unit:.3f} .. "
            f"{arm.joint_upper[j] / unit:.3f} {word}: first with the tip at {s[first]:.4f} m of "
            f"path '{path.name}' {in_inches(path.point(s[first]))}, worst "
            f"{solution.joints[worst, j] / unit:.3f} {word} at {s[worst]:.4f} m, "
            f"{-margins[worst, j] / unit:.3f} {word} too far"
        )
        found.append(PlanFailure(sentence, float(s[first])))
    return found


def fold_failures(arm: SerpentineArm, path: TipPath, solution: Solution) -> list[PlanFailure]:
    """A sentence if a spine point goes back on the path while the tip goes on.

    It does so when the path turns back inside a module's sphere: the module would span the fold
    instead of following it. Where chord and path are less than a right angle apart, every spine
    point goes on with the tip.
    """
    steps = np.diff(solution.spine_arc_lengths, axis=0)
    steps[~(solution.solved[1:] & solution.solved[:-1])] = 0.0
    back = np.argwhere(steps < -GOING_BACK)
    if back.size == 0:
        return []
    row = back[0, 0]
    module = back[back[:, 0] == row, 1].max()  # where it begins: the others only follow
    s = float(solution.tip_arc_lengths[row])
    sentence = (
        f"the path folds inside the reach of module {module + 1}: spine point "
        f"{arm.spine_indices[module]} would go back on it with the tip at {s:.4f} m of path "
        f"'{path.name}' {in_inches(path.point(s))}"
    )
    return [PlanFailure(sentence, s)]


def centre_line_deviation(arm: SerpentineArm, path: TipPath, solution: Solution) -> Array:
    """Farthest point of the arm's whole centre line from the path, (N,) m.

    Exact spine points are not an exact arm: the uncontrolled odd points and the links cut corners.
    The centre line runs from the first controlled spine point to the tip; before that the arm lies
    where its base holds it.
    """
    solved = np.flatnonzero(~np.isnan(solution.joints[:, 0]))
    result = np.full(solution.tip_arc_lengths.size, np.nan)
    if solved.size:
        result[solved] = posture_deviation(
            arm, path, solution.joints[solved], solution.spine_arc_lengths[solved]
        )
    return result


def posture_deviation(
    arm: SerpentineArm, path: TipPath, joints: Array, spine_arc_lengths: Array
) -> Array:
    """Farthest point of the centre line from the path, (N,) m, for any postures (N, joints).

    Args:
        spine_arc_lengths: where the spine points should be, (N, M + 1) m: each link is compared
            with its own part of the path, half a module longer at either end.
    """
    corners = kinematics.centre_line(arm, joints)[:, 1:]
    fractions = np.linspace(0.0, 1.0, POINTS_PER_LINK)[:, None]
    links = corners[:, :-1, None] + fractions * (corners[:, 1:] - corners[:, :-1])[:, :, None]
    # Two links a module: from an even spine point over the odd one to the next even one.
    low = np.repeat(spine_arc_lengths[:, :-1], 2, axis=1)
    high = np.repeat(spine_arc_lengths[:, 1:], 2, axis=1)
    reach = 0.5 * (high - low)
    shape = links.shape[:3]
    distance, _ = path.nearest(
        links.reshape(-1, 3),
        np.broadcast_to(np.maximum(low - reach, 0.0)[:, :, None], shape).ravel(),
        np.broadcast_to(np.minimum(high + reach, path.length)[:, :, None], shape).ravel(),
    )
    result: Array = distance.reshape(shape[0], -1).max(axis=1)
    return result


def _solution_failures(
    path: TipPath, solver: FollowTheLeader, solution: Solution
) -> list[PlanFailure]:
    failed = np.flatnonzero(~solution.solved)
    if failed.size == 0:
        return []
    sentence = solver.explain(path, solution, int(failed[0]))
    more = f" (and at {failed.size - 1} more tip positions)" if failed.size > 1 else ""
    return [PlanFailure(sentence + more, float(solution.tip_arc_lengths[failed[0]]))]


def _base_direction(arm: SerpentineArm) -> Array:
    """Unit vector of the base line: along the spine at home, towards the tip."""
    home = kinematics.spine_points(arm, arm.joint_home)[0]
    direction: Array = (home[-1] - home[0]) / np.linalg.norm(home[-1] - home[0])
    return direction


def _vector(direction: Array) -> str:
    return "(" + ", ".join(f"{round(value, 3) + 0.0:.3f}" for value in direction) + ")"
