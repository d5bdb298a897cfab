"""The shipped scenes: each trajectory inspects its payload, and the arm touches nothing on the way.

Where the camera looks is computed here from the numbers in the files alone: the joints' poses from
the arm's SDF, the payload's cylinder from its SDF, its place from the scene's directives.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import yaml
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from pips_drake.scenarios import load_scenario, scenario_descriptions
from pips_drake.scenarios import simulate as simulate_scenario
from pips_drake.scene.loading import AddPlacedFrame, AddScene, check_anchored
from pips_drake.scene.packages import find_scene_file, list_names, models_directory
from pips_drake.serpentine.plan import make_plan
from pips_drake.serpentine.runs.check import check
from pips_drake.serpentine.station import load_setup

INCH = 0.0254
INSPECTING = ("trajectory_1", "trajectory_2", "trajectory_3", "trajectory_4")
BLOCKED = "trajectory_4_blocked"
SDF = models_directory() / "sdf"


@cache
def checked(name):
    scenario = load_scenario(name)
    return check(scenario.config, name=name, folder=scenario.folder)


@cache
def end_joints(name):
    """Joints at the end of the scenario's planned path."""
    setup = load_setup(load_scenario(name).config)
    return make_plan(setup.arm, setup.path).joints[-1]


def transform(rotation, translation):
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = rotation.as_matrix(), translation
    return X


def camera_ray(joints):
    """The middle of the camera head's front, and where it looks, in frame 0, from the arm's SDF."""
    model = ET.parse(SDF / "prototype" / "prototype.sdf").find("model")
    poses = {}
    for link in model.findall("link"):
        pose = link.find("pose")
        if pose is not None:
            assert pose.get("rotation_format") == "quat_xyzw"
            numbers = np.array(pose.text.split(), dtype=float)
            X = transform(Rotation.from_quat(numbers[3:]), numbers[:3])
            poses[link.get("name")] = (pose.get("relative_to"), X)
    X_0 = {"rail": np.eye(4)}
    for joint, value in zip(model.findall("joint"), joints, strict=True):
        parent, child = joint.findtext("parent"), joint.findtext("child")
        assert poses[child][0] == parent
        assert joint.findtext("axis/xyz") == "0 0 1"
        if joint.get("type") == "prismatic":
            move = transform(Rotation.identity(), [0.0, 0.0, value])
        else:
            move = transform(Rotation.from_euler("z", value), np.zeros(3))
        X_0[child] = X_0[parent] @ poses[child][1] @ move
    head = model.find("link[@name='camera_head']/collision")
    centre = np.array(head.findtext("pose").split(), dtype=float)[0]
    front = centre + 0.5 * float(head.findtext("geometry/box/size").split()[0])
    X = X_0["camera_head"]
    assert front == pytest.approx(6.0 * INCH)
    return X[:3, 3] + front * X[:3, 0], X[:3, 0]


class DirectiveLoader(yaml.SafeLoader):
    """Reads Drake's model directives; `!Rpy {deg: [...]}` becomes a rotation."""


DirectiveLoader.add_constructor(
    "!Rpy",
    lambda loader, node: Rotation.from_euler(
        "xyz", loader.construct_mapping(node, deep=True)["deg"], degrees=True
    ),
)


def directives(scene):
    """The scene's directives, those of the files that it adds included."""
    text = find_scene_file(scene).read_text(encoding="utf-8")
    for directive in yaml.load(text, DirectiveLoader)["directives"]:  # noqa: S506
        if "add_directives" in directive:
            file = directive["add_directives"]["file"].rsplit("/", 1)[1]
            yield from directives(file.removesuffix(".dmd.yaml"))
        else:
            yield directive


@dataclass
class Cylinder:
    """A payload in frame 0: rows of `axes` are its x, y and axis."""

    middle: np.ndarray
    axes: np.ndarray
    radius: float
    length: float

    def hit(self, start, along):
        """Distance along a ray to the curved surface, and the angle (rad) to its normal there."""
        start, along = self.axes @ (start - self.middle), self.axes @ along
        # |(start + t along)_xy| = radius, the nearer root.
        a, b = along[:2] @ along[:2], start[:2] @ along[:2]
        c = start[:2] @ start[:2] - self.radius**2
        root = b * b - a * c
        if root < 0.0:
            return None
        t = (-b - np.sqrt(root)) / a
        point = start + t * along
        if abs(point[2]) > 0.5 * self.length:
            return None
        return t, np.arccos(-(point[:2] / self.radius) @ along[:2])


def payload_of(scene):
    files, welds = {}, {}
    for directive in directives(scene):
        if "add_model" in directive:
            files[directive["add_model"]["name"]] = directive["add_model"]["file"]
        else:
            assert directive["add_weld"]["parent"] == "frame_0"
            welds[directive["add_weld"]["child"]] = directive["add_weld"]["X_PC"]
    file = models_directory() / files["payload"].removeprefix("package://pips_drake/")
    shell = ET.parse(file).find(".//collision[@name='shell']")
    assert shell.findtext("pose").split() == ["0"] * 6
    pose = welds["payload::payload"]
    return Cylinder(
        middle=np.array(pose["translation"]),
        axes=pose["rotation"].as_matrix().T,
        radius=float(shell.findtext("geometry/cylinder/radius")),
        length=float(shell.findtext("geometry/cylinder/length")),
    )


def test_rays_meet_cylinders_where_they_should():
    cylinder = Cylinder(middle=np.array([0.0, 5.0, 0.0]), axes=np.eye(3), radius=1.0, length=2.0)
    t, angle = cylinder.hit(np.zeros(3), np.array([0.0, 1.0, 0.0]))
    assert (t, angle) == pytest.approx((4.0, 0.0))
    t, angle = cylinder.hit(np.array([0.5, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    assert (t, angle) == pytest.approx((5.0 - np.sqrt(0.75), np.pi / 6.0))
    assert cylinder.hit(np.array([1.1, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])) is None
    assert cylinder.hit(np.array([0.0, 0.0, 1.1]), np.array([0.0, 1.0, 0.0])) is None


@pytest.mark.parametrize("name", INSPECTING)
def test_camera_looks_at_the_payload_from_within_a_foot(name):
    joints = end_joints(name)
    assert joints[-1] == 0.0  # theta18 is not needed to look
    distance, angle = payload_of(name).hit(*camera_ray(joints))
    assert 2.0 * INCH < distance < 12.0 * INCH
    assert angle < np.radians(45.0)


def test_trajectory_4_and_its_blocked_twin_differ_in_the_payloads_place_alone():
    free, blocked = payload_of("trajectory_4"), payload_of(BLOCKED)
    np.testing.assert_allclose(blocked.middle - free.middle, [0.0, 0.3, 0.0], atol=1e-12)
    front, view = camera_ray(end_joints("trajectory_4"))
    assert blocked.hit(front, view)[0] < 0.0  # the front is inside


# Trajectory 4 and its blocked twin are checked by `tests/cli/test_other_commands.py` every time.
@pytest.mark.slow
@pytest.mark.parametrize("name", INSPECTING)
def test_planned_arm_keeps_its_distance_without_being_far_away(name):
    verdict = checked(name)
    assert verdict.passed, verdict.failures
    assert 0.025 <= verdict.summary["clearance_sampled_min_m"] < 0.15
    assert verdict.summary["drive_effort_max_fraction"] <= 1.0
    assert verdict.summary["drive_speed_max_fraction"] <= 1.0


@pytest.mark.slow
def test_check_finds_the_payload_in_the_way():
    verdict = checked(BLOCKED)
    assert not verdict.passed
    (sentence,) = verdict.failures
    assert "camera_head penetrates payload::payload" in sentence
    assert "with the tip at" in sentence
    assert verdict.summary["clearance_sampled_min_m"] < -0.05


@pytest.mark.parametrize("name", (*INSPECTING, BLOCKED))
def test_scene_parses_strictly_and_is_fixed(name):
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.0)
    AddPlacedFrame(plant, "frame_0", RigidTransform())
    file = find_scene_file(name)
    models = AddScene(plant, file)
    plant.Finalize()
    check_anchored(plant, models, file)
    assert sorted(plant.GetModelInstanceName(model) for model in models) == ["pallet", "payload"]


@pytest.mark.parametrize("name", (*INSPECTING, BLOCKED))
def test_payload_stands_in_the_pallet(name):
    """Its cradles end on the pallet's floor, between the walls and within the pallet's length."""
    plant = MultibodyPlant(0.0)
    AddPlacedFrame(plant, "frame_0", RigidTransform())
    AddScene(plant, find_scene_file(name))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    pallet, payload = (plant.GetFrameByName(link) for link in ("pallet", "payload"))
    X = plant.CalcRelativeTransform(context, pallet, payload)
    file = "cylindrical_payload" if "4" in name else "long_cylindrical_payload"
    link = ET.parse(SDF / file / f"{file}.sdf").find(".//link")
    for cradle in ("cradle_1", "cradle_2"):
        shape = link.find(f"collision[@name='{cradle}']")
        middle = np.array(shape.findtext("pose").split(), dtype=float)[:3]
        half = 0.5 * np.array(shape.findtext("geometry/box/size").split(), dtype=float)
        corners = [middle + half * [1.0, y, z] for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
        feet = np.array([X @ corner for corner in corners])
        np.testing.assert_allclose(feet[:, 2], 0.0, atol=0.5e-3)
        assert np.all(np.abs(feet[:, 0]) < 0.5 * 2.87)
        assert np.all(np.abs(feet[:, 1]) < 1.70)


def test_pallet_has_the_size_of_the_real_one():
    """FACTS: 2.87 m x 4.35 m, 1.78 m inner height, 725 kg."""
    link = ET.parse(SDF / "spacelab_pallet" / "spacelab_pallet.sdf").find(".//link")
    assert float(link.findtext("inertial/mass")) == 725.0
    boxes = {}
    for shape in link.findall("collision"):
        pose = np.array(shape.findtext("pose").split(), dtype=float)
        size = np.array(shape.findtext("geometry/box/size").split(), dtype=float)
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        rotated = Rotation.from_euler("xyz", pose[3:]).apply(0.5 * corners * size)
        boxes[shape.get("name")] = pose[:3] + rotated
    every = np.concatenate(list(boxes.values()))
    np.testing.assert_allclose(np.ptp(every, axis=0)[:2], [2.87, 4.35], atol=1e-9)
    assert boxes["floor"][:, 2].max() == pytest.approx(0.0, abs=1e-12)  # the floor's inner face
    assert every[:, 2].max() == pytest.approx(1.78, abs=1e-9)


@pytest.mark.parametrize("folder", sorted(path.name for path in SDF.iterdir() if path.is_dir()))
def test_every_model_has_its_sdf_numbers_and_picture(folder):
    assert (SDF / folder / f"{folder}.sdf").is_file()
    text = (SDF / folder / "README.md").read_text(encoding="utf-8")
    for word in ("source", "assumed", f"{folder}.png"):
        assert word in text
    picture = SDF / folder / f"{folder}.png"
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size < 150_000


def test_visuals_and_collisions_of_scene_models_agree():
    """What is seen is what collides, bands of paint and outlines aside."""
    arms = set(list_names("arm"))
    for folder in (path for path in SDF.iterdir() if path.is_dir() and path.name not in arms):
        link = ET.parse(folder / f"{folder.name}.sdf").find(".//link")
        seen = {}
        for shape in link.findall("visual"):
            text = ET.tostring(shape.find("geometry")) + shape.findtext("pose").encode()
            seen[shape.get("name").removesuffix("_visual")] = b"".join(text.split())
        for shape in link.findall("collision"):
            text = ET.tostring(shape.find("geometry")) + shape.findtext("pose").encode()
            assert seen.pop(shape.get("name")) == b"".join(text.split())
        assert all(name.startswith(("band", "outline", "port_rim")) for name in seen)


def test_every_scenario_says_what_it_is():
    described = scenario_descriptions()
    assert set(described) >= {*INSPECTING, BLOCKED}
    assert all(20 < len(text) < 100 for text in described.values()), described


def simulated(name, folder):
    overrides = {"actuation.show_uncompensated": "false"}
    if hasattr(load_scenario(name).config, "camera"):
        overrides["camera.enabled"] = "false"
    return simulate_scenario(load_scenario(name, overrides), out=folder / name)


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", INSPECTING)
def test_simulated_arm_goes_out_and_back(name, tmp_path):
    verdict = simulated(name, tmp_path)
    summary = verdict.summary
    assert verdict.passed, verdict.failures
    assert summary["clearance_sampled_min_m"] >= 0.025
    planned = checked(name).summary
    planned_clearance = planned["clearance_sampled_min_m"]
    assert summary["clearance_sampled_min_m"] == pytest.approx(planned_clearance, abs=2e-3)
    assert summary["clearance_min_pair"] == planned["clearance_min_pair"]
    assert summary["spine_error_max_m"] <= 0.010
    assert summary["drive_effort_max_fraction"] <= 1.0
    assert summary["drive_speed_max_fraction"] <= 1.0
    # Out and back at 25 mm/s with ramps of 2 s, and 5 s there.
    travel = load_setup(load_scenario(name).config).path.travel
    assert summary["cycle_time_s"] == pytest.approx(2.0 * (travel / 0.025 + 2.0) + 5.0, abs=0.1)
    assert summary["cycle_completed"]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_simulated_arm_runs_into_the_payload_and_the_verdict_says_so(tmp_path):
    verdict = simulated(BLOCKED, tmp_path)
    assert not verdict.passed
    contact = verdict.failures[0]
    assert contact.startswith("prototype::camera_head penetrates payload::payload: -")
    assert "must be >= 25 mm, first broken at 86." in contact
    assert "(contact at 87." in contact
    assert any("from the plan at" in sentence for sentence in verdict.failures[1:])
    # The contact is held: millimetres deep, the joints near their limits at worst, and the folder
    # is whole.
    assert -0.02 < verdict.summary["clearance_sampled_min_m"] < 0.0
    assert verdict.summary["spine_error_max_m"] < 0.3
    folder = tmp_path / BLOCKED
    for file in ("clearance", "joints", "joints_commanded", "actuators", "tip"):
        rows = np.genfromtxt(folder / f"{file}.csv", delimiter=",", skip_header=1)
        assert np.isfinite(rows[1:]).all()  # no effort has acted in the first row
    clearance = np.genfromtxt(folder / "clearance.csv", delimiter=",", names=True)
    assert clearance["clearance_m"][-1] > 0.1  # it came free and back
    assert json.loads((folder / "summary.json").read_text(encoding="utf-8"))["verdict"] == "fail"
    assert (folder / "replay.html").is_file()
