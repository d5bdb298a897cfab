"""Robots' files: those shipped, and what is refused."""

from __future__ import annotations

import re

import numpy as np
import pytest

from pips_drake.cable_robot.configuration import load_robot
from pips_drake.cable_robot.kinematics import cable_lengths, make_poses
from pips_drake.cable_robot.stability import kinematic_stability, static_stability
from pips_drake.cable_robot.statics import distribute_tensions
from pips_drake.errors import InputError
from pips_drake.scene.packages import find_file, list_names

SHIPPED = find_file("cable robot", "planar_example").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", list_names("cable robot"))
def test_every_shipped_robot_says_where_its_numbers_come_from_and_holds_its_weight(name):
    config = load_robot(name)
    assert "assumed" in config.source.lower()
    if name == "planar_example":  # whose point is that it does not
        return
    robot = config.robot()
    middle = 0.5 * (np.array(config.region.lower_m) + config.region.upper_m)
    poses = make_poses(middle)
    config.require_inside(poses)
    assert static_stability(robot, poses).stable.all()
    assert distribute_tensions(robot, poses, "least_norm").feasible.all()


def test_the_planar_examples_cables_are_those_of_the_report():
    robot = load_robot("planar_example").robot()
    lengths = cable_lengths(robot, make_poses([0.0, 0.0, 0.0]))
    np.testing.assert_allclose(lengths, np.sqrt(5.0))
    np.testing.assert_allclose(robot.weight_wrench(np.eye(3)), [0.0, -1.0, 0.0])


def test_ipanema_is_fully_constrained_and_caroca_hangs():
    pose = make_poses([[0.0, 0.0, 1.3]])
    assert kinematic_stability(load_robot("ipanema_3").robot(), pose).stable.all()
    assert not kinematic_stability(load_robot("caroca").robot(), pose).stable.any()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass_kg: 1.0", "mass_kg: -1.0", "mass_kg = -1.0; must be > 0"),
        ("tension_max_N: 10.0", "tension_max_N: .nan", "tension_max_N"),
        ("tension_max_N: 10.0", "tension_max_N: 10.0, tension_min_N: 20.0", "20 .. 10 N; must be"),
        ("axial_stiffness_N: 1.0e+4", "axial_stiffness_N: -3.0", "axial_stiffness_N = -3.0"),
        ("[0.0, -1.0, 0.0]}", "[0.0, -1.0]}", "attachment_m = [0.0, -1.0]; must be three numbers"),
        ("upper_m: [2.0,", "upper_m: [-3.0,", "must be rising"),
        ("planar: true", "planar: perhaps", "planar"),
        ("planar: true", "planar: false", "cables = 4; must be >= 6"),
        ("anchor_m: [2.0, -2.0, 0.0], attachment_m: [0.0, -1.0, 0.0]",
         "anchor_m: [2.0, 2.0, 0.0], attachment_m: [1.0, 0.0, 0.0]",
         "cables 1 and 2 have the same"),
        ("source:", "sauce:", "sauce"),
    ],
)  # fmt: skip
def test_what_is_no_robot_is_refused_with_its_field(tmp_path, old, new, message):
    assert old in SHIPPED
    (tmp_path / "own.yaml").write_text(SHIPPED.replace(old, new, 1))
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        load_robot("own.yaml", inside=tmp_path)
    assert "\n" not in str(caught.value)


def test_a_robot_without_cables_is_refused(tmp_path):
    text = re.sub(r"cables:\n(- .*\n)+", "", SHIPPED)
    (tmp_path / "own.yaml").write_text(text)
    with pytest.raises(InputError, match="cables = none"):
        load_robot("own.yaml", inside=tmp_path)


def test_poses_outside_the_frame_are_refused_with_place_and_limits():
    config = load_robot("planar_example")
    with pytest.raises(InputError, match=r"pose 2 at \[3\.0, 0\.0, 0\.0\] m lies outside"):
        config.require_inside(make_poses([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]))
