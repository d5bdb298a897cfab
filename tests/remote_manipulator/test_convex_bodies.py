"""Convex bodies against Drake's query, closed forms, and what any pair must obey."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import (
    Convex,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    ProximityProperties,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from scipy.spatial.transform import Rotation

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.convex_bodies import (
    EDGE_PAIR,
    FACE_OF_FIRST,
    FACE_OF_SECOND,
    BodySet,
    ConvexBody,
    distance,
    exact_collision,
    separation,
    vertices_inside,
)
from pips_drake.remote_manipulator.geometry import prism_corners
from pips_drake.units import FOOT

HERE = (np.eye(3), np.zeros(3))
# Rounding of coordinates of a few metres, 1e-15, times the few operations that follow.
ROUNDING = 1e-13
PAYLOAD = ConvexBody.prism(8, 14.0 * FOOT, 50.0 * FOOT)
PROBE = ConvexBody.box([0.3, 0.25, 0.25]).moved(np.eye(3), [-25.0 * FOOT - 0.3, 0.0, 0.0])
CAE = ConvexBody.prism(8, 14.0 * FOOT, 7.5, "z")


def turns(rng, count):
    return Rotation.random(count, random_state=rng).as_matrix()


def boxes_of_like_size(rng, poses):
    """Two boxes, and poses at which a third of them meet."""
    one, two = (ConvexBody.box(rng.uniform(0.5, 1.0, 3)) for _ in range(2))
    apart = rng.uniform(-2.0, 2.0, (poses, 3))
    return (
        one,
        two,
        (turns(rng, poses), apart, turns(rng, poses), rng.normal(size=(poses, 3)) * 0.1),
    )


def bars_near_boxes(rng, poses):
    """A thin bar and a box, brought to a gap or depth of 1e-8 to 0.1 m."""
    one = ConvexBody.box([rng.uniform(1.0, 2.0), *rng.uniform(0.02, 0.1, 2)])
    two = ConvexBody.box(rng.uniform(0.3, 0.8, 3))
    R, S, q = turns(rng, poses), turns(rng, poses), rng.uniform(-1.0, 1.0, (poses, 3))
    found = separation(one, R, np.zeros(3), two, S, q)
    gap = 10.0 ** rng.uniform(-8.0, -1.0, poses) * rng.choice([-1.0, 1.0], poses)
    return one, two, (R, found.normal * (gap - found.separation)[:, None], S, q)


FAMILIES = [boxes_of_like_size, bars_near_boxes]


def drake_distances(first, second, poses):
    """Drake's signed distance of the same vertices' hulls."""
    graph = SceneGraph()
    source = graph.RegisterSource("bodies")
    frames, shapes = [], []
    for k, body in enumerate((first, second)):
        frames.append(graph.RegisterFrame(source, GeometryFrame(f"frame_{k}")))
        shape = GeometryInstance(RigidTransform(), Convex(body.vertices.T, "hull"), f"hull_{k}")
        shape.set_proximity_properties(ProximityProperties())
        shapes.append(graph.RegisterGeometry(source, frames[-1], shape))
    context = graph.CreateDefaultContext()
    query, pose_port = graph.get_query_output_port(), graph.get_source_pose_port(source)
    distances = []
    for R, p, S, q in zip(*poses, strict=True):
        X = FramePoseVector()
        X.set_value(frames[0], RigidTransform(RotationMatrix(R), p))
        X.set_value(frames[1], RigidTransform(RotationMatrix(S), q))
        pose_port.FixValue(context, X)
        pair = query.Eval(context).ComputeSignedDistancePairClosestPoints(*shapes)
        distances.append(pair.distance)
    return np.array(distances)


def compare_with_drake(family, rng, bodies, poses):
    """Shares that meet, and the worst of |distance| where the verdicts differ."""
    meeting, worst, depths = [], 0.0, 0.0
    for _ in range(bodies):
        first, second, placed = family(rng, poses)
        found = separation(first, *placed[:2], second, *placed[2:])
        drake = drake_distances(first, second, placed)
        differ = found.collides != (drake <= 0.0)
        worst = max(worst, abs(drake[differ]).max(initial=0.0))
        worst = max(worst, abs(found.separation[differ]).max(initial=0.0))
        deep = found.collides & (drake < 0.0)
        depths = max(depths, abs(found.separation - drake)[deep].max(initial=0.0))
        # A lower bound of the distance.
        assert (found.separation <= drake + ROUNDING)[~found.collides].all()
        meeting.append(found.collides.mean())
    return np.mean(meeting), worst, depths


@pytest.mark.parametrize("family", FAMILIES)
def test_verdict_and_depth_are_drakes(family):
    meeting, worst, depths = compare_with_drake(family, np.random.default_rng(11), 8, 40)
    assert 0.2 < meeting < 0.8
    assert worst <= 1e-9
    assert depths < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_verdict_is_drakes_in_20000_pairs(family):
    meeting, worst, depths = compare_with_drake(family, np.random.default_rng(12), 50, 400)
    print(f"{family.__name__}: {100 * meeting:.1f} % meet, verdicts differ up to {worst:.1e} m")
    assert 0.2 < meeting < 0.8
    assert worst <= 1e-9
    assert depths < 1e-9


def test_boxes_prisms_and_hulls_close_and_look_outward():
    bodies = {
        "box": (ConvexBody.box([1.0, 2.0, 3.0]), (6, 12, 3, 3)),
        "prism": (PAYLOAD, (10, 24, 5, 5)),
        "hexagon": (ConvexBody.prism(6, 1.0, 2.0, "y"), (8, 18, 4, 4)),
        "wedge": (ConvexBody.prism(3, 1.0, 2.0, "z"), (5, 9, 4, 4)),
    }
    for body, counts in bodies.values():
        hull = ConvexBody.hull(np.vstack([body.vertices, 0.3 * body.vertices]))  # and points inside
        for one in (body, hull):
            found = (one.faces, one.edges, one.face_normals, one.edge_directions)
            assert tuple(map(len, found)) == counts
            assert len(one.vertices) - len(one.edges) + len(one.faces) == 2  # Euler
            heights = one.vertices @ one.planes[:, :3].T - one.planes[:, 3]
            assert heights.max() < ROUNDING
            on_face = np.zeros(heights.shape, dtype=bool)
            for k, face in enumerate(one.faces):
                on_face[list(face), k] = True
            np.testing.assert_array_equal(on_face, heights > -1e-9)


def test_a_prism_is_the_payloads():
    np.testing.assert_allclose(PAYLOAD.vertices, prism_corners(14.0 * FOOT, 50.0 * FOOT))
    # Along z as along x, turned.
    assert CAE.vertices[:, 2].max() == pytest.approx(3.75)
    assert CAE.vertices[:, 0].max() == pytest.approx(7.0 * FOOT)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ConvexBody.box([1.0, 0.0, 1.0]), "must be three, > 0"),
        (lambda: ConvexBody.box([1.0, math.nan, 1.0]), "must be three, > 0"),
        (lambda: ConvexBody.prism(2, 1.0, 1.0), "sides must be >= 3"),
        (lambda: ConvexBody.prism(8, 1.0, -1.0), "sizes > 0"),
        (lambda: ConvexBody.prism(8, 1.0, 1.0, "w"), "must be x, y or z"),
        (lambda: ConvexBody.hull(np.eye(3)), "3 points span no convex body"),
        (lambda: ConvexBody.hull(np.eye(4)[:, :3] * [1, 1, 0]), "span no convex body"),
        (lambda: ConvexBody.hull([[math.inf, 0, 0]] * 4), "must be finite"),
    ],
)
def test_bodies_that_are_none_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_gaps_and_distances_of_upright_boxes_are_closed_form():
    one, two = ConvexBody.box([1.0, 2.0, 3.0]), ConvexBody.box([0.5, 0.5, 0.5])
    place = np.array([[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [-2.5, -3.5, 0.0], [2.5, 4.5, 7.5]])
    found = distance(one, *HERE, two, np.eye(3), place)
    # Parallel edges have no product: what is left are the three axes.
    expected = [0.5, -0.5, 1.0, 4.0]
    np.testing.assert_allclose(found.separation.separation, expected, atol=ROUNDING)
    assert found.separation.axis.tolist() == [FACE_OF_FIRST] * 4
    np.testing.assert_array_equal(found.separation.collides, [False, True, False, False])
    apart = [0.5, -0.5, math.hypot(1.0, 1.0), math.sqrt(1.0 + 2.0**2 + 4.0**2)]
    np.testing.assert_allclose(found.distance, apart, atol=ROUNDING)
    np.testing.assert_allclose(found.separation.plane[0], [-1.0, 0.0, 0.0, -1.25], atol=ROUNDING)
    assert np.isnan(found.separation.plane[1]).all()
    np.testing.assert_allclose(found.points[3], [[1, 2, 3], [2, 4, 7]], atol=ROUNDING)
    assert np.isnan(found.points[1]).all()


@pytest.mark.parametrize("angle", [0.0, 1e-13, 1e-11, 1e-9, 1e-8, 1e-6, 1e-3, 1.0, 0.5 * math.pi])
def test_crossed_bars_on_edge_meet_edge_to_edge_however_small_the_angle(angle):
    bar, on_edge = ConvexBody.box([2.0, 0.1, 0.1]), Rotation.from_euler("x", 45, degrees=True)
    turned = (Rotation.from_euler("z", angle) * on_edge).as_matrix()
    gaps = np.array([-1e-3, -1e-9, 1e-9, 1e-3])
    above = np.zeros((4, 3))
    above[:, 2] = 0.2 * math.sqrt(2.0) + gaps
    found = distance(bar, turned, above, bar, on_edge.as_matrix(), np.zeros(3))
    np.testing.assert_array_equal(found.separation.collides, gaps < 0.0)
    # The gap along the vertical is the distance; parallel bars' gap is found on their faces alone.
    np.testing.assert_allclose(found.distance[2:], gaps[2:], atol=ROUNDING)
    if angle > 1e-12:
        assert (found.separation.axis[2:] == EDGE_PAIR).all()
        np.testing.assert_allclose(found.separation.separation[2:], gaps[2:], atol=ROUNDING)


def random_body(rng):
    kind = rng.integers(3)
    if kind == 0:
        return ConvexBody.box(rng.uniform(0.1, 1.0, 3))
    if kind == 1:
        return ConvexBody.prism(int(rng.integers(3, 10)), *rng.uniform(0.3, 2.0, 2), "xyz"[kind])
    return ConvexBody.hull(rng.normal(size=(10, 3)) * 0.7)


SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=40)
@given(SEEDS)
def test_pairs_are_symmetric_and_do_not_depend_on_the_place(seed):
    rng = np.random.default_rng(seed)
    first, second, count = random_body(rng), random_body(rng), 10
    R, S, Q = turns(rng, count), turns(rng, count), turns(rng, 1)[0]
    p, q = rng.uniform(-1.2, 1.2, (2, count, 3))
    here = separation(first, R, p, second, S, q)
    back = separation(second, S, q, first, R, p)
    np.testing.assert_allclose(back.separation, here.separation, atol=1e-11)
    moved = separation(first, Q @ R, p @ Q.T + 30.0, second, Q @ S, q @ Q.T + 30.0)
    # Coordinates of 30 m have a last digit of 4e-15 m; an edge pair must win by 1e-12 m.
    np.testing.assert_allclose(moved.separation, here.separation, atol=1e-11)


@settings(max_examples=40)
@given(SEEDS)
def test_to_be_moved_by_the_depth_is_enough_and_needed(seed):
    rng = np.random.default_rng(seed)
    first, second, count = random_body(rng), random_body(rng), 10
    poses = turns(rng, count), turns(rng, count), rng.uniform(-0.5, 0.5, (count, 3))
    R, S, p = poses
    found = separation(first, R, p, second, S, np.zeros(3))
    deep = found.collides
    out = found.normal * -found.separation[:, None]
    for part, meets in ((1.0 - 1e-9, True), (1.0 + 1e-9, False)):
        then = separation(first, R, p + part * out, second, S, np.zeros(3))
        # Depths below a centimetre times 1e-9 are rounding.
        sure = deep & (found.separation < -0.01)
        assert (then.collides[sure] == meets).all()
    # No way out is shorter: tried in many directions.
    ways = rng.normal(size=(count, 3))
    ways *= 0.999 * found.separation[:, None] / np.linalg.norm(ways, axis=1, keepdims=True)
    assert separation(first, R, p + ways, second, S, np.zeros(3)).collides[deep].all()


@settings(max_examples=40)
@given(SEEDS)
def test_planes_and_nearest_points_prove_themselves(seed):
    rng = np.random.default_rng(seed)
    first, second, count = random_body(rng), random_body(rng), 20
    R, S = turns(rng, count), turns(rng, count)
    p, q = rng.uniform(-2.0, 2.0, (2, count, 3))
    found = distance(first, R, p, second, S, q)
    apart, axis = ~found.separation.collides, found.separation
    one = first.vertices @ np.swapaxes(R, 1, 2) + p[:, None]
    two = second.vertices @ np.swapaxes(S, 1, 2) + q[:, None]

    def gap(normal):
        ahead = np.einsum("nvi,ni->nv", one, normal).min(axis=1)
        return ahead - np.einsum("nvi,ni->nv", two, normal).max(axis=1)

    np.testing.assert_allclose(gap(axis.normal), axis.separation, atol=ROUNDING)
    assert np.isnan(axis.plane[~apart]).all()
    n, d = axis.plane[apart, :3], axis.plane[apart, 3]
    assert (np.einsum("nvi,ni->nv", one[apart], n) >= d[:, None]).all()
    assert (np.einsum("nvi,ni->nv", two[apart], n) <= d[:, None]).all()
    # Two points of the bodies, and a gap as wide as they are apart: no two are nearer.
    between = found.points[apart, 0] - found.points[apart, 1]
    length = np.linalg.norm(between, axis=1)
    np.testing.assert_allclose(length, found.distance[apart], atol=ROUNDING)
    # Directions of short distances have fewer digits: 1e-15 m over the distance, times 2 m.
    way = np.zeros((count, 3))
    way[apart] = between / length[:, None]
    close = 1e-14 + 1e-14 / found.distance[apart].clip(1e-12)
    assert (abs(gap(way)[apart] - found.distance[apart]) <= close).all()
    for body, Q, x, row in ((first, R, p, 0), (second, S, q, 1)):
        planes = body.planes_at(Q, x)[apart]
        heights = np.einsum("ni,nfi->nf", found.points[apart, row], planes[..., :3])
        assert (heights <= planes[..., 3] + ROUNDING).all()


def test_a_whole_frame_is_its_pairs():
    rng = np.random.default_rng(3)
    bodies = [PAYLOAD, PROBE, CAE, ConvexBody.box([3.0, 0.1, 2.0]), random_body(rng)]
    R, p = turns(rng, 5), rng.uniform(-8.0, 8.0, (5, 3))
    pairs = [(i, j) for i in range(5) for j in range(5) if i != j]
    together = BodySet(bodies).distances(pairs, R, p)
    assert 0 < together.separation.collides.sum() < len(pairs)
    for k, (i, j) in enumerate(pairs):
        alone = distance(bodies[i], R[i], p[i], bodies[j], R[j], p[j])
        assert alone.distance[0] == together.distance[k]
        assert alone.separation.axis[0] == together.separation.axis[k]
    # A body seen from another frame is the same body.
    moved = bodies[0].moved(R[0], p[0])
    again = separation(moved, *HERE, bodies[2], R[2], p[2])
    assert again.separation[0] == pytest.approx(together.separation.separation[1], abs=ROUNDING)


def test_hexahedra_given_by_vertices_are_their_hulls():
    rng = np.random.default_rng(4)
    count = 60
    frustum = ConvexBody.box([1.0, 0.6, 0.8]).vertices
    frustum = frustum * np.where(frustum[:, 2:] > 0.0, [[0.4, 0.7, 1.0]], 1.0)
    for shape in (frustum, ConvexBody.box([1.0, 0.6, 0.8]).vertices):
        body = ConvexBody.hull(shape)
        R, S = turns(rng, count), turns(rng, count)
        p = rng.uniform(-2.2, 2.2, (count, 3))
        expected = separation(body, R, p, body, S, np.zeros(3))
        one, two = shape @ np.swapaxes(R, 1, 2) + p[:, None], shape @ np.swapaxes(S, 1, 2)
        found = exact_collision(one, two)
        np.testing.assert_allclose(found.separation, expected.separation, atol=1e-11)
        assert set(expected.axis) == {FACE_OF_FIRST, FACE_OF_SECOND, EDGE_PAIR}
        assert 0.1 < expected.collides.mean() < 0.9
    assert len(exact_collision(np.empty((0, 8, 3)), np.empty((0, 8, 3))).separation) == 0


def test_points_inside_are_on_the_false_side_of_all_faces():
    points = np.random.default_rng(5).uniform(-1.2, 1.2, (500, 3)) * [1.0, 2.0, 3.0]
    box = ConvexBody.box([1.0, 2.0, 3.0])
    expected = (abs(points) <= [1.0, 2.0, 3.0]).all(axis=1)
    np.testing.assert_array_equal(vertices_inside(points, box.planes), expected)
    R, p = turns(np.random.default_rng(6), 4), np.arange(12.0).reshape(4, 3)
    placed = points @ np.swapaxes(R, 1, 2) + p[:, None]
    found = vertices_inside(placed, box.planes_at(R, p))
    np.testing.assert_array_equal(found, np.tile(expected, (4, 1)))
