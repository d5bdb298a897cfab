"""The tip runs out, dwells and comes back on the profile; commands stop and turn it smoothly."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from pips_drake.errors import InputError
from pips_drake.serpentine.motion_profile import RestToRestProfile
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.systems.tip_path_source import (
    DONE,
    DWELLING,
    EXTEND,
    EXTENDING,
    HOLD,
    RETRACT,
    RETRACTING,
    RUN,
    TipPathSource,
)

PERIOD = 1.0 / 64.0
SPEED = 0.25
RAMP = 0.5
# Steepest ramp of 3 x^2 - 2 x^3: 1.5 speed / ramp.
ACCELERATION = 1.5 * SPEED / RAMP
# Sums of powers of two are exact; what is left are roundings of arc lengths of some metres.
ROUNDING = 1e-14


@pytest.fixture(scope="module")
def path():
    return load_path("trajectory_4_arcs")


@pytest.fixture(scope="module")
def profile(path):
    return RestToRestProfile.make(travel=path.travel, speed=SPEED, ramp=RAMP)


def run(source, duration, commands=()):
    """Samples (N, 4) every period: time, arc length, rate, phase; `commands` are (time, word)."""
    simulator = Simulator(source)
    context = simulator.get_mutable_context()
    port = source.GetInputPort("command")
    simulator.Initialize()
    rows, pending = [], list(commands)
    for k in range(int(np.ceil(duration / PERIOD)) + 1):
        # Midway between updates, so that no sample stands on an update's own instant.
        simulator.AdvanceTo((k + 0.5) * PERIOD)
        tip, phase = source.GetOutputPort("tip").Eval(context), source.GetOutputPort("phase")
        rows.append([context.get_time(), *tip, phase.Eval(context)[0]])
        while pending and pending[0][0] <= context.get_time():
            port.FixValue(context, [pending.pop(0)[1]])
    return np.array(rows)


def assert_continuous(rows):
    """Arc lengths change by the mean of the rates at both ends, and those by the ramps alone."""
    steps, rates = np.diff(rows[:, 1]), rows[:, 2]
    # The trapezium rule's error is s''' dt^3 / 12. s''' is at most 6 speed / ramp^2 from the
    # profile, and during a hold's ramp (1 s) up to 3 acceleration / 1 s more: below
    # 12 speed / ramp^2 here.
    bound = 12.0 * SPEED / RAMP**2 * PERIOD**3 / 12.0
    np.testing.assert_allclose(steps, 0.5 * (rates[1:] + rates[:-1]) * PERIOD, rtol=0, atol=bound)
    # Rate = profile's speed times the clock's: both change, by at most these.
    assert np.abs(np.diff(rates)).max() <= (ACCELERATION + SPEED / 1.0) * PERIOD + ROUNDING
    assert np.abs(rates).max() <= SPEED + ROUNDING


def test_ports(path, profile, port_sizes):
    inputs, outputs = port_sizes(TipPathSource(path, profile))
    assert inputs == {"command": 1, "speed_share": 1}
    assert outputs == {"tip": 2, "path": 0, "phase": 1}


def test_no_output_has_feedthrough(path, profile):
    assert not TipPathSource(path, profile).HasAnyDirectFeedthrough()


def test_the_path_output_is_the_path_itself(path, profile):
    source = TipPathSource(path, profile)
    assert source.GetOutputPort("path").Eval(source.CreateDefaultContext()) is path


def test_the_tip_starts_at_rest_at_home(path, profile):
    source = TipPathSource(path, profile)
    context = source.CreateDefaultContext()
    np.testing.assert_array_equal(
        source.GetOutputPort("tip").Eval(context), [path.home_arc_length, 0.0]
    )
    assert source.GetOutputPort("phase").Eval(context)[0] == EXTENDING


def test_out_dwell_and_back_take_their_time(path, profile):
    dwell = 1.25
    source = TipPathSource(path, profile, dwell=dwell)
    rows = run(source, source.duration + 0.5)
    phases = rows[:, 3]
    count = {phase: np.sum(phases == phase) for phase in (EXTENDING, DWELLING, RETRACTING)}
    # The clock stands at whole periods; the last one of each way may be a part. The update at
    # time 0 takes the first one before the first sample, so a way out shows one sample less.
    way = int(np.ceil(profile.duration / PERIOD))
    assert count == {EXTENDING: way - 1, DWELLING: dwell / PERIOD, RETRACTING: way - 1}
    first_done = rows[np.argmax(phases == DONE), 0]
    assert source.duration - PERIOD <= first_done <= source.duration + 2.0 * PERIOD
    assert_continuous(rows)
    assert rows[:, 1].max() == path.length
    np.testing.assert_array_equal(rows[-1, 1:3], [path.home_arc_length, 0.0])


def test_the_tip_moves_as_the_profile_says(path, profile):
    rows = run(TipPathSource(path, profile), profile.duration - 0.1)
    # State at the sample's period: one update at time 0, then one each period.
    clock = PERIOD * (1.0 + np.arange(len(rows)))
    expected = np.array([profile(time) for time in clock])
    np.testing.assert_allclose(
        rows[:, 1] - path.home_arc_length, expected[:, 0], rtol=0, atol=ROUNDING
    )
    np.testing.assert_array_equal(rows[:, 2], expected[:, 1])


def test_without_retraction_it_is_done_at_the_end_whatever_the_dwell(path, profile):
    source = TipPathSource(path, profile, dwell=60.0, retract=False)
    assert source.duration == profile.duration
    rows = run(source, source.duration + 1.0)
    np.testing.assert_array_equal(rows[-1, 1:], [path.length, 0.0, DONE])
    assert not (rows[:, 3] == DWELLING).any()


@pytest.mark.parametrize("ramp", [0.25, 1.0])
def test_a_hold_comes_to_rest_within_its_ramp(path, profile, ramp):
    source = TipPathSource(path, profile, hold_ramp=ramp)
    rows = run(source, 6.0, [(3.0, HOLD)])
    held = rows[:, 0] > 3.0 + PERIOD + ramp
    assert np.all(rows[held, 2] == 0.0)
    assert np.ptp(rows[held, 1]) == 0.0
    assert np.all(rows[:, 3] == EXTENDING)
    # At full speed the clock's straight ramp takes half of what the speed would have made of it;
    # the sum over updates is the trapezium's, which is exact for a straight ramp.
    start = rows[rows[:, 0] <= 3.0 + PERIOD][-1, 1]
    assert rows[-1, 1] - start == pytest.approx(0.5 * SPEED * ramp, abs=ROUNDING)


def test_hold_resume_and_retract_keep_the_arc_length_continuous(path, profile):
    # In the profile's first ramp, at full speed, and a resume before the hold has come to rest.
    commands = [(0.2, HOLD), (1.4, RUN), (3.0, HOLD), (4.5, RUN), (5.0, HOLD), (5.25, RUN)]
    commands.append((7.0, RETRACT))
    rows = run(TipPathSource(path, profile), 14.0, commands)
    assert_continuous(rows)
    np.testing.assert_array_equal(rows[-1, 1:], [path.home_arc_length, 0.0, DONE])


def test_a_hold_and_a_resume_end_where_an_undisturbed_run_does(path, profile):
    rows = run(TipPathSource(path, profile, retract=False), 15.0, [(2.0, HOLD), (5.0, RUN)])
    np.testing.assert_array_equal(rows[-1, 1:], [path.length, 0.0, DONE])
    # Half a second is lost in each ramp of 1 s, and the 2 s between them.
    late = rows[np.argmax(rows[:, 3] == DONE), 0] - profile.duration
    assert late == pytest.approx(3.0, abs=2.0 * PERIOD)


def test_a_hold_from_the_beginning_does_not_move_the_tip(path, profile):
    source = TipPathSource(path, profile)
    simulator = Simulator(source)
    source.GetInputPort("command").FixValue(simulator.get_mutable_context(), [HOLD])
    simulator.AdvanceTo(2.0)
    tip = source.GetOutputPort("tip").Eval(simulator.get_context())
    np.testing.assert_array_equal(tip, [path.home_arc_length, 0.0])


def test_a_hold_stops_the_dwell(path, profile):
    arrival = np.ceil(profile.duration)
    source = TipPathSource(path, profile, dwell=2.0)
    rows = run(source, arrival + 6.0, [(arrival, HOLD), (arrival + 3.0, RUN)])
    left = rows[np.argmax(rows[:, 3] == RETRACTING), 0]
    assert left == pytest.approx(profile.duration + 2.0 + 3.0, abs=3.0 * PERIOD)


def test_retraction_from_half_way_goes_back_over_the_same_points_at_the_same_speeds(path, profile):
    rows = run(TipPathSource(path, profile), 9.0, [(3.0, HOLD), (4.5, RETRACT)])
    back = rows[rows[:, 3] == RETRACTING]
    assert np.all(np.diff(back[:, 1]) <= 0.0)
    full = back[back[:, 2] < -SPEED + 1e-9]
    assert len(full) > 10
    # At the same place on the profile the same speed: the last ramp is the first one, mirrored.
    out = np.array([profile(t) for t in np.linspace(0.0, RAMP, 4001)])
    ramp = back[back[:, 1] < path.home_arc_length + 0.5 * SPEED * RAMP]
    # Linear interpolation of speed against travel; near rest speed goes as travel^(2/3), so the
    # error there is that of a step: below 1e-3 of the speed.
    expected = np.interp(ramp[:, 1] - path.home_arc_length, out[:, 0], out[:, 1])
    np.testing.assert_allclose(-ramp[:, 2], expected, rtol=0, atol=1e-3 * SPEED)


def test_run_after_retract_goes_on_with_the_way_back(path, profile):
    rows = run(TipPathSource(path, profile), 9.0, [(2.0, RETRACT), (2.5, RUN)])
    np.testing.assert_array_equal(rows[-1, 1:], [path.home_arc_length, 0.0, DONE])


@pytest.mark.parametrize("turned", [2.25, 3.5, 8.0], ids=["at once", "on the way", "at home"])
def test_extend_after_retract_is_the_way_out_again_without_a_jump(path, profile, turned):
    commands = [(2.0, RETRACT), (turned, EXTEND), (turned + 0.25, RUN)]
    end = turned + profile.duration + 1.0
    rows = run(TipPathSource(path, profile, dwell=60.0), end, commands)
    assert_continuous(rows)
    arrived = [path.home_arc_length + path.travel, 0.0, DWELLING]
    np.testing.assert_allclose(rows[-1, 1:], arrived, rtol=0, atol=ROUNDING)
    # It was on its way back, or home, when it was told.
    told = rows[rows[:, 0] <= turned][-1, 3]
    assert told == (DONE if turned > 6.0 else RETRACTING)
    assert set(rows[rows[:, 0] > turned + PERIOD, 3]) == {EXTENDING, DWELLING}


def test_who_turns_after_the_dwell_dwells_anew(path, profile):
    back = np.ceil(profile.duration) + 2.0
    rows = run(
        TipPathSource(path, profile, dwell=0.5), back + 6.0, [(back, EXTEND), (back + 0.1, RUN)]
    )
    again = rows[(rows[:, 0] > back) & (rows[:, 3] == DWELLING)]
    assert len(again) == 0.5 / PERIOD


def test_extend_leads_to_the_end_and_never_back(path, profile):
    # At the end it stands for longer than its dwell; with the dwell over it has no way on.
    arrival = np.ceil(profile.duration)
    rows = run(TipPathSource(path, profile, dwell=0.5), arrival + 4.0, [(1.0, EXTEND)])
    assert rows[-1, 3] == DWELLING
    source = TipPathSource(path, profile, retract=False)
    rows = run(source, arrival + 4.0, [(arrival + 1.0, EXTEND)])
    np.testing.assert_array_equal(rows[-1, 2:], [0.0, DONE])
    # On the first of its way back it turns to where it came from.
    back = [(arrival, RETRACT), (arrival + PERIOD, EXTEND)]
    rows = run(TipPathSource(path, profile, dwell=60.0), arrival + 4.0, back)
    assert_continuous(rows)
    assert rows[-1, 3] == DWELLING


def test_retract_at_the_far_end_comes_back_though_nobody_planned_it(path, profile):
    source = TipPathSource(path, profile, retract=False)
    rows = run(source, 2.0 * profile.duration + 2.0, [(profile.duration + 0.5, RETRACT)])
    np.testing.assert_array_equal(rows[-1, 1:], [path.home_arc_length, 0.0, DONE])
    assert_continuous(rows)


def test_a_share_of_the_speed_goes_back_over_the_same_points_more_slowly(path, profile):
    source = TipPathSource(path, profile)
    source_run = Simulator(source)
    context = source_run.get_mutable_context()
    for port, value in (("command", RETRACT), ("speed_share", 0.5)):
        source.GetInputPort(port).FixValue(context, [value])
    # From the end of the path, at rest.
    context.SetDiscreteState([profile.duration, 0.0, DWELLING, 1.0])
    rows = []
    for k in range(int(2.0 * profile.duration / PERIOD) + 4):
        source_run.AdvanceTo((k + 0.5) * PERIOD)
        rows.append(np.array(source.GetOutputPort("tip").Eval(context)))
    back = np.array(rows)
    np.testing.assert_array_equal(back[-1], [path.home_arc_length, 0.0])
    # The clock at half its rate, as soon as the first update: no ramp from rest at the end.
    clock = np.maximum(profile.duration - 0.5 * PERIOD * (1.0 + np.arange(len(back))), 0.0)
    expected = np.array([profile(time) for time in clock])
    np.testing.assert_allclose(
        back[:, 0] - path.home_arc_length, expected[:, 0], rtol=0, atol=ROUNDING
    )
    np.testing.assert_allclose(back[:-4, 1], -0.5 * expected[:-4, 1], rtol=0, atol=ROUNDING)


def test_a_change_of_the_share_is_a_ramp(path, profile):
    source = TipPathSource(path, profile, hold_ramp=1.0)
    simulator = Simulator(source)
    context = simulator.get_mutable_context()
    rates = []
    for k in range(320):
        if k in (192, 224):
            share = 0.25 if k == 192 else 1.0
            source.GetInputPort("speed_share").FixValue(context, [share])
        simulator.AdvanceTo((k + 0.5) * PERIOD)
        rates.append(source.GetOutputPort("tip").Eval(context)[1])
    # The clock slows down by half within the half second, and speeds up again as fast.
    assert rates[223] == pytest.approx(0.5 * SPEED, abs=ROUNDING)
    assert rates[255] == pytest.approx(SPEED, abs=ROUNDING)
    steps = np.abs(np.diff(rates[190:]))
    assert steps.max() == pytest.approx(SPEED * PERIOD, abs=ROUNDING)


@pytest.mark.parametrize("share", [0.0, -0.5, 1.01, np.nan])
def test_a_share_that_is_none_is_refused(path, profile, share):
    source = TipPathSource(path, profile)
    simulator = Simulator(source)
    source.GetInputPort("speed_share").FixValue(simulator.get_mutable_context(), [share])
    with pytest.raises(InputError, match=r"TipPathSource.speed_share = .*; must be > 0 and <= 1"):
        simulator.AdvanceTo(0.1)


def test_an_unconnected_command_means_run(path, profile):
    told = run(TipPathSource(path, profile), 2.0, [(-1.0, RUN)])
    np.testing.assert_array_equal(run(TipPathSource(path, profile), 2.0), told)


@pytest.mark.parametrize("command", [np.nan, 0.4, 2.5])
def test_a_command_that_is_no_word_is_refused(path, profile, command):
    source = TipPathSource(path, profile)
    simulator = Simulator(source)
    source.GetInputPort("command").FixValue(simulator.get_mutable_context(), [command])
    words = r"1 \(run\), 0 \(hold\), -1 \(retract\) or 2 \(extend\)"
    message = rf"TipPathSource.command = {command}; must be {words}"
    with pytest.raises(InputError, match=message):
        simulator.AdvanceTo(0.1)


def test_bad_times_are_refused(path, profile):
    with pytest.raises(InputError, match=r"hold_ramp = 0.0 s; must be > 0"):
        TipPathSource(path, profile, hold_ramp=0.0)
    with pytest.raises(InputError, match=r"dwell = -1.0 s; must be >= 0"):
        TipPathSource(path, profile, dwell=-1.0)
