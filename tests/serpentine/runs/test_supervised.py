"""What a run says of its supervisor: decisions with numbers, how it ended, and when it is over."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pips_drake.scenarios import load_scenario
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.motion_words import DONE, EXTENDING, RETRACTING
from pips_drake.serpentine.runs.pictures import MOST_DECISIONS, run_bookmarks
from pips_drake.serpentine.runs.run import Run, run_station
from pips_drake.serpentine.runs.supervised import RunEnd, Supervised, SupervisorLog
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import load_setup
from pips_drake.serpentine.station.supervision import supervision_latency
from pips_drake.serpentine.supervision import Cause, Mode
from pips_drake.serpentine.supervisor_config import SupervisorConfig
from pips_drake.serpentine.systems.motion_supervisor import MEASURED

#: Nothing wrong; in `MEASURED`'s order.
NUMBERS = [
    0.1,
    0.0,
    0.17,
    0.0,
    1e-3,
    4.0,
    0.3,
    2.0,
    -1.0,
    np.nan,
    np.nan,
    -1.0,
    np.nan,
    np.nan,
    -1.0,
]
GOOD = dict(zip(MEASURED, NUMBERS, strict=True))
PAIR = ("arm::hand", "payload::side")


@pytest.fixture
def supervised(arm):
    def make(
        *rows: tuple[Mode, Cause, dict[str, float]],
        phase: float = EXTENDING,
        clearance: float = 0.05,
        moved: float = 0.0,
        whole: bool = True,
    ) -> Supervised:
        """A supervised run with a decision a second; `moved` in its last second, m."""
        time = np.arange(len(rows), dtype=float)
        joints = np.zeros((max(len(rows), 2), arm.joints))
        joints[-1, 0] = moved
        data: Any = SimpleNamespace(
            time=np.arange(len(joints), dtype=float),
            joints=joints,
            clearance=np.full(len(joints), clearance),
            self_clearance=np.full(len(joints), 0.17),
            pairs=(PAIR,) * len(joints),
        )
        log = SupervisorLog(
            time=time,
            commands=np.ones((len(rows), 2)),
            modes=np.array([float(row[0]) for row in rows]),
            causes=np.array([float(row[1]) for row in rows]),
            measured=np.array([list((GOOD | row[2]).values()) for row in rows]),
        )
        return Supervised(
            arm=arm,
            config=SupervisorConfig(),
            log=log,
            stopping_time=0.35,
            data=data,
            phase=phase,
            whole=whole,
            pair_name=lambda index: ("arm::elbow", "wall::wall") if index >= 0 else None,
        )

    return make


FREE = (Mode.PERMIT, Cause.NONE, {})
NEAR = {"clearance_m": 0.028, "clearance_rate_m_per_s": -0.026}
HELD = (Mode.HOLD, Cause.CLEARANCE, NEAR)
REST = (Mode.HOLD, Cause.CLEARANCE, {"clearance_m": 0.0205})
BACK = (Mode.RETRACT, Cause.CLEARANCE, {"clearance_m": 0.0205})


def test_decisions_are_the_changes(supervised):
    found = supervised(FREE, FREE, HELD, REST, REST, BACK, BACK).decisions
    assert [(one.time, one.before, one.after, one.cause) for one in found] == [
        (2.0, Mode.PERMIT, Mode.HOLD, Cause.CLEARANCE),
        (5.0, Mode.HOLD, Mode.RETRACT, Cause.CLEARANCE),
    ]
    assert [one.label for one in found] == ["hold: clearance", "retract: clearance"]
    # 28 mm less 26 mm/s times 0.35 s.
    assert found[0].why == (
        "arm::hand to payload::side 28.0 mm, closing in by 26.0 mm/s (18.9 mm left at rest); "
        "must be left: 20 mm"
    )
    summary, numbers = found[0].summary(), GOOD | NEAR
    assert [summary.pop(name) for name in ("time_s", "from", "to", "cause", "why")] == [
        2.0,
        "permit",
        "hold",
        "clearance",
        found[0].why,
    ]
    assert list(summary) == list(numbers)
    np.testing.assert_array_equal(list(summary.values()), list(numbers.values()))


def test_a_pair_that_closes_in_behind_the_nearest_is_named(supervised):
    seen = {
        "clearance_m": 0.039,
        "urgent_clearance_m": 0.045,
        "urgent_rate_m_per_s": -0.1,
        "urgent_pair": 4.0,
    }
    (decision,) = supervised((Mode.HOLD, Cause.CLEARANCE, seen)).decisions
    assert decision.why.startswith("arm::elbow to wall::wall 45.0 mm, closing in by 100.0 mm/s")


def test_a_part_of_the_arm_that_closes_in_is_named(supervised):
    seen = {
        "self_clearance_m": 0.020,
        "self_urgent_clearance_m": 0.033,
        "self_urgent_rate_m_per_s": -0.1,
        "self_urgent_pair": 4.0,
    }
    (decision,) = supervised((Mode.HOLD, Cause.SELF_CLEARANCE, seen)).decisions
    assert decision.why == (
        "arm::elbow to wall::wall 33.0 mm, closing in by 100.0 mm/s (-2.0 mm left at rest); "
        "must be left: 5 mm"
    )


def test_what_a_retraction_meets_is_said(supervised):
    (_, stop) = supervised(
        BACK, (Mode.STOP, Cause.SELF_CLEARANCE, {"self_clearance_m": 0.002})
    ).decisions
    assert stop.why == "the arm to itself 2.0 mm, on the way back"


def test_a_change_of_the_cause_alone_is_a_decision(supervised):
    lag = (Mode.HOLD, Cause.TRACKING, {"tracking_error_m": 0.05, "tracking_joint": 8.0})
    found = supervised(HELD, lag, FREE).decisions
    assert [one.label for one in found] == ["hold: clearance", "hold: tracking", "free again"]


WHY = {
    Cause.SELF_CLEARANCE: (
        {"self_clearance_m": 0.004},
        "the arm to itself 4.0 mm; must be left: 5 mm",
    ),
    Cause.TRACKING: (
        {"tracking_error_m": 0.0512, "tracking_joint": 8.0},
        "spine point 8 is 51.2 mm from its command, must be < 40 mm",
    ),
    Cause.RUNAWAY: (
        {"tracking_error_m": 0.0647, "tracking_joint": 18.0},
        "spine point 18 is 64.7 mm from its command, over 20 mm farther than when it was held",
    ),
    Cause.FORCE: (
        {"force_fraction": 0.99, "force_drive": 2.0},
        "drive L3 needs 99 % of its limit, must be < 98 %",
    ),
    Cause.ENCODER: ({"unhealthy_encoder": 3.0}, "the encoder of theta4 fails"),
    Cause.INVALID: ({"clearance_m": np.nan}, "no number: clearance_m"),
}


@pytest.mark.parametrize("cause", WHY)
def test_each_cause_says_its_numbers(supervised, cause):
    numbers, words = WHY[cause]
    (decision,) = supervised((Mode.HOLD, cause, numbers)).decisions
    assert decision.why == words


def test_a_command_that_is_no_word_is_said(supervised):
    (decision,) = supervised((Mode.STOP, Cause.INVALID, {})).decisions
    assert decision.why == "no number: the command"


def test_what_is_fled_says_the_distance_that_it_was_fled_at(supervised):
    (decision,) = supervised((Mode.RETRACT, Cause.CLEARANCE, {"clearance_m": 0.009})).decisions
    assert decision.why == "arm::hand to payload::side 9.0 mm; must be left: 10 mm"


def test_a_run_that_was_never_held_or_let_go_again_passes(supervised):
    for rows in ([FREE, FREE], [FREE, HELD, REST, FREE]):
        run = supervised(*rows, phase=DONE)
        assert run.completed and run.failures() == []
    assert supervised(FREE, FREE, phase=DONE).summary()["supervisor_decisions"] == []


def test_a_run_that_was_taken_back_fails_and_says_how_it_ended(supervised):
    run = supervised(FREE, HELD, REST, BACK, BACK, phase=DONE)
    assert not run.completed and run.safe
    (sentence,) = run.failures()
    assert sentence == (
        "the arm was held at 1.00 s: arm::hand to payload::side 28.0 mm, closing in by 26.0 mm/s "
        "(18.9 mm left at rest); must be left: 20 mm; retracted at 3.00 s; it ended at rest at "
        "home, 50 mm clear"
    )
    summary = run.summary()
    assert (summary["supervisor_mode"], summary["supervisor_cause"]) == ("retract", "clearance")
    assert summary["ended_safely"] is True


def test_the_sentence_begins_with_the_last_time_that_nothing_was_wrong(supervised):
    stop = (Mode.STOP, Cause.ENCODER, {"unhealthy_encoder": 0.0})
    fails = (Mode.HOLD, Cause.ENCODER, {"unhealthy_encoder": 0.0})
    (sentence,) = supervised(HELD, FREE, FREE, fails, stop, moved=0.01).failures()
    assert sentence == (
        "the arm was held at 3.00 s: the encoder of d1 fails; stopped at 4.00 s; it ended still "
        "moving, 50 mm clear"
    )


def test_an_arm_that_ends_moving_or_touching_has_not_ended_safely(supervised):
    assert supervised(FREE, FREE).safe
    # A sample a second: 1 mm/s is at rest no more.
    assert not supervised(FREE, FREE, moved=1.1e-3).safe
    assert not supervised(FREE, FREE, clearance=-1e-4).safe
    run = supervised(FREE, REST, clearance=-0.0021)
    assert run.failures()[0].endswith("it ended at rest, 2.1 mm deep")


def test_a_run_that_is_cut_short_fails_only_if_it_is_held_then(supervised):
    assert supervised(FREE, HELD, FREE, whole=False).failures() == []
    assert len(supervised(FREE, HELD, whole=False).failures()) == 1
    # A whole one that is let go too late is not done.
    assert len(supervised(FREE, HELD, FREE, whole=True).failures()) == 1


def test_the_table_has_a_column_a_number(supervised):
    series = supervised(FREE, HELD).log.series()
    assert series.columns[:4] == ("mode", "cause", "command", "speed_share")
    assert series.values.shape == (2, 4 + len(MEASURED))


def test_decisions_are_moments_of_the_replay_and_not_too_many(supervised):
    decisions = supervised(*[FREE, HELD] * 10).decisions
    data = SimpleNamespace(
        time=np.zeros(1),
        tip_arc_lengths=np.zeros(1),
        clearance=np.ones(1),
        pairs=(None,),
        witness=None,
    )
    assessment: Any = SimpleNamespace(data=data, motion=SimpleNamespace(end=2.0), nearest=0)
    marks = run_bookmarks(assessment, decisions)
    assert len(marks) == MOST_DECISIONS < len(decisions)
    assert (marks[0].label, marks[0].time) == ("hold: clearance", 1.0)


class Look:
    """A run's end that is shown modes and phases instead of a diagram."""

    def __init__(self, monkeypatch, *, duration=10.0, duration_s=0.0, intervened=True):
        scenario = SerpentineScenario(duration_s=duration_s)
        modes: Any = object()
        self.end = RunEnd(None, modes, scenario, duration)  # type: ignore[arg-type]
        self.seen = (0.0, 0.0, 0.0)
        monkeypatch.setattr(self.end, "_look", lambda context: self.seen)
        monkeypatch.setattr(RunEnd, "_intervened", staticmethod(lambda *args: intervened))

    def __call__(self, time, mode, phase, rate):
        self.seen = (float(mode), phase, rate)
        context: Any = SimpleNamespace(get_time=lambda: time)
        return self.end(context)


def test_a_run_that_nothing_holds_ends_at_its_time(monkeypatch):
    look = Look(monkeypatch, intervened=False)
    assert not look(9.75, Mode.PERMIT, DONE, 0.0)
    assert look(10.0, Mode.PERMIT, RETRACTING, -0.01)


def test_a_held_run_goes_on_until_it_is_done_and_settled(monkeypatch):
    look = Look(monkeypatch)
    assert not look(10.0, Mode.PERMIT, RETRACTING, -0.01)
    assert not look(40.0, Mode.PERMIT, DONE, 0.0)
    assert not look(40.75, Mode.PERMIT, DONE, 0.0)
    assert look(41.0, Mode.PERMIT, DONE, 0.0)


@pytest.mark.parametrize(("mode", "phase"), [(Mode.STOP, EXTENDING), (Mode.RETRACT, DONE)])
def test_a_stopped_or_retracted_run_ends_once_it_has_settled(monkeypatch, mode, phase):
    look = Look(monkeypatch)
    assert not look(3.0, mode, phase, 0.01)
    assert not look(3.25, mode, phase, 0.0)
    assert look(4.25, mode, phase, 0.0)


def test_a_run_that_is_held_for_ever_has_a_latest_end(monkeypatch):
    look = Look(monkeypatch)
    assert not look(1000.0, Mode.HOLD, EXTENDING, 0.0)
    # Its time, the whole way back at half the speed, and a minute.
    assert look.end.latest == 10.0 + 20.0 + 60.0
    assert Look(monkeypatch, duration_s=4.0, duration=4.0).end.latest == 4.0


def test_without_a_supervisor_a_run_ends_at_its_time():
    end = RunEnd(None, None, SerpentineScenario(), 10.0)  # type: ignore[arg-type]
    assert end.latest == 10.0
    for time, over in ((9.75, False), (10.0, True)):
        context: Any = SimpleNamespace(get_time=lambda time=time: time)
        assert end(context) == over


def obstructed(**supervisor: float) -> tuple[SerpentineScenario, Run]:
    """The shipped scenario's run with other settings."""
    scenario = load_scenario("trajectory_4_obstructed").config
    for name, value in supervisor.items():
        setattr(scenario.motion if hasattr(scenario.motion, name) else scenario.supervisor, name,
                value)  # fmt: skip
    return scenario, run_station(scenario, load_setup(scenario))


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("speed", "share"), [(25.0, 1.0), (45.0, 0.5)])
def test_the_arm_stops_within_its_stopping_distance_and_goes_home_untouched(arm, speed, share):
    # Faster than 49 mm/s the rail cannot go.
    scenario, run = obstructed(tip_speed_mm_per_s=speed, patience_s=2.0, safe_speed_fraction=share)
    held, back = run.supervised.decisions
    assert (held.after, back.after, held.cause) == (Mode.HOLD, Mode.RETRACT, Cause.CLEARANCE)
    assert back.time - held.time == pytest.approx(2.0, abs=0.1)
    # v latency + v^2 / (2 a), a = v / ramp. 1 mm more for what the arm swings when it stops, and
    # for the closing rate's growth meanwhile: the hand turns towards the payload.
    v, ramp = speed * 1e-3, scenario.supervisor.hold_ramp_s
    stop = v * supervision_latency(scenario.clocks) + v**2 / (2.0 * v / ramp)
    data = run.data
    rest = (data.time > held.time) & (data.time < back.time)
    # The payload's, which at 45 mm/s is not the nearest yet when it is acted on: the pallet is.
    lost = held.numbers["urgent_clearance_m"] - data.clearance[rest].min()
    assert 0.5 * stop < lost <= stop + 1e-3
    # And so at no time was less left than asked for.
    assert data.clearance.min() >= scenario.supervisor.hold_clearance_mm * 1e-3 - 1e-3
    # Back over the same points, at its share of the speed; roundings of some metres.
    fastest = -np.diff(data.tip_arc_lengths).min() * scenario.clocks.record_hz
    assert fastest == pytest.approx(share * v, rel=1e-9)
    assert run.supervised.phase == DONE and run.supervised.safe
    home = kinematics.spine_points(arm, data.joints[[0, -1]])
    np.testing.assert_allclose(home[0], home[1], rtol=0, atol=1e-3)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_run_without_patience_is_held_to_its_latest_end():
    scenario, run = obstructed(
        tip_speed_mm_per_s=45.0,
        patience_s=0.0,
        safe_speed_fraction=1.0,
        overtime_s=2.0,
        retract=False,
        dwell_s=0.0,
    )
    (held,) = run.supervised.decisions
    assert held.after == Mode.HOLD
    duration = run.station.GetSubsystemByName("tip_path_source").duration
    latest = 2.0 * (duration + scenario.motion.settle_s) + 2.0
    assert run.run_time.simulated_s == pytest.approx(latest, abs=1e-9)
    (sentence,) = run.supervised.failures()
    assert sentence.startswith("the arm was held at") and "it ended at rest" in sentence
    assert run.supervised.safe
