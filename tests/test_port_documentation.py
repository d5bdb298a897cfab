"""Every system's `.. pydrake_system::` block names the ports that the system has."""

from __future__ import annotations

import importlib
import inspect
import itertools
import pkgutil
import re
import textwrap

import numpy as np
import pytest
import yaml
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder, LeafSystem, PortDataType

import pips_drake
from pips_drake.cable_robot.kinematics import make_poses
from pips_drake.cable_robot.platform_motion import PlatformMotion
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.planning.live_arm import LiveArm
from pips_drake.remote_manipulator.analog_inputs import angle_scaling
from pips_drake.remote_manipulator.autopilot import Autopilot
from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig, load_configuration
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs, frames_of
from pips_drake.remote_manipulator.operator_recording import OperatorRecording
from pips_drake.remote_manipulator.program import CollisionProgram
from pips_drake.remote_manipulator.random_operator import RandomOperator
from pips_drake.remote_manipulator.script import ScriptStep
from pips_drake.scene.signed_distance import SignedDistanceField
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.kinematics import spine_points
from pips_drake.serpentine.motion_profile import RestToRestProfile
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.planned_motion import GivenJoints
from pips_drake.serpentine.sdf import make_sdf


def find_systems() -> dict[str, type[LeafSystem]]:
    """All LeafSystems that a module of a package named `systems` defines, by class name."""
    found = {}
    for info in pkgutil.walk_packages(pips_drake.__path__, "pips_drake."):
        if ".systems." not in info.name:
            continue
        module = importlib.import_module(info.name)
        for name, value in inspect.getmembers(module, inspect.isclass):
            if issubclass(value, LeafSystem) and value.__module__ == info.name:
                found[name] = value
    return found


SYSTEMS = find_systems()
#: J, A and M in the docstrings: joints and actuators of the arm that `arguments` has, and cables.
COUNTS = {"": 1, "J": 18, "A": 16, "M": 8}


class Controls:
    """What a Meshcat's page is to its operator before anything is pressed."""

    def __init__(self, config: RemoteManipulatorConfig) -> None:
        self.config = config


def arguments() -> dict[str, object]:
    """Something to pass for each argument that a system cannot do without, by its name."""
    arm = load_arm("prototype")
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 1e-3)
    (model,) = Parser(plant).AddModelsFromString(make_sdf(arm), "sdf")
    plant.Finalize()
    motion = JointMotion(times=np.array([0.0, 1.0]), joints=np.tile(arm.joint_home, (2, 1)))
    live_arm = LiveArm(arm, SignedDistanceField.of([]))
    tip = spine_points(arm, arm.joint_home)[0, -1]
    manipulator = load_configuration()
    home = OperatorInputs(angles=manipulator.arm.home)
    ends = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    cable_robot = CableRobot(name="box", anchors=3.0 * ends, attachments=0.1 * ends)
    poses = make_poses([0.0, 0.0, 0.0])
    return {
        "angles": manipulator.arm.home,
        "arm": arm,
        "bodies": [[1, 2]] * COUNTS["A"],
        "body_index": 1,
        "cable_robot": cable_robot,
        "cae_index": 2,
        "config": manipulator,
        "controls": Controls(manipulator),
        "given": GivenJoints(arm=arm, motion=motion, name="joints"),
        "first_lengths": np.ones(COUNTS["M"]),
        "gravity": [0.0, 0.0, -9.81],
        "guess": poses,
        "hand": RandomOperator(manipulator, 0),
        "live_arm": live_arm,
        "model": model,
        "orbiter_index": 1,
        "path": load_path("trajectory_4"),
        "payload_index": 3,
        "period": 1.0 / 512.0,
        "pilot": Autopilot(manipulator, [ScriptStep(do="close")]),
        "plant": plant,
        "platform_motion": PlatformMotion(poses),
        "points": [[[0.0, 0.0, 0.0]] * 2] * COUNTS["A"],
        "profile": RestToRestProfile.make(travel=1.0, speed=0.1, ramp=1.0),
        "program": CollisionProgram(manipulator),
        "recording": OperatorRecording(times=np.zeros(1), frames=frames_of([home])),
        "robot": [model],
        "scaling": angle_scaling(manipulator.arm),
        "scene_graph": scene_graph,
        "solver": FollowTheLeader(arm),
        "start": live_arm.lay([tip, tip + np.array([0.0, 0.0, 1.0])]),
    }


def make_system(system: type[LeafSystem]) -> LeafSystem:
    """An instance with the required arguments alone."""
    parameters = inspect.signature(system).parameters.values()
    needed = [p for p in parameters if p.default is p.empty]
    given = arguments()
    missing = [p.name for p in needed if p.name not in given]
    assert not missing, f"{system.__name__} needs {missing}: add them to arguments()"
    positional = [given[p.name] for p in needed if p.kind is not p.KEYWORD_ONLY]
    keywords = {p.name: given[p.name] for p in needed if p.kind is p.KEYWORD_ONLY}
    return system(*positional, **keywords)


def documented(system: type[LeafSystem]) -> dict[str, object]:
    """The block's YAML."""
    _, _, rest = inspect.cleandoc(system.__doc__ or "").partition(".. pydrake_system::\n")
    lines = []
    for line in rest.splitlines():
        if line.strip() and not line.startswith(" "):
            break
        lines.append(line)
    block = yaml.safe_load(textwrap.dedent("\n".join(lines)))
    assert isinstance(block, dict), f"{system.__name__} has no '.. pydrake_system::' block"
    return block


def test_systems_are_found():
    assert {"TipPathSource", "ActuatorServo", "ClearanceMonitor"} <= set(SYSTEMS)


@pytest.mark.parametrize("name", sorted(SYSTEMS))
def test_documented_ports_are_the_ports(name):
    system = make_system(SYSTEMS[name])
    live = {
        "name": name,
        "input_ports": [
            system.get_input_port(i).get_name() for i in range(system.num_input_ports())
        ],
        "output_ports": [
            system.get_output_port(i).get_name() for i in range(system.num_output_ports())
        ],
    }
    block = documented(SYSTEMS[name])
    assert {"input_ports": [], "output_ports": []} | block == live


@pytest.mark.parametrize("name", sorted(SYSTEMS))
def test_each_port_has_one_line_with_its_true_size(name):
    system, text = make_system(SYSTEMS[name]), inspect.cleandoc(SYSTEMS[name].__doc__ or "")
    ports = [system.get_input_port(i) for i in range(system.num_input_ports())]
    ports += [system.get_output_port(i) for i in range(system.num_output_ports())]
    lines = re.findall(r"^- `(\w+)`(.*)", text, flags=re.MULTILINE)
    # In the ports' order, inputs first: an input and an output may share their name.
    assert [line[0] for line in lines] == [port.get_name() for port in ports]
    for port, (_, line) in zip(ports, lines, strict=True):
        if port.get_data_type() == PortDataType.kAbstractValued:
            assert line.startswith(": abstract ")
        else:
            shape = re.match(r", \((\d*) ?([JAM]?),\):", line)
            assert shape, f"{name}.{port.get_name()} must state its shape, such as (2 J,)"
            assert int(shape[1] or 1) * COUNTS[shape[2]] == port.size()
