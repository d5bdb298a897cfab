"""A run that nothing simulated: every frame alike, but for what a test says."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from pips_drake.remote_manipulator.analog_inputs import angle_scaling, encode_frame
from pips_drake.remote_manipulator.configuration import load_configuration
from pips_drake.remote_manipulator.display import DISPLAY
from pips_drake.remote_manipulator.geometry import docking_port, probe_tip
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.phases import PHASES
from pips_drake.remote_manipulator.runs.data import RunData

CONFIG = load_configuration()
PAIR = ("rms_payload::payload", "rms_cargo_bay::cargo_bay")
#: From the payload's middle to the CAE's when the probe's end is in the middle of the port.
DOCKED = docking_port(CONFIG) - probe_tip(CONFIG)


def pose(*position: float) -> np.ndarray:
    """Of a body along {R}, (7,)."""
    return np.array([1.0, 0.0, 0.0, 0.0, *position])


def made_data(count: int = 6, **changes: Any) -> RunData:
    """`count` frames: the payload stowed, the arm at home, nothing near anything; or as changed."""
    arm = np.array([CONFIG.stand.lower_m, *CONFIG.arm.home, CONFIG.effector.prong_open_gap_m])
    volts = encode_frame(OperatorInputs(angles=CONFIG.arm.home), angle_scaling(CONFIG.arm))
    cae = pose(*CONFIG.central_assembly_element.location_m)
    values: dict[str, Any] = {
        "time": 0.05 * np.arange(count),
        "setpoint": np.tile([*arm, 0.0, 0.0, 0.0], (count, 1)),
        "arm": np.tile(arm, (count, 1)),
        "arm_rates": np.zeros((count, 8)),
        "arm_efforts": np.zeros((count, 8)),
        "payload": np.tile(pose(*CONFIG.payload.location_m), (count, 1)),
        "cae": np.tile(cae, (count, 1)),
        "phase": np.zeros(count, dtype=int),
        "flags": np.zeros((count, 4), dtype=bool),
        "display": {name: np.ones(count) for name in DISPLAY},
        "control_word": np.zeros(count, dtype=int),
        "station": np.full(count, 2),
        "camera": np.zeros((count, 3)),
        "clearance": np.ones(count),
        "pairs": (PAIR,) * count,
        "penetration": np.zeros(count),
        "positions": np.zeros((count, 15)),
        "channels": np.tile(volts, (count, 1)),
    }
    assert set(changes) <= set(values)
    return RunData(**(values | changes))


def phases(*names: str) -> np.ndarray:
    """One a frame, as numbers."""
    return np.array([PHASES.index(name) for name in names])


def flags(*rows: str) -> np.ndarray:
    """One row a frame, of letters: a, f collision of arm and finger; A, F their inhibits."""
    return np.array([[letter in row for letter in "afAF"] for row in rows])


def made_run(data: RunData, **changes: Any) -> Any:
    """A run with this record, which took half of its time, and is done."""
    values = {
        "data": data,
        "run_time": SimpleNamespace(simulated_s=4.0, wall_s=2.0, real_time_rate=2.0),
        "attachments": [],
        "slip_max": 1e-6,
        "finished": True,
        "stopped": "",
    }
    assert set(changes) <= set(values)
    return SimpleNamespace(**(values | changes))
