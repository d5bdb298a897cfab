"""The verdict of a simulated run: what it broke, what it hit, and what is proved of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pips_drake.serpentine.runs.assessment import Assessment
from pips_drake.serpentine.runs.certified import (
    CertifiedMotion,
    certify,
    commanded_motion,
    write_proof,
)
from pips_drake.serpentine.runs.hit import find_hit
from pips_drake.serpentine.runs.placed_arm import PlacedArm, place_arm
from pips_drake.serpentine.runs.run import Run
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import SerpentineSetup, make_profile
from pips_drake.twin.motion_record import RecordedMotion


@dataclass(frozen=True, kw_only=True, eq=False)
class Judgement:
    """What is said of a run.

    Attributes:
        failures: sentences; none for a run that passed.
        summary: the numbers behind them.
        certified: what is proved of the simulated motion; None if nothing is.
    """

    failures: tuple[str, ...]
    summary: dict[str, Any]
    assessment: Assessment
    certified: CertifiedMotion | None


def judge_run(
    scenario: SerpentineScenario, setup: SerpentineSetup, run: Run, *, proofs: Path | None = None
) -> Judgement:
    """Judges a run.

    Args:
        proofs: the folder for `proof_commanded.npz` and `proof_simulated.npz`.
    """
    assessment = Assessment(
        arm=setup.arm,
        path=setup.path,
        solver=setup.solver,
        checks=scenario.checks,
        data=run.data,
        clearance_range=scenario.clearance_range_m,
    )
    summary, failures = assessment.summary(), assessment.failures()
    placed = None
    if scenario.certificate.enabled or run.steps is not None:
        placed = place_arm(scenario, setup)
    if placed is not None and run.steps is not None:
        hit = find_hit(placed, run.steps)
        if hit is not None:
            summary |= hit.summary()
            failures.append(hit.sentence())
    if run.supervised is not None:
        summary |= run.supervised.summary()
        failures += run.supervised.failures()
    certified = None
    if placed is not None and scenario.certificate.enabled:
        certified, proved, unproved = _certify(
            scenario, setup, assessment, run.motion, placed, proofs
        )
        summary |= proved
        failures += unproved
    return Judgement(
        failures=tuple(failures), summary=summary, assessment=assessment, certified=certified
    )


def _certify(
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    assessment: Assessment,
    motion: RecordedMotion,
    placed: PlacedArm,
    proofs: Path | None,
) -> tuple[CertifiedMotion | None, dict[str, Any], list[str]]:
    """Certifies the commanded and the simulated motion, and writes their proofs.

    Returns:
        what is proved of the simulated one; the summary's part; what fails the verdict.
    """
    profile = make_profile(scenario, setup)
    # The verdict is that of the simulated motion.
    commanded, summary, _ = certify(
        "commanded", scenario, setup, commanded_motion(scenario, setup, profile), placed
    )
    simulated, more, failures = certify(
        "simulated",
        scenario,
        setup,
        motion,
        placed,
        sampled={
            "clearance": float(assessment.data.clearance.min()),
            "self_clearance": float(assessment.data.self_clearance.min()),
        },
    )
    for name, certified in (("commanded", commanded), ("simulated", simulated)):
        if certified is not None and proofs is not None:
            write_proof(proofs / f"proof_{name}.npz", certified)
    return simulated, summary | more, failures
