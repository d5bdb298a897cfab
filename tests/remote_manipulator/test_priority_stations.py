"""Moved cameras that break the permanent priority lists are refused; harmless ones are not."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig
from pips_drake.remote_manipulator.priority import PriorityModel
from pips_drake.remote_manipulator.priority_stations import (
    TRUE_SIDES,
    check_cameras,
    known_sides,
    true_sides,
)
from pips_drake.remote_manipulator.priority_trees import fixed_planes

from .priority_scenes import CONFIG, Count, depths, eye_and_look, random_pose, rays

PLANES = fixed_planes(CONFIG)
BOUND = [station for station in CONFIG.cameras.stations if station.frame in "RPC"]


def moved(name: str, position: list[float]) -> RemoteManipulatorConfig:
    """The configuration with one station elsewhere in its frame."""
    config = copy.deepcopy(CONFIG)
    config.cameras.stations["ABCDEFGHIJKLM".index(name)].position_m = position
    return config


def test_shipped_cameras_pass_and_are_where_their_lists_have_them():
    check_cameras(CONFIG)
    assert true_sides(CONFIG) == TRUE_SIDES


@pytest.mark.parametrize("station", BOUND, ids=lambda station: station.name)
def test_each_plane_of_a_station_may_be_approached_but_not_crossed(station):
    sides = known_sides(PLANES, station)
    assert sides
    for name, side in sides.items():
        plane = PLANES[name]
        for beyond in (1e-6, -1e-6, 0.0):
            position = list(station.position_m)
            position[plane.axis] = plane.at + beyond
            config = moved(station.name, position)
            if beyond != 0.0 and (beyond > 0.0) == side:
                try:
                    check_cameras(config)
                except InputError as error:  # it may be in a wall there, but not across a plane
                    assert "is inside" in str(error) or f"plane {name}," not in str(error)
            else:
                with pytest.raises(InputError, match=f"^station {station.name}: ") as caught:
                    check_cameras(config)
                if "must be" in str(caught.value) and "plane" in str(caught.value):
                    assert "breaks the priority list" in str(caught.value)


def test_the_message_has_letter_plane_and_what_is_allowed():
    with pytest.raises(InputError) as caught:
        check_cameras(moved("A", [1.0, -0.9, -0.8]))
    assert str(caught.value) == (
        "station A: position_m = [1.0, -0.9, -0.8] m breaks the priority list of this station, "
        "which has it on the other side of plane 20, the forward wall's outer face; "
        "x must be > 1.1 m"
    )


@pytest.mark.parametrize(
    ("name", "position", "what"),
    [
        ("F", [3.0, 0.0, 0.1], "arm_0"),
        ("G", [3.0, 0.1, 0.0], "arm_1"),
        ("K", [0.2, 0.0, -2.3], "bar"),
    ],
)
def test_cameras_inside_something_are_refused(name: str, position: list[float], what: str):
    with pytest.raises(InputError, match=f"station {name}: .* is inside {what}; must be outside"):
        check_cameras(moved(name, position))


def test_a_camera_on_the_arm_may_be_anywhere_outside():
    check_cameras(moved("F", [3.0, 1.0, -1.0]))
    check_cameras(moved("G", [5.0, 0.0, -0.3]))


def test_a_camera_that_is_refused_would_have_painted_a_wrong_picture():
    # Station A goes to behind the CAE, its list remains: the CAE is painted behind the arm.
    config = moved("A", [-12.0, -2.7, -5.0])
    with pytest.raises(InputError, match="station A"):
        check_cameras(config)
    station, model = config.cameras.stations[0], PriorityModel(config)
    wrong = {}
    rng = np.random.default_rng(12)
    poses = [random_pose("stowed", rng) for _ in range(6)]
    for listed in (station.name, None):
        found = Count()
        for pose in poses:
            eye, look = eye_and_look(station, pose)
            (depth,) = depths(pose, [eye], [rays(look, 30)])
            found.add(model.order(pose, eye, phase="stowed", station=listed, sort=False), depth)
        wrong[listed] = found.wrong + found.wrong_unclaimed
        # Not even then is a wrong order claimed: claims look where the eye is.
        assert found.wrong == 0
    assert wrong["A"] > wrong[None]
