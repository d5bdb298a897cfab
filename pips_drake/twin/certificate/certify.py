"""Certified clearance of a robot in a plant: to the scene around it, and to itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.errors import InputError
from pips_drake.twin.certificate.bodies import ConvexBody, read_shape, stack_shapes
from pips_drake.twin.certificate.problem import Problem
from pips_drake.twin.certificate.search import Certificate, certify
from pips_drake.twin.certificate.tree import FREE, ReadTree, read_tree

if TYPE_CHECKING:
    from pydrake.geometry import GeometryId, SceneGraphInspector
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import ModelInstanceIndex

Array = NDArray[np.float64]


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
        pairs: geometries to look at; all that can collide by default.

    Raises:
        InputError: shapes do not fit, a shape or a joint is of a kind that cannot be certified.
    """
    scene, own = read_problems(
        plant, inspector, robot, positions, times, deviation=deviation, pairs=pairs
    )
    return ClearanceCertificate(
        scene=certify(scene, tolerance=tolerance) if scene else None,
        own=certify(own, tolerance=tolerance) if own else None,
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
    knots, times_ = _check_motion(plant, positions, times)
    read = read_tree(plant, knots)
    off = np.broadcast_to(np.asarray(deviation, dtype=np.float64), knots.shape[1:]).copy()
    _check_deviation(read, off)
    # Which body a geometry belongs to, and whether that is the robot's.
    owner: dict[GeometryId, tuple[int, bool]] = {}
    names: dict[GeometryId, str] = {}
    for i in range(plant.num_bodies()):
        body = plant.get_body(_body_index(i))
        for geometry in plant.GetCollisionGeometriesForBody(body):
            owner[geometry] = (i, body.model_instance() in robot)
            names[geometry] = str(body.scoped_name())
    scene: list[tuple[GeometryId, GeometryId]] = []
    own: list[tuple[GeometryId, GeometryId]] = []
    candidates = inspector.GetCollisionCandidates() if pairs is None else pairs
    for first, second in sorted(candidates, key=lambda pair: tuple(g.get_value() for g in pair)):
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
    motion = (times_, knots, off)
    return _problem(scene, *placed, *motion), _problem(own, *placed, *motion)


def _problem(
    pairs: list[tuple[GeometryId, GeometryId]],
    inspector: SceneGraphInspector,
    owner: dict[GeometryId, tuple[int, bool]],
    names: dict[GeometryId, str],
    read: ReadTree,
    times: Array,
    knots: Array,
    deviation: Array,
) -> Problem | None:
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
    return Problem(
        tree=read.tree,
        shapes=stack_shapes(shapes),
        names=tuple(inspector.GetName(geometry) for geometry in rows),
        bodies=tuple(names[geometry] for geometry in rows),
        a=np.array(a, dtype=np.int64),
        b=np.array(b, dtype=np.int64),
        times=times,
        knots=knots,
        deviation=deviation,
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
