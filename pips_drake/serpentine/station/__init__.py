"""The serpentine station, and the parts that it is composed of, for diagrams of your own."""

from pips_drake.serpentine.station.actuation import ActuationPorts, AddActuation
from pips_drake.serpentine.station.camera import (
    AddCameraPointer,
    AddCameraStation,
    camera_target,
    make_camera,
)
from pips_drake.serpentine.station.legs import AddLegSprings, LegServer
from pips_drake.serpentine.station.motion import (
    AddPlannedMotion,
    MotionNames,
    given_joints_at_updates,
    make_constant_profile,
    make_fastest_motion,
    make_profile,
    motion_names,
)
from pips_drake.serpentine.station.plant import (
    BASE_FRAME,
    AddSerpentineArm,
    gravity_in_frame_0,
    make_plant,
    plant_time_step,
)
from pips_drake.serpentine.station.prismatic_legs import (
    AddPrismaticLegs,
    legs_name,
    set_default_leg_positions,
    set_leg_positions,
)
from pips_drake.serpentine.station.setup import (
    SerpentineSetup,
    arm_pose,
    built_arm,
    load_setup,
    mounting_pose,
)
from pips_drake.serpentine.station.station import (
    VISUAL_PERIOD,
    MakeSerpentineStation,
    MakeSimulator,
)

__all__ = [
    "BASE_FRAME",
    "VISUAL_PERIOD",
    "ActuationPorts",
    "AddActuation",
    "AddCameraPointer",
    "AddCameraStation",
    "AddLegSprings",
    "AddPlannedMotion",
    "AddPrismaticLegs",
    "AddSerpentineArm",
    "LegServer",
    "MakeSerpentineStation",
    "MakeSimulator",
    "MotionNames",
    "SerpentineSetup",
    "arm_pose",
    "built_arm",
    "camera_target",
    "given_joints_at_updates",
    "gravity_in_frame_0",
    "legs_name",
    "load_setup",
    "make_camera",
    "make_constant_profile",
    "make_fastest_motion",
    "make_plant",
    "make_profile",
    "motion_names",
    "mounting_pose",
    "plant_time_step",
    "set_default_leg_positions",
    "set_leg_positions",
]
