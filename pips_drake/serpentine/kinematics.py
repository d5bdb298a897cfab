"""Forward kinematics of a serpentine arm, vectorised over postures.

Frames are Craig's: frame {j} sits on joint j's axis Z_j, and FTL-95 Table A.1 gives
`{j-1}T{j} = RotX(alpha) TransX(a) RotZ(theta) TransZ(d)`. Everything is expressed in frame {0}.
A mirrored arm's frames are M F M with M the reflection in the x0-z0 plane, so that the same joint
values mean the same hinges; a revolute joint then turns about -Z of its frame.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.dh_chain import joint_frames_many
from pips_drake.serpentine.motion_base import base_roots_many
from pips_drake.serpentine.spine_inverse import joints_from_spines, make_mechanism

Array = NDArray[np.float64]


def _as_postures(arm: SerpentineArm, q: ArrayLike) -> Array:
    """The postures as (N, joints) float64."""
    postures = np.atleast_2d(np.asarray(q, dtype=np.float64))
    if postures.ndim != 2 or postures.shape[1] != arm.joints:
        raise InputError(
            f"joint values of shape {np.shape(q)}; must be (N, {arm.joints}) for arm '{arm.name}'"
        )
    return postures


def frames(arm: SerpentineArm, q: ArrayLike) -> Array:
    """Poses of all joint frames in frame {0} (FTL-95 Eq 2.1 applied along Table A.1).

    Args:
        q: joint values (N, joints) or (joints,), m and rad.

    Returns:
        homogeneous transforms (N, joints, 4, 4), translations in m.
    """
    rotations, origins = joint_frames_many(arm.dh_table, _as_postures(arm, q))
    mirror = arm.mirror
    result = np.zeros((*rotations.shape[:2], 4, 4))
    result[..., :3, :3] = mirror[:, None] * rotations * mirror
    result[..., :3, 3] = mirror * origins
    result[..., 3, 3] = 1.0
    return result


def joint_axes(arm: SerpentineArm, transforms: Array) -> Array:
    """Unit axes (N, joints, 3) of the joints in frame {0}, positive with the joint value."""
    axes: Array = transforms[..., :3, 2].copy()
    if arm.mirrored:
        axes[:, ~arm.is_prismatic] *= -1.0
    return axes


def spine_points(arm: SerpentineArm, q: ArrayLike) -> Array:
    """Controlled spine points 4, 6, ... (N, M + 1, 3) m in frame {0}."""
    return frames(arm, q)[:, :, :3, 3][:, [j - 1 for j in arm.spine_indices]]


def centre_line(arm: SerpentineArm, q: ArrayLike) -> Array:
    """Corners of the arm's centre line, (N, 2 S, 3) m in frame {0}: the origins of frames 3 on."""
    return frames(arm, q)[:, arm.first_actuated_joint :, :3, 3]


def jacobian(arm: SerpentineArm, q: ArrayLike, joint: int | None = None) -> Array:
    """Geometric Jacobians (N, 6, joints) of a joint frame's origin, expressed in frame {0}.

    Rows are angular (rad/s) then linear velocity (m/s) for unit joint rates.

    Args:
        q: joint values (N, joints) or (joints,), m and rad.
        joint: the frame's number in FTL-95 (1 is d1's); the last (the tip) by default.
    """
    transforms = frames(arm, q)
    last = arm.joints if joint is None else joint
    if not 1 <= last <= arm.joints:
        raise InputError(f"joint frame {last}; must be 1 .. {arm.joints} for arm '{arm.name}'")
    axes = joint_axes(arm, transforms)[:, :last]
    reach = transforms[:, last - 1, None, :3, 3] - transforms[:, :last, :3, 3]
    sliding = arm.is_prismatic[:last][None, :, None]
    result = np.zeros((transforms.shape[0], 6, arm.joints))
    result[:, :3, :last] = np.where(sliding, 0.0, axes).transpose(0, 2, 1)
    result[:, 3:, :last] = np.where(sliding, axes, np.cross(axes, reach)).transpose(0, 2, 1)
    return result


def module_lengths(arm: SerpentineArm, odd_angles: ArrayLike) -> Array:
    """Q_i (N, M) m at the modules' odd angles (N, M) rad: FTL-95 Eq 3.4."""
    offset, length = arm.chain.T
    odd = np.asarray(odd_angles, dtype=np.float64)
    squared: Array = offset**2 + 2.0 * offset * length * np.cos(odd) + length**2
    return np.sqrt(squared)


def motion_base_roots(arm: SerpentineArm, points: ArrayLike) -> Array:
    """Both inverse solutions of the motion base for first spine points (N, 3) m in frame {0}.

    Returns:
        (N, 2, base joints) m and rad (FTL-95 Eqs 3.11 to 3.15); NaN where there is none.
    """
    targets = np.atleast_2d(np.asarray(points, dtype=np.float64)) * arm.mirror
    return base_roots_many(arm.base.kind, arm.base.parameters, targets)


def spine_inverse(arm: SerpentineArm, spine: ArrayLike) -> Array:
    """Joints that put the spine points where they are given (FTL-95 section 3.4).

    Args:
        spine: spine points (N, M + 1, 3) m in frame {0}, at distances that the modules can have.

    Returns:
        joints (N, joints) m and rad, the last 0; NaN where the base does not reach. The modules'
        angles are exact only for spine points at distances that agree with Eq 3.4.
    """
    points = np.asarray(spine, dtype=np.float64).reshape(-1, arm.modules + 1, 3) * arm.mirror
    return joints_from_spines(make_mechanism(arm), points)
