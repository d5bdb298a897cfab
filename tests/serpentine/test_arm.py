"""The prototype is the arm of FTL-95's Appendix A, and an arm file that is wrong is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.scene.packages import find_arm_file
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.kinematics import module_lengths

INCH = 0.0254


def test_average_module_lengths_are_those_of_table_a2(arm):
    # FTL-95 Table A.2, to the six decimals that its definition gives (inches).
    table = [21.205889, 21.205889, 17.507598, 17.213567, 17.213567, 13.410085, 12.761790]
    # Half a unit of the sixth decimal.
    np.testing.assert_allclose(arm.average_module_length / INCH, table, rtol=0, atol=5e-7)


def test_module_length_range_is_table_a2s_delta_q(arm):
    shortest, longest = arm.module_length_range
    printed = [0.158, 0.158, 0.185, 0.149, 0.149, 0.180, 0.102]
    np.testing.assert_allclose((longest - shortest) / INCH, printed, rtol=0, atol=5e-4)


def test_module_lengths_reach_from_the_triangle_at_30_degrees_to_the_straight_module(arm):
    delta = np.array([1.25, 1.25, 1.5, 1.188, 1.188, 1.5, 0.813]) * INCH
    segment = np.array([20.035, 20.035, 16.1, 16.1, 16.1, 12.0, 12.0]) * INCH
    shortest, longest = arm.module_length_range
    # Two sides of a triangle as complex numbers; rounding of lengths below 1 m.
    bent = np.abs(delta + segment * np.exp(1j * np.pi / 6))
    np.testing.assert_allclose(shortest, bent, rtol=0, atol=1e-15)
    np.testing.assert_allclose(longest, delta + segment, rtol=0, atol=1e-15)


def test_average_lengths_belong_to_21_degrees_as_table_a2_prints(arm):
    # 21.1 deg is printed to 0.05 deg, and Q changes by at most 0.5 in a radian there.
    angles = np.full((1, arm.modules), np.radians(21.1))
    lengths = module_lengths(arm, angles)[0]
    np.testing.assert_allclose(
        lengths / INCH, arm.average_module_length / INCH, atol=0.5 * np.radians(0.05), rtol=0
    )


def test_dh_table_is_table_a1(arm, table_a1):
    np.testing.assert_allclose(arm.dh_table[:, 0], table_a1[:, 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(arm.dh_table[:, 1], table_a1[:, 1], rtol=0, atol=1e-15)
    np.testing.assert_allclose(arm.dh_table[1:, 2], table_a1[1:, 2], rtol=0, atol=1e-15)
    assert arm.is_prismatic.tolist() == [True] + [False] * 17
    assert not np.any(arm.dh_table[:, 3])


def test_home_and_limits_are_the_reports(arm):
    home = [24.9 * INCH, -np.pi / 2] + [0.0] * 16
    np.testing.assert_allclose(arm.joint_home, home, rtol=0, atol=1e-15)
    assert (arm.joint_lower[0] / INCH, arm.joint_upper[0] / INCH) == pytest.approx((24.9, 114.5))
    # Nominal limits are 30 deg either side of home.
    np.testing.assert_allclose((arm.joint_upper - arm.joint_home)[1:], np.pi / 6, atol=1e-15)
    np.testing.assert_allclose((arm.joint_home - arm.joint_lower)[1:], np.pi / 6, atol=1e-15)


def test_names_and_numbers_count_as_the_report_does(arm):
    assert arm.modules == 7
    assert arm.joints == 18
    assert arm.spine_indices == (4, 6, 8, 10, 12, 14, 16, 18)
    assert arm.joint_names[:3] == ("d1", "theta2", "theta3")
    assert arm.joint_names[-1] == "theta18"
    assert arm.joint_columns[:2] == ("d1_m", "theta2_rad")
    assert (arm.actuator_names[0], arm.actuator_names[-1]) == ("L3", "L18")
    assert len(arm.actuator_names) == 16


def test_each_joint_has_a_body_and_the_assumed_masses_add_up(arm):
    assert len(arm.bodies) == arm.joints
    assert len({body.name for body in arm.bodies}) == arm.joints
    # Carriage, crane, 3 large, 3 medium, 2 small boxes, 7 short links, head.
    total = 40 + 25 + 3 * 24 + 3 * 14 + 2 * 7 + 7 * 1.5 + 4
    assert sum(body.mass for body in arm.bodies) == pytest.approx(total, abs=1e-9)


def test_an_actuator_belongs_to_the_box_on_the_inner_side_of_its_hinge(arm):
    large, medium, small = 9.0, 7.5, 6.0
    # L3 to L9 hang on segments 1-3, L10 to L15 on 4-6, L16 to L18 on 7-8.
    anchors = [large] * 7 + [medium] * 6 + [small] * 2 + [2.7]  # the last inside the head
    np.testing.assert_allclose(arm.linkage.anchor_inner / INCH, anchors, atol=1e-12)
    # One force limit and one stiffness a box: they change where the box does and nowhere else.
    for values in (arm.linkage.force_limit, arm.linkage.stiffness):
        assert np.flatnonzero(np.diff(values)).tolist() == [6, 12]
    np.testing.assert_allclose(arm.linkage.speed_limit, 0.025, atol=1e-15)


@pytest.mark.parametrize("segments", [2, 3, 12])
def test_an_arm_may_have_any_number_of_segments(arm_variant, segments):
    arm = arm_variant(lengths=[12.0] * segments, offsets=[1.0] * segments)
    assert arm.modules == segments - 1
    assert arm.joints == 2 * segments + 2
    assert len(arm.bodies) == arm.joints
    assert len(arm.spine_indices) == segments
    assert arm.dh_table.shape == (arm.joints, 5)
    assert arm.linkage.stiffness.shape == (arm.joints - 2,)


def test_without_offsets_a_module_has_one_length(arm_variant):
    arm = arm_variant(lengths=[12.0] * 4, offsets=[0.0] * 4)
    shortest, longest = arm.module_length_range
    np.testing.assert_allclose(shortest, 12.0 * INCH, rtol=1e-15)
    np.testing.assert_allclose(longest, 12.0 * INCH, rtol=1e-15)


def test_unknown_arm_lists_the_known_ones():
    with pytest.raises(UnknownNameError, match=r"prototyp.*did you mean 'prototype'"):
        load_arm("prototyp")


# What is replaced in the prototype's file, by what, and what the message must say.
BAD_FILES = {
    "unknown key at the top": (
        "short_link_mass_kg:",
        "short_link_mass_lb:",
        ["unknown key 'short_link_mass_lb'", "did you mean 'short_link_mass_kg'"],
    ),
    "unknown key in the base": ("a2_in: 8.908", "a2_m: 8.908", ["motion_base", "'a2_m'"]),
    "unknown key in a segment": (
        "{length_in: 12.000, offset_in: 0.763, box: small}",
        "{lenght_in: 12.000, offset_in: 0.763, box: small}",
        ["segments[7]", "'lenght_in'", "length_in"],
    ),
    "unknown key in a joint": (
        "{name: theta5, unit: deg,",
        "{name: theta5, units: deg,",
        ["joints[4]", "'units'"],
    ),
    "unknown key in a box": ("pin_angle_deg: 90.0", "pin_angle: 90.0", ["boxes.", "'pin_angle'"]),
    "unknown key in a drive": (
        "torque_limit_Nm: ",
        "torque_Nm: ",
        ["motion_base_drives.theta2", "'torque_Nm'"],
    ),
    "negative mass": (
        "mass_kg: 14.0",
        "mass_kg: -14.0",
        ["boxes.medium", "mass_kg = -14.0", "> 0"],
    ),
    "missing mass": ("    mass_kg: 14.0\n", "", ["boxes.medium", "mass_kg", "> 0"]),
    "NaN length": ("a0_in: 11.250", "a0_in: .nan", ["motion_base.a0_in", "finite"]),
    "infinite force": (
        "    force_limit_N: ",
        "    force_limit_N: .inf # ",
        ["motion_base_drives.d1.force_limit_N", "finite"],
    ),
    "text for a number": (
        "a0_in: 11.250",
        "a0_in: eleven",
        ["motion_base.a0_in = 'eleven'", "a number"],
    ),
    "nothing for a number": ("a0_in: 11.250", "a0_in:", ["motion_base.a0_in = null", "a number"]),
    "number for a list": ("[14.0, 8.0, 12.0]", "14.0", ["carriage.size_in = 14.0", "a list"]),
    "two numbers for three": ("[14.0, 8.0, 12.0]", "[14.0, 8.0]", ["carriage.size_in", "three"]),
    "limits in the wrong order": (
        "{name: theta7, unit: deg, home: 0.0, lower: -30.0, upper: 30.0}",
        "{name: theta7, unit: deg, home: 0.0, lower: 30.0, upper: -30.0}",
        ["joints.theta7.lower = 30.0", "< upper"],
    ),
    "home outside its limits": (
        "home: 24.9, lower: 24.9",
        "home: 20.0, lower: 24.9",
        ["joints.d1.home = 20.0", "between"],
    ),
    "wrong joint name": (
        "name: theta9,",
        "name: theta99,",
        ["joints.name = theta99", "theta9"],
    ),
    "joints in the wrong order": ("name: theta3,", "name: theta4,", ["theta4", "theta3, in order"]),
    "a missing joint row": (
        "  - {name: theta18, unit: deg, home: 0.0, lower: -30.0, upper: 30.0}\n",
        "",
        ["rows in joints = 17", "18"],
    ),
    "unknown joint unit": ("unit: in, home: 24.9", "unit: ft, home: 24.9", ["d1.unit = ft", "rad"]),
    "an angle for a slide": ("unit: in, home: 24.9", "unit: deg, home: 24.9", ["d1.unit = deg"]),
    "unknown base": ("kind: rail_crane", "kind: crane", ["motion_base.kind = crane", "gimbal"]),
    "unknown box": (
        "0.763, box: small",
        "0.763, box: tiny",
        ["box = tiny", "large, medium, small"],
    ),
    "offset longer than its segment": (
        "offset_in: 0.763",
        "offset_in: 76.3",
        ["segments[7]", "offset_in = 76.3"],
    ),
    "repeated key": ("mirrored: false", "mirrored: false\nmirrored: true", ["'mirrored'", "line"]),
    "word for a flag": (
        "mirrored: false",
        "mirrored: left",
        ["mirrored = 'left'", "true or false"],
    ),
    "broken YAML": ("carriage: {mass_kg: 40.0,", "carriage: {{mass_kg: 40.0,", ["line "]),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_a_bad_arm_file_is_refused_in_one_line_that_says_where(tmp_path: Path, case: str):
    old, new, words = BAD_FILES[case]
    text = find_arm_file("prototype").read_text()
    assert old in text, "the prototype's file has changed: mend this test"
    file = tmp_path / "arm.yaml"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_arm(file)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"{file}: ")
    for word in words:
        assert word in message
