"""The plant: the platform, free in the world, with posts and obstacles that it may hit.

The cables are no bodies: `CableForces` pulls the platform as explicit springs do. A discrete plant
advances velocities first and positions with them, which follows a spring of the frequency w, rad/s,
as long as w times the step is below 2, and damping of the time tau as long as tau w^2 times the
step is. Settings are refused from half of these on: there the frequency is wrong by 5 %.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box, CollisionFilterDeclaration, Cylinder, SceneGraph, Shape, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody, SpatialInertia, UnitInertia
from pydrake.systems.framework import DiagramBuilder
from scipy.linalg import eigh

from pips_drake.cable_robot.kinematics import Poses
from pips_drake.cable_robot.robot import SPATIAL, CableRobot
from pips_drake.cable_robot.statics import distribute_tensions
from pips_drake.cable_robot.stiffness import full_stiffness
from pips_drake.cable_robot.systems.tension_controller import box_inertia
from pips_drake.config import require
from pips_drake.errors import InputError

Array = NDArray[np.float64]

#: Of the frequency w and of tau w^2, with the step: see above.
LARGEST_SHARE = 1.0
#: The camera's head: a ball below the platform that holds the camera at every tilt, m.
HEAD_PLACE, HEAD_RADIUS = (0.0, 0.0, -0.28), 0.08
POST_RADIUS = 0.1
_FRICTION = CoulombFriction(0.5, 0.5)
_COLORS = {
    "platform": (0.0, 0.447, 0.698, 1.0),
    "camera_head": (0.2, 0.2, 0.2, 1.0),
    "post": (0.5, 0.5, 0.5, 1.0),
    "obstacle": (0.8, 0.8, 0.85, 1.0),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxObstacle:
    """A box that stands in the world.

    Attributes:
        name: of its own.
        size: full, (3,) m.
        X_WB: its pose, (4, 4).
        body: what it is a part of, which clearances name; empty: it stands alone. Few bodies make
            a fast simulation.
    """

    name: str
    size: Array
    X_WB: Array
    body: str = ""


@dataclass(frozen=True, kw_only=True)
class CableRobotPlant:
    """The plant with what one needs to find in it.

    Attributes:
        plant, scene_graph: as they are in the diagram.
        platform: the body whose frame is P.
        model: its model instance.
        robot: what it was made of.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph
    platform: RigidBody
    model: ModelInstanceIndex
    robot: CableRobot


def fastest_rates(robot: CableRobot, poses: Poses, tensions: Array) -> Array:
    """The highest frequency of the platform on its locked cables, (N,) rad/s."""
    K = full_stiffness(robot, poses, tensions)
    inertia, mass, found = box_inertia(robot), robot.mass, np.empty(len(poses))
    for n, R in enumerate(poses.rotation):
        c = R @ robot.centre_of_mass
        cross = np.cross(np.eye(3), c)  # rows e_i x c: the matrix of -c x
        M = np.zeros((6, 6))
        M[:3, :3], M[3:, 3:] = mass * np.eye(3), R @ inertia @ R.T
        M[:3, 3:], M[3:, :3] = mass * cross.T, mass * cross
        found[n] = math.sqrt(max(eigh(0.5 * (K[n] + K[n].T), M, eigvals_only=True)[-1], 0.0))
    return found


def check_time_step(
    robot: CableRobot, poses: Poses, time_step: float, damping_time: float = 0.0
) -> float:
    """Refuses a step that explicit springs are not stable with at some of N poses.

    Returns:
        The highest frequency there, rad/s.

    Raises:
        InputError: says the step, and what it must be; or the robot is a planar one.
    """
    if robot.freedoms != SPATIAL:
        raise InputError(f"{robot.name}: a planar robot; the station is of robots in space")
    require(0.0 < time_step <= 0.1, "time_step", f"{time_step:g} s", "in (0, 0.1] s")
    tensions = np.maximum(distribute_tensions(robot, poses, "least_norm").tensions, 0.0)
    rates = fastest_rates(robot, poses, tensions)
    worst = int(np.argmax(rates))
    fastest = float(rates[worst])
    limits = {"stiffness": 1.0 / fastest, "damping": math.inf}
    if damping_time > 0.0:
        limits["damping"] = 1.0 / (damping_time * fastest**2)
    reason = min(limits, key=lambda name: limits[name])
    if time_step >= LARGEST_SHARE * limits[reason]:
        raise InputError(
            f"{robot.name}: time_step = {time_step:g} s; must be < {limits[reason]:.3g} s for the "
            f"cables' {reason}: pose {worst + 1} moves with {fastest:.0f} rad/s"
        )
    return fastest


def add_plant(
    builder: DiagramBuilder,
    robot: CableRobot,
    *,
    time_step: float,
    obstacles: Sequence[BoxObstacle] = (),
    floor: float = -3.0,
    camera_head: bool = True,
) -> CableRobotPlant:
    """Adds a finalized plant and its scene graph.

    The platform is a solid box; a platform without one is a cube as wide as its attachments, and
    has no collision geometry.

    Args:
        floor: where the posts stand, z, m.
        camera_head: whether a ball below the platform stands for the camera's head.

    Raises:
        InputError: two obstacles of one name.
    """
    names = [obstacle.name for obstacle in obstacles]
    twice = next((name for name in names if names.count(name) > 1), "")
    require(not twice, "obstacles: name", f"{twice} (twice)", "different from the others'")
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=time_step, discrete_contact_approximation="lagged", contact_model="point"
        ),
        builder,
    )
    plant.mutable_gravity_field().set_gravity_vector(robot.gravity)
    model = plant.AddModelInstance("cable_robot")
    inertia = box_inertia(robot) / robot.mass
    platform = plant.AddRigidBody(
        "platform",
        model,
        SpatialInertia(
            mass=robot.mass,
            p_PScm_E=robot.centre_of_mass,
            G_SP_E=UnitInertia(*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]),
        ),
    )
    if np.all(robot.box > 0.0):
        _add_shape(plant, platform, RigidTransform(), Box(*robot.box), "platform")
        if camera_head:
            X_PH = RigidTransform(np.array(HEAD_PLACE))
            _add_shape(plant, platform, X_PH, Sphere(HEAD_RADIUS), "camera_head")
    # Clearances name bodies.
    scene = plant.AddModelInstance("scene")
    bodies: dict[str, RigidBody] = {}
    for obstacle in obstacles:
        name = obstacle.body or obstacle.name
        if name not in bodies:
            bodies[name] = plant.AddRigidBody(name, scene)
            plant.WeldFrames(plant.world_frame(), bodies[name].body_frame())
        X_WB = RigidTransform(obstacle.X_WB)
        _add_shape(plant, bodies[name], X_WB, Box(*obstacle.size), obstacle.name, "obstacle")
    places = np.unique(np.round(robot.anchors[:, :2], 6), axis=0)
    for number, place in enumerate(places, start=1):
        at_place = np.all(np.abs(robot.anchors[:, :2] - place) < 1e-5, axis=1)
        top = float(robot.anchors[at_place, 2].max())
        if top - floor < POST_RADIUS:
            continue
        body = plant.AddRigidBody(f"post_{number}", scene)
        middle = RigidTransform(np.array([*place, 0.5 * (floor + top)]))
        plant.WeldFrames(plant.world_frame(), body.body_frame(), middle)
        shape = Cylinder(POST_RADIUS, top - floor)
        _add_shape(plant, body, RigidTransform(), shape, body.name(), "post")
    # What stands may stand in what stands: they are not looked at together.
    standing = [plant.get_body(index) for index in plant.GetBodyIndices(scene)]
    if standing:
        scene_graph.collision_filter_manager().Apply(
            CollisionFilterDeclaration().ExcludeWithin(plant.CollectRegisteredGeometries(standing))
        )
    plant.Finalize()
    return CableRobotPlant(
        plant=plant, scene_graph=scene_graph, platform=platform, model=model, robot=robot
    )


def _add_shape(
    plant: MultibodyPlant, body: RigidBody, X_BG: RigidTransform, shape: Shape, name: str,
    color: str = "",
) -> None:  # fmt: skip
    plant.RegisterCollisionGeometry(body, X_BG, shape, name, _FRICTION)
    plant.RegisterVisualGeometry(body, X_BG, shape, f"{name}_visual", _COLORS[color or name])
