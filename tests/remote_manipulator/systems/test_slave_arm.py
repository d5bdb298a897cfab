"""The slave arm's servo: a frame's straight way, a frame late, within the joints' rates."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.configuration import load_configuration
from pips_drake.remote_manipulator.drives import make_drives
from pips_drake.remote_manipulator.systems.slave_arm import SlaveArm

CONFIG = load_configuration()
FRAME, PERIOD = 0.05, 0.01
RATES = np.concatenate([make_drives(CONFIG).rate, np.full(3, CONFIG.orbiter.rate_m_s)])


class Program(LeafSystem):
    """Writes a set-point every frame into its state, as the collision program does."""

    def __init__(self, of_frame):
        super().__init__()
        self._of_frame = of_frame
        self._state = self.DeclareDiscreteState(11)
        self.DeclareStateOutputPort("setpoint", self._state)
        self.DeclareInitializationDiscreteUpdateEvent(self._write)
        self.DeclarePeriodicDiscreteUpdateEvent(FRAME, 0.0, self._write)

    def _write(self, context, values):
        values.get_mutable_vector(self._state).set_value(
            self._of_frame(round(context.get_time() / FRAME))
        )


def run(of_frame, duration, **arguments):
    """Times (N,), what the drives are sent to (N, 11) and how fast (N, 11), a row a period."""
    builder = DiagramBuilder()
    program = builder.AddSystem(Program(of_frame))
    slave = builder.AddSystem(SlaveArm(CONFIG, frame=FRAME, period=PERIOD, **arguments))
    builder.Connect(program.get_output_port(), slave.get_input_port())
    simulator = Simulator(builder.Build())
    simulator.Initialize()
    context = slave.GetMyContextFromRoot(simulator.get_context())
    rows = []
    for k in range(round(duration / PERIOD)):
        # Just before the next update: what holds during period k.
        simulator.AdvanceTo((k + 0.5) * PERIOD)
        arm = slave.GetOutputPort("arm_desired_state").Eval(context)
        orbiter = slave.GetOutputPort("orbiter_desired_state").Eval(context)
        rows.append(np.concatenate([arm[:8], orbiter[:3], arm[8:], orbiter[3:]]))
    rows = np.array(rows)
    return np.arange(len(rows)) * PERIOD, rows[:, :11], rows[:, 11:]


def test_standing_setpoint_is_kept():
    rest = np.linspace(0.1, 1.1, 11)
    _, where, rates = run(lambda k: rest, 0.3, start=rest)
    np.testing.assert_allclose(where, np.tile(rest, (len(where), 1)), atol=1e-15)
    np.testing.assert_array_equal(rates, 0.0)


def test_steady_motion_is_straight_and_one_frame_and_one_period_late():
    """At 0.8 of the rates: the drives are sent along the line, its rates with it."""
    speed = 0.8 * RATES
    times, where, rates = run(lambda k: speed * k * FRAME, 2.0)
    # Period k ends at times[k] + PERIOD; the frame written at t is reached at t + frame + period.
    expected = speed * (times[:, None] + PERIOD - FRAME - PERIOD)
    late = times > 0.2
    np.testing.assert_allclose(where[late], expected[late], atol=1e-12)
    np.testing.assert_allclose(rates[late], np.tile(speed, (late.sum(), 1)), atol=1e-12)


def test_a_leap_is_walked_at_the_limits_of_rate():
    goal = np.array([3.0, *np.full(6, 0.5), 0.4, 0.1, -0.1, 0.1])
    _, where, rates = run(lambda k: goal * (k > 0), 12.0)
    assert np.all(np.abs(rates) <= RATES * (1.0 + 1e-12))
    fastest = np.abs(rates).max(axis=0)
    np.testing.assert_allclose(fastest, RATES, rtol=1e-9)
    # 3 m at 0.06 m/s take longer than this, everything else has arrived.
    np.testing.assert_allclose(where[-1, 7:], goal[7:], atol=1e-12)
    assert where[-1, 0] == pytest.approx(0.06 * (12.0 - FRAME - PERIOD), abs=0.06 * 2 * PERIOD)
    # Rates are the differences of places.
    steps = np.diff(where, axis=0) / PERIOD
    np.testing.assert_allclose(steps, rates[1:], atol=1e-9)


def test_limited_acceleration_is_kept_and_brakes_in_time():
    limits = np.full(11, 0.01)
    goal = np.array([0.1, *np.full(6, 0.05), 0.05, 0.05, 0.0, 0.0])
    _, where, rates = run(lambda k: goal * (k > 0), 40.0, accelerations=limits)
    growth = np.diff(rates, axis=0) / PERIOD
    assert np.abs(growth).max() <= 0.01 * (1.0 + 1e-9)
    np.testing.assert_allclose(where[-1], goal, atol=1e-6)
    # While the frame's straight way stops at once, this goes on by v^2 / (2 a) at most.
    beyond = (where - goal).max(axis=0)
    assert np.all(beyond <= RATES**2 / (2.0 * 0.01) + 1e-9)


def test_placing_sends_it_there_at_rest():
    slave = SlaveArm(CONFIG)
    context = slave.CreateDefaultContext()
    place = np.linspace(0.0, 1.0, 11)
    slave.place(context, place)
    arm = slave.GetOutputPort("arm_desired_state").Eval(context)
    np.testing.assert_array_equal(arm, [*place[:8], *np.zeros(8)])
    orbiter = slave.GetOutputPort("orbiter_desired_state").Eval(context)
    np.testing.assert_array_equal(orbiter, [*place[8:], 0.0, 0.0, 0.0])


def test_no_output_feeds_through():
    assert not SlaveArm(CONFIG).HasAnyDirectFeedthrough()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"period": 0.03}, "must be a whole part of 0.05 s"),
        ({"accelerations": np.zeros(11)}, "positive numbers"),
        ({"accelerations": np.ones(8)}, "11 positive numbers"),
        ({"start": np.ones(8)}, r"must be \(11,\)"),
    ],
)
def test_bad_arguments_are_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        SlaveArm(CONFIG, **arguments)
