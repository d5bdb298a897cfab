"""Random faults for the campaign: what is drawn from a seed, and where on its path a run begins."""

from __future__ import annotations

import copy
import functools
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, Diagram

from pips_drake.config import validate
from pips_drake.scenarios import load_scenario
from pips_drake.serpentine.drives import joints_from_drives
from pips_drake.serpentine.fault_config import DRIVE_FAULTS, ENCODER_FAULTS, FaultConfig
from pips_drake.serpentine.motion_words import EXTENDING
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import SerpentineSetup, built_arm, load_setup

#: Kinds, each with the range of its size: mild, and hard.
KINDS: dict[str, tuple[tuple[float, float], tuple[float, float]] | None] = {
    "jam": None,
    "slow": ((0.1, 0.6), (0.0, 0.1)),
    "runaway": ((0.05, 0.3), (0.3, 1.0)),
    "limited": ((5.0, 25.0), (1.0, 5.0)),
    "weak": ((0.2, 0.9), (0.005, 0.2)),
    "dead": None,
    "stuck": None,
    "biased": ((0.2, 2.0), (2.0, 15.0)),
    "quantised": ((0.05, 0.5), (0.5, 5.0)),
    "segment_length": ((2.0, 20.0), (20.0, 100.0)),
    "anchor": ((0.5, 5.0), (5.0, 25.0)),
    "payload_displaced": None,
    "disturbance": None,
    "late": ((2.0, 8.0), (8.0, 64.0)),
}
#: Kinds whose sign is drawn too.
SIGNED = ("runaway", "biased", "segment_length", "anchor")
#: Simulated time of a run, s, and when on its way (of 52.5 s) it may begin.
DURATION, LATEST_START = 8.0, 46.0
#: Share of the runs that nobody supervises, and of the hard ones.
UNSUPERVISED, HARD = 0.35, 0.5


@dataclass(frozen=True, kw_only=True)
class Draw:
    """One run's lot.

    Attributes:
        hard: whether its size is of the hard range.
        supervised: whether the motion supervisor is there.
        start: time on the motion's profile at which the run begins, s.
        fault: fields of `FaultConfig`.
    """

    seed: int
    kind: str
    hard: bool
    supervised: bool
    start: float
    fault: dict[str, Any]

    def record(self) -> dict[str, Any]:
        return asdict(self)


def draw(seed: int) -> Draw:
    """A run's lot, the same for the same seed; kinds take turns."""
    rng = np.random.default_rng(seed)
    kind = list(KINDS)[seed % len(KINDS)]
    hard, supervised = bool(rng.uniform() < HARD), bool(rng.uniform() >= UNSUPERVISED)
    start = float(rng.uniform(0.0, LATEST_START))
    joint, begin = int(rng.integers(3, 19)), float(rng.uniform(0.25, 3.0))
    fault: dict[str, Any] = {"kind": kind}
    if kind in DRIVE_FAULTS or kind == "anchor":
        fault["drive"] = f"L{joint}"
    if kind in ENCODER_FAULTS:
        fault["encoder"] = f"theta{joint}"
    if kind == "segment_length":
        fault["segment"] = int(rng.integers(1, 9))
    if kind == "payload_displaced":
        if hard:  # the hand comes to it within the run
            start = float(rng.uniform(42.0, LATEST_START))
        aside, nearest = (100.0, (200.0, 500.0)) if hard else (200.0, (0.0, 200.0))
        low, high = [-aside, nearest[0], -aside], [aside, nearest[1], aside]
        fault |= {"body": "payload::payload", "offset_mm": rng.uniform(low, high).tolist()}
    if kind == "disturbance":
        # The pallet's wall is along +y, the payload along -y.
        way = rng.normal(size=3) + ([0.0, 4.0 * rng.choice([-1.0, 1.0]), 0.0] if hard else 0.0)
        newtons = rng.uniform(400.0, 1500.0) if hard else rng.uniform(50.0, 400.0)
        fault["force_n"] = (newtons * way / np.linalg.norm(way)).tolist()
        fault["duration_s"] = float(rng.uniform(0.1, 3.0))
    sizes = KINDS[kind]
    if sizes is not None:
        size = float(rng.uniform(*sizes[hard]))
        fault["size"] = round(size) if kind == "late" else size
        if kind in SIGNED:
            fault["size"] = float(rng.choice([-1.0, 1.0])) * fault["size"]
    if kind not in ("segment_length", "anchor", "payload_displaced"):
        fault["start_s"] = begin
    return Draw(seed=seed, kind=kind, hard=hard, supervised=supervised, start=start, fault=fault)


@functools.cache
def _sound() -> tuple[SerpentineScenario, SerpentineSetup]:
    """Trajectory 4 beside pallet and payload, and what it names; read once a process."""
    scenario: SerpentineScenario = load_scenario("fault_jam").config
    return scenario, load_setup(scenario)


def drawn_scenario(lot: Draw) -> tuple[SerpentineScenario, SerpentineSetup]:
    """Trajectory 4 beside pallet and payload with the lot's fault, and what it names."""
    sound, setup = _sound()
    scenario = copy.deepcopy(sound)
    scenario.faults = [FaultConfig(**lot.fault)]
    scenario.duration_s = DURATION
    scenario.supervisor.enabled = lot.supervised
    scenario.supervisor.patience_s = 1.0
    if lot.kind == "weak":
        scenario.actuation.fidelity = "leg"
    validate(scenario)
    return scenario, setup


def begin_at(
    station: Diagram,
    context: Context,
    *,
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    start: float,
) -> None:
    """Puts a station that is not running yet part of the way along its path, at rest.

    Args:
        context: of the root.
        start: time on the motion's profile, s.
    """
    source = station.GetSubsystemByName("tip_path_source")
    inside = source.GetMyMutableContextFromRoot(context)
    dwell = float(inside.get_discrete_state(0).value()[3])
    # Profile's time, its rate, phase, time left to dwell.
    inside.SetDiscreteState(0, np.array([start, 0.0, EXTENDING, dwell]))
    arm = built_arm(setup, scenario.faults)
    wanted = _value(station, context, "actuator_length_map", "drive_state")[: arm.joints]
    offset = _value(station, context, "deflection_compensator", "drive_offset")
    plant = station.GetSubsystemByName("plant")
    model = plant.GetModelInstanceByName(arm.name)
    plant.SetPositions(
        plant.GetMyMutableContextFromRoot(context), model, joints_from_drives(arm, wanted)
    )
    # The set-points begin where the servos' first ones are.
    first = wanted + offset
    if scenario.actuation.fidelity == "joint":
        first = joints_from_drives(arm, first)
    moving = station.GetSubsystemByName("setpoint_interpolator")
    moving.GetMyMutableContextFromRoot(context).SetDiscreteState(0, first)


def _value(station: Diagram, context: Context, name: str, port: str) -> np.ndarray:
    system = station.GetSubsystemByName(name)
    value: np.ndarray = system.GetOutputPort(port).Eval(system.GetMyContextFromRoot(context))
    return value
