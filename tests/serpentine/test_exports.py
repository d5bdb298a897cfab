"""URDF and MJCF say what the SDF says: Drake reads the same arm from each."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from pips_drake.errors import InputError
from pips_drake.serpentine.export import Format, choose_format, make_export
from pips_drake.serpentine.mjcf import make_mjcf
from pips_drake.serpentine.mounting import MOUNTINGS, mounting_rotation
from pips_drake.serpentine.urdf import roll_pitch_yaw

OTHERS = (Format.URDF, Format.MJCF)
VARIANTS = {
    "prototype": {},
    "mirrored": {"mirrored": True},
    # Hinges whose frames stand at a pitch of 90 deg in their parents'.
    "gimbal": {"base": "gimbal", "offsets": [0.0] * 8},
    "mirrored gimbal": {"base": "gimbal", "mirrored": True},
    "two segments": {"lengths": [18.0, 14.0], "offsets": [1.1, 0.0]},
}


class Model:
    """An exported arm in Drake, frame {0} in the world's place."""

    def __init__(self, arm, format):
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, 1e-3)
        parser = Parser(self.plant)
        if format is not Format.MJCF:  # of which Drake does not know all
            parser.SetStrictParsing()
        text = make_export(arm, format)
        (self.model,) = parser.AddModelsFromString(text, format.value.removeprefix("."))
        rail = self.plant.GetBodyByName("rail", self.model)
        if format is not Format.MJCF:  # which says itself where it stands
            self.plant.WeldFrames(self.plant.world_frame(), rail.body_frame())
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self.bodies = [self.plant.GetBodyByName(body.name) for body in (arm.rail, *arm.bodies)]

    def inspector(self):
        return self.scene_graph.model_inspector()

    def shapes(self, body, role):
        """A body's solids: kind, dimensions m, pose in the body, colour; in order."""
        inspector, result = self.inspector(), []
        frame = self.plant.GetBodyFrameIdOrThrow(body.index())
        for geometry in inspector.GetGeometries(frame, role):
            shape = inspector.GetShape(geometry)
            kind = type(shape).__name__
            match kind:
                case "Box":
                    size = list(shape.size())
                case "Sphere":
                    size = [shape.radius()]
                case _:
                    size = [shape.radius(), shape.length()]
            pose = RigidTransform(inspector.GetPoseInFrame(geometry)).GetAsMatrix4()
            result.append((kind, np.array(size), pose, self._colour(geometry, role)))
        # Drake lists a body's geometries in no order that it promises.
        return sorted(result, key=lambda s: (s[0], *np.round(s[2][:3, 3], 6), *np.round(s[1], 6)))

    def _colour(self, geometry, role):
        if role is not Role.kIllustration:
            return None
        properties = self.inspector().GetIllustrationProperties(geometry)
        rgba = properties.GetProperty("phong", "diffuse")
        return rgba.r(), rgba.g(), rgba.b(), rgba.a()


@pytest.fixture(scope="module")
def models(arm_variant):
    """Arms and their models by format, by variant."""
    made = {}

    def get(name):
        if name not in made:
            arm = arm_variant(**VARIANTS[name])
            made[name] = arm, {format: Model(arm, format) for format in Format}
        return made[name]

    return get


each_variant = pytest.mark.parametrize("name", VARIANTS)
each_format = pytest.mark.parametrize("format", OTHERS, ids=lambda format: format.word)


@each_format
@each_variant
def test_positions_are_the_joint_values_in_order(models, name, format):
    arm, by_format = models(name)
    plant, model = by_format[format].plant, by_format[format].model
    assert plant.num_positions() == plant.num_actuators() == arm.joints
    assert plant.GetPositionNames(model, always_add_suffix=False) == list(arm.joint_names)
    assert plant.GetActuatorNames(model) == list(arm.joint_names)
    kinds = [plant.GetJointByName(joint).type_name() for joint in arm.joint_names]
    assert kinds == ["prismatic" if slides else "revolute" for slides in arm.is_prismatic]


@each_format
@each_variant
def test_links_stand_and_move_as_the_sdfs(models, random_postures, name, format):
    arm, by_format = models(name)
    ours, sdf = by_format[format], by_format[Format.SDF]
    for q in random_postures(arm, 20):
        for one in (ours, sdf):
            one.plant.SetPositions(one.plant_context, q)
        for body, other in zip(ours.bodies, sdf.bodies, strict=True):
            found = ours.plant.EvalBodyPoseInWorld(ours.plant_context, body).GetAsMatrix4()
            X_WB = sdf.plant.EvalBodyPoseInWorld(sdf.plant_context, other).GetAsMatrix4()
            # Products of some 20 matrices of doubles, each a rounding off for its other words:
            # quaternion, or roll, pitch and yaw, in the shortest text of the same double.
            np.testing.assert_allclose(found, X_WB, rtol=0, atol=1e-13)
        jacobians = [
            one.plant.CalcJacobianSpatialVelocity(
                one.plant_context,
                JacobianWrtVariable.kV,
                one.bodies[-1].body_frame(),
                np.zeros(3),
                one.plant.world_frame(),
                one.plant.world_frame(),
            )
            for one in (ours, sdf)
        ]
        np.testing.assert_allclose(*jacobians, rtol=0, atol=1e-13)


@each_format
@each_variant
def test_inertias_are_the_sdfs(models, name, format):
    _, by_format = models(name)
    ours, sdf = by_format[format], by_format[Format.SDF]
    for body, other in zip(ours.bodies, sdf.bodies, strict=True):
        found, inertia = (
            b.CalcSpatialInertiaInBodyFrame(one.plant_context)
            for b, one in ((body, ours), (other, sdf))
        )
        # The numbers in the files are the same text; only its sums may differ.
        assert found.get_mass() == inertia.get_mass()
        np.testing.assert_array_equal(found.get_com(), inertia.get_com())
        np.testing.assert_allclose(
            found.CopyToFullMatrix6(), inertia.CopyToFullMatrix6(), rtol=1e-14, atol=1e-15
        )


@each_format
@each_variant
def test_limits_and_gains_are_the_sdfs(models, name, format):
    arm, by_format = models(name)
    ours, sdf = by_format[format].plant, by_format[Format.SDF].plant
    for joint in arm.joint_names:
        found, stated = ours.GetJointByName(joint), sdf.GetJointByName(joint)
        assert found.position_lower_limits() == stated.position_lower_limits()
        assert found.position_upper_limits() == stated.position_upper_limits()
        if format is Format.URDF:  # MJCF has no limits of speed
            assert found.velocity_upper_limits() == stated.velocity_upper_limits()
            assert found.velocity_lower_limits() == stated.velocity_lower_limits()
        assert found.default_damping() == stated.default_damping() == 0.0
        drive, stated_drive = ours.GetJointActuatorByName(joint), sdf.GetJointActuatorByName(joint)
        assert drive.effort_limit() == stated_drive.effort_limit()
        gains, stated_gains = drive.get_controller_gains(), stated_drive.get_controller_gains()
        assert gains.p == stated_gains.p
        if format is Format.URDF:  # Drake (1.58) looks for an MJCF's `kv` under another name
            assert gains.d == stated_gains.d


@each_format
@each_variant
def test_what_collides_is_the_sdfs(models, name, format):
    _, by_format = models(name)
    ours, sdf = by_format[format], by_format[Format.SDF]
    for body, other in zip(ours.bodies, sdf.bodies, strict=True):
        found, stated = (one.shapes(b, Role.kProximity) for one, b in ((ours, body), (sdf, other)))
        assert [shape[0] for shape in found] == [shape[0] for shape in stated]
        for one, another in zip(found, stated, strict=True):
            np.testing.assert_array_equal(one[1], another[1])
            # Drake makes an SDF's poses from poses in the model: a few roundings of metres.
            np.testing.assert_allclose(one[2], another[2], rtol=0, atol=1e-14)


@each_format
@each_variant
def test_what_is_drawn_is_the_sdfs(models, name, format):
    _, by_format = models(name)
    ours, sdf = by_format[format], by_format[Format.SDF]
    for body, other in zip(ours.bodies, sdf.bodies, strict=True):
        found, stated = (
            one.shapes(b, Role.kIllustration) for one, b in ((ours, body), (sdf, other))
        )
        assert len(found) == len(stated) > 0
        for one, another in zip(found, stated, strict=True):
            assert one[0] == another[0]
            np.testing.assert_allclose(one[3], another[3], atol=1e-7)  # SDF's are floats
            # Struts have six digits of their lengths, of which MJCF has the half, and eight of
            # their poses.
            np.testing.assert_allclose(one[1], another[1], rtol=0, atol=1.1e-6)
            np.testing.assert_allclose(one[2], another[2], rtol=0, atol=1e-7)


@each_format
@each_variant
def test_the_same_pairs_are_left_out_of_collisions(models, name, format):
    arm, by_format = models(name)

    def left_out(model):
        inspector = model.inspector()
        boxes = {
            body.name(): model.plant.GetCollisionGeometriesForBody(body)[0] for body in model.bodies
        }
        return {
            pair
            for pair in combinations(boxes, 2)
            if inspector.CollisionFiltered(*(boxes[body] for body in pair))
        }

    # Neighbours, the segments at each universal joint, and the carriage and the first segment.
    assert len(left_out(by_format[Format.SDF])) == arm.joints + arm.modules + 1
    assert left_out(by_format[format]) == left_out(by_format[Format.SDF])


def test_roll_pitch_and_yaw_are_the_rotation_in_every_direction():
    rng = np.random.default_rng(95)
    turned = list(Rotation.random(200, random_state=rng))
    # All 24 of a cube, and pitches near 90 deg, where an arcsine is good to 1e-8 only.
    turned += list(Rotation.create_group("O"))
    turned += list(Rotation.from_euler("ZYX", [[0.3, np.pi / 2 - e, 1.1] for e in (1e-4, 1e-8, 0)]))
    for rotation in turned:
        R = RollPitchYaw(roll_pitch_yaw(rotation)).ToRotationMatrix().matrix()
        np.testing.assert_allclose(R, rotation.as_matrix(), rtol=0, atol=5e-15)  # roundings


@pytest.mark.parametrize("mounting", MOUNTINGS)
def test_an_mjcf_stands_as_it_is_mounted(arm, mounting):
    root = ET.fromstring(make_mjcf(arm, mounting))
    rail = root.find("worldbody/body[@name='rail']")
    assert rail is not None and rail.find("joint") is None
    w, x, y, z = (float(word) for word in rail.get("quat", "").split())
    R_W0 = Rotation.from_quat([x, y, z, w]).as_matrix()
    np.testing.assert_allclose(R_W0, mounting_rotation(mounting), rtol=0, atol=1e-15)
    assert rail.get("pos") == "0.0 0.0 0.0"
    assert RotationMatrix(R_W0).IsValid()


def test_an_mjcf_can_start_at_home_and_hold_there(arm):
    root = ET.fromstring(make_mjcf(arm))
    (key,) = root.findall("keyframe/key[@name='home']")
    for name in ("qpos", "ctrl"):
        values = [float(word) for word in key.get(name, "").split()]
        np.testing.assert_array_equal(values, arm.joint_home)
    assert [drive.get("joint") for drive in root.findall("actuator/position")] == list(
        arm.joint_names
    )


def test_an_mjcf_stands_on_a_known_mounting(arm):
    with pytest.raises(InputError, match="unknown mounting 'up'; known: laboratory, pad"):
        make_mjcf(arm, "up")


def test_only_an_mjcf_is_mounted(arm):
    for format in (Format.SDF, Format.URDF):
        with pytest.raises(InputError, match="--mounting pad: is for mjcf alone"):
            make_export(arm, format, mounting="pad")


@pytest.mark.parametrize(
    ("word", "file", "format"),
    [
        (None, None, Format.SDF),
        (None, "a.sdf", Format.SDF),
        (None, "a.urdf", Format.URDF),
        (None, "b.c/a.XML", Format.MJCF),
        (None, "a", Format.SDF),
        ("urdf", None, Format.URDF),
        ("mjcf", "a.xml", Format.MJCF),
        ("mjcf", "a.mjcf", Format.MJCF),
    ],
)
def test_a_format_is_what_is_said_or_what_the_file_ends_in(word, file, format):
    assert choose_format(word, file and Path(file)) is format


@pytest.mark.parametrize(
    ("word", "file", "message"),
    [
        ("usd", None, "unknown format 'usd' (did you mean 'sdf'?); known: mjcf, sdf, urdf"),
        (None, "a.txt", "a.txt: must end in one of .sdf, .urdf, .xml, or --format say which"),
        ("urdf", "a.xml", "a.xml: is not how urdf files end (.urdf)"),
    ],
)
def test_a_format_that_cannot_be_told_is_refused(word, file, message):
    with pytest.raises(InputError) as caught:
        choose_format(word, file and Path(file))
    assert str(caught.value) == message
