"""The cargo bay: as large as said, closed but for its port, and a gap that an arm fits into."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.math import RigidTransform

from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import read_distance_field
from pips_drake.twin.model_viewer import view_model

FOOT = 0.3048
RADIUS, LENGTH = 7.5 * FOOT, 60.0 * FOOT
PAYLOAD_RADIUS, PAYLOAD_LENGTH = 1.79, 50.0 * FOOT


@pytest.fixture(scope="module")
def field():
    """The scene in the bay's own frame."""
    X_FB = RigidTransform([-1.621, 0.0, 4.695])
    return read_distance_field(
        find_scene_file("cargo_bay"), placed_frames={"frame_0": X_FB.inverse()}
    )


@pytest.fixture(scope="module")
def bare(field):
    return field.without_body("obstacles::obstacles").without_body("payload::payload")


def at(around, out, along):
    around, out, along = np.broadcast_arrays(around, out, along)
    return np.column_stack([out * np.cos(around), out * np.sin(around), along])


def test_bay_is_a_cylinder_of_60_by_15_feet_less_what_its_flat_staves_take(bare):
    """On the axis the wall is an apothem away, the bulkheads half the length."""
    apothem = RADIUS * np.cos(np.pi / 36.0)
    assert bare.distances([[0.0, 0.0, 0.5 * LENGTH]])[0] == pytest.approx(apothem, abs=1e-8)
    for along in (1.0, LENGTH - 1.0):
        assert bare.distances([[0.0, 0.0, along]])[0] == pytest.approx(1.0, abs=1e-8)
    around = np.radians(10.0 * np.arange(36) + 5.0)
    # SDF poses have 9 digits.
    edges = bare.distances(at(around, RADIUS, 5.0))
    np.testing.assert_allclose(edges, 0.0, atol=1e-7)


def test_wall_and_bulkheads_have_no_hole_but_the_port(bare):
    around = np.radians(np.arange(0.0, 360.0, 0.5))
    for along in (0.01, 5.0, LENGTH - 0.01):
        assert (bare.distances(at(around, RADIUS + 0.02, along)) < 0.0).all()
    for out in np.linspace(0.0, RADIUS, 60):
        assert (bare.distances(at(around, out, LENGTH + 0.025)) < 0.0).all()
        solid = bare.distances(at(around, out, -0.025)) < 0.0
        if out < PAYLOAD_RADIUS:
            assert solid.all()
        else:
            degrees = (np.degrees(around) + 180.0) % 360.0 - 180.0
            assert not solid[np.abs(degrees) < 13.0].any()
            assert solid[np.abs(degrees) > 15.5].all()


def test_gap_between_payload_and_wall_is_about_half_a_metre(field):
    """Halfway between the two, where no obstacle is near."""
    face = RADIUS * np.cos(np.pi / 36.0)
    middle = 0.5 * (PAYLOAD_RADIUS + face)
    free = field.distances(at(0.0, middle, [2.5, 15.0]))
    np.testing.assert_allclose(free, 0.5 * (face - PAYLOAD_RADIUS), atol=1e-8)
    assert 0.48 < face - PAYLOAD_RADIUS < RADIUS - PAYLOAD_RADIUS < 0.5


def test_prototypes_tip_enters_the_port_in_its_middle(field):
    """Straight ahead of the home tip (x0 = 16.25 in): an arm of 0.23 m square fits in."""
    out = 1.621 + 16.2549018 * 0.0254
    along = np.linspace(-0.5, 0.5, 201)
    assert field.distances(at(0.0, out, along)).min() > 0.5 * np.hypot(0.2286, 0.2286)
    nearest = field.nearest(at(0.0, out, [-0.025]))
    assert field.shapes[nearest.indices[0]].body in ("bay::bay", "payload::payload")


def test_every_obstacle_is_in_the_gap_and_some_close_it(field):
    obstacles = [placed for placed in field.shapes if placed.body == "obstacles::obstacles"]
    assert len(obstacles) == 7
    for placed in obstacles:
        out = np.hypot(*placed.X_WG.translation()[:2])
        assert PAYLOAD_RADIUS < out < RADIUS
        assert 0.0 < placed.X_WG.translation()[2] < LENGTH
    # Across the whole gap, from the payload's surface to the wall.
    out = np.linspace(PAYLOAD_RADIUS + 1e-3, RADIUS, 50)
    for around, along in ((125.0, 9.0), (165.0, 6.0), (90.0, 4.144), (180.0, 9.144)):
        assert (field.distances(at(np.radians(around), out, along)) < 0.0).all()


def test_scene_can_be_viewed():
    view_model("cargo_bay", once=True)
