"""A bare gap between a cylinder and a wall of staves, whose shortest paths are known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from pydrake.geometry import Box, Cylinder
from pydrake.math import RigidTransform, RollPitchYaw

from pips_drake.planning.grid import Grid
from pips_drake.scene.signed_distance import PlacedShape, SignedDistanceField

WALL, PAYLOAD, LENGTH, ARM, STAVES = 2.286, 1.79, 18.288, 0.1, 36
FACE = WALL * np.cos(np.pi / STAVES)


#: Between payload and wall.
MIDDLE = 2.03


def at(around, along, out=MIDDLE):
    """A place in the gap, (3,) m."""
    return np.array([out * np.cos(around), out * np.sin(around), along])


def post(name, around, along, width, height):
    """A box across the gap, `width` around (m) and `height` along."""
    X_WG = RigidTransform(RollPitchYaw(0.0, 0.0, around), at(around, along))
    return PlacedShape(name, "", Box(0.7, width, height), X_WG)


def bare_gap():
    """No ends: nothing but the gap is inside."""
    shapes = [PlacedShape("payload", "", Cylinder(PAYLOAD, 100.0), RigidTransform())]
    for k in range(STAVES):
        angle, out = 2.0 * np.pi * k / STAVES, FACE + 0.025
        X_WG = RigidTransform(
            RollPitchYaw(0.0, 0.0, angle), [out * np.cos(angle), out * np.sin(angle), 0.0]
        )
        shapes.append(PlacedShape("wall", f"stave_{k}", Box(0.05, 0.41, 100.0), X_WG))
    return SignedDistanceField.of(shapes)


def cartesian_grid(shape=(120, 120, 400)):
    corner = np.array([2.29, 2.29, 0.5 * LENGTH])
    return Grid(lower=-corner, upper=corner, shape=shape)


def unfolded_grid(shape=(400, 160, 13)):
    return Grid(
        lower=np.array([-0.5 * LENGTH, -np.pi, PAYLOAD]),
        upper=np.array([0.5 * LENGTH, np.pi, FACE]),
        shape=shape,
        unfolded=True,
    )


def random_pairs(rng, count):
    """Points in the gap where the arm fits, (count, 2, 3) m."""
    around = rng.uniform(-np.pi, np.pi, (count, 2))
    out = rng.uniform(PAYLOAD + ARM + 0.03, FACE - ARM - 0.03, (count, 2))
    along = rng.uniform(-0.49 * LENGTH, 0.49 * LENGTH, (count, 2))
    return np.stack([out * np.cos(around), out * np.sin(around), along], axis=-1)


def taut_length(p, q):
    """Of a string from p to q around the grown payload, the shorter way, m.

    Seen along the axis it is two tangents and an arc; its height grows evenly with that length.
    The wall, which is convex from inside, never matters.
    """
    radius = PAYLOAD + ARM
    a, b = np.hypot(*p[:2]), np.hypot(*q[:2])
    turn = np.arctan2(p[1], p[0]) - np.arctan2(q[1], q[0])
    turn = abs((turn + np.pi) % (2.0 * np.pi) - np.pi)
    arc = turn - np.arccos(radius / a) - np.arccos(radius / b)
    if arc > 0.0:
        flat = np.sqrt(a * a - radius**2) + np.sqrt(b * b - radius**2) + radius * arc
    else:
        flat = np.linalg.norm(p[:2] - q[:2])
    return float(np.hypot(flat, p[2] - q[2]))


def dense(path, spacing=1e-3):
    """Points on a polyline, (N, 3) m."""
    parts = []
    for a, b in pairwise(path):
        count = max(2, int(np.linalg.norm(b - a) / spacing))
        parts.append(a + np.linspace(0.0, 1.0, count)[:, None] * (b - a))
    return np.concatenate(parts)
