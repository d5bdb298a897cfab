"""The design questions' answers, against what the library says of a pose or two."""

from __future__ import annotations

import csv

import numpy as np
import pytest
import yaml

from pips_drake.cable_robot.cablings import survey_poses
from pips_drake.cable_robot.configuration import load_robot
from pips_drake.cable_robot.statics import distribute_tensions
from pips_drake.scenarios import load_scenario, simulate

pytestmark = pytest.mark.slow


def run(folder, **changes):
    scenario = {
        "machine": "cable_robot",
        "task": "workspace",
        "robot": "radiator_crossed",
        "workspace": {"cell_m": 2.0, "compare_cablings": False},
    }
    (folder / "study.yaml").write_text(yaml.safe_dump(scenario | changes))
    return simulate(load_scenario(str(folder / "study.yaml")), out=folder / "out")


def test_the_crossed_robot_answers_all_questions_and_passes(tmp_path):
    verdict = run(tmp_path)
    assert verdict.passed
    summary = verdict.summary
    poses, _ = survey_poses()
    robot = load_robot("radiator_crossed").robot()
    tensions = distribute_tensions(robot, poses, "least_norm").tensions
    assert summary["tension_max_N"] == pytest.approx(tensions.max())
    assert summary["work_usable_share"] == 1.0 and summary["disturbance_margin"] > 1.0
    # It hangs: nowhere do its cables pull against each other without the weight.
    assert summary["work_kinematically_stable_share"] == 0.0
    assert summary["work_statically_stable_share"] == 1.0
    volumes = summary["volumes_m3"]
    assert 0.5 < volumes["usable"] / sum(volumes.values()) < 0.9
    for name in ("volume", "tension", "accuracy", "stiffness", "force", "moment", "materials"):
        assert (tmp_path / f"out/figures/{name}.png").stat().st_size > 10_000
    with (tmp_path / "out/materials.csv").open() as file:
        errors = {row["material"]: float(row["length_error_mm"]) for row in csv.DictReader(file)
                  if row["bears_bending"] == "1"}  # fmt: skip
    assert min(errors, key=lambda name: errors[name]) == summary["material_recommended"]


def test_the_straight_robot_fails_and_says_where(tmp_path):
    verdict = run(tmp_path, robot="radiator_straight")
    assert not verdict.passed
    assert "of a survey's poses can be used" in verdict.failures[0]
    assert "do not bear 20 N and 2 N m within 10 .. 2000 N" in verdict.failures[1]


def test_without_disturbances_the_weight_alone_is_asked(tmp_path):
    none = {"disturbance_force_N": 0.0, "disturbance_moment_N_m": 0.0}
    verdict = run(tmp_path, workspace={"cell_m": 2.0, "compare_cablings": False} | none)
    assert verdict.passed and not np.isfinite(verdict.summary["disturbance_margin"])
