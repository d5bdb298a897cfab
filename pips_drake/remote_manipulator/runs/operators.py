"""The operator that a scenario asks for, as a system."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import System

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.analog_inputs import angle_scaling
from pips_drake.remote_manipulator.autopilot import Autopilot as Pilot
from pips_drake.remote_manipulator.configuration import STATIONS
from pips_drake.remote_manipulator.meshcat_controls import MeshcatControls
from pips_drake.remote_manipulator.operator_recording import load_recording
from pips_drake.remote_manipulator.program_state import ANGLES
from pips_drake.remote_manipulator.random_operator import RandomOperator as Hand
from pips_drake.remote_manipulator.runs.run import Setup
from pips_drake.remote_manipulator.scenario import RemoteManipulatorScenario
from pips_drake.remote_manipulator.systems.autopilot import Autopilot
from pips_drake.remote_manipulator.systems.meshcat_operator import MeshcatOperator
from pips_drake.remote_manipulator.systems.random_operator import RandomOperator
from pips_drake.remote_manipulator.systems.recorded_operator import RecordedOperator
from pips_drake.scene.packages import find_file


@dataclass(frozen=True, kw_only=True)
class Operator:
    """An operator.

    Attributes:
        system: its ports are those of `systems`.
        real_time: it is a person, for whom a second must be one.
    """

    system: System
    real_time: bool = False


def make_operator(
    scenario: RemoteManipulatorScenario,
    setup: Setup,
    *,
    folder: Path | None = None,
    meshcat: Meshcat | None = None,
) -> Operator:
    """The operator of a scenario.

    Args:
        folder: where the scenario's relative file names start.
        meshcat: what a person works with, where `operator.kind` is `meshcat`.

    Raises:
        InputError: there is no such recording, or no Meshcat.
    """
    angles = np.asarray(setup.plant.arm_vector)[ANGLES]
    station = STATIONS.index(scenario.station)
    kind = scenario.operator.kind
    if kind == "autopilot":
        pilot = Pilot(setup.config, scenario.operator.script, station=station)
        return Operator(system=Autopilot(pilot, angles=angles))
    if kind == "recording":
        file = find_file("operator recording", scenario.operator.recording, inside=folder)
        scaling = angle_scaling(setup.config.arm)
        return Operator(system=RecordedOperator(load_recording(file, scaling), scaling))
    if kind == "random":
        hand = Hand(setup.config, scenario.seed, station=station)
        return Operator(system=RandomOperator(hand, angles=angles))
    if meshcat is None:
        raise InputError("operator.kind = meshcat; must be run with --meshcat")
    controls = MeshcatControls(meshcat, setup.config, angles=angles, station=station)
    system = MeshcatOperator(controls, angles=angles, station=station)
    return Operator(system=system, real_time=True)
