"""Puts models and scenes into a plant."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pips_drake.errors import InputError
from pips_drake.scene.packages import add_package, add_package_beside

if TYPE_CHECKING:
    from pydrake.geometry import SceneGraph
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import ModelInstanceIndex, RigidBody

#: Kinds of scene files; the first says itself where its models stand.
DIRECTIVES = ".dmd.yaml"
SUFFIXES = (DIRECTIVES, ".sdf", ".urdf", ".xml", ".obj")


def AddPlacedFrame(plant: MultibodyPlant, name: str, X_WF: RigidTransform) -> None:
    """Names a place in the world, for models and scenes to be welded to."""
    from pydrake.multibody.tree import FixedOffsetFrame

    plant.AddFrame(FixedOffsetFrame(name, plant.world_frame(), X_WF))


def AddScene(
    plant: MultibodyPlant, file: Path, *, base_frame: str | None = None
) -> list[ModelInstanceIndex]:
    """Adds the models of a scene file.

    A `*.dmd.yaml` says itself where its models are welded; if a `package.xml` stands beside it, it
    can name files of its folder as `package://NAME/...` with the name there. In any other file,
    what is not fixed to the world is welded to `base_frame`, at the pose that the file gives it.

    Call `check_anchored` with the result once the plant is finalized.

    Args:
        base_frame: name of the frame to weld to; the world by default.

    Raises:
        InputError: the file is of no known kind, does not parse, or has unknown tags (parsing is
            strict).
    """
    if not file.name.endswith(SUFFIXES):
        raise InputError(f"{file}: not a scene; must be one of *{', *'.join(SUFFIXES)}")
    before = set(_model_instances(plant))
    _add_models(plant, file)
    models = [model for model in _model_instances(plant) if model not in before]
    if not file.name.endswith(DIRECTIVES):
        frame = plant.GetFrameByName(base_frame) if base_frame else plant.world_frame()
        for body in _root_bodies(plant, models):
            pose = plant.GetDefaultFloatingBaseBodyPose(body)
            plant.WeldFrames(frame, body.body_frame(), pose)
    return models


def AddMissingNormals(
    plant: MultibodyPlant, scene_graph: SceneGraph, models: list[ModelInstanceIndex]
) -> None:
    """Gives seen meshes (*.obj) that have no normals flat ones; call it before Finalize.

    Drake's renderer refuses meshes without. Their materials, if any, are lost.
    """
    from pydrake.common import MemoryFile
    from pydrake.geometry import (
        GeometryInstance,
        IllustrationProperties,
        InMemoryMesh,
        Mesh,
        PerceptionProperties,
        Role,
    )

    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    for body in (plant.get_body(b) for model in models for b in plant.GetBodyIndices(model)):
        for geometry in plant.GetVisualGeometriesForBody(body):
            shape = inspector.GetShape(geometry)
            if not isinstance(shape, Mesh) or shape.extension() != ".obj":
                continue
            text = Path(shape.source().path()).read_text(encoding="utf-8", errors="replace")
            try:
                drawn = obj_with_normals(text)
            except (IndexError, ValueError) as error:
                raise InputError(f"{shape.source().path()}: not a mesh ({error})") from None
            if drawn == text:
                continue
            name, X_BG = inspector.GetName(geometry), inspector.GetPoseInFrame(geometry)
            mesh = InMemoryMesh(mesh_file=MemoryFile(drawn, ".obj", name))
            instance = GeometryInstance(
                X_BG, Mesh(mesh, shape.scale3()), f"{name.split('::')[-1]}_with_normals"
            )
            illustration = inspector.GetIllustrationProperties(geometry)
            if illustration is not None:
                instance.set_illustration_properties(IllustrationProperties(illustration))
                scene_graph.RemoveRole(source, geometry, Role.kIllustration)
            perception = inspector.GetPerceptionProperties(geometry)
            if perception is not None:
                instance.set_perception_properties(PerceptionProperties(perception))
                scene_graph.RemoveRole(source, geometry, Role.kPerception)
            plant.RegisterVisualGeometry(body, instance)


def obj_with_normals(text: str) -> str:
    """The text of an .obj file with a flat normal for every face that has none."""
    vertices: list[list[float]] = []
    lines, normals, changed = [], 0, False
    for line in text.splitlines():
        words = line.split()
        kind = words[0] if words else ""
        if kind == "v":
            vertices.append([float(word) for word in words[1:4]])
        normals += kind == "vn"
        corners = [word.split("/") for word in words[1:]]
        if kind == "f" and all(len(corner) < 3 for corner in corners):
            changed = True
            # Counted from 1, or backwards from the last one so far.
            rows = [int(corner[0]) for corner in corners]
            p = np.array([vertices[row - 1 if row > 0 else row] for row in rows])
            normal = np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0)  # Newell's
            normal /= max(float(np.linalg.norm(normal)), 1e-300)
            normals += 1
            lines.append("vn " + " ".join(f"{x:.9g}" for x in normal))
            line = "f " + " ".join(
                "/".join([*(*corner, "")[:2], str(normals)]) for corner in corners
            )
        if kind not in ("mtllib", "usemtl"):
            lines.append(line)
    return "\n".join(lines) + "\n" if changed else text


def describe_placement(plant: MultibodyPlant, base_frame: str) -> list[str]:
    """Where the bodies stand that are fixed to the world, one line each.

    Args:
        base_frame: name of the frame, fixed in the world, in which positions are given.
    """
    from pydrake.multibody.tree import JointIndex

    X_WF, context = plant.GetFrameByName(base_frame).GetFixedPoseInBodyFrame(), None
    lines = []
    for joint in (plant.get_joint(JointIndex(i)) for i in plant.GetJointIndices()):
        if joint.parent_body().index() != plant.world_body().index() or joint.num_velocities():
            continue
        context = context or plant.CreateDefaultContext()
        X_FB = X_WF.inverse() @ joint.child_body().EvalPoseInWorld(context)
        place = ", ".join(f"{x + 0.0:.4g}" for x in np.round(X_FB.translation(), 6))
        to = joint.frame_on_parent().name()
        fixed = f"welded to {base_frame}" if to == base_frame else "fixed to the world"
        name = joint.child_body().scoped_name()
        lines.append(f"{name} is {fixed} and stands at ({place}) m in {base_frame}")
    return lines


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


def _root_bodies(plant: MultibodyPlant, models: list[ModelInstanceIndex]) -> list[RigidBody]:
    """The models' bodies that hang on no other, and are not fixed to the world either."""
    from pydrake.multibody.tree import JointIndex

    joints = [plant.get_joint(JointIndex(i)) for i in plant.GetJointIndices()]
    held = {joint.child_body().index() for joint in joints}
    held |= {body.index() for body in plant.GetBodiesWeldedTo(plant.world_body())}
    bodies = [plant.get_body(index) for model in models for index in plant.GetBodyIndices(model)]
    return [body for body in bodies if body.index() not in held]


def _add_models(plant: MultibodyPlant, file: Path) -> list[ModelInstanceIndex]:
    from pydrake.multibody.parsing import Parser

    parser = Parser(plant)
    parser.SetStrictParsing()
    add_package(parser)
    try:
        if file.name.endswith(DIRECTIVES):
            add_package_beside(parser, file)
        return list(parser.AddModels(str(file)))
    # drake 1.51 exits where a mesh has faces of vertices that it lacks.
    except (RuntimeError, SystemExit) as error:
        relative = re.search(r"URI '([^']*)' is invalid when parsing a string", str(error))
        if relative:
            raise InputError(
                f"{file}: file: {relative[1]}; directives know no relative names: must be "
                "file:///..., or package://pips_drake/... for what is shipped"
            ) from None
        raise InputError(f"{file}: {' '.join(str(error).split())}") from None
