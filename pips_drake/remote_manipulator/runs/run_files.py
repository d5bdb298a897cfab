"""Series and events of a run, as CSV."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from pips_drake.remote_manipulator.analog_inputs import CHANNELS, angle_scaling, decode_channels
from pips_drake.remote_manipulator.configuration import JOINTS, STATIONS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.operator_recording import OperatorRecording, write_recording
from pips_drake.remote_manipulator.runs.data import ARM_COLUMNS, FLAGS, Event, RunData
from pips_drake.twin.output_folder import write_whole
from pips_drake.twin.recording import Series, write_csv

_POSE = ("qw", "qx", "qy", "qz", "x_m", "y_m", "z_m")
_EFFORTS = ("stand_effort_N", *(f"{name}_effort_N_m" for name in JOINTS), "gap_effort_N")


def write_series(folder: Path, data: RunData, config: RemoteManipulatorConfig) -> None:
    """`joints.csv`, `payload.csv`, `program.csv`, `cameras.csv`, `channels.csv`, `operator.csv`.

    The last one is a recording: a scenario whose operator it is does the same task again.
    """
    sent = tuple(f"{column.rpartition('_')[0]}_sent_{column.rpartition('_')[2]}"
                 for column in ARM_COLUMNS)  # fmt: skip
    shown = tuple(data.display)
    tables: dict[str, tuple[list[Any], tuple[str, ...]]] = {
        "joints": (
            [data.arm, data.setpoint[:, : len(ARM_COLUMNS)], data.arm_efforts],
            (*ARM_COLUMNS, *sent, *_EFFORTS),
        ),
        "payload": (
            [data.payload, data.cae],
            (*_POSE, *(f"cae_{name}" for name in _POSE)),
        ),
        "program": (
            [
                data.phase,
                data.control_word,
                data.flags,
                np.column_stack([data.display[name] for name in shown]),
                data.clearance,
                data.penetration,
            ],
            ("phase", "control_word", *FLAGS, *shown, "clearance_m", "penetration_m"),
        ),
        "cameras": (
            [data.station, data.camera],
            ("station", "pan_rad", "tilt_rad", "field_of_view_rad"),
        ),
        "channels": ([data.channels], tuple(f"channel_{k + 1}_V" for k in range(CHANNELS))),
    }
    for name, (values, columns) in tables.items():
        stacked = np.column_stack([np.asarray(value, dtype=np.float64) for value in values])
        series = Series(time=data.time, values=stacked, columns=columns)
        write_csv(series, folder / f"{name}.csv")
    frames = decode_channels(data.channels, angle_scaling(config.arm))
    write_recording(folder / "operator.csv", OperatorRecording(times=data.time, frames=frames))


def write_events(folder: Path, events: list[Event]) -> None:
    """`events.csv`: everything that happened, in order."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["time_s", "kind", "text"])
    for event in events:
        writer.writerow([f"{event.time:.2f}", event.kind, event.text])
    write_whole(folder / "events.csv", text.getvalue())


def station_letters(data: RunData) -> str:
    """The stations that were chosen, in order."""
    changes = [0, *(np.flatnonzero(np.diff(data.station)) + 1)]
    return "".join(STATIONS[data.station[row]] for row in changes)
