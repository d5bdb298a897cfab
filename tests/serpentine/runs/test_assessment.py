"""A run's assessment: each check fails alone, and says what, when and how much."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.follow_the_leader import FollowTheLeader
from pips_drake.serpentine.planned_motion import FollowedPath
from pips_drake.serpentine.runs.assessment import Assessment, RunData
from pips_drake.serpentine.scenario import CheckConfig
from pips_drake.serpentine.tip_path import polyline_path

SAMPLES = 5
PAIR = ("prototype::segment_8", "pallet::pallet")
INCH = 0.0254
#: A large box's actuator at a straight hinge: a = b = 9 in, square at the hinge (FACTS).
LEVER = 9.0 * INCH / np.sqrt(2.0)

Change = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def path() -> Any:
    points = np.array([[16.255, 0.0, 0.0], [16.255, 0.0, 174.902], [16.255, 0.0, 200.0]])
    return polyline_path(points * INCH, "straight")


@pytest.fixture
def assess(arm: SerpentineArm, path: Any) -> Callable[..., Assessment]:
    """Assesses a made-up run: at rest at home, 0.3 m from everything, changed by a function."""

    def make(change: Change | None = None, **checks: float) -> Assessment:
        joints = np.tile(arm.joint_home, (SAMPLES, 1))
        joints[:, 0] += 0.5 * INCH  # off the limit that home is at
        efforts = np.zeros(joints.shape)
        efforts[0] = np.nan
        fields: dict[str, Any] = dict(
            time=np.arange(SAMPLES, dtype=np.float64),
            tip_arc_lengths=np.full(SAMPLES, path.home_arc_length + 0.5 * INCH),
            commanded_joints=joints.copy(),
            joints=joints,
            joint_rates=np.zeros(joints.shape),
            joint_efforts=efforts,
            clearance=np.full(SAMPLES, 0.3),
            self_clearance=np.full(SAMPLES, 0.2),
            pairs=(PAIR,) * SAMPLES,
            solution=np.zeros((SAMPLES, 2)),
        )
        if change is not None:
            change(fields)
        return Assessment(
            arm=arm,
            motion=FollowedPath(path=path, solver=FollowTheLeader(arm)),
            checks=dataclasses.replace(CheckConfig(), **checks),
            data=RunData(**fields),
            clearance_range=0.5,
        )

    return make


def test_a_run_that_keeps_everything_has_no_failures(assess, arm):
    assessment = assess()
    assert assessment.failures() == []
    summary = assessment.summary()
    assert summary["clearance_sampled_min_m"] == 0.3
    assert summary["clearance_min_pair"] == list(PAIR)
    assert summary["clearance_in_range"]
    assert summary["tip_error_max_m"] == summary["spine_error_max_m"] == 0.0
    assert summary["joint_margin_min_rad"] == pytest.approx(np.radians(30.0))
    assert summary["rail_margin_min_m"] == pytest.approx(0.5 * INCH)
    assert summary["drive_effort_max_fraction"] == 0.0
    # The tip stands on the path, and the arm lies along it (FACTS: within 1e-4 in).
    assert summary["path_deviation_max_m"] < 5e-6


def test_the_least_clearance_is_told_with_pair_and_time(assess):
    def nearer(fields):
        fields["clearance"][1:4] = [0.020, 0.012, 0.024]
        fields["pairs"] = (None, None, ("prototype::camera_head", "payload::payload"), None, PAIR)

    assessment = assess(nearer)
    assert assessment.failures() == [
        "prototype::camera_head comes too near to payload::payload: 12.0 mm at 2.00 s; "
        "must be >= 25 mm, first broken at 1.00 s"
    ]
    summary = assessment.summary()
    assert summary["clearance_min_pair"] == ["prototype::camera_head", "payload::payload"]
    assert summary["clearance_min_time_s"] == 2.0


def test_a_clearance_below_zero_is_a_penetration(assess):
    def deeper(fields):
        fields["clearance"][1:] = [0.024, -0.001, -0.003, -0.002]

    assert assess(deeper).failures() == [
        "prototype::segment_8 penetrates pallet::pallet: -3.0 mm at 3.00 s; must be >= 25 mm, "
        "first broken at 1.00 s (contact at 2.00 s)"
    ]


def test_a_clearance_out_of_range_is_said_to_be(assess):
    def farther(fields):
        fields["clearance"][:] = 0.5
        fields["pairs"] = (None,) * SAMPLES

    summary = assess(farther).summary()
    assert not summary["clearance_in_range"]
    assert summary["clearance_min_pair"] == []


def test_the_arm_too_near_to_itself_is_told(assess):
    assessment = assess(lambda fields: fields["self_clearance"].__setitem__(3, 0.004))
    assert assessment.failures() == [
        "the arm comes too near to itself or its rail: 4.0 mm at 3.00 s; must be >= 10 mm"
    ]


def test_a_spine_point_off_the_plan_is_told(assess):
    # Along the rail every spine point is off by as much.
    assessment = assess(lambda fields: fields["joints"].__setitem__((3, 0), 0.7))
    (sentence,) = assessment.failures()
    off = 0.7 - 25.4 * INCH
    assert sentence.startswith("spine point ")
    assert sentence.endswith(f" is {off * 1e3:.1f} mm from the plan at 3.00 s; must be <= 10 mm")
    assert assessment.summary()["tip_error_max_m"] == pytest.approx(off)


def test_the_farthest_spine_point_is_named(assess, arm):
    # Joint 17, the last hinge, turns the last segment (12 in): only spine point 18 moves.
    assessment = assess(lambda fields: fields["joints"].__setitem__((1, 16), 0.05))
    (sentence,) = assessment.failures()
    off = 2.0 * np.sin(0.025) * 12.0 * INCH
    assert sentence.startswith(f"spine point 18 is {off * 1e3:.1f} mm from the plan at 1.00 s")


def test_an_effort_beyond_its_limit_names_the_drive(assess):
    # Joint 3's actuator: 25 kN.
    assessment = assess(
        lambda fields: fields["joint_efforts"].__setitem__((2, 2), -1.1 * 25000.0 * LEVER)
    )
    assert assessment.failures() == [
        "drive L3 needs 110 % of its effort limit at 2.00 s; must be <= 100 %"
    ]
    summary = assessment.summary()
    assert summary["actuator_force_max_fraction"] == pytest.approx(1.1, rel=1e-9)
    assert summary["drive_effort_max_drive"] == "L3"
    assert summary["drive_effort_max_time_s"] == 2.0


def test_the_rails_effort_counts_but_is_no_actuator_force(assess):
    assessment = assess(lambda fields: fields["joint_efforts"].__setitem__((2, 0), 12000.0))
    assert assessment.failures() == [
        "drive d1 needs 120 % of its effort limit at 2.00 s; must be <= 100 %"
    ]
    assert assessment.summary()["actuator_force_max_fraction"] == 0.0


def test_a_speed_beyond_its_limit_names_the_drive(assess):
    # 25 mm/s at the lever of a large box.
    assessment = assess(
        lambda fields: fields["joint_rates"].__setitem__((4, 3), 1.3 * 0.025 / LEVER)
    )
    assert assessment.failures() == [
        "drive L4 needs 130 % of its speed limit at 4.00 s; must be <= 100 %"
    ]
    assert assessment.summary()["drive_speed_max_fraction"] == pytest.approx(1.3, rel=1e-9)


def both(fields: dict[str, Any], joint: int, value: float) -> None:
    """The plan and the plant take a joint there, so that tracking has nothing to say."""
    for name in ("commanded_joints", "joints"):
        fields[name][3, joint] = value


def test_a_joint_beyond_its_limit_is_told_once_it_is_farther_than_the_slack(assess):
    assert assess(lambda fields: both(fields, 4, np.radians(30.09))).failures() == []
    assessment = assess(lambda fields: both(fields, 4, np.radians(-30.2)))
    assert assessment.failures() == ["joint theta5 is 0.20 deg beyond its limit at 3.00 s"]
    assert assessment.summary()["joint_margin_min_joint"] == "theta5"
    assert assessment.summary()["joint_margin_min_rad"] == pytest.approx(-np.radians(0.2))


def test_the_rail_beyond_its_limit_is_told_in_millimetres(assess):
    assert assess(lambda fields: both(fields, 0, 114.5 * INCH + 0.0009)).failures() == []
    assessment = assess(lambda fields: both(fields, 0, 24.9 * INCH - 0.0015))
    assert assessment.failures() == ["joint d1 is 1.50 mm beyond its limit at 3.00 s"]


def test_an_actuator_beyond_its_stroke_is_told(assess):
    assessment = assess(lambda fields: both(fields, 4, np.radians(31.5)), joint_overrun_max_deg=5.0)
    # An isosceles triangle of 9 in sides; its stroke ends 2 mm beyond the length at 30 deg.
    length = 2.0 * 9.0 * INCH * np.sin(np.radians(0.5 * np.array([90.0 + 31.5, 90.0 + 30.0])))
    beyond = (length[0] - length[1]) * 1e3 - 2.0
    assert assessment.failures() == [f"actuator L5 is {beyond:.2f} mm beyond its stroke at 3.00 s"]


def test_every_failure_has_its_sentence(assess):
    def all_of_it(fields):
        fields["clearance"][1] = fields["self_clearance"][1] = 0.001
        fields["joint_efforts"][1:] = 1e6
        fields["joint_rates"][:] = 9.0
        fields["joints"][2, 8] = 1.0

    said = "\n".join(assess(all_of_it).failures())
    for words in (
        "comes too near to pallet::pallet",
        "to itself",
        "from the plan",
        "of its effort limit",
        "of its speed limit",
        "joint theta9 is",
        "actuator L9 is",
    ):
        assert words in said
    assert said.count("\n") == 6
