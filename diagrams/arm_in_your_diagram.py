"""Only the controller and the SDF, in somebody else's diagram.

    python diagrams/arm_in_your_diagram.py [--seconds 4]

The arm's model brings its drives' stiffness as controller gains, so that its `desired_state` port
takes what `FollowTheLeaderController` puts out. Where the tip should be comes from a signal of
your own: here a sine.
"""

import argparse

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    Adder,
    ConstantValueSource,
    ConstantVectorSource,
    Multiplexer,
    Sine,
)

from pips_drake.scene.packages import add_package
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.kinematics import spine_points
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.systems.follow_the_leader_controller import FollowTheLeaderController


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0, help="simulated time")
    seconds = parser.parse_args().seconds

    arm, path = load_arm("prototype"), load_path("trajectory_4_arcs")
    solver = FollowTheLeader(arm)
    builder = DiagramBuilder()

    config = MultibodyPlantConfig(time_step=1 / 512, discrete_contact_approximation="lagged")
    plant, _ = AddMultibodyPlant(config, builder)
    model_parser = Parser(plant)
    add_package(model_parser)
    (model,) = model_parser.AddModelsFromUrl("package://pips_drake/sdf/prototype/prototype.sdf")
    # The rail overhead and horizontal: frame 0's x down, its z forward.
    X_W0 = RigidTransform(RotationMatrix(np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])), [0, 0, 3])
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("rail"), X_W0)
    plant.Finalize()

    # A sine about the middle of the path, as arc length and its rate.
    middle, amplitude, frequency = path.home_arc_length + 0.5 * path.travel, 0.2, 0.1
    plant.SetDefaultPositions(model, solver.solve(path, [middle]).joints[0])
    sine = builder.AddSystem(Sine(amplitude, frequency, phase=0.0, size=1))
    offset = builder.AddSystem(ConstantVectorSource([middle]))
    arc_length = builder.AddSystem(Adder(num_inputs=2, size=1))
    signal = builder.AddSystem(Multiplexer(2))
    builder.Connect(sine.get_output_port(0), arc_length.get_input_port(0))
    builder.Connect(offset.get_output_port(), arc_length.get_input_port(1))
    builder.Connect(arc_length.get_output_port(), signal.get_input_port(0))
    builder.Connect(sine.get_output_port(1), signal.get_input_port(1))
    constant_path = builder.AddSystem(ConstantValueSource(AbstractValue.Make(path)))
    leader = builder.AddSystem(FollowTheLeaderController(solver))
    builder.Connect(signal.get_output_port(), leader.GetInputPort("tip"))
    builder.Connect(constant_path.get_output_port(), leader.GetInputPort("path"))
    builder.Connect(leader.GetOutputPort("joint_state"), plant.get_desired_state_input_port(model))

    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(seconds)
    context = simulator.get_context()
    q = plant.GetPositions(plant.GetMyContextFromRoot(context), model)
    wanted = leader.GetOutputPort("joint_state").Eval(leader.GetMyContextFromRoot(context))
    sag = spine_points(arm, q)[0, -1] - spine_points(arm, wanted[: arm.joints])[0, -1]
    print(f"after {seconds:g} s the tip hangs {1e3 * np.linalg.norm(sag):.1f} mm below its command")
    print("(the full station compensates that: diagrams/serpentine_station.py)")


if __name__ == "__main__":
    main()
