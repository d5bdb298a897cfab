"""What a run of the remote manipulator recorded, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pips_drake.remote_manipulator.configuration import JOINTS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.kinematics import forward_kinematics
from pips_drake.remote_manipulator.phases import PHASES

Array = NDArray[np.float64]

#: Entries of a record of flags.
FLAGS = ("arm_collision", "finger_collision", "arm_inhibit", "finger_inhibit")


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happened.

    Attributes:
        time: s.
        kind: phase, collision, inhibit, contact, attachment or camera.
        text: what, in words.
    """

    time: float
    kind: str
    text: str


@dataclass(frozen=True, kw_only=True, eq=False)
class RunData:
    """Rows are the operator's frames, N of them.

    Attributes:
        time: (N,) s.
        setpoint: (N, 11): stand, six angles, gap, the orbiter's offset.
        arm, arm_rates, arm_efforts: (N, 8): stand (m, N), six angles (rad, N m), gap (m, N).
        payload, cae: (N, 7), poses X_RP and X_RC: quaternion w x y z, position m.
        phase: (N,), indices of `PHASES`.
        flags: (N, 4), the columns of `FLAGS`.
        display: what the operator is shown, by name, each (N,).
        control_word: (N,), 24 bits.
        station: (N,), indices of stations; camera: (N, 3) pan, tilt, field of view, rad.
        clearance: (N,) m, of arm and payload to everything else, as simulated; pairs: whose.
        penetration: (N,) m, deepest of the plant's contacts.
        positions: (N, n) of the plant.
        channels: (N, 17) V.
    """

    time: Array
    setpoint: Array
    arm: Array
    arm_rates: Array
    arm_efforts: Array
    payload: Array
    cae: Array
    phase: NDArray[np.int_]
    flags: NDArray[np.bool_]
    display: dict[str, Array]
    control_word: NDArray[np.int_]
    station: NDArray[np.int_]
    camera: Array
    clearance: Array
    pairs: tuple[tuple[str, str] | None, ...]
    penetration: Array
    positions: Array
    channels: Array

    @property
    def phases(self) -> list[str]:
        """The phases that the run went through, in order."""
        changes = np.flatnonzero(np.diff(self.phase)) + 1
        return [PHASES[self.phase[row]] for row in (0, *changes)]

    @property
    def inhibits(self) -> int:
        """How often a flag that inhibits motion was raised."""
        raised = self.flags[:, 2] | self.flags[:, 3]
        return int(raised[0]) + int(np.sum(raised[1:] & ~raised[:-1]))

    def tracking_error(self, config: RemoteManipulatorConfig) -> Array:
        """How far the palm is from where the slave arm was sent a frame before, (N,) m.

        Where all has just been put back to the beginning, it was sent somewhere else: 0.
        """
        sent = np.vstack([self.setpoint[:1], self.setpoint[:-1]])
        wanted = forward_kinematics(config.arm, sent[:, 1:7], sent[:, 0])
        found = forward_kinematics(config.arm, self.arm[:, 1:7], self.arm[:, 0])
        error = np.asarray(np.linalg.norm(found.palm - wanted.palm, axis=1))
        reset = np.flatnonzero(np.diff(self.display["resets"])) + 1
        error[reset] = error[np.minimum(reset + 1, len(error) - 1)] = 0.0
        return error

    def torque_fractions(self, config: RemoteManipulatorConfig) -> Array:
        """Shares of their limits that the drives used, (N, 8)."""
        limits = [config.stand.force_N, *config.arm.torques, config.effector.prong_force_N]
        return np.asarray(np.abs(self.arm_efforts) / np.array(limits))


def find_events(data: RunData) -> list[Event]:
    """Phase changes, collisions and inhibits of a run, in order."""
    events = []
    for row in np.flatnonzero(np.diff(data.phase)) + 1:
        was, now = (PHASES[data.phase[k]] for k in (row - 1, row))
        events.append(Event(time=float(data.time[row]), kind="phase", text=f"{was} -> {now}"))
    for column, name in enumerate(FLAGS):
        flag = data.flags[:, column]
        what, kind = name.split("_")
        for row in np.flatnonzero(np.diff(flag.astype(int))) + 1:
            word = "begins" if flag[row] else "is relieved"
            if kind == "inhibit":
                word = "inhibited" if flag[row] else "free again"
                text = f"{what} motion {word}"
            else:
                text = f"collision of the {what} {word}"
            events.append(Event(time=float(data.time[row]), kind=kind, text=text))
    return sorted(events, key=lambda event: event.time)


#: Columns of arm vectors in CSV files.
ARM_COLUMNS = ("stand_m", *(f"{name}_rad" for name in JOINTS), "gap_m")


def millimetres(length: float) -> str:
    """A length, m, as text, with tenths where it is short."""
    digits = 0 if abs(length) >= 0.01 else 1
    return f"{1e3 * length:.{digits}f} mm"
