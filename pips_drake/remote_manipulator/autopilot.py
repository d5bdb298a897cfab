"""An operator that works through a script: poses to be reached, straight ways, what to wait for.

It sees what an operator sees (the phase, the arm, payload and CAE) and moves what an operator moves
(the master arm's angles and the switches), so that the collision program treats it like one.

A way goes straight from where the palm is to where it is to be (`straight_way`). Towards a payload
that nothing holds, it is straight in the payload's frame, so that it follows one that moves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from pips_drake.errors import NotFollowableError
from pips_drake.remote_manipulator.configuration import STATIONS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.geometry import docking_port, payload_parts, probe_tip
from pips_drake.remote_manipulator.kinematics import forward_kinematics, nearest_angles
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.phases import TABLE, Phase
from pips_drake.remote_manipulator.program_state import FRAME_PERIOD
from pips_drake.remote_manipulator.script import ScriptStep
from pips_drake.remote_manipulator.straight_way import (
    PEAK_RATE,
    SHORTEST,
    least_duration,
    pose_between,
    pose_numbers,
    progress,
    relative,
)
from pips_drake.units import FOOT

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

#: Share of a joint's rate that a way may need.
RATE_SHARE = 0.85
#: A way is over when the arm is as near to its end, rad, or after so long, s.
ARRIVED, PATIENCE = 4e-3, 12.0
#: Words whose way is straight in {P} while nothing holds the payload, and those that move.
_TOWARDS_PAYLOAD = ("approach", "descend", "close")
_BY_PAYLOAD = (*_TOWARDS_PAYLOAD, "retreat")
_MOVES = (
    *_BY_PAYLOAD,
    "carry",
    "carry_to_port",
    "dock",
    "carry_to_berth",
    "berth",
)
#: How long is waited for what has no time of its own, s.
_TIMES = {"close": 20.0, "undock": 5.0}
#: How far before the port a docking way ends, m: inside the tolerance, outside the CAE.
_SHORT_OF_PORT = 0.02


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What an operator sees.

    Attributes:
        phase: of the task.
        arm: height m, six angles rad, gap m, (8,), as measured.
        X_RP, X_RC: poses of payload and CAE in {R}.
    """

    phase: Phase
    arm: Array
    X_RP: Pose
    X_RC: Pose


@dataclass(frozen=True, kw_only=True, eq=False)
class AutopilotState:
    """Where in its script an autopilot is.

    Attributes:
        step: index of the step; the script's length when all is done.
        elapsed: since the step began, s; negative before its beginning has been worked out.
        duration: of the step's way, s.
        start, goal: rotation vector (3,) and position (3,) of {2}'s palm at both ends, (6,), in {P}
            or {R}.
        angles: of the master arm, (6,) rad.
        station: chosen camera station, a number.
    """

    step: int = 0
    elapsed: float = -1.0
    duration: float = 0.0
    start: Array
    goal: Array
    angles: Array
    station: int = 0

    def vector(self) -> Array:
        """All of it as numbers, (22,)."""
        head = [self.step, self.elapsed, self.duration, self.station]
        return np.concatenate([head, self.start, self.goal, self.angles])

    @staticmethod
    def of_vector(vector: ArrayLike) -> AutopilotState:
        """The state that `vector` made the numbers of."""
        v = np.array(vector, dtype=np.float64)
        return AutopilotState(
            step=round(v[0]),
            elapsed=float(v[1]),
            duration=float(v[2]),
            station=round(v[3]),
            start=v[4:10],
            goal=v[10:16],
            angles=v[16:22],
        )


class Autopilot:
    """Works through a script with one machine.

    Args:
        config: the machine.
        script: at least one step.
        station: camera station at first, a number.
    """

    def __init__(
        self, config: RemoteManipulatorConfig, script: Sequence[ScriptStep], *, station: int = 0
    ) -> None:
        self.config = config
        self.script = tuple(script)
        self.station = STATIONS[station]
        bar = payload_parts(config)[2]
        # Over the middle of the bar's top, half of what acquisition allows above it.
        top = bar.position[2] - 0.5 * bar.size[2]
        gap = 0.5 * config.acquisition.top_ft * FOOT
        self._grasp = np.array([*bar.position[:2], top - gap - config.effector.palm.length_m])

    def first_state(self, angles: ArrayLike) -> AutopilotState:
        """Before the first frame, with the master arm at angles (6,) rad."""
        zero = np.zeros(6)
        return AutopilotState(
            start=zero,
            goal=zero,
            angles=np.array(angles, dtype=float),
            station=STATIONS.index(self.station),
        )

    def finished(self, state: AutopilotState) -> bool:
        """All steps are done."""
        return state.step >= len(self.script)

    def advance(self, state: AutopilotState, seen: Seen) -> tuple[AutopilotState, OperatorInputs]:
        """One frame: the next state, and what the operator does in it.

        Raises:
            NotFollowableError: the arm cannot reach what a step asks for.
        """
        if self.finished(state):
            return state, self._inputs(state)
        step = self.script[state.step]
        if state.elapsed < 0.0:
            state = self._begun(state, step, seen)
        if step.do in (*_MOVES, "move_joints") and not _caught(step, seen):
            state = replace(state, angles=self._angles(state, step, seen))
        inputs = self._inputs(state, step)
        state = replace(state, elapsed=state.elapsed + FRAME_PERIOD)
        if self._done(state, step, seen):
            state = replace(state, step=state.step + 1, elapsed=-1.0)
        return state, inputs

    def _begun(self, state: AutopilotState, step: ScriptStep, seen: Seen) -> AutopilotState:
        angles = state.angles
        # After a collision the arm is not where it was sent.
        if np.max(np.abs(seen.arm[1:7] - angles)) > 5.0 * ARRIVED:
            angles = seen.arm[1:7].copy()
        state = replace(state, elapsed=0.0, duration=0.0, angles=angles)
        if step.do == "camera":
            pan, tilt, zoom = self._camera_times(step)
            longest = max(abs(pan) + abs(tilt), abs(zoom))
            return replace(state, station=STATIONS.index(step.station), duration=longest)
        if step.do == "move_joints":
            self._check_limits(state, step)
            way = np.abs(np.radians(step.angles_deg) - angles)
            duration = float(np.max(PEAK_RATE * way / (RATE_SHARE * self.config.arm.rates)))
            goal = np.radians(step.angles_deg)
            return replace(state, start=angles, goal=goal, duration=max(duration, SHORTEST))
        if step.do not in _MOVES:
            # Where the stand is at first says which way it is to go.
            start = np.full(6, float(seen.arm[0]))
            return replace(state, start=start, duration=self._waiting_time(step, seen))
        base = self._base(step, seen)
        pose = forward_kinematics(self.config.arm, angles, float(seen.arm[0]))
        palm = pose.R_R2, pose.palm
        state = replace(
            state,
            start=pose_numbers(relative(base, palm)),
            goal=pose_numbers(relative(base, self._goal(step, seen, palm))),
        )
        if step.do == "close":
            return replace(state, duration=self._waiting_time(step, seen))
        return replace(state, duration=self._way_time(state, step, seen))

    def _check_limits(self, state: AutopilotState, step: ScriptStep) -> None:
        for joint, angle in zip(self.config.arm.joints, step.angles_deg, strict=True):
            if not joint.lower_deg <= angle <= joint.upper_deg:
                raise NotFollowableError(
                    f"step {state.step + 1} ({step.do}): {joint.name} = {angle:g} deg; must be "
                    f"{joint.lower_deg:g} .. {joint.upper_deg:g} deg"
                )

    def _base(self, step: ScriptStep, seen: Seen) -> Pose:
        """The frame that a step's way is straight in."""
        loose = not TABLE[seen.phase].grasped
        if loose and step.do in _BY_PAYLOAD:
            return seen.X_RP
        return np.eye(3), np.zeros(3)

    def _goal(self, step: ScriptStep, seen: Seen, palm: Pose) -> Pose:
        """Where the palm is to be, in {R}."""
        R_RP, p_RP = seen.X_RP
        if step.do in ("approach", "descend"):
            height = step.height_m if step.do == "approach" else 0.0
            # The nearer of the two ways to take the bar: z2 along the payload's x, or against it.
            sign = 1.0 if palm[0][:, 2] @ R_RP[:, 0] >= 0.0 else -1.0
            R_P2 = np.array([[0.0, 0.0, sign], [0.0, -sign, 0.0], [1.0, 0.0, 0.0]])
            return R_RP @ R_P2, R_RP @ (self._grasp - [0.0, 0.0, height]) + p_RP
        if step.do == "close":
            return palm  # stays with a payload that drifts
        if step.do == "retreat":
            return palm[0], palm[1] - step.height_m * palm[0][:, 0]
        if step.do == "carry":
            turn = Rotation.from_euler("xyz", np.radians(step.turn_deg or [0.0] * 3)).as_matrix()
            by = np.array(step.by_m or [0.0] * 3)
            if not TABLE[seen.phase].grasped:
                return turn @ palm[0], palm[1] + by
            return self._palm_of((turn @ R_RP, p_RP + by), seen)
        if step.do in ("carry_to_port", "dock"):
            R_RC, p_RC = seen.X_RC
            short = step.standoff_m if step.do == "carry_to_port" else _SHORT_OF_PORT
            missed = np.array(step.offset_m or [0.0] * 3)
            tip = docking_port(self.config) + missed + np.array([short, 0.0, 0.0])
            return self._palm_of((R_RC, R_RC @ (tip - probe_tip(self.config)) + p_RC), seen)
        standoff = step.standoff_m if step.do == "carry_to_berth" else 0.0
        stowed = np.array(self.config.payload.location_m) - [0.0, 0.0, standoff]
        return self._palm_of((np.eye(3), stowed), seen)

    def _palm_of(self, X_RP: Pose, seen: Seen) -> Pose:
        """Where the palm must be for a held payload to be at X_RP."""
        held = forward_kinematics(self.config.arm, seen.arm[1:7], float(seen.arm[0]))
        R, p = relative(seen.X_RP, (held.R_R2, held.palm))
        return X_RP[0] @ R, X_RP[0] @ p + X_RP[1]

    def _way_time(self, state: AutopilotState, step: ScriptStep, seen: Seen) -> float:
        """How long the way takes: within speeds, accelerations and the joints' rates, s."""
        held = TABLE[seen.phase].grasped
        duration = least_duration(state.start, state.goal, held=held, speed=step.speed_m_s)
        # The joints' rates along the way, by differences.
        shares = np.linspace(0.0, 1.0, 41)
        angles, samples = state.angles, []
        for share in shares:
            angles = self._angles_at(state, step, seen, progress(share), near=angles)
            samples.append(angles)
        rates = np.abs(np.diff(samples, axis=0)) / np.diff(shares)[:, None]
        needed = np.max(rates / (RATE_SHARE * self.config.arm.rates))
        return max(duration, float(needed))

    def _angles(self, state: AutopilotState, step: ScriptStep, seen: Seen) -> Array:
        share = progress(min(1.0, (state.elapsed + FRAME_PERIOD) / state.duration))
        if step.do == "move_joints":
            way: Array = state.start + share * (state.goal - state.start)
            return way
        return self._angles_at(state, step, seen, share, near=state.angles)

    def _angles_at(
        self, state: AutopilotState, step: ScriptStep, seen: Seen, share: float, *, near: Array
    ) -> Array:
        base = self._base(step, seen)
        R, p = pose_between(state.start, state.goal, share)
        palm, R_R2 = base[0] @ p + base[1], base[0] @ R
        angles = nearest_angles(self.config.arm, palm, R_R2, float(seen.arm[0]), near)
        if angles is None:
            where = ", ".join(f"{value:.2f}" for value in palm)
            raise NotFollowableError(
                f"step {state.step + 1} ({step.do}): the arm cannot hold its palm at ({where}) m "
                f"with the stand at {seen.arm[0]:.2f} m"
            )
        return angles

    def _waiting_time(self, step: ScriptStep, seen: Seen) -> float:
        """How long a step without a way takes at most, s."""
        if step.do == "telescope":
            return abs(step.to_m - float(seen.arm[0])) / self.config.stand.rate_m_s
        if step.do == "translate_orbiter":
            return float(np.max(np.abs(step.by_m))) / self.config.orbiter.rate_m_s
        if step.do == "open":
            effector = self.config.effector
            way = effector.prong_open_gap_m - effector.prong_closed_gap_m
            return 1.5 * way / effector.prong_rate_m_s
        return step.seconds or _TIMES.get(step.do, 0.0)

    def _done(self, state: AutopilotState, step: ScriptStep, seen: Seen) -> bool:
        facts = TABLE[seen.phase]
        over = state.elapsed >= state.duration - 1e-9
        if _caught(step, seen):
            return True
        if step.do == "close":
            return over
        if step.do == "undock":
            return facts.support != "port" or over
        if step.do == "dock" and seen.phase is Phase.DOCKED_HELD:
            return True
        if step.do == "open":
            wide = float(seen.arm[7]) > self.config.effector.prong_open_gap_m - 0.01
            return (wide and not facts.grasped) or over
        if step.do in (*_MOVES, "move_joints"):
            missing = float(np.max(np.abs(seen.arm[1:7] - state.angles)))
            patience = step.seconds or PATIENCE
            late = state.elapsed >= state.duration + patience
            waits = step.do == "dock"  # until it docks
            return over and ((missing < ARRIVED and not waits) or late)
        return over

    def _inputs(self, state: AutopilotState, step: ScriptStep | None = None) -> OperatorInputs:
        """What the operator does in this frame."""
        switches = {} if step is None else self._switches(state, step)
        station = STATIONS[state.station]
        return OperatorInputs(angles=state.angles, station=station, **switches)

    def _switches(self, state: AutopilotState, step: ScriptStep) -> dict[str, Any]:
        if step.do in ("close", "open"):
            return {"prong": 1 if step.do == "close" else -1}
        if step.do == "undock":
            return {"open_latch": True}
        left = state.duration - state.elapsed
        if step.do == "translate_orbiter":
            rate = self.config.orbiter.rate_m_s
            on = [state.elapsed < abs(by) / rate - 1e-9 for by in step.by_m]
            signs = np.sign(step.by_m).astype(int).tolist()
            return {"shuttle": tuple(s if o else 0 for s, o in zip(signs, on, strict=True))}
        if step.do == "camera":
            pan, tilt, zoom = self._camera_times(step)
            # Pan and tilt share a channel: one comes after the other.
            now = state.elapsed + 1e-9
            return {
                "pan": _way(pan) if now < abs(pan) else 0,
                "tilt": _way(tilt) if abs(pan) <= now < abs(pan) + abs(tilt) else 0,
                "zoom": _way(zoom) if now < abs(zoom) else 0,
            }
        if step.do == "telescope" and left > 1e-9:
            return {"telescope": _way(step.to_m - float(state.start[0]))}
        return {}

    def _camera_times(self, step: ScriptStep) -> tuple[float, float, float]:
        """How long to pan, to tilt and to zoom, s; the signs say which way."""
        cameras = self.config.cameras
        turn = cameras.pan_tilt_rate_deg_s
        # A wider field of view is zoomed out.
        return step.pan_deg / turn, step.tilt_deg / turn, -step.zoom_deg / cameras.zoom_rate_deg_s


def _way(value: float) -> int:
    return int(math.copysign(1.0, value)) if value else 0


def _caught(step: ScriptStep, seen: Seen) -> bool:
    """The payload that a step goes for is held: its way, in the payload's frame, is over."""
    return step.do in _TOWARDS_PAYLOAD and TABLE[seen.phase].grasped
