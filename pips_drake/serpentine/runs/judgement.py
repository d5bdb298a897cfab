"""The verdict of a simulated run: what it broke, what it hit, and what is proved of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pips_drake.serpentine.runs.assessment import Assessment
from pips_drake.serpentine.runs.certified import (
    CertifiedMotion,
    certify,
    write_proof,
)
from pips_drake.serpentine.runs.hit import find_hit
from pips_drake.serpentine.runs.placed_arm import PlacedArm, place_arm
from pips_drake.serpentine.runs.planned import planned_knots
from pips_drake.serpentine.runs.run import Run
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import SerpentineSetup
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
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    run: Run,
    *,
    proofs: Path | None = None,
    commanded: bool = True,
) -> Judgement:
    """Judges a run.

    Args:
        proofs: the folder for `proof_commanded.npz` and `proof_simulated.npz`.
        commanded: whether to certify the commanded motion too, which no verdict depends on.
    """
    assessment = Assessment.of(scenario, setup, run.data)
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
        if commanded:
            summary |= _certify_commanded(scenario, setup, placed, proofs)
        certified, proved, unproved = _certify_simulated(
            scenario, setup, assessment, run.motion, placed, proofs
        )
        summary |= proved
        failures += unproved
    return Judgement(
        failures=tuple(failures), summary=summary, assessment=assessment, certified=certified
    )


def _certify_commanded(
    scenario: SerpentineScenario, setup: SerpentineSetup, placed: PlacedArm, proofs: Path | None
) -> dict[str, Any]:
    """Certifies the commanded motion and writes its proof; returns the summary's part."""
    motion = planned_knots(scenario, setup)
    certified, summary, _ = certify("commanded", scenario, setup, motion, placed)
    if certified is not None and proofs is not None:
        write_proof(proofs / "proof_commanded.npz", certified)
    return summary


def _certify_simulated(
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    assessment: Assessment,
    motion: RecordedMotion,
    placed: PlacedArm,
    proofs: Path | None,
) -> tuple[CertifiedMotion | None, dict[str, Any], list[str]]:
    """Certifies the simulated motion and writes its proof.

    Returns:
        what is proved; the summary's part; what fails the verdict.
    """
    least = {
        "clearance": float(assessment.data.clearance.min()),
        "self_clearance": float(assessment.data.self_clearance.min()),
    }
    certified, summary, failures = certify(
        "simulated", scenario, setup, motion, placed, sampled=least
    )
    if certified is not None and proofs is not None:
        write_proof(proofs / "proof_simulated.npz", certified)
    return certified, summary, failures
