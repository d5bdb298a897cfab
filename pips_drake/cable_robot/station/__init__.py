"""The cable robot's station, and the parts that it is composed of."""

from pips_drake.cable_robot.station.plant import (
    BoxObstacle,
    CableRobotPlant,
    add_plant,
    check_time_step,
    fastest_rates,
)
from pips_drake.cable_robot.station.station import (
    AddCableRobot,
    CableRobotSystems,
    DisturbanceSettings,
    MakeCableRobotStation,
    Station,
    StationSettings,
    least_distances,
)

__all__ = [
    "AddCableRobot",
    "BoxObstacle",
    "CableRobotPlant",
    "CableRobotSystems",
    "DisturbanceSettings",
    "MakeCableRobotStation",
    "Station",
    "StationSettings",
    "add_plant",
    "check_time_step",
    "fastest_rates",
    "least_distances",
]
