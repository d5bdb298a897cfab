"""A corridor between a cylinder and a wall ahead of the arm, and an arm on a snake in it."""

from __future__ import annotations

import numpy as np
from pydrake.geometry import Box, Cylinder, Sphere
from pydrake.math import RigidTransform

from pips_drake.planning.live_arm import LiveArm
from pips_drake.scene.signed_distance import PlacedShape, SignedDistanceField
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.links import collision_shapes

#: The payload's surface and the wall's, m along x0; the arm's base line runs between them.
PAYLOAD, WALL = 0.1, 0.72


def corridor(*spheres):
    """A payload of 1.8 m radius, a plane wall 0.62 m from it at y0 = 0, balls (x, y, z, r).

    Both begin 0.2 m beyond the camera head at home: the carriage does not come so far.
    """
    shapes = [
        PlacedShape("payload", "", Cylinder(1.8, 20.0), RigidTransform([PAYLOAD - 1.8, 0.0, 20.1])),
        PlacedShape("wall", "", Box(0.2, 20.0, 20.0), RigidTransform([WALL + 0.1, 0.0, 20.1])),
    ]
    for k, (x, y, z, r) in enumerate(spheres):
        shapes.append(PlacedShape(f"ball_{k}", "", Sphere(r), RigidTransform([x, y, z])))
    return SignedDistanceField.of(shapes)


def home_tip(arm):
    """In frame {0}, which is the scene's here."""
    return kinematics.spine_points(arm, arm.joint_home)[0, -1]


def along_the_corridor(arm, length=4.0):
    """A path of the tip from home: straight on."""
    tip = home_tip(arm)
    return tip + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, length]])


def live_arm(arm, *spheres, **kwargs):
    return LiveArm(arm, corridor(*spheres), **kwargs)


def distance_of_bodies(arm, field, joints, shift=0.0):
    """Least distance (m) of points on the surfaces of an arm's boxes: an upper bound of the truth.

    Thirds of edges and faces, and the balls' middles less their radius.
    """
    poses = kinematics.frames(arm, joints)[0]
    share = np.linspace(-1.0, 1.0, 4)
    grid = np.stack(np.meshgrid(share, share, share), axis=-1).reshape(-1, 3)
    surface = grid[(np.abs(grid) == 1.0).any(axis=1)]
    points, radii = [], []
    for j, body in enumerate(arm.bodies):
        for shape in collision_shapes(arm, body):
            half = 0.5 * shape.size if shape.kind == "box" else np.zeros(3)
            here = shape.centre + (surface * half if shape.kind == "box" else np.zeros((1, 3)))
            points.append(here @ poses[j, :3, :3].T + poses[j, :3, 3] + [0.0, 0.0, shift])
            radii.append(np.full(len(here), 0.0 if shape.kind == "box" else shape.size[0]))
    return float((field.distances(np.concatenate(points)) - np.concatenate(radii)).min())
