"""A goal and a direction to look in: a straight approach, nailed; the best where there is none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from pydrake.geometry import Box, Sphere
from pydrake.math import RigidTransform

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.planning.grid import Grid
from pips_drake.planning.line_of_sight import is_clear
from pips_drake.planning.occupancy import Occupancy
from pips_drake.planning.planner import PlannerSettings
from pips_drake.planning.potential_field import Repulsion
from pips_drake.planning.snake import SnakeSettings, make_snake, nail
from pips_drake.planning.snake_motion import settle
from pips_drake.planning.viewing import approach_along, find_viewing_path, look_angle, nail_tail
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import (
    PlacedShape,
    SignedDistanceField,
    read_distance_field,
)
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.anchoring import anchor_path
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.plan import make_plan
from pips_drake.serpentine.tip_path import blended_path

from .gap import ARM, FACE, bare_gap

LINK = 0.457


def field_of(**shapes):
    return SignedDistanceField.of(
        PlacedShape(name, "", shape, RigidTransform(place))
        for name, (shape, place) in shapes.items()
    )


@pytest.fixture(scope="module")
def room():
    """4 x 3 x 2 m with a ball at (2, 1.5, 1)."""
    grid = Grid(lower=[0.0, 0.0, 0.0], upper=[4.0, 3.0, 2.0], shape=(40, 30, 20))
    return Occupancy.of(field_of(ball=(Sphere(0.4), [2.0, 1.5, 1.0])), grid, ARM)


def test_a_clear_direction_is_arrived_along_by_the_last_link(room):
    goal, direction = np.array([3.4, 1.5, 1.0]), np.array([0.0, 2.0, -2.0])
    view = approach_along(room.field, goal, direction, length=LINK, radius=ARM)
    unit = direction / math.sqrt(8.0)
    assert view.off == 0.0
    assert view.possible
    assert view.blocked_by is None
    assert_allclose(view.approach, goal - LINK * unit, rtol=0, atol=1e-12)
    path = find_viewing_path(room, [0.4, 1.5, 1.0], view)
    assert_array_equal(path[-1], goal)
    assert_array_equal(path[-2], view.approach)
    assert is_clear(room.field, path, ARM - 1e-5)
    assert look_angle(path, view) == pytest.approx(0.0, abs=1e-7)


def test_a_nailed_tail_keeps_looking_where_a_free_snake_turns_away(room):
    """Free, stiffness carries the turn before the approach point into the last link."""
    goal = np.array([3.0, 1.5, 1.0])
    view = approach_along(room.field, goal, [0.0, 1.0, 0.0], length=LINK, radius=ARM)
    snake = make_snake(
        find_viewing_path(room, [0.4, 1.5, 1.0], view), SnakeSettings(bending_stiffness=0.1)
    )
    repulsion = Repulsion(strength=0.05, reach=0.3, clamp=0.03)
    free = settle(snake, room.field.to_bodies, repulsion)
    assert look_angle(free.snake.points, view) > math.radians(20.0)
    nailed = nail_tail(snake, view)
    tail = nailed.points[nailed.nailed][1:]
    assert_array_equal(tail[0], view.approach)
    kept = settle(nailed, room.field.to_bodies, repulsion)
    assert kept.stable
    # Rounding of the chord's root alone.
    assert look_angle(kept.snake.points, view) == pytest.approx(0.0, abs=1e-7)
    assert_array_equal(kept.snake.points[-len(tail) :], tail)
    assert_array_equal(kept.snake.points[-1], goal)
    assert (nailed.spacings[-len(tail) + 1 :] <= 0.1 + 1e-12).all()


def test_a_radial_look_in_a_gap_no_wider_than_a_link_is_off_by_what_the_wall_leaves(room):
    """The link's base must keep ARM from the wall: asin((FACE - ARM - g) / LINK) is the tilt."""
    field = bare_gap()
    for out in (1.95, 2.1):
        view = approach_along(
            field, [out, 0.0, 0.3], [-1.0, 0.0, 0.0], length=LINK, radius=ARM, within=1.05
        )
        tilt = math.asin((FACE - ARM - out) / LINK)
        # A clear piece may be 1e-5 m nearer, which is 1e-5 / 0.4 rad, and 1e-4 is searched to.
        assert view.off == pytest.approx(0.5 * math.pi - tilt, abs=3e-4)
        assert is_clear(field, [view.approach, view.goal], ARM - 1e-5)
        assert view.direction @ view.wanted == pytest.approx(math.cos(view.off))
        assert view.possible == (view.off <= 1.05)
        off = math.degrees(view.off)
        assert view.words.startswith(f"viewing direction is off by {off:.1f} deg, because wall (st")
        assert ("cannot make up for it" in view.words) == (view.off > 1.05)


def test_behind_a_ball_the_nearest_direction_touches_it():
    """The piece is a tangent of the ball grown by the arm: sin = (R + ARM) / D."""
    field = field_of(ball=(Sphere(0.1), [0.0, 0.0, -0.3]))
    view = approach_along(field, [0.0, 0.0, 0.0], [0.0, 0.0, 1.0], length=LINK, radius=ARM)
    assert view.blocked_by == "ball"
    assert view.off == pytest.approx(math.asin(0.2 / 0.3), abs=3e-4)
    assert not view.possible


def test_a_look_between_plates_uses_all_the_room():
    """Between plates 0.4 m apart, the goal in the middle: the tilt's sine is 0.1 / LINK."""
    plates = {
        f"plate_{n}": (Box(4.0, 4.0, 0.1), [0.0, 0.0, side * 0.25])
        for n, side in enumerate((-1, 1))
    }
    view = approach_along(
        field_of(**plates), [0.0, 0.0, 0.0], [0.0, 0.0, -1.0], length=LINK, radius=ARM
    )
    assert view.off == pytest.approx(0.5 * math.pi - math.asin(0.1 / LINK), abs=3e-4)
    assert view.blocked_by == "plate_1"


@pytest.mark.slow
@pytest.mark.parametrize(("spare", "degrees"), [(0.0, 1.0), (0.1, 1e-6)])
def test_the_arms_last_link_looks_there_when_it_follows_the_leader(spare, degrees):
    """In the bay, 45 deg across the gap: what the path's rounding takes of the piece is missing."""
    arm = load_arm("cmu_92")
    grid = Grid(
        lower=np.array([4.4, -math.pi, 1.5]),
        upper=np.array([14.0, math.pi, 2.28]),
        shape=(96, 128, 8),
        unfolded=True,
        origin=np.array([-1.621, 0.0, 0.0]),
    )
    field = read_distance_field(find_scene_file("cargo_bay"))
    occupancy = Occupancy.of(field, grid, 0.12)
    goal, tip, lead = [-1.621, 2.034, 12.2], [0.412877, 0.0, 4.4425], [0.412877, 0.0, 4.9425]
    link = float(arm.average_module_length[-1])
    view = approach_along(field, goal, [-1.0, 0.0, 1.0], length=link + spare, radius=0.12)
    assert view.off == 0.0
    settings = PlannerSettings()
    path = np.vstack([tip, find_viewing_path(occupancy, lead, view)])
    snake = nail_tail(nail(make_snake(path, settings.snake), lead), view)

    def distances(points):
        return field.blended(points, blend=settings.blend, within=settings.repulsion.reach)

    settled = settle(snake, distances, settings.repulsion)
    base = np.array(tip) - [0.0, 0.0, arm.average_module_length.sum()]
    points = np.vstack([base, settled.snake.points])
    plan = make_plan(arm, anchor_path(arm, blended_path(points, "looking"))[0])
    assert plan.followable, plan.failures
    spine = kinematics.spine_points(arm, plan.joints)[-1]
    last = (spine[-1] - spine[-2]) / np.linalg.norm(spine[-1] - spine[-2])
    off = math.degrees(math.atan2(np.linalg.norm(np.cross(last, view.wanted)), last @ view.wanted))
    assert off <= degrees


def test_what_cannot_be_looked_at_is_refused(room):
    def look(goal=(3.4, 1.5, 1.0), direction=(1.0, 0.0, 0.0), **given):
        return approach_along(
            room.field, goal, direction, **{"length": LINK, "radius": ARM, **given}
        )

    with pytest.raises(InputError, match=r"goal \(2.45, 1.5, 1\) m is 0.05 m from ball; must be"):
        look(goal=(2.45, 1.5, 1.0))
    with pytest.raises(InputError, match=r"viewing direction = \[0, 0, 0\]; must have a length"):
        look(direction=(0.0, 0.0, 0.0))
    with pytest.raises(InputError, match=r"viewing direction = \[nan, 0.0, 0.0\]; must be three"):
        look(direction=(math.nan, 0.0, 0.0))
    with pytest.raises(InputError, match=r"straight approach = 0.0 m; must be > 0"):
        look(length=0.0)
    with pytest.raises(InputError, match=r"within = -1.0 rad; must be 0 or more"):
        look(within=-1.0)
    cell = {
        f"side_{axis}_{side}": (Box(1.0, 1.0, 1.0), 0.7 * side * np.eye(3)[axis])
        for axis in range(3)
        for side in (-1, 1)
    }
    with pytest.raises(NotFollowableError, match=r"no straight approach of 0.457 m to the goal"):
        approach_along(field_of(**cell), [0.0, 0.0, 0.0], [1.0, 0, 0], length=LINK, radius=ARM)
    view = look()
    with pytest.raises(InputError, match=r"snake ends at .* must end at the goal \(3.4, 1.5, 1\)"):
        nail_tail(make_snake([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], SnakeSettings()), view)
    with pytest.raises(InputError, match=r"path is shorter than its straight end of 0.457 m"):
        look_angle([[3.3, 1.5, 1.0], [3.4, 1.5, 1.0]], view)
