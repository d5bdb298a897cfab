"""Patches cover a shape's surface once, and what has been seen of them is remembered."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydrake.common import MemoryFile
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    GeometryInstance,
    InMemoryMesh,
    ProximityProperties,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix

from pips_drake.errors import InputError
from pips_drake.twin.camera import PinholeCamera
from pips_drake.twin.patches import disc
from pips_drake.twin.rendering import look_at
from pips_drake.twin.seen_figure import color_patches, seen_surface_figure
from pips_drake.twin.surface import SeenSurface, body_surface

CUBE = """
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f 1 4 3 2
f 5 6 7 8
f 1 2 6 5
f 3 4 8 7
f 2 3 7 6
f 1 5 8 4
"""
KEPT: list[object] = []


def world(*shapes):
    """A scene graph's query object and the geometries of shapes (shape, X_WG, name)."""
    scene_graph = SceneGraph()
    source = scene_graph.RegisterSource("test")
    found = []
    for shape, X_WG, name in shapes:
        instance = GeometryInstance(X_WG, shape, name)
        instance.set_proximity_properties(ProximityProperties())
        found.append(scene_graph.RegisterAnchoredGeometry(source, instance))
    context = scene_graph.CreateDefaultContext()
    KEPT.append((scene_graph, context))  # the query object points into them
    return scene_graph.get_query_output_port().Eval(context), found


CUBE_MESH = Convex(InMemoryMesh(mesh_file=MemoryFile(CUBE, ".obj", "cube.obj")))
SHAPES = {
    "cylinder": (Cylinder(0.75, 2.0), 2.0 * math.pi * 0.75 * (2.0 + 0.75), math.pi * 0.75**2 * 2.0),
    "box": (Box(1.0, 0.5, 0.25), 2.0 * (0.5 + 0.25 + 0.125), 0.125),
    "sphere": (Sphere(0.4), 4.0 * math.pi * 0.16, 4.0 / 3.0 * math.pi * 0.064),
    "convex": (CUBE_MESH, 6.0, 1.0),
}


@pytest.mark.parametrize("name", SHAPES)
def test_patches_have_the_shapes_area_and_face_outwards(name):
    shape, area, volume = SHAPES[name]
    X_WG = RigidTransform(RotationMatrix.MakeXRotation(0.7), [1.0, -2.0, 3.0])
    query, geometries = world((shape, X_WG, name))
    patches = body_surface(query, geometries, "body", size=0.05).patches
    assert patches.areas.sum() == pytest.approx(area, rel=1e-12)
    np.testing.assert_allclose(np.linalg.norm(patches.normals, axis=1), 1.0, rtol=1e-12)
    # Gauss: the flux of x / 3 out of the surface is the volume; patches are flat, so a round one
    # misses a share of the order of (0.05 / 2 r)^2.
    flux = np.einsum("ij,ij,i->", patches.points, patches.normals, patches.areas) / 3.0
    assert flux == pytest.approx(volume, rel=5e-3)
    # The corners go round the patch anticlockwise as seen from outside.
    c = patches.corners
    turn = np.einsum("ij,ij->i", np.cross(c[:, 2] - c[:, 0], c[:, 3] - c[:, 1]), patches.normals)
    triangle = np.einsum(
        "ij,ij->i", np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), patches.normals
    )
    assert (np.maximum(turn, triangle) > 0.0).all()
    assert np.linalg.norm(c - patches.points[:, None], axis=2).max() < 0.05


def test_what_lies_inside_another_shape_is_no_surface():
    # Two unit cubes that overlap by half: the union's surface is 2 (1.5 + 1.5 + 1) = 8.
    query, geometries = world(
        (Box(1.0, 1.0, 1.0), RigidTransform(), "one"),
        (Box(1.0, 1.0, 1.0), RigidTransform([0.5, 0.0, 0.0]), "other"),
    )
    found = body_surface(query, geometries, "body", size=0.05)
    # The sides coincide and count twice where they do: four of 0.5 more.
    assert found.patches.areas.sum() == pytest.approx(8.0 + 4 * 0.5, rel=1e-12)


def test_shapes_that_are_not_sampled_are_named():
    query, geometries = world(
        (Box(1.0, 1.0, 1.0), RigidTransform(), "box"),
        (Capsule(0.1, 0.2), RigidTransform([3.0, 0.0, 0.0]), "pill"),
    )
    assert body_surface(query, geometries, "body").left_out == ("pill",)
    with pytest.raises(InputError, match="body 'body' has no surface to look at"):
        body_surface(query, geometries[1:], "body")


def cylinder_seen_from(distance: float) -> tuple[SeenSurface, PinholeCamera]:
    """A cylinder of 0.5 m about z, seen once from +x."""
    query, geometries = world((Cylinder(0.5, 1.0), RigidTransform(), "shell"))
    seen = SeenSurface(surface=body_surface(query, geometries, "can::can"))
    camera = PinholeCamera(
        field_of_view=math.radians(60.0), far=50.0, incidence=math.radians(89.9), width=480
    )
    seen.add(camera, look_at([distance, 0.0, 0.0], [0.0, 0.0, 0.0]))
    return seen, camera


def test_the_seen_part_of_a_cylinder_is_that_of_its_tangents():
    seen, _ = cylinder_seen_from(3.0)
    # Sight ends at the tangents: the angle either side is acos(r / d). A patch is 2.9 deg wide.
    angle = math.acos(0.5 / 3.0)
    assert seen.area == pytest.approx(2.0 * angle * 0.5 * 1.0, rel=0.02)
    assert seen.fraction == pytest.approx(seen.area / (math.pi + 2 * math.pi * 0.25), rel=1e-9)
    assert seen.distance.min() == pytest.approx(2.5, abs=1e-3)


def test_a_nearer_look_counts_and_a_farther_one_changes_nothing():
    seen, camera = cylinder_seen_from(3.0)
    first = seen.distance.copy()
    seen.add(camera, look_at([4.0, 0.0, 0.0], [0.0, 0.0, 0.0]))
    known = np.isfinite(first)
    np.testing.assert_array_equal(seen.distance[known], first[known])
    area = seen.area
    seen.add(camera, look_at([-2.0, 0.0, 0.0], [0.0, 0.0, 0.0]))
    assert seen.area > 1.8 * area
    assert seen.distance.min() == pytest.approx(1.5, abs=1e-3)


def test_the_map_has_each_patch_where_it_is():
    query, geometries = world((Cylinder(0.5, 1.0), RigidTransform([1.0, 0.0, 0.0]), "shell"))
    found = body_surface(query, geometries, "can::can", size=0.1)
    (unrolled,) = found.maps
    grid = unrolled.grid
    assert unrolled.rows.shape == (grid.around, grid.along) == (32, 10)
    points = found.patches.points[unrolled.rows] - [1.0, 0.0, 0.0]
    angle = 2.0 * math.pi * (np.arange(32) + 0.5) / 32
    np.testing.assert_allclose(points[:, 0, 0], 0.5 * np.cos(angle), atol=1e-12)
    np.testing.assert_allclose(points[0, :, 2], (np.arange(10) + 0.5) / 10 - 0.5, atol=1e-12)


def test_colours_lie_on_what_was_seen_alone():
    seen, _ = cylinder_seen_from(3.0)
    patches = color_patches(seen, levels=5)
    assert len(np.unique(patches.colors, axis=0)) <= 5
    edges = np.cross(
        patches.corners[:, 1] - patches.corners[:, 0], patches.corners[:, 2] - patches.corners[:, 0]
    )
    # 4 mm outside a radius of 0.5 m, and chords for arcs.
    assert 0.5 * np.linalg.norm(edges, axis=1).sum() == pytest.approx(seen.area, rel=0.01)


@pytest.mark.parametrize("with_picture", [False, True])
def test_the_figure_is_the_same_each_time(tmp_path, with_picture):
    seen, camera = cylinder_seen_from(3.0)
    picture = np.full((40, 40, 3), 128, dtype=np.uint8) if with_picture else None
    for name in ("a.png", "b.png"):
        seen_surface_figure(
            tmp_path / name,
            seen,
            focal_length=camera.focal_length,
            camera_track=[[3.0, 0.0, 0.0], [3.0, 0.5, 0.2]],
            picture=picture,
            notes=("A note.",),
        )
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_figure_of_nothing_seen_can_be_drawn(tmp_path):
    for shape in (Cylinder(0.5, 1.0), Box(1.0, 1.0, 1.0)):
        query, geometries = world((shape, RigidTransform(), "shape"))
        seen = SeenSurface(surface=body_surface(query, geometries, "a::b", size=0.2))
        seen_surface_figure(tmp_path / "a.png", seen, focal_length=500.0, camera_track=[])
        assert seen.fraction == 0.0
        assert len(color_patches(seen).corners) == 0


def test_discs_are_whole():
    assert disc(0.3, 0.05).areas.sum() == pytest.approx(math.pi * 0.09, rel=1e-12)
