"""A tick of teleoperation: the operator's snake, and the arm fitted to it and judged."""

from __future__ import annotations

import math
import time

import numpy as np
from pydrake.systems.analysis import Simulator

from benchmarks.measuring import Array, Line
from pips_drake.planning.live_arm import LiveArm
from pips_drake.planning.live_snake import LiveSnakeSettings
from pips_drake.planning.live_state import LiveArmSettings, LiveState
from pips_drake.planning.snake import SnakeSettings
from pips_drake.planning.systems.snake_teleoperator import SnakeTeleoperator
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import read_distance_field
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.motion_words import EXTEND

#: Points of the snake, its length, and how far out along it the arm is, m.
POINTS, LENGTH, EXTENDED = 200, 8.0, 6.0
#: Before the cargo bay's port, in the scene's frame, m.
HOME_TIP = np.array([0.412877, 0.0, 4.4425])
#: As long as one of 30 pictures a second is shown, ms; and what is aimed for.
LIMIT, AIM = 33.0, 10.0


def measure(*, quick: bool) -> list[Line]:
    """Milliseconds: the 95th percentile of the ticks of each round."""
    ticks, rounds = (10, 2) if quick else (500, 5)
    live, start = make_live_arm()
    made = [np.sort(1e3 * tick_times(live, start, ticks)) for _ in range(rounds + 1)][1:]
    worst = np.array([float(np.quantile(times, 0.95)) for times in made])
    every = np.concatenate(made)
    return [
        Line(
            name="teleoperation_tick",
            what=f"A tick of teleoperation in the cargo bay, {len(start.live.snake.points)} "
            f"points, {live.arm.modules + 1} links, the goal moving: 95th percentile of "
            f"{ticks} ticks",
            ours=worst,
            unit="ms",
            value_aim=AIM,
            limits="Distances of the snake's points and of the arm to 84 shapes are half of it",
            agreement={
                "median (ms)": float(np.median(every)),
                "longest (ms)": float(every.max()),
                "beyond 33 ms": float((every > LIMIT).sum()),
            },
        )
    ]


def make_live_arm() -> tuple[LiveArm, LiveState]:
    """CMU-92's arm in the cargo bay's gap, on a snake of 200 points."""
    arm = load_arm("cmu_92")
    shift = float(HOME_TIP[2] - kinematics.spine_points(arm, arm.joint_home)[0, -1, 2])
    snake = SnakeSettings(bending_stiffness=0.3, spacing=LENGTH / (POINTS - 1) * (1.0 + 1e-9))
    live = LiveArm(
        arm,
        read_distance_field(find_scene_file("cargo_bay")),
        rail_shift=shift,
        settings=LiveArmSettings(snake=LiveSnakeSettings(snake=snake)),
    )
    path = HOME_TIP + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, LENGTH]])
    return live, live.lay(path, extended=EXTENDED, settled=True)


def tick_times(live: LiveArm, start: LiveState, ticks: int) -> Array:
    """Processor seconds of each tick, (ticks,), with all that Drake does besides.

    The goal goes around a circle across the gap in 10 s; what is between goal and arm follows.
    """
    system = SnakeTeleoperator(live, start)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("command").FixValue(context, [EXTEND])
    joints, period = system.GetOutputPort("joint_state"), live.settings.period
    simulator.Initialize()
    times = np.empty(ticks)
    for k in range(ticks):
        angle = 2.0 * math.pi * k * period / 10.0
        goal = start.live.goal + 0.08 * np.array([0.0, math.sin(angle), 1.0 - math.cos(angle)])
        system.GetInputPort("goal").FixValue(context, goal)
        began = time.thread_time()
        simulator.AdvanceTo((k + 1) * period)
        joints.Eval(context)
        times[k] = time.thread_time() - began
    moved = system.live_state(context)
    # What stood still would cost less.
    if ticks > 100 and np.linalg.norm(moved.joints - start.joints) == 0.0:
        raise RuntimeError("the arm has not moved")
    return times
