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


def AddPlacedModel(
    plant: MultibodyPlant, file: Path, *, root: str, X_WR: RigidTransform, frame: str
) -> ModelInstanceIndex:
    """Adds a model, welds its `root` link to the world at `X_WR`, and names that place `frame`.

    Scenes weld their models to the named frame, so that they stay with the arm in every mounting.

    Raises:
        InputError: the file does not parse, or has unknown tags (parsing is strict).
    """
    from pydrake.multibody.tree import FixedOffsetFrame

    (model,) = _add_models(plant, file)
    place = plant.AddFrame(FixedOffsetFrame(frame, plant.world_frame(), X_WR))
    plant.WeldFrames(place, plant.GetFrameByName(root, model))
    return model


def AddScene(plant: MultibodyPlant, file: Path) -> list[ModelInstanceIndex]:
    """Adds the models of a scene file (`*.dmd.yaml`, or one SDF welded where it says).

    Raises:
        InputError: the file does not parse, or a model in it is not fixed to the world.
    """
    before = set(_model_instances(plant))
    _add_models(plant, file)
    added = [model for model in _model_instances(plant) if model not in before]
    for model in added:
        for index in plant.GetBodyIndices(model):
            body = plant.get_body(index)
            if not plant.IsAnchored(body):
                raise InputError(
                    f"{file}: body '{body.name()}' of model "
                    f"'{plant.GetModelInstanceName(model)}' is loose; must be welded to frame_0 or "
                    "the world, because the scene does not move"
                )
    return added


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
