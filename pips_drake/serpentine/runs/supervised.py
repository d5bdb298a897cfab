"""What the supervisor decided in a run: when, why, by which numbers, and how the run ended."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import effort_columns
from pips_drake.serpentine.motion_words import DONE
from pips_drake.serpentine.runs.assessment import RunData
from pips_drake.serpentine.scenario import ClockConfig, SerpentineScenario
from pips_drake.serpentine.station.motion import PATH_NAMES, MotionNames
from pips_drake.serpentine.station.supervision import SUPERVISOR_PORTS, supervision_period
from pips_drake.serpentine.supervision import Cause, Mode, stopping_clearance
from pips_drake.serpentine.supervisor_config import SupervisorConfig
from pips_drake.serpentine.systems.motion_supervisor import MEASURED
from pips_drake.twin.recording import Series

Array = NDArray[np.float64]

#: Slower than this at every spine point, an arm is at rest, m/s.
AT_REST = 1e-3
#: A run goes on while the joints' rates add up to more, rad/s and m/s: on an arm 5 m long no point
#: is then as fast as `AT_REST`.
_STILL = AT_REST / 5.0
_WORDS = {Mode.HOLD: "held", Mode.RETRACT: "retracted", Mode.STOP: "stopped"}


@dataclass(frozen=True, kw_only=True)
class SupervisorLog:
    """What a supervisor said, a row a decision period.

    Attributes:
        time: of the decisions, (N,) s.
        commands: command and share of the speed, (N, 2).
        modes, causes: (N,).
        measured: `MEASURED`, (N, 15).
    """

    time: Array
    commands: Array
    modes: Array
    causes: Array
    measured: Array

    def series(self) -> Series:
        """As a table with names and units."""
        return Series(
            time=self.time,
            values=np.column_stack([self.modes, self.causes, self.commands, self.measured]),
            columns=("mode", "cause", "command", "speed_share", *MEASURED),
        )


def log_supervisor(
    builder: DiagramBuilder, station: Diagram, scenario: SerpentineScenario
) -> dict[str, VectorLogSink]:
    """Adds logs of every decision, by the station's ports; none without a supervisor."""
    period, _ = supervision_period(scenario.clocks)
    logs = {}
    for port in SUPERVISOR_PORTS if scenario.supervisor.enabled else ():
        logs[port] = LogVectorOutput(station.GetOutputPort(port), builder, period)
        logs[port].set_name(f"log.{port}")
    return logs


def read_log(
    logs: Mapping[str, VectorLogSink], context: Context, clocks: ClockConfig
) -> SupervisorLog:
    """What `log_supervisor`'s logs hold: a log's row is the decision before it."""
    period, offset = supervision_period(clocks)
    found = {port: logs[port].FindLog(context) for port in SUPERVISOR_PORTS}
    # The first row is from before any decision.
    rows = {port.split(".")[1]: log.data().T[1:] for port, log in found.items()}
    time = found[SUPERVISOR_PORTS[0]].sample_times()[1:]
    return SupervisorLog(
        time=time - (period - offset if offset > 0.0 else period),
        commands=np.hstack([rows["command"], rows["speed_share"]]),
        modes=rows["mode"][:, 0],
        causes=rows["cause"][:, 0],
        measured=rows["measured"],
    )


@dataclass(frozen=True, kw_only=True)
class RunDecision:
    """A change of what the supervisor does, or why.

    Attributes:
        time: s.
        before, after: modes.
        cause: of the new mode.
        why: a phrase with the numbers; empty for motion that is free again.
        numbers: what was measured, by name.
    """

    time: float
    before: Mode
    after: Mode
    cause: Cause
    why: str
    numbers: dict[str, float]

    @property
    def label(self) -> str:
        """A few words, for a button."""
        name = {Mode.PERMIT: "free again"}.get(self.after, self.after.name.lower())
        return name if self.cause == Cause.NONE else f"{name}: {_cause_name(self.cause)}"

    def summary(self) -> dict[str, Any]:
        """For `summary.json`."""
        return {
            "time_s": self.time,
            "from": self.before.name.lower(),
            "to": self.after.name.lower(),
            "cause": self.cause.name.lower(),
            "why": self.why,
        } | self.numbers


@dataclass(frozen=True, kw_only=True, eq=False)
class Supervised:
    """A run that was supervised.

    Attributes:
        log: what the supervisor said.
        stopping_time: with which it took closing rates into account, s.
        data: what the run recorded.
        phase: of the path source, at the end.
        whole: whether the run was to be a whole one, not shortened by `duration_s`.
        pair_name: the monitor's.
    """

    arm: SerpentineArm
    config: SupervisorConfig
    log: SupervisorLog
    stopping_time: float
    data: RunData
    phase: float
    whole: bool
    pair_name: Callable[[float], tuple[str, str] | None]

    @cached_property
    def decisions(self) -> list[RunDecision]:
        """Every change of mode or cause, in time."""
        found, mode, cause = [], Mode.PERMIT, Cause.NONE
        for row in range(len(self.log.time)):
            after, why = Mode(int(self.log.modes[row])), Cause(int(self.log.causes[row]))
            if (after, why) != (mode, cause):
                numbers = dict(zip(MEASURED, self.log.measured[row].tolist(), strict=True))
                found.append(
                    RunDecision(
                        time=float(self.log.time[row]),
                        before=mode,
                        after=after,
                        cause=why,
                        why=self._why(why, (mode, after), numbers, float(self.log.time[row])),
                        numbers=numbers,
                    )
                )
            mode, cause = after, why
        return found

    @property
    def mode(self) -> Mode:
        """At the end."""
        return Mode(int(self.log.modes[-1])) if len(self.log.modes) else Mode.PERMIT

    @property
    def completed(self) -> bool:
        """Whether the tip went its way to the end, held or not in between."""
        return self.phase == DONE and self.mode in (Mode.PERMIT, Mode.HOLD)

    @cached_property
    def final_speed(self) -> float:
        """Of the fastest spine point at the end, m/s."""
        last = kinematics.spine_points(self.arm, self.data.joints[-2:])
        step = float(self.data.time[-1] - self.data.time[-2])
        return float(np.linalg.norm(last[1] - last[0], axis=-1).max() / step)

    @property
    def safe(self) -> bool:
        """Whether the arm ended at rest and clear of everything, itself included."""
        clear = min(self.data.clearance[-1], self.data.self_clearance[-1]) > 0.0
        return bool(clear and self.final_speed < AT_REST)

    def summary(self) -> dict[str, Any]:
        """The supervisor's part of `summary.json`."""
        cause = Cause(int(self.log.causes[-1])) if len(self.log.causes) else Cause.NONE
        return {
            "supervisor_mode": self.mode.name.lower(),
            "supervisor_cause": cause.name.lower(),
            "supervisor_decisions": [one.summary() for one in self.decisions],
            "ended_safely": self.safe,
        }

    def failures(self) -> list[str]:
        """A sentence if the run was not completed because of the supervisor."""
        intervened = [one for one in self.decisions if one.after != Mode.PERMIT]
        if self.completed or not intervened or not (self.whole or self.mode != Mode.PERMIT):
            return []
        # From the last time that nothing was wrong: what was decided first, and last.
        free = [i for i, one in enumerate(self.decisions) if one.after == Mode.PERMIT]
        first, *later = self.decisions[free[-1] + 1 if free else 0 :] or intervened[-1:]
        words = f"the arm was {_WORDS[first.after]} at {first.time:.2f} s: {first.why}"
        for before, after in itertools.pairwise([first, *later]):
            if after.after != before.after:
                words += f"; {_WORDS[after.after]} at {after.time:.2f} s"
                words += f": {after.why}" if after.cause != before.cause else ""
        left = float(self.data.clearance[-1])
        clear = f"{left * 1e3:.0f} mm clear" if left > 0.0 else f"{-left * 1e3:.1f} mm deep"
        ending = "at rest" if self.final_speed < AT_REST else "still moving"
        place = " at home" if self.phase == DONE else ""
        return [f"{words}; it ended {ending}{place}, {clear}"]

    def _why(
        self, cause: Cause, modes: tuple[Mode, Mode], seen: dict[str, float], time: float
    ) -> str:
        """The numbers behind a cause of a change from one mode to another."""
        config = self.config
        if cause == Cause.NONE:
            return ""
        if cause == Cause.INVALID:
            # What is urgent may be unknown.
            measured = [item for item in seen.items() if "urgent" not in item[0]]
            bad = [name for name, value in measured if not np.isfinite(value)]
            return f"no number: {', '.join(bad) or 'the command'}"
        if cause in (Cause.TRACKING, Cause.RUNAWAY):
            error, joint = seen["tracking_error_m"] * 1e3, int(seen["tracking_joint"])
            limit = f"must be < {config.tracking_hold_mm:g} mm"
            if cause == Cause.RUNAWAY:
                limit = f"over {config.tracking_growth_mm:g} mm farther than when it was held"
            return f"spine point {joint} is {error:.1f} mm from its command, {limit}"
        if cause == Cause.FORCE:
            # Without the unit that ends a column's name.
            drive = effort_columns(self.arm)[int(seen["force_drive"])].rsplit("_", 1)[0]
            share, most = 100.0 * seen["force_fraction"], 100.0 * config.force_fraction_hold
            return f"drive {drive} needs {share:.0f} % of its limit, must be < {most:g} %"
        if cause == Cause.ENCODER:
            return f"the encoder of {self.arm.joint_names[int(seen['unhealthy_encoder'])]} fails"
        return self._why_near("self_" if cause == Cause.SELF_CLEARANCE else "", modes, seen, time)

    def _why_near(
        self, own: str, modes: tuple[Mode, Mode], seen: dict[str, float], time: float
    ) -> str:
        """The numbers behind a clearance; `own` is what its columns' names begin with."""
        config, (before, mode) = self.config, modes
        distance, rate = seen[f"{own}clearance_m"], seen[f"{own}clearance_rate_m_per_s"]
        hold = config.own_hold_clearance_mm if own else config.hold_clearance_mm
        near = "the arm to itself" if own else self._pair(time)
        urgent, urgent_rate = (
            seen[f"{own}urgent_{name}"] for name in ("clearance_m", "rate_m_per_s")
        )
        if mode == Mode.HOLD and urgent_rate * 1e3 < -config.closing_speed_mm_per_s:
            pair = self.pair_name(seen[f"{own}urgent_pair"])
            distance, rate = urgent, urgent_rate
            near = near if pair is None else f"{pair[0]} to {pair[1]}"
        more = ""
        if rate * 1e3 < -config.closing_speed_mm_per_s:
            left = stopping_clearance(distance, rate, self.stopping_time)
            more = f", closing in by {-rate * 1e3:.1f} mm/s ({left * 1e3:.1f} mm left at rest)"
        if mode == Mode.RETRACT and not own and distance * 1e3 < config.retract_clearance_mm:
            more, hold = "", config.retract_clearance_mm
        elif before == Mode.RETRACT:
            return f"{near} {distance * 1e3:.1f} mm{more}, on the way back"
        elif mode in (Mode.RETRACT, Mode.STOP):
            return f"{near} {distance * 1e3:.1f} mm{more}, after {config.patience_s:g} s"
        return f"{near} {distance * 1e3:.1f} mm{more}; must be left: {hold:g} mm"

    def _pair(self, time: float) -> str:
        """The nearest bodies at a time, as far as they were recorded."""
        row = min(int(np.searchsorted(self.data.time, time)), len(self.data.pairs) - 1)
        pair = self.data.pairs[row]
        return "the arm to the scene" if pair is None else f"{pair[0]} to {pair[1]}"


def _cause_name(cause: Cause) -> str:
    return cause.name.lower().replace("_", " ")


class RunEnd:
    """Says when a supervised run is over.

    A run that nothing held ends at its time. A held one goes on until it is done, or stopped, and
    both the path's tip and the arm have been at rest for `motion.settle_s`; at most to `latest`.

    Args:
        station: in the diagram that runs.
        modes: log of the supervisor's modes; None without a supervisor.
        duration: of a run that nothing holds, s.
        names: of what moves the arm in the station; by default, of a path that is followed.
    """

    def __init__(
        self,
        station: Diagram,
        modes: VectorLogSink | None,
        scenario: SerpentineScenario,
        duration: float,
        *,
        names: MotionNames = PATH_NAMES,
    ) -> None:
        self._station, self._modes, self._names = station, modes, names
        self._settle = scenario.motion.settle_s
        self._duration = duration
        self._since: float | None = None
        self.latest = duration
        if modes is not None and scenario.duration_s <= 0.0:
            config = scenario.supervisor
            self.latest += duration / config.safe_speed_fraction + config.overtime_s

    def __call__(self, context: Context) -> bool:
        """Whether a run whose root context this is has come to its end."""
        time = context.get_time()
        if self._modes is None:
            return time >= self._duration
        mode, phase, rate = self._look(context)
        over = mode == Mode.STOP or (mode == Mode.RETRACT and phase == DONE)
        waiting_is_over = time >= self._duration and phase == DONE
        if rate == 0.0 and (over or waiting_is_over):
            self._since = time if self._since is None else self._since
            if time - self._since >= self._settle:
                return True
        else:
            self._since = None
        return time >= self._duration and not self._intervened(context, self._modes)

    def _look(self, context: Context) -> tuple[float, float, float]:
        """The supervisor's mode, the source's phase, and the tip's rate, or else the arm's."""
        mine = self._station.GetMyContextFromRoot(context)
        mode, phase, tip, state = (
            self._station.GetOutputPort(port).Eval(mine)
            for port in (
                "motion_supervisor.mode",
                self._names.phase,
                self._names.tip,
                "plant.state",
            )
        )
        rate = float(tip[1])
        if rate == 0.0:
            # The path's tip may stand while a drive that has failed goes on.
            joints = float(np.abs(state[len(state) // 2 :]).sum())
            rate = joints if joints > _STILL else 0.0
        return float(mode[0]), float(phase[0]), rate

    @staticmethod
    def _intervened(context: Context, modes: VectorLogSink) -> bool:
        return bool(np.any(modes.FindLog(context).data() != Mode.PERMIT))
