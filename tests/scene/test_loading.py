"""Scene files of any kind stand where they say, or where the arm's base frame is."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from pips_drake.errors import InputError
from pips_drake.scene.loading import (
    AddMissingNormals,
    AddPlacedFrame,
    AddScene,
    check_anchored,
    describe_placement,
    obj_with_normals,
)

X_W0 = RigidTransform(RollPitchYaw(0.0, 0.5, 0.0), [1.0, 2.0, 3.0])
URDF = (
    "<robot name='bracket'><link name='body'><collision><geometry><box size='1 1 1'/></geometry>"
    "</collision></link></robot>"
)


def load(file):
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    AddPlacedFrame(plant, "frame_0", X_W0)
    models = AddScene(plant, file, base_frame="frame_0")
    AddMissingNormals(plant, scene_graph, models)
    plant.Finalize()
    check_anchored(plant, models, file)
    builder.Build()
    return plant


def pose(plant, body="body"):
    return plant.GetBodyByName(body).EvalPoseInWorld(plant.CreateDefaultContext())


def test_a_free_model_is_welded_to_the_base_frame_at_its_own_pose(bracket, tmp_path):
    plant = load(bracket.write(tmp_path, pose="0.1 0.2 0.3 0 0 1.5"))
    wanted = X_W0 @ RigidTransform(RollPitchYaw(0, 0, 1.5), [0.1, 0.2, 0.3])
    assert pose(plant).IsNearlyEqualTo(wanted, 1e-12)
    assert describe_placement(plant, "frame_0") == [
        "bracket::body is welded to frame_0 and stands at (0.1, 0.2, 0.3) m in frame_0"
    ]


def test_a_fixed_model_stays_in_the_world(bracket, tmp_path):
    plant = load(bracket.write(tmp_path, pose="1 2 4 0 0 0", fixed=True))
    assert pose(plant).IsNearlyEqualTo(RigidTransform([1.0, 2.0, 4.0]), 1e-12)
    x, z = -np.sin(0.5), np.cos(0.5)
    assert describe_placement(plant, "frame_0") == [
        f"bracket::body is fixed to the world and stands at ({x:.4g}, 0, {z:.4g}) m in frame_0"
    ]


def test_a_urdf_is_welded_at_the_base_frame(tmp_path):
    (tmp_path / "bracket.urdf").write_text(URDF)
    assert pose(load(tmp_path / "bracket.urdf")).IsNearlyEqualTo(X_W0, 1e-12)


def test_a_mesh_alone_is_a_scene(bracket, tmp_path):
    (tmp_path / "bracket.obj").write_text(bracket.obj())
    assert pose(load(tmp_path / "bracket.obj"), "bracket").IsNearlyEqualTo(X_W0, 1e-12)


def test_directives_say_themselves_where_things_stand(bracket, tmp_path):
    bracket.write(tmp_path)
    file = tmp_path / "s.dmd.yaml"
    (tmp_path / "package.xml").write_text("<package><name>mine</name></package>")
    text = f"directives:\n- add_model: {{name: b, file: 'file://{tmp_path}/bracket.sdf'}}\n"
    file.write_text(text)
    with pytest.raises(InputError, match=r"body 'b::body' is loose; must be welded"):
        load(file)
    file.write_text(text + "- add_weld: {parent: frame_0, child: 'b::body'}\n")
    assert pose(load(file)).IsNearlyEqualTo(X_W0, 1e-12)


def test_directives_with_relative_names_are_told_what_is_allowed(bracket, tmp_path):
    bracket.write(tmp_path)
    file = tmp_path / "s.dmd.yaml"
    file.write_text("directives:\n- add_model: {name: b, file: bracket.sdf}\n")
    with pytest.raises(InputError, match=r"file: bracket\.sdf; .* must be file:///\.\.\., or pack"):
        load(file)


def test_links_without_joints_are_each_welded(tmp_path):
    collision = "<collision name='c'><geometry><box><size>1 1 1</size></box></geometry></collision>"
    links = "".join(
        f"<link name='{n}'><pose>{x} 0 0 0 0 0</pose>{collision}</link>"
        for n, x in (("a", 1), ("b", 2))
    )
    file = tmp_path / "two.sdf"
    file.write_text(f"<sdf version='1.9'><model name='m'>{links}</model></sdf>")
    plant = load(file)
    assert pose(plant, "b").IsNearlyEqualTo(X_W0 @ RigidTransform([2.0, 0.0, 0.0]), 1e-12)


def test_another_kind_of_file_is_refused(tmp_path):
    (tmp_path / "bracket.stl").write_text("solid")
    with pytest.raises(
        InputError, match=r"bracket.stl: not a scene; must be one of \*\.dmd\.yaml,"
    ):
        load(tmp_path / "bracket.stl")


def test_faces_without_normals_get_flat_ones_and_others_keep_theirs():
    text = "v 0 0 0\nv 2 0 0\nv 0 3 0\nvn 1 0 0\nf 1//1 2//1 3//1\nf 1 2 3\nf -3/4 -1/5 -2/6\n"
    lines = obj_with_normals(text).splitlines()
    assert lines[4] == "f 1//1 2//1 3//1"
    assert lines[5:7] == ["vn 0 0 1", "f 1//2 2//2 3//2"]
    assert lines[7:9] == ["vn 0 0 -1", "f -3/4/3 -1/5/3 -2/6/3"]
    assert obj_with_normals("v 0 0 0\nvn 0 0 1\nf 1//1 1//1 1//1\n").count("vn") == 1
