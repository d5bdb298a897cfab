"""A run ends at its time, or when it says that it is over, and never with numbers that are none."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import AffineSystem

from pips_drake.twin.simulation import STRIDE, DivergedError, advance


def make(rate: float = 1.0) -> Simulator:
    """A state that grows by `rate` a second, a step each 1/16 s."""
    step = 1.0 / 16.0
    f0 = np.array([rate * step])
    one, none = np.ones((1, 1)), np.zeros((1, 0))
    system = AffineSystem(
        A=one, B=none, f0=f0, C=one, D=np.zeros((1, 0)), y0=np.zeros(1), time_period=step
    )
    return Simulator(system)


def test_a_run_ends_at_its_time_and_is_watched_on_the_way():
    simulator, times = make(), []
    run = advance(simulator, 0.6, watch=lambda context: times.append(context.get_time()))
    assert times == [STRIDE, 2.0 * STRIDE, 0.6]
    assert run.simulated_s == simulator.get_context().get_time() == 0.6
    assert run.real_time_rate == 0.6 / run.wall_s


def test_a_run_that_is_over_ends_before_its_time():
    run = advance(make(), 10.0, finished=lambda context: context.get_time() >= 1.0)
    assert run.simulated_s == 1.0


@pytest.mark.parametrize(("over", "end"), [(1.9, 2.1), (99.0, 3.0)])
def test_a_run_that_is_not_over_goes_on_to_its_latest_end(over, end):
    # Strides are counted from 1.1 s on.
    run = advance(make(), 1.1, finished=lambda context: context.get_time() >= over, latest=3.0)
    assert run.simulated_s == pytest.approx(end, abs=1e-12)


def test_a_run_that_says_nothing_does_not_go_on():
    assert advance(make(), 1.0, latest=3.0).simulated_s == 1.0
    assert advance(make(), 1.0, finished=lambda context: False).simulated_s == 1.0


def test_a_state_that_is_no_number_ends_the_run():
    with pytest.raises(DivergedError, match=r"not finite at 0\.250 s") as caught:
        advance(make(np.inf), 1.0)
    assert caught.value.time == 0.25
