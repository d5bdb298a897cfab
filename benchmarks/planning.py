"""The planner's parts: grid search beside scikit-image, a snake's step beside general solvers."""

from __future__ import annotations

import contextlib
from functools import partial
from typing import Any

import numpy as np
from pydrake.geometry import Box
from pydrake.math import RigidTransform
from scipy.linalg import solve
from scipy.sparse import csc_array
from scipy.sparse.linalg import spsolve

from benchmarks.insertion import Judge, scenario_of
from benchmarks.measuring import Array, Line, measure_in_turn
from pips_drake.planning.grid import Grid
from pips_drake.planning.grid_search import NoPathError, find_path
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.potential_field import Repulsion
from pips_drake.planning.runs.motion import plan_motion
from pips_drake.planning.runs.prover import Prover
from pips_drake.planning.runs.workspace import Workspace, load_workspace
from pips_drake.planning.scenario import goal_point
from pips_drake.planning.snake import Snake, SnakeSettings, make_snake, move_goal
from pips_drake.planning.snake_motion import Settled, settle
from pips_drake.planning.string_pull import pull
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import PlacedShape, read_distance_field

#: Of the bay that begins at z = 0: a point at its port, and one behind the payload, m.
PORT, BEHIND = [2.03, 0.0, 0.3], [-2.04, 0.0, 12.0]
#: How far a goal is moved, m.
MOVED = 0.02
#: Of a snake whose step is timed.
POINTS = 200


def measure(*, quick: bool) -> list[Line]:
    """Times of the planner's parts, and of all of them together."""
    rounds = 2 if quick else 7
    return [*_searches(quick, rounds), *_steps(quick, rounds), *_plans(quick, rounds)]


def _searches(quick: bool, rounds: int) -> list[Line]:
    """Queries that have an answer, and one that has none, in the whole bay."""
    from skimage.graph import MCP_Geometric

    counts = (30, 30, 100) if quick else (120, 120, 400)
    field = read_distance_field(
        find_scene_file("cargo_bay"), placed_frames={"frame_0": RigidTransform([1.621, 0, -4.695])}
    )
    grid = Grid(lower=[-2.29, -2.29, 0.0], upper=[2.29, 2.29, 18.288], shape=counts)
    occupancy = Occupancy.of(field, grid, 0.1)
    dam = PlacedShape("dam", "", Box(5.0, 5.0, 0.4), RigidTransform([0.0, 0.0, 10.0]))
    blocked = Occupancy.of(field.with_shapes([dam]), grid, 0.1)
    ends = [tuple(cell) for cell in grid.cells([PORT, BEHIND]).tolist()]
    found: dict[str, float] = {}

    def ours(name: str, cells: Occupancy) -> float:
        found[name] = np.inf
        with contextlib.suppress(NoPathError):
            found[name] = find_path(cells, *(grid.centres(np.array([end]))[0] for end in ends)).cost
        return 1.0

    def theirs(name: str, cells: Occupancy) -> float:
        # Built anew as a query of ours is: it keeps what it found before.
        prices = np.where(cells.free, 1.0, -1.0)
        search = MCP_Geometric(prices, fully_connected=True, sampling=tuple(grid.spacing.tolist()))
        costs, _ = search.find_costs([ends[0]], [ends[1]], find_all_ends=False)
        found[name] = float(costs[ends[1]])
        return 1.0

    seconds = measure_in_turn(
        {
            "ours": lambda: ours("ours", occupancy),
            "theirs": lambda: theirs("theirs", occupancy),
            "ours in vain": lambda: ours("ours in vain", blocked),
            "theirs in vain": lambda: theirs("theirs in vain", blocked),
        },
        rounds=min(rounds, 3),
    )
    if np.isfinite([found["ours in vain"], found["theirs in vain"]]).any():
        raise RuntimeError("there is a way through a closed dam")
    what = f"Grid search in the bay, {' x '.join(map(str, counts[::-1]))} cells"
    line = partial(Line, unit="s", beside="scikit-image MCP_Geometric (Dijkstra, Cython)")
    return [
        line(
            name="search",
            what=f"{what}: a way behind the payload",
            ours=seconds["ours"],
            peer=seconds["theirs"],
            value_aim=0.2,
            limits="Cells that A* opens, and the memory that they are in",
            agreement={"costs apart (m)": abs(found["ours"] - found["theirs"])},
        ),
        line(
            name="search_in_vain",
            what=f"{what}: no way, and what is in it",
            ours=seconds["ours in vain"],
            peer=seconds["theirs in vain"],
            value_aim=2.0,
            limits="All cells before the dam are visited; the peer does not say what blocks",
        ),
    ]


def _steps(quick: bool, rounds: int) -> list[Line]:
    """A snake's step in the field of two cylinders, and its equations solved by others."""
    steps = 5 if quick else 200
    repulsion = Repulsion(strength=0.1, reach=0.3, clamp=0.03)
    angle = np.linspace(0.0, 2.4, 4 * POINTS)
    path = np.stack([1.9 * np.cos(angle), 1.9 * np.sin(angle), np.linspace(0, 6, 4 * POINTS)], -1)
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    settings = SnakeSettings(
        bending_stiffness=0.3, spacing=length / (POINTS - 1) * (1 + 1e-9), spacing_band=(0.2, 5.0)
    )
    snake = make_snake(path, settings)
    assert len(snake.points) == POINTS

    def gap(points: Array) -> tuple[Array, Array]:
        r = np.hypot(points[:, 0], points[:, 1])
        outward = np.zeros_like(points)
        outward[:, :2] = points[:, :2] / r[:, None]
        return np.stack([r - 1.8, 2.286 - r], axis=-1), np.stack([outward, -outward], axis=1)

    def ours() -> float:
        return settle(snake, gap, repulsion, max_steps=steps, tolerance=0.0).steps

    matrix, right = _equations(snake)
    sparse = csc_array(matrix)

    def dense() -> float:
        for _ in range(max(1, steps // 10)):
            solve(matrix, right, assume_a="pos", check_finite=False)
        return max(1, steps // 10)

    def by_sparse() -> float:
        for _ in range(steps):
            spsolve(sparse, right)
        return steps

    times = measure_in_turn({"ours": ours, "dense": dense, "sparse": by_sparse}, rounds=rounds)
    line = partial(
        Line,
        what=f"A snake's step, {POINTS} points, two walls",
        ours=1e6 * times["ours"],
        unit="us",
        value_aim=150.0,
        limits="Numpy's calls on small arrays: field, force, stiffness and energy; then the factor",
    )
    return [
        line(
            name="snake_dense",
            beside="LAPACK's dense Cholesky, of equations that are given",
            peer=1e6 * times["dense"],
        ),
        line(
            name="snake_sparse",
            beside="SuperLU (scipy spsolve), of equations that are given",
            peer=1e6 * times["sparse"],
        ),
    ]


def _equations(snake: Snake) -> tuple[Array, Array]:
    """A matrix of a step's size and structure, and a right side: bending, tension, and a gain."""
    n, h = len(snake.points), snake.settings.spacing
    first, second = np.diff(np.eye(n), axis=0), np.diff(np.eye(n), n=2, axis=0)
    stiffness = snake.tension[0] * first.T @ first / h**2
    stiffness += snake.bending_stiffness[0] * second.T @ second / h**4
    matrix = np.kron(stiffness, np.eye(3)) + 10.0 * np.eye(3 * n)
    return matrix, matrix @ snake.points.ravel()


def _plans(quick: bool, rounds: int) -> list[Line]:
    """From a goal behind the payload to a snake at rest, and to a certified motion."""
    scenario = scenario_of("behind")
    workspace = load_workspace(scenario)
    goal = np.array(goal_point(scenario, scenario.goals[0]))
    rested = _rest(workspace, goal, None)
    if not rested.stable:
        raise RuntimeError("the snake behind the payload does not come to rest")
    aside = goal + MOVED * np.array([0.0, 0.0, 1.0])
    again: dict[str, Any] = {}

    def to_rest() -> float:
        _rest(workspace, goal, None)
        return 1.0

    def moved() -> float:
        again["settled"] = _rest(workspace, aside, rested.snake)
        return 1.0

    times = measure_in_turn({"rest": to_rest, "moved": moved}, rounds=rounds)
    prover, found = Prover(scenario, workspace), []

    def certified() -> float:
        found.append(plan_motion(scenario, workspace, judge=prover))
        return 1.0

    def from_files() -> float:
        anew = load_workspace(scenario)
        found.append(plan_motion(scenario, anew))
        return 1.0

    both = measure_in_turn(
        {"certified": certified, "from files": from_files}, rounds=2 if quick else 5
    )
    if any(one.failures for one in found):
        raise RuntimeError(f"there is no plan behind the payload: {found[0].failures}")
    verdict = Judge(scenario, found[-1].plans[0].points).verdict(found[-1].plans[0].plan.joints)
    agreement = {
        "clearance, proved (mm)": verdict["clearance_mm"],
        "certified (1: yes)": float(verdict["certified"]),
    }
    return [
        Line(
            name="a_star_to_rest",
            what=f"Search, string and snake to rest, {len(rested.snake.points)} points",
            ours=times["rest"],
            unit="s",
            value_aim=1.0,
            limits=f"{rested.steps} steps, each asks for the distances of all shapes",
        ),
        Line(
            name="goal_moved",
            what=f"A goal is moved by {1e3 * MOVED:g} mm: the snake to rest again",
            ours=1e3 * times["moved"],
            unit="ms",
            value_aim=33.0,
            limits=f"{again['settled'].steps} steps",
        ),
        Line(
            name="goal_to_certified",
            what="reach_behind_payload: goal to certified motion, scene and plant at hand",
            ours=both["certified"],
            unit="s",
            value_aim=1.0,
            limits="Paths of other homotopy, then the certificate: 20 links, 84 shapes",
            agreement=agreement,
        ),
        Line(
            name="files_to_certified",
            what="reach_behind_payload: files to certified motion",
            ours=both["from files"],
            unit="s",
            limits="The same, and reading the scene, its cells, and building the plant",
        ),
    ]


def _rest(workspace: Workspace, goal: Array, snake: Snake | None) -> Settled:
    """A snake at rest with its end at a goal, begun on the string of a search or as it lies."""
    occupancy, settings = workspace.occupancy, workspace.settings
    if snake is None:
        start = workspace.home_tip + np.array([0.0, 0.0, settings.lead])
        found = find_path(occupancy, start, goal)
        snake = make_snake(pull(occupancy.field, found.points, occupancy.radius), settings.snake)
    snake = move_goal(snake, goal)

    def distances(points: Array) -> tuple[Array, Array]:
        reach = settings.repulsion.reach
        return occupancy.field.blended(points, blend=settings.blend, within=reach)

    return settle(snake, distances, settings.repulsion)
