"""The camera stands where pan and tilt put it, and its pictures show what stands there."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydrake.geometry import (
    Box,
    GeometryInstance,
    PerceptionProperties,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.framework import DiagramBuilder

from pips_drake.errors import InputError
from pips_drake.twin.camera import PinholeCamera
from pips_drake.twin.rendering import add_renderer
from pips_drake.twin.systems.camera_station import CameraStation

CAMERA = PinholeCamera(width=64, height=48, field_of_view=math.radians(40.0), near=0.05)
X_WB = RigidTransform(RollPitchYaw(0.0, 0.0, math.pi / 2), [0.0, -3.0, 1.0])


def pose(station, poses, **inputs):
    context = station.CreateDefaultContext()
    station.GetInputPort("body_poses").FixValue(context, poses)
    for name, value in inputs.items():
        station.GetInputPort(name).FixValue(context, value)
    return station.GetOutputPort("camera_pose").Eval(context)


def test_ports_and_what_feeds_through():
    station = CameraStation(0)
    feedthrough = {
        (station.get_input_port(i).get_name(), station.get_output_port(j).get_name())
        for i in range(4)
        for j in range(3)
        if station.HasDirectFeedthrough(i, j)
    }
    pictures = {
        (given, image)
        for given in ("query_object", "body_poses", "pan_tilt", "zoom")
        for image in ("color_image", "depth_image")
    }
    assert feedthrough == pictures | {
        ("body_poses", "camera_pose"),
        ("pan_tilt", "camera_pose"),
    }


def test_at_rest_it_looks_along_the_bodys_x_with_z_up():
    X_WC = pose(CameraStation(1), [RigidTransform(), X_WB])
    # The body's x is the world's y.
    np.testing.assert_allclose(X_WC.rotation().matrix().T, [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
                               atol=1e-12)  # fmt: skip
    np.testing.assert_array_equal(X_WC.translation(), [0.0, -3.0, 1.0])


def test_pan_turns_left_tilt_looks_up_and_the_mount_moves_with_the_body():
    station = CameraStation(0, X_BM=RigidTransform([0.5, 0.0, 0.0]))
    X_WC = pose(station, [X_WB], pan_tilt=[math.pi / 2, 0.0])
    np.testing.assert_allclose(X_WC.rotation().col(2), [-1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(X_WC.translation(), [0.0, -2.5, 1.0], atol=1e-12)
    X_WC = pose(station, [X_WB], pan_tilt=[0.0, math.pi / 4])
    np.testing.assert_allclose(
        X_WC.rotation().col(2), [0, math.sqrt(0.5), math.sqrt(0.5)], atol=1e-12
    )


def test_roll_turns_the_picture():
    X_WC = pose(CameraStation(0, roll=math.pi / 2), [X_WB])
    # The camera's up is the mount's right, so what was up goes to the left.
    np.testing.assert_allclose(-X_WC.rotation().col(1), [1.0, 0.0, 0.0], atol=1e-12)


def make_bench(*, rendered: bool = True):
    """A red cube of 1 m at the origin and a station that stands before it."""
    builder = DiagramBuilder()
    scene_graph = builder.AddSystem(SceneGraph())
    source = scene_graph.RegisterSource("test")
    cube = GeometryInstance(RigidTransform(), Box(1.0, 1.0, 1.0), "cube")
    properties = PerceptionProperties()
    properties.AddProperty("phong", "diffuse", Rgba(1.0, 0.0, 0.0, 1.0))
    cube.set_perception_properties(properties)
    scene_graph.RegisterAnchoredGeometry(source, cube)
    if rendered:
        add_renderer(scene_graph, background=(0.0, 1.0, 0.0))
    station = builder.AddSystem(CameraStation(0, camera=CAMERA))
    builder.Connect(scene_graph.get_query_output_port(), station.GetInputPort("query_object"))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    own = station.GetMyMutableContextFromRoot(context)
    station.GetInputPort("body_poses").FixValue(
        own, [RigidTransform(RotationMatrix.MakeZRotation(math.pi / 2), [0.0, -3.0, 0.0])]
    )
    return diagram, context, station, own


def red_rows(station, own):
    """How many pixels of the middle column are red."""
    image = np.array(station.GetOutputPort("color_image").Eval(own).data)
    assert image.shape == (48, 64, 4)
    return int(np.sum(image[:, 32, 0] > image[:, 32, 1]))


@pytest.mark.render
def test_the_picture_shows_the_cube_in_its_middle_and_zoom_enlarges_it():
    _diagram, _context, station, own = make_bench()
    # The near face, 2.5 m away, covers 1 / (2 * 2.5 * tan(20 deg)) of the height.
    rows = 48 / (2.0 * 2.5 * math.tan(math.radians(20.0)))
    assert red_rows(station, own) == pytest.approx(rows, abs=1.0)
    station.GetInputPort("zoom").FixValue(own, [1.5])
    assert red_rows(station, own) == pytest.approx(1.5 * rows, abs=1.0)


@pytest.mark.render
def test_looking_away_shows_the_background_alone():
    _diagram, _context, station, own = make_bench()
    station.GetInputPort("pan_tilt").FixValue(own, [math.pi, 0.0])
    image = np.array(station.GetOutputPort("color_image").Eval(own).data)
    assert (image[:, :, :3] == [0, 255, 0]).all()


@pytest.mark.render
def test_depth_is_along_the_view():
    _diagram, _context, station, own = make_bench()
    depth = np.array(station.GetOutputPort("depth_image").Eval(own).data)[:, :, 0]
    # A plane square to the view has one depth; the renderer's is a 24 or 32 bit buffer's.
    np.testing.assert_allclose(depth[18:30, 26:38], 2.5, atol=2e-3)
    assert np.isinf(depth[0, 0])


def test_without_a_renderer_the_message_says_what_to_do():
    _diagram, _context, station, own = make_bench(rendered=False)
    with pytest.raises(InputError, match="the camera cannot render; must have add_renderer"):
        station.GetOutputPort("color_image").Eval(own)
