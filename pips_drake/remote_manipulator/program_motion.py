"""How the command moves: after the master arm, and along the bay's side walls."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pips_drake.remote_manipulator.bodies import SIDE_WALLS
from pips_drake.remote_manipulator.configuration import ArmConfig, RemoteManipulatorConfig
from pips_drake.remote_manipulator.kinematics import nearest_angles
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.program_collisions import CollisionTest, Contact
from pips_drake.remote_manipulator.program_state import (
    ANGLES,
    COMMAND,
    FRAME_PERIOD,
    GAP,
    HEIGHT,
    OFFSET,
)

Array = NDArray[np.float64]


#: A payload that slides along a wall comes so near to it, m: the plant's own contact is no help.
SLIDE_GAP = 1e-3


def effector_pose(arm: ArmConfig, command: Array) -> tuple[Array, Array]:
    """Pose of {2} in {R} at a command (8 or 11,): as `forward_kinematics` has it, for one arm.

    A frame needs it a few times, and arrays of one element cost five times as much.
    """
    height, h0, p0, p1, h2, p2, r2 = command[: ANGLES.stop].tolist()
    ch, sh, c1, s1 = math.cos(h0), math.sin(h0), math.cos(p0 + p1), math.sin(p0 + p1)
    # Along arm 1 and across it; the third axis of {1} follows.
    out = arm.arm_0_m * math.cos(p0) + arm.arm_1_m * c1
    up = arm.arm_0_m * math.sin(p0) + arm.arm_1_m * s1
    ch2, sh2, cp2, sp2 = math.cos(h2), math.sin(h2), math.cos(p2), math.sin(p2)
    cr, sr = math.cos(r2), math.sin(r2)
    R_R1 = np.array([[ch * c1, -sh, ch * s1], [sh * c1, ch, sh * s1], [-s1, 0.0, c1]])
    # R_z(H2) R_y(P2) R_x(R2).
    R_12 = np.array(
        [
            [ch2 * cp2, ch2 * sp2 * sr - sh2 * cr, ch2 * sp2 * cr + sh2 * sr],
            [sh2 * cp2, sh2 * sp2 * sr + ch2 * cr, sh2 * sp2 * cr - ch2 * sr],
            [-sp2, cp2 * sr, cp2 * cr],
        ]
    )
    return R_R1 @ R_12, np.array([ch * out, sh * out, -height - up])


class MasterFollower:
    """Follows the master arm and the operator's switches within limits and rates.

    Args:
        config: the machine.
        limit_rates: the six angles move no faster than their joints can; the stand, the prong and
            the orbiter have one rate each anyway (RMS-71, VI.B).
    """

    def __init__(self, config: RemoteManipulatorConfig, *, limit_rates: bool) -> None:
        arm, stand, effector = config.arm, config.stand, config.effector
        self._lower, self._upper = np.full(COMMAND, -np.inf), np.full(COMMAND, np.inf)
        self._lower[HEIGHT], self._upper[HEIGHT] = stand.lower_m, stand.upper_m
        self._lower[ANGLES], self._upper[ANGLES] = arm.lower, arm.upper
        self._lower[GAP] = effector.prong_closed_gap_m
        self._upper[GAP] = effector.prong_open_gap_m
        self._angle_steps = arm.rates * FRAME_PERIOD if limit_rates else np.full(6, np.inf)
        self._stand = stand.rate_m_s * FRAME_PERIOD
        self._prong = effector.prong_rate_m_s * FRAME_PERIOD
        self._orbiter = config.orbiter.rate_m_s * FRAME_PERIOD

    def step(self, base: Array, inputs: OperatorInputs, *, gap_only: bool = False) -> Array:
        """The command of the next frame, (11,).

        Args:
            base: where it starts, (11,).
            inputs: what the operator wants.
            gap_only: everything but the prong stands still.
        """
        command = base.copy()
        # The prong closes on +1.
        command[GAP] -= inputs.prong * self._prong
        if not gap_only:
            limits = self._angle_steps
            wanted = np.clip(inputs.angles, self._lower[ANGLES], self._upper[ANGLES])
            command[ANGLES] += np.clip(wanted - base[ANGLES], -limits, limits)
            command[HEIGHT] += inputs.telescope * self._stand
            command[OFFSET] += np.array(inputs.shuttle) * self._orbiter
        limited: Array = np.clip(command, self._lower, self._upper)
        return limited

    def stopped(self, command: Array, inputs: OperatorInputs) -> tuple[bool, bool]:
        """Whether stand and prong are driven against their stops."""
        at_stop = []
        for row, way in ((HEIGHT, inputs.telescope), (GAP, -inputs.prong)):
            against = self._upper[row] if way > 0 else self._lower[row]
            at_stop.append(way != 0 and bool(command[row] == against))
        return at_stop[0], at_stop[1]


#: A contact's normal with less than this of the wall's own is one of the wall's upper edge.
_ALONG_WALL = 0.99


class WallSlider:
    """Takes a held payload along the bay's side walls where the command would take it into them.

    Args:
        config: the machine.
        test: whose pairs of a held payload are looked at.
    """

    def __init__(self, config: RemoteManipulatorConfig, test: CollisionTest) -> None:
        self._config, self._test = config, test
        arm = config.arm
        self._lower, self._upper = arm.lower, arm.upper
        self._angle_steps = arm.rates * FRAME_PERIOD
        # Assumed: as fast as the stand, which is chosen for a loaded arm's tip.
        self._step = config.stand.rate_m_s * FRAME_PERIOD

    def __call__(
        self,
        contact: Contact,
        before: Contact,
        command: Array,
        free: Array,
        wanted: Array,
        p_2P: Array,
    ) -> Array | None:
        """The command beside the walls, (11,); None where something else is hit, or out of reach.

        The payload keeps the attitude that it was free in. Its middle goes straight to where the
        master arm has it, but for what would go into the walls.

        Args:
            contact: at `command`.
            before: at `free`.
            command: that collides, (11,).
            free: the last free one, (11,).
            wanted: the master arm's angles, (6,) rad.
            p_2P: the payload's middle in {2}, (3,) m.
        """
        arm, machine = self._config.arm, self._test.machine
        master = command.copy()
        master[ANGLES] = np.clip(wanted, self._lower, self._upper)
        (R, wrist), (R_end, wrist_end) = (effector_pose(arm, one) for one in (free, master))
        way = wrist_end + R_end @ p_2P - wrist - R @ p_2P
        for row in np.flatnonzero(contact.separations <= 0.0):
            wall = machine.names[machine.held_pairs[row, 1]]
            if wall not in SIDE_WALLS:
                return None
            normal = contact.normals[row]
            room = max(float(before.separations[row]) - SLIDE_GAP, 0.0)
            if abs(normal[1]) < _ALONG_WALL:
                # At the wall's upper edge the shallowest way out is over it: not for a slide.
                side = 1.0 if wall == "wall_starboard" else -1.0
                normal, room = np.array([0.0, side, 0.0]), 0.0
            way -= min(float(way @ normal) + room, 0.0) * normal
        palm, height = wrist + arm.arm_2_m * R[:, 0], float(command[HEIGHT])
        share = min(1.0, self._step / max(float(np.linalg.norm(way)), 1e-12))
        for _ in range(2):
            angles = nearest_angles(arm, palm + share * way, R, height, free[ANGLES])
            if angles is None:
                return None
            excess = float(np.max(np.abs(angles - free[ANGLES]) / self._angle_steps))
            if excess <= 1.0:
                break
            # In small steps the angles go as the way does; half spare for what does not.
            share *= 0.5 / excess
        moved = command.copy()
        moved[ANGLES] = angles
        return moved
