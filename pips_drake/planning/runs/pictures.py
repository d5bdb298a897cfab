"""What a plan looks like: three views, what a scan's camera sees, and the motion as a page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pips_drake.planning.coverage_figure import draw_coverage
from pips_drake.planning.runs.planned import Planned
from pips_drake.planning.runs.unfolded_panel import unfolded_panel
from pips_drake.planning.runs.views import ViewedPath, draw_views
from pips_drake.planning.runs.workspace import Workspace
from pips_drake.planning.scenario import PlannerScenario, goal_point, serpentine_scenario
from pips_drake.serpentine.joint_motion import JointMotion
from pips_drake.serpentine.runs.pictures import write_run_replay
from pips_drake.serpentine.runs.planned import planned_knots
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import SerpentineSetup, mounting_pose
from pips_drake.twin.figures import figure_style, new_figure, save_figure
from pips_drake.twin.replay_panel import ReplayPanel

Array = NDArray[np.float64]

#: Postures that are drawn, and that a page shows, at most.
_DRAWN, _SHOWN = 5, 500
# Of points at which a path is drawn, m.
_SPACING = 0.02


def write_views(
    file: Path, name: str, scenario: PlannerScenario, workspace: Workspace, planned: Planned
) -> None:
    """Draws what was planned, and what was not taken, in three views."""
    draw_views(
        file,
        occupancy=workspace.occupancy,
        arm=workspace.arm,
        paths=_paths(scenario, planned),
        postures=_postures(planned),
        shift=_shift(planned),
        goals=_goals(scenario),
        title=f"{name}: {workspace.arm.name} in {scenario.scene or 'free space'}",
    )


def write_coverage(file: Path, planned: Planned) -> None:
    """Draws what the camera of a scan sees of the surface; nothing without a scan of one."""
    if planned.scan is None or planned.scan.coverage is None:
        return
    with figure_style():
        figure = new_figure(height=4.5)
        track = planned.scan.tips[planned.scan.rows >= 0]
        draw_coverage(figure.subplots(), planned.scan.coverage, track=track)
        save_figure(figure, file)


def write_plan_replay(
    file: Path,
    name: str,
    scenario: PlannerScenario,
    workspace: Workspace,
    planned: Planned,
    run: SerpentineScenario,
    setup: SerpentineSetup,
) -> None:
    """Writes the planned motion, as it is commanded, as a page: in 3-D, and the gap unfolded."""
    knots = planned_knots(run, setup)
    count = min(_SHOWN, len(knots.times))
    # Evenly in time: knots stand where a motion bends.
    times = np.linspace(knots.times[0], knots.times[-1], count)
    joints = JointMotion(times=knots.times, joints=knots.positions).at(times)
    write_run_replay(
        file,
        run,
        setup,
        title=f"{name}: {setup.arm.name}, as planned",
        time=times,
        joints=joints,
        panel=make_panel(scenario, workspace, planned)(times, joints),
    )


def make_panel(
    scenario: PlannerScenario, workspace: Workspace, planned: Planned
) -> Callable[[Array, Array], ReplayPanel | None]:
    """What makes a page's flat view of a motion, (T,) s and (T, J) m and rad."""

    def panel(times: Array, joints: Array) -> ReplayPanel | None:
        return unfolded_panel(
            workspace.occupancy,
            workspace.arm,
            times=times,
            joints=joints,
            shift=_shift(planned),
            paths=_paths(scenario, planned),
            goals=_goals(scenario),
            X_W0=mounting_pose(serpentine_scenario(scenario, path="planned")),
        )

    return panel


def _paths(scenario: PlannerScenario, planned: Planned) -> list[ViewedPath]:
    # What a scan's tip did begins with the way there.
    plans = planned.plans if planned.scan is None else ()
    paths = [
        ViewedPath(
            points=one.path.point(one.path.samples(_SPACING)),
            label=_label(scenario, number, len(planned.plans)),
        )
        for number, one in enumerate(plans)
    ]
    if planned.scan is not None:
        paths.append(ViewedPath(points=planned.scan.tips, label="tip while it scans"))
    if planned.rough is not None:
        paths.append(ViewedPath(points=planned.rough, label="your path", alternative=True))
    return paths + [
        ViewedPath(points=one.pulled, label=one.words, alternative=True)
        for number, one in enumerate(planned.alternatives)
        if number != planned.chosen
    ]


def _goals(scenario: PlannerScenario) -> Array:
    return np.array([goal_point(scenario, goal) for goal in scenario.goals]).reshape(-1, 3)


def _shift(planned: Planned) -> float:
    return float(planned.plans[0].shift[2]) if planned.plans else 0.0


def _postures(planned: Planned) -> Array | None:
    """Some of the motion's; of a tour those at its goals."""
    if len(planned.plans) > 1:
        ends = np.array([one.plan.joints[-1] for one in planned.plans])
        return ends[~np.isnan(ends).any(axis=1)]
    if planned.motion is not None:
        return planned.motion.at(np.linspace(0.0, planned.motion.duration, _DRAWN))
    if not planned.plans:
        return None
    joints = planned.plans[-1].plan.joints
    joints = joints[~np.isnan(joints).any(axis=1)]
    if not len(joints):
        return None
    rows = np.linspace(0, len(joints) - 1, _DRAWN).round().astype(int)
    chosen: Array = joints[rows]
    return chosen


def _label(scenario: PlannerScenario, number: int, count: int) -> str:
    if number < len(scenario.goals) and scenario.goals[number].name:
        return f"path to {scenario.goals[number].name}"
    return "path of the tip" if count == 1 else f"path {number + 1}"
