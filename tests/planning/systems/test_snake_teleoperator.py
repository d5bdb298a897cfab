"""The operator's hand as a system: ports, state that can be cloned, joints that are continuous."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common.value import Value
from pydrake.geometry import Sphere
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from pips_drake.errors import InputError
from pips_drake.planning.extension import Extending
from pips_drake.planning.live_snake import Wish
from pips_drake.planning.live_state import LiveArmSettings
from pips_drake.planning.systems.snake_teleoperator import STATUS, SnakeTeleoperator
from pips_drake.scene.signed_distance import PlacedShape
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.motion_words import EXTEND, EXTENDING, HOLD, RETRACT, RETRACTING

from ..corridor import along_the_corridor, home_tip, live_arm

PERIOD = 1.0 / 32.0


@pytest.fixture(scope="module")
def arm():
    return load_arm("cmu_92")


@pytest.fixture(scope="module")
def live(arm):
    settings = LiveArmSettings(tip_speed=0.09, tip_acceleration=0.5)
    return live_arm(arm, settings=settings)


@pytest.fixture(scope="module")
def start(live, arm):
    return live.lay(along_the_corridor(arm, 1.5), extended=0.5)


@pytest.fixture
def system(live, start):
    return SnakeTeleoperator(live, start)


def output(system, context, name):
    return system.GetOutputPort(name).Eval(context)


def test_ports_have_the_documented_sizes_and_no_feedthrough(system, arm):
    sizes = {"joint_state": 2 * arm.joints, "tip": 2, "phase": 1, "status": len(STATUS)}
    for name, size in sizes.items():
        assert system.GetOutputPort(name).size() == size
    assert not system.HasAnyDirectFeedthrough()


def test_left_alone_it_does_what_the_arm_on_the_snake_does(system, live, start):
    simulator = Simulator(system)
    simulator.AdvanceTo(1.0 - 0.5 * PERIOD)
    state = start
    for _ in range(32):
        state = live.tick(state, Wish())
    found = system.live_state(simulator.get_context())
    assert_allclose(found.joints, state.joints, rtol=0, atol=0)
    tip = output(system, simulator.get_context(), "tip")
    assert_allclose(tip, [state.tip, state.tip_rate], rtol=0, atol=0)
    status = dict(zip(STATUS, output(system, simulator.get_context(), "status"), strict=True))
    assert status["extending"] == Extending.OUT and status["near_rest"] == 1.0
    assert status["to_the_end_m"] == pytest.approx(state.path.length - state.tip)
    path = output(system, simulator.get_context(), "tip_path")
    tip_point = kinematics.spine_points(live.arm, state.joints)[0, -1]
    assert_allclose(path.point(tip[0]), tip_point, rtol=0, atol=1e-9)
    snake = output(system, simulator.get_context(), "snake")
    assert_allclose(snake.points[-1], state.live.snake.points[-1], rtol=0, atol=0)


def test_joints_go_straight_between_updates_and_rates_are_their_own(system, live):
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("command").FixValue(context, [EXTEND])
    system.GetInputPort("goal").FixValue(context, home_tip(live.arm) + np.array([0.03, 0.2, 1.4]))
    joints, rates, step = [], [], PERIOD / 4.0
    for k in range(129):
        simulator.AdvanceTo(k * step)
        q, v = np.split(output(system, context, "joint_state"), 2)
        joints.append(q)
        rates.append(v)
    changes = np.diff(np.array(joints), axis=0)
    # Left by an update are the rates until the next one; AdvanceTo stops before its updates.
    for k in range(0, 124, 4):
        for part in range(1, 4):
            assert_allclose(changes[k + part], rates[k + part] * step, rtol=0, atol=1e-12)
    assert np.abs(changes[:, 0]).max() <= 0.09 * step * 1.01
    assert np.abs(changes).max() > 0.0


def test_a_cloned_context_goes_on_alike_and_by_itself(system):
    simulator = Simulator(system)
    simulator.AdvanceTo(0.5)
    other = Simulator(system, simulator.get_context().Clone())
    simulator.AdvanceTo(1.0)
    before = system.live_state(other.get_context()).tip
    assert before < system.live_state(simulator.get_context()).tip
    other.Initialize()
    other.AdvanceTo(1.0)
    assert_allclose(
        output(system, other.get_context(), "joint_state"),
        output(system, simulator.get_context(), "joint_state"),
        rtol=0,
        atol=0,
    )


def test_words_nails_pulls_weights_and_reach_arrive(system, live, arm):
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    tip = home_tip(arm)
    place = tip + np.array([0.0, 0.1, 1.0])
    system.GetInputPort("nails").FixValue(context, Value[object](place[None]))
    system.GetInputPort("tension").FixValue(context, [2.5])
    system.GetInputPort("bending_stiffness").FixValue(context, [0.7])
    system.GetInputPort("pull").FixValue(context, [*tip, 0.0, 0.0, 0.0])
    system.GetInputPort("reach").FixValue(context, [0.2])
    assert output(system, context, "phase")[0] == EXTENDING
    simulator.AdvanceTo(0.25)
    state = system.live_state(context)
    assert_allclose(state.live.nails, place[None], rtol=0, atol=0)
    assert set(state.live.snake.tension) == {2.5}
    assert set(state.live.snake.bending_stiffness) == {0.7}
    # It stood out farther than it may.
    assert state.extending == Extending.BACK
    assert output(system, context, "phase")[0] == RETRACTING
    system.GetInputPort("command").FixValue(context, [HOLD])
    simulator.AdvanceTo(1.5)
    held = system.live_state(context)
    assert held.extending == Extending.HELD and not held.rates.any()
    system.GetInputPort("command").FixValue(context, [RETRACT])
    simulator.AdvanceTo(2.0)
    assert system.live_state(context).tip < held.tip


def test_a_share_of_the_speed_is_one_of_the_tips(system):
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("speed_share").FixValue(context, [0.25])
    simulator.AdvanceTo(1.0)
    assert output(system, context, "tip")[1] == pytest.approx(0.25 * 0.09)


@pytest.mark.parametrize(
    ("port", "value", "words"),
    [
        ("goal", [math.nan, 0.0, 0.0], "operator's goal = "),
        ("command", [5.0], r"operator's word = 5\.0; must be 1 \(run\)"),
        ("speed_share", [0.0], r"speed_share = 0\.0; must be > 0 and <= 1"),
        ("nails", Value[object]("here"), r"nails = 'here'; must be \(K, 3\), m"),
    ],
)
def test_bad_inputs_say_what_is_wrong(system, port, value, words):
    simulator = Simulator(system)
    system.GetInputPort(port).FixValue(simulator.get_mutable_context(), value)
    with pytest.raises(InputError, match=words):
        simulator.AdvanceTo(PERIOD)


def test_obstacles_that_are_placed_while_it_runs_push_the_snake_and_keep_the_arm_clear(
    system, live, start
):
    # A ball against the wall, 0.3 m beside the middle of what the arm has yet to pass.
    middle = start.live.snake.points[len(start.live.snake.points) * 3 // 4]
    ball = PlacedShape("ball", "", Sphere(0.1), RigidTransform(middle + np.array([0.0, 0.3, 0.0])))
    placed = live.obstacles.with_shapes([ball])
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    port = system.GetInputPort("obstacles")
    port.FixValue(context, Value[object](placed))
    simulator.AdvanceTo(3.0)
    moved = system.live_state(context)
    assert moved.clearance >= live.settings.clearance
    aside = moved.live.snake.points[:, 1].min()
    # Pushed away from the ball, by more than the points' own rest.
    assert aside < start.live.snake.points[:, 1].min() - 0.01
    assert placed.distances(moved.live.snake.points).min() > 0.2
    # Removed, it lets the snake come back.
    port.FixValue(context, Value[object](live.obstacles))
    simulator.AdvanceTo(6.0)
    back = system.live_state(context).live.snake.points
    assert back[:, 1].min() > aside + 0.005


def test_obstacles_that_are_none_are_refused(system):
    simulator = Simulator(system)
    system.GetInputPort("obstacles").FixValue(
        simulator.get_mutable_context(), Value[object]("a ball")
    )
    with pytest.raises(InputError, match=r"obstacles = str; must be a SignedDistanceField"):
        simulator.AdvanceTo(0.1)
