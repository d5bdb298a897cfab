"""Pictures and replay of an arm in its scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import QueryObject, SceneGraph
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from pips_drake.serpentine.planned_motion import PlannedMotion
from pips_drake.serpentine.runs.assessment import Assessment, RunData
from pips_drake.serpentine.runs.supervised import RunDecision
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import (
    SerpentineSetup,
    arm_pose,
    legs_name,
    make_plant,
    mounting_pose,
)
from pips_drake.twin.camera import PinholeCamera
from pips_drake.twin.figures import COLORS, figure_style, new_figure, save_figure
from pips_drake.twin.rendering import (
    FIELD_OF_VIEW,
    add_renderer,
    corner_points,
    fit_view,
    look_at,
    render_available,
    render_depth,
    render_view,
    save_png,
)
from pips_drake.twin.replay import Bookmark, LineInSpace, write_replay
from pips_drake.twin.replay_panel import ReplayPanel
from pips_drake.twin.seen_figure import ColoredPatches

Array = NDArray[np.float64]

#: Pixels of a picture.
SIZE = (1600, 1000)
#: From how far the tightest moment is looked at, m.
MOMENT_DISTANCE = 2.2
#: Of the line between nearest points.
NEAREST_COLOR = (0.902, 0.0, 0.494)
#: A run that is held again and again has more decisions than a page has room for.
MOST_DECISIONS = 6


def write_run_pictures(
    folder: Path, scenario: SerpentineScenario, setup: SerpentineSetup, assessment: Assessment
) -> str | None:
    """Renders a run: scene and path, four stages, the end, and the tightest moment.

    Returns:
        None, or one line that says why there are no pictures here.
    """
    missing = render_available()
    if missing is not None:
        return missing
    data = assessment.data
    end = int(np.argmax(data.tip_arc_lengths))
    travel = data.tip_arc_lengths - setup.motion.start
    stages = {}
    for share in (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0):
        sample = int(np.argmax(travel[: end + 1] >= share * travel[end] - 1e-9))
        stages[f"t = {data.time[sample]:.0f} s, tip at {travel[sample]:.2f} m"] = data.joints[
            sample
        ]
    scene_figure(folder / "scene.png", scenario, setup)
    stages_figure(folder / "stages.png", scenario, setup, stages)
    render_posture(folder / "end.png", scenario, setup, data.joints[end])
    nearest = assessment.nearest
    pair = data.pairs[nearest]
    if data.witness is not None and pair is not None:
        moment_figure(
            folder / "least_clearance.png",
            scenario,
            setup,
            joints=data.joints[nearest],
            witness=data.witness[nearest],
            title=f"Least clearance: {data.clearance[nearest] * 1e3:.1f} mm at "
            f"{data.time[nearest]:.1f} s, {pair[0]} to {pair[1]}",
        )
    return None


def render_posture(
    file: Path, scenario: SerpentineScenario, setup: SerpentineSetup, joints: ArrayLike
) -> None:
    """Renders the arm in its scene in a posture (joints,) m and rad."""
    diagram, plant, scene_graph, model = _make_posed(scenario, setup, rendered=True)
    context = diagram.CreateDefaultContext()
    plant.SetPositions(plant.GetMyContextFromRoot(context), model, np.asarray(joints))
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    X_WC = fit_view(corner_points(query), view_direction(scenario), size=SIZE)
    save_png(render_view(query, X_WC, size=SIZE), file)


def stages_figure(
    file: Path,
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    postures: Mapping[str, ArrayLike],
) -> None:
    """Four stages of a run rendered side by side, after FTL-95 Figures D.2a to D.2d.

    Args:
        postures: joints (joints,) m and rad by caption, in order.
    """
    diagram, plant, scene_graph, model = _make_posed(scenario, setup, rendered=True)
    context = diagram.CreateDefaultContext()
    scene_context = scene_graph.GetMyContextFromRoot(context)
    rows = (len(postures) + 1) // 2
    X_WC = None
    with figure_style():
        figure = new_figure(3.3 * rows, title=f"Stages of {setup.motion.name}")
        layout = figure.add_gridspec(rows, 2)
        for number, (caption, joints) in enumerate(postures.items()):
            plant.SetPositions(plant.GetMyContextFromRoot(context), model, np.asarray(joints))
            query = scene_graph.get_query_output_port().Eval(scene_context)
            # One view for all, so that they can be compared.
            X_WC = X_WC or fit_view(corner_points(query), view_direction(scenario), size=SIZE)
            axes = figure.add_subplot(layout[number // 2, number % 2])
            axes.imshow(render_view(query, X_WC, size=SIZE))
            axes.set_axis_off()
            axes.set_title(caption, loc="left")
        save_figure(figure, file)


def scene_figure(file: Path, scenario: SerpentineScenario, setup: SerpentineSetup) -> None:
    """The scene with the tip's path drawn over it, after FTL-95 Figure D.1; the arm is at home.

    The path is drawn through whatever stands before it.
    """
    diagram, _, scene_graph, _ = _make_posed(scenario, setup, rendered=True)
    context = diagram.CreateDefaultContext()
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    motion, X_W0 = setup.motion, arm_pose(scenario, setup)
    points, marks = ((X_W0 @ line.T).T for line in (motion.line, motion.marks))
    X_WC = fit_view(np.vstack([corner_points(query), points]), view_direction(scenario), size=SIZE)
    camera = PinholeCamera(width=SIZE[0], height=SIZE[1], field_of_view=FIELD_OF_VIEW)
    with figure_style():
        figure = new_figure(6.4, title=f"Scene and {motion.title}")
        axes = figure.add_subplot()
        axes.imshow(render_view(query, X_WC, size=SIZE))
        axes.set_axis_off()
        line, _ = camera.project((X_WC.inverse() @ points.T).T)
        dots, _ = camera.project((X_WC.inverse() @ marks.T).T)
        axes.plot(*line.T, color=COLORS[1], linewidth=2.0, label="path of the tip")
        axes.plot(*dots.T, "o", color="black", markersize=4.0, markerfacecolor="white",
                  label=motion.mark_label)  # fmt: skip
        axes.legend(loc="lower left", frameon=True)
        save_figure(figure, file)


def moment_figure(
    file: Path,
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    *,
    joints: ArrayLike,
    witness: Array,
    title: str,
) -> None:
    """A close look at the nearest points of arm and scene.

    Args:
        joints: the posture, (joints,) m and rad.
        witness: nearest points on arm and scene, (2, 3) m in the world.
        title: says what it is.
    """
    diagram, plant, scene_graph, model = _make_posed(scenario, setup, rendered=True)
    context = diagram.CreateDefaultContext()
    plant.SetPositions(plant.GetMyContextFromRoot(context), model, np.asarray(joints))
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    X_WC = _unhidden_view(query, witness, view_direction(scenario))
    camera = PinholeCamera(width=SIZE[0], height=SIZE[1], field_of_view=FIELD_OF_VIEW)
    ends, _ = camera.project((X_WC.inverse() @ witness.T).T)
    with figure_style():
        figure = new_figure(6.4, title=title)
        axes = figure.add_subplot()
        axes.imshow(render_view(query, X_WC, size=SIZE))
        axes.set_axis_off()
        axes.plot(*ends.T, "-o", color="#E6007E", markersize=5.0, linewidth=2.0)
        gap = float(np.linalg.norm(witness[0] - witness[1]))
        axes.annotate(
            f"{gap * 1e3:.0f} mm", tuple(ends.mean(axis=0)), xytext=(28, -28),
            textcoords="offset points", fontsize=12, weight="bold", color="#E6007E",
            bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 2.0},
            arrowprops={"arrowstyle": "-", "color": "#E6007E"},
        )  # fmt: skip
        axes.text(
            0.01, 0.01, "between the shapes that collide; the trusses lie inside their boxes",
            transform=axes.transAxes, fontsize=9, color="#333333",
        )  # fmt: skip
        save_figure(figure, file)


def _unhidden_view(query: QueryObject, witness: Array, wanted: Array) -> RigidTransform:
    """A camera near the witness points that sees their middle; as near `wanted` as it can be."""
    middle = witness.mean(axis=0)
    best, least_hidden = None, np.inf
    for turn in np.radians([0.0, 40.0, -40.0, 80.0, -80.0, 120.0, -120.0, 160.0]):
        for steep in (0.0, -0.8, -2.0):
            ahead = RotationMatrix.MakeZRotation(turn) @ (wanted + np.array([0.0, 0.0, steep]))
            X_WC = look_at(middle - MOMENT_DISTANCE * ahead / np.linalg.norm(ahead), middle)
            depth = render_depth(query, X_WC, size=(64, 40))[20, 32]
            hidden = max(0.0, MOMENT_DISTANCE - float(depth))
            # A little is always hidden: the middle lies in the gap behind an edge or beside one.
            if hidden < 0.08:
                return X_WC
            if hidden < least_hidden:
                best, least_hidden = X_WC, hidden
    assert best is not None  # there is always a least
    return best


def run_bookmarks(assessment: Assessment, decisions: Sequence[RunDecision] = ()) -> list[Bookmark]:
    """Moments of a run that one wants to see: tightest, first contact, at the path's end.

    Args:
        decisions: of the supervisor; the first `MOST_DECISIONS` are moments too.
    """
    data, found = assessment.data, []
    moments = {}
    if data.clearance.min() < 0.0:
        moments[int(np.argmax(data.clearance < 0.0))] = "first contact"
    moments[assessment.nearest] = "least clearance"
    for sample, words in sorted(moments.items()):
        if data.witness is None or data.pairs[sample] is None:
            continue
        line = LineInSpace(name="nearest", points=data.witness[sample], color=NEAREST_COLOR)
        label = f"{words} {data.clearance[sample] * 1e3:.0f} mm"
        found.append(Bookmark(label=label, time=float(data.time[sample]), line=line))
    arrived = run_phases(data, assessment.motion).get("dwell")
    if arrived is not None:
        found.append(Bookmark(label="end of path", time=arrived))
    for decision in decisions[:MOST_DECISIONS]:
        found.append(Bookmark(label=decision.label, time=decision.time))
    return found


def run_phases(data: RunData, motion: PlannedMotion) -> dict[str, float]:
    """When a run's phases begin, s: extend, and dwell and retract if it came to them."""
    phases = {"extend": float(data.time[0])}
    at_end = np.flatnonzero(data.tip_arc_lengths >= motion.end - 1e-9)
    if at_end.size > 0:
        phases["dwell"] = float(data.time[at_end[0]])
        if at_end[-1] + 1 < data.time.size:
            phases["retract"] = float(data.time[at_end[-1]])
    return phases


def write_run_replay(
    file: Path,
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    *,
    title: str,
    time: ArrayLike,
    joints: ArrayLike,
    legs: ArrayLike | None = None,
    bookmarks: Sequence[Bookmark] = (),
    phases: Mapping[str, float] | None = None,
    note: str = "",
    seen: ColoredPatches | None = None,
    panel: ReplayPanel | None = None,
) -> None:
    """Writes recorded joints (N, joints) m and rad at times (N,) s as a 3-D page with the path.

    Args:
        legs: recorded positions of the legs, (N, 3 A), in the fidelity `truss`: they then move as
            they did; otherwise actuators are drawn from pin to pin.
        bookmarks, phases: see `run_bookmarks` and `run_phases`.
        note: below the title.
        seen: coloured patches of what the camera has seen.
        panel: a flat view below.
    """
    diagram, plant, scene_graph, model = _make_posed(
        scenario, setup, rendered=False, fidelity="joint" if legs is None else "truss"
    )
    more = {} if legs is None else {plant.GetModelInstanceByName(legs_name(setup.arm)): legs}
    context = diagram.CreateDefaultContext()
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    corners = corner_points(query)
    X_WC = fit_view(corners, view_direction(scenario), size=SIZE)
    # A point ahead of the eye, as far as the middle of what is seen: the page turns about it.
    eye, ahead = X_WC.translation(), X_WC.rotation().col(2)
    target = eye + ahead * float((corners.mean(axis=0) - eye) @ ahead)
    X_W0: RigidTransform = arm_pose(scenario, setup)
    write_replay(
        file,
        diagram=diagram,
        plant=plant,
        model=model,
        time=time,
        positions=joints,
        more_positions=more,
        eye=eye,
        target=target,
        title=title,
        note=note,
        seen=seen,
        lines=[LineInSpace(name="tip path", points=(X_W0 @ setup.motion.line.T).T)],
        bookmarks=bookmarks,
        phases=phases,
        panel=panel,
    )


def _make_posed(
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    *,
    rendered: bool,
    fidelity: str = "joint",
) -> tuple[Diagram, MultibodyPlant, SceneGraph, ModelInstanceIndex]:
    """A plant that is posed and looked at, not simulated."""
    builder = DiagramBuilder()
    plant, scene_graph, model = make_plant(builder, setup, scenario, fidelity=fidelity)
    if rendered:
        add_renderer(scene_graph)
    return builder.Build(), plant, scene_graph, model


def view_direction(scenario: SerpentineScenario) -> Array:
    """Where the scenario's camera looks, in the world, (3,)."""
    X_W0: RigidTransform = mounting_pose(scenario)
    direction: Array = X_W0.rotation() @ np.array(scenario.view.direction)
    return direction
