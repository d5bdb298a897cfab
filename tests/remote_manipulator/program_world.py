"""An ideal world around the collision program: the arm is where it was sent one frame before."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig, load_configuration
from pips_drake.remote_manipulator.geometry import docking_port
from pips_drake.remote_manipulator.kinematics import forward_kinematics, nearest_angles
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.phases import TABLE, Event, Phase
from pips_drake.remote_manipulator.program import CollisionProgram, Frame, Measured
from pips_drake.remote_manipulator.program_state import (
    ANGLES,
    GAP,
    HEIGHT,
    OFFSET,
    ProgramSettings,
    ProgramState,
)

Pose = tuple[np.ndarray, np.ndarray]

CONFIG = load_configuration()
#: The effector pointing down with its prong towards the payload's starboard side: x2 down, z2 aft.
DOWN = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
STOWED: Pose = (np.eye(3), np.array(CONFIG.payload.location_m))
#: From the payload's middle up to the bar's top, and from there to the end of arm 2, with 10 mm
#: between palm and bar.
BAR_TOP = 0.5 * CONFIG.payload.across_flats_m + CONFIG.receptacle.height_m
PALM_TOP = BAR_TOP + CONFIG.effector.palm.length_m + 0.01


def cae_pose(config: RemoteManipulatorConfig = CONFIG) -> Pose:
    return np.eye(3), np.array(config.central_assembly_element.location_m)


def docked_payload(config: RemoteManipulatorConfig = CONFIG, away: float = 0.0) -> Pose:
    """The payload in front of the port, `away` m from it."""
    half = 0.5 * config.payload.length_m + config.payload.probe_length_m
    return np.eye(3), cae_pose(config)[1] + docking_port(config) + [half + away, 0.0, 0.0]


def arm_over(payload: Pose, height: float = 4.0, gap: float = 0.6, up: float = 0.0) -> np.ndarray:
    """The arm (8,) with its palm right over the bar of a payload that lies along {R}."""
    palm = payload[1] - [0.0, 0.0, PALM_TOP + up]
    angles = nearest_angles(CONFIG.arm, palm, DOWN, height, CONFIG.arm.home)
    assert angles is not None
    return np.array([height, *angles, gap])


@dataclasses.dataclass
class World:
    """Program and world; `frame` moves both by a frame."""

    program: CollisionProgram
    payload: Pose
    cae: Pose = dataclasses.field(default_factory=cae_pose)

    def __post_init__(self) -> None:
        self.state: ProgramState = self.program.first_state()
        self.shown: Frame | None = None
        self.events: list[tuple[int, str]] = []
        self._first = self.payload
        self._X_2P: Pose | None = None
        self._last_offset = np.zeros(3)

    def frame(self, **inputs: object) -> ProgramState:
        """One frame; inputs are those of `OperatorInputs`, the angles stay where they are."""
        angles = inputs.pop("angles", self.state.command[ANGLES])
        self._move()
        before = self.state
        measured = Measured(self.payload, self.cae_now())
        self.state, self.shown = self.program.advance(
            before, OperatorInputs(angles=angles, **inputs), measured
        )
        if self.state.resets > before.resets:
            self.payload, self._X_2P = self._first, None
            self._last_offset = self.state.sent[OFFSET]
        elif self.state.event in (Event.ACQUIRED, Event.UNDOCKED):
            R, p = self.effector(before)
            self._X_2P = R.T @ self.payload[0], R.T @ (self.payload[1] - p)
        if self.state.event:
            self.events.append((self.state.frames, self.state.event.name))
        return self.state

    def go(
        self, arm: np.ndarray, most: int = 6000, until: Callable[[], bool] | None = None, **inputs
    ) -> ProgramState:
        """Moves the master arm to (8,) and waits for the command to be there, or `until`."""
        for _ in range(most):
            lift = float(arm[HEIGHT] - self.state.command[HEIGHT])
            telescope = int(np.sign(lift)) if abs(lift) > 1e-9 else 0
            # The last step of the stand is whole: it may stop within half of one.
            step = CONFIG.stand.rate_m_s * 0.05
            telescope = 0 if abs(lift) < 0.5 * step else telescope
            self.frame(angles=arm[ANGLES], telescope=telescope, **inputs)
            if until is not None and until():
                return self.state
            if telescope == 0 and np.allclose(self.state.command[ANGLES], arm[ANGLES], atol=1e-12):
                return self.state
        return self.state

    def close(self) -> ProgramState:
        """Closes the prong until it stops."""
        for _ in range(200):
            self.frame(prong=1)
        return self.state

    @staticmethod
    def effector(state: ProgramState) -> Pose:
        pose = forward_kinematics(CONFIG.arm, state.sent[ANGLES], state.sent[HEIGHT])
        return pose.R_R2, pose.wrist

    def cae_now(self) -> Pose:
        """The CAE, which stands still in space, in the moved {R}."""
        return self.cae[0], self.cae[1] - self.state.sent[OFFSET]

    def held_payload(self, X_R2: Pose) -> Pose:
        """Where a payload is that the effector at X_R2 holds as it was when it was taken."""
        assert self._X_2P is not None
        R, p = X_R2
        return R @ self._X_2P[0], R @ self._X_2P[1] + p

    def _move(self) -> None:
        """The hardware does what was sent."""
        facts, now = TABLE[self.state.phase], self.state.sent[OFFSET]
        last, self._last_offset = self._last_offset, now
        if facts.grasped and facts.support == "none":
            self.payload = self.held_payload(self.effector(self.state))
        elif facts.support != "bay":
            self.payload = self.payload[0], self.payload[1] - (now - last)


def world(
    settings: ProgramSettings | None = None,
    *,
    phase: Phase = Phase.STOWED,
    arm: np.ndarray | None = None,
    payload: Pose = STOWED,
    config: RemoteManipulatorConfig = CONFIG,
) -> World:
    """A world that begins in a phase; without `arm`, the effector is over the bar, prong open."""
    arm = arm_over(payload) if arm is None else arm
    return World(CollisionProgram(config, settings, phase=phase, arm=arm), payload)


def gap_of(state: ProgramState) -> float:
    return float(state.sent[GAP])
