"""Measures how well the three models of the actuators agree, and draws docs/images/fidelities.png.

    python docs/make_fidelities.py

Takes some minutes. tests/serpentine/test_fidelities.py asserts the same, and the arm's README
quotes it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder

from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import (
    MakeSerpentineStation,
    MakeSimulator,
    load_setup,
    make_plant,
    set_leg_positions,
)
from pips_drake.twin.figures import COLORS, figure_style, new_figure, save_figure
from pips_drake.twin.rendering import Picture, add_renderer, look_at, render_view

Array = NDArray[np.float64]

IMAGE = Path(__file__).resolve().parent / "images" / "fidelities.png"
#: Between two looks at a run, s.
PERIOD = 0.25
#: Bend of both hinges of the universal joint that is looked at, deg.
BENDS = (-28.0, 28.0)
#: Index of the first of those hinges.
HINGE = 3
SIZE = (1100, 800)


def make_scenario(fidelity: str, plant_hz: int = 512) -> SerpentineScenario:
    """Trajectory 4 without a scene."""
    scenario = SerpentineScenario(path="trajectory_4_arcs")
    scenario.actuation.fidelity, scenario.clocks.plant_hz = fidelity, plant_hz
    return scenario


def follow(fidelity: str, plant_hz: int = 512) -> tuple[Array, Array]:
    """Joints (N, J) of a run out and back, and largest gap of its loops (N,) m."""
    scenario = make_scenario(fidelity, plant_hz)
    station = MakeSerpentineStation(scenario)
    simulator = MakeSimulator(station, scenario)
    context = simulator.get_context()
    duration = station.GetSubsystemByName("tip_path_source").duration
    joints, gaps = [], []
    for k in range(1, int(duration / PERIOD)):
        simulator.AdvanceTo(k * PERIOD)
        state = station.GetOutputPort("plant.state").Eval(context)
        joints.append(state[: state.size // 2])
        if fidelity == "truss":
            gaps.append(station.GetOutputPort("loop_gap_meter.gap").Eval(context).max())
    return np.array(joints), np.array(gaps)


def close_up(bend: float) -> tuple[Picture, Array]:
    """Picture of the legs across a universal joint, and their two lengths, m."""
    scenario = make_scenario("truss")
    setup = load_setup(scenario)
    builder = DiagramBuilder()
    plant, scene_graph, model = make_plant(builder, setup, scenario, fidelity="truss")
    add_renderer(scene_graph, headlight=0.6)
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    context = plant.GetMyMutableContextFromRoot(root)
    joints = setup.arm.joint_home.copy()
    joints[HINGE : HINGE + 2] = np.radians(bend)
    plant.SetPositions(context, model, joints)
    set_leg_positions(plant, context, setup.arm, joints)
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(root))
    body = plant.GetBodyByName(setup.arm.bodies[HINGE].name, model)
    X_WB = plant.EvalBodyPoseInWorld(context, body)
    # From the side of the legs, which is that of -y and +z of the segment before the joint.
    before = plant.GetBodyByName(setup.arm.bodies[HINGE - 1].name, model)
    R_WP = plant.EvalBodyPoseInWorld(context, before).rotation()
    eye = X_WB.translation() + R_WP @ np.array([0.2, -0.85, 0.68])
    picture = render_view(query, look_at(eye, X_WB.translation(), up=R_WP.col(0)), size=SIZE)
    first = setup.arm.first_actuated_joint
    return picture, setup.arm.linkage.length(joints[first:])[HINGE - first : HINGE - first + 2]


def main() -> None:
    """Measures and draws."""
    joint, _ = follow("joint")
    legs, _ = follow("leg")
    truss, gaps = follow("truss")
    _, fine_gaps = follow("truss", 1024)
    time = PERIOD * np.arange(1, len(joint) + 1)
    with figure_style():
        figure = new_figure(7.4, title="Actuators as springs at joints, springs, and two-part legs")
        layout = figure.add_gridspec(2, 2, height_ratios=[1.25, 1.0])
        for column, bend in enumerate(BENDS):
            picture, lengths = close_up(bend)
            axes = figure.add_subplot(layout[0, column])
            axes.imshow(picture)
            axes.set_axis_off()
            named = zip((HINGE + 1, HINGE + 2), lengths, strict=True)
            text = ", ".join(f"L{j} = {1e3 * length:.0f} mm" for j, length in named)
            axes.set_title(f"truss, hinges at {bend:+.0f} deg: {text}", loc="left", fontsize=9)
        axes = figure.add_subplot(layout[1, 0])
        for name, other, color in (("leg", legs, COLORS[1]), ("truss", truss, COLORS[0])):
            apart = np.degrees(np.abs(other - joint)[:, 1:]).max(axis=1)
            axes.semilogy(time, np.maximum(apart, 1e-9), color=color, label=name)
            print(f"{name}: at most {apart.max():.2g} deg from joint")
        axes.axhline(0.1, color="black", linestyle=":", label="0.1 deg")
        axes.set(xlabel="time, s", ylabel="largest joint angle from `joint`, deg")
        axes.legend(loc="center right")
        axes = figure.add_subplot(layout[1, 1])
        for name, values, color in (
            ("step 1/512 s", gaps, COLORS[0]),
            ("step 1/1024 s", fine_gaps, COLORS[2]),
        ):
            axes.plot(time, 1e6 * values, color=color, label=name)
            print(f"{name}: gaps up to {1e6 * values.max():.3g} micrometres")
        axes.set(xlabel="time, s", ylabel="largest gap of the truss's loops, um", ylim=(0.0, None))
        axes.legend(loc="center right")
        save_figure(figure, IMAGE)
    print(IMAGE.name)


if __name__ == "__main__":
    main()
