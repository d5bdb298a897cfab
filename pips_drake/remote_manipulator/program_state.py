"""What the dynamic collision program remembers from frame to frame, and how it is set up."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.remote_manipulator.phases import Event, Phase

Array = NDArray[np.float64]
Pose = tuple[Array, Array]

#: The operator's frame, s: 20 Hz. RMS-71 says "50 msec" and "1/50 second"; the first is its loop's.
FRAME_PERIOD = 0.05
#: The command: height of the shoulder, six angles, gap of the prong, translation of the orbiter.
COMMAND = 11
HEIGHT, GAP = 0, 7
ANGLES, OFFSET = slice(1, 7), slice(8, 11)

COLLISIONS = ("exact", "report")
INHIBITS = ("direction_aware", "literal")


@dataclass(frozen=True)
class ProgramSettings:
    """The program's choices.

    Attributes:
        collision: exact (whole convex bodies) or report (RMS-71's tests, with what they miss).
        inhibit: direction_aware or literal; see `program`.
        slide_along_walls: a payload slides along the bay's side walls (RMS-71, VII.4).
        snap_to_right_angles: the payload is held at right angles, as MO2SET does.
        limit_master_rates: the master arm is followed no faster than the joints can go.
    """

    collision: str = "exact"
    inhibit: str = "direction_aware"
    slide_along_walls: bool = False
    snap_to_right_angles: bool = False
    limit_master_rates: bool = True

    def __post_init__(self) -> None:
        for name, known in (("collision", COLLISIONS), ("inhibit", INHIBITS)):
            value = getattr(self, name)
            require(value in known, f"ProgramSettings.{name}", value, " or ".join(known))


@dataclass(frozen=True, eq=False)
class ProgramState:
    """The program between two frames.

    Attributes:
        phase: of the task.
        command: what collisions are computed for: the master arm, followed, (11,) m and rad.
        free: the last command that was free of collision, (11,).
        sent: what the scene and the slave arm were last given, (11,).
        arm_collision, finger_collision: flags of the last frame.
        arm_inhibit, finger_inhibit: motion inhibit flags of the last frame.
        held: pose X_2P latched at acquisition, quaternion w x y z and position m, (7,).
        sign: of z2 along the payload's x, latched at acquisition: 1 or -1.
        armed: the port takes a payload; after undocking, once it has been away.
        initializing: channel 1 said so in the last frame.
        planes: D1 to D3, (3, 4).
        event: what changed the phase in the last frame.
        frames, resets, inhibits: how many there have been; `inhibits` counts rises.
    """

    phase: Phase
    command: Array
    free: Array
    sent: Array
    planes: Array
    held: Array
    arm_collision: bool = False
    finger_collision: bool = False
    arm_inhibit: bool = False
    finger_inhibit: bool = False
    sign: int = 1
    armed: bool = True
    initializing: bool = False
    event: Event = Event.NONE
    frames: int = 0
    resets: int = 0
    inhibits: int = 0

    @property
    def inhibited(self) -> bool:
        """Any motion inhibit flag is raised."""
        return self.arm_inhibit or self.finger_inhibit

    def vector(self) -> Array:
        """All of it as numbers, (`STATE_SIZE`,)."""
        return np.concatenate(
            [np.ravel(np.asarray(getattr(self, one.name), dtype=float)) for one in fields(self)]
        )

    @staticmethod
    def of_vector(vector: ArrayLike) -> ProgramState:
        """The state that `vector` made the numbers of."""
        numbers = np.array(vector, dtype=float)
        arrays, start = {}, 1
        for name, shape in _ARRAYS.items():
            size = math.prod(shape)
            arrays[name] = numbers[start : start + size].reshape(shape)
            start += size
        flags = [value != 0.0 for value in numbers[start : start + 4]]
        sign, armed, initializing, event, frames, resets, inhibits = numbers[start + 4 :].tolist()
        return ProgramState(
            Phase(int(numbers[0])),
            **arrays,
            arm_collision=flags[0],
            finger_collision=flags[1],
            arm_inhibit=flags[2],
            finger_inhibit=flags[3],
            sign=int(sign),
            armed=armed != 0.0,
            initializing=initializing != 0.0,
            event=Event(int(event)),
            frames=int(frames),
            resets=int(resets),
            inhibits=int(inhibits),
        )


_ARRAYS: dict[str, tuple[int, ...]] = {
    "command": (COMMAND,),
    "free": (COMMAND,),
    "sent": (COMMAND,),
    "planes": (3, 4),
    "held": (7,),
}
#: Numbers of `ProgramState.vector`.
STATE_SIZE = 1 + sum(math.prod(shape) for shape in _ARRAYS.values()) + 11


def first_state(phase: Phase, command: ArrayLike) -> ProgramState:
    """The state before the first frame.

    Args:
        phase: of the scenario's beginning.
        command: the arm's pose then, (11,).
    """
    where = np.array(command, dtype=float)
    require(where.shape == (COMMAND,), "command: shape", where.shape, f"({COMMAND},)")
    return ProgramState(
        phase=phase,
        command=where,
        free=where,
        sent=where,
        # No plane has been found yet: z = 0, the deck.
        planes=np.tile([0.0, 0.0, 1.0, 0.0], (3, 1)),
        held=np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    )


def cleared(state: ProgramState) -> ProgramState:
    """Without collision and inhibit flags, as MO2SET leaves them."""
    return replace(
        state,
        arm_collision=False,
        finger_collision=False,
        arm_inhibit=False,
        finger_inhibit=False,
    )


def pose_of(vector: ArrayLike) -> Pose:
    """Rotation (3, 3) and position (3,) m of a pose (7,): quaternion w x y z, position.

    The quaternion is taken as a direction: its length does not matter.
    """
    w, x, y, z, *p = np.asarray(vector, dtype=float).tolist()
    s = 2.0 / (w * w + x * x + y * y + z * z)
    R = np.array(
        [
            [1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)],
        ]
    )
    return R, np.array(p)


def vector_of(pose: Pose) -> Array:
    """A pose as quaternion w x y z (w >= 0) and position m, (7,)."""
    R, p = pose
    m = R.tolist()
    trace = m[0][0] + m[1][1] + m[2][2]
    # The largest of the four is found first, so that nothing small is divided by (Shepperd, 1978).
    squares = (trace, m[0][0], m[1][1], m[2][2])
    k = squares.index(max(squares))
    if k == 0:
        q = [1.0 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]]
    else:
        i, j, n = k - 1, k % 3, (k + 1) % 3
        q = [0.0] * 4
        q[0] = m[n][j] - m[j][n]
        q[1 + i] = 1.0 + m[i][i] - m[j][j] - m[n][n]
        q[1 + j] = m[j][i] + m[i][j]
        q[1 + n] = m[n][i] + m[i][n]
    length = math.copysign(math.hypot(*q), q[0])
    return np.array([value / length for value in q] + list(p))
