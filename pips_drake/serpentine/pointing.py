"""Points the arm's camera: the last joint as far as it goes, pan and tilt for the rest.

The camera's centre sits on the last link's x axis, at the head's front; it pans about the last
frame's z, the last joint's own axis, and tilts towards that z. With the target at (x, y, z) in the
frame before the last, and the hinge at (S, 0, 0) there, the last link's x axis lies along
(cos theta, 0, -sin theta) in either hand of the arm. The target lies in the plane of that axis and
z, so that no pan is left, if

    theta = atan2(-z, x - S).

Clipped to its limits, the joint leaves the rest of the angle to the pan. What stands out of the
hinge's plane is the tilt's: no joint of the arm can take it without leaving the path.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from functools import cached_property

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.dh_chain import joint_frames

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CameraMount:
    """Where the camera sits on an arm, and how far it turns.

    Attributes:
        hinge: distance of the last joint's axis from the frame before, S, m.
        reach: distance of the camera's centre from that axis, m.
        joint_lower, joint_upper: of the last joint when it points the camera, rad.
        joint_speed: of the last joint, rad/s.
        pan_limit, tilt_limit: either way, rad.
        pan_tilt_speed: of pan and of tilt, rad/s.
    """

    hinge: float
    reach: float
    joint_lower: float
    joint_upper: float
    joint_speed: float
    pan_limit: float
    tilt_limit: float
    pan_tilt_speed: float

    @cached_property
    def numbers(self) -> tuple[float, ...]:
        """All of it in the order above, as compiled functions take it."""
        return astuple(self)


@dataclass(frozen=True, kw_only=True)
class Aim:
    """How to look at a target.

    Attributes:
        joint: of the last joint, rad.
        pan, tilt: rad.
    """

    joint: float
    pan: float
    tilt: float


def make_mount(
    arm: SerpentineArm,
    *,
    pan_limit: float = math.radians(60.0),
    tilt_limit: float = math.radians(80.0),
    pan_tilt_speed: float = math.radians(30.0),
    joint_margin: float = math.radians(2.0),
    speed_share: float = 0.5,
) -> CameraMount:
    """The camera of an arm.

    Args:
        pan_limit, tilt_limit, pan_tilt_speed: of the camera's own unit, rad and rad/s. Assumed.
        joint_margin: how far inside its limits the last joint stays, rad.
        speed_share: the share of its actuator's speed that the last joint may use.

    Raises:
        InputError: the margin leaves the joint nowhere to be.
    """
    lower, upper = arm.joint_lower[-1] + joint_margin, arm.joint_upper[-1] - joint_margin
    require(lower < upper, "camera's joint margin", f"{joint_margin} rad", "less than the range")
    # The joint is slowest where its lever is longest.
    angles = np.linspace(arm.joint_lower[-1], arm.joint_upper[-1], 101)
    levers = np.array([arm.linkage.lever(angle)[-1] for angle in angles])
    speed = speed_share * float(arm.linkage.speed_limit[-1] / levers.max())
    return CameraMount(
        hinge=float(arm.segment_length[-1]),
        reach=float(arm.bodies[-1].size[0]),
        joint_lower=float(lower),
        joint_upper=float(upper),
        joint_speed=speed,
        pan_limit=pan_limit,
        tilt_limit=tilt_limit,
        pan_tilt_speed=pan_tilt_speed,
    )


def target_before_last(arm: SerpentineArm, joints: ArrayLike, target: ArrayLike) -> Array:
    """A target (3,) m in frame {0} as the frame before the last has it, (3,) m."""
    q, point = np.asarray(joints, dtype=np.float64), np.asarray(target, dtype=np.float64)
    require(q.shape == (arm.joints,), "joint values' shape", f"{q.shape}", f"({arm.joints},)")
    local: Array = _target_before_last(arm.dh_table[:-1], arm.mirror, q, point)
    return local


def joint_towards(mount: CameraMount, target: ArrayLike, *, otherwise: float = 0.0) -> float:
    """The last joint's angle, rad, within its limits, that leaves the least pan.

    Args:
        target: (3,) m in the frame before the last.
        otherwise: the angle if the target lies on the hinge's axis, where all are alike.
    """
    return float(_joint_towards(mount.numbers, np.asarray(target, dtype=np.float64), otherwise))


def pan_tilt_towards(
    arm: SerpentineArm, mount: CameraMount, target: ArrayLike, joint: float
) -> tuple[float, float]:
    """Pan and tilt, rad, within their limits, towards a target with the last joint at `joint`.

    Args:
        target: (3,) m in the frame before the last.
    """
    point = np.asarray(target, dtype=np.float64)
    pan, tilt = _pan_tilt_towards(mount.numbers, float(arm.mirror[1]), point, joint)
    return float(pan), float(tilt)


def aim(arm: SerpentineArm, mount: CameraMount, joints: ArrayLike, target: ArrayLike) -> Aim:
    """How to look at a target (3,) m in frame {0} from joints (J,); the last of them is not used.

    A target out of reach of pan or tilt is looked towards as far as they go.
    """
    local = target_before_last(arm, joints, target)
    joint = joint_towards(mount, local, otherwise=float(np.asarray(joints)[-1]))
    pan, tilt = pan_tilt_towards(arm, mount, local, joint)
    return Aim(joint=joint, pan=pan, tilt=tilt)


@numba.njit(cache=True)
def _target_before_last(dh, mirror, joints, target):
    """`target_before_last` by the chain's rows up to that frame, (J - 1, 5)."""
    rows = dh.shape[0]
    rotations, origins = np.empty((rows, 3, 3)), np.empty((rows, 3))
    joint_frames(dh, joints, rotations, origins)
    local = np.zeros(3)
    for k in range(3):
        for m in range(3):
            # A mirrored arm's frame is M R M at M o (`kinematics`).
            away = mirror[m] * target[m] - origins[rows - 1, m]
            local[k] += mirror[k] * rotations[rows - 1, m, k] * away
    return local


@numba.njit(cache=True)
def _joint_towards(mount, target, otherwise):
    hinge, _, lower, upper, _, _, _, _ = mount
    x, z = target[0] - hinge, target[2]
    angle = math.atan2(-z, x) if math.hypot(x, z) > 1e-9 else otherwise
    return min(max(angle, lower), upper)


@numba.njit(cache=True)
def _pan_tilt_towards(mount, hand, target, joint):
    hinge, reach, _, _, _, pan_limit, tilt_limit, _ = mount
    x, y, z = target[0] - hinge, target[1], target[2]
    c, s = math.cos(joint), math.sin(joint)
    # In the last frame: x along the link, and y and z so that a positive joint turns x to y, or
    # away from it in the mirrored hand, whose frames are reflected in their x-z planes.
    ahead, aside, up = c * x - s * z - reach, -hand * (s * x + c * z), hand * y
    pan, tilt = math.atan2(aside, ahead), math.atan2(up, math.hypot(ahead, aside))
    return (
        min(max(pan, -pan_limit), pan_limit),
        min(max(tilt, -tilt_limit), tilt_limit),
    )


@numba.njit(cache=True)
def _towards(before, wanted, reach):
    """From `before` to `wanted`, but by no more than `reach`."""
    return before + min(max(wanted - before, -reach), reach)


@numba.njit(cache=True)
def step_pointing(dh, mirror, mount, gain, period, joints, target, state):
    """One period of a camera that is kept on its target (`CameraPointer` has the law).

    Args:
        dh: the chain's rows up to the frame before the last, (J - 1, 5).
        mirror: `SerpentineArm.mirror`, (3,).
        mount: `CameraMount.numbers`.
        gain: 1/s.
        period: s.
        joints: joint values (at least J - 1,), m and rad.
        target: in frame {0}, (3,) m.
        state: in and out, last joint and its rate, pan, tilt, (4,) rad and rad/s.
    """
    _, _, _, _, joint_speed, _, _, pan_tilt_speed = mount
    local = _target_before_last(dh, mirror, joints, target)
    joint, rate, pan, tilt = state
    missing = _joint_towards(mount, local, joint) - joint
    rate = _towards(rate, _towards(0.0, gain * missing, joint_speed), gain * joint_speed * period)
    joint += rate * period
    pan_after, tilt_after = _pan_tilt_towards(mount, mirror[1], local, joint)
    reach = pan_tilt_speed * period
    state[0], state[1] = joint, rate
    state[2], state[3] = _towards(pan, pan_after, reach), _towards(tilt, tilt_after, reach)
