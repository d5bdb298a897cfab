"""A seeded operator who means well, or ill, or nothing: goes everywhere the task can go.

Every frame draws from a generator of its own, made of the seed and the frame's number: what the
operator does depends on these, on what was decided before, and on what is seen, and on nothing
else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from pips_drake.remote_manipulator.analog_inputs import angle_scaling
from pips_drake.remote_manipulator.autopilot import Seen
from pips_drake.remote_manipulator.configuration import STATIONS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.geometry import docking_port, payload_parts, probe_tip
from pips_drake.remote_manipulator.kinematics import forward_kinematics, nearest_angles
from pips_drake.remote_manipulator.operator_inputs import (
    FIELDS,
    INITIALIZE_SELECTS,
    Integers,
    OperatorFrames,
    OperatorInputs,
)
from pips_drake.remote_manipulator.phases import TABLE
from pips_drake.remote_manipulator.program_state import FRAME_PERIOD, GAP, HEIGHT

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

#: A hand turns a joint of the master arm no faster, rad/s: assumed, ten times what the arm can.
HAND_RATE = 0.5
#: A hand is not steady, rad: assumed.
_SHAKE = 0.0005
#: A decision is kept for so many frames, at least and less than.
_KEPT = (20, 800)
#: In a frame, the chance of an initialization: one in eight minutes.
_INITIALIZES = 0.0001
#: Chances that a goal is any angles at all, and how far these go beyond the limits, rad.
_ANYWHERE, _BEYOND = 0.15, 0.1
#: The palm is that far from the bar's top when it takes hold of it, m.
_GRASP_GAP = 0.01
#: What counts as at the bar, and as before the port, m.
_AT_BAR, _BEFORE_PORT = 0.1, 0.3
#: The effector that points down on a payload along {R}: x2 down, z2 aft.
_DOWN = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True, kw_only=True, eq=False)
class RandomState:
    """What an operator at random has decided.

    Attributes:
        frames: that have been.
        left: frames until the next decision.
        switches: a row of `OperatorFrames.switches`, (12,).
        angles: of the master arm, (6,) rad.
        target: where the hand takes them, (6,) rad.
    """

    frames: int = 0
    left: int = 0
    switches: Integers
    angles: Array
    target: Array

    def vector(self) -> Array:
        """All of it as numbers, (26,)."""
        return np.concatenate(
            [[self.frames, self.left], self.switches, self.angles, self.target], dtype=np.float64
        )

    @staticmethod
    def of_vector(vector: ArrayLike) -> RandomState:
        """The state that `vector` made the numbers of."""
        v = np.array(vector, dtype=np.float64)
        end = 2 + len(FIELDS)
        return RandomState(
            frames=round(v[0]),
            left=round(v[1]),
            switches=np.rint(v[2:end]).astype(np.int64),
            angles=v[end : end + 6],
            target=v[end + 6 :],
        )


class RandomOperator:
    """Chooses a goal every few seconds, and switches now and then.

    Goals: over the bar, the bar itself, the held payload up, at the port, in the bay, shaken by
    some centimetres and degrees, or any angles within and beyond the limits.

    Args:
        config: the machine.
        seed: of what is random, >= 0.
        station: camera station at first, a number.
    """

    def __init__(self, config: RemoteManipulatorConfig, seed: int, *, station: int = 0) -> None:
        self.config = config
        self._seed, self._station = seed, station
        self._full_scale = angle_scaling(config.arm).largest_angles
        bar = payload_parts(config)[2]
        # In {P}, where the palm's middle is when it holds the bar.
        top = bar.position[2] - 0.5 * bar.size[2]
        self._grasp = np.array(
            [*bar.position[:2], top - _GRASP_GAP - config.effector.palm.length_m]
        )
        self._stowed = np.array(config.payload.location_m)
        self._docked = docking_port(config) - probe_tip(config)

    def first_state(self, angles: ArrayLike) -> RandomState:
        """Before the first frame, with the master arm at angles (6,) rad."""
        switches = np.zeros(len(FIELDS), dtype=np.int64)
        switches[FIELDS.index("station")] = self._station
        at = np.array(angles, dtype=np.float64)
        return RandomState(switches=switches, angles=at, target=at.copy())

    def inputs(self, state: RandomState) -> OperatorInputs:
        """What the operator does in the frame that a state is of."""
        return OperatorFrames(
            angles=state.angles[np.newaxis], switches=state.switches[np.newaxis]
        ).frame(0)

    def advance(self, state: RandomState, seen: Seen) -> tuple[RandomState, OperatorInputs]:
        """One frame: the next state, and what the operator does in it."""
        rng = np.random.default_rng([self._seed, state.frames])
        if state.left == 0:
            state = self._decided(state, seen, rng)
        switches = state.switches.copy()
        initialize = bool(rng.random() < _INITIALIZES)
        select = int(rng.integers(len(INITIALIZE_SELECTS))) if initialize else 0
        switches[FIELDS.index("initialize")] = initialize
        switches[FIELDS.index("initialize_select")] = select
        most = HAND_RATE * FRAME_PERIOD
        step = state.target + rng.normal(0.0, _SHAKE, 6) - state.angles
        angles = np.clip(
            state.angles + np.clip(step, -most, most), -self._full_scale, self._full_scale
        )
        state = replace(
            state,
            frames=state.frames + 1,
            left=state.left - 1,
            switches=switches,
            angles=angles,
        )
        return state, self.inputs(state)

    def _decided(self, state: RandomState, seen: Seen, rng: np.random.Generator) -> RandomState:
        facts = TABLE[seen.phase]
        chances = [0.03, 0.47, 0.5]
        if not facts.grasped:
            # Who means well comes with an open prong, and closes it there.
            chances = [0.1, 0.1, 0.8] if self._at_bar(seen) else [0.7, 0.2, 0.1]
        prong = int(rng.choice([-1, 0, 1], p=chances))
        # Pan and tilt share a channel.
        pan, tilt = rng.permutation([int(rng.integers(-1, 2)), 0])
        station = state.switches[FIELDS.index("station")]
        values = {
            "telescope": rng.choice([-1, 0, 1], p=[0.1, 0.8, 0.1]),
            "prong": prong,
            "pan": pan,
            "tilt": tilt,
            "zoom": rng.integers(-1, 2),
            "station": rng.integers(len(STATIONS)) if rng.random() < 0.3 else station,
            "open_latch": rng.random() < 0.2,
        }
        for field in ("shuttle_x", "shuttle_y", "shuttle_z"):
            values[field] = rng.choice([-1, 0, 1], p=[0.02, 0.96, 0.02])
        switches = np.array([int(values.get(field, 0)) for field in FIELDS], dtype=np.int64)
        arm = self.config.arm
        if rng.random() < _ANYWHERE:
            target = rng.uniform(arm.lower - _BEYOND, arm.upper + _BEYOND)
        else:
            goal = self._goal(*self._payload_goal(facts.grasped, seen, rng), seen, rng)
            target = seen.arm[1:GAP] if goal is None else goal
        left = int(rng.integers(*_KEPT))
        return replace(state, left=left, switches=switches, target=np.array(target))

    def _at_bar(self, seen: Seen) -> bool:
        """The palm is where it takes hold of the bar, or nearly so."""
        R, p = seen.X_RP
        palm = forward_kinematics(self.config.arm, seen.arm[1:GAP], float(seen.arm[HEIGHT])).palm
        return bool(np.linalg.norm(R @ self._grasp + p - palm) < _AT_BAR)

    def _payload_goal(self, grasped: bool, seen: Seen, rng: np.random.Generator) -> Pose:
        """Where the payload (or, of a free effector, what it takes hold of) is wanted, in {R}."""
        R, p = seen.X_RP
        if not grasped:
            up = rng.choice([0.0, 0.0, 0.3, 2.0])
            return R, p - up * R[:, 2]
        R_RC, p_RC = seen.X_RC
        docked = R_RC @ self._docked + p_RC
        places = (
            docked,
            docked + 0.5 * R_RC[:, 0],
            self._stowed,
            self._stowed - [0.0, 0.0, 3.0],
            self._stowed - [0.0, 0.0, 4.6],
            p + rng.normal(0.0, 0.5, 3),
            p - [0.0, 0.0, 1.0],
        )
        row = int(rng.integers(len(places)))
        # Before the port, mostly into it.
        if np.linalg.norm(p - places[1]) < _BEFORE_PORT and rng.random() < 0.6:
            row = 0
        return np.eye(3), places[row]

    def _goal(self, R: Array, p: Array, seen: Seen, rng: np.random.Generator) -> Array | None:
        """Angles at which a payload at that pose is held, or taken hold of; None: none."""
        shake = rng.choice([0.0, 0.0, 1.0, 5.0])
        turn = rng.normal(0.0, 0.01, 3) * shake
        place = rng.normal(0.0, 0.01, 3) * shake
        R = R @ Rotation.from_rotvec(turn).as_matrix()
        palm = p + place + R @ self._grasp
        height = float(seen.arm[HEIGHT])
        return nearest_angles(self.config.arm, palm, R @ _DOWN, height, seen.arm[1:GAP])
