"""A scenario's workspace: its cells, and what it is loaded from."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pips_drake.errors import InputError
from pips_drake.planning.runs.workspace import load_workspace, make_grid
from pips_drake.planning.scenario import GoalConfig, PlannerScenario, WorkspaceConfig
from pips_drake.serpentine import kinematics


def test_cells_fill_the_workspace_and_are_no_larger_than_wanted():
    grid = make_grid(
        WorkspaceConfig(axis_m=[-1.0, 0.5], along_m=[1.0, 5.05], out_m=[1.5, 2.5], cell_mm=100.0)
    )
    assert grid.unfolded and grid.shape == (41, math.ceil(2.0 * math.pi * 2.0 / 0.1), 10)
    # Half a turn from x0, in the middle of the gap.
    assert_allclose(grid.to_world([[3.0, math.pi, 2.0]]), [[-3.0, 0.5, 3.0]], rtol=0, atol=1e-12)
    box = make_grid(
        WorkspaceConfig(
            kind="box", lower_m=[0.0, 0.0, 0.0], upper_m=[1.0, 0.3, 0.25], cell_mm=100.0
        )
    )
    assert not box.unfolded and box.shape == (10, 3, 3)
    assert_allclose(box.spacing, [0.1, 0.1, 0.25 / 3.0], rtol=1e-12)


def test_too_many_cells_are_refused_with_their_size():
    config = WorkspaceConfig(kind="box", lower_m=[0.0] * 3, upper_m=[100.0] * 3, cell_mm=5.0)
    with pytest.raises(InputError, match=r"cells of 5 mm.*cells at most"):
        make_grid(config)


def test_an_arm_begins_at_its_home_where_a_scenario_does_not_say():
    scenario = PlannerScenario(
        arm="prototype",
        workspace=WorkspaceConfig(kind="box", lower_m=[0.0] * 3, upper_m=[1.0] * 3),
        goals=[GoalConfig(point_m=[0.5] * 3)],
    )
    workspace = load_workspace(scenario)
    spine = kinematics.spine_points(workspace.arm, workspace.arm.joint_home)[0]
    assert_allclose(workspace.home_tip, spine[-1], rtol=0, atol=0)
    # Without a scene everything is free.
    assert workspace.occupancy.free.all() and workspace.scene_file is None
    scenario.home_tip_m = [0.1, 0.2, 0.3]
    assert_allclose(load_workspace(scenario).home_tip, [0.1, 0.2, 0.3])
    scenario.arm = "nobody"
    with pytest.raises(InputError, match="unknown arm 'nobody'"):
        load_workspace(scenario)


def test_a_scenario_in_millimetres_is_planned_in_metres():
    scenario = PlannerScenario(
        workspace=WorkspaceConfig(
            kind="box", lower_m=[0.0] * 3, upper_m=[1.0] * 3, arm_radius_mm=120.0
        ),
        goals=[GoalConfig(point_m=[0.5] * 3)],
    )
    scenario.snake.spacing_mm, scenario.snake.lead_mm = 80.0, 400.0
    workspace = load_workspace(scenario)
    assert workspace.occupancy.radius == 0.12
    settings = workspace.settings
    assert np.allclose([settings.snake.spacing, settings.lead], [0.08, 0.4], rtol=1e-15)
    assert np.allclose(settings.repulsion.reach, 0.3, rtol=1e-15)
