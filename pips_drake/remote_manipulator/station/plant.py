"""The plant: orbiter, bay, arm, payload and CAE, and the welds that hold the payload.

The world W is inertial: x aft, y starboard, z up. The orbiter's {R} stands in it turned by half a
turn about x; it is fixed, or translates on three sliding joints. The CAE is fixed in W.

The payload flies free. What takes hold of it is a weld constraint between the holder (effector,
orbiter or CAE) and an adapter, a body without mass that hangs on the payload by a frame whose place
a context may change: so a weld holds the payload where it is, with no error to pull out. Which
welds are on belongs to a context, not to the plant: call `set_initial_state` with every new one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import CollisionFilterDeclaration, SceneGraph
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    ModelInstanceIndex,
    MultibodyConstraintId,
    PdControllerGains,
    PrismaticJoint,
    RigidBody,
    SpatialInertia,
    WeldJoint,
)
from pydrake.systems.framework import Context, DiagramBuilder

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.configuration import JOINTS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.drives import ARM_JOINTS, orbiter_gains
from pips_drake.remote_manipulator.geometry import docking_port, probe_tip
from pips_drake.remote_manipulator.phases import SUPPORTS
from pips_drake.remote_manipulator.sdf import MODELS

Array = NDArray[np.float64]

#: Downwards in W, on the arm alone, m/s^2. With none at all and everything at rest the contact
#: solver stops: its tolerance is a part of the momenta, and nothing has any. This bends the arm by
#: 2 um. What flies free has exactly none.
GRAVITY = 1e-3
#: X_WR when nothing has been translated.
X_WR = RigidTransform(RotationMatrix.MakeXRotation(math.pi), np.zeros(3))


@dataclass(kw_only=True)
class PlantSettings:
    """What of the plant is not in the machine's configuration.

    Attributes:
        time_step: s.
        support: what holds the payload at first, one of `phases.SUPPORTS`.
        X_RP: where the payload is at first; None: stowed, or docked if `support` is `port`.
        spin, velocity: of a payload that nothing holds, (3,) rad/s and m/s, in {R}.
        arm_vector: where the arm is at first, (8,); None: home, stand lowest, fingers open.
        cae_offset: from the configuration's place, in {R}, (3,) m.
        orbiter_translates: on sliding joints along the axes of {R}.
    """

    time_step: float = 1.0 / 200.0
    support: str = "bay"
    X_RP: RigidTransform | None = None
    spin: Sequence[float] = (0.0, 0.0, 0.0)
    velocity: Sequence[float] = (0.0, 0.0, 0.0)
    arm_vector: ArrayLike | None = None
    cae_offset: Sequence[float] = (0.0, 0.0, 0.0)
    orbiter_translates: bool = False


@dataclass(frozen=True, kw_only=True)
class Hold:
    """A weld that may hold the payload.

    Attributes:
        name: `grasp`, `bay` or `port`.
        constraint: its number in the plant.
        holder: effector, orbiter or CAE.
        X_HA: where the weld holds the adapter in the holder.
        frame: on the payload, at whose place the adapter hangs.
        adapter: its body.
    """

    name: str
    constraint: MultibodyConstraintId
    holder: RigidBody
    X_HA: RigidTransform
    frame: FixedOffsetFrame
    adapter: RigidBody


@dataclass(frozen=True, kw_only=True)
class RemoteManipulatorPlant:
    """The plant with what one needs to find in it.

    Attributes:
        plant, scene_graph: as they are in the diagram.
        arm, payload: model instances; the arm's positions are the arm vector.
        orbiter_motion: model instance of the sliding joints; None: the orbiter is fixed.
        orbiter, effector, payload_body, cae: bodies whose frames are {R}, {2}, {P} and {C}.
        holds: by name.
        config, settings: what it was made of.
    """

    plant: MultibodyPlant
    scene_graph: SceneGraph
    arm: ModelInstanceIndex
    payload: ModelInstanceIndex
    orbiter_motion: ModelInstanceIndex | None
    orbiter: RigidBody
    effector: RigidBody
    payload_body: RigidBody
    cae: RigidBody
    holds: dict[str, Hold]
    config: RemoteManipulatorConfig
    settings: PlantSettings
    # The initial place of the payload in {R}.
    initial_X_RP: RigidTransform
    initial_arm_vector: Array = field(repr=False)

    def set_initial_state(self, context: Context) -> None:
        """Puts everything where it is at first, with the welds that are on then.

        Args:
            context: the plant's own.
        """
        self.plant.SetPositionsAndVelocities(
            context, self.arm, np.concatenate([self.initial_arm_vector, np.zeros(len(ARM_JOINTS))])
        )
        if self.orbiter_motion is not None:
            self.plant.SetPositionsAndVelocities(context, self.orbiter_motion, np.zeros(6))
        rotation = X_WR.rotation()
        self.place_payload(
            context,
            self.initial_X_RP,
            spin=rotation @ np.asarray(self.settings.spin, dtype=np.float64),
            velocity=rotation @ np.asarray(self.settings.velocity, dtype=np.float64),
        )
        for name, hold in self.holds.items():
            if name == self.settings.support:
                self.engage(context, hold)
            else:
                self.release(context, hold)

    def place_payload(
        self,
        context: Context,
        X_RP: RigidTransform,
        *,
        spin: ArrayLike = (0.0, 0.0, 0.0),
        velocity: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Puts the payload at a pose in {R}, with spin (3,) rad/s and velocity (3,) m/s in W."""
        X_WR_now = self.plant.EvalBodyPoseInWorld(context, self.orbiter)
        self.plant.SetFreeBodyPose(context, self.payload_body, X_WR_now.multiply(X_RP))
        self.plant.SetVelocities(context, self.payload, np.concatenate([spin, velocity]))

    def engage(self, context: Context, hold: Hold) -> None:
        """Lets a weld hold the payload where it is in the holder."""
        X_WH = self.plant.EvalBodyPoseInWorld(context, hold.holder)
        X_WP = self.plant.EvalBodyPoseInWorld(context, self.payload_body)
        hold.frame.SetPoseInParentFrame(context, X_WP.inverse().multiply(X_WH.multiply(hold.X_HA)))
        self.plant.SetConstraintActiveStatus(context, hold.constraint, True)

    def release(self, context: Context, hold: Hold) -> None:
        """Lets a weld go."""
        self.plant.SetConstraintActiveStatus(context, hold.constraint, False)

    def is_engaged(self, context: Context, hold: Hold) -> bool:
        """Whether a weld is on."""
        return bool(self.plant.GetConstraintActiveStatus(context, hold.constraint))

    def slip(self, context: Context, hold: Hold) -> float:
        """How far a weld's two sides are apart, m."""
        X_HA = self.plant.CalcRelativeTransform(
            context, hold.holder.body_frame(), hold.adapter.body_frame()
        )
        return float(np.linalg.norm(X_HA.translation() - hold.X_HA.translation()))

    def arm_vector_from_state(self, arm_state: ArrayLike) -> Array:
        """The arm vector (8,) of the arm's state (16,)."""
        vector: Array = np.asarray(arm_state, dtype=np.float64)[: len(ARM_JOINTS)]
        return vector

    def positions_from_arm_vector(self, arm_vector: ArrayLike) -> Array:
        """The arm's positions (8,) in the plant at an arm vector (8,): they are the same."""
        return np.array(arm_vector, dtype=np.float64)


def home_arm_vector(config: RemoteManipulatorConfig) -> Array:
    """Home, the stand at its lowest, the fingers open, (8,)."""
    return np.array([config.stand.lower_m, *config.arm.home, config.effector.prong_open_gap_m])


def stowed_pose(config: RemoteManipulatorConfig) -> RigidTransform:
    """X_RP of the payload in its place in the bay."""
    return RigidTransform(np.asarray(config.payload.location_m, dtype=np.float64))


def docked_pose(config: RemoteManipulatorConfig, X_RC: RigidTransform) -> RigidTransform:
    """X_RP of the payload with its probe's end in the middle of the CAE's port."""
    return X_RC.multiply(RigidTransform(docking_port(config) - probe_tip(config)))


def make_plant(
    builder: DiagramBuilder,
    config: RemoteManipulatorConfig,
    settings: PlantSettings | None = None,
) -> RemoteManipulatorPlant:
    """Adds a finalized plant and its scene graph.

    Its ports: desired states of `rms_arm` (16,) and, if the orbiter translates, `orbiter_motion`
    (6,); both must be connected, or the drives let go.

    Raises:
        InputError: a setting is not allowed.
    """
    settings = settings or PlantSettings()
    _check(config, settings)
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=settings.time_step,
            # Lagged is the fast one, and honours implicit PD gains.
            discrete_contact_approximation="lagged",
            contact_model="point",
        ),
        builder,
    )
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -GRAVITY])
    parser = Parser(plant)
    parser.SetStrictParsing()
    models = {
        name: parser.AddModelsFromString(make(config), "sdf")[0] for name, make in MODELS.items()
    }
    for model in models.values():
        plant.set_gravity_enabled(model, model == models["rms_arm"])
    X_RC = RigidTransform(
        np.asarray(config.central_assembly_element.location_m)
        + np.asarray(settings.cae_offset, dtype=np.float64)
    )
    body = {
        name: plant.GetBodyByName(name, models[model])
        for name, model in {
            "orbiter": "rms_orbiter",
            "cargo_bay": "rms_cargo_bay",
            "stand": "rms_arm",
            "telescope": "rms_arm",
            "effector": "rms_arm",
            "payload": "rms_payload",
            "cae": "rms_cae",
        }.items()
    }
    motion = _carry_orbiter(plant, config, body["orbiter"], settings.orbiter_translates)
    for name in ("cargo_bay", "stand"):
        plant.WeldFrames(body["orbiter"].body_frame(), body[name].body_frame())
    plant.WeldFrames(plant.world_frame(), body["cae"].body_frame(), X_WR.multiply(X_RC))
    if settings.X_RP is not None:
        X_RP = settings.X_RP
    elif settings.support == "port":
        X_RP = docked_pose(config, X_RC)
    else:
        X_RP = stowed_pose(config)
    holds = _add_holds(plant, config, models["rms_payload"], body)
    # The inner tube reaches into the fixed one and through the deck.
    standing = [body[name] for name in ("orbiter", "cargo_bay", "stand")]
    scene_graph.collision_filter_manager().Apply(
        CollisionFilterDeclaration().ExcludeBetween(
            plant.CollectRegisteredGeometries([body["telescope"]]),
            plant.CollectRegisteredGeometries(standing),
        )
    )
    plant.Finalize()
    arm_vector = (
        home_arm_vector(config)
        if settings.arm_vector is None
        else np.array(settings.arm_vector, dtype=np.float64)
    )
    plant.SetDefaultPositions(models["rms_arm"], arm_vector)
    plant.SetDefaultFloatingBaseBodyPose(body["payload"], X_WR.multiply(X_RP))
    return RemoteManipulatorPlant(
        plant=plant,
        scene_graph=scene_graph,
        arm=models["rms_arm"],
        payload=models["rms_payload"],
        orbiter_motion=motion,
        orbiter=body["orbiter"],
        effector=body["effector"],
        payload_body=body["payload"],
        cae=body["cae"],
        holds=holds,
        config=config,
        settings=replace(settings),
        initial_X_RP=X_RP,
        initial_arm_vector=arm_vector,
    )


def _check(config: RemoteManipulatorConfig, settings: PlantSettings) -> None:
    if settings.support not in SUPPORTS:
        known = " or ".join(SUPPORTS)
        raise InputError(f"payload.support = {settings.support!r}; must be {known}")
    if settings.support != "none" and np.any([settings.spin, settings.velocity]):
        raise InputError("a payload that is held moves; spin and velocity must be zero")
    if settings.arm_vector is None:
        return
    vector = np.asarray(settings.arm_vector, dtype=np.float64)
    if vector.shape != (len(ARM_JOINTS),):
        raise InputError(f"arm vector of shape {vector.shape}; must be ({len(ARM_JOINTS)},)")
    stand, effector = config.stand, config.effector
    lower = [stand.lower_m, *config.arm.lower, effector.prong_closed_gap_m]
    upper = [stand.upper_m, *config.arm.upper, effector.prong_open_gap_m]
    for name, value, low, high in zip(ARM_JOINTS, vector, lower, upper, strict=True):
        if not low - 1e-9 <= value <= high + 1e-9:
            # Scenarios give angles in degrees.
            scale, unit = (math.degrees(1.0), "deg") if name in JOINTS else (1.0, "m")
            shown = f"{value * scale:g} {unit}; must be {low * scale:g} .. {high * scale:g} {unit}"
            raise InputError(f"arm: {name} = {shown}")


def _carry_orbiter(
    plant: MultibodyPlant,
    config: RemoteManipulatorConfig,
    orbiter: RigidBody,
    translates: bool,
) -> ModelInstanceIndex | None:
    """Welds the orbiter to the world, or to three sliding joints along the axes of {R}."""
    if not translates:
        plant.WeldFrames(plant.world_frame(), orbiter.body_frame(), X_WR)
        return None
    instance = plant.AddModelInstance("orbiter_motion")
    frame = plant.AddFrame(FixedOffsetFrame("initial_R", plant.world_frame(), X_WR))
    stiffness, damping = orbiter_gains(config)
    for name, axis in zip("xyz", np.eye(3), strict=True):
        # Three joints in one place: what is between them has no mass.
        carrier = plant.AddRigidBody(f"carrier_{name}", instance, SpatialInertia.Zero())
        joint = plant.AddJoint(PrismaticJoint(f"orbiter_{name}", frame, carrier.body_frame(), axis))
        actuator = plant.AddJointActuator(f"orbiter_{name}", joint, config.orbiter.force_N)
        actuator.set_controller_gains(PdControllerGains(p=stiffness, d=damping))
        frame = carrier.body_frame()
    plant.WeldFrames(frame, orbiter.body_frame())
    return instance


def _add_holds(
    plant: MultibodyPlant,
    config: RemoteManipulatorConfig,
    payload: ModelInstanceIndex,
    body: dict[str, RigidBody],
) -> dict[str, Hold]:
    """The three welds; bay and port share an adapter, as only one of them holds at a time."""
    palm = config.arm.arm_2_m + config.effector.palm.length_m
    bar = -0.5 * config.payload.across_flats_m - config.receptacle.height_m
    at = {
        "grasp": ("effector", [palm, 0.0, 0.0], [*config.receptacle.location_m, bar]),
        "bay": ("orbiter", config.payload.location_m, [0.0, 0.0, 0.0]),
        "port": ("cae", docking_port(config), probe_tip(config)),
    }
    holds = {}
    hung: dict[str, tuple[FixedOffsetFrame, RigidBody]] = {}
    for name, (holder, place, place_on_payload) in at.items():
        adapter_name = "grasp" if name == "grasp" else "support"
        if adapter_name not in hung:
            frame = plant.AddFrame(
                FixedOffsetFrame(
                    f"{adapter_name}_point",
                    body["payload"].body_frame(),
                    RigidTransform(np.asarray(place_on_payload, dtype=np.float64)),
                )
            )
            adapter = plant.AddRigidBody(f"{adapter_name}_adapter", payload, SpatialInertia.Zero())
            plant.AddJoint(
                WeldJoint(f"{adapter_name}_weld", frame, adapter.body_frame(), RigidTransform())
            )
            hung[adapter_name] = frame, adapter
        frame, adapter = hung[adapter_name]
        X_HA = RigidTransform(np.asarray(place, dtype=np.float64))
        holds[name] = Hold(
            name=name,
            constraint=plant.AddWeldConstraint(body[holder], X_HA, adapter, RigidTransform()),
            holder=body[holder],
            X_HA=X_HA,
            frame=frame,
            adapter=adapter,
        )
    return holds
