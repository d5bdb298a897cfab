"""Puts models and scenes into a plant."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pips_drake.errors import InputError
from pips_drake.scene.packages import add_package

if TYPE_CHECKING:
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import ModelInstanceIndex


def AddPlacedFrame(plant: MultibodyPlant, name: str, X_WF: RigidTransform) -> None:
    """Names a place in the world, for models and scenes to be welded to."""
    from pydrake.multibody.tree import FixedOffsetFrame

    plant.AddFrame(FixedOffsetFrame(name, plant.world_frame(), X_WF))


def AddScene(plant: MultibodyPlant, file: Path) -> list[ModelInstanceIndex]:
    """Adds the models of a scene file (`*.dmd.yaml`, or one SDF welded where it says).

    Call `check_anchored` with the result once the plant is finalized.

    Raises:
        InputError: the file does not parse, or has unknown tags (parsing is strict).
    """
    before = set(_model_instances(plant))
    _add_models(plant, file)
    return [model for model in _model_instances(plant) if model not in before]


def check_anchored(plant: MultibodyPlant, scene: list[ModelInstanceIndex], file: Path) -> None:
    """Refuses a scene with a body that could fall, or with nothing that could be touched.

    Raises:
        InputError: names the body.
    """
    bodies = [plant.get_body(index) for model in scene for index in plant.GetBodyIndices(model)]
    if not any(plant.GetCollisionGeometriesForBody(body) for body in bodies):
        raise InputError(
            f"{file}: no body has collision geometry; one must have some, or everything would "
            "always look clear"
        )
    for model in scene:
        for index in plant.GetBodyIndices(model):
            body = plant.get_body(index)
            if not plant.IsAnchored(body):
                raise InputError(
                    f"{file}: body '{body.scoped_name()}' is loose; must be welded to frame_0 or "
                    "to the world, because the scene does not move"
                )


def _model_instances(plant: MultibodyPlant) -> list[ModelInstanceIndex]:
    from pydrake.multibody.tree import ModelInstanceIndex

    return [ModelInstanceIndex(i) for i in range(plant.num_model_instances())]


def _add_models(plant: MultibodyPlant, file: Path) -> list[ModelInstanceIndex]:
    from pydrake.multibody.parsing import Parser

    parser = Parser(plant)
    parser.SetStrictParsing()
    add_package(parser)
    try:
        return list(parser.AddModels(str(file)))
    except RuntimeError as error:
        raise InputError(f"{file}: {' '.join(str(error).split())}") from None
