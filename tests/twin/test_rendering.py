"""Cameras stand where they should, and pictures show what stands there."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydrake.geometry import (
    Box,
    GeometryInstance,
    PerceptionProperties,
    QueryObject,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix

from pips_drake.errors import InputError
from pips_drake.twin import rendering
from pips_drake.twin.rendering import (
    FIELD_OF_VIEW,
    SIZE,
    add_renderer,
    corner_points,
    fit_view,
    look_at,
    render_available,
    render_depth,
    render_view,
    save_png,
)

COORDINATES = st.floats(-10.0, 10.0)
POINTS = st.lists(st.tuples(COORDINATES, COORDINATES, COORDINATES), min_size=1, max_size=12)
DIRECTIONS = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda d: math.hypot(*d) > 0.1)


def test_look_at_has_x_right_y_down_z_forward() -> None:
    X_WC = look_at([0.0, -5.0, 1.0], [0.0, 3.0, 1.0])
    np.testing.assert_allclose(X_WC.rotation().matrix().T, [[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    np.testing.assert_array_equal(X_WC.translation(), [0.0, -5.0, 1.0])


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)])
def test_looking_along_up_is_no_trouble(up: tuple[float, float, float]) -> None:
    for ahead in ([0.0, 0.0, -2.0], [0.0, 2.0, 0.0], [2.0, 0.0, 0.0]):
        rotation = look_at([0.0, 0.0, 0.0], ahead, up).rotation()
        assert rotation.IsValid()
        np.testing.assert_allclose(rotation.col(2), np.array(ahead) / 2.0)


def test_a_camera_that_looks_at_itself_is_refused() -> None:
    with pytest.raises(InputError, match="another point"):
        look_at([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])


@given(points=POINTS, direction=DIRECTIONS)
def test_fit_view_sees_all_points_and_is_the_nearest(
    points: list[tuple[float, float, float]], direction: tuple[float, float, float]
) -> None:
    margin = 0.05
    X_WC = fit_view(points, direction, margin=margin)
    x, y, z = X_WC.inverse() @ np.array(points).T
    assert np.all(z >= 0.1 - 1e-9)
    half = math.tan(0.5 * FIELD_OF_VIEW)
    # In parts of the picture, from -0.5 to 0.5.
    across, down = 0.5 * x / z / (half * SIZE[0] / SIZE[1]), 0.5 * y / z / half
    edge = 0.5 - margin
    assert np.all(np.abs(across) <= edge + 1e-9)
    assert np.all(np.abs(down) <= edge + 1e-9)
    touches = any(
        part.max() >= edge - 1e-6 and part.min() <= -edge + 1e-6 for part in (across, down)
    )
    assert touches or z.min() <= 0.1 + 1e-9


def test_without_libraries_the_error_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering, "can_render", lambda: False)
    assert "libegl1" in str(render_available())
    with pytest.raises(InputError, match="apt install libegl1"):
        add_renderer(SceneGraph())


def make_scene() -> SceneGraph:
    """A red cube of 1 m at x = 2 m, and a flat blue box at y = 3 m, turned about z."""
    scene_graph = SceneGraph()
    source = scene_graph.RegisterSource("test")
    for name, position, size, color in (
        ("cube", [2.0, 0.0, 0.0], (1.0, 1.0, 1.0), Rgba(1.0, 0.0, 0.0, 1.0)),
        ("flat", [0.0, 3.0, 0.0], (2.0, 1.0, 0.1), Rgba(0.0, 0.0, 1.0, 1.0)),
    ):
        X_WG = RigidTransform(RotationMatrix.MakeZRotation(math.pi / 2), position)
        geometry = GeometryInstance(X_WG, Box(*size), name)
        properties = PerceptionProperties()
        properties.AddProperty("phong", "diffuse", color)
        geometry.set_perception_properties(properties)
        scene_graph.RegisterAnchoredGeometry(source, geometry)
    return scene_graph


def query(scene_graph: SceneGraph, *, in_context: bool = False) -> QueryObject:
    """A query object; its scene graph and context, which it points into, are kept."""
    context = scene_graph.CreateDefaultContext()
    if in_context:
        add_renderer(scene_graph, context=context)
        add_renderer(scene_graph, context=context)
    KEPT.append((scene_graph, context))
    return scene_graph.get_query_output_port().Eval(context)


KEPT: list[object] = []


def test_corners_are_those_of_the_boxes_in_the_world() -> None:
    corners = corner_points(query(make_scene()))
    assert corners.shape == (16, 3)
    np.testing.assert_allclose(corners.min(axis=0), [-0.5, -0.5, -0.5], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [2.5, 4.0, 0.5], atol=1e-12)
    assert corner_points(query(make_scene()), models=["other"]).shape == (0, 3)


@pytest.mark.render
@pytest.mark.parametrize("in_context", [False, True])
def test_the_picture_shows_the_scene(in_context: bool) -> None:
    scene_graph = make_scene()
    if not in_context:
        add_renderer(scene_graph, background=(0.0, 1.0, 0.0))
        add_renderer(scene_graph)  # a second time does nothing
    picture = render_view(
        query(scene_graph, in_context=in_context),
        look_at([2.0, -6.0, 0.0], [2.0, 0.0, 0.0]),
        size=(64, 48),
        field_of_view=math.radians(20.0),
    )
    assert picture.shape == (48, 64, 3)
    assert picture.dtype == np.uint8
    red, green, blue = picture[24, 32].astype(int)
    assert red > 60, "lit from the side"
    assert max(green, blue) < 20
    corner = picture[1, 1]
    np.testing.assert_array_equal(corner, picture[-2, 1])
    if not in_context:
        np.testing.assert_array_equal(corner, [0, 255, 0])
    # The cube's near face, 5.5 m away, fills 1 / (2 * 5.5 * tan(10 deg)) of the height.
    rows = np.flatnonzero((picture[:, 32].astype(int) - corner)[:, 0] != 0)
    share = 1.0 / (2.0 * 5.5 * math.tan(math.radians(10.0)))
    assert abs(np.ptp(rows) + 1 - 48 * share) <= 2.0


@pytest.mark.render
def test_depth_is_the_distance_along_the_view() -> None:
    scene_graph = make_scene()
    add_renderer(scene_graph)
    depth = render_depth(
        query(scene_graph),
        look_at([2.0, -6.0, 0.0], [2.0, 0.0, 0.0]),
        size=(64, 48),
        field_of_view=math.radians(20.0),
    )
    assert depth.shape == (48, 64)
    # The cube's near face is 5.5 m away, square to the view; VTK's depth buffer has 24 bits.
    assert abs(depth[24, 32] - 5.5) < 1e-3
    assert np.isinf(depth[1, 1])


@pytest.mark.render
def test_a_fitted_view_cuts_nothing_off() -> None:
    scene_graph = make_scene()
    add_renderer(scene_graph, background=(0.0, 1.0, 0.0))
    look = query(scene_graph)
    X_WC = fit_view(corner_points(look), [0.3, 1.0, -0.5], size=(64, 48))
    picture = render_view(look, X_WC, size=(64, 48))
    background = np.all(picture == [0, 255, 0], axis=2)
    assert background[[0, -1]].all()
    assert background[:, [0, -1]].all()
    assert not background.all()


def test_a_picture_reads_back_and_has_the_same_bytes(tmp_path: Path) -> None:
    picture: NDArray[np.uint8] = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
    save_png(picture, tmp_path / "a.png")
    save_png(picture, tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    back = np.round(matplotlib.image.imread(tmp_path / "a.png")[:, :, :3] * 255.0)
    np.testing.assert_array_equal(back, picture)
