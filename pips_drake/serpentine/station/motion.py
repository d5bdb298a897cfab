"""How the tip of a scenario moves along its path over time."""

from __future__ import annotations

import math

import numpy as np
from pydrake.multibody.tree import UniformGravityFieldElement

from pips_drake.serpentine.motion_limits import FastestMotion, fastest_motion, path_motion
from pips_drake.serpentine.motion_profile import MotionProfile, RestToRestProfile
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station.setup import SerpentineSetup, arm_pose


def make_profile(scenario: SerpentineScenario, setup: SerpentineSetup) -> MotionProfile:
    """The tip's travel along its path, against time, as `motion.profile` wants it.

    Raises:
        InputError: `fastest` on a path with corners.
        NotFollowableError: `fastest`, and the path has no posture somewhere, or the arm cannot be
            held still there within `motion.limit_share` of its drives' limits.
    """
    motion = scenario.motion
    if motion.profile == "fastest":
        return make_fastest_motion(scenario, setup).profile
    return make_constant_profile(scenario, setup)


def make_constant_profile(
    scenario: SerpentineScenario, setup: SerpentineSetup
) -> RestToRestProfile:
    """The report's motion, at the scenario's tip speed."""
    motion = scenario.motion
    return RestToRestProfile.make(
        travel=setup.path.travel, speed=motion.tip_speed_mm_per_s * 1e-3, ramp=motion.ramp_s
    )


def make_fastest_motion(scenario: SerpentineScenario, setup: SerpentineSetup) -> FastestMotion:
    """The fastest motion of a scenario, whatever its `motion.profile`, and what holds it back.

    Raises:
        InputError, NotFollowableError: as `make_profile`.
    """
    motion = scenario.motion
    down = np.array([0.0, 0.0, -UniformGravityFieldElement.kDefaultStrength])
    return fastest_motion(
        path_motion(setup.arm, setup.path, arm_pose(scenario, setup).rotation().inverse() @ down),
        share=motion.limit_share,
        tip_speed=motion.tip_speed_max_mm_per_s * 1e-3 or math.inf,
        smoothing=motion.smoothing_s,
    )
