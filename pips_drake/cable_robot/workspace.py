"""Where a platform on cables can be: the studies of CABLE-96, section 4, over many poses at once.

For each pose: rank and condition of L, kinematic and static stability, whether tensions within
bounds bear the weight and every wrench of a box of disturbances, the tensions, and how near things
come to each other. What holds a wrench-feasible pose is exact for the whole box: see `capability`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.cable_robot import tension_methods
from pips_drake.cable_robot.capability import capability_of, pseudoinverse
from pips_drake.cable_robot.interference import Clearances, ObstacleBox, clearances
from pips_drake.cable_robot.kinematics import Poses, jacobian, make_poses
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.stability import static_stability
from pips_drake.cable_robot.statics import (
    BALANCED,
    BOUNDS_KEPT,
    characteristic_length,
    general_solution,
    moment_scales,
)
from pips_drake.config import require
from pips_drake.errors import InputError, UnknownNameError

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Parts of a sweep that can be left out.
PARTS = ("tensions", "clearances", "condition")
#: Poses that are looked at at once: some 50 MB.
_CHUNK = 25_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """What is asked of every pose.

    Attributes:
        disturbance_force: the largest disturbance along each axis, either way, N.
        disturbance_moment: and about each axis, N m.
        obstacles: what must not be touched.
        least_clearance: between any two things, m. What a cable's own stretch, its sag and its
            thickness, and the pose's errors take from it must be less.
        tension_method: see `tension_methods.METHODS`.
        parts: of `PARTS`, those that are wanted.
    """

    disturbance_force: float = 0.0
    disturbance_moment: float = 0.0
    obstacles: Sequence[ObstacleBox] = ()
    least_clearance: float = 0.05
    tension_method: str = "least_norm"
    parts: Sequence[str] = PARTS

    def __post_init__(self) -> None:
        for name, unit in (
            ("disturbance_force", "N"),
            ("disturbance_moment", "N m"),
            ("least_clearance", "m"),
        ):
            value = getattr(self, name)
            require(np.isfinite(value) and value >= 0.0, name, f"{value:g} {unit}", ">= 0")
        for part in self.parts:
            if part not in PARTS:
                raise UnknownNameError("part of a study", part, list(PARTS))
        if self.tension_method not in tension_methods.METHODS:
            raise UnknownNameError(
                "tension method", self.tension_method, list(tension_methods.METHODS)
            )

    def disturbance(self, robot: CableRobot) -> Array:
        """Half sizes of the box of wrenches, (freedom,) N and N m."""
        sizes = self.disturbance_force, self.disturbance_moment
        return np.array([sizes[0] if k < 3 else sizes[1] for k in robot.freedoms])


@dataclass(frozen=True, eq=False)
class WorkspaceResult:
    """What was found, one row a pose; nan in numbers that were not asked for.

    Attributes:
        poses: the N poses.
        rank: of L, (N,).
        kinematic, static: stability as in `stability`, (N,).
        margin: how many times the box of disturbances can be borne with the weight, (N,); negative
            where not even the weight can. Without a box inf or -inf.
        feasible: the weight and all disturbances can be borne within the bounds, (N,).
        slack: see `statics.TensionDistribution`, (N,) N.
        tension_least, tension_most: of the cables' tensions under the weight, (N,) N; nan where
            none are within the bounds.
        condition: of L with rotations as arcs at the characteristic length, (N,).
        clearances: the least distances; None if not asked for.
        clear: no two things nearer than the least clearance, and no cable through the platform's
            box, (N,); True if not asked for.
    """

    poses: Poses
    rank: NDArray[np.int64]
    kinematic: Flags
    static: Flags
    margin: Array
    feasible: Flags
    slack: Array
    tension_least: Array
    tension_most: Array
    condition: Array
    clearances: Clearances | None
    clear: Flags

    @property
    def usable(self) -> Flags:
        """Poses that are feasible and clear, (N,)."""
        return self.feasible & self.clear


def sweep(robot: CableRobot, poses: Poses, study: Study | None = None) -> WorkspaceResult:
    """Studies N poses.

    Raises:
        InputError: no poses, a method without the upper bound that it needs, or a cable without
            length.
    """
    study = Study() if study is None else study
    require(len(poses) > 0, f"{robot.name}: poses to study", len(poses), ">= 1")
    bounded = bool(np.isfinite(robot.tension_max))
    bounded = bounded or study.tension_method not in tension_methods.NEED_BOTH_BOUNDS
    shown = f"{robot.tension_max:g} N"
    require(bounded, f"{robot.name}: tension_max", shown, f"finite for {study.tension_method}")
    parts = []
    for start in range(0, len(poses), _CHUNK):
        part = slice(start, start + _CHUNK)
        chosen = Poses(poses.position[part], poses.rotation[part])
        parts.append(_statics(robot, chosen, study))
    rank, kinematic, static, margin, feasible, slack, least, most, condition = (
        np.concatenate(column) for column in zip(*parts, strict=True)
    )
    near = None
    clear = np.ones(len(poses), dtype=bool)
    if "clearances" in study.parts:
        near = clearances(robot, poses, study.obstacles)
        clear = (near.least >= study.least_clearance) & (near.cable_platform > 0.0)
    return WorkspaceResult(
        poses=poses,
        rank=rank,
        kinematic=kinematic,
        static=static,
        margin=margin,
        feasible=feasible,
        slack=slack,
        tension_least=least,
        tension_most=most,
        condition=condition,
        clearances=near,
        clear=clear,
    )


def _statics(robot: CableRobot, poses: Poses, study: Study) -> tuple[NDArray[Any], ...]:
    """rank, kinematic, static, margin, feasible, slack, least and largest tension, condition."""
    low, high = robot.tension_min, robot.tension_max
    L, solution = jacobian(robot, poses), general_solution(robot, poses)
    box = study.disturbance(robot)
    disturbed = bool(np.any(box > 0.0))
    known = capability_of(robot, L, solution, pseudoinverse(L, solution), (low, high), box)
    static = known.static.copy()
    poor = ~known.full_rank
    if poor.any():
        static[poor] = static_stability(
            robot, Poses(poses.position[poor], poses.rotation[poor])
        ).stable
    margin = known.margin
    feasible = known.full_rank & (margin >= (1.0 if disturbed else 0.0))
    slack, least, most, condition = np.full((4, len(poses)), np.nan)
    if "tensions" in study.parts:
        within = np.zeros(len(poses), dtype=bool)
        for chosen, null_spaces in solution.by_rank():
            tensions, slack[chosen], within[chosen] = tension_methods.choose(
                study.tension_method, null_spaces, solution.shortest[chosen], low, high, BOUNDS_KEPT
            )
            least[chosen], most[chosen] = tensions.min(axis=1), tensions.max(axis=1)
        balanced = solution.residual <= BALANCED
        within &= balanced
        slack[~balanced] = -np.inf
        least[~within], most[~within] = np.nan, np.nan
        if not disturbed:  # poses without full rank can hang still, too
            feasible = within
    if "condition" in study.parts:
        scales = moment_scales(robot, characteristic_length(robot))
        values = np.linalg.svd(L / scales, compute_uv=False)
        condition = np.full(len(poses), np.inf)
        full = known.full_rank
        condition[full] = values[full, 0] / values[full, -1]
    return solution.rank, known.kinematic, static, margin, feasible, slack, least, most, condition


@dataclass(frozen=True, eq=False)
class Grid:
    """Places at the centres of equal cells of a block, at one orientation.

    Attributes:
        axes: centres along x, y and z, m. An axis with one is a slice's.
        sizes: of a cell, (3,) m; 0 along an axis with one centre.
        angles: (phi, theta, psi), rad.
    """

    axes: tuple[Array, Array, Array]
    sizes: Array
    angles: tuple[float, float, float]

    @property
    def shape(self) -> tuple[int, int, int]:
        x, y, z = self.axes
        return len(x), len(y), len(z)

    @property
    def poses(self) -> Poses:
        """One a cell; z varies fastest."""
        places = np.stack(np.meshgrid(*self.axes, indexing="ij"), axis=-1)
        return make_poses(places.reshape(-1, 3), self.angles)

    @property
    def cell(self) -> float:
        """A cell's volume, m3, or a slice's cell's area, m2."""
        return float(np.prod(self.sizes[self.sizes > 0.0]))

    def values(self, column: ArrayLike) -> Array:
        """A result's column as a block of the grid's shape."""
        return np.asarray(column).reshape(self.shape)

    def measure(self, mask: ArrayLike) -> float:
        """Volume of the cells where the mask holds, m3; of a slice the area, m2."""
        return self.cell * int(np.count_nonzero(np.asarray(mask)))

    def fraction(self, mask: ArrayLike) -> float:
        """Share of the cells where the mask holds."""
        return float(np.mean(np.asarray(mask, dtype=float)))


def make_grid(
    lower: ArrayLike,
    upper: ArrayLike,
    counts: tuple[int, int, int],
    angles: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Grid:
    """A grid of `counts` cells between two corners, (3,) m; where both are equal, a slice.

    Raises:
        InputError: corners that are not in order, or counts that are not positive.
    """
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    flat = low == high
    good = low.shape == high.shape == (3,) and bool(np.all(np.isfinite([low, high])))
    if not (good and np.all(low <= high) and np.sum(flat) < 3):
        raise InputError(f"grid from {low.tolist()} to {high.tolist()} m; must be a block or slice")
    numbers = np.array(counts)
    good = numbers.shape == (3,) and bool(np.all(numbers >= 1) and np.all(numbers[flat] == 1))
    require(good, "cells of a grid", list(counts), "three of 1 or more, and 1 where it is flat")
    sizes = (high - low) / numbers
    axes = [a + size * (np.arange(n) + 0.5) for a, size, n in zip(low, sizes, counts, strict=True)]
    return Grid((axes[0], axes[1], axes[2]), sizes, angles)
