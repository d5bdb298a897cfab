"""A cable robot's data: what is refused, and what gravity does."""

from __future__ import annotations

import re

import numpy as np
import pytest

from pips_drake.cable_robot.kinematics import rotation_matrix
from pips_drake.errors import InputError

from .robots import box_robot, planar_example


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"anchors": [[2, 2, 0]] * 2, "attachments": [[1, 0, 0], [0, 1, 0]]}, "cables = 2; must"),
        ({"attachments": [[1, 0, 0]] * 3}, "must be (M, 3) each"),
        ({"anchors": [[2, 2, 0]] * 4, "attachments": [[1, 0, 0]] * 4}, "cables 1 and 2 have the"),
        ({"anchors": [[2, 2, 0]] * 4}, "anchors = 1 different points; must be >= 2"),
        ({"axial_stiffness": -1.0}, "axial_stiffness = -1 N; must be > 0"),
        ({"axial_stiffness": np.nan}, "axial_stiffness = nan N"),
        ({"mass": 0.0}, "mass = 0 kg; must be > 0"),
        ({"tension_min": 5.0, "tension_max": 4.0}, "tension bounds = 5 .. 4 N; must be rising"),
        ({"tension_min": -1.0}, "tension bounds = -1 .. inf N"),
        ({"freedoms": (0, 1)}, "freedoms = (0, 1); must be"),
        ({"anchors": [[2, 2, 1], [2, -2, 0], [-2, -2, 0], [-2, 2, 0]]}, "must lie in one plane"),
        ({"gravity": [0.0, np.inf, 0.0]}, "gravity = [0.0, inf, 0.0]; must be finite numbers"),
    ],
)  # fmt: skip
def test_what_is_no_robot_is_refused(changes, message):
    with pytest.raises(InputError, match=re.escape(message)):
        planar_example(**changes)


def test_the_weights_wrench_is_force_and_moment_of_the_centre_of_mass():
    robot = box_robot()
    object.__setattr__(robot, "centre_of_mass", np.array([0.1, 0.0, 0.0]))
    R = rotation_matrix([[0.0, 0.0, 0.0], [np.pi / 2, 0.0, 0.0]])
    weight = 20.0 * 9.81
    expected = [[0, 0, -weight, 0, 0.1 * weight, 0], [0, 0, -weight, -0.1 * weight, 0, 0]]
    np.testing.assert_allclose(robot.weight_wrench(R), expected, atol=1e-12)


def test_arrays_cannot_be_changed_afterwards():
    with pytest.raises(ValueError, match="read-only"):
        box_robot().anchors[0, 0] = 1.0
