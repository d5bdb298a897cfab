"""Holds, takes back or stops an arm on its path when something is wrong."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import drive_limits
from pips_drake.serpentine.motion_words import HOLD, RUN, WORDS
from pips_drake.serpentine.supervision import (
    BY_GRAVITY,
    Cause,
    Decision,
    Measurement,
    Mode,
    Release,
    Thresholds,
    brakes,
    command_of,
    decide,
)
from pips_drake.serpentine.supervisor_config import SupervisorConfig
from pips_drake.serpentine.tracking import largest_share, tracking_error
from pips_drake.twin.systems.inputs import input_values

Array = NDArray[np.float64]

#: What the `measured` output holds, with units.
MEASURED = (
    "clearance_m",
    "clearance_rate_m_per_s",
    "self_clearance_m",
    "self_clearance_rate_m_per_s",
    "tracking_error_m",
    "tracking_joint",
    "force_fraction",
    "force_drive",
    "unhealthy_encoder",
    "urgent_clearance_m",
    "urgent_rate_m_per_s",
    "urgent_pair",
    "self_urgent_clearance_m",
    "self_urgent_rate_m_per_s",
    "self_urgent_pair",
)


class MotionSupervisor(LeafSystem):
    """Lets the operator's command through to the path source, or holds, retracts or stops the tip.

    .. pydrake_system::

        name: MotionSupervisor
        input_ports:
        - clearance
        - commanded_joint_state
        - joint_state
        - drive_effort
        - tip
        - phase
        - operator_command
        - encoder_health
        - urgent
        - own_urgent
        output_ports:
        - command
        - speed_share
        - brake
        - mode
        - cause
        - measured

    Input ports:

    - `clearance`, (3,): `ClearanceMonitor.clearance`: distance to the scene, m, its rate, m/s
      (where it is NaN, that of the last two samples is taken), and distance to itself, m.
    - `commanded_joint_state`, (2 J,): where the joints are sent, m and rad, and rates (not used).
    - `joint_state`, (2 J,): where they are measured, and rates (not used).
    - `drive_effort`, (J,): efforts of the drives, N and Nm.
    - `tip`, (2,): `TipPathSource.tip`: arc length, m (not used), and its rate, m/s.
    - `phase`, (1,): `TipPathSource.phase`.
    - `operator_command`, (1,): what the operator wants: 1 (run), 0 (hold), -1 (retract) or 2 (out
      again after having gone back); optional, run when unconnected. Anything else stops the arm.
    - `encoder_health`, (J,): 1 for a joint whose encoder can be trusted; optional, all of them when
      unconnected.
    - `urgent`, (3,): `ClearanceMonitor.urgent`: distance, m, rate, m/s, and index of the pair that
      will be nearest when the arm has come to rest; optional. Without it, what is not the nearest
      yet is not seen to close in.
    - `own_urgent`, (3,): `ClearanceMonitor.own_urgent`, the same of the arm to itself; optional.

    Output ports, all from state (no feedthrough):

    - `command`, (1,): for `TipPathSource.command`.
    - `speed_share`, (1,): for `TipPathSource.speed_share`.
    - `brake`, (1,): for `ActuatorServo.brake`: 1 at a stop, else 0.
    - `mode`, (1,): `supervision.Mode`: 0 permit, 1 hold, 2 retract, 3 stop.
    - `cause`, (1,): `supervision.Cause`: 0 none, 1 clearance, 2 self clearance, 3 tracking, 4
      force, 5 encoder, 6 invalid number, 7 runaway.
    - `measured`, (15,): what the present decision rests on (`MEASURED`, names and units): clearance
      and rate, self clearance and rate, tracking error and the joint of that spine point (from 1),
      share of its limit that a drive needs and which (from 0), first encoder that is not trusted
      (from 0, -1 for none), `urgent` and `own_urgent`. Zero before the first decision.

    State: discrete, updated every `period` s (default 1/32 s), the first time at `offset` s
    (default 1/64 s, so that it sees what a monitor has found a control period before): command,
    share, brake, mode, cause, directions barred by each cause and for how long it has been clear,
    least clearances, tracking error now and when it became a cause, force needed, time waited, how
    far a retraction is released; and `measured`. At initialization the operator's command passes.
    Latency: what is measured acts on the outputs at the next update.

    Decisions are those of `supervision.decide`. In short: the tip is held when the clearance that
    would be left at rest, d + min(rate, 0) T, falls below the hold threshold. T is latency + ramp /
    2, so that v T is the stopping distance v latency + v^2 / (2 a) with the ramp's a = v / ramp.
    Motion the other way passes at full speed. A hold ends when its causes have been past their
    resume thresholds for a while. What lasts longer than the patience is answered by retraction, or
    by a stop where the way back is barred too; an arm that leaves its place although it is held is
    stopped at once. A retraction is left when the operator holds at rest, and then runs. A stop is
    not left again.

    Args:
        arm: whose joints and drives they are.
        config: thresholds.
        latency: from a change of clearance to the plant's answer, s.
        period, offset: s.
    """

    def __init__(
        self,
        arm: SerpentineArm,
        *,
        config: SupervisorConfig | None = None,
        latency: float = 0.1,
        period: float = 1.0 / 32.0,
        offset: float = 1.0 / 64.0,
    ) -> None:
        super().__init__()
        self._dh = arm.dh_table
        self._spine = np.array(arm.spine_indices, dtype=np.int64)
        self._effort_limits = drive_limits(arm)[3]
        self._thresholds = (config or SupervisorConfig()).thresholds(latency)
        self._period = period
        joints = arm.joints
        self._clearance = self._declare_input("clearance", 3)
        self._commanded = self._declare_input("commanded_joint_state", 2 * joints)
        self._joints = self._declare_input("joint_state", 2 * joints)
        self._effort = self._declare_input("drive_effort", joints)
        self._tip = self._declare_input("tip", 2)
        self._phase = self._declare_input("phase", 1)
        self._operator = self._declare_input("operator_command", 1)
        self._health = self._declare_input("encoder_health", joints)
        self._urgent = self._declare_input("urgent", 3)
        self._own_urgent = self._declare_input("own_urgent", 3)
        self._decided = self.DeclareDiscreteState(_pack(Decision(), RUN, 1.0))
        self._measured = self.DeclareDiscreteState([0.0] * len(MEASURED))
        # Distances at the update before, for rates; none yet.
        self._last = self.DeclareDiscreteState([math.nan, math.nan])
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePeriodicDiscreteUpdateEvent(period, offset, self._update)
        decided_only = {self.discrete_state_ticket(self._decided)}
        for index, name in enumerate(("command", "speed_share", "brake", "mode", "cause")):
            self.DeclareVectorOutputPort(
                name, 1, self._make_calc(index), prerequisites_of_calc=decided_only
            )
        self.DeclareStateOutputPort("measured", self._measured)

    @property
    def thresholds(self) -> Thresholds:
        """Where it acts, SI."""
        return self._thresholds

    def _declare_input(self, name: str, size: int) -> int:
        return int(self.DeclareVectorInputPort(name, size).get_index())

    def _make_calc(self, index: int) -> Callable[[Context, BasicVector], None]:
        """What writes one number of the decision to an output."""

        def calc(context: Context, output: BasicVector) -> None:
            output[0] = context.get_discrete_state(self._decided)[index]

        return calc

    def _wish(self, context: Context) -> float:
        operator = self.EvalVectorInput(context, self._operator)
        return RUN if operator is None else float(operator[0])

    def _initialize(self, context: Context, values: DiscreteValues) -> None:
        wish = self._wish(context)
        # What is no word is for the first decision to answer.
        command = wish if wish in WORDS else HOLD
        values.get_mutable_vector(self._decided).SetFromVector(_pack(Decision(), command, 1.0))

    def _update(self, context: Context, values: DiscreteValues) -> None:
        seen, rows = self._see(context)
        before = _unpack(context.get_discrete_state(self._decided).value().tolist())
        after = decide(before, seen, self._thresholds, self._period)
        command = command_of(after, seen.wish, seen.phase, self._thresholds.safe_share)
        values.get_mutable_vector(self._decided).SetFromVector(_pack(after, *command))
        values.get_mutable_vector(self._measured).SetFromVector(rows)
        last = [seen.clearance, seen.own_clearance]
        values.get_mutable_vector(self._last).SetFromVector(last)

    def _see(self, context: Context) -> tuple[Measurement, list[float]]:
        """What the inputs say, and the `measured` output of it."""
        distance, rate, own = input_values(self, context, self._clearance).tolist()
        last, own_last = context.get_discrete_state(self._last).value().tolist()
        if math.isnan(rate):
            rate = self._rate(last, distance)
        own_rate = self._rate(own_last, own)
        error, point = tracking_error(
            self._dh,
            self._spine,
            input_values(self, context, self._commanded),
            input_values(self, context, self._joints),
        )
        efforts = input_values(self, context, self._effort)
        share, drive = largest_share(efforts, self._effort_limits)
        health = self.EvalVectorInput(context, self._health)
        # Written so that a NaN is not trusted.
        bad = [] if health is None else np.flatnonzero(~(health.value() >= 1.0)).tolist()
        urgent, own_urgent = self._urgent_at(context, self._urgent, self._own_urgent)
        seen = Measurement(
            clearance=distance,
            clearance_rate=rate,
            own_clearance=own,
            own_rate=own_rate,
            tracking_error=error,
            force_share=share,
            healthy=len(bad) == 0,
            tip_rate=float(input_values(self, context, self._tip)[1]),
            phase=float(input_values(self, context, self._phase)[0]),
            wish=self._wish(context),
            urgent_clearance=urgent[0],
            urgent_rate=urgent[1],
            own_urgent_clearance=own_urgent[0],
            own_urgent_rate=own_urgent[1],
        )
        encoder = -1.0 if len(bad) == 0 else float(bad[0])
        rows = [distance, rate, own, own_rate, error, point, share, drive, encoder]
        return seen, rows + urgent + own_urgent

    def _urgent_at(self, context: Context, *ports: int) -> list[list[float]]:
        """Distance, rate and pair of optional ports, NaN where nothing is connected."""
        found = [self.EvalVectorInput(context, port) for port in ports]
        return [[math.nan] * 3 if one is None else one.value().tolist() for one in found]

    def _rate(self, last: float, now: float) -> float:
        """From two samples, m/s; zero at the first."""
        return 0.0 if math.isnan(last) else (now - last) / self._period


def _pack(decision: Decision, command: float, share: float) -> list[float]:
    """A decision and what it commands as discrete state."""
    return [
        command,
        share,
        float(brakes(decision)),
        float(decision.mode),
        float(decision.cause),
        *(float(decision.barred[cause]) for cause in BY_GRAVITY),
        *(decision.clear_for[cause] for cause in BY_GRAVITY),
        decision.least,
        decision.own_least,
        decision.error,
        decision.load,
        decision.lost_at,
        decision.waited,
        float(decision.release),
    ]


def _unpack(state: list[float]) -> Decision:
    """The decision in a discrete state."""
    _, _, _, mode, cause, *rest = state
    count = len(BY_GRAVITY)
    barred, clear_for, rest = rest[:count], rest[count : 2 * count], rest[2 * count :]
    least, own_least, error, load, lost_at, waited, release = rest
    return Decision(
        mode=Mode(int(mode)),
        cause=Cause(int(cause)),
        barred=dict(zip(BY_GRAVITY, map(int, barred), strict=True)),
        clear_for=dict(zip(BY_GRAVITY, clear_for, strict=True)),
        least=least,
        own_least=own_least,
        error=error,
        load=load,
        lost_at=lost_at,
        waited=waited,
        release=Release(int(release)),
    )
