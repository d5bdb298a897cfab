"""`pips check`: the verdict on a path in a scene, without simulating."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from pips_drake.scene.packages import list_names
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.runs.certified import (
    CertifiedMotion,
    certified_clearance,
    certify,
    write_proof,
)
from pips_drake.serpentine.runs.placed_arm import PlacedArm, place_arm
from pips_drake.serpentine.runs.planned import PlannedRun, Postures, planned_knots, planned_run
from pips_drake.serpentine.runs.scene_report import (
    report_scene,
    scenario_text,
    with_joint_motion_file,
)
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.statics import holding_efforts
from pips_drake.serpentine.station import SerpentineSetup, gravity_in_frame_0, load_setup
from pips_drake.twin.clearance import ClearanceQuery, LeastDistance
from pips_drake.twin.output_folder import output_folder, write_whole
from pips_drake.twin.run_figures import clearance_figure
from pips_drake.twin.summary import versions, write_summary
from pips_drake.twin.verdict import Verdict


def scene_of_path(path: str) -> str:
    """The shipped scene that belongs to a path: of its own name, or of its table's; else none."""
    # Names alone: the path of a file, which `find_scene_file` would take too, is no scene.
    shipped = list_names("scene")
    return next((name for name in (path, path.removesuffix("_arcs")) if name in shipped), "")


def check(
    scenario: SerpentineScenario,
    *,
    name: str,
    out: Path | None = None,
    force: bool = False,
    folder: Path | None = None,
    scene_file: Path | None = None,
    joint_motion: JointMotion | None = None,
) -> Verdict:
    """Plans a scenario's motion and judges the plan: limits, clearance, forces and speeds.

    Postures are a quarter inch of tip travel apart. Clearance is sampled at them, and certified for
    the whole commanded motion (`certified`); forces are those of statics in the scenario's
    mounting; speeds are those at its tip speed. If the fastest motion is wanted, forces and
    speeds are those of that motion. Of joints that are given, so are speeds; postures are taken
    where the arm's fastest point has gone a quarter inch.

    Args:
        name: for the summary.
        out: a folder to write; none without it.
        force: replace an earlier result there.
        folder: where the scenario's relative file names start.
        scene_file: stands for the scenario's scene.
        joint_motion: stands for the scenario's path or joints; the rail then stands at the
            scenario's `rail_shift_m`.

    Raises:
        InputError: something that the scenario names cannot be used; nothing is written.
    """
    setup = load_setup(scenario, folder=folder, scene_file=scene_file, joint_motion=joint_motion)
    if out is None:
        return _check(_believed(scenario, setup), name)[0]
    with output_folder(out, force=force) as partial:
        verdict = check_into(partial, scenario, setup, name=name)
        scenario = with_joint_motion_file(scenario, setup, partial)
        write_whole(partial / "scenario.yaml", scenario_text(scenario))
        write_summary(partial / "summary.json", verdict.summary)
    return Verdict(failures=verdict.failures, summary=verdict.summary, folder=out)


def check_into(
    folder: Path, scenario: SerpentineScenario, setup: SerpentineSetup, *, name: str
) -> Verdict:
    """Judges a plan as `check` does, and writes its proof and its figures, but no summary.

    Args:
        folder: exists; `figures` in it is made.
    """
    planned, pictures = _believed(scenario, setup), folder / "figures"
    pictures.mkdir(exist_ok=True)
    verdict, clearance, certified = _check(planned, name, figures=pictures)
    planned.write_figures(pictures)
    if certified is not None:
        write_proof(folder / "proof_commanded.npz", certified)
    if clearance:
        clearance_figure(
            pictures / "clearance.png",
            planned.postures.ways,
            [scene.distance for scene, _ in clearance],
            pair=min((scene for scene, _ in clearance), key=lambda s: s.distance).pair,
            threshold=scenario.checks.clearance_min_mm * 1e-3,
            max_distance=scenario.clearance_range_m,
            own_distance=[own.distance for _, own in clearance],
            x_axis=("tip travel", "m"),
            certified=certified_clearance(certified),
        )
    return verdict


def _believed(scenario: SerpentineScenario, setup: SerpentineSetup) -> PlannedRun:
    """The plan knows of no fault; a displaced payload stands where it is believed to stand."""
    return planned_run(dataclasses.replace(scenario, faults=[]), setup)


Clearances = list[tuple[LeastDistance, LeastDistance]]


def _check(
    planned: PlannedRun, name: str, *, figures: Path | None = None
) -> tuple[Verdict, Clearances, CertifiedMotion | None]:
    scenario, setup = planned.scenario, planned.setup
    scene = report_scene(scenario, setup, figures=figures)
    failures = [*planned.failures, *planned.warnings]
    summary = planned.numbers() | scene
    summary |= {
        "scenario": name,
        "scene": scenario.scene or None,
        "rail_shift_m": setup.rail_shift,
    }
    clearance: Clearances = []
    certified = None
    postures = planned.postures
    if len(postures.joints):
        placed = place_arm(scenario, setup)
        clearance = _sample_clearance(postures, scenario, placed)
        gravity = gravity_in_frame_0(placed.plant)
        summary |= planned.drive_numbers(holding_efforts(setup.arm, postures.joints, gravity))
        summary |= _clearance_numbers(postures, clearance)
        if not planned.failures:
            motion, more = planned.motion_numbers(figures)
            summary |= motion
            failures += more
        failures += _failures(scenario, planned, clearance, summary)
        if scenario.certificate.enabled and not planned.failures and "motion_duration_s" in summary:
            certified, numbers, more = certify(
                "commanded",
                scenario,
                setup,
                planned_knots(scenario, setup),
                placed,
                sampled={
                    "clearance": summary["clearance_sampled_min_m"],
                    "self_clearance": summary["self_clearance_sampled_min_m"],
                },
            )
            summary |= numbers
            failures += more
    summary |= {
        "verdict": "fail" if failures else "pass",
        "failures": failures,
        "versions": versions(),
    }
    return Verdict(failures=tuple(failures), summary=summary), clearance, certified


def _sample_clearance(
    postures: Postures, scenario: SerpentineScenario, placed: PlacedArm
) -> Clearances:
    query = ClearanceQuery(placed.plant, [placed.model], max_distance=scenario.clearance_range_m)
    return [query.least(scene) for scene in placed.posed(postures.joints)]


def _clearance_numbers(postures: Postures, clearance: Clearances) -> dict[str, Any]:
    least = int(np.argmin([scene.distance for scene, _ in clearance]))
    return {
        "clearance_sampled_min_m": clearance[least][0].distance,
        "clearance_min_pair": list(clearance[least][0].pair),
        f"clearance_min_{postures.index}": postures.indices[least],
        "clearance_in_range": bool(clearance[least][0].pair),
        "self_clearance_sampled_min_m": min(own.distance for _, own in clearance),
    }


def _failures(
    scenario: SerpentineScenario,
    planned: PlannedRun,
    clearance: Clearances,
    numbers: dict[str, Any],
) -> list[str]:
    checks, found = scenario.checks, []
    least = numbers["clearance_sampled_min_m"]
    if least < checks.clearance_min_mm * 1e-3:
        robot, other = numbers["clearance_min_pair"]
        word = "penetrates" if least < 0.0 else "comes too near to"
        found.append(
            f"{robot} {word} {other}: {least * 1e3:.1f} mm "
            f"{planned.where(numbers[f'clearance_min_{planned.postures.index}'])}; must be >= "
            f"{checks.clearance_min_mm:g} mm"
        )
    own = numbers["self_clearance_sampled_min_m"]
    if own < checks.self_clearance_min_mm * 1e-3:
        nearest = min((pair for _, pair in clearance), key=lambda pair: pair.distance)
        found.append(
            f"{' and '.join(nearest.pair)} come too near to each other: {own * 1e3:.1f} mm; must "
            f"be >= {checks.self_clearance_min_mm:g} mm"
        )
    for key, limit, what in (
        ("drive_effort_max_fraction", checks.force_fraction_max, "effort"),
        ("drive_speed_max_fraction", checks.speed_fraction_max, "speed"),
    ):
        if what == "speed" and planned.warnings:
            continue  # which say when, too
        if numbers[key] > limit:
            found.append(
                f"a drive needs {100.0 * numbers[key]:.0f} % of its {what} limit; must be <= "
                f"{100.0 * limit:g} %"
            )
    return found
