"""Follow-the-leader alone, in the browser: no dynamics, the joints go where the solver says.

    python diagrams/follow_the_leader_in_meshcat.py [--seconds 20]

Diagram: TipPathSource -> FollowTheLeaderController -> (positions) -> MultibodyPositionToGeometry
-> SceneGraph -> Meshcat.
"""

import argparse

from pydrake.geometry import MeshcatVisualizer
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Demultiplexer
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from pips_drake.scene.packages import add_package
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.motion_profile import RestToRestProfile
from pips_drake.serpentine.mounting import mounting_rotation
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.systems.follow_the_leader_controller import FollowTheLeaderController
from pips_drake.serpentine.systems.tip_path_source import TipPathSource
from pips_drake.twin.replay import make_meshcat


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=0.0, help="stop early; 0: the whole path")
    seconds = parser.parse_args().seconds

    arm, path = load_arm("prototype"), load_path("trajectory_4_arcs")
    builder = DiagramBuilder()

    # A plant for its shapes only: it is not simulated.
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    model_parser = Parser(plant)
    add_package(model_parser)
    model_parser.AddModelsFromUrl("package://pips_drake/sdf/prototype/prototype.sdf")
    X_W0 = RigidTransform(RotationMatrix(mounting_rotation("pad")), [0.0, 0.0, 3.0])
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("rail"), X_W0)
    plant.Finalize()

    # 250 mm/s, ten times the arm's own speed: nothing here has mass.
    profile = RestToRestProfile.make(travel=path.travel, speed=0.25, ramp=1.0)
    source = builder.AddSystem(TipPathSource(path, profile, dwell=1.0))
    leader = builder.AddSystem(FollowTheLeaderController(FollowTheLeader(arm)))
    positions = builder.AddSystem(Demultiplexer([arm.joints, arm.joints]))
    builder.Connect(source.GetOutputPort("tip"), leader.GetInputPort("tip"))
    builder.Connect(source.GetOutputPort("path"), leader.GetInputPort("path"))
    builder.Connect(leader.GetOutputPort("joint_state"), positions.get_input_port())

    # Positions are shown as they are: the plant's own output of poses is left unconnected.
    to_pose = builder.AddSystem(MultibodyPositionToGeometryPose(plant))
    builder.Disconnect(
        plant.get_geometry_pose_output_port(),
        scene_graph.get_source_pose_port(plant.get_source_id()),
    )
    builder.Connect(positions.get_output_port(0), to_pose.get_input_port())
    builder.Connect(
        to_pose.get_output_port(), scene_graph.get_source_pose_port(plant.get_source_id())
    )

    meshcat = make_meshcat()
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    simulator = Simulator(builder.Build())
    simulator.set_target_realtime_rate(0.0 if seconds else 1.0)
    print(f"open {meshcat.web_url()}")
    simulator.AdvanceTo(seconds or source.duration)


if __name__ == "__main__":
    main()
