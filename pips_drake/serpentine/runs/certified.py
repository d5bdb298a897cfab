"""Proves a run's clearance and limits at every instant, for its plan and for what it did."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.motion_extremes import MotionExtremes, motion_extremes
from pips_drake.serpentine.motion_profile import MotionProfile
from pips_drake.serpentine.runs.placed_arm import PlacedArm
from pips_drake.serpentine.scenario import CheckConfig, SerpentineScenario
from pips_drake.serpentine.station import SerpentineSetup, built_arm
from pips_drake.twin.certificate.certify import Certifier, ClearanceCertificate
from pips_drake.twin.certificate.proof import save_proof
from pips_drake.twin.certificate.search import Certificate
from pips_drake.twin.motion_record import RecordedMotion, thin_out
from pips_drake.units import DEGREE

Array = NDArray[np.float64]

#: A commanded motion of more knots than this is thinned out, and the deviation accounted for.
MOST_KNOTS = 20_000
#: Likewise where joint errors are allowed for, of which thinning out adds a few per cent at most:
#: each plane then looks at every joint at every knot.
MOST_KNOTS_WITH_ERRORS = 3000
#: By how much a sampled clearance may be below the certified one, m: both have roundings.
_ROUNDING = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class CertifiedMotion:
    """What is proved of one motion.

    Attributes:
        clearance: over every instant of the motion.
        with_errors: the same if the joints are off by the scenario's errors; None if not asked for.
        limits: of joints, strokes and drive speeds.
        motion: what it is proved of.
    """

    clearance: ClearanceCertificate
    with_errors: ClearanceCertificate | None
    limits: MotionExtremes
    motion: RecordedMotion


def commanded_motion(
    scenario: SerpentineScenario, setup: SerpentineSetup, profile: MotionProfile
) -> RecordedMotion:
    """The joints that follow-the-leader commands on the way out, at each update of the drives.

    Between updates the drives' set-points move on straight lines (`AddActuation`), so this is the
    commanded motion at every instant; the way back is the same. The camera's share in the last
    joint is not in it.
    """
    ticks = int(np.ceil(profile.duration * scenario.clocks.control_hz)) + 1
    times = np.arange(ticks) / scenario.clocks.control_hz
    travel = np.array([profile(time)[0] for time in times])
    joints = setup.solver.solve(setup.path, setup.path.home_arc_length + travel).joints
    return _thinned(times, joints, MOST_KNOTS)


def _thinned(times: Array, joints: Array, most: int) -> RecordedMotion:
    """A motion (N,) s and (N, joints) of `most` knots and the last one, evenly chosen."""
    rows = len(times)
    stride = -(-rows // most)
    return thin_out(times, joints, np.unique(np.append(np.arange(0, rows, stride), rows - 1)))


def certify_motion(
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    motion: RecordedMotion,
    placed: PlacedArm,
    *,
    with_errors: bool = False,
) -> CertifiedMotion:
    """Certifies a motion of the arm in a plant that holds arm and scene.

    Args:
        with_errors: also with the scenario's joint errors.

    Raises:
        InputError: something in the scene is of a kind that cannot be certified.
    """
    arm, config = setup.arm, scenario.certificate

    certifier = Certifier(placed.plant, placed.scene_graph.model_inspector(), [placed.model])

    def certify(motion: RecordedMotion, deviation: Array) -> ClearanceCertificate:
        return certifier.certify(
            motion.positions,
            motion.times,
            tolerance=config.tolerance_mm * 1e-3,
            deviation=deviation,
        )

    errors = np.where(
        arm.is_prismatic, config.rail_error_mm * 1e-3, config.joint_error_deg * DEGREE
    )
    erring = None
    if with_errors and errors.any():
        fewer = _thinned(motion.times, motion.positions, MOST_KNOTS_WITH_ERRORS)
        erring = certify(fewer, motion.deviation + fewer.deviation + errors)
    return CertifiedMotion(
        clearance=certify(motion, motion.deviation),
        with_errors=erring,
        limits=motion_extremes(arm, motion.times, motion.positions, deviation=motion.deviation),
        motion=motion,
    )


def certified_numbers(certified: CertifiedMotion, arm: SerpentineArm) -> dict[str, Any]:
    """What the summary says of a certified motion."""
    numbers: dict[str, Any] = {
        "knots": len(certified.motion.times),
        "deviation_max": certified.motion.deviation.max(),
    }
    for name, group in _groups(certified.clearance).items():
        numbers[f"{name}_lower_m"] = group.lower
        numbers[f"{name}_upper_m"] = group.upper
        numbers[f"{name}_pair"] = list(group.witness.bodies)
        numbers[f"{name}_time_s"] = group.witness.time
        numbers[f"{name}_queries"] = group.queries
        numbers[f"{name}_wall_s"] = group.wall_s
    if certified.with_errors is not None:
        for name, group in _groups(certified.with_errors).items():
            numbers[f"{name}_lower_with_errors_m"] = group.lower
    limits = certified.limits
    hinges = ~arm.is_prismatic
    numbers |= {
        "joint_margin_min_rad": limits.joint_margin[hinges].min(),
        "rail_margin_min_m": limits.joint_margin[~hinges].min(),
        "stroke_margin_min_m": limits.stroke_margin.min(),
        "drive_speed_max_fraction": limits.speed_fraction.max(),
    }
    return numbers


def _groups(clearance: ClearanceCertificate) -> dict[str, Certificate]:
    groups = {"clearance": clearance.scene, "self_clearance": clearance.own}
    return {name: group for name, group in groups.items() if group is not None}


def certified_failures(
    certified: CertifiedMotion, checks: CheckConfig, *, what: str, sampled: dict[str, float]
) -> list[str]:
    """Sentences for the clearances that are not proved although every sample keeps them.

    Args:
        what: which motion, for the sentence.
        sampled: least sampled distances by name, m; what they show has been said already.
    """
    need = {
        "clearance": checks.clearance_min_mm * 1e-3,
        "self_clearance": checks.self_clearance_min_mm * 1e-3,
    }
    found = []
    for name, group in _groups(certified.clearance).items():
        least = sampled.get(name, np.inf)
        first, second = group.witness.bodies
        if least < group.lower - _ROUNDING:
            found.append(
                f"{what}: a sample of {name} is {least * 1e3:.3f} mm, less than the "
                f"{group.lower * 1e3:.3f} mm that was proved: a defect of pips_drake; trust neither"
            )
        elif group.lower < need[name] <= least:
            found.append(
                f"{what}: {first} may come within {group.lower * 1e3:.2f} mm of {second} near "
                f"{group.witness.time:.2f} s, between samples; must be >= {need[name] * 1e3:g} mm"
            )
    return found


def write_proof(file: Path, certified: CertifiedMotion) -> None:
    """Writes what `pips verify` re-checks."""
    save_proof(file, certified.clearance)


def certified_clearance(certified: CertifiedMotion | None) -> float | None:
    """The proved least distance of arm to scene, m; None if there is none."""
    if certified is None or certified.clearance.scene is None:
        return None
    return certified.clearance.scene.lower


def certify(
    what: Literal["commanded", "simulated"],
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    motion: RecordedMotion,
    placed: PlacedArm,
    *,
    sampled: dict[str, float] | None = None,
) -> tuple[CertifiedMotion | None, dict[str, Any], list[str]]:
    """Certifies a motion, and says so.

    Args:
        what: which motion; joint errors are allowed for in the commanded one.
        sampled: as in `certified_failures`.

    Returns:
        the certified motion, or None where the scene has something that cannot be certified; its
        part of the summary; and sentences that fail the verdict.
    """
    if what == "simulated":
        # Strokes and speeds are those of the actuators as they stand.
        setup = replace(setup, arm=built_arm(setup, scenario.faults))
    try:
        certified = certify_motion(scenario, setup, motion, placed, with_errors=what == "commanded")
    except InputError as error:
        return None, {f"certificate_{what}_missing": str(error)}, []
    numbers = certified_numbers(certified, setup.arm)
    summary: dict[str, Any] = {f"certificate_{what}": numbers}
    # For the lines that the command prints: the motion that was certified last is the nearest to
    # what will happen.
    for key in ("clearance_lower", "self_clearance_lower", "clearance_lower_with_errors"):
        if f"{key}_m" in numbers:
            summary[f"{key.replace('_lower', '_certified_min')}_m"] = numbers[f"{key}_m"]
    # Samples end at the monitor's reach, which says nothing of what lies beyond.
    reach = scenario.clearance_range_m
    seen = {name: least for name, least in (sampled or {}).items() if least < reach}
    failures = certified_failures(certified, scenario.checks, what=f"{what} motion", sampled=seen)
    return certified, summary, failures
