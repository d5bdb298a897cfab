"""How a scenario's arm moves over time: along its path, or as its joints are given."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.tree import UniformGravityFieldElement
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort

from pips_drake.serpentine.motion_clock import MotionClock
from pips_drake.serpentine.motion_limits import FastestMotion, fastest_motion, path_motion
from pips_drake.serpentine.motion_profile import MotionProfile, RestToRestProfile
from pips_drake.serpentine.motion_words import EXTENDING, RUN
from pips_drake.serpentine.planned_motion import GivenJoints, PlannedMotion
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station.setup import SerpentineSetup, arm_pose
from pips_drake.serpentine.systems.follow_the_leader_controller import FollowTheLeaderController
from pips_drake.serpentine.systems.joint_motion_source import JointMotionSource
from pips_drake.serpentine.systems.tip_path_source import TipPathSource

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class MotionNames:
    """What of a station moves the arm, by name.

    Attributes:
        source: the system that hears words, and has `tip` and `phase`.
        joint_state: output port of the commanded joints.
        ports: all output ports that the station has of it.
    """

    source: str
    joint_state: str
    ports: tuple[str, ...]

    @property
    def tip(self) -> str:
        """Output port: how far along its way it is, m, and its rate, m/s."""
        return f"{self.source}.tip"

    @property
    def phase(self) -> str:
        """Output port."""
        return f"{self.source}.phase"

    @property
    def command(self) -> str:
        """Input port."""
        return f"{self.source}.command"


PATH_NAMES = MotionNames(
    source="tip_path_source",
    joint_state="follow_the_leader.joint_state",
    ports=(
        "tip_path_source.tip",
        "tip_path_source.phase",
        "follow_the_leader.joint_state",
        "follow_the_leader.solution",
    ),
)
_JOINT_NAMES = MotionNames(
    source="joint_motion_source",
    joint_state="joint_motion_source.joint_state",
    ports=(
        "joint_motion_source.tip",
        "joint_motion_source.phase",
        "joint_motion_source.joint_state",
    ),
)


def motion_names(motion: PlannedMotion) -> MotionNames:
    """Which systems and ports of a station move an arm so."""
    return _JOINT_NAMES if isinstance(motion, GivenJoints) else PATH_NAMES


def AddPlannedMotion(
    builder: DiagramBuilder, scenario: SerpentineScenario, setup: SerpentineSetup
) -> tuple[LeafSystem, OutputPort]:
    """Adds what moves the arm of a scenario, under its `motion_names`.

    Returns:
        the source, and the port of the commanded joints' state.

    Raises:
        as `make_profile`.
    """
    config, names = scenario.motion, motion_names(setup.motion)
    period, ramp = 1.0 / scenario.clocks.control_hz, scenario.supervisor.hold_ramp_s
    if isinstance(setup.motion, GivenJoints):
        given = builder.AddNamedSystem(
            names.source,
            JointMotionSource(
                setup.motion,
                dwell=config.dwell_s,
                retract=config.retract,
                hold_ramp=ramp,
                period=period,
            ),
        )
        return given, given.GetOutputPort("joint_state")
    source = builder.AddNamedSystem(
        names.source,
        TipPathSource(
            setup.path,
            make_profile(scenario, setup),
            dwell=config.dwell_s,
            retract=config.retract,
            hold_ramp=ramp,
            period=period,
        ),
    )
    leader = builder.AddNamedSystem(
        "follow_the_leader", FollowTheLeaderController(setup.solver, period=period)
    )
    builder.Connect(source.GetOutputPort("tip"), leader.GetInputPort("tip"))
    builder.Connect(source.GetOutputPort("path"), leader.GetInputPort("path"))
    return source, leader.GetOutputPort("joint_state")


def given_joints_at_updates(
    scenario: SerpentineScenario, given: GivenJoints
) -> tuple[Array, Array]:
    """Times (N,) s of the drives' updates on the way out, and the joints (N, J) sent at them."""
    period = 1.0 / scenario.clocks.control_hz
    clock = MotionClock(
        end=given.motion.duration,
        dwell=0.0,
        retract=False,
        ramp=scenario.supervisor.hold_ramp_s,
        period=period,
        rests_at_ends=False,
    )
    state = clock.start
    times = [state[0]]
    while state[2] == EXTENDING:
        state = clock.step(state, RUN, 1.0)
        times.append(state[0])
    updates: Array = period * np.arange(len(times), dtype=np.float64)
    return updates, given.motion.at(times)


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
