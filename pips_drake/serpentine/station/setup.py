"""What a scenario names, loaded, and where it stands in the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydrake.math import RigidTransform, RotationMatrix

from pips_drake.config import load_yaml
from pips_drake.errors import InputError
from pips_drake.scene.packages import (
    find_arm_file,
    find_joint_motion_file,
    find_path_file,
    find_scene_file,
)
from pips_drake.serpentine.anchoring import anchor_path
from pips_drake.serpentine.arm import SerpentineArm, load_arm
from pips_drake.serpentine.arm_file import ArmFile
from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.joint_motion_file import read_joint_motion
from pips_drake.serpentine.mounting import mounting_rotation
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.planned_motion import FollowedPath, GivenJoints, PlannedMotion
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.tip_path import TipPath
from pips_drake.serpentine.tolerances import arm_as_built, is_built_otherwise
from pips_drake.units import INCH


@dataclass(frozen=True, kw_only=True)
class SerpentineSetup:
    """What a scenario names, loaded: the arm, its motion, the solver and the scene's file.

    Attributes:
        arm: as plan and controllers believe it to be; `built_arm` is what stands there.
        motion: along a path, or given by joints; in the arm's frame {0}.
        rail_shift: how far along z0 the arm's frame {0} stands from the scene's `frame_0`, m; not
            0 for an arm whose rail is placed for the path (`anchoring`) or for the joints
            (`rail_shift_m`).
        arm_file: what the arm was made of.
    """

    arm: SerpentineArm
    motion: PlannedMotion
    solver: FollowTheLeader
    scene_file: Path | None
    rail_shift: float = 0.0
    arm_file: ArmFile | None = None

    @property
    def path(self) -> TipPath:
        """The path that the arm follows, in its frame {0}.

        Raises:
            InputError: the motion is given by joints.
        """
        if isinstance(self.motion, FollowedPath):
            return self.motion.path
        raise InputError(f"motion '{self.motion.name}' is given by joints; must follow a path")


def load_setup(
    scenario: SerpentineScenario,
    *,
    folder: Path | None = None,
    scene_file: Path | None = None,
    joint_motion: JointMotion | None = None,
) -> SerpentineSetup:
    """Loads arm, motion and scene of a scenario; relative files are looked for in `folder`.

    Args:
        scene_file: stands for the scenario's scene, wherever it lies.
        joint_motion: stands for the scenario's path or joints.

    Raises:
        InputError: a name is unknown, or a file cannot be used.
    """
    file = find_arm_file(scenario.arm, inside=folder)
    arm = load_arm(file)
    solver = FollowTheLeader(
        arm,
        tolerance=scenario.solver.tolerance_in * INCH,
        max_iterations=scenario.solver.max_iterations,
    )
    if scenario.joints or joint_motion is not None:
        motion, rail_shift = _given_joints(scenario, arm, joint_motion, folder)
    else:
        motion, rail_shift = _followed_path(scenario, solver, folder)
    if scene_file is None and scenario.scene:
        scene_file = find_scene_file(scenario.scene, inside=folder)
    return SerpentineSetup(
        arm=arm,
        motion=motion,
        rail_shift=rail_shift,
        solver=solver,
        scene_file=scene_file,
        arm_file=load_yaml(ArmFile, file),
    )


def _followed_path(
    scenario: SerpentineScenario, solver: FollowTheLeader, folder: Path | None
) -> tuple[PlannedMotion, float]:
    """The motion along a scenario's path, and how far the rail is shifted for it, m."""
    drawn = load_path(
        find_path_file(scenario.path, inside=folder),
        smooth=scenario.corner_deviation_in > 0.0,
        corner_deviation=scenario.corner_deviation_in * INCH,
    )
    path, rail_shift = anchor_path(solver.arm, drawn)
    return FollowedPath(path=path, solver=solver), rail_shift


def _given_joints(
    scenario: SerpentineScenario,
    arm: SerpentineArm,
    motion: JointMotion | None,
    folder: Path | None,
) -> tuple[PlannedMotion, float]:
    """The motion that is given by joints, and how far the rail is shifted for it, m."""
    shift, name = scenario.rail_shift_m, "planned"
    if shift != 0.0 and not arm.rail_is_placed_for_the_path:
        raise InputError(
            f"rail_shift_m = {shift:g}; must be 0 for arm '{arm.name}', whose rail stands where it "
            "stands"
        )
    if motion is None:
        file = find_joint_motion_file(scenario.joints, inside=folder)
        motion, name = read_joint_motion(file, arm), file.stem
    return GivenJoints(arm=arm, motion=motion, name=name), shift


def built_arm(setup: SerpentineSetup, faults: Sequence[FaultConfig]) -> SerpentineArm:
    """The arm as it stands: the setup's own, unless faults of its making change it.

    Raises:
        InputError: the faults name what the arm has not, or the setup was not loaded from a file.
    """
    if not is_built_otherwise(faults):
        return setup.arm
    if setup.arm_file is None:
        raise InputError("faults of how the arm is built need the arm's file")
    return arm_as_built(setup.arm_file, faults)


def mounting_pose(scenario: SerpentineScenario) -> RigidTransform:
    """Pose in the world of `frame_0`, in which scenes and paths are given."""
    rotation = RotationMatrix(mounting_rotation(scenario.mounting))
    return RigidTransform(rotation, scenario.mounting_position_m)


def arm_pose(scenario: SerpentineScenario, setup: SerpentineSetup) -> RigidTransform:
    """Pose X_W0 of the arm's frame {0} in the world."""
    return mounting_pose(scenario) @ RigidTransform([0.0, 0.0, setup.rail_shift])
