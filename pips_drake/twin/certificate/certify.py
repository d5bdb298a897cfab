"""Certified clearance of a robot in a plant: to the scene around it, and to itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.errors import InputError
from pips_drake.twin.certificate.bodies import ConvexBody, Shapes, read_shape, stack_shapes
from pips_drake.twin.certificate.problem import Problem, check_free_turns
from pips_drake.twin.certificate.search import Certificate, certify
from pips_drake.twin.certificate.sweep import make_sweep
from pips_drake.twin.certificate.tree import FREE, ReadTree, Tree, read_tree

if TYPE_CHECKING:
    from pydrake.geometry import GeometryId, SceneGraphInspector
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import ModelInstanceIndex

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True, eq=False)
class ClearanceCertificate:
    """What is proved of a robot's clearance over a motion.

    Attributes:
        scene: of the robot to everything else; None if no such pair can collide.
        own: of the robot to itself; None if no such pair can collide.
    """

    scene: Certificate | None
    own: Certificate | None


def certify_clearance(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    robot: Sequence[ModelInstanceIndex],
    positions: ArrayLike,
    times: ArrayLike | None = None,
    *,
    tolerance: float = 1e-4,
    deviation: ArrayLike | float = 0.0,
    enough: float = math.inf,
    pairs: Sequence[tuple[GeometryId, GeometryId]] | None = None,
) -> ClearanceCertificate:
    """Bounds a robot's clearance over every instant of a motion, from below and above.

    Between knots every joint is taken to move linearly; a free body (quaternion) slides and turns
    evenly, the shorter way. `deviation` allows for motion that does not.

    Args:
        plant: finalized, registered with a scene graph. Obstacles may move by joints too.
        inspector: of the scene graph: collision filters are those that it knows.
        robot: the robot's model instances, and those of what it carries; all else is the scene.
        positions: knots of the motion, (N, plant.num_positions()).
        times: of the knots, (N,) s, increasing; 0, 1, ... by default.
        tolerance: how near the bounds must come to each other, m.
        deviation: how far each position may be off at any instant, independently of the others,
            (plant.num_positions(),) or one number for all, m and rad.
        enough: a lower bound of this will do, m, however far the distance is above it.
        pairs: geometries to look at; all that can collide by default.

    Raises:
        InputError: shapes do not fit, a shape or a joint is of a kind that cannot be certified.
    """
    certifier = Certifier(plant, inspector, robot, pairs=pairs)
    return certifier.certify(
        positions, times, tolerance=tolerance, deviation=deviation, enough=enough
    )


def read_problems(
    plant: MultibodyPlant,
    inspector: SceneGraphInspector,
    robot: Sequence[ModelInstanceIndex],
    positions: ArrayLike,
    times: ArrayLike | None = None,
    *,
    deviation: ArrayLike | float = 0.0,
    pairs: Sequence[tuple[GeometryId, GeometryId]] | None = None,
) -> tuple[Problem | None, Problem | None]:
    """The problems of `certify_clearance`: robot to scene, and robot to robot."""
    return Certifier(plant, inspector, robot, pairs=pairs).problems(
        positions, times, deviation=deviation
    )


class Certifier:
    """Certifies one motion of a plant after another; what they have in common is read once.

    A planner that asks again and again builds one. It holds for the plant as it is: collision
    filters, shapes and bodies must not change afterwards.

    Args:
        plant, inspector, robot, pairs: as of `certify_clearance`.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        inspector: SceneGraphInspector,
        robot: Sequence[ModelInstanceIndex],
        *,
        pairs: Sequence[tuple[GeometryId, GeometryId]] | None = None,
    ) -> None:
        self._plant, self._inspector, self._robot = plant, inspector, robot
        self._pairs = inspector.GetCollisionCandidates() if pairs is None else pairs
        self._last: _ReadPlant | None = None

    def certify(
        self,
        positions: ArrayLike,
        times: ArrayLike | None = None,
        *,
        tolerance: float = 1e-4,
        deviation: ArrayLike | float = 0.0,
        enough: float = math.inf,
        own: bool = True,
    ) -> ClearanceCertificate:
        """Bounds the clearance over a motion: `certify_clearance`.

        Args:
            own: also of the robot to itself.

        Raises:
            InputError: as `certify_clearance`.
        """
        scene, own_ = self.problems(positions, times, deviation=deviation)
        problems = {"scene": scene, "own": own_ if own else None}
        for problem in problems.values():
            if problem is not None:
                check_free_turns(problem.tree, problem.knots)
        known = next((problem for problem in problems.values() if problem is not None), None)
        sweep = make_sweep(known.tree, known.knots) if known is not None else None
        found = {
            name: None
            if problem is None
            else certify(problem, tolerance=tolerance, enough=enough, sweep=sweep)
            for name, problem in problems.items()
        }
        return ClearanceCertificate(**found)

    def problems(
        self,
        positions: ArrayLike,
        times: ArrayLike | None = None,
        *,
        deviation: ArrayLike | float = 0.0,
    ) -> tuple[Problem | None, Problem | None]:
        """The problems of a motion: robot to scene, and robot to robot."""
        knots, times_ = _check_motion(self._plant, positions, times)
        if self._last is None or not self._last.fits(knots):
            self._last = self._read(knots)
        off = np.broadcast_to(np.asarray(deviation, dtype=np.float64), knots.shape[1:]).copy()
        _check_deviation(self._last.read, off)
        scene, own = (
            None if pairs is None else pairs.problem(self._last.read.tree, times_, knots, off)
            for pairs in (self._last.scene, self._last.own)
        )
        return scene, own

    def _read(self, knots: Array) -> _ReadPlant:
        plant, inspector = self._plant, self._inspector
        read = read_tree(plant, knots)
        # Which body a geometry belongs to, and whether that is the robot's.
        owner: dict[GeometryId, tuple[int, bool]] = {}
        names: dict[GeometryId, str] = {}
        for i in range(plant.num_bodies()):
            body = plant.get_body(_body_index(i))
            for geometry in plant.GetCollisionGeometriesForBody(body):
                owner[geometry] = (i, body.model_instance() in self._robot)
                names[geometry] = str(body.scoped_name())
        scene: list[tuple[GeometryId, GeometryId]] = []
        own: list[tuple[GeometryId, GeometryId]] = []
        for first, second in sorted(
            self._pairs, key=lambda pair: tuple(g.get_value() for g in pair)
        ):
            count = sum(geometry in owner and owner[geometry][1] for geometry in (first, second))
            for geometry in (first, second):
                if count and geometry not in owner:
                    raise InputError(
                        f"{inspector.GetName(geometry)} may collide with the robot and is not the "
                        "plant's; where it is over time is not known"
                    )
            if count == 1:
                scene.append((first, second) if owner[first][1] else (second, first))
            elif count == 2:
                # The one nearer to the base is the one that the other is seen from.
                inner = read.number[owner[first][0]] <= read.number[owner[second][0]]
                own.append((second, first) if inner else (first, second))
        placed = (inspector, owner, names, read)
        still = np.ones(knots.shape[1], dtype=np.bool_)
        for start, kind in zip(read.tree.start[1:], read.tree.kind[1:], strict=True):
            still[start : start + (7 if kind == FREE else 1)] = False
        return _ReadPlant(
            read=read,
            scene=_read_pairs(scene, *placed),
            own=_read_pairs(own, *placed),
            still=still,
            stand=knots[0, still],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pairs:
    """Pairs of shapes, whatever the motion; attributes as of `Problem`."""

    shapes: Shapes
    names: tuple[str, ...]
    bodies: tuple[str, ...]
    a: Indices
    b: Indices

    def problem(self, tree: Tree, times: Array, knots: Array, deviation: Array) -> Problem:
        return Problem(
            tree=tree,
            shapes=self.shapes,
            names=self.names,
            bodies=self.bodies,
            a=self.a,
            b=self.b,
            times=times,
            knots=knots,
            deviation=deviation,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _ReadPlant:
    """What is read of a plant.

    Attributes:
        still: positions that no joint of the tree takes, (nq,) bool.
        stand: where they are; another motion may have them elsewhere.
    """

    read: ReadTree
    scene: _Pairs | None
    own: _Pairs | None
    still: NDArray[np.bool_]
    stand: Array

    def fits(self, knots: Array) -> bool:
        """Whether a motion moves only what the tree moves."""
        return bool((knots[:, self.still] == self.stand).all())


def _read_pairs(
    pairs: list[tuple[GeometryId, GeometryId]],
    inspector: SceneGraphInspector,
    owner: dict[GeometryId, tuple[int, bool]],
    names: dict[GeometryId, str],
    read: ReadTree,
) -> _Pairs | None:
    if not pairs:
        return None
    rows: dict[GeometryId, int] = {}
    shapes: list[ConvexBody] = []
    for geometry in dict.fromkeys(geometry for pair in pairs for geometry in pair):
        body = owner[geometry][0]
        rows[geometry] = len(shapes)
        shapes.append(
            read_shape(
                inspector, geometry, read.number[body], read.rotation[body], read.origin[body]
            )
        )
    a, b = [], []
    for first, second in pairs:
        i, j = rows[first], rows[second]
        if shapes[i].half_space.any():
            i, j = j, i
        if shapes[i].half_space.any():
            raise InputError(
                f"{names[first]} and {names[second]} are both half spaces; they always overlap"
            )
        a.append(i)
        b.append(j)
    return _Pairs(
        shapes=stack_shapes(shapes),
        names=tuple(inspector.GetName(geometry) for geometry in rows),
        bodies=tuple(names[geometry] for geometry in rows),
        a=np.array(a, dtype=np.int64),
        b=np.array(b, dtype=np.int64),
    )


def _check_motion(
    plant: MultibodyPlant, positions: ArrayLike, times: ArrayLike | None
) -> tuple[Array, Array]:
    knots = np.ascontiguousarray(positions, dtype=np.float64)
    expected = plant.num_positions()
    if knots.ndim != 2 or knots.shape[1] != expected or not len(knots):
        raise InputError(f"positions of shape {knots.shape}; must be (N >= 1, {expected})")
    when = np.arange(len(knots), dtype=np.float64) if times is None else np.asarray(times, float)
    if when.shape != knots.shape[:1]:
        raise InputError(f"times of shape {when.shape}; must be ({len(knots)},)")
    require(bool(np.isfinite(knots).all()), "positions", "not finite", "finite numbers")
    good = np.isfinite(when).all() and (np.diff(when) > 0.0).all()
    require(bool(good), "times", "not increasing", "finite and increasing")
    if len(knots) == 1:
        # A posture is a motion that goes nowhere.
        return np.repeat(knots, 2, axis=0), np.array([when[0], when[0]])
    return knots, when


def _check_deviation(read: ReadTree, deviation: Array) -> None:
    good = np.isfinite(deviation).all() and (deviation >= 0.0).all()
    require(bool(good), "deviation", deviation.tolist(), "finite and >= 0")
    for start in read.tree.start[read.tree.kind == FREE].tolist():
        if deviation[start : start + 7].any():
            raise InputError("deviation of a free body's positions is not known; must be 0")


def _body_index(i: int) -> object:
    from pydrake.multibody.tree import BodyIndex

    return BodyIndex(i)
