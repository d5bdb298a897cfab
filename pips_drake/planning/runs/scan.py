"""A scenario's scan: its pattern, the arm's motion along it, and what the camera saw."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pips_drake.planning.runs.planned import Planned
from pips_drake.planning.runs.workspace import Workspace
from pips_drake.planning.scan_motion import ScanSettings, plan_scan
from pips_drake.planning.scan_target import CylinderTarget, ScanCamera
from pips_drake.planning.scanning import ScanPattern, helix, raster, read_pattern
from pips_drake.planning.scenario import PlannerScenario
from pips_drake.scene.packages import find_path_file
from pips_drake.serpentine.joint_motion_pacing import paced
from pips_drake.serpentine.scenario import CameraConfig


def plan_surface(
    scenario: PlannerScenario, workspace: Workspace, *, folder: Path | None = None
) -> Planned:
    """Plans a scenario's scan.

    Args:
        folder: where the scenario's relative file names start.

    Raises:
        InputError: a pattern that means nothing, or does not fit the gap.
        NotFollowableError: the arm cannot get to the pattern's beginning.
    """
    config, camera = scenario.scan, scan_camera(scenario.camera)
    found = plan_scan(
        workspace.arm,
        workspace.occupancy,
        make_pattern(scenario, workspace, camera, folder=folder),
        home_tip=workspace.home_tip,
        camera=camera,
        settings=ScanSettings(
            planner=workspace.settings,
            tip_speed=scenario.motion.tip_speed_mm_per_s * 1e-3,
            lag=None if config.lag_mm < 0.0 else config.lag_mm * 1e-3,
        ),
    )
    numbers: dict[str, Any] = {
        "scan_points": len(found.pattern.points),
        "scan_reached_share": found.reached_share,
        "scan_length_m": found.pattern.length,
        "scan_line_spacing_m": found.pattern.spacing,
        "scan_swath_m": found.pattern.swath,
        "hinge_range_used_max": found.joint_share,
    }
    failures = list(found.failures)
    if found.coverage is not None:
        seen = found.coverage
        numbers |= {
            "coverage_share": seen.share,
            "coverage_area_m2": seen.area,
            "coverage_seen_m2": seen.seen_area,
        }
        if seen.share < config.coverage_min:
            failures.append(
                f"{100.0 * seen.share:.1f} % of the surface were seen; must be "
                f"{100.0 * config.coverage_min:g} % or more"
            )
    return Planned(
        plans=(found.approach,),
        # Its rows are timed by speeds alone: the arm would ring where these jump.
        motion=paced(workspace.arm, found.motion),
        scan=found,
        failures=tuple(failures),
        notes=found.notes,
        numbers=numbers,
    )


def make_pattern(
    scenario: PlannerScenario,
    workspace: Workspace,
    camera: ScanCamera,
    *,
    folder: Path | None = None,
) -> ScanPattern:
    """The pattern of a scenario's scan, in frame 0.

    Raises:
        InputError: a number that means nothing, or a file that cannot be used.
    """
    config, target = scenario.scan, None
    if config.along_m:
        low, high = np.radians(config.around_deg).tolist()
        target = CylinderTarget(
            radius=config.radius_m,
            along=(config.along_m[0], config.along_m[1]),
            around=(low, high),
            origin=(*scenario.workspace.axis_m, 0.0),
        )
    step = config.step_mm * 1e-3
    if config.pattern == "points":
        file = find_path_file(config.points_file, inside=folder)
        field = workspace.occupancy.field
        return read_pattern(file, target=target, field=field, step=step)
    assert target is not None  # the scenario's own check
    standoff = config.standoff_mm * 1e-3
    if config.pattern == "helix":
        return helix(target, camera, standoff=standoff, overlap=config.overlap, step=step)
    lines: Literal["along", "around"] = "along" if config.lines == "along" else "around"
    return raster(target, camera, standoff=standoff, overlap=config.overlap, lines=lines, step=step)


def scan_camera(camera: CameraConfig) -> ScanCamera:
    """The planner's camera of a scenario's."""
    return ScanCamera(
        field_of_view=math.radians(camera.field_of_view_deg),
        aspect=camera.width / camera.height,
        near=camera.range_near_m,
        far=camera.range_far_m,
        incidence=math.radians(camera.incidence_max_deg),
        pan_limit=math.radians(camera.pan_limit_deg),
        tilt_limit=math.radians(camera.tilt_limit_deg),
        roll=math.radians(camera.roll_deg),
    )
