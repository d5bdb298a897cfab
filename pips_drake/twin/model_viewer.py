"""Shows a model in the browser: Drake's model visualizer, on localhost."""

from __future__ import annotations

from pips_drake.errors import InputError
from pips_drake.scene.loading import DIRECTIVES, AddPlacedFrame
from pips_drake.scene.packages import (
    add_package,
    add_package_beside,
    find_model_file,
    find_scene_file,
    list_names,
)


def view_model(name: str, *, once: bool = False) -> None:
    """Shows a model or a scene, with a slider a joint, until stopped.

    Args:
        name: a shipped model's or scene's name, or a file's path. A scene's `frame_0` is the world.
        once: load and publish it once, then return.

    Raises:
        InputError: unknown name, or the file does not parse.
    """
    from pydrake.math import RigidTransform
    from pydrake.visualization import ModelVisualizer

    from pips_drake.twin.replay import make_meshcat

    is_scene = name in list_names("scene") or name.endswith(DIRECTIVES)
    file = find_scene_file(name) if is_scene else find_model_file(name)
    visualizer = ModelVisualizer(meshcat=make_meshcat(), visualize_frames=False)
    add_package(visualizer.parser())
    if is_scene:
        AddPlacedFrame(visualizer.parser().plant(), "frame_0", RigidTransform())
    try:
        if is_scene:
            add_package_beside(visualizer.parser(), file)
        visualizer.parser().AddModels(str(file))
        visualizer.Finalize()
    except RuntimeError as error:
        raise InputError(f"{file}: {' '.join(str(error).split())}") from None
    visualizer.Run(loop_once=once)
