"""The cable robot's station: way points in, the modelled winches, cables and platform at work.

    python diagrams/cable_robot_station.py [--seconds 20]

Sends the platform from over the bay to a starboard panel, and reads the station's exported ports.
"""

import argparse

import numpy as np
from pydrake.systems.analysis import Simulator

from pips_drake.cable_robot.cablings import bay_obstacles
from pips_drake.cable_robot.configuration import load_robot
from pips_drake.cable_robot.kinematics import make_poses
from pips_drake.cable_robot.platform_motion import MotionLimits, PlatformMotion
from pips_drake.cable_robot.station import BoxObstacle, MakeCableRobotStation, StationSettings


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="simulated time")
    seconds = parser.parse_args().seconds

    robot = load_robot("radiator_crossed").robot()
    way_points = [[0.0, 0.0, 1.5], [0.0, 3.3, 1.0], [0.0, 3.5, -0.5]]
    motion = PlatformMotion(make_poses(way_points), limits=MotionLimits(speed=0.4))
    doors = [BoxObstacle(name=box.name, size=box.size, X_WB=box.X_WB) for box in bay_obstacles()]
    settings = StationSettings(encoder_step=1e-4, force_step=1.0)
    station = MakeCableRobotStation(robot, motion, settings, obstacles=doors)

    ports = station.diagram
    simulator = Simulator(ports)
    context = simulator.get_context()
    for time in np.linspace(0.0, seconds, 6):
        simulator.AdvanceTo(time)
        wanted = motion.at(time).position
        place = ports.GetOutputPort("plant.platform_state").Eval(context)[4:7]
        tensions = ports.GetOutputPort("cable_forces.tensions").Eval(context)
        clearance = ports.GetOutputPort("clearance_monitor.clearance").Eval(context)[0]
        off = 1e3 * np.linalg.norm(place - wanted)
        print(
            f"{time:5.1f} s: at {np.round(place, 3)} m, {off:5.2f} mm off; "
            f"tensions {tensions.min():.0f} .. {tensions.max():.0f} N; "
            f"clearance {clearance:.3f} m"
        )


if __name__ == "__main__":
    main()
