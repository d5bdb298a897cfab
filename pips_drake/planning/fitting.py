"""Laying an arm along a path, in three ways (CMU-92 section 3.5.2, FTL-95).

`fit_directly` goes from the base to the tip and points each joint at the path a link's length ahead
(section 3.5.2.1): quick, and the tip ends where it ends. `fit_with_springs` pulls points of the arm
to the path and turns the forces into joint rates by the Jacobian's transpose (section 3.5.2.2).
`fit_by_following` is follow-the-leader, which puts the tip on its place and every spine point on
the path.

The springs' gain. Eq 15 as printed, dq_i = tau_i / m_i with tau = J'(x* - x) and m_i = |J_i|^2, is
a Jacobi step on the least squares |x* - x|^2: an error e of the joints becomes (1 - g D^-1 J'J) e,
with D = diag(m) and g = 1. It dies out if and only if 0 < g < 2 / lambda, lambda the largest
eigenvalue of D^-1/2 J'J D^-1/2. That matrix has a unit diagonal, so that lambda lies between 1 and
the number of joints, and the more joints move the same points, the larger it is (17 for 41 joints
around a bend): unit gain diverges beyond a few joints. The default is 1 / lambda, at which every
part of the error shrinks and none changes its sign.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.plan import joint_margins, posture_deviation
from pips_drake.serpentine.tip_path import TipPath

Array = NDArray[np.float64]

#: The springs have settled when no pulled point moves farther than this in a step, m. Slow parts of
#: the error are then still up to some thousand times as large.
SETTLED = 1e-6
MAX_STEPS = 20000
#: Steps of a link's length in which the walk along a path looks for a link's end.
_PARTS = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """An arm laid along a path.

    Attributes:
        joints: (J,) m and rad.
        spine_arc_lengths: where on the path its spine points belong, (M + 1,) m.
        tip_error: from the tip to where on the path it was wanted, m.
        deviation: farthest point of the centre line from the path, m.
        margins: of the joints to their nearer limit, (J,) m and rad; negative beyond it.
        steps: of an iteration; 1 for what needs none.
    """

    joints: Array
    spine_arc_lengths: Array
    tip_error: float
    deviation: float
    margins: Array
    steps: int = 1


def fit_directly(arm: SerpentineArm, path: TipPath, tip_arc_length: float) -> Fit:
    """Joint by joint from the base, each link's end on the path a link's length ahead.

    The first spine point is put the arm's length before the wanted tip, measured along the path;
    where the path bends, links take more of it than their length, and the tip stops beyond.

    Raises:
        NotFollowableError: the base cannot hold the first spine point there.
    """
    lengths = arm.average_module_length
    arcs = [tip_arc_length - float(lengths.sum())]
    for length in lengths:
        arcs.append(_ahead(path, arcs[-1], float(length)))
    spine = path.point(np.array(arcs))
    return _judge(arm, path, tip_arc_length, kinematics.spine_inverse(arm, spine)[0], arcs)


def fit_by_following(arm: SerpentineArm, path: TipPath, tip_arc_length: float) -> Fit:
    """Follow-the-leader: the tip on its place and every spine point on the path.

    Raises:
        NotFollowableError: says why the arm cannot lie there.
    """
    solver = FollowTheLeader(arm)
    found = solver.solve(path, [tip_arc_length])
    if not found.solved[0]:
        raise NotFollowableError(solver.explain(path, found, 0))
    return _judge(
        arm,
        path,
        tip_arc_length,
        found.joints[0],
        found.spine_arc_lengths[0],
        steps=int(found.iterations[0]),
    )


def fit_with_springs(
    arm: SerpentineArm,
    path: TipPath,
    tip_arc_length: float,
    *,
    start: ArrayLike | None = None,
    gain: float | None = None,
    tolerance: float = SETTLED,
    max_steps: int = MAX_STEPS,
) -> Fit:
    """Springs from every spine point to the path's nearest point, and from the tip to its place.

    Args:
        start: joints (J,) to begin with; the direct fit by default.
        gain: g; by default 1 / lambda of the present posture, which is safe.
        tolerance: it has settled when no spine point moves farther in a step, m.

    Raises:
        NotFollowableError: it has not settled within `max_steps`, or left every bound.
    """
    if gain is not None and not (math.isfinite(gain) and gain > 0.0):
        raise InputError(f"gain = {gain}; must be > 0")
    first = fit_directly(arm, path, tip_arc_length)
    q = first.joints.copy() if start is None else np.array(start, dtype=np.float64)
    if q.shape != (arm.joints,) or not np.isfinite(q).all():
        raise InputError(f"joints to start from; must be {arm.joints} finite numbers")
    arcs = first.spine_arc_lengths.copy()
    reach = arm.average_module_length.max()
    for step in range(1, max_steps + 1):
        points = kinematics.spine_points(arm, q)[0]
        _, arcs = path.nearest(points, np.maximum(arcs - reach, 0.0), arcs + reach)
        arcs[-1] = tip_arc_length
        jacobian = spine_jacobian(arm, q)
        pull = (path.point(arcs) - points).ravel()
        masses = np.sum(jacobian * jacobian, axis=0)
        moving = masses > 0.0  # the last joint turns the tip about itself
        rate = np.zeros(arm.joints)
        rate[moving] = (jacobian.T @ pull)[moving] / masses[moving]
        change = (1.0 / largest_eigenvalue(jacobian) if gain is None else gain) * rate
        q = q + change
        farthest = float(np.abs(jacobian @ change).max())
        if not farthest < path.length:
            raise NotFollowableError(
                f"springs diverge after {step} steps: a gain of {gain:g} is too large; must be "
                f"below {2.0 / largest_eigenvalue(spine_jacobian(arm, first.joints)):.3g} here"
            )
        if farthest <= tolerance:
            return _judge(arm, path, tip_arc_length, q, arcs, steps=step)
    raise NotFollowableError(f"springs have not settled within {max_steps} steps")


def spine_jacobian(arm: SerpentineArm, joints: ArrayLike) -> Array:
    """Derivatives (3 (M + 1), J) of the spine points in one posture (J,), m/m and m/rad."""
    transforms = kinematics.frames(arm, joints)
    axes = kinematics.joint_axes(arm, transforms)[0]
    origins = transforms[0, :, :3, 3]
    last = np.array(arm.spine_indices) - 1
    reach = origins[last][:, None, :] - origins[None, :, :]
    columns = np.where(arm.is_prismatic[None, :, None], axes, np.cross(axes[None], reach))
    # A joint moves what lies behind it alone.
    columns = np.where(np.arange(arm.joints)[None, :, None] <= last[:, None, None], columns, 0.0)
    jacobian: Array = columns.transpose(0, 2, 1).reshape(-1, arm.joints)
    return jacobian


def largest_eigenvalue(jacobian: Array) -> float:
    """lambda of the module's text: a gain of 2 / lambda and more diverges."""
    sizes = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian[:, sizes > 0.0] / sizes[sizes > 0.0]
    return float(np.linalg.norm(scaled, ord=2) ** 2)


def _ahead(path: TipPath, start: float, length: float) -> float:
    """The arc length (m) at which the path first leaves the sphere of a radius about a place."""
    centre = path.point(start)

    def beyond(s: float) -> float:
        return float(np.linalg.norm(path.point(s) - centre)) - length

    # A chord is never longer than its arc.
    low = high = start + length
    while beyond(high) < 0.0:
        low, high = high, high + length / _PARTS
        if high > path.length + 2.0 * length:  # the ends are extended: it is out there
            raise NotFollowableError(f"{path.label}: folds so tightly that no link leaves it")
    return low if low == high else float(brentq(beyond, low, high, xtol=1e-13))


def _judge(
    arm: SerpentineArm,
    path: TipPath,
    tip_arc_length: float,
    joints: Array,
    arcs: ArrayLike,
    *,
    steps: int = 1,
) -> Fit:
    if np.isnan(joints).any():
        raise NotFollowableError(
            f"{path.label}: the base cannot reach the path's beginning with the tip at "
            f"{tip_arc_length:.3f} m"
        )
    spine_arcs = np.array(arcs, dtype=np.float64)
    tip = kinematics.spine_points(arm, joints)[0, -1]
    return Fit(
        joints=joints,
        spine_arc_lengths=spine_arcs,
        tip_error=float(np.linalg.norm(tip - path.point(tip_arc_length))),
        deviation=float(posture_deviation(arm, path, joints[None], spine_arcs[None])[0]),
        margins=joint_margins(arm, joints[None])[0],
        steps=steps,
    )
