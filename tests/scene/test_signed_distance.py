"""Signed distances: Drake's own point queries, geometry that knows its answer, and differences."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.common import MemoryFile
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    InMemoryMesh,
    Mesh,
    MeshcatCone,
    ProximityProperties,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.shapes import scene_frames
from pips_drake.scene.signed_distance import (
    PlacedShape,
    SignedDistanceField,
    placed_shapes,
    read_distance_field,
)

KINDS = ("Sphere", "Box", "Cylinder", "Capsule", "HalfSpace", "Convex")
#: Drake's documentation says 2 to 6e-15 m for things of 0.2 m; ours are up to 2 m, 4 m apart.
ROUNDING = 1e-13
#: Both gradients are differences of rounded points over the distance: at 1e-4 m and farther.
GRADIENT_ROUNDING = 1e-9


def random_pose(rng, reach=2.0):
    rotation = RotationMatrix(Rotation.random(random_state=rng).as_matrix())
    return RigidTransform(rotation, rng.uniform(-reach, reach, 3))


def polytope(rng):
    """A random convex polytope with 4 to 30 vertices, as a Drake shape."""
    points = rng.normal(size=(rng.integers(4, 31), 3)) * rng.uniform(0.2, 1.0, 3)
    hull = ConvexHull(points)
    vertices = points[hull.vertices]
    rows = {old: new + 1 for new, old in enumerate(hull.vertices)}
    lines = ["v " + " ".join(map(repr, vertex)) for vertex in vertices.tolist()]
    for simplex, equation in zip(hull.simplices, hull.equations, strict=True):
        a, b, c = points[simplex]
        order = simplex if np.cross(b - a, c - a) @ equation[:3] > 0.0 else simplex[::-1]
        lines.append("f " + " ".join(str(rows[i]) for i in order))
    return Convex(InMemoryMesh(mesh_file=MemoryFile("\n".join(lines) + "\n", ".obj", "polytope")))


def random_shape(rng, kind):
    a, b, c = rng.uniform(0.1, 1.0, 3)
    return {
        "Sphere": lambda: Sphere(a),
        "Box": lambda: Box(2 * a, 2 * b, 2 * c),
        "Cylinder": lambda: Cylinder(a, 2 * b),
        "Capsule": lambda: Capsule(a, 2 * b),
        "HalfSpace": HalfSpace,
        "Convex": lambda: polytope(rng),
        "Ellipsoid": lambda: Ellipsoid(a, b, c),
    }[kind]()


class DrakeScene:
    """Shapes in a scene graph of their own."""

    def __init__(self, shapes):
        builder = DiagramBuilder()
        self.plant, self.scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        for placed in shapes:
            self.plant.RegisterCollisionGeometry(
                self.plant.world_body(),
                placed.X_WG,
                placed.shape,
                placed.name,
                ProximityProperties(),
            )
        self.plant.Finalize()
        diagram = builder.Build()
        self._root = diagram.CreateDefaultContext()  # keeps the query's context alive
        context = self.scene_graph.GetMyContextFromRoot(self._root)
        self.query = self.scene_graph.get_query_output_port().Eval(context)

    @property
    def field(self):
        frames = scene_frames(self.plant, ModelInstanceIndex(10**6))
        return SignedDistanceField.of(placed_shapes(self.query, frames))

    def nearest(self, point):
        return min(self.query.ComputeSignedDistanceToPoint(point), key=lambda pair: pair.distance)


def single(shape, X_WG=None):
    pose = RigidTransform() if X_WG is None else X_WG
    return SignedDistanceField.of([PlacedShape("body", "shape", shape, pose)])


@pytest.mark.parametrize("kind", KINDS)
def test_each_shape_agrees_with_drake_inside_and_outside(kind):
    rng = np.random.default_rng(7)
    sides = set()
    for _ in range(6):
        scene = DrakeScene([PlacedShape("world", "it", random_shape(rng, kind), random_pose(rng))])
        points = rng.uniform(-3.0, 3.0, (150, 3))
        X_WG = scene.field.shapes[0].X_WG
        near = X_WG.translation() + rng.normal(scale=0.2, size=(150, 3))
        points = np.concatenate([points, near])
        found = scene.field.nearest(points)
        for point, distance, gradient in zip(points, found.distances, found.gradients, strict=True):
            truth = scene.nearest(point)
            assert distance == pytest.approx(truth.distance, abs=ROUNDING)
            if abs(distance) > 1e-4:
                np.testing.assert_allclose(gradient, truth.grad_W, atol=GRADIENT_ROUNDING)
            sides.add(distance > 0.0)
    assert sides == {True, False}


def test_scenes_of_many_shapes_agree_with_drakes_least():
    rng = np.random.default_rng(8)
    inside = 0
    for _ in range(5):
        shapes = [
            PlacedShape("world", f"{kind}_{i}", random_shape(rng, kind), random_pose(rng, 3.0))
            for kind in KINDS
            if kind != "HalfSpace"
            for i in range(5)
        ]
        scene = DrakeScene(shapes)
        points = rng.uniform(-4.0, 4.0, (500, 3))
        field = scene.field
        found = field.nearest(points)
        for point, distance, index in zip(points, found.distances, found.indices, strict=True):
            truth = scene.nearest(point)
            assert distance == pytest.approx(truth.distance, abs=ROUNDING)
            name = scene.query.inspector().GetName(truth.id_G)
            assert field.shapes[index].name == name.split("::")[-1]
            inside += distance < 0.0
    assert inside > 100


@pytest.mark.parametrize("kind", (*KINDS, "Ellipsoid"))
def test_gradients_are_differences_of_distances(kind):
    """Central differences of 1e-6 m: exact to 1e-8 but where a shape has an edge in between."""
    rng = np.random.default_rng(9)
    field = single(random_shape(rng, kind), random_pose(rng))
    points = field.shapes[0].X_WG.translation() + rng.uniform(-1.5, 1.5, (400, 3))
    found, step = field.nearest(points), 1e-6
    moves = step * np.eye(3)
    slopes = np.column_stack(
        [(field.distances(points + m) - field.distances(points - m)) / (2 * step) for m in moves]
    )
    np.testing.assert_allclose(np.linalg.norm(found.gradients, axis=1), 1.0, atol=1e-12)
    off = np.abs(slopes - found.gradients).max(axis=1)
    # Second derivatives are 1 / distance to an edge: a few points are near one.
    assert np.mean(off < 1e-6) > 0.99


def test_ellipsoids_know_how_far_they_were_left():
    """From a surface point along its normal, out any way, in as far as the surface curves least.

    Drake's own distance is iterative here, 3e-5 m by its documentation: no truth.
    """
    rng = np.random.default_rng(10)
    for _ in range(40):
        axes = rng.uniform(0.1, 1.0, 3)
        if rng.random() < 0.3:
            axes[1] = axes[0]
        pose = random_pose(rng)
        field = single(Ellipsoid(*axes), pose)
        unit = rng.normal(size=(50, 3))
        unit /= np.linalg.norm(unit, axis=1)[:, None]
        normals = unit / axes
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        # The largest ball that rolls everywhere inside has radius min^2 / max.
        heights = rng.uniform(-(axes.min() ** 2) / axes.max(), 1.0, 50)
        local = unit * axes + heights[:, None] * normals
        found = field.nearest((pose @ local.T).T)
        np.testing.assert_allclose(found.distances, heights, atol=1e-13)
        expected = normals @ pose.rotation().matrix().T
        np.testing.assert_allclose(found.gradients, expected, atol=1e-7)


def test_middles_and_axes_have_unit_gradients_and_the_exact_depth():
    ellipsoid = single(Ellipsoid(0.5, 0.2, 0.3)).nearest([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
    # On the longest axis near the middle the nearest points stand off it: x' = x a^2 / (a^2 - b^2).
    x = 0.1 * 0.25 / (0.25 - 0.04)
    y = 0.2 * np.sqrt(1.0 - (x / 0.5) ** 2)
    expected = [-0.2, -np.hypot(x - 0.1, y)]
    np.testing.assert_allclose(ellipsoid.distances, expected, atol=1e-13)
    for shape, depth in (
        (Sphere(0.3), 0.3),
        (Cylinder(0.3, 1.0), 0.3),
        (Cylinder(0.3, 0.4), 0.2),
        (Capsule(0.3, 1.0), 0.3),
        (Box(0.2, 0.6, 0.8), 0.1),
    ):
        found = single(shape).nearest(np.zeros((1, 3)))
        assert found.distances[0] == pytest.approx(-depth, abs=1e-15)
        assert np.linalg.norm(found.gradients[0]) == pytest.approx(1.0)


def test_a_mesh_is_its_hull_as_in_drakes_collisions(bracket, tmp_path):
    bracket.write(tmp_path)
    whole, hull = (single(kind(str(tmp_path / "bracket.obj"))) for kind in (Mesh, Convex))
    points = np.random.default_rng(11).uniform(-0.3, 0.7, (300, 3))
    np.testing.assert_array_equal(whole.distances(points), hull.distances(points))
    # On the slanting face of the hull, in the mesh's hollow.
    corner = [0.5 * (bracket.leg_x + bracket.thick), 0.5 * (bracket.leg_y + bracket.thick), 0.1]
    assert whole.distances([corner])[0] == pytest.approx(0.0, abs=1e-12)


def test_shapes_are_added_and_taken_away_by_name():
    field = single(Sphere(1.0))
    at = np.array([[5.0, 0.0, 0.0]])
    obstacle = PlacedShape("post", "", Sphere(0.5), RigidTransform([4.0, 0.0, 0.0]))
    more = field.with_shapes([obstacle])
    found = more.nearest(at)
    assert (found.distances[0], more.label(found.indices[0])) == (pytest.approx(0.5), "post")
    assert more.without_body("post").distances(at)[0] == pytest.approx(4.0)
    assert field.label(0) == "body (shape)"
    with pytest.raises(UnknownNameError, match=r"unknown body 'pst'.*did you mean 'post'"):
        more.without_body("pst")


def test_distances_to_bodies_are_those_of_each_body_alone():
    rng = np.random.default_rng(12)
    shapes = [
        PlacedShape(f"body_{i % 3}", "", random_shape(rng, "Box"), random_pose(rng))
        for i in range(9)
    ]
    field = SignedDistanceField.of(shapes)
    points = rng.uniform(-2.0, 2.0, (200, 3))
    distances, gradients = field.to_bodies(points)
    assert field.bodies == ("body_0", "body_1", "body_2")
    for i, body in enumerate(field.bodies):
        alone = SignedDistanceField.of(s for s in shapes if s.body == body).nearest(points)
        np.testing.assert_array_equal(distances[:, i], alone.distances)
        np.testing.assert_array_equal(gradients[:, i], alone.gradients)


def test_blended_distances_are_smooth_and_little_smaller():
    rng = np.random.default_rng(13)
    shapes = [
        PlacedShape(f"body_{i % 2}", "", random_shape(rng, "Box"), random_pose(rng))
        for i in range(12)
    ]
    field = SignedDistanceField.of(shapes)
    points, blend, step = rng.uniform(-2.0, 2.0, (500, 3)), 0.05, 1e-6
    there, gradients = field.blended(points, blend=blend, within=10.0)
    exact, _ = field.to_bodies(points)
    assert (there <= exact).all()
    assert (exact - there <= blend * np.log(6.0)).all()
    for axis in range(3):
        shift = step * np.eye(3)[axis]
        up, down = (field.blended(points + s, blend=blend, within=10.0)[0] for s in (shift, -shift))
        # Boxes' distances have creases of their own inside and at their edges' regions: curvature
        # there is up to 1 / distance.
        slope = (up - down) / (2.0 * step)
        good = np.abs(slope - gradients[:, :, axis]) < 1e-5
        assert good[exact > 0.0].all()


def test_between_two_shapes_that_are_as_near_the_blended_gradient_does_not_leap():
    shapes = [
        PlacedShape("body", "", Sphere(1.0), RigidTransform([x, 0.0, 0.0])) for x in (-2.0, 2.0)
    ]
    x = np.linspace(-0.01, 0.01, 201)
    points = np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])
    field = SignedDistanceField.of(shapes)
    assert np.abs(np.diff(field.to_bodies(points)[1][:, 0, 0])).max() == pytest.approx(2.0)
    # The share's slope is at most 1 / (2 blend) a metre, so steps of 0.1 mm change it by 1 %.
    there = field.blended(points, blend=0.01, within=5.0)[1][:, 0, 0]
    assert np.abs(np.diff(there)).max() < 0.011


def test_what_is_farther_than_wanted_is_left_out():
    field = single(Sphere(0.5))
    distances, gradients = field.blended([[5.0, 0.0, 0.0]], blend=0.01, within=1.0)
    assert np.isinf(distances).all()
    assert (gradients == 0.0).all()
    for wrong in ({"blend": 0.0, "within": 1.0}, {"blend": 0.1, "within": np.nan}):
        with pytest.raises(InputError, match="must be > 0"):
            field.blended([[5.0, 0.0, 0.0]], **wrong)


def test_nothing_is_infinitely_far():
    found = SignedDistanceField.of([]).nearest(np.zeros((2, 3)))
    assert np.isinf(found.distances).all()
    assert (found.indices == -1).all()
    assert (found.gradients == 0.0).all()


def test_points_and_shapes_without_a_distance_are_refused():
    field = single(Sphere(1.0))
    with pytest.raises(InputError, match=r"points\[1\] = \[nan, 0.0, 0.0\]; must be finite"):
        field.distances([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
    with pytest.raises(InputError, match=r"points have shape \(3,\); must be \(N, 3\)"):
        field.distances([0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="body: shape shape is a MeshcatCone; must be one of Box"):
        single(MeshcatCone(1.0))


def test_scene_files_are_read_as_the_plant_places_them():
    """Trajectory 4's pallet: its floor's outer side at z = 5.967 + 0.05 m in frame_0."""
    file = find_scene_file("trajectory_4")
    above = np.array([[1.562, -1.8421, 6.117]])
    assert read_distance_field(file).distances(above)[0] == pytest.approx(0.1, abs=1e-12)
    X_WF = RigidTransform(RotationMatrix.MakeXRotation(0.3), [1.0, 2.0, 3.0])
    moved = read_distance_field(file, placed_frames={"frame_0": X_WF})
    assert moved.distances((X_WF @ above.T).T)[0] == pytest.approx(0.1, abs=1e-12)
    assert {placed.body for placed in moved.shapes} == {"pallet::pallet", "payload::payload"}
