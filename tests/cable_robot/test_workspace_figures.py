"""Figures of the studies: written, of their size, with the numbers that the studies gave."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import image

from pips_drake.cable_robot.cablings import (
    DISTURBANCE,
    Frame,
    bay_obstacles,
    compare_cablings,
    survey_poses,
)
from pips_drake.cable_robot.configuration import load_robot
from pips_drake.cable_robot.materials import MATERIALS, RopeNeed, compare_materials
from pips_drake.cable_robot.runs import cabling_figures, workspace_figures
from pips_drake.cable_robot.runs.cabling_figures import (
    cabling_plans_figure,
    cablings_figure,
    materials_figure,
)
from pips_drake.cable_robot.runs.workspace_figures import map_figure, volume_figure
from pips_drake.cable_robot.workspace import Study, make_grid, sweep
from pips_drake.errors import UnknownNameError
from pips_drake.twin.figures import figure_style, save_figure

from ..figure_layout import check_layout


@pytest.fixture(scope="module")
def robot():
    return load_robot("radiator_crossed").robot()


@pytest.fixture
def texts(monkeypatch):
    """What every figure says, by file name; each was checked for texts that overlap."""
    said = {}

    def check_and_save(figure, file):
        save_figure(figure, file)
        with figure_style():
            said[file.stem] = check_layout(figure)

    for module in (workspace_figures, cabling_figures):
        monkeypatch.setattr(module, "save_figure", check_and_save)
    return said


def colours(file):
    """Distinct colours in a PNG, and its width in pixels."""
    pixels = image.imread(file)
    return len(np.unique(pixels.reshape(-1, pixels.shape[2]), axis=0)), pixels.shape[1]


@pytest.mark.slow
def test_every_map_is_drawn_and_the_volume_is_the_sweep_s(robot, tmp_path, texts):
    volumes = workspace_figures.workspace_figures(
        tmp_path, robot, bay_obstacles(), disturbance=DISTURBANCE, cells=0.5
    )
    for name in ("tension", "accuracy", "stiffness", "force", "moment"):
        count, width = colours(tmp_path / f"map_{name}.png")
        assert count > 200  # a map in colours, not an empty frame
        assert width == 1500
    assert "position error (mm)" in texts["map_accuracy"]
    assert "not usable (20 N and 2 N m not borne" in texts["map_tension"]
    assert f"usable: {volumes['usable']:.0f} m3" in texts["volume"]
    grid = make_grid([-11.0, -7.0, -1.0], [11.0, 7.0, 6.0], (22, 14, 7))
    force, moment = DISTURBANCE
    study = Study(disturbance_force=force, disturbance_moment=moment, obstacles=bay_obstacles())
    assert volumes["usable"] == grid.measure(sweep(robot, grid.poses, study).usable)
    assert sum(volumes.values()) == pytest.approx(22.0 * 14.0 * 7.0)


@pytest.mark.slow
def test_cablings_and_materials_are_drawn(robot, tmp_path, texts):
    candidates = [("straight", Frame()), ("crossed_round", Frame())]
    rows = compare_cablings(robot, candidates, poses=survey_poses(3, 3)[0])
    cablings_figure(tmp_path / "cablings.png", rows)
    cabling_plans_figure(tmp_path / "plans.png", rows)
    need = RopeNeed(strength=1e4, axial_stiffness=1e6, longest=24.0, tension=200.0, slackest=90.0)
    materials_figure(tmp_path / "materials.png", compare_materials(need, materials=MATERIALS[:3]))
    for name in ("cablings", "plans", "materials"):
        count, width = colours(tmp_path / f"{name}.png")
        assert count > 50
        assert width == 1500
    best = rows[1]
    assert f"{best.moment:.1f}" in texts["cablings"]
    assert f"usable at {100.0 * best.usable:.0f} %" in texts["plans"]
    assert "recommended: steel wire rope" in texts["materials"]


def test_an_unknown_map_lists_the_known(robot, tmp_path):
    with pytest.raises(UnknownNameError, match="accuracy"):
        map_figure(tmp_path / "map.png", robot, "beauty", study=Study())


def test_a_robot_without_any_usable_place_has_its_figure_too(tmp_path, robot):
    study = Study(disturbance_force=1e5, parts=[])
    file = tmp_path / "volume.png"
    volumes = volume_figure(file, robot, study=study, cells=2.0, heights=[0.0, 2.0])
    assert volumes["usable"] == 0.0
    assert file.exists()
