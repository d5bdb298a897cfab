"""The cable robot: tensions of many poses at once, and a study of where it can be."""

from __future__ import annotations

import importlib
import importlib.util
import itertools
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from benchmarks.measuring import Array, Line, measure_in_turn
from pips_drake.cable_robot.cablings import DISTURBANCE, bay_obstacles
from pips_drake.cable_robot.configuration import load_robot
from pips_drake.cable_robot.kinematics import Poses, make_poses
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import (
    characteristic_length,
    distribute_tensions,
    structure_matrix,
    total_wrench,
)
from pips_drake.cable_robot.workspace import Study, sweep

SEED = 1996
ROBOT = "radiator_crossed"
#: A study of 100,000 poses takes no longer than 5 s; a second is aimed for. Per pose, us.
LIMIT, AIM = 50.0, 10.0


def measure(*, quick: bool) -> list[Line]:
    """Microseconds a pose."""
    robot = load_robot(ROBOT).robot()
    return [*measure_tensions(robot, quick=quick), measure_sweep(robot, quick=quick)]


def measure_tensions(robot: CableRobot, *, quick: bool) -> list[Line]:
    """Least-norm tensions of poses in a batch, beside a solver that is called pose by pose."""
    count, rounds = (30, 2) if quick else (20_000, 7)
    poses = some_poses(count)
    A, w = structure_matrix(robot, poses), total_wrench(robot, poses)
    # The loops take some of the poses: their time per pose does not depend on how many.
    some = slice(None, None, 1 if quick else 10)
    ours = distribute_tensions(robot, poses, "least_norm")

    def batch() -> float:
        distribute_tensions(robot, poses, "least_norm")
        return count

    lines = []
    for name, solve in solvers().items():
        one = partial(loop, solve, robot, A[some], w[some])
        theirs = one()
        seconds = measure_in_turn({"ours": batch, "theirs": lambda f=one: len(f())}, rounds=rounds)
        both = ours.feasible[some] & np.isfinite(theirs[:, 0])
        apart = np.abs(ours.tensions[some] - theirs)[both]
        lines.append(
            Line(
                name=f"cable_tensions_{name}",
                what=f"Least-norm tensions of {count:,} poses, eight cables",
                ours=1e6 * seconds["ours"],
                peer=1e6 * seconds["theirs"],
                unit="us a pose",
                beside=f"{name} called pose by pose from Python",
                limits="Decomposition and two small programs a pose, compiled, on one core",
                agreement={
                    "tensions apart at most (N)": float(apart.max()),
                    "feasible for one of them alone": float(
                        np.sum(ours.feasible[some] != np.isfinite(theirs[:, 0]))
                    ),
                    "feasible": float(ours.feasible.mean()),
                },
            )
        )
    return lines


def measure_sweep(robot: CableRobot, *, quick: bool) -> Line:
    """A study's statics, beside numpy pose by pose; and all of it, with doors and bay, once."""
    count, rounds = (40, 2) if quick else (100_000, 5)
    poses = some_poses(count)
    force, moment = DISTURBANCE
    asked = {"disturbance_force": force, "disturbance_moment": moment}
    study = Study(**asked, parts=["condition"])
    whole = Study(**asked, obstacles=bay_obstacles())
    few = Poses(*(part[:: 1 if quick else 200] for part in (poses.position, poses.rotation)))
    ours, theirs = sweep(robot, few, study), plain_sweep(robot, few, study)

    def batch() -> float:
        sweep(robot, poses, study)
        return count

    def plain() -> float:
        plain_sweep(robot, few, study)
        return len(few)

    seconds = measure_in_turn({"ours": batch, "theirs": plain}, rounds=rounds)
    sweep(robot, few, whole)
    began = time.thread_time()
    found = sweep(robot, poses, whole)
    everything = time.thread_time() - began
    margins, conditions, kinematic = theirs
    return Line(
        name="cable_workspace",
        what=f"Study of {count:,} poses: rank, condition, stability, and whether the weight and "
        "every wrench of a box are borne within the bounds",
        ours=1e6 * seconds["ours"],
        peer=1e6 * seconds["theirs"],
        unit="us a pose",
        beside="the same in numpy, pose by pose, the 56 faces of a pose at once",
        value_aim=LIMIT,
        limits="Faces of the wrench set and numpy's decompositions, on one core; "
        f"{AIM:g} us would be a second for 100,000 poses",
        agreement={
            "margin apart at most (of the box)": float(np.abs(margins - ours.margin).max()),
            "condition apart at most (relative)": float(
                np.abs(conditions / ours.condition - 1.0).max()
            ),
            "stability that differs": float(np.sum(kinematic != ours.kinematic)),
            "us a pose, with tensions and distances to 17 boxes": 1e6 * everything / count,
            "usable": float(found.usable.mean()),
        },
    )


def some_poses(count: int) -> Poses:
    """Level poses between and beyond the posts, from the panels' outer edges to the anchors."""
    rng = np.random.default_rng(SEED)
    return make_poses(rng.uniform([-11.5, -7.5, -1.0], [11.5, 7.5, 5.5], (count, 3)))


Solver = Callable[[Array, Array, float, float], Array | None]


def solvers() -> dict[str, Solver]:
    """Those that are installed; Clarabel comes with Drake."""
    found: dict[str, Solver] = {"clarabel": by_clarabel}
    if importlib.util.find_spec("quadprog"):
        found["quadprog"] = by_quadprog
    return found


def loop(solve: Solver, robot: CableRobot, A: Array, w: Array) -> Array:
    """Tensions (N, M), nan where the solver finds none."""
    tensions = np.full((len(A), robot.cables), np.nan)
    for n in range(len(A)):
        found = solve(A[n], w[n], robot.tension_min, robot.tension_max)
        if found is not None:
            tensions[n] = found
    return tensions


def by_clarabel(A: Array, w: Array, low: float, high: float) -> Array | None:
    """Least |T|^2 with A T = -w within bounds."""
    program = MathematicalProgram()
    T = program.NewContinuousVariables(A.shape[1])
    program.AddQuadraticCost(np.eye(len(T)), np.zeros(len(T)), T)
    program.AddLinearEqualityConstraint(A, -w, T)
    program.AddBoundingBoxConstraint(low, high, T)
    result = ClarabelSolver().Solve(program)
    return np.asarray(result.GetSolution(T)) if result.is_success() else None


def by_quadprog(A: Array, w: Array, low: float, high: float) -> Array | None:
    """The same by Goldfarb and Idnani's method."""
    quadprog: Any = importlib.import_module("quadprog")
    eye = np.eye(A.shape[1])
    sides = np.concatenate([-w, np.full(len(eye), low), np.full(len(eye), -high)])
    normals = np.vstack([A, eye, -eye]).T.copy()
    try:
        return np.asarray(quadprog.solve_qp(eye, np.zeros(len(eye)), normals, sides, len(w))[0])
    except ValueError:  # "constraints are inconsistent, no solution"
        return None


def plain_sweep(robot: CableRobot, poses: Poses, study: Study) -> tuple[Array, Array, Array]:
    """Margin, condition and kinematic stability of every pose, as one would write it first.

    Eight cables in space: two dimensions of null vectors, so that faces are cross products.
    """
    low, high = robot.tension_min, robot.tension_max
    box = study.disturbance(robot)
    triples = np.array(list(itertools.combinations(range(robot.cables), 3)))
    length = characteristic_length(robot)
    scales = np.array([1.0, 1.0, 1.0, length, length, length])
    margins, conditions = np.empty(len(poses)), np.empty(len(poses))
    stable = np.empty(len(poses), dtype=bool)
    for n in range(len(poses)):
        arms = robot.attachments @ poses.rotation[n].T
        vectors = robot.anchors - poses.position[n] - arms
        units = vectors / np.linalg.norm(vectors, axis=1)[:, None]
        L = np.hstack([-units, np.cross(units, arms)])
        left, values, right = np.linalg.svd(L / scales)
        conditions[n] = values[0] / values[-1]
        inverse = (left[:, :6] / values) @ right / scales
        N = left[:, 6:]
        weight = robot.mass * robot.gravity
        w = np.concatenate([weight, np.cross(poses.rotation[n] @ robot.centre_of_mass, weight)])
        a, b, c = N[triples[:, 0]], N[triples[:, 1]], N[triples[:, 2]]
        y = np.zeros((len(triples), robot.cables))
        rows = np.arange(len(triples))
        for k, (p, q) in enumerate(((b, c), (c, a), (a, b))):
            y[rows, triples[:, k]] = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
        y = np.vstack([y, -y])
        room = (np.maximum(y, 0.0) * high + np.minimum(y, 0.0) * low).sum(axis=1) - y @ inverse @ w
        margins[n] = (room / (np.abs(y @ inverse) @ box)).min()
        stable[n] = not np.any(np.all(y >= -1e-12, axis=1))
    return margins, conditions, stable
