"""Faults in the station: encoders, forces at the tip, and a payload that stands elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, WeldJoint
from pydrake.systems.framework import DiagramBuilder, OutputPort

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.faults import end_of, make_encoder_faults
from pips_drake.serpentine.systems.encoder_bank import EncoderBank
from pips_drake.serpentine.systems.tip_disturbance import TipDisturbance


def displace_bodies(
    plant: MultibodyPlant, models: Sequence[ModelInstanceIndex], faults: Sequence[FaultConfig]
) -> None:
    """Moves scene bodies that faults displace; the plant is not final and has no constraints yet.

    Raises:
        InputError: the scene has no such body, or it is not fixed to anything.
    """
    for fault in faults:
        if fault.kind != "payload_displaced":
            continue
        bodies = [plant.get_body(b) for model in models for b in plant.GetBodyIndices(model)]
        known = {body.scoped_name().get_full(): body for body in bodies}
        if fault.body not in known:
            raise UnknownNameError("body of the scene", fault.body, list(known))
        body = known[fault.body]
        joint = next(
            (
                one
                for index in plant.GetJointIndices()
                if isinstance(one := plant.get_joint(index), WeldJoint)
                and one.child_body().index() == body.index()
            ),
            None,
        )
        if joint is None:
            raise InputError(f"body '{fault.body}', to be displaced, is loose; must be welded")
        parent, child, X_PC = joint.frame_on_parent(), joint.frame_on_child(), joint.X_FM()
        moved = RigidTransform([value * 1e-3 for value in fault.offset_mm]) @ X_PC
        plant.RemoveJoint(joint)
        plant.WeldFrames(parent, child, moved)


def AddDisturbances(
    builder: DiagramBuilder,
    *,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    arm: SerpentineArm,
    faults: Sequence[FaultConfig],
) -> None:
    """Adds the forces that faults let act at the arm's last body; nothing without any."""
    forces = [(f.start_s, end_of(f), f.force_n) for f in faults if f.kind == "disturbance"]
    if forces:
        body = plant.GetBodyByName(arm.bodies[-1].name, model)
        disturbance = builder.AddNamedSystem(
            "tip_disturbance", TipDisturbance(body.index(), forces=forces)
        )
        builder.Connect(
            disturbance.GetOutputPort("spatial_force"),
            plant.get_applied_spatial_force_input_port(),
        )


def AddEncoders(
    builder: DiagramBuilder,
    *,
    arm: SerpentineArm,
    joint_state: OutputPort,
    faults: Sequence[FaultConfig],
    period: float,
) -> EncoderBank | None:
    """Adds encoders if any of them is to fail; else the joints are read as they are."""
    wrong = make_encoder_faults(arm, faults)
    if not wrong:
        return None
    encoders: EncoderBank = builder.AddNamedSystem(
        "encoder_bank", EncoderBank(arm, faults=wrong, period=period)
    )
    builder.Connect(joint_state, encoders.GetInputPort("joint_state"))
    return encoders
