"""Task `survey`: flies the camera over the radiators, finds defects, maps and compares them."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from pips_drake.cable_robot.accuracy import pose_errors
from pips_drake.cable_robot.cablings import bay_obstacles
from pips_drake.cable_robot.configuration import CableRobotConfig
from pips_drake.cable_robot.defect_map import (
    Finding,
    MapCheck,
    Sighting,
    compare_with_truth,
    locate,
    merge,
    panel_mask,
    predicted_error,
)
from pips_drake.cable_robot.defects import Defect, next_mission, seeded_defects
from pips_drake.cable_robot.detection import find_defects, require_scikit_image
from pips_drake.cable_robot.edge_registration import registered
from pips_drake.cable_robot.interference import clearances
from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.panels import Panel, find_panel, radiator_panels
from pips_drake.cable_robot.platform_motion import MotionLimits
from pips_drake.cable_robot.raster import FARTHEST, Raster, coverage, survey_raster
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.runs.panel_studio import PanelStudio
from pips_drake.cable_robot.runs.station_flight import station_flight
from pips_drake.cable_robot.runs.survey_files import write_survey
from pips_drake.cable_robot.runs.survey_flight import Flight, flight_motion, rest_flight
from pips_drake.cable_robot.runs.task import TaskResult
from pips_drake.cable_robot.scenario import CableRobotScenario
from pips_drake.cable_robot.survey_camera import (
    SurveyCamera,
    camera_poses,
    noise_tile,
    with_noise,
)
from pips_drake.cable_robot.survey_comparison import SurveyComparison, compare_surveys
from pips_drake.errors import InputError
from pips_drake.twin.rendering import render_available

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: Half the width of the piece of a picture that the report shows of a defect, pixels.
CROP = 80
#: Distance of the poses along the way at which clearances are looked at, m.
_APART = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class Survey:
    """One survey.

    Attributes:
        raster, flight: views, and how they were flown.
        defects: what is on the panels.
        findings: the map.
        crops: pieces of pictures, by the findings' names.
        coverage: share of each panel that was seen, by its name.
        tolerance: by which a finding may be misplaced, m.
        check: the map beside the truth.
    """

    raster: Raster
    flight: Flight
    defects: list[Defect]
    findings: list[Finding]
    crops: dict[str, Picture]
    coverage: dict[str, float]
    tolerance: float
    check: MapCheck


@dataclass(frozen=True, kw_only=True, eq=False)
class SurveyRun:
    """Everything that a survey's scenario gives.

    Attributes:
        before, after: the two surveys; `after` is None if there is one only.
        comparison: of both maps.
        clearance: least distance of platform or cables to anything else along the raster, m.
        clearance_kind: of what to what.
    """

    robot: CableRobot
    camera: SurveyCamera
    before: Survey
    after: Survey | None
    comparison: SurveyComparison | None
    clearance: float
    clearance_kind: str

    @property
    def surveys(self) -> list[Survey]:
        """One or two."""
        return [self.before] if self.after is None else [self.before, self.after]


def prepare(
    scenario: CableRobotScenario, config: CableRobotConfig
) -> Callable[[Path, str], TaskResult]:
    """Checks that the survey can be flown; returns what flies it.

    Raises:
        InputError: unknown panels, views outside the robot's region, no renderer, no scikit-image.
    """
    asked = scenario.survey
    if config.planar:
        raise InputError(f"{config.name}: a planar robot; a survey needs one that moves in space")
    config.require_box()
    panels = radiator_panels()
    if asked.panels:
        panels = tuple(find_panel(panels, name) for name in dict.fromkeys(asked.panels))
    camera = SurveyCamera(
        width=asked.camera.width,
        height=asked.camera.height,
        field_of_view=math.radians(asked.camera.field_of_view_deg),
    )
    raster = survey_raster(panels, camera, standoff=asked.standoff_m, overlap=asked.overlap)
    config.require_inside(raster.platform)
    defects = _missions(scenario, panels)
    missing = render_available()
    if missing is not None:
        raise InputError(f"a survey needs pictures: {missing}")
    require_scikit_image()

    def work(folder: Path, name: str) -> TaskResult:
        run = run_survey(scenario, config, camera, raster, defects)
        return write_survey(folder, name, scenario, run)

    return work


def run_survey(
    scenario: CableRobotScenario,
    config: CableRobotConfig,
    camera: SurveyCamera,
    raster: Raster,
    missions: Sequence[list[Defect]],
) -> SurveyRun:
    """One survey of each mission's defects, with another calibration each, compared."""
    surveys = [
        _survey(scenario, config, camera, raster, defects, number)
        for number, defects in enumerate(missions)
    ]
    comparison = None
    if len(surveys) > 1:
        before, after = surveys
        radius = before.tolerance + after.tolerance
        comparison = compare_surveys(before.findings, after.findings, radius=radius)
    motion, _ = flight_motion(raster, _limits(scenario))
    near = clearances(config.robot(), _along(motion.poses.position), bay_obstacles())
    kinds = {
        "cable to cable": near.cable_cable,
        "cable to panel, door or sill": near.cable_obstacle,
        "platform to panel, door or sill": near.platform_obstacle,
    }
    kind = min(kinds, key=lambda name: float(kinds[name].min()))
    return SurveyRun(
        robot=config.robot(),
        camera=camera,
        before=surveys[0],
        after=surveys[1] if len(surveys) > 1 else None,
        comparison=comparison,
        clearance=float(kinds[kind].min()),
        clearance_kind=kind,
    )


def _missions(scenario: CableRobotScenario, panels: Sequence[Panel]) -> list[list[Defect]]:
    asked, painted = scenario.survey, scenario.survey.defects
    sizes = (1e-3 * painted.smallest_mm, 1e-3 * painted.largest_mm)
    try:
        defects = seeded_defects(asked.seed, panels, painted.count, sizes)
        if not asked.after_mission:
            return [defects]
        later = next_mission(
            defects,
            asked.seed + 1,
            panels,
            new=painted.new,
            grown=painted.grown,
            cleaned=painted.cleaned,
            sizes=sizes,
        )
    except InputError as error:
        raise InputError(f"survey.defects (count, new, grown, cleaned): {error}") from None
    return [defects, later]


def _survey(
    scenario: CableRobotScenario,
    config: CableRobotConfig,
    camera: SurveyCamera,
    raster: Raster,
    defects: list[Defect],
    number: int,
) -> Survey:
    asked = scenario.survey
    seed = 1000 * asked.seed + number
    limits = _limits(scenario)
    if asked.flight == "station":
        flight = station_flight(
            config,
            raster,
            limits,
            asked=scenario.station,
            seed=seed,
            label=f"flight {number + 1}",
        )
    else:
        flight = rest_flight(config, raster, limits, seed=seed)
    tolerance = _tolerance(config, camera, raster, asked.standoff_m)
    true = camera_poses(camera, flight.true, raster.tilt)
    estimated = camera_poses(camera, flight.estimated, raster.tilt)
    sightings: list[Sighting] = []
    pieces: dict[tuple[int, float, float], Picture] = {}
    tile = noise_tile(camera, asked.camera.noise, seed)
    words = ("survey", "survey after the mission")[number]
    with tempfile.TemporaryDirectory() as folder:
        studio = PanelStudio(Path(folder), raster.panels, defects)
        for view in tqdm(range(len(raster)), desc=words, unit="picture", disable=None, leave=False):
            picture = with_noise(studio.shoot(camera, true, view), tile, seed + view)
            seen = registered(picture, camera, estimated, view, raster.panels, reach=tolerance)
            mask = panel_mask(camera, seen, view, raster.panels)
            found = find_defects(picture, mask=mask)
            for sighting in locate(found, camera, seen, view, raster.panels):
                sightings.append(sighting)
                across, down = sighting.pixel
                pieces[view, float(across), float(down)] = _crop(picture, across, down)
    findings = merge(sightings, camera, radius=2.0 * tolerance)
    return Survey(
        raster=raster,
        flight=flight,
        defects=defects,
        findings=findings,
        crops={f.name: pieces[f.image, f.pixel[0], f.pixel[1]] for f in findings},
        coverage=_coverage(raster, camera, true, FARTHEST * asked.standoff_m),
        tolerance=tolerance,
        check=compare_with_truth(findings, defects, tolerance),
    )


def _limits(scenario: CableRobotScenario) -> MotionLimits:
    asked = scenario.survey
    return MotionLimits(
        speed=asked.speed_m_s, acceleration=asked.acceleration_m_s2, dwell=asked.exposure_s
    )


def _tolerance(
    config: CableRobotConfig, camera: SurveyCamera, raster: Raster, standoff: float
) -> float:
    """What the errors of the lengths do to a point of the map, at most over all views, m."""
    winch = config.winch
    length_error = 1e-3 * (winch.length_error_mm + 0.5 * winch.encoder_step_mm)
    errors = pose_errors(config.robot(), raster.platform, length_error)
    # The camera hangs below the origin that the position is of.
    arm = float(np.linalg.norm(camera.mount))
    return predicted_error(
        camera,
        standoff,
        position_error=float((errors.position + arm * errors.rotation).max()),
        rotation_error=float(errors.rotation.max()),
    )


def _coverage(
    raster: Raster, camera: SurveyCamera, poses: Poses, farthest: float
) -> dict[str, float]:
    share = {}
    for index, panel in enumerate(raster.panels):
        here = raster.panel == index
        chosen = Poses(poses.position[here], poses.rotation[here])
        share[panel.name] = coverage(panel, chosen, camera, farthest=farthest)[0]
    return share


def _along(corners: Array) -> Poses:
    """Level poses along a way, no farther apart than `_APART`."""
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    pieces = [
        start + np.linspace(0.0, 1.0, math.ceil(length / _APART), endpoint=False)[:, None] * step
        for start, step, length in zip(corners, np.diff(corners, axis=0), lengths, strict=False)
        if length > 0.0
    ]
    places = np.concatenate([*pieces, corners[-1:]])
    return Poses(places, np.broadcast_to(np.eye(3), (len(places), 3, 3)))


def _crop(picture: Picture, across: float, down: float) -> Picture:
    """A square piece round a pixel, moved to lie inside the picture."""
    height, width = picture.shape[:2]
    size = min(2 * CROP, height, width)
    left = int(np.clip(round(across) - size // 2, 0, width - size))
    top = int(np.clip(round(down) - size // 2, 0, height - size))
    piece: Picture = picture[top : top + size, left : left + size].copy()
    return piece
