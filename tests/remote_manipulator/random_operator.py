"""The operator at random in an ideal world, and how deep what it does lets bodies into others."""

from __future__ import annotations

import numpy as np

from pips_drake.remote_manipulator.autopilot import Seen
from pips_drake.remote_manipulator.bodies import Placement
from pips_drake.remote_manipulator.kinematics import forward_kinematics
from pips_drake.remote_manipulator.phases import TABLE
from pips_drake.remote_manipulator.program_state import ANGLES, FRAME_PERIOD, GAP, HEIGHT
from pips_drake.remote_manipulator.random_operator import RandomOperator as Hand

from .program_world import CONFIG, World

#: Rates of the arm's joints, the stand, the prong and the orbiter, in a frame.
ANGLE_STEPS = CONFIG.arm.rates * FRAME_PERIOD
STAND_STEP = CONFIG.stand.rate_m_s * FRAME_PERIOD
PRONG_STEP = CONFIG.effector.prong_rate_m_s * FRAME_PERIOD
ORBITER_STEP = CONFIG.orbiter.rate_m_s * FRAME_PERIOD


class RandomOperator:
    """The seeded operator at the desk of a world, whose arm is where it was sent."""

    def __init__(self, world: World, seed: int) -> None:
        self._world = world
        self._hand = Hand(CONFIG, seed)
        self._state = self._hand.first_state(world.state.command[ANGLES])

    def inputs(self) -> dict[str, object]:
        """Of this frame, for `World.frame`."""
        world = self._world
        arm = world.state.sent[: GAP + 1]
        seen = Seen(phase=world.state.phase, arm=arm, X_RP=world.payload, X_RC=world.cae_now())
        self._state, inputs = self._hand.advance(self._state, seen)
        return vars(inputs)


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
