"""The whole station with anybody at its desk, ten times ten minutes: nothing breaks.

The bodies of the plant press into each other by what contact yields, and by no more than the two
frames of motion that the inhibit lets through.
"""

from __future__ import annotations

import collections
import functools
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

from pips_drake.remote_manipulator.analog_inputs import angle_scaling, decode_channels
from pips_drake.remote_manipulator.geometry import prism_corners
from pips_drake.remote_manipulator.kinematics import forward_kinematics
from pips_drake.remote_manipulator.phases import TRANSITIONS, Phase
from pips_drake.remote_manipulator.runs.data import RunData
from pips_drake.remote_manipulator.runs.operators import make_operator
from pips_drake.remote_manipulator.runs.run import load_setup, make_station, run_station
from pips_drake.remote_manipulator.scenario import (
    DynamicsConfig,
    LimitCycleConfig,
    OperatorConfig,
    PayloadStartConfig,
    RemoteManipulatorScenario,
)

from .program_world import CONFIG, STOWED, arm_over, docked_payload

FRAME = 0.05
TEN_MINUTES = 600.0
SEEDS = range(10)
#: What contact yields, m: the stiffness is chosen so that 10 t at 0.06 m/s press 2 mm.
COMPLIANCE = 2e-3
#: Of a payload that is carried at 0.06 m/s, m. (The hand at random goes up to five times as fast.)
TWO_SLOW_FRAMES = 2.0 * 0.06 * FRAME
#: Where the payload is at first, by what holds it.
STARTS = {"bay": STOWED, "port": docked_payload(), "none": docked_payload(away=2.0)}
ARROWS = {(arrow.source, arrow.target) for arrow in TRANSITIONS}


def scenario(seed: int, seconds: float) -> RemoteManipulatorScenario:
    """The effector over the bar of a payload in the bay, at the port, or in a limit cycle."""
    support = tuple(STARTS)[seed % 3]
    flies = support == "none"
    arm = arm_over(STARTS[support], up=0.05)
    made = RemoteManipulatorScenario(
        operator=OperatorConfig(kind="random"),
        duration_s=seconds,
        seed=seed,
        payload=PayloadStartConfig(
            support=support,
            position_m=list(STARTS[support][1]) if flies else [],
            spin_deg_s=[0.02, 0.01, -0.01] if flies else [0.0, 0.0, 0.0],
            limit_cycle=LimitCycleConfig(enabled=flies),
        ),
        stand_height_m=float(arm[0]),
        angles_deg=np.degrees(arm[1:7]).tolist(),
        dynamics=DynamicsConfig(orbiter_translates=True),
    )
    made.validate()
    return made


def motion(data: RunData) -> np.ndarray:
    """How far the fastest corner of payload and effector went against {R} in each frame, (N,) m."""
    hull = prism_corners(CONFIG.payload.across_flats_m, CONFIG.payload.length_m)
    turns = Rotation.from_quat(data.payload[:, :4], scalar_first=True).as_matrix()
    arm = forward_kinematics(CONFIG.arm, data.arm[:, 1:7], data.arm[:, 0])
    palm, finger = CONFIG.effector.palm, CONFIG.effector.finger
    end = CONFIG.arm.arm_2_m + palm.length_m + finger.length_m
    corners = np.array([[end, y, 0.0] for y in (-0.5 * palm.width_m, 0.5 * palm.width_m)])
    places = np.concatenate(
        [
            hull @ np.swapaxes(turns, 1, 2) + data.payload[:, np.newaxis, 4:],
            corners @ np.swapaxes(arm.R_R2, 1, 2) + arm.wrist[:, np.newaxis],
        ],
        axis=1,
    )
    steps = np.linalg.norm(np.diff(places, axis=0), axis=2).max(axis=1)
    # What stands still in space moves against an orbiter that translates, and the prong closes.
    steps += np.linalg.norm(np.diff(data.cae[:, 4:], axis=0), axis=1)
    steps += np.abs(np.diff(data.arm[:, 7]))
    return np.concatenate([[0.0], steps])


@dataclass(frozen=True)
class Soak:
    """What came of a run."""

    data: RunData
    slip: float

    @property
    def excess(self) -> float:
        """Deepest penetration beyond two frames of motion, m."""
        steps = motion(self.data)
        # The faster of the frames before: contact comes to rest after a frame has gone into it.
        lately = sliding_window_view(np.pad(steps, (3, 0)), 4).max(axis=1)
        return float(np.max(self.data.penetration - 2.0 * lately))


@functools.cache
def soak(seed: int, seconds: float) -> Soak:
    made = scenario(seed, seconds)
    setup = load_setup(made)
    station = make_station(setup, make_operator(made, setup).system, camera=made.station)
    run = run_station(station, duration=seconds)
    return Soak(data=run.data, slip=run.slip_max)


def check(found: Soak, seed: int) -> None:
    data = found.data
    for name in ("arm", "arm_rates", "payload", "cae", "positions", "setpoint", "channels"):
        assert np.isfinite(getattr(data, name)).all(), name
    assert np.isfinite(np.column_stack(list(data.display.values()))).all()
    phases = [Phase(number) for number in data.phase]
    first = (Phase.STOWED, Phase.DOCKED, Phase.FREE_FLYING)[seed % 3]
    assert phases[0] is first
    initializes = decode_channels(data.channels, angle_scaling(CONFIG.arm)).column("initialize")
    for row in np.flatnonzero(np.diff(data.phase)):
        if phases[row + 1] is first and initializes[row] == 1:
            continue
        assert (phases[row], phases[row + 1]) in ARROWS
    margin = np.radians(1.0)
    assert np.all(data.arm[:, 1:7] > CONFIG.arm.lower - margin)
    assert np.all(data.arm[:, 1:7] < CONFIG.arm.upper + margin)
    assert found.excess <= COMPLIANCE
    # A reset is a frame of many metres; but nothing was ever deeper than two slow frames.
    assert data.penetration.max() <= TWO_SLOW_FRAMES
    # The welds' own compliance.
    assert found.slip < 1e-4


def test_some_seconds_of_the_station():
    found = soak(8, 3.0)
    check(found, 8)
    assert len(found.data.time) == 61


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_ten_minutes_of_the_station(seed):
    found = soak(seed, TEN_MINUTES)
    check(found, seed)
    assert len(found.data.time) == 12001
    assert found.data.inhibits > 0


@pytest.mark.slow
def test_the_stations_went_through_all_phases():
    phases = sum(
        (collections.Counter(soak(seed, TEN_MINUTES).data.phase.tolist()) for seed in SEEDS),
        collections.Counter(),
    )
    assert set(phases) == set(Phase)
