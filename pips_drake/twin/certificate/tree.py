"""Kinematics of a plant as plain arrays: a tree of bodies that slide or turn on their parents.

The plant is read once; its poses are compared with the tree's at some knots of the motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError

if TYPE_CHECKING:
    from pydrake.multibody.plant import MultibodyPlant

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Compiles functions that only compiled ones may call (Python would crash): without the wrappers
#: for Python, which take longer to compile than the functions.
inner = numba.njit(cache=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)

#: Kinds of joints.
FIXED, REVOLUTE, PRISMATIC, FREE = 0, 1, 2, 3
#: The tree's poses must agree with the plant's within this, m and (as entries of rotations) rad.
AGREEMENT = 1e-9


class Tree(NamedTuple):
    """Bodies, each after its parent; body 0 is the world. A plain tuple for compiled code.

    Attributes:
        parent: (B,).
        kind: of the joint to the parent, (B,).
        start: of its first position in q, (B,).
        R_PF, p_PF: the joint's frame F in the parent, (B, 3, 3) and (B, 3) m.
        axis: unit vector in F, (B, 3).
        R_MB, p_MB: the body in the joint's moving frame M, (B, 3, 3) and (B, 3) m.
    """

    parent: Indices
    kind: Indices
    start: Indices
    R_PF: Array
    p_PF: Array
    axis: Array
    R_MB: Array
    p_MB: Array


class Poses(NamedTuple):
    """Where everything is at N knots, in the world.

    Attributes:
        rotation, position: of the bodies, (N, B, 3, 3) and (N, B, 3) m.
        axis: of each body's joint, (N, B, 3).
        origin: of each joint, as a point of the parent [0] and of the body [1], (N, B, 2, 3) m;
            the same unless the joint slides.
    """

    rotation: Array
    position: Array
    axis: Array
    origin: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadTree:
    """A tree, and where the plant's bodies are in it.

    Attributes:
        number: by the plant's body index, the tree's body that it is part of.
        rotation, origin: the plant's body in that, (plant bodies, 3, 3) and (.., 3) m.
    """

    tree: Tree
    number: tuple[int, ...]
    rotation: Array
    origin: Array


def read_tree(plant: MultibodyPlant, knots: Array) -> ReadTree:
    """The plant's kinematics; bodies without a joint that moves become part of their parents.

    Args:
        plant: finalized.
        knots: (N, plant.num_positions()). A joint of a kind that is not known here must keep still.

    Raises:
        InputError: such a joint moves, or the poses do not come out as the plant's.
    """
    from pydrake.multibody.tree import JointIndex

    joints = {}
    for i in (
        plant.GetJointIndices() if hasattr(plant, "GetJointIndices") else range(plant.num_joints())
    ):
        joint = plant.get_joint(JointIndex(int(i)))
        joints[int(joint.child_body().index())] = joint
    bodies = plant.num_bodies()
    number, rotation, origin = [-1] * bodies, np.zeros((bodies, 3, 3)), np.zeros((bodies, 3))
    number[0], rotation[0] = 0, np.eye(3)
    rows = [_row(0, FIXED, 0, np.eye(3), np.zeros(3), np.zeros(3), np.eye(3), np.zeros(3))]
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, knots[0])
    waiting = list(range(1, bodies))
    while waiting:
        left = []
        for i in waiting:
            joint = joints.get(i)
            if joint is None:
                raise InputError(f"body {plant.get_body(_body(i)).scoped_name()} has no joint")
            parent = int(joint.parent_body().index())
            if number[parent] < 0:
                left.append(i)
                continue
            kind, axis = _kind(joint, knots)
            R_TP, p_TP = rotation[parent], origin[parent]
            if kind == FIXED:
                X_PB = plant.CalcRelativeTransform(
                    context, joint.parent_body().body_frame(), joint.child_body().body_frame()
                )
                number[i] = number[parent]
                rotation[i] = R_TP @ X_PB.rotation().matrix()
                origin[i] = R_TP @ X_PB.translation() + p_TP
                continue
            X_PF = joint.frame_on_parent().GetFixedPoseInBodyFrame()
            X_MB = joint.frame_on_child().GetFixedPoseInBodyFrame().inverse()
            number[i], rotation[i] = len(rows), np.eye(3)
            rows.append(
                _row(
                    number[parent],
                    kind,
                    joint.position_start(),
                    R_TP @ X_PF.rotation().matrix(),
                    R_TP @ X_PF.translation() + p_TP,
                    axis,
                    X_MB.rotation().matrix(),
                    X_MB.translation(),
                )
            )
        waiting = left
    tree = Tree(
        *(np.ascontiguousarray(column) for column in map(np.array, zip(*rows, strict=True)))
    )
    read = ReadTree(tree=tree, number=tuple(number), rotation=rotation, origin=origin)
    _compare(plant, context, read, knots)
    return read


def _row(*values: object) -> tuple[object, ...]:
    return values


def _body(i: int) -> object:
    from pydrake.multibody.tree import BodyIndex

    return BodyIndex(i)


def _kind(joint: object, knots: Array) -> tuple[int, Array]:
    """Kind and axis of a joint."""
    first, count = joint.position_start(), joint.num_positions()  # type: ignore[attr-defined]
    moves = count > 0 and bool(np.any(np.ptp(knots[:, first : first + count], axis=0) > 0.0))
    name = joint.type_name()  # type: ignore[attr-defined]
    if name == "revolute":
        return REVOLUTE, joint.revolute_axis()  # type: ignore[attr-defined]
    if name == "prismatic":
        return PRISMATIC, joint.translation_axis()  # type: ignore[attr-defined]
    if not moves:
        return FIXED, np.zeros(3)
    if name == "quaternion_floating":
        return FREE, np.zeros(3)
    raise InputError(
        f"joint {joint.name()} of kind {name} moves; a certified motion must be of joints of kind "  # type: ignore[attr-defined]
        "revolute, prismatic or quaternion_floating"
    )


def _compare(plant: MultibodyPlant, context: object, read: ReadTree, knots: Array) -> None:
    """Refuses a tree that does not move as its plant does."""
    rows = sorted({0, len(knots) // 2, len(knots) - 1})
    poses = calc_poses(read.tree, np.ascontiguousarray(knots[rows]))
    for k, row in enumerate(rows):
        plant.SetPositions(context, knots[row])
        for i, number in enumerate(read.number):
            X_WB = plant.EvalBodyPoseInWorld(context, plant.get_body(_body(i)))
            R, p = poses.rotation[k, number], poses.position[k, number]
            off = max(
                float(np.abs(R @ read.rotation[i] - X_WB.rotation().matrix()).max()),
                float(np.abs(R @ read.origin[i] + p - X_WB.translation()).max()),
            )
            if not off <= AGREEMENT:
                raise InputError(
                    f"body {plant.get_body(_body(i)).scoped_name()} is {off:.3g} off its pose in "
                    f"the plant; must be <= {AGREEMENT:g} (m, and entries of the rotation)"
                )


def interpolate(tree: Tree, q0: Array, q1: Array, s: float) -> Array:
    """Positions at s in [0, 1] between two knots: linear; free bodies turn the shorter way."""
    q = (1.0 - s) * q0 + s * q1
    for b in np.flatnonzero(tree.kind == FREE):
        i = int(tree.start[b])
        first, second = q0[i : i + 4], q1[i : i + 4]
        first, second = first / np.linalg.norm(first), second / np.linalg.norm(second)
        second = second if first @ second >= 0.0 else -second
        # The angle between quaternions from their chord: exact where they nearly agree.
        half = 2.0 * math.asin(min(1.0, 0.5 * float(np.linalg.norm(second - first))))
        if half > 1e-12:
            q[i : i + 4] = (
                math.sin((1.0 - s) * half) * first + math.sin(s * half) * second
            ) / math.sin(half)
        else:
            q[i : i + 4] = first
    return q


@inner
def rotate(R, x, out):
    for i in range(3):
        out[i] = R[i, 0] * x[0] + R[i, 1] * x[1] + R[i, 2] * x[2]


@inner
def multiply(A, B, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@inner
def _axis_rotation(axis, angle, out):
    """Rodrigues' formula."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    v = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * v - y * s, z * y * v + x * s, c + z * z * v


@inner
def _quaternion_rotation(q, i, out):
    w, x, y, z = q[i], q[i + 1], q[i + 2], q[i + 3]
    f = 2.0 / (w * w + x * x + y * y + z * z)
    out[0, 0], out[0, 1], out[0, 2] = (
        1.0 - f * (y * y + z * z),
        f * (x * y - z * w),
        f * (x * z + y * w),
    )
    out[1, 0], out[1, 1], out[1, 2] = (
        f * (x * y + z * w),
        1.0 - f * (x * x + z * z),
        f * (y * z - x * w),
    )
    out[2, 0], out[2, 1], out[2, 2] = (
        f * (x * z - y * w),
        f * (y * z + x * w),
        1.0 - f * (x * x + y * y),
    )


@numba.njit(cache=True)
def calc_poses(tree, q):
    """Poses of a tree at positions (N, nq)."""
    count, bodies = q.shape[0], tree.parent.shape[0]
    R, p = np.zeros((count, bodies, 3, 3)), np.zeros((count, bodies, 3))
    z, o = np.zeros((count, bodies, 3)), np.zeros((count, bodies, 2, 3))
    R_FM, R_WF, R_WM, x = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for k in range(count):
        for i in range(3):
            R[k, 0, i, i] = 1.0
        for b in range(1, bodies):
            a = tree.parent[b]
            multiply(R[k, a], tree.R_PF[b], R_WF)
            rotate(R[k, a], tree.p_PF[b], x)
            for i in range(3):
                o[k, b, 0, i] = p[k, a, i] + x[i]
                o[k, b, 1, i] = o[k, b, 0, i]
            rotate(R_WF, tree.axis[b], z[k, b])
            first = tree.start[b]
            if tree.kind[b] == REVOLUTE:
                _axis_rotation(tree.axis[b], q[k, first], R_FM)
                multiply(R_WF, R_FM, R_WM)
            elif tree.kind[b] == PRISMATIC:
                for i in range(3):
                    for j in range(3):
                        R_WM[i, j] = R_WF[i, j]
                    o[k, b, 1, i] += q[k, first] * z[k, b, i]
            else:
                _quaternion_rotation(q[k], first, R_FM)
                multiply(R_WF, R_FM, R_WM)
                rotate(R_WF, q[k, first + 4 : first + 7], x)
                for i in range(3):
                    o[k, b, 1, i] += x[i]
            multiply(R_WM, tree.R_MB[b], R[k, b])
            rotate(R_WM, tree.p_MB[b], x)
            for i in range(3):
                p[k, b, i] = o[k, b, 1, i] + x[i]
    return Poses(R, p, z, o)
