"""What collides, beside what is seen: said where the two differ, and only there."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from pips_drake.errors import InputError
from pips_drake.scene.decomposition import AddConvexParts
from pips_drake.scene.loading import AddMissingNormals, AddScene
from pips_drake.scene.shapes import HULL_TOLERANCE, describe_shapes, scene_frames

# Not imported: CoACD's library and Drake's do not go well together in one process.
needs_coacd = pytest.mark.skipif(
    importlib.util.find_spec("coacd") is None, reason="the extra `meshes` is not installed"
)
BOX = "<geometry><box><size>{} {} {}</size></box></geometry>"
NO_ROBOT = ModelInstanceIndex(10**6)


class Scene:
    """A scene file in a plant of its own."""

    def __init__(self, file, *, decompose=False):
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        models = AddScene(self.plant, file)
        AddMissingNormals(self.plant, self.scene_graph, models)
        if decompose:
            AddConvexParts(self.plant, self.scene_graph, models)
        self.plant.Finalize()
        self.diagram = builder.Build()
        self.root = self.diagram.CreateDefaultContext()
        self.frames = scene_frames(self.plant, NO_ROBOT)

    @property
    def shapes(self):
        return describe_shapes(self.scene_graph.model_inspector(), self.frames)

    def distance_to_ball(self, place, radius=1e-3):
        """Of a ball at a place in the world from all that collides, m."""
        port = self.scene_graph.get_query_output_port()
        query = port.Eval(self.scene_graph.GetMyContextFromRoot(self.root))
        pairs = query.ComputeSignedDistanceToPoint(np.asarray(place))
        return min(pair.distance for pair in pairs) - radius


def test_a_mesh_collides_as_its_hull_and_the_difference_is_closed_form(bracket, tmp_path):
    (shape,) = Scene(bracket.write(tmp_path)).shapes.shapes
    assert (shape.body, shape.kind, shape.fit.file) == ("bracket::body", "Mesh", "bracket.obj")
    assert shape.size == pytest.approx((bracket.leg_x, bracket.leg_y, bracket.height))
    assert shape.fit.larger == pytest.approx(bracket.hull_excess, abs=0.5e-3)
    assert shape.fit.volume_ratio == pytest.approx(bracket.hull_volume / bracket.volume)
    assert shape.fit.missing == 0.0


def test_the_warning_says_it_in_one_line(bracket, tmp_path):
    assert Scene(bracket.write(tmp_path)).shapes.warnings() == [
        "bracket::body mesh bracket.obj collides as its convex hull, up to 120 mm larger and 1.5 "
        "times its volume: distances to it are too small in its hollows; `--decompose` splits it"
    ]


def test_a_scaled_mesh_is_compared_at_its_size(bracket, tmp_path):
    scaled = bracket.mesh.replace("</uri>", "</uri><scale>2 2 3</scale>")
    scene = Scene(bracket.write(tmp_path, seen=scaled, collides=scaled))
    assert scene.shapes.shapes[0].fit.larger == pytest.approx(2 * bracket.hull_excess, abs=0.5e-3)


def test_primitives_that_are_seen_as_they_collide_are_not_warned_of(bracket, tmp_path):
    for geometry, size in (
        (BOX.format(1, 2, 3), (1, 2, 3)),
        ("<geometry><sphere><radius>0.5</radius></sphere></geometry>", (0.5,)),
        ("<geometry><cylinder><radius>2</radius><length>3</length></cylinder></geometry>", (2, 3)),
        ("<geometry><capsule><radius>0.2</radius><length>3</length></capsule></geometry>",
         (0.2, 3)),
        ("<geometry><ellipsoid><radii>1 2 3</radii></ellipsoid></geometry>", (1, 2, 3)),
    ):  # fmt: skip
        shapes = Scene(bracket.write(tmp_path, seen=geometry, collides=geometry)).shapes
        assert shapes.warnings() == []
        assert shapes.shapes[0].size == size


def test_a_convex_mesh_is_not_warned_of(bracket, tmp_path):
    file = bracket.write(tmp_path)
    (tmp_path / "bracket.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    )
    assert Scene(file).shapes.warnings() == []


def test_seen_but_not_colliding_and_the_other_way_round(bracket, tmp_path):
    seen = Scene(bracket.write(tmp_path, collides="")).shapes
    assert seen.warnings() == [
        "bracket::body is seen but does not collide: the arm passes through it"
    ]
    felt = Scene(bracket.write(tmp_path, seen="", collides=BOX.format(1, 1, 1))).shapes
    assert felt.warnings() == ["bracket::body collides but is not seen"]


def test_what_is_seen_outside_of_what_collides_is_told_with_how_far(bracket, tmp_path):
    shapes = Scene(
        bracket.write(tmp_path, seen=BOX.format(1, 1, 1.2), collides=BOX.format(1, 1, 1))
    ).shapes
    assert shapes.seen_outside["bracket::body"] == pytest.approx(0.1)
    assert shapes.warnings() == [
        "bracket::body is seen up to 100 mm outside what collides: distances to it are too large "
        "there"
    ]
    # What collides may be larger than what is seen: that is on the safe side.
    larger = bracket.write(tmp_path, seen=BOX.format(1, 1, 1), collides=BOX.format(2, 2, 2))
    assert Scene(larger).shapes.warnings() == []


def test_a_mesh_without_volume_is_refused(bracket, tmp_path):
    file = bracket.write(tmp_path)
    (tmp_path / "bracket.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n")
    with pytest.raises(InputError, match=r"bracket::body: mesh bracket.obj is flat; a mesh that"):
        _ = Scene(file).shapes


def test_a_mesh_that_is_not_closed_has_no_volume_ratio(bracket, tmp_path):
    file = bracket.write(tmp_path)
    text = (tmp_path / "bracket.obj").read_text().splitlines()
    (tmp_path / "bracket.obj").write_text("\n".join(text[:-1]))
    (shape,) = Scene(file).shapes.shapes
    assert shape.fit.volume_ratio is None
    assert shape.fit.larger == pytest.approx(bracket.hull_excess, abs=0.5e-3)


@needs_coacd
def test_decomposition_leaves_the_hollow_free(bracket, tmp_path):
    file = bracket.write(tmp_path)
    hull, parts = Scene(file), Scene(file, decompose=True)
    (shape,) = parts.shapes.shapes
    assert shape.fit.parts >= 2
    assert max(shape.fit.larger, shape.fit.missing) < HULL_TOLERANCE
    assert shape.fit.volume_ratio == pytest.approx(1.0, abs=1e-3)
    assert parts.shapes.warnings() == []
    # In the hollow, level with the middle: the nearer leg is 0.05 m away. The hull is around it.
    place = [bracket.thick + 0.1, bracket.thick + 0.05, 0.5 * bracket.height]
    assert parts.distance_to_ball(place) == pytest.approx(0.05 - 1e-3, abs=HULL_TOLERANCE)
    inspector = hull.scene_graph.model_inspector()
    assert len(inspector.GetAllGeometryIds(Role.kProximity)) == 1


@needs_coacd
def test_decomposition_is_the_same_every_time(bracket, tmp_path):
    from pips_drake.scene import decomposition
    from pips_drake.scene.meshes import TriangleMesh

    mesh = TriangleMesh(*bracket.triangles())
    first = decomposition.decompose(mesh)
    decomposition._decompose.cache_clear()
    for one, other in zip(first, decomposition.decompose(mesh), strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)


def test_without_the_library_the_extra_is_named(bracket, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "coacd", None)
    with pytest.raises(InputError, match=r"CoACD is missing; install it with the extra `meshes`"):
        Scene(bracket.write(tmp_path), decompose=True)


@needs_coacd
def test_a_mesh_that_says_it_is_convex_is_not_split(bracket, tmp_path):
    declared = bracket.mesh.replace("<uri>", "<drake:declare_convex/><uri>")
    file = bracket.write(tmp_path, collides=declared)
    file.write_text(file.read_text().replace("<sdf ", "<sdf xmlns:drake='http://drake.mit.edu' "))
    (warning,) = Scene(file, decompose=True).shapes.warnings()
    assert "120 mm larger" in warning and warning.endswith("its model declares it convex")


def test_frames_are_those_of_all_bodies_but_the_robots(bracket, tmp_path):
    scene = Scene(bracket.write(tmp_path))
    assert sorted(scene.frames.values()) == ["bracket::body", "world"]
    robot = scene.plant.GetModelInstanceByName("bracket")
    assert list(scene_frames(scene.plant, robot).values()) == ["world"]
