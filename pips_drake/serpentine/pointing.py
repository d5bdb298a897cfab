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
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm

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
    X = kinematics.frames(arm, joints)[0, -2]
    local: Array = X[:3, :3].T @ (np.asarray(target, dtype=np.float64) - X[:3, 3])
    return local


def joint_towards(mount: CameraMount, target: ArrayLike, *, otherwise: float = 0.0) -> float:
    """The last joint's angle, rad, within its limits, that leaves the least pan.

    Args:
        target: (3,) m in the frame before the last.
        otherwise: the angle if the target lies on the hinge's axis, where all are alike.
    """
    x, _, z = np.asarray(target, dtype=np.float64) - [mount.hinge, 0.0, 0.0]
    angle = math.atan2(-z, x) if math.hypot(x, z) > 1e-9 else otherwise
    return min(max(angle, mount.joint_lower), mount.joint_upper)


def pan_tilt_towards(
    arm: SerpentineArm, mount: CameraMount, target: ArrayLike, joint: float
) -> tuple[float, float]:
    """Pan and tilt, rad, within their limits, towards a target with the last joint at `joint`.

    Args:
        target: (3,) m in the frame before the last.
    """
    x, y, z = np.asarray(target, dtype=np.float64) - [mount.hinge, 0.0, 0.0]
    c, s = math.cos(joint), math.sin(joint)
    # In the last frame: x along the link, and y and z so that a positive joint turns x to y, or
    # away from it in the mirrored hand, whose frames are reflected in their x-z planes.
    hand = float(arm.mirror[1])
    ahead, aside, up = c * x - s * z - mount.reach, -hand * (s * x + c * z), hand * y
    pan, tilt = math.atan2(aside, ahead), math.atan2(up, math.hypot(ahead, aside))
    return (
        min(max(pan, -mount.pan_limit), mount.pan_limit),
        min(max(tilt, -mount.tilt_limit), mount.tilt_limit),
    )


def aim(arm: SerpentineArm, mount: CameraMount, joints: ArrayLike, target: ArrayLike) -> Aim:
    """How to look at a target (3,) m in frame {0} from joints (J,); the last of them is not used.

    A target out of reach of pan or tilt is looked towards as far as they go.
    """
    local = target_before_last(arm, joints, target)
    joint = joint_towards(mount, local, otherwise=float(np.asarray(joints)[-1]))
    pan, tilt = pan_tilt_towards(arm, mount, local, joint)
    return Aim(joint=joint, pan=pan, tilt=tilt)
