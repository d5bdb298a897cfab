"""Task `statics`: poses, their stability with certificates, tensions and stiffness."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.cable_robot.configuration import CableRobotConfig
from pips_drake.cable_robot.kinematics import Poses, cable_lengths, jacobian, make_poses
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.runs.robot_figure import robot_figure
from pips_drake.cable_robot.runs.task import TaskResult
from pips_drake.cable_robot.scenario import CableRobotScenario
from pips_drake.cable_robot.stability import (
    KinematicStability,
    StaticStability,
    kinematic_stability,
    static_stability,
)
from pips_drake.cable_robot.statics import (
    GeneralSolution,
    TensionDistribution,
    characteristic_length,
    distribute_tensions,
    general_solution,
    moment_scales,
    total_wrench,
)
from pips_drake.cable_robot.stiffness import (
    StiffnessDirections,
    full_stiffness,
    stiffness_directions,
)
from pips_drake.errors import InputError
from pips_drake.twin.figures import save_figure
from pips_drake.twin.output_folder import write_whole
from pips_drake.twin.sheet import SheetPicture, SheetRow

Array = NDArray[np.float64]

#: Names of a twist's components, by freedom.
TWIST = ("x", "y", "z", "about x", "about y", "about z")


@dataclass(frozen=True, kw_only=True, eq=False)
class Statics:
    """What was found of N poses."""

    robot: CableRobot
    poses: Poses
    solution: GeneralSolution
    kinematic: KinematicStability
    static: StaticStability
    chosen: TensionDistribution
    directions: StiffnessDirections
    singular_values: Array


def prepare(
    scenario: CableRobotScenario, config: CableRobotConfig
) -> Callable[[Path, str], TaskResult]:
    """Checks poses and wrench; returns what does the task.

    Raises:
        InputError: a pose outside the robot's region, a wrench of another size.
    """
    asked = scenario.statics
    robot = config.robot()
    poses = make_poses(
        [pose.position_m for pose in asked.poses],
        np.radians([pose.angles_deg for pose in asked.poses]),
    )
    config.require_inside(poses)
    jacobian(robot, poses)  # a cable without length has no direction
    wrench = asked.wrench_N or None
    if wrench is not None and len(wrench) != robot.freedom:
        raise InputError(
            f"statics.wrench_N = {len(wrench)} numbers; must be {robot.freedom} for {robot.name}"
        )
    total_wrench(robot, poses, wrench)
    length = asked.length_m or characteristic_length(robot)

    def work(folder: Path, name: str) -> TaskResult:
        found = analyse(robot, poses, wrench=wrench, method=asked.method, length=length)
        return _write(folder, name, scenario, found)

    return work


def analyse(
    robot: CableRobot, poses: Poses, *, wrench: list[float] | None, method: str, length: float
) -> Statics:
    """Stability, tensions and stiffness of N poses.

    Args:
        wrench: on the platform beside its weight, (freedom,) N and N m.
        method: of `statics.distribute_tensions`.
        length: what rotations are multiplied by where stiffnesses are compared, m.
    """
    chosen = distribute_tensions(robot, poses, method, wrench=wrench)
    K = full_stiffness(robot, poses, np.maximum(chosen.tensions, 0.0))
    scaled = jacobian(robot, poses) / moment_scales(robot, characteristic_length(robot))
    return Statics(
        robot=robot,
        poses=poses,
        solution=general_solution(robot, poses, wrench),
        # Its certificates are the plainest motions: those that shorten cables most.
        kinematic=kinematic_stability(robot, poses, "motion"),
        static=static_stability(robot, poses, wrench),
        chosen=chosen,
        directions=stiffness_directions(robot, K, length),
        singular_values=np.linalg.svd(scaled, compute_uv=False),
    )


def _write(folder: Path, name: str, scenario: CableRobotScenario, found: Statics) -> TaskResult:
    _write_cables(folder / "cables.csv", found)
    failures = _judge(scenario, found)
    pictures = []
    for pose in range(min(len(found.poses), 3)):
        file = folder / "figures" / f"pose_{pose + 1}.png"
        words = "stable" if found.static.stable[pose] else "not statically stable"
        figure = robot_figure(
            found.robot,
            found.poses,
            pose,
            tensions=found.chosen.tensions[pose],
            motion=found.kinematic.motion[pose],
            title=f"{name}, pose {pose + 1}: {words}",
        )
        save_figure(figure, file)
        pictures.append(SheetPicture(file=file, caption=f"pose {pose + 1} and its cables"))
    poses = [_numbers(found, pose) for pose in range(len(found.poses))]
    worst = int(np.argmin(found.chosen.slack))
    numbers: dict[str, Any] = {
        "method": found.chosen.method,
        "poses": poses,
        "tension_slack_min_N": found.chosen.slack[worst],
        "tension_residual_max": found.chosen.residual.max(),
        "stiffness_length_m": found.directions.length,
        "statically_stable": bool(found.static.stable.all()),
        "kinematically_stable": bool(found.kinematic.stable.all()),
    }
    count = len(found.poses)
    lead = (
        f"{count} pose{'s' * (count > 1)}: {int(found.kinematic.stable.sum())} kinematically and "
        f"{int(found.static.stable.sum())} statically stable"
    )
    return TaskResult(
        numbers=numbers,
        failures=failures,
        lead=lead,
        rows=_rows(found, worst),
        pictures=pictures,
    )


def _judge(scenario: CableRobotScenario, found: Statics) -> list[str]:
    checks = scenario.checks
    failures = []
    for pose in range(len(found.poses)):
        where = f"pose {pose + 1}"
        if bool(found.static.stable[pose]) != checks.statically_stable:
            slack = found.static.slack[pose]
            failures.append(
                f"{where} is not statically stable: a cable would have to push, by {-slack:.3g} N"
                if checks.statically_stable and np.isfinite(slack)
                else f"{where}: no tensions of any sign balance the load"
                if checks.statically_stable
                else f"{where} is statically stable, and should not be"
            )
        asked = checks.kinematically_stable
        if asked != "none" and bool(found.kinematic.stable[pose]) != (asked == "true"):
            failures.append(
                f"{where} is not kinematically stable: the motion in summary.json makes cables "
                "shorter and none longer"
                if asked == "true"
                else f"{where} is kinematically stable, and should not be"
            )
        if checks.within_bounds and checks.statically_stable and not found.chosen.feasible[pose]:
            failures.append(
                f"{where}: no tensions within {found.robot.tension_min:g} .. "
                f"{found.robot.tension_max:g} N hold it; they miss by "
                f"{-found.chosen.slack[pose]:.3g} N"
            )
    return failures


def _numbers(found: Statics, pose: int) -> dict[str, Any]:
    shown: dict[str, Any] = {
        "position_m": found.poses.position[pose],
        "rank": int(found.solution.rank[pose]),
        "kinematically_stable": bool(found.kinematic.stable[pose]),
        "statically_stable": bool(found.static.stable[pose]),
        "static_slack_N": found.static.slack[pose],
        "shortest_tensions_N": found.solution.shortest[pose],
        "null_space": found.solution.null_space(pose).T,
        "tensions_N": found.chosen.tensions[pose],
        "within_bounds": bool(found.chosen.feasible[pose]),
        "tension_slack_N": found.chosen.slack[pose],
        "stiffness_N_m": found.directions.values[pose],
        "softest_twist": found.directions.softest[pose],
        "stiffest_twist": found.directions.stiffest[pose],
        "jacobian_singular_values": found.singular_values[pose],
    }
    if found.kinematic.stable[pose]:
        shown["certificate_tension"] = found.kinematic.tension[pose]
    else:
        shown["certificate_motion"] = found.kinematic.motion[pose]
    return shown


def _write_cables(file: Path, found: Statics) -> None:
    lengths = cable_lengths(found.robot, found.poses)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["pose", "cable", "length_m", "tension_N", "shortest_solution_N"])
    for pose in range(len(found.poses)):
        for cable in range(found.robot.cables):
            values = (
                lengths[pose, cable],
                found.chosen.tensions[pose, cable],
                found.solution.shortest[pose, cable],
            )
            writer.writerow([pose + 1, cable + 1, *(f"{value + 0.0:.9g}" for value in values)])
    write_whole(file, text.getvalue())


def _rows(found: Statics, worst: int) -> list[SheetRow]:
    robot, chosen = found.robot, found.chosen
    low, high = chosen.tensions[worst].min(), chosen.tensions[worst].max()
    softest = found.directions.softest[worst]
    names = [TWIST[component] for component in robot.freedoms]
    main = names[int(np.argmax(np.abs(softest * moment_scales(robot, found.directions.length))))]
    slack = chosen.slack[worst]
    return [
        SheetRow(label="cables, freedoms", value=f"{robot.cables}, {robot.freedom}"),
        SheetRow(label=f"tensions ({chosen.method.replace('_', ' ')})",
                 value=f"{low:.4g} .. {high:.4g} N",
                 allowed=f"{robot.tension_min:g} .. {robot.tension_max:g} N",
                 good=bool(chosen.feasible[worst])),
        SheetRow(label="room that the bounds leave, least", value=f"{slack:.4g} N",
                 allowed=">= 0", good=bool(slack >= 0.0)),
        SheetRow(label="left over by the tensions", value=f"{chosen.residual.max():.1e}",
                 allowed="of the load"),
        SheetRow(label=f"softest, mostly {main}",
                 value=f"{found.directions.values[worst, 0]:.4g} N/m"),
        SheetRow(label="stiffest", value=f"{found.directions.values[worst, -1]:.4g} N/m"),
        SheetRow(label="rotations count as arcs of", value=f"{found.directions.length:.3g} m"),
        SheetRow(label="pose shown", value=f"{worst + 1}", allowed="the one of least slack"),
    ]  # fmt: skip
