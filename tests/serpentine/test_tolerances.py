"""Errors within tolerances: what they do to an arm and a scene, and what is the worst of them."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.config import load_yaml
from pips_drake.errors import InputError, UnknownNameError
from pips_drake.scene.packages import find_arm_file, find_file
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.arm_file import ArmFile
from pips_drake.serpentine.runs import margins
from pips_drake.serpentine.runs.study import make_cases, run_case
from pips_drake.serpentine.tolerances import (
    TOLERANCES,
    Errors,
    arm_with_errors,
    draw,
    half_widths,
    worst_of,
)
from pips_drake.twin.study.probability import pass_probability
from pips_drake.twin.study.study_file import StudyFile

TOLERATED = {"payload_mm": 20.0, "link_mm": 1.0, "joint_deg": 0.5, "rail_mm": 2.0, "sag_share": 0.3}


def test_draws_are_within_tolerances_reach_their_ends_and_do_not_depend_on_each_other():
    arm = load_arm("prototype")
    widths = half_widths(arm, TOLERATED)
    drawn = np.array([draw(widths, 7, index) for index in range(2000)])
    assert np.all(np.abs(drawn) <= widths)
    assert np.all(np.abs(drawn).max(axis=0) > 0.99 * widths)
    # Even on an interval: mean 0 with the standard error of w / sqrt(3 N), five of them allowed.
    assert np.all(np.abs(drawn.mean(axis=0)) < 5.0 * widths / np.sqrt(3.0 * 2000))
    assert draw(widths, 7, 5) == pytest.approx(drawn[5], abs=0.0)
    assert not np.array_equal(draw(widths, 8, 5), drawn[5])


def test_errors_are_those_of_the_row_they_are_made_of():
    arm = load_arm("prototype")
    row = np.arange(3.0 + 16 + 18 + 1)
    errors = Errors.from_vector(arm, row)
    assert errors.payload.tolist() == [0.0, 1.0, 2.0]
    assert errors.joints[0] == 3 + 16
    assert errors.vector.tolist() == row.tolist()


def test_an_arm_with_errors_is_longer_by_them():
    config, arm = load_yaml(ArmFile, find_arm_file("prototype")), load_arm("prototype")
    lengths = np.linspace(-1e-3, 1e-3, 16)
    errors = Errors(payload=np.zeros(3), lengths=lengths, joints=np.zeros(18), sag_share=0.0)
    built = arm_with_errors(config, errors)
    assert built.segment_length - arm.segment_length == pytest.approx(lengths[:8], abs=1e-12)
    assert built.segment_offset - arm.segment_offset == pytest.approx(lengths[8:], abs=1e-12)


def test_an_arm_without_offsets_has_no_errors_of_them():
    arm = load_arm("pcr_concept")
    widths = half_widths(arm, {"link_mm": 1.0})
    assert np.count_nonzero(widths) == len(arm.segment_length)


@pytest.mark.parametrize("name", sorted(TOLERANCES))
def test_tolerances_that_mean_nothing_are_refused(name):
    with pytest.raises(InputError, match=f"tolerances.{name}"):
        half_widths(load_arm("prototype"), {name: -1.0})


def test_an_unknown_tolerance_names_the_known_ones():
    with pytest.raises(UnknownNameError, match="payload_mm"):
        half_widths(load_arm("prototype"), {"payload_in": 1.0})


def test_the_worst_corner_goes_against_the_gradient():
    assert worst_of(np.array([1.0, 2.0, 3.0]), np.array([0.5, -0.1, 0.0])).tolist() == [-1, 2, 0]


def test_the_interval_is_the_tables():
    # Clopper and Pearson: 0 of n leave 1 - (alpha / 2)^(1 / n); all of n the mirror image.
    share, low, high = pass_probability(0, 10)
    assert (share, low) == (0.0, 0.0)
    assert high == pytest.approx(1.0 - 0.025**0.1, rel=1e-9)
    share, low, high = pass_probability(200, 200)
    assert (share, high) == (1.0, 1.0)
    assert low == pytest.approx(0.025 ** (1.0 / 200.0), rel=1e-9)


@pytest.mark.parametrize("probability", [0.5, 0.9])
def test_the_interval_covers_the_truth_as_often_as_it_says(probability):
    random = np.random.default_rng(3)
    intervals = [pass_probability(passed, 50)[1:] for passed in range(51)]
    drawn = [intervals[k] for k in random.binomial(50, probability, 300)]
    covered = sum(low <= probability <= high for low, high in drawn)
    # At least 95 %; three standard errors below it for 300 trials.
    assert covered / 300 > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / 300)


def cases_of(draws: int = 4) -> list:
    study = StudyFile(scenario="trajectory_4", tolerances=TOLERATED, draws=draws)
    return make_cases(study, find_file("scenario", "trajectory_4"))


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_the_nominal_case_is_the_plan_and_the_adverse_one_is_tighter_than_any_draw():
    rows = [run_case(case.task) for case in cases_of(draws=12)]
    kinds = [case.values["kind"] for case in cases_of(draws=12)]
    # docs/scenes.md: 39 mm, segment_3 to the pallet.
    assert kinds[0] == margins.NOMINAL
    assert rows[0]["clearance_sampled_min_m"] == pytest.approx(0.039, abs=5e-4)
    assert rows[0]["tip_displacement_max_m"] == 0.0
    assert kinds[1] == margins.ADVERSE
    least = [row["clearance_sampled_min_m"] for row in rows]
    assert least[1] == min(least) < least[0]
    assert kinds[2] == margins.ADVERSE_PAYLOAD
    beside = [row["payload_clearance_sampled_min_m"] for row in rows]
    # docs/scenes.md: 192 mm from the camera head to the payload.
    assert beside[0] == pytest.approx(0.192, abs=5e-4)
    assert beside[2] == min(beside)
    # Every coordinate stands at an end of its tolerance or has no share in it.
    for name in ("payload_x_m", "payload_y_m", "payload_z_m"):
        assert abs(rows[2][name]) in (0.0, pytest.approx(0.02))
    assert all(abs(row["sag_share"]) <= 0.3 for row in rows)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_payload_that_comes_nearer_is_nearer_by_as_much():
    """An independent truth: moving the payload alone toward the camera head, along their normal."""
    study = StudyFile(
        scenario="trajectory_4_blocked",
        set={"camera.target_body": "payload::payload"},
        tolerances={"payload_mm": 50.0},
        draws=1,
    )
    nominal, adverse, payload, _ = make_cases(study, find_file("scenario", "trajectory_4_blocked"))
    before = run_case(nominal.task)
    assert "payload" in before["clearance_min_pair"]
    assert before["verdict"] == "fail"
    after = run_case(adverse.task)
    moved = np.linalg.norm([after[f"payload_{axis}_m"] for axis in "xyz"])
    change = before["clearance_sampled_min_m"] - after["clearance_sampled_min_m"]
    # Never more than it moved, and never less than half of a corner of a cube along any normal.
    assert 0.5 * moved <= change <= moved + 1e-6
    assert run_case(payload.task)["clearance_sampled_min_m"] == pytest.approx(
        after["clearance_sampled_min_m"], abs=1e-9
    )
