"""Meshes against an L-shaped prism, whose hull is known in closed form, and against boxes."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.scene.meshes import TriangleMesh, convex_hull, excess, hull_excess, read_obj

TOLERANCE = 0.2e-3  # m


@pytest.fixture
def mesh(bracket):
    return TriangleMesh(*bracket.triangles())


def box(low, high):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    return convex_hull(np.asarray(low) + corners * (np.asarray(high) - low))


def test_volume_is_closed_form(bracket, mesh):
    assert mesh.closed
    assert mesh.volume == pytest.approx(bracket.volume, rel=1e-12)


def test_volume_does_not_depend_on_the_place(bracket, mesh):
    moved = TriangleMesh(mesh.vertices + np.array([1e3, -1e3, 1e3]), mesh.triangles)
    assert moved.volume == pytest.approx(bracket.volume, rel=1e-9)


def test_a_mesh_with_a_hole_or_a_face_turned_over_is_not_closed(mesh):
    assert not TriangleMesh(mesh.vertices, mesh.triangles[1:]).closed
    turned = mesh.triangles.copy()
    turned[0] = turned[0, ::-1]
    assert not TriangleMesh(mesh.vertices, turned).closed


def test_hull_is_closed_form(bracket, mesh):
    hull = convex_hull(mesh.vertices)
    assert hull.closed
    assert hull.volume == pytest.approx(bracket.hull_volume, rel=1e-12)
    # The inner corner is the only place of the outline that the hull does not touch.
    assert len(hull.vertices) == 10


def test_hull_stands_out_of_the_mesh_by_the_closed_form(bracket, mesh):
    found = hull_excess(convex_hull(mesh.vertices), mesh, tolerance=TOLERANCE)
    assert bracket.hull_excess - TOLERANCE <= found <= bracket.hull_excess + 1e-12


def test_skipping_shared_faces_changes_nothing(mesh):
    hull = convex_hull(mesh.vertices)
    plain = excess(hull, mesh, tolerance=TOLERANCE)
    assert hull_excess(hull, mesh, tolerance=TOLERANCE) == pytest.approx(plain, abs=TOLERANCE)


def test_mesh_stands_out_of_its_hull_nowhere(mesh):
    assert excess(mesh, [convex_hull(mesh.vertices)]) < 1e-12


def test_two_boxes_are_the_bracket(bracket, mesh):
    x, y, t, h = bracket.leg_x, bracket.leg_y, bracket.thick, bracket.height
    parts = [box([0, 0, 0], [x, t, h]), box([0, t, 0], [t, y, h])]
    assert excess(mesh, parts) < 1e-12
    assert max(excess(part, mesh) for part in parts) < 1e-12
    # Without the second one, its far end is missing.
    assert excess(mesh, parts[:1]) == pytest.approx(y - t, abs=TOLERANCE)


def test_a_larger_box_stands_out_by_the_way_to_its_corner():
    inner, outer = box([0, 0, 0], [1, 1, 1]), box([0, 0, 0], [1.3, 1.4, 1])
    assert excess(outer, inner, tolerance=TOLERANCE) == pytest.approx(0.5, abs=TOLERANCE)
    # Exact at once: the largest distance is at a corner.
    assert excess(outer, [inner]) == pytest.approx(0.5, rel=1e-12)
    assert excess(inner, outer) < 1e-12


def test_half_the_tolerance_comes_nearer(bracket, mesh):
    hull = convex_hull(mesh.vertices)
    for tolerance in (8e-3, 4e-3, 2e-3, 1e-3):
        found = hull_excess(hull, mesh, tolerance=tolerance)
        assert 0.0 <= bracket.hull_excess - found <= tolerance


@pytest.mark.parametrize("points", [np.eye(3), np.zeros((5, 3)), [[0, 0, 0], [1, 0, 0], [0, 1, 0],
                                                                   [1, 1, 0]]])  # fmt: skip
def test_what_is_flat_has_no_hull(points):
    assert convex_hull(points) is None


def test_reading_scales_and_a_mirror_keeps_the_outside_outside(bracket, tmp_path):
    file = tmp_path / "bracket.obj"
    file.write_text(bracket.obj())
    for scale in ([1, 1, 1], [2, 1, 0.5], [-1, 1, 1], [-1, -2, 1]):
        mesh = read_obj(file, scale)
        assert mesh.closed
        whole = abs(float(np.prod(scale))) * bracket.volume
        assert mesh.volume == pytest.approx(whole, rel=1e-12)


def test_repeated_vertices_become_one(tmp_path, bracket):
    vertices, faces = bracket.triangles()
    lines = ["v {!r} {!r} {!r}".format(*v) for v in vertices[faces].reshape(-1, 3).tolist()]
    lines += [f"f {i + 1} {i + 2} {i + 3}" for i in range(0, 3 * len(faces), 3)]
    (tmp_path / "soup.obj").write_text("\n".join(lines))
    mesh = read_obj(tmp_path / "soup.obj")
    assert (len(mesh.vertices), mesh.closed) == (12, True)


def test_a_file_that_is_no_mesh_is_refused(tmp_path):
    (tmp_path / "bad.obj").write_text("v 1 2 3\nf 1 2 3\n")
    with pytest.raises(InputError, match=r"bad\.obj"):
        read_obj(tmp_path / "bad.obj")
