"""The machine's solids as convex bodies, and the pairs that the collision program looks at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig
from pips_drake.remote_manipulator.convex_bodies import BodySet
from pips_drake.remote_manipulator.geometry import (
    SIDES,
    Part,
    bay_parts,
    cae_parts,
    effector_parts,
    payload_parts,
    prong_part,
    prong_position,
)
from pips_drake.remote_manipulator.kinematics import (
    heading_matrix,
    pitch_matrix,
    roll_matrix,
)
from pips_drake.remote_manipulator.orbiter_outline import orbiter_parts
from pips_drake.remote_manipulator.polyhedra import ConvexBody

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

#: The effector's three hexahedra (EFF HEX 1 to 3), first in every list of bodies.
EFFECTOR = ("palm", "finger", "prong")
#: What the effector takes hold of, and holds.
PAYLOAD = ("bar", "hull", "probe")
#: The bay's walls that face port and starboard (RMS-71, VII.4: a payload may slide along them).
SIDE_WALLS = ("wall_port", "wall_starboard")


def convex_body(part: Part) -> ConvexBody:
    """A box or prism in its body's frame; a cylinder as the prism of eight sides around it."""
    if part.kind == "box":
        body = ConvexBody.box(0.5 * np.array(part.size))
    else:
        across, length = part.size
        axis = "x" if part.kind == "prism" else "z"
        body = ConvexBody.prism(SIDES, across, length, axis)
    roll, pitch, yaw = part.rpy
    R = heading_matrix(yaw) @ pitch_matrix(pitch) @ roll_matrix(roll)
    return body.moved(R, part.position)


def stand_part(config: RemoteManipulatorConfig) -> Part:
    """The stand in a frame at the shoulder, along {R}; what is below the deck does no harm."""
    length = config.stand.upper_m
    size = (config.arm.diameter_m, length)
    return Part(name="stand", kind="cylinder", size=size, position=(0.0, 0.0, 0.5 * length))


def machine_parts(config: RemoteManipulatorConfig) -> tuple[tuple[str, Part], ...]:
    """All solids that the program looks at, with the frame they are in.

    Frames: 2 the effector's, K the prong's, P the payload's, C the CAE's, R the orbiter's, S the
    shoulder's.
    """
    effector = effector_parts(config.effector, config.arm.arm_2_m)
    by_name = {part.name: part for part in payload_parts(config)}
    return (
        *(("2", part) for part in effector),
        ("K", prong_part(config.effector, config.arm.arm_2_m)),
        *(("P", by_name[name]) for name in PAYLOAD),
        *(("R", part) for part in bay_parts(config)),
        *(("R", part) for part in orbiter_parts(config) if part.solid),
        *(("C", part) for part in cae_parts(config) if part.solid),
        ("S", stand_part(config)),
    )


@dataclass(frozen=True)
class Placement:
    """Where everything is in a frame, in {R}.

    Attributes:
        X_R2, X_RP, X_RC: poses of effector, payload and CAE.
        gap: between finger and prong, m.
        height: of the shoulder above the deck, m.
    """

    X_R2: Pose
    X_RP: Pose
    X_RC: Pose
    gap: float
    height: float


class MachineBodies:
    """The bodies of one machine, and where they are.

    Attributes:
        names: of the bodies, in their order.
        bodies: `BodySet` of them.
        free_pairs: of a free effector: each of its hexahedra against all else, (N, 2); the first
            three are with the bar.
        held_pairs: of an effector that holds the payload: both against all else, (M, 2).
    """

    def __init__(self, config: RemoteManipulatorConfig) -> None:
        parts = machine_parts(config)
        self.names = tuple(part.name for _, part in parts)
        self.bodies = BodySet([convex_body(part) for _, part in parts])
        self._rows = {
            frame: [k for k, (own, _) in enumerate(parts) if own == frame] for frame in "2KPCRS"
        }
        self._effector_config = config.effector
        moving, held = len(EFFECTOR), len(EFFECTOR) + len(PAYLOAD)
        everything = len(self.names)
        with_bar = [(k, moving) for k in range(moving)]
        others = [(k, other) for k in range(moving) for other in range(moving + 1, everything)]
        self.free_pairs = np.array(with_bar + others, dtype=np.int64)
        self.held_pairs = np.array(
            [(k, other) for k in range(held) for other in range(held, everything)], dtype=np.int64
        )
        self._R = np.tile(np.eye(3), (everything, 1, 1))
        self._p = np.zeros((everything, 3))

    def poses(self, placement: Placement) -> tuple[Array, Array]:
        """Rotations (B, 3, 3) and positions (B, 3) m of all bodies in {R}."""
        R, p, rows = self._R.copy(), self._p.copy(), self._rows
        for frame, (rotation, position) in (
            ("2", placement.X_R2),
            ("P", placement.X_RP),
            ("C", placement.X_RC),
        ):
            R[rows[frame]], p[rows[frame]] = rotation, position
        prong = rows["K"]
        rotation, position = placement.X_R2
        along = prong_position(self._effector_config, placement.gap)
        R[prong], p[prong] = rotation, position + along * rotation[:, 1]
        p[rows["S"], 2] = -placement.height
        return R, p

    def vertices(self, name: str, R: Array, p: Array) -> Array:
        """A body's vertices at the poses of all, (V, 3) m in {R}."""
        k = self.names.index(name)
        corners: Array = self.bodies.bodies[k].vertices @ R[k].T + p[k]
        return corners
