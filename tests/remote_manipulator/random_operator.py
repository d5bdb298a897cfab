"""A seeded operator who means well, or ill, or nothing: goes everywhere the task can go."""

from __future__ import annotations

import numpy as np

from pips_drake.remote_manipulator.bodies import Placement
from pips_drake.remote_manipulator.kinematics import (
    forward_kinematics,
    heading_matrix,
    nearest_angles,
    pitch_matrix,
    roll_matrix,
)
from pips_drake.remote_manipulator.phases import TABLE
from pips_drake.remote_manipulator.program_state import ANGLES, FRAME_PERIOD, GAP, HEIGHT, OFFSET

from .program_world import CONFIG, DOWN, PALM_TOP, STOWED, World, docked_payload

#: Rates of the arm's joints, the stand, the prong and the orbiter, in a frame.
ANGLE_STEPS = CONFIG.arm.rates * FRAME_PERIOD
STAND_STEP = CONFIG.stand.rate_m_s * FRAME_PERIOD
PRONG_STEP = CONFIG.effector.prong_rate_m_s * FRAME_PERIOD
ORBITER_STEP = CONFIG.orbiter.rate_m_s * FRAME_PERIOD


class RandomOperator:
    """Chooses a goal every few seconds, and switches now and then.

    Goals: over the bar, the bar itself, the held payload up, at the port, in the bay, shaken by
    some centimetres and degrees, or any angles within and beyond the limits.
    """

    def __init__(self, world: World, seed: int) -> None:
        self._world, self._rng = world, np.random.default_rng(seed)
        self._left = 0
        self._inputs: dict[str, object] = {}
        self._target = world.state.command[ANGLES]

    def inputs(self) -> dict[str, object]:
        """Of this frame, for `World.frame`."""
        if self._left == 0:
            self._choose()
        self._left -= 1
        rng = self._rng
        # A hand that is not steady.
        angles = self._target + rng.normal(0.0, 0.002, 6)
        initialize = bool(rng.random() < 0.0002)
        select = str(rng.choice(["full", "mode_1", "mode_2_or_3"])) if initialize else "full"
        return self._inputs | {
            "angles": angles,
            "initialize": initialize,
            "initialize_select": select,
        }

    def _choose(self) -> None:
        rng, state = self._rng, self._world.state
        self._left = int(rng.integers(20, 400))
        facts = TABLE[state.phase]
        prong = int(rng.choice([-1, 0, 1], p=[0.05, 0.45, 0.5]))
        if not facts.grasped and state.sent[GAP] < 0.4 and rng.random() < 0.5:
            prong = -1
        self._inputs = {
            "telescope": int(rng.integers(-1, 2)),
            "prong": prong,
            "shuttle": tuple(int(n) for n in rng.choice([-1, 0, 1], 3, p=[0.05, 0.9, 0.05])),
            "open_latch": bool(rng.random() < 0.2),
        }
        if rng.random() < 0.15:
            self._target = rng.uniform(CONFIG.arm.lower - 0.1, CONFIG.arm.upper + 0.1)
            return
        angles = self._goal(*self._payload_goal(facts.grasped))
        self._target = state.command[ANGLES] if angles is None else angles

    def _payload_goal(self, grasped: bool) -> tuple[np.ndarray, np.ndarray]:
        """Where the payload (or, of a free effector, what it takes hold of) is wanted."""
        rng = self._rng
        R, p = self._world.payload
        if not grasped:
            up = rng.choice([0.0, 0.0, 0.3, 2.0])
            return R, p - up * R[:, 2]
        places = (
            docked_payload()[1] - self._world.state.sent[OFFSET],
            docked_payload(away=0.5)[1] - self._world.state.sent[OFFSET],
            STOWED[1],
            STOWED[1] - [0.0, 0.0, 3.0],
            STOWED[1] - [0.0, 0.0, 4.6],
            p + rng.normal(0.0, 0.5, 3),
            p - [0.0, 0.0, 1.0],
        )
        return np.eye(3), places[rng.integers(len(places))]

    def _goal(self, R: np.ndarray, p: np.ndarray) -> np.ndarray | None:
        """Angles at which a payload at that pose is held, or taken hold of; None: none."""
        rng = self._rng
        shake = rng.choice([0.0, 0.0, 1.0, 5.0])
        turn = rng.normal(0.0, 0.01, 3) * shake
        place = rng.normal(0.0, 0.01, 3) * shake
        R = R @ heading_matrix(turn[0]) @ pitch_matrix(turn[1]) @ roll_matrix(turn[2])
        palm = p + place - PALM_TOP * R[:, 2]
        state = self._world.state
        return nearest_angles(
            CONFIG.arm, palm, R @ DOWN, float(state.command[HEIGHT]), state.command[ANGLES]
        )


def placement(world: World, command: np.ndarray) -> Placement:
    """Where everything is when the hardware is as commanded, by the world's own memory."""
    arm = forward_kinematics(CONFIG.arm, command[ANGLES], command[HEIGHT])
    X_R2 = arm.R_R2, arm.wrist
    X_RP = world.held_payload(X_R2) if TABLE[world.state.phase].grasped else world.payload
    return Placement(X_R2, X_RP, world.cae_now(), float(command[GAP]), float(command[HEIGHT]))


def least_separation(world: World) -> float:
    """Of effector and payload, at what the scene was sent, m."""
    machine = world.program.collisions.machine
    grasped = TABLE[world.state.phase].grasped
    pairs = machine.held_pairs if grasped else machine.free_pairs
    R, p = machine.poses(placement(world, world.state.sent))
    return float(machine.bodies.separations(pairs, R, p).separation.min())


def motion_bound(world: World) -> float:
    """How far any point of effector and payload can go in a frame, m.

    Every joint at its full rate, each with the farthest corner's distance from its origin, all in
    one direction.
    """
    state = world.state
    machine = world.program.collisions.machine
    R, p = machine.poses(placement(world, state.sent))
    names = ("palm", "finger", "prong")
    if TABLE[state.phase].grasped:
        names += ("bar", "hull", "probe")
    corners = np.concatenate([machine.vertices(name, R, p) for name in names])
    arm = forward_kinematics(CONFIG.arm, state.sent[ANGLES], state.sent[HEIGHT])
    origins = [arm.shoulder] * 2 + [arm.elbow] + [arm.wrist] * 3
    turned = sum(
        step * np.linalg.norm(corners - origin, axis=1).max()
        for step, origin in zip(ANGLE_STEPS, origins, strict=True)
    )
    return float(turned + STAND_STEP + PRONG_STEP + 3.0 * ORBITER_STEP)
