"""Varied arms and paths differ in what they say, and in nothing else."""

from __future__ import annotations

import copy
import dataclasses
import math

import numpy as np
import pytest

from pips_drake.config import dump_yaml, load_yaml, validate
from pips_drake.errors import InputError, UnknownNameError
from pips_drake.scene.packages import find_arm_file, find_path_file, list_names
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import make_arm
from pips_drake.serpentine.arm_file import ArmFile
from pips_drake.serpentine.arm_variants import (
    ARM_VARIATIONS,
    equalise_links,
    scale_boxes,
    scale_offsets,
    scale_stiffness,
    set_joint_limits,
    set_path_travel,
    set_travel,
    vary_arm,
)
from pips_drake.serpentine.path_file import PathFile, load_path
from pips_drake.units import DEGREE, INCH

#: Lengths are sums of a dozen numbers of a metre.
ROUNDING = 1e-12

NEUTRAL = {
    "arm.offset_scale": 1.0,
    "arm.equal_links": 0.0,
    "arm.travel_in": 89.6,
    "arm.joint_limit_deg": 30.0,
    "arm.box_width_scale": 1.0,
    "arm.stiffness_scale": 1.0,
}


@pytest.fixture
def prototype() -> ArmFile:
    return load_yaml(ArmFile, find_arm_file("prototype"))


@pytest.mark.parametrize("name", sorted(ARM_VARIATIONS))
def test_the_neutral_value_of_a_variation_changes_nothing(name, prototype):
    before, after = make_arm(prototype), make_arm(vary_arm(prototype, name, NEUTRAL[name]))
    for field in dataclasses.fields(before):
        value, other = getattr(before, field.name), getattr(after, field.name)
        if isinstance(value, np.ndarray):
            np.testing.assert_allclose(other, value, rtol=1e-14, atol=0.0)
    assert after.rail.size == pytest.approx(before.rail.size, abs=ROUNDING)


@pytest.mark.parametrize("name", sorted(ARM_VARIATIONS))
def test_the_given_arm_is_not_changed_and_the_varied_one_survives_its_file(
    name, prototype, tmp_path
):
    before = copy.deepcopy(prototype)
    varied = vary_arm(prototype, name, {"arm.joint_limit_deg": 20.0}.get(name, 0.5))
    assert prototype == before
    assert varied != before
    validate(varied)
    (tmp_path / "arm.yaml").write_text(dump_yaml(varied))
    assert load_yaml(ArmFile, tmp_path / "arm.yaml") == varied


@pytest.mark.parametrize("factor", [0.0, 0.4, 1.7])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_offsets_and_links_change_within_an_arm_of_the_same_home(prototype, factor, share):
    arm, varied = (
        make_arm(prototype),
        make_arm(equalise_links(scale_offsets(prototype, factor), share)),
    )
    tip = kinematics.spine_points(arm, arm.joint_home)[0, -1]
    there = kinematics.spine_points(varied, varied.joint_home)[0, -1]
    assert there == pytest.approx(tip, abs=ROUNDING)


def test_without_offsets_modules_have_one_length_whatever_the_angle(prototype):
    arm = make_arm(scale_offsets(prototype, 0.0))
    shortest, longest = arm.module_length_range
    assert shortest == pytest.approx(longest, abs=ROUNDING)
    # The straight lengths of FTL-95 Table A.2's Q_MAX: Delta_i + S_{i+1}.
    assert longest[0] == pytest.approx((1.25 + 20.035) * INCH, abs=ROUNDING)


def test_equal_links_are_equal(prototype):
    varied = equalise_links(prototype, 1.0)
    assert len({round(segment.length_in, 9) for segment in varied.segments}) == 1
    assert len({round(segment.offset_in, 9) for segment in varied.segments[:-1]}) == 1


def test_travel_moves_the_upper_limit_and_the_rails_end_alike(prototype):
    varied = set_travel(prototype, 150.0)
    assert varied.joints[0].upper == pytest.approx(24.9 + 150.0)
    assert varied.rail.end_in - prototype.rail.end_in == pytest.approx(150.0 - 89.6)


def test_travel_is_in_inches_whatever_the_slides_unit(prototype):
    metric = copy.deepcopy(prototype)
    slide = metric.joints[0]
    slide.unit = "m"
    slide.home, slide.lower, slide.upper = (
        value * INCH for value in (slide.home, slide.lower, slide.upper)
    )
    ours, theirs = make_arm(set_travel(metric, 60.0)), make_arm(set_travel(prototype, 60.0))
    assert ours.joint_upper == pytest.approx(theirs.joint_upper, abs=ROUNDING)
    assert ours.rail.size == pytest.approx(theirs.rail.size, abs=ROUNDING)


def test_limits_boxes_and_stiffness_are_what_is_asked_for(prototype):
    arm = make_arm(set_joint_limits(prototype, 20.0))
    assert arm.joint_upper[2:] == pytest.approx(20.0 * DEGREE)
    assert arm.joint_lower[1] == make_arm(prototype).joint_lower[1]
    boxes = scale_boxes(prototype, 2.0).boxes
    assert (boxes["large"].width_in, boxes["large"].mass_kg) == (18.0, 96.0)
    stiff, nominal = make_arm(scale_stiffness(prototype, 4.0)), make_arm(prototype)
    assert stiff.linkage.stiffness == pytest.approx(4.0 * nominal.linkage.stiffness)
    assert stiff.base_stiffness == pytest.approx(4.0 * nominal.base_stiffness)


@pytest.mark.parametrize("name", sorted(ARM_VARIATIONS))
def test_impossible_values_are_refused_by_name(name, prototype):
    with pytest.raises(InputError, match=rf"{name} = -1"):
        vary_arm(prototype, name, -1.0)


def test_an_unknown_variation_names_the_known_ones(prototype):
    with pytest.raises(UnknownNameError, match=r"arm\.offset_scale"):
        vary_arm(prototype, "arm.offset", 1.0)


@pytest.mark.parametrize("travel", [10.0, 60.0, 89.0, 120.0])
def test_a_path_of_another_travel_is_the_same_path_as_far_as_both_go(travel, tmp_path):
    file = find_path_file("trajectory_4_arcs")
    (tmp_path / "cut.yaml").write_text(
        dump_yaml(set_path_travel(load_yaml(PathFile, file), travel))
    )
    whole, cut = load_path(file), load_path(tmp_path / "cut.yaml")
    assert cut.travel == pytest.approx(travel * INCH, abs=ROUNDING)
    both = np.linspace(0.0, min(whole.length, cut.length), 50)
    np.testing.assert_allclose(cut.point(both), whole.point(both), atol=1e-10)


def test_a_path_is_led_straight_on_from_its_end(tmp_path):
    file = find_path_file("trajectory_4_arcs")
    # Two quarter circles of 28 in and 29 in (FTL-95, Appendix D.1).
    end = 0.5 * math.pi * (28.0 + 29.0)
    (tmp_path / "on.yaml").write_text(
        dump_yaml(set_path_travel(load_yaml(PathFile, file), end + 10.0))
    )
    whole, led = load_path(file), load_path(tmp_path / "on.yaml")
    # It goes on along -y, where the second quarter circle turns to.
    there = whole.point(whole.length) + np.array([0.0, -10.0 * INCH, 0.0])
    assert led.point(led.length) == pytest.approx(there, abs=1e-10)


def test_every_shipped_arm_takes_every_variation():
    for name in list_names("arm"):
        arm = load_yaml(ArmFile, find_arm_file(name))
        for field, value in NEUTRAL.items():
            make_arm(vary_arm(arm, field, value))
