"""Follow-the-leader: every spine point lies on the path that the tip has taken (FTL-95).

For each tip position two steps alternate (Fig 3.1): the arm is fitted to the path from tip to base
by spheres whose radii are the module lengths, and inverse kinematics gives the joints from base to
tip. With joint offsets the module lengths depend on the joints (Eq 3.4), so they are updated and
the steps repeated until forward kinematics finds the spine points where they were wanted.

Two modes, by tolerance. *Converged* (1e-9 in or finer; the default): every tip position starts from
the average lengths, so its answer depends on nothing else. *Report* (coarser): the lengths carry
over from one tip position to the next and are updated after every solution, accepted ones too;
with 0.1 in that reproduces the report's Figure D.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.serpentine import solver
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.joint_rates import follow_tip, joint_rates_many
from pips_drake.serpentine.path_geometry import ON_PIECE_TOLERANCE, sphere_line_roots
from pips_drake.serpentine.spine_inverse import make_mechanism
from pips_drake.serpentine.tip_path import TipPath
from pips_drake.units import INCH, in_inches

Array = NDArray[np.float64]

#: Default tolerance, m: converged, so that the answer does not depend on where it started.
CONVERGED_TOLERANCE = 1e-9 * INCH
#: The report's tolerance, m (FTL-95 Appendix D.4).
REPORT_TOLERANCE = 0.1 * INCH
#: Default iteration limit. The fixed point contracts by about 100 a step: 6 are typical.
MAX_ITERATIONS = 50


@dataclass(frozen=True, kw_only=True)
class SphereSegmentIntersection:
    """How a sphere meets a line segment: FTL-95 section 3.3.2.2's cases, for both roots.

    Attributes:
        t: parameters of the roots, smaller first, 0 at the first end and 1 at the second; NaN if
            the line misses the sphere.
        on_segment: which of them lie on the segment, ends included.
        tangent: whether the two are one.
    """

    t: tuple[float, float]
    on_segment: tuple[bool, bool]
    tangent: bool


def intersect_sphere_segment(
    first: ArrayLike, second: ArrayLike, centre: ArrayLike, radius: float
) -> SphereSegmentIntersection:
    """Intersects the segment from `first` to `second` (3,) m with a sphere (FTL-95 Eqs 3.5 to 3.8).

    The report's strict 0 < t < 1 loses a vertex that lies exactly `radius` away; here the ends
    count, with the tolerance of the walk.
    """
    p = np.asarray(first, dtype=np.float64)
    u = np.asarray(second, dtype=np.float64) - p
    c = np.asarray(centre, dtype=np.float64)
    length = float(np.linalg.norm(u))
    if length == 0.0:
        raise InputError("segment: its two ends are the same point")
    _, *roots = sphere_line_roots(*map(float, [*p, *(u / length), *c]), float(radius))
    t1, t2 = (root / length for root in roots)
    slack = ON_PIECE_TOLERANCE
    return SphereSegmentIntersection(
        t=(t1, t2),
        on_segment=(bool(-slack <= t1 <= 1 + slack), bool(-slack <= t2 <= 1 + slack)),
        tangent=bool(t1 == t2),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """Postures for tip positions along a path, base frame {0}.

    Attributes:
        tip_arc_lengths: (N,) m.
        joints: (N, joints) m and rad; NaN where there is no solution.
        spine_points: wanted spine points (N, M + 1, 3) m, on the path.
        spine_arc_lengths: where on the path they lie, (N, M + 1) m.
        status: (N,), `solver.CONVERGED` and others.
        iterations: (N,).
        spine_error: largest distance between wanted spine points and forward kinematics, (N,) m.
        first_spine_error: the same after the first iteration, (N,) m.
        failing_part: module (`OFF_PATH`) or base row (`BASE_OUT_OF_REACH`), from 0; else -1.
        base_excess: by how much the base's sine or cosine exceeds 1, (N,).
        module_lengths: Q_i as updated last, (N, M) m; at `OFF_PATH` those that did not fit.
    """

    tip_arc_lengths: Array
    joints: Array
    spine_points: Array
    spine_arc_lengths: Array
    status: NDArray[np.int64]
    iterations: NDArray[np.int64]
    spine_error: Array
    first_spine_error: Array
    failing_part: NDArray[np.int64]
    base_excess: Array
    module_lengths: Array

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Which tip positions have a solution within the tolerance, (N,)."""
        return self.status == solver.CONVERGED


class FollowTheLeader:
    """The solver for one arm. Paths are passed to its calls, because they may change.

    Args:
        arm: the arm.
        tolerance: spine error at which the iteration stops, m.
        max_iterations: at most this many a tip position; a point that needs more is reported as
            not converged, with its last joints and error.
    """

    def __init__(
        self,
        arm: SerpentineArm,
        *,
        tolerance: float = CONVERGED_TOLERANCE,
        max_iterations: int = MAX_ITERATIONS,
    ) -> None:
        if not (math.isfinite(tolerance) and tolerance > 0.0):
            raise InputError(f"tolerance = {tolerance} m; must be > 0")
        if max_iterations < 1:
            raise InputError(f"max_iterations = {max_iterations}; must be 1 or more")
        self.arm = arm
        self.tolerance = float(tolerance)
        self.max_iterations = int(max_iterations)
        self._mechanism = make_mechanism(arm)
        self._average = arm.average_module_length

    @property
    def carries_over(self) -> bool:
        """Whether module lengths carry over (the report's mode)."""
        return self.tolerance > CONVERGED_TOLERANCE * (1.0 + 1e-9)

    @property
    def initial_module_lengths(self) -> Array:
        """Q_AVG (M,) m, where the iteration starts."""
        return self._average.copy()

    def solve(
        self,
        path: TipPath,
        tip_arc_lengths: ArrayLike,
        *,
        module_lengths: ArrayLike | None = None,
    ) -> Solution:
        """Postures for tips at arc lengths (N,) m of the path, in that order.

        Args:
            module_lengths: where the iteration starts, (M,) m; the averages by default. A converged
                answer does not depend on it.
        """
        start = np.array(self._average if module_lengths is None else module_lengths, dtype=float)
        if start.shape != self._average.shape:  # compiled code would not look
            raise InputError(
                f"module lengths of shape {start.shape}; must be {self._average.shape}"
            )
        s = np.atleast_1d(np.asarray(tip_arc_lengths, dtype=np.float64))
        q, spine, arcs, status, iterations, errors, part, excess, lengths = solver.solve_points(
            self._pieces(path),
            s,
            self._mechanism,
            self.tolerance,
            self.max_iterations,
            start,
            self.carries_over,
        )
        return Solution(
            tip_arc_lengths=s,
            joints=q,
            spine_points=spine * self.arm.mirror,
            spine_arc_lengths=arcs,
            status=status,
            iterations=iterations,
            spine_error=errors[:, 0],
            first_spine_error=errors[:, 1],
            failing_part=part,
            base_excess=excess,
            module_lengths=lengths,
        )

    def follow(
        self,
        path: TipPath,
        tip: tuple[float, float],
        module_lengths: Array,
        joint_state: Array,
        solution: Array,
    ) -> int:
        """One tip position and its rates, for a loop: `solve` and `rates` in one compiled call.

        Args:
            tip: arc length (m) and its rate (m/s).
            module_lengths: where the iteration starts, (M,) m; updated in place (report mode).
            joint_state: out, joint values and rates (2 joints,); not written without a solution.
            solution: out, spine error (m) and iterations, (2,).

        Returns:
            status.
        """
        return int(
            follow_tip(
                self._pieces(path),
                *tip,
                self._mechanism,
                self.tolerance,
                self.max_iterations,
                module_lengths,
                True,
                joint_state,
                solution,
            )
        )

    def rates(self, path: TipPath, joints: ArrayLike, spine_arc_lengths: ArrayLike) -> Array:
        """Derivatives (N, joints) of converged joints by the tip's arc length, rad/m and m/m.

        At a polyline's vertices the one-sided derivative from the base's side.
        """
        return np.asarray(
            joint_rates_many(
                self._pieces(path),
                np.atleast_2d(np.asarray(joints, dtype=np.float64)),
                np.atleast_2d(np.asarray(spine_arc_lengths, dtype=np.float64)),
                self._mechanism,
            )
        )

    def _pieces(self, path: TipPath) -> Array:
        """The path's table as the drawn hand sees it: a mirrored arm solves the mirrored path."""
        return path.mirrored_pieces if self.arm.mirrored else path.pieces

    def explain(self, path: TipPath, solution: Solution, index: int) -> str:
        """One sentence: why a tip position has no solution, where, and by how much."""
        s = float(solution.tip_arc_lengths[index])
        where = f"tip at {s:.4f} m of path '{path.name}' {in_inches(path.point(s))}"
        status, part = int(solution.status[index]), int(solution.failing_part[index])
        if status == solver.NOT_CONVERGED:
            return (
                f"{where}: spine error {solution.spine_error[index] / INCH:.3g} in "
                f"after {solution.iterations[index]} iterations; "
                f"must be <= {self.tolerance / INCH:.3g} in"
            )
        if status == solver.OFF_PATH:
            return f"{where}: {self._off_path_text(path, solution, index, part)}"
        if status == solver.BASE_OUT_OF_REACH:
            joint = self.arm.joint_names[2 if part == 0 else 1]
            function = "sine" if part == 0 else "cosine"
            return (
                f"{where}: the motion base does not reach spine point "
                f"{self.arm.spine_indices[0]} at {in_inches(solution.spine_points[index, 0])}: the "
                f"{function} for {joint} exceeds 1 by {solution.base_excess[index]:.4g}"
            )
        raise NotFollowableError(f"{where}: it has a solution", s)

    def _off_path_text(self, path: TipPath, solution: Solution, index: int, module: int) -> str:
        outer = self.arm.spine_indices[module + 1]
        centre = solution.spine_points[index, module + 1]
        s = solution.spine_arc_lengths[index, module + 1]
        start = float(np.linalg.norm(path.point(0.0) - centre))
        needed = float(solution.module_lengths[index, module])
        return (
            f"the sphere about spine point {outer} (at {s:.4f} m of the path) meets no earlier "
            f"part of the path: module {module + 1} needs {needed / INCH:.3f} in and the path's "
            f"start is {start / INCH:.3f} in away, {(needed - start) / INCH:.3f} in too near"
        )
