"""The remote manipulator's station: your own channels in, the modelled arm at work.

    python diagrams/remote_manipulator_station.py [--seconds 10]

Sends the master arm's elbow 20 deg up, and reads the station's exported ports.
"""

import argparse

import numpy as np
from pydrake.systems.analysis import Simulator

from pips_drake.remote_manipulator.analog_inputs import angle_scaling, encode_frame
from pips_drake.remote_manipulator.configuration import load_configuration
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.phases import PHASES
from pips_drake.remote_manipulator.station import MakeRemoteManipulatorStation


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated time")
    seconds = parser.parse_args().seconds

    config = load_configuration()
    station = MakeRemoteManipulatorStation(config)
    ports = station.diagram
    simulator = Simulator(ports)
    context = simulator.get_mutable_context()

    # The welds that hold the payload are switched between steps, by the simulator's monitor.
    station.attachments.initialize(context)
    simulator.set_monitor(station.attachments.monitor)

    angles = config.arm.home + np.radians([0.0, 0.0, 20.0, 0.0, 0.0, 0.0])
    channels = encode_frame(OperatorInputs(angles=angles), angle_scaling(config.arm))
    ports.GetInputPort("operator.channels").FixValue(context, channels)

    simulator.Initialize()
    for time in np.linspace(0.0, seconds, 6):
        simulator.AdvanceTo(time)
        phase = PHASES[int(ports.GetOutputPort("collision_program.phase").Eval(context)[0])]
        arm = ports.GetOutputPort("relative_poses.arm_measured").Eval(context)
        clearance = ports.GetOutputPort("clearance_monitor.clearance").Eval(context)[0]
        word = int(ports.GetOutputPort("collision_program.control_word").Eval(context)[0])
        print(
            f"{time:5.1f} s: {phase}; elbow at {np.degrees(arm[3]):7.2f} deg; "
            f"clearance {clearance:.3f} m; control word {word:024b}"
        )


if __name__ == "__main__":
    main()
