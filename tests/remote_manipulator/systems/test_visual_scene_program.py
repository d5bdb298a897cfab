"""The scene program follows the control word at 20 Hz, and a point lands where a pinhole has it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydrake.geometry import (
    GeometryInstance,
    PerceptionProperties,
    Rgba,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.configuration import STATIONS, load_configuration
from pips_drake.remote_manipulator.control_word import ControlWord, encode
from pips_drake.remote_manipulator.systems.visual_scene_program import VisualSceneProgram
from pips_drake.twin.rendering import add_renderer

CONFIG = load_configuration()
HOME = np.array([2.0, *CONFIG.arm.home, 0.6])
PAYLOAD = np.array([1.0, 0.0, 0.0, 0.0, *CONFIG.payload.location_m])
CAE = np.array([1.0, 0.0, 0.0, 0.0, *CONFIG.central_assembly_element.location_m])
SIZE = (320, 180)
X_WR = RigidTransform(RotationMatrix.MakeXRotation(math.pi), np.zeros(3))


def word(station="A", **fields):
    return [float(encode(ControlWord(station=station, **fields)))]


def fix(system, context, **inputs):
    values = {
        "control_word": word(),
        "arm_measured": HOME,
        "payload_pose": PAYLOAD,
        "cae_pose": CAE,
    }
    for name, value in (values | inputs).items():
        system.GetInputPort(name).FixValue(context, value)


class Bench:
    """The system alone, in a simulator."""

    def __init__(self, **arguments):
        self.system = VisualSceneProgram(CONFIG, size=SIZE, **arguments)
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        fix(self.system, self.context)

    def frames(self, count, **fields):
        """Passes frames with one control word, from this moment on."""
        self.system.GetInputPort("control_word").FixValue(self.context, word(**fields))
        # A frame is taken at its beginning, before time goes on.
        self.simulator.AdvanceTo(self.context.get_time() + 0.05 * count)

    def output(self, name):
        return self.system.GetOutputPort(name).Eval(self.context)


def test_what_feeds_through():
    system = VisualSceneProgram(CONFIG)
    feedthrough = {
        (system.get_input_port(i).get_name(), system.get_output_port(j).get_name())
        for i in range(system.num_input_ports())
        for j in range(system.num_output_ports())
        if system.HasDirectFeedthrough(i, j)
    }
    places = {"arm_measured", "payload_pose", "cae_pose", "body_poses"}
    assert feedthrough == {
        *((name, output) for name in places for output in ("camera_pose", "color_image")),
        ("query_object", "color_image"),
    }


def test_the_word_moves_the_chosen_camera_frame_by_frame():
    bench = Bench(station="C")
    assert STATIONS[int(bench.output("station")[0])] == "C"
    before = bench.output("camera").copy()
    np.testing.assert_allclose(np.degrees(before), [10.0, -8.0, 60.0])
    # Rounded sums of times may pass one frame more or less than asked in a whole second.
    bench.frames(20, station="C", pan=1, zoom=1)
    taken = round((np.degrees(bench.output("camera")[0]) - 10.0) / 0.5)
    assert taken in (20, 21)
    change = np.degrees(bench.output("camera") - before)
    np.testing.assert_allclose(change, [0.5 * taken, 0.0, -0.25 * taken], atol=1e-9)
    bench.frames(2, station="F")
    assert STATIONS[int(bench.output("station")[0])] == "F"
    np.testing.assert_allclose(np.degrees(bench.output("camera")), [0.0, -76.0, 60.0])
    bench.frames(2, station="C")
    np.testing.assert_allclose(np.degrees(bench.output("camera") - before), change, atol=1e-9)
    bench.frames(2, station="C", initialize=True)
    np.testing.assert_array_equal(bench.output("camera"), before)


def test_the_pose_follows_the_orbiter_and_is_fixed_without_one():
    shift = RigidTransform([0.5, -0.25, 0.125])
    alone, carried = Bench(), Bench(orbiter_index=1)
    poses = [RigidTransform(), shift.multiply(X_WR)]
    carried.system.GetInputPort("body_poses").FixValue(carried.context, poses)
    still, moved = alone.output("camera_pose"), carried.output("camera_pose")
    # Station A, from {R} with z down to {W} with z up.
    np.testing.assert_allclose(still.translation(), [1.35, 0.90, 0.80], atol=1e-12)
    np.testing.assert_allclose(
        moved.translation() - still.translation(), shift.translation(), atol=1e-12
    )
    np.testing.assert_allclose(moved.rotation().matrix(), still.rotation().matrix(), atol=1e-12)


def test_an_illegal_word_is_refused():
    bench = Bench()
    with pytest.raises(InputError, match="must have exactly one 1, the mode's"):
        bench.system.GetInputPort("control_word").FixValue(bench.context, [0.0])
        bench.simulator.AdvanceTo(0.1)


def scene_with_dots(points_R):
    """A scene graph of red dots of 4 cm at points (N, 3) m in {R}, with the system."""
    builder = DiagramBuilder()
    scene_graph = builder.AddSystem(SceneGraph())
    system = builder.AddNamedSystem("scene", VisualSceneProgram(CONFIG, size=SIZE))
    source = scene_graph.RegisterSource("dots")
    for k, point in enumerate(points_R):
        dot = GeometryInstance(X_WR.multiply(RigidTransform(point)), Sphere(0.04), f"dot_{k}")
        properties = PerceptionProperties()
        properties.AddProperty("phong", "diffuse", Rgba(1.0, 0.0, 0.0, 1.0))
        dot.set_perception_properties(properties)
        scene_graph.RegisterAnchoredGeometry(source, dot)
    builder.Connect(scene_graph.get_query_output_port(), system.GetInputPort("query_object"))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    return diagram, scene_graph, system, context


@pytest.mark.render
@pytest.mark.parametrize("seed", [1, 2])
def test_a_point_lands_where_a_pinhole_camera_has_it(seed):
    rng = np.random.default_rng(seed)
    station = CONFIG.cameras.stations[0]
    # In the station's frame, by slopes: within the picture's 60 deg, 2.5 m ahead.
    across, down = rng.uniform(-0.8, 0.8), rng.uniform(-0.45, 0.45)
    in_S = 2.5 * np.array([1.0, across, down])
    look = Rotation.from_euler("ZY", [station.heading_deg, station.pitch_deg], degrees=True)
    point = look.apply(in_S) + station.position_m
    _, scene_graph, system, context = scene_with_dots([point])
    add_renderer(scene_graph, context=scene_graph.GetMyMutableContextFromRoot(context))
    own = system.GetMyMutableContextFromRoot(context)
    fix(system, own)
    image = np.array(system.GetOutputPort("color_image").Eval(own).data)[:, :, :3].astype(float)
    red = image[:, :, 1] < 100.0
    rows, columns = np.nonzero(red)
    assert rows.size > 5
    focal = 90.0 / math.tan(math.radians(30.0))
    expected = [159.5 + focal * across, 89.5 + focal * down]
    # The renderer draws half a pixel up and to the left (the same half in pictures five times as
    # wide), and the middle of a dot five pixels wide is known to a quarter of one.
    np.testing.assert_allclose([columns.mean(), rows.mean()], expected, atol=0.8)


def test_without_a_renderer_only_the_picture_fails():
    diagram, _, system, context = scene_with_dots([[5.0, -2.0, 0.0]])
    own = system.GetMyMutableContextFromRoot(context)
    fix(system, own)
    Simulator(diagram, context).AdvanceTo(0.2)
    assert system.GetOutputPort("camera_pose").Eval(own).translation().shape == (3,)
    with pytest.raises(InputError, match="add_renderer"):
        system.GetOutputPort("color_image").Eval(own)
