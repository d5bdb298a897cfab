"""Task `workspace`: CABLE-96's design questions, answered for a robot over the payload bay.

How large is the workspace, what tension do the cables need, how accurate are pose and picture, how
stiff is it and what moment does it bear, and what should the cables be made of.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.cable_robot.accuracy import PoseErrors, pose_errors, step_motions
from pips_drake.cable_robot.cablings import (
    CablingRow,
    bay_obstacles,
    best_cabling,
    compare_cablings,
    survey_poses,
)
from pips_drake.cable_robot.capability import (
    Capability,
    MatrixDirections,
    jacobian_directions,
    wrench_capability,
)
from pips_drake.cable_robot.configuration import CableRobotConfig
from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.materials import (
    MaterialRow,
    compare_materials,
    recommend_material,
    rope_need,
)
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.runs.cabling_figures import (
    cabling_plans_figure,
    cablings_figure,
    materials_figure,
)
from pips_drake.cable_robot.runs.task import TaskResult
from pips_drake.cable_robot.runs.workspace_figures import QUANTITIES, map_figure, volume_figure
from pips_drake.cable_robot.scenario import CableRobotScenario
from pips_drake.cable_robot.statics import characteristic_length, distribute_tensions
from pips_drake.cable_robot.stiffness import (
    StiffnessDirections,
    full_stiffness,
    stiffness_directions,
)
from pips_drake.cable_robot.survey_camera import STANDOFF, SurveyCamera
from pips_drake.cable_robot.workspace import Study, WorkspaceResult, sweep
from pips_drake.errors import InputError
from pips_drake.twin.output_folder import write_whole
from pips_drake.twin.sheet import SheetPicture, SheetRow

Array = NDArray[np.float64]

TWIST = ("x", "y", "z", "about x", "about y", "about z")


@dataclass(frozen=True, kw_only=True, eq=False)
class WorkingPoses:
    """What was found at the poses of a survey's work.

    Attributes:
        poses: views of all panels, and the way over the bay.
        result: of the sweep with the disturbances and the bay.
        tensions: least norm, (N, M) N.
        errors: of pose and looked-at point for the length error.
        steps: motion of one encoder step, (N, M) m.
        directions: of the full stiffness.
        capability: forces and moments that are borne besides the weight.
        flimsy: SVD of L.
    """

    poses: Poses
    result: WorkspaceResult
    tensions: Array
    errors: PoseErrors
    steps: Array
    directions: StiffnessDirections
    capability: Capability
    flimsy: MatrixDirections


def prepare(
    scenario: CableRobotScenario, config: CableRobotConfig
) -> Callable[[Path, str], TaskResult]:
    """Checks that there is something to study; returns what does it.

    Raises:
        InputError: a planar robot, or one without a box, which has no clearance.
    """
    if config.planar:
        raise InputError(f"{config.name}: a planar robot; this study is of one over the bay")
    config.require_box()
    robot = config.robot()
    asked = scenario.workspace

    def work(folder: Path, name: str) -> TaskResult:
        study = Study(
            disturbance_force=asked.disturbance_force_N,
            disturbance_moment=asked.disturbance_moment_N_m,
            obstacles=bay_obstacles(),
            least_clearance=1e-3 * scenario.checks.clearance_min_mm,
        )
        figures = folder / "figures"
        volumes = volume_figure(figures / "volume.png", robot, study=study, cells=asked.cell_m)
        for quantity in QUANTITIES:
            map_figure(figures / f"{quantity}.png", robot, quantity, study=study,
                       cells=0.5 * asked.cell_m)  # fmt: skip
        found = study_work(config, robot, study)
        materials = compare_materials(
            rope_need(robot, found.poses, found.tensions), robot, found.poses
        )
        materials_figure(figures / "materials.png", materials)
        _write_materials(folder / "materials.csv", materials)
        cablings = compare_cablings(robot) if asked.compare_cablings else []
        if cablings:
            cablings_figure(figures / "cablings.png", cablings)
            cabling_plans_figure(figures / "cabling_plans.png", cablings)
            _write_cablings(folder / "cablings.csv", cablings)
        numbers = _numbers(config, robot, found, volumes, materials, cablings)
        failures = _judge(scenario, robot, found)
        shown = ("volume", "accuracy", "cablings" if cablings else "materials")
        return TaskResult(
            numbers=numbers,
            failures=failures,
            lead=f"{numbers['volume_usable_m3']:.0f} m3 can be used; of {len(found.poses)} poses "
            f"of a survey {100.0 * numbers['work_usable_share']:.1f} %",
            rows=_rows(scenario, numbers),
            pictures=[
                SheetPicture(file=figures / f"{picture}.png", caption=picture) for picture in shown
            ],
        )

    return work


def study_work(config: CableRobotConfig, robot: CableRobot, study: Study) -> WorkingPoses:
    """Everything about the poses of a survey's work."""
    poses, _ = survey_poses()
    winch = config.winch
    chosen = distribute_tensions(robot, poses, "least_norm")
    tensions = np.maximum(chosen.tensions, 0.0)
    look = STANDOFF - SurveyCamera().mount[2]
    K = full_stiffness(robot, poses, tensions)
    step = 1e-3 * (winch.encoder_step_mm or 1e-6)
    return WorkingPoses(
        poses=poses,
        result=sweep(robot, poses, study),
        tensions=tensions,
        errors=pose_errors(robot, poses, 1e-3 * winch.length_error_mm, arm=[0.0, 0.0, -look]),
        steps=step_motions(robot, poses, step)[0],
        directions=stiffness_directions(robot, K, characteristic_length(robot)),
        capability=wrench_capability(robot, poses),
        flimsy=jacobian_directions(robot, poses),
    )


def _numbers(
    config: CableRobotConfig,
    robot: CableRobot,
    found: WorkingPoses,
    volumes: dict[str, float],
    materials: list[MaterialRow],
    cablings: list[CablingRow],
) -> dict[str, Any]:
    result = found.result
    near = result.clearances
    assert near is not None
    weakest = int(np.argmin(found.directions.values[:, 0]))
    twist = found.directions.softest[weakest] * _arc_scales(found.directions.length)
    best = recommend_material(materials)
    numbers: dict[str, Any] = {
        "volumes_m3": volumes,
        "volume_usable_m3": volumes["usable"],
        "work_poses": len(found.poses),
        "work_usable_share": float(result.usable.mean()),
        "work_feasible_share": float(result.feasible.mean()),
        "work_kinematically_stable_share": float(result.kinematic.mean()),
        "work_statically_stable_share": float(result.static.mean()),
        "disturbance_margin": float(result.margin.min()),
        "tension_min_N": float(found.tensions.min()),
        "tension_max_N": float(found.tensions.max()),
        "clearance_sampled_min_m": float(near.least.min()),
        "length_error_m": 1e-3 * config.winch.length_error_mm,
        "position_error_max_m": float(found.errors.position.max()),
        "rotation_error_max_rad": float(found.errors.rotation.max()),
        "picture_error_max_m": float(found.errors.point.max()),
        "encoder_step_m": 1e-3 * config.winch.encoder_step_mm,
        "encoder_step_moves_max_m": float(found.steps.max()),
        "stiffness": "full (with least-norm tensions)",
        "stiffness_length_m": found.directions.length,
        "stiffness_softest_N_m": float(found.directions.values[weakest, 0]),
        "stiffness_softest_mostly": TWIST[int(np.argmax(np.abs(twist)))],
        "stiffness_stiffest_N_m": float(found.directions.values[:, -1].max()),
        "jacobian_condition_max": float(found.flimsy.condition.max()),
        "force_borne_min_N": float(found.capability.force.min()),
        "moment_borne_min_N_m": float(found.capability.moment.min()),
        "material_recommended": best.material.name,
        "material_length_error_m": best.length_error,
    }
    if cablings:
        chosen = best_cabling(cablings)
        numbers["cabling_best"] = chosen.name
        numbers["cabling_best_heights_m"] = [chosen.frame.upper, chosen.frame.lower]
    return numbers


def _arc_scales(length: float) -> Array:
    return np.array([1.0, 1.0, 1.0, length, length, length])


def _judge(scenario: CableRobotScenario, robot: CableRobot, found: WorkingPoses) -> list[str]:
    least = scenario.checks.usable_min_percent
    result, asked = found.result, scenario.workspace
    share = 100.0 * float(result.usable.mean())
    if share >= least:
        return []
    sentences = [f"{share:.1f} % of a survey's poses can be used; must be >= {least:g} %"]
    if not result.feasible.all():
        worst = int(np.argmin(result.margin))
        where = np.round(found.poses.position[worst], 2).tolist()
        sentences.append(
            f"{100.0 * float(1.0 - result.feasible.mean()):.1f} % do not bear "
            f"{asked.disturbance_force_N:g} N and {asked.disturbance_moment_N_m:g} N m within "
            f"{robot.tension_min:g} .. {robot.tension_max:g} N, worst at {where} m"
        )
    if not result.clear.all():
        near = result.clearances
        assert near is not None
        tightest = int(np.argmin(near.least))
        where = np.round(found.poses.position[tightest], 2).tolist()
        sentences.append(
            f"{100.0 * float(1.0 - result.clear.mean()):.1f} % come nearer than "
            f"{scenario.checks.clearance_min_mm:g} mm to something, the nearest at {where} m"
        )
    return sentences


def _rows(scenario: CableRobotScenario, numbers: dict[str, Any]) -> list[SheetRow]:
    checks = scenario.checks
    share = 100.0 * numbers["work_usable_share"]
    least = 1e3 * numbers["clearance_sampled_min_m"]
    rows = [
        SheetRow(label="survey's poses that can be used", value=f"{share:.1f} %",
                 allowed=f">= {checks.usable_min_percent:g} %",
                 good=share >= checks.usable_min_percent),
        SheetRow(label="disturbances borne, times", value=f"{numbers['disturbance_margin']:.2f}",
                 allowed=">= 1", good=numbers["disturbance_margin"] >= 1.0),
        SheetRow(label="least distance", value=f"{least:.0f} mm",
                 allowed=f">= {checks.clearance_min_mm:g} mm",
                 good=least >= checks.clearance_min_mm),
        SheetRow(label="tensions, least norm",
                 value=f"{numbers['tension_min_N']:.0f} .. {numbers['tension_max_N']:.0f} N"),
        SheetRow(label=f"position, lengths off by {1e3 * numbers['length_error_m']:g} mm",
                 value=f"{1e3 * numbers['position_error_max_m']:.1f} mm"),
        SheetRow(label="point looked at, likewise",
                 value=f"{1e3 * numbers['picture_error_max_m']:.1f} mm"),
        SheetRow(label="an encoder's step moves it by",
                 value=f"{1e3 * numbers['encoder_step_moves_max_m']:.2f} mm"),
        SheetRow(label=f"softest, {numbers['stiffness_softest_mostly']}",
                 value=f"{1e-3 * numbers['stiffness_softest_N_m']:.1f} kN/m",
                 allowed=f"arcs of {numbers['stiffness_length_m']:.2f} m"),
        SheetRow(label="force borne, every way",
                 value=f"{numbers['force_borne_min_N']:.0f} N"),
        SheetRow(label="moment borne, every way",
                 value=f"{numbers['moment_borne_min_N_m']:.1f} N m"),
        SheetRow(label="cables of", value=str(numbers["material_recommended"])),
    ]  # fmt: skip
    if "cabling_best" in numbers:
        rows.append(SheetRow(label="best cabling", value=numbers["cabling_best"].replace("_", " ")))
    return rows


def _table(file: Path, header: list[str], rows: list[list[object]]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    write_whole(file, text.getvalue())


def _write_cablings(file: Path, cablings: list[CablingRow]) -> None:
    measures = {
        "held_share": "held", "feasible_share": "feasible", "usable_share": "usable",
        "cable_cable_m": "cable_cable", "cable_obstacle_m": "cable_obstacle",
        "platform_obstacle_m": "platform_obstacle", "position_error_m": "position_error",
        "rotation_error_rad": "rotation_error", "picture_error_m": "point_error",
        "softest_N_m": "softest", "tension_max_N": "tension", "force_N": "force",
        "moment_N_m": "moment", "longest_cable_m": "longest",
    }  # fmt: skip
    rows: list[list[object]] = [
        [row.name, row.frame.upper, row.frame.lower,
         *(f"{getattr(row, name):.6g}" for name in measures.values())]
        for row in cablings
    ]  # fmt: skip
    _table(file, ["cabling", "upper_m", "lower_m", *measures], rows)


def _write_materials(file: Path, materials: list[MaterialRow]) -> None:
    rows: list[list[object]] = [
        [
            row.material.name, f"{1e3 * row.diameter:.2f}", f"{1e3 * row.mass_per_length:.1f}",
            f"{row.axial_stiffness:.4g}", f"{row.strength:.4g}",
            *(f"{1e3 * value:.3f}" for value in (
                row.sag, row.sag_error, row.stretch_error, row.thermal_error, row.creep_error,
                row.length_error)),
            int(row.material.bends),
        ]
        for row in materials
    ]  # fmt: skip
    header = [
        "material", "rope_mm", "g_per_m", "axial_stiffness_N", "strength_N", "sag_mm",
        "sag_error_mm", "stretch_error_mm", "thermal_error_mm", "creep_error_mm",
        "length_error_mm", "bears_bending",
    ]  # fmt: skip
    _table(file, header, rows)
