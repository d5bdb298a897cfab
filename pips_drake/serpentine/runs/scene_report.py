"""What a run's scene is: where it stands, what of it collides, and what to be warned of."""

from __future__ import annotations

import copy
import dataclasses
from pathlib import Path
from typing import Any

from pydrake.systems.framework import DiagramBuilder

from pips_drake.config import dump_yaml
from pips_drake.scene.loading import describe_placement
from pips_drake.scene.packages import list_names
from pips_drake.scene.shapes import describe_shapes, scene_frames
from pips_drake.serpentine.joint_motion_file import write_joint_motion
from pips_drake.serpentine.planned_motion import GivenJoints
from pips_drake.serpentine.runs.pictures import view_direction
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import BASE_FRAME, SerpentineSetup, make_plant
from pips_drake.twin.rendering import render_available
from pips_drake.twin.shapes_figure import shapes_figure

#: Longer motions are written as archives instead of tables.
_MOST_TABLE_ROWS = 5000


def report_scene(
    scenario: SerpentineScenario, setup: SerpentineSetup, *, figures: Path | None = None
) -> dict[str, Any]:
    """What a summary says of the scene: `scene_warnings`, `scene_shapes`, `scene_placement`.

    Args:
        figures: a folder for `collision_shapes.png`, if pictures can be rendered.

    Raises:
        InputError: a mesh of the scene has no volume, or cannot be read.
    """
    if setup.scene_file is None:
        return {}
    builder = DiagramBuilder()
    plant, scene_graph, model = make_plant(builder, setup, scenario)
    diagram = builder.Build()
    frames = scene_frames(plant, model)
    shapes = describe_shapes(scene_graph.model_inspector(), frames)
    if figures is not None and render_available() is None:
        root = diagram.CreateDefaultContext()  # held: queries look into it
        context = scene_graph.GetMyContextFromRoot(root)
        shapes_figure(
            figures / "collision_shapes.png",
            scene_graph.get_query_output_port().Eval(context),
            frames,
            direction=view_direction(scenario),
            title=f"What collides in {scenario.scene}",
        )
    robot = plant.GetModelInstanceName(model)
    placement = describe_placement(plant, BASE_FRAME)
    return {
        "scene_warnings": shapes.warnings(),
        "scene_shapes": shapes.as_data(),
        "scene_placement": [line for line in placement if not line.startswith(f"{robot}::")],
    }


def without_lost_target(
    scenario: SerpentineScenario, setup: SerpentineSetup
) -> tuple[SerpentineScenario, list[str]]:
    """A scenario put into another scene: without its camera, if what that looks at is not there.

    Returns:
        The scenario, and a line that says so, or none.
    """
    target = scenario.camera.target_body
    if not scenario.camera.enabled or not target:
        return scenario, []
    plant, _, model = make_plant(DiagramBuilder(), setup, scenario)
    names = sorted(scene_frames(plant, model).values())
    if target in names:
        return scenario, []
    changed: SerpentineScenario = copy.deepcopy(scenario)
    changed.camera.enabled, changed.camera.target_body = False, ""
    known = ", ".join(name for name in names if name != "world") or "none"
    return changed, [
        f"no camera: its target '{target}' is not in this scene; --set camera.enabled=true "
        f"camera.target_body=BODY looks at another one (known: {known})"
    ]


def with_joint_motion_file(
    scenario: SerpentineScenario, setup: SerpentineSetup, folder: Path
) -> SerpentineScenario:
    """The scenario as it can be run again from a folder: joints that are given are written there.

    A scenario whose motion follows a path is returned as it is.
    """
    if not isinstance(setup.motion, GivenJoints):
        return scenario
    motion = setup.motion.motion
    suffix = ".csv" if len(motion.times) <= _MOST_TABLE_ROWS else ".npz"
    file = folder / f"joint_motion{suffix}"
    write_joint_motion(file, setup.arm, motion)
    return dataclasses.replace(scenario, path="", joints=file.name, rail_shift_m=setup.rail_shift)


def scenario_text(scenario: SerpentineScenario) -> str:
    """The scenario as written beside its result; says how to repeat it in one's own scene."""
    text = dump_yaml(scenario)
    if not scenario.scene or scenario.scene in list_names("scene"):
        return text
    return (
        "# To repeat: pips simulate THIS_FILE --scene FILE, where FILE is\n"
        f"# {scenario.scene} as it was in the folder where the command was given.\n{text}"
    )
