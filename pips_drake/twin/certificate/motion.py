"""Kinematics of a plant as plain arrays, and how far its points leave their chords.

Between two knots every joint moves linearly in s from 0 to 1, so q'' = 0. For a chain of joints that
starts at a base link, with w the angular velocity and a the angular acceleration of each link seen
from the base (derivatives by s), z_j a joint's axis and o_j a point on it:

    w_j = w_(j-1) + q_j' z_j              a_j = a_(j-1) + q_j' w_(j-1) x z_j
    o_j'' = o_(j-1)'' + a_(j-1) x r + w_(j-1) x (w_(j-1) x r) [+ 2 w_(j-1) x d_j' z_j if it slides]

with r from o_(j-1) to o_j. Norms of these give `bending`. See docs/certificate.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
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

#: Kinds of joints.
FIXED, REVOLUTE, PRISMATIC, FREE = 0, 1, 2, 3
#: The tree's poses must agree with the plant's within this, m and (as entries of rotations) rad.
AGREEMENT = 1e-9


class Tree(NamedTuple):
    """Bodies, each after its parent; body 0 is the world. A plain tuple for compiled code.

    Attributes:
        parent: (B,).
        kind: of the joint to the parent, (B,).
        index: of its first position in q, (B,).
        R_PF, p_PF: the joint's frame F in the parent, (B, 3, 3) and (B, 3) m.
        axis: unit vector in F, (B, 3).
        R_MB, p_MB: the body in the joint's moving frame M, (B, 3, 3) and (B, 3) m.
    """

    parent: Indices
    kind: Indices
    index: Indices
    R_PF: Array
    p_PF: Array
    axis: Array
    R_MB: Array
    p_MB: Array


class Poses(NamedTuple):
    """Where everything is at N knots; all in the world.

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
    waiting = [i for i in range(1, bodies)]
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


def chain(tree: Tree, base: int, body: int) -> list[tuple[int, int]]:
    """The joints from a base body to another: (the joint's body, +1 outward or -1 inward)."""
    inward, outward = _ancestors(tree, base), _ancestors(tree, body)
    common = next(b for b in inward if b in outward)
    steps = [(b, -1) for b in inward[: inward.index(common)]]
    return steps + [(b, 1) for b in reversed(outward[: outward.index(common)])]


def _ancestors(tree: Tree, body: int) -> list[int]:
    line = [body]
    while line[-1] != 0:
        line.append(int(tree.parent[line[-1]]))
    return line


def stack_chains(chains: Sequence[list[tuple[int, int]]]) -> tuple[Indices, Indices]:
    """Chains as rows of (bodies, signs), (L, C); sign 0 where a chain has ended."""
    longest = max((len(steps) for steps in chains), default=0)
    bodies = np.zeros((len(chains), max(longest, 1)), dtype=np.int64)
    signs = np.zeros_like(bodies)
    for row, steps in enumerate(chains):
        for column, (body, sign) in enumerate(steps):
            bodies[row, column], signs[row, column] = body, sign
    return bodies, signs


def interpolate(tree: Tree, q0: Array, q1: Array, s: float) -> Array:
    """Positions at s in [0, 1] between two knots: linear; free bodies turn the shorter way."""
    q = (1.0 - s) * q0 + s * q1
    for b in np.flatnonzero(tree.kind == FREE):
        i = int(tree.index[b])
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


@numba.njit(cache=True)
def _rotate(R, x, out):
    for i in range(3):
        out[i] = R[i, 0] * x[0] + R[i, 1] * x[1] + R[i, 2] * x[2]


@numba.njit(cache=True)
def _multiply(A, B, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@numba.njit(cache=True)
def _axis_rotation(axis, angle, out):
    """Rodrigues' formula."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    v = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * v - y * s, z * y * v + x * s, c + z * z * v


@numba.njit(cache=True)
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
            _multiply(R[k, a], tree.R_PF[b], R_WF)
            _rotate(R[k, a], tree.p_PF[b], x)
            for i in range(3):
                o[k, b, 0, i] = p[k, a, i] + x[i]
                o[k, b, 1, i] = o[k, b, 0, i]
            _rotate(R_WF, tree.axis[b], z[k, b])
            first = tree.index[b]
            if tree.kind[b] == REVOLUTE:
                _axis_rotation(tree.axis[b], q[k, first], R_FM)
                _multiply(R_WF, R_FM, R_WM)
            elif tree.kind[b] == PRISMATIC:
                for i in range(3):
                    for j in range(3):
                        R_WM[i, j] = R_WF[i, j]
                    o[k, b, 1, i] += q[k, first] * z[k, b, i]
            else:
                _quaternion_rotation(q[k], first, R_FM)
                _multiply(R_WF, R_FM, R_WM)
                _rotate(R_WF, q[k, first + 4 : first + 7], x)
                for i in range(3):
                    o[k, b, 1, i] += x[i]
            _multiply(R_WM, tree.R_MB[b], R[k, b])
            _rotate(R_WM, tree.p_MB[b], x)
            for i in range(3):
                p[k, b, i] = o[k, b, 1, i] + x[i]
    return Poses(R, p, z, o)


@numba.njit(cache=True)
def _span(u, v):
    """Distance of two points."""
    return math.sqrt((u[0] - v[0]) ** 2 + (u[1] - v[1]) ** 2 + (u[2] - v[2]) ** 2)


@numba.njit(cache=True)
def _free_turn(tree, poses, b, k, turn):
    """Angle, rad, by which a free body turns from knot k to the next; its axis in the world."""
    R0, R1, a = poses.rotation[k, b], poses.rotation[k + 1, b], tree.parent[b]
    # The body's turn seen from its parent: Q1 Q0^T with Q = (parent)^T (body).
    Q0, Q1, D = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    _multiply(poses.rotation[k, a].T, R0, Q0)
    _multiply(poses.rotation[k + 1, a].T, R1, Q1)
    _multiply(Q1, Q0.T, D)
    x, y, z = D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]
    sine = 0.5 * math.sqrt(x * x + y * y + z * z)
    angle = math.atan2(sine, 0.5 * (D[0, 0] + D[1, 1] + D[2, 2] - 1.0))
    turn[0] = turn[1] = turn[2] = 0.0
    if sine > 1e-9:
        turn[0], turn[1], turn[2] = 0.5 * x / sine, 0.5 * y / sine, 0.5 * z / sine
    return angle


@numba.njit(cache=True)
def bending(tree, poses, q, bodies, signs):
    """Bounds on second derivatives by s of points of each chain's last link, in its base's frame.

    Args:
        bodies, signs: chains, (L, C) each (`stack_chains`).

    Returns:
        acceleration of the last joint's origin, (L, N - 1) m, and what a point of the last link
        adds by each metre of its distance from there, (L, N - 1).
    """
    chains, knots = bodies.shape[0], q.shape[0]
    at_origin, by_reach = np.zeros((chains, knots - 1)), np.zeros((chains, knots - 1))
    w0, w1, u, x = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for row in range(chains):
        for k in range(knots - 1):
            angular = speed = acceleration = 0.0
            for j in range(3):
                w0[j] = w1[j] = 0.0
            last, last_side = -1, 0
            for c in range(bodies.shape[1]):
                sign, b = signs[row, c], bodies[row, c]
                if sign == 0:
                    break
                side = 1 if sign > 0 else 0
                kind, i = tree.kind[b], tree.index[b]
                # A free joint slides, then turns about the body's point; inward the other way round.
                for part in range(2 if kind == FREE else 1):
                    turns = kind == REVOLUTE or (kind == FREE and (part == 1) == (sign > 0))
                    here = side
                    if kind == FREE and turns:
                        here = 1
                    if last >= 0:
                        r = max(
                            _span(poses.origin[k, b, here], poses.origin[k, last, last_side]),
                            _span(
                                poses.origin[k + 1, b, here], poses.origin[k + 1, last, last_side]
                            ),
                        )
                        acceleration += (angular + speed * speed) * r
                    last, last_side = b, here
                    if not turns:
                        if kind == PRISMATIC:
                            slide = abs(q[k + 1, i] - q[k, i])
                        else:
                            slide = _span(q[k + 1, i + 4 : i + 7], q[k, i + 4 : i + 7])
                        acceleration += 2.0 * speed * slide
                        continue
                    if kind == REVOLUTE:
                        angle = q[k + 1, i] - q[k, i]
                        for j in range(3):
                            w0[j] += sign * angle * poses.axis[k, b, j]
                            w1[j] += sign * angle * poses.axis[k + 1, b, j]
                    else:
                        angle = _free_turn(tree, poses, b, k, u)
                        a = tree.parent[b]
                        _rotate(poses.rotation[k, a], u, x)
                        for j in range(3):
                            w0[j] += sign * angle * x[j]
                        _rotate(poses.rotation[k + 1, a], u, x)
                        for j in range(3):
                            w1[j] += sign * angle * x[j]
                    angular += abs(angle) * speed
                    ends = math.sqrt(w0[0] ** 2 + w0[1] ** 2 + w0[2] ** 2) + math.sqrt(
                        w1[0] ** 2 + w1[1] ** 2 + w1[2] ** 2
                    )
                    speed = min(speed + abs(angle), 0.5 * (ends + angular))
            at_origin[row, k] = acceleration
            by_reach[row, k] = angular + speed * speed
    return at_origin, by_reach


@numba.njit(cache=True)
def error_terms(tree, poses, q, bodies, signs, deviation):
    """What errors of the joints add to `bending`, and what they move points beyond first order.

    Returns:
        four (L, N - 1): as `bending` does, additions to the bounds on second derivatives (by which
        first-order displacements leave their chords) and the remainder of second order.
    """
    chains, knots, longest = bodies.shape[0], q.shape[0], bodies.shape[1]
    bend, bend_reach = np.zeros((chains, knots - 1)), np.zeros((chains, knots - 1))
    rest, rest_reach = np.zeros((chains, knots - 1)), np.zeros((chains, knots - 1))
    spans = np.zeros(longest)
    for row in range(chains):
        for k in range(knots - 1):
            angular = speed = acceleration = turn = slide = length = 0.0
            last, last_side = -1, 0
            for c in range(longest):
                sign, b = signs[row, c], bodies[row, c]
                if sign == 0:
                    break
                side, i = (1 if sign > 0 else 0), tree.index[b]
                spans[c] = 0.0
                if last >= 0:
                    spans[c] = max(
                        _span(poses.origin[k, b, side], poses.origin[k, last, last_side]),
                        _span(poses.origin[k + 1, b, side], poses.origin[k + 1, last, last_side]),
                    )
                    if tree.kind[b] == FREE and sign < 0:
                        # Two steps: to the body's point about which it turns, and along its slide.
                        spans[c] = _span(
                            poses.origin[k, b, 1], poses.origin[k, last, last_side]
                        ) + max(
                            _span(poses.origin[k, b, 0], poses.origin[k, b, 1]),
                            _span(poses.origin[k + 1, b, 0], poses.origin[k + 1, b, 1]),
                        )
                last, last_side = b, side
                error = deviation[b]
                if tree.kind[b] == PRISMATIC:
                    spans[c] += error
                length += spans[c]
                acceleration += (angular + speed * speed) * spans[c]
                if tree.kind[b] == PRISMATIC:
                    acceleration += 2.0 * speed * error
                    slide += abs(q[k + 1, i] - q[k, i])
                elif tree.kind[b] == REVOLUTE:
                    angular += error * speed
                    speed += error
                    turn += abs(q[k + 1, i] - q[k, i])
                else:
                    slide += _span(q[k + 1, i + 4 : i + 7], q[k, i + 4 : i + 7])
                    turn += _free_turn(tree, poses, b, k, np.empty(3))
            rest[row, k] = 0.5 * acceleration
            rest_reach[row, k] = 0.5 * (angular + speed * speed)
            for c in range(longest):
                if signs[row, c] == 0:
                    break
                error = deviation[bodies[row, c]]
                # From joint c's origin to the last one's.
                length -= spans[c]
                if tree.kind[bodies[row, c]] == PRISMATIC:
                    bend[row, k] += error * turn * turn
                else:
                    bend[row, k] += error * (turn * turn * length + 2.0 * turn * slide)
                    bend_reach[row, k] += error * turn * turn
    return bend, bend_reach, rest, rest_reach
