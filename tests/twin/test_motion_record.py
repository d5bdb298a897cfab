"""A recorded motion: knots that were steps, and a deviation that holds every step between them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

from pips_drake.twin.motion_record import MotionRecorder

STEP = 1.0 / 64.0


class Waving(LeafSystem):
    """Two positions and two velocities that are functions of the time, with steps of `STEP`."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclareVectorOutputPort("state", 4, self._calc_state)
        self.DeclarePeriodicDiscreteUpdateEvent(STEP, 0.0, lambda context, values: None)

    def _calc_state(self, context: Context, output: BasicVector) -> None:
        t = context.get_time()
        output.SetFromVector([wave(t), 3.0 * t, 7.0, 7.0])


def wave(t):
    return 0.4 * np.sin(2.0 * np.pi * t)


def record(duration, stride, strides_of=0.25):
    return recorded(duration, stride, strides_of).motion()


def recorded(duration, stride, strides_of=0.25, recent=0.0, freeze_at=math.inf):
    builder = DiagramBuilder()
    system = builder.AddSystem(Waving())
    recorder = MotionRecorder(
        builder, system.get_output_port(), positions=2, stride=stride, recent=recent
    )
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.Initialize()
    done = 0.0
    while done < duration:
        done = min(done + strides_of, duration)
        simulator.AdvanceTo(done)
        recorder.collect(simulator.get_mutable_context())
        if done >= freeze_at:
            recorder.freeze()
    return recorder


@pytest.mark.parametrize("stride", [1, 4, 7, 1000])
@pytest.mark.parametrize("strides_of", [STEP, 0.25, 0.3])
def test_every_step_lies_within_the_deviation_of_the_knots(stride, strides_of):
    motion = record(2.0, stride, strides_of)
    assert motion.times[0] == 0.0
    assert motion.times[-1] == 2.0
    assert np.all(np.diff(motion.times) > 0.0)
    np.testing.assert_allclose(motion.positions[:, 0], wave(motion.times), rtol=0, atol=1e-15)
    t = np.arange(129) * STEP
    found = np.column_stack([wave(t), 3.0 * t])
    straight = np.column_stack(
        [np.interp(t, motion.times, motion.positions[:, k]) for k in range(2)]
    )
    off = np.abs(found - straight).max(axis=0)
    # It is the largest of them, not only a bound; at a stride of one there is none.
    np.testing.assert_allclose(motion.deviation, off, rtol=0, atol=1e-14)
    if stride == 1:
        np.testing.assert_allclose(motion.deviation, 0.0, rtol=0, atol=1e-17)


def test_knots_are_a_stride_of_steps_apart_and_the_end_is_kept():
    motion = record(1.0 + 3 * STEP, 8, 1.0 + 3 * STEP)
    np.testing.assert_allclose(np.diff(motion.times)[:-1], 8 * STEP, rtol=0, atol=1e-15)
    assert motion.times[-1] == 1.0 + 3 * STEP


def test_a_run_that_never_moved_on_is_one_knot():
    builder = DiagramBuilder()
    system = builder.AddSystem(Waving())
    recorder = MotionRecorder(builder, system.get_output_port(), positions=2, stride=4)
    simulator = Simulator(builder.Build())
    simulator.Initialize()
    recorder.collect(simulator.get_mutable_context())
    motion = recorder.motion()
    assert len(motion.times) <= 1


def test_all_steps_are_kept_if_asked_for():
    steps = recorded(2.0, 4, recent=math.inf, freeze_at=0.5).steps()
    np.testing.assert_array_equal(steps.times, np.arange(129) * STEP)
    expected = np.column_stack([wave(steps.times), 3.0 * steps.times])
    np.testing.assert_array_equal(steps.states[:, :2], expected)
    assert np.all(steps.states[:, 2:] == 7.0)


@pytest.mark.parametrize(("freeze_at", "last"), [(math.inf, 2.0), (1.0, 1.0)])
def test_the_latest_steps_are_kept_until_they_are_frozen(freeze_at, last):
    steps = recorded(2.0, 4, recent=0.4, freeze_at=freeze_at).steps()
    assert steps.times[-1] == last
    # What is asked for, and at most one look (0.25 s) more.
    assert last - 0.65 - STEP <= steps.times[0] <= last - 0.4
    assert np.all(np.diff(steps.times) == STEP), "none is missing"
