"""The SDF models: the shipped files are the generated ones, and mean what the machine means."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from pips_drake.remote_manipulator.configuration import load_configuration
from pips_drake.remote_manipulator.drives import (
    carried_inertias,
    make_drives,
    orbiter_gains,
    prism_unit_moments,
    step_response,
    stopping_distance,
)
from pips_drake.remote_manipulator.kinematics import forward_kinematics
from pips_drake.remote_manipulator.orbiter_outline import orbiter_parts
from pips_drake.remote_manipulator.sdf import MODELS
from pips_drake.scene.packages import find_model_file

CONFIG = load_configuration()


def parsed(name, config=CONFIG):
    """The finalized plant of a model's text alone, welded to the world by its first link."""
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.01)
    parser = Parser(plant)
    parser.SetStrictParsing()
    (model,) = parser.AddModelsFromString(MODELS[name](config), "sdf")
    root = plant.get_body(plant.GetBodyIndices(model)[0])
    plant.WeldFrames(plant.world_frame(), root.body_frame())
    plant.Finalize()
    return plant, scene_graph


@pytest.mark.parametrize("name", sorted(MODELS))
def test_shipped_file_is_the_generated_one(name):
    assert find_model_file(name).read_text(encoding="utf-8") == MODELS[name](CONFIG)


@pytest.mark.parametrize("name", sorted(MODELS))
def test_only_boxes_and_cylinders_whose_contact_is_stated(name):
    """Drake's own contact stiffness follows from gravity, of which there is next to none."""
    for shape in ET.fromstring(MODELS[name](CONFIG)).iter("collision"):
        (solid,) = shape.find("geometry")
        assert solid.tag in ("box", "cylinder")
        stiffness = shape.find(".//{http://drake.mit.edu}point_contact_stiffness")
        assert float(stiffness.text) > 1e6


def test_arms_joints_move_it_as_the_kinematics_say():
    """Its positions are the arm vector, without any offset."""
    plant, _ = parsed("rms_arm")
    context = plant.CreateDefaultContext()
    arm, effector = CONFIG.arm, CONFIG.effector
    rng = np.random.default_rng(3)
    for _ in range(20):
        angles, height = rng.uniform(arm.lower, arm.upper), rng.uniform(2.0, 4.0)
        gap = rng.uniform(0.24, 0.6)
        plant.SetPositions(context, [height, *angles, gap])
        pose = forward_kinematics(arm, angles, height)
        for name, point, rotation in (
            ("arm_0", pose.shoulder, pose.R_R0),
            ("arm_1", pose.elbow, pose.R_R1),
            ("effector", pose.wrist, pose.R_R2),
        ):
            X = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name))
            # The file has ten digits of lengths of some metres.
            np.testing.assert_allclose(X.translation(), point, atol=1e-8)
            np.testing.assert_allclose(X.rotation().matrix(), rotation, atol=1e-9)
        X_2K = plant.CalcRelativeTransform(
            context, plant.GetFrameByName("effector"), plant.GetFrameByName("prong")
        )
        expected = [0.0, gap - effector.finger_offset_m, 0.0]
        np.testing.assert_allclose(X_2K.translation(), expected, atol=1e-9)


def test_arm_weighs_what_its_parts_do():
    plant, _ = parsed("rms_arm")
    arm = CONFIG.arm
    expected = 95.3 + 139.4 + 87.4 + 54.4 + 45.2 + CONFIG.stand.mass_kg + 5.0
    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == pytest.approx(expected, rel=1e-9)
    assert arm.effector_mass_kg == 45.2


def test_a_prisms_moments_are_those_of_its_points():
    across, length = 4.2672, 15.24
    rng = np.random.default_rng(4)
    points = rng.uniform(-0.5, 0.5, (400_000, 3)) * [length, 1.1 * across, 1.1 * across]
    angles = np.arange(8) * math.pi / 4
    normals = np.column_stack([np.zeros(8), np.cos(angles), np.sin(angles)])
    inside = points[np.all(points @ normals.T <= 0.5 * across, axis=1)]
    x, y, z = np.mean(inside**2, axis=0)
    along, other = prism_unit_moments(across, length)
    # The mean of n squares scatters by about one part in sqrt(n), here 0.2 %.
    assert along == pytest.approx(y + z, rel=0.01)
    assert other == pytest.approx(x + z, rel=0.01)


def test_a_changed_machine_is_another_model():
    changed = replace(CONFIG, arm=replace(CONFIG.arm, arm_0_m=7.5))
    plant, _ = parsed("rms_arm", changed)
    elbow = plant.GetJointByName("P1").frame_on_parent()
    assert elbow.GetFixedPoseInBodyFrame().translation()[0] == pytest.approx(7.5)
    heavy = replace(CONFIG, payload=replace(CONFIG.payload, mass_kg=20000.0))
    plant, _ = parsed("rms_payload", heavy)
    assert plant.GetBodyByName("payload").default_mass() == 20000.0


def test_stand_is_one_tube_in_another_at_every_height():
    plant, scene_graph = parsed("rms_arm")
    inspector, spans = scene_graph.model_inspector(), {}
    for body, name in (("stand", "tube"), ("telescope", "inner_tube")):
        (shape,) = (
            geometry
            for geometry in plant.GetCollisionGeometriesForBody(plant.GetBodyByName(body))
            if inspector.GetName(geometry).endswith(f"::{name}")
        )
        middle = inspector.GetPoseInFrame(shape).translation()[2]
        half = 0.5 * inspector.GetShape(shape).length()
        spans[name] = middle - half, middle + half
    for height in (CONFIG.stand.lower_m, CONFIG.stand.upper_m):
        low, high = (z - height for z in spans["inner_tube"])
        # It sticks out above the fixed tube, and is in it for more than half a diameter.
        assert low < spans["tube"][0] < high - 0.5 * CONFIG.arm.diameter_m


def test_only_cabin_and_deck_of_the_orbiter_are_solid_and_the_bay_is_open():
    parts = orbiter_parts(CONFIG)
    solid = {part.name for part in parts if part.solid}
    assert solid == {"cabin", "deck_port", "deck_starboard", "deck_forward", "deck_aft"}
    assert len({part.name for part in parts}) == len(parts)
    bay = CONFIG.cargo_bay
    low = np.array([bay.location_m[0], bay.location_m[1] - 0.5 * bay.width_m, bay.location_m[2]])
    high = low + np.array([bay.length_m, bay.width_m, bay.depth_m])
    for part in parts:
        if any(part.rpy):
            continue
        half = 0.5 * np.array(part.size)
        apart = (part.position + half <= low + 1e-9) | (part.position - half >= high - 1e-9)
        assert apart.any(), part.name


def test_outline_is_as_long_and_as_wide_as_the_orbiter():
    boxes = [part for part in orbiter_parts(CONFIG) if not any(part.rpy)]
    nose = min(part.position[0] - 0.5 * part.size[0] for part in boxes)
    tail = max(part.position[0] + 0.5 * part.size[0] for part in boxes if "deck" in part.name)
    assert tail - nose == pytest.approx(CONFIG.orbiter.length_m)
    tips = [part.position[1] + 0.5 * part.size[1] for part in boxes]
    assert max(tips) - CONFIG.cargo_bay.location_m[1] == pytest.approx(12.0)


def test_drives_brake_the_loaded_arm_in_time():
    """d / p >= v / (2 a) at the loaded arm's 0.06 m/s, for every joint that carries the payload."""
    drives, inertias = make_drives(CONFIG), carried_inertias(CONFIG)
    arm = CONFIG.arm
    levers = np.array([1.0, *[0.75 * (arm.arm_0_m + arm.arm_1_m)] * 2, arm.arm_1_m])
    speeds, braking = 0.06 / levers, (drives.effort / inertias)[:4]
    late = speeds / (2.0 * braking) - (drives.damping / drives.stiffness)[:4]
    assert np.all(late < 0.0)
    # What that means: by shoulder or elbow alone, a sixth of a metre.
    distance = levers * stopping_distance(speeds, braking)
    np.testing.assert_allclose(distance[1:], 0.15, atol=0.03)


def test_orbiters_servo_is_at_least_critically_damped():
    stiffness, damping = orbiter_gains(CONFIG)
    assert damping**2 >= 4.0 * stiffness * CONFIG.orbiter.mass_kg * (1.0 - 1e-12)


def test_step_response_solves_its_equation():
    inertia, stiffness, damping = 3.0, 5.0, 20.0
    t = np.linspace(0.0, 5.0, 5001)
    q = step_response(t, inertia, stiffness, damping)
    rate = np.gradient(q, t)
    balance = inertia * np.gradient(rate, t) + damping * rate + stiffness * q
    # Central differences of a step of 1 ms.
    np.testing.assert_allclose(balance[2:-2], stiffness, rtol=1e-4)
    assert q[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("rms_arm", [CONFIG.arm.arm_0_m, CONFIG.arm.arm_1_m, CONFIG.arm.arm_2_m]),
        ("rms_arm", [CONFIG.arm.diameter_m, CONFIG.arm.arm_0_mass_kg, CONFIG.arm.arm_1_mass_kg]),
        ("rms_arm", [joint.rate_deg_s for joint in CONFIG.arm.joints]),
        ("rms_arm", [int(joint.torque_N_m) for joint in CONFIG.arm.joints]),
        ("rms_payload", [CONFIG.payload.length_m, CONFIG.payload.across_flats_m]),
        ("rms_cargo_bay", [CONFIG.cargo_bay.length_m, CONFIG.cargo_bay.width_m]),
        ("rms_cae", CONFIG.central_assembly_element.location_m),
        ("rms_orbiter", [int(CONFIG.orbiter.length_m), int(CONFIG.orbiter.span_m)]),
    ],
)
def test_readme_states_the_configurations_numbers(name, values):
    text = find_model_file(name).with_name("README.md").read_text(encoding="utf-8")
    missing = [value for value in values if str(value) not in text]
    assert missing == []
