"""What the permanent priority lists assume of the camera stations, and the check of moved cameras.

RMS-71, section V.B: "If a camera position change is desired, it is suggested that a careful study
be made to guarantee that it will not cause a priority conflict between objects due to its new
position with respect to fixed separating planes in the system." `check_cameras` is that study.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError
from pips_drake.remote_manipulator import geometry
from pips_drake.remote_manipulator.clusters import orbiter_solids, part_rotation
from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig, StationConfig
from pips_drake.remote_manipulator.geometry import Part
from pips_drake.remote_manipulator.priority_trees import (
    IN_BAY,
    OUT_OF_BAY,
    Plane,
    fixed_planes,
    tree_planes,
)

Array = NDArray[np.float64]

#: The trees' planes on whose true side a station is; it is on the false side of all others. Those
#: of {R} and {C} are as they are before anything is translated, and of them only those in the
#: station's own frame are taken for known. F and G ride on the arm: they know none. Made by
#: `true_sides` for the shipped cameras; a moved camera does not change it.
TRUE_SIDES: Mapping[str, str] = {
    "A": "2 3 5 16 20 23",
    "B": "2 3 5 16 20 23",
    "C": "2 16 23",
    "D": "2 3 5 16 20 23",
    "E": "2 3 5 16 20 23",
    "F": "",
    "G": "",
    "H": "2 16 23",
    "I": "",
    "J": "8",
    "K": "9",
    "L": "2 16 23",
    "M": "1 2 3 5 6 7 16 20 21 22 23",
}
_AXES = "xyz"


def station_planes(planes: Mapping[str, Plane], station: StationConfig) -> tuple[str, ...]:
    """The trees' planes that are fixed in the frame that the station is fixed in."""
    names = dict.fromkeys((*tree_planes(IN_BAY), *tree_planes(OUT_OF_BAY)))
    return tuple(name for name in names if name in planes and planes[name].frame == station.frame)


def true_sides(config: RemoteManipulatorConfig) -> dict[str, str]:
    """What `TRUE_SIDES` must be for the stations of a configuration."""
    planes = fixed_planes(config)
    names = dict.fromkeys((*tree_planes(IN_BAY), *tree_planes(OUT_OF_BAY)))
    result = {}
    for station in config.cameras.stations:
        true = []
        for name in names:
            # The payload moves against everything else.
            if name not in planes or (planes[name].frame == "P") != (station.frame == "P"):
                continue
            point = _seen_from(config, station, planes[name].frame)
            if point is not None and point[planes[name].axis] > planes[name].at:
                true.append(name)
        result[station.name] = " ".join(sorted(true, key=int))
    return result


def known_sides(planes: Mapping[str, Plane], station: StationConfig) -> dict[str, bool]:
    """For each of the station's planes, whether its list assumes it on the true side."""
    true = TRUE_SIDES[station.name].split()
    return {name: name in true for name in station_planes(planes, station)}


def check_cameras(config: RemoteManipulatorConfig) -> None:
    """Refuses stations that break the permanent priority lists, or that are inside something.

    Raises:
        InputError: a station is on the other side of a plane than its list has it, or in a solid.
    """
    planes = fixed_planes(config)
    for station in config.cameras.stations:
        where = f"station {station.name}: position_m = {list(station.position_m)} m"
        for name, side in known_sides(planes, station).items():
            plane = planes[name]
            beyond = float(station.position_m[plane.axis]) - plane.at
            if beyond == 0.0 or (beyond > 0.0) != side:
                raise InputError(
                    f"{where} breaks the priority list of this station, which has it on the other "
                    f"side of plane {name}, {plane.meaning}; {_AXES[plane.axis]} must be "
                    f"{'>' if side else '<'} {plane.at:.6g} m"
                )
        for frame, parts in _solids(config).items():
            point = _seen_from(config, station, frame)
            inside = [part.name for part in parts if point is not None and _holds(part, point)]
            if inside:
                raise InputError(f"{where} is inside {inside[0]}; must be outside of all solids")


def _solids(config: RemoteManipulatorConfig) -> dict[str, tuple[Part, ...]]:
    """What a camera must not be in, by frame; the stand is as high as it can be."""
    arm, top = config.arm, config.stand.upper_m

    def tube(name: str, length: float, *, upright: bool = False) -> Part:
        return Part(
            name=name,
            kind="prism",
            size=(arm.diameter_m, length),
            position=(0.0, 0.0, -0.5 * length) if upright else (0.5 * length, 0.0, 0.0),
            rpy=(0.0, 0.5 * math.pi if upright else 0.0, 0.0),
        )

    return {
        "R": (
            *orbiter_solids(config),
            tube("stand", top, upright=True),
        ),
        "P": geometry.payload_parts(config),
        "C": tuple(part for part in geometry.cae_parts(config) if part.solid),
        "0": (tube("arm_0", arm.arm_0_m),),
        "1": (tube("arm_1", arm.arm_1_m),),
    }


def _seen_from(config: RemoteManipulatorConfig, station: StationConfig, frame: str) -> Array | None:
    """A station's place in another frame as everything is at first; None if the arm is between."""
    point = np.array(station.position_m, dtype=np.float64)
    if station.frame == frame:
        return point
    origins = {
        "R": np.zeros(3),
        "P": np.array(config.payload.location_m),
        "C": np.array(config.central_assembly_element.location_m),
    }
    if station.frame not in origins or frame not in origins:
        return None
    result: Array = point + origins[station.frame] - origins[frame]
    return result


def _holds(part: Part, point: Array) -> bool:
    """Whether a point of the part's own frame is inside a box or prism."""
    local = part_rotation(part).T @ (point - np.array(part.position))
    if part.kind != "prism":
        return bool(np.all(np.abs(local) < 0.5 * np.array(part.size)))
    across, length = part.size
    angles = np.arange(geometry.SIDES) * 2.0 * math.pi / geometry.SIDES
    sides = np.cos(angles) * local[1] + np.sin(angles) * local[2]
    return bool(abs(local[0]) < 0.5 * length and np.all(sides < 0.5 * across))
