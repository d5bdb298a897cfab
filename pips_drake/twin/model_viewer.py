"""Shows a model in the browser: Drake's model visualizer, on localhost."""

from __future__ import annotations

from pips_drake.errors import InputError
from pips_drake.scene.packages import add_package, find_model_file


def view_model(name: str, *, once: bool = False) -> None:
    """Shows a shipped model or a model file, with a slider a joint, until stopped.

    Args:
        name: a shipped model's name or a file's path.
        once: load and publish it once, then return.

    Raises:
        InputError: unknown name, or the file does not parse.
    """
    from pydrake.visualization import ModelVisualizer

    from pips_drake.twin.replay import make_meshcat

    file = find_model_file(name)
    visualizer = ModelVisualizer(meshcat=make_meshcat(), visualize_frames=False)
    add_package(visualizer.parser())
    try:
        visualizer.parser().AddModels(str(file))
        visualizer.Finalize()
    except RuntimeError as error:
        raise InputError(f"{file}: {' '.join(str(error).split())}") from None
    visualizer.Run(loop_once=once)
