"""Drawn actuators reach from pin to pin, whatever the posture."""

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.station import AddSerpentineArm
from pips_drake.serpentine.systems.actuator_visualizer import AddActuatorVisualizer


@pytest.fixture(name="arm", scope="module")
def _arm():
    return load_arm("prototype")


def _diagram(arm, period):
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=1 / 512)
    model = AddSerpentineArm(plant, arm, RigidTransform())
    plant.Finalize()
    plant.SetDefaultPositions(model, arm.joint_home)
    visualizer = AddActuatorVisualizer(
        builder, plant=plant, model=model, scene_graph=scene_graph, arm=arm, period=period
    )
    return builder.Build(), plant, scene_graph, visualizer


def test_ports_and_feedthrough(arm):
    for period, feedthrough in ((None, True), (1 / 32, False)):
        _, _, _, visualizer = _diagram(arm, period)
        assert visualizer.GetInputPort("body_poses").get_index() == 0
        assert visualizer.GetOutputPort("geometry_pose").get_index() == 0
        assert visualizer.HasDirectFeedthrough(0) == feedthrough


def test_tube_and_rod_stand_at_their_pins_and_point_at_each_other(arm):
    diagram, plant, scene_graph, _ = _diagram(arm, None)
    context = diagram.CreateDefaultContext()
    rng = np.random.default_rng(5)
    q = rng.uniform(arm.joint_lower, arm.joint_upper)
    plant.SetPositions(plant.GetMyContextFromRoot(context), q)
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    poses = {}
    for frame in query.inspector().GetAllFrameIds():
        if query.inspector().GetOwningSourceName(frame) == "actuator_visualizer":
            poses[query.inspector().GetName(frame)] = query.GetPoseInWorld(frame).GetAsMatrix4()
    lengths = arm.linkage.length(q[2:])
    for name, length in zip(arm.actuator_names, lengths, strict=True):
        tube, rod = poses[f"{name}_tube"], poses[f"{name}_rod"]
        apart = rod[:3, 3] - tube[:3, 3]
        # The linkage's triangle is independent of the poses; rounding only.
        assert np.linalg.norm(apart) == pytest.approx(length, abs=1e-12)
        np.testing.assert_allclose(tube[:3, 2], apart / length, atol=1e-12)
        np.testing.assert_allclose(rod[:3, 2], -apart / length, atol=1e-12)


def test_sampled_poses_change_only_at_their_period(arm):
    diagram, _, _, visualizer = _diagram(arm, 1 / 32)
    simulator = Simulator(diagram)
    simulator.Initialize()
    port = visualizer.GetOutputPort("geometry_pose")

    def rods():
        poses = port.Eval(visualizer.GetMyContextFromRoot(simulator.get_context()))
        return np.array([poses.value(frame).translation() for frame in poses.ids()])

    simulator.AdvanceTo(1 / 32 + 1 / 512)
    before = rods()
    simulator.AdvanceTo(2 / 32 - 1 / 512)  # the unheld arm falls meanwhile
    np.testing.assert_array_equal(rods(), before)
    simulator.AdvanceTo(2 / 32 + 1 / 512)
    assert not np.array_equal(rods(), before)
