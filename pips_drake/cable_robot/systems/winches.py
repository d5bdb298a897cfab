"""The winches: from what the controller wants to what is reeled out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from pips_drake.cable_robot.robot import CableRobot
from pips_drake.config import require
from pips_drake.errors import InputError
from pips_drake.twin.systems.inputs import input_values

Array = NDArray[np.float64]

CONTROLS = ("length", "tension")
OVERLOADS = ("hold", "slip")
#: A slipping winch pays out so fast that what is above its largest force is gone in this time, s.
SLIP_TIME = 0.02


def rounded(values: Array, step: float) -> Array:
    """The nearest whole steps; 0 has none."""
    return values.copy() if step == 0.0 else np.asarray(np.round(values / step) * step)


class Winches(LeafSystem):
    """Reels M cables within their speed and force, by length or by tension.

    .. pydrake_system::

        name: Winches
        input_ports:
        - command
        - tensions
        - brake
        - command_rate
        output_ports:
        - unstretched
        - rate
        - encoder
        - force_reading

    Input ports:

    - `command`, (M,): unstretched lengths, m, or tensions, N.
    - `tensions`, (M,): of the cables, N.
    - `brake`, (1,): above 0.5 all winches stand still; optional.
    - `command_rate`, (M,): of the lengths, m/s, under control by tension; optional.

    Output ports; all but `force_reading` are from state, without feedthrough:

    - `unstretched`, (M,): what is truly reeled out, m.
    - `rate`, (M,): at which it changes, m/s.
    - `encoder`, (M,): what the encoders say is reeled out, m: whole steps, and less by the
      calibration error than what is.
    - `force_reading`, (M,): `tensions` in whole steps, N.

    State, discrete, updated every `period` s: lengths and rates, (2 M,); updates that are left
    until the next command is read, (1,).

    By length: a command is rounded to encoder steps, read every `control_period`, one period after
    it is written, and reached a control period later at a constant rate, if the speed allows.

    By tension: the rate is that of `command_rate` plus bandwidth l0 / (E A) (reading - command),
    within the speed; with the platform held, the tension goes to its command with that bandwidth.
    Without the first, a cable that moves at 0.1 m/s would miss its tension by hundreds of newtons.

    A cable at `force_limit` or above is reeled in no farther: `hold`, the winch keeps what it has
    and its brake bears whatever more comes; `slip`, it lets out so much that the excess is gone in
    0.02 s.

    Args:
        cable_robot: with M cables.
        first_lengths: what is reeled out at first by the encoders, (M,) m.
        control: `length` or `tension`.
        speed: limit, m/s.
        force_limit: of a winch, N.
        overload: `hold` or `slip`.
        encoder_step: m; 0: none.
        force_step: of the sensors, N; 0: none.
        calibration_error: of what is reeled out, less what the encoders say, (M,) m.
        bandwidth: of the tension, rad/s.
        period: s.
        control_period: of the commands, s; a multiple of `period`.
    """

    def __init__(
        self,
        cable_robot: CableRobot,
        *,
        first_lengths: ArrayLike,
        control: str = "length",
        speed: float = 0.5,
        force_limit: float = math.inf,
        overload: str = "hold",
        encoder_step: float = 0.0,
        force_step: float = 0.0,
        calibration_error: ArrayLike = 0.0,
        bandwidth: float = 20.0,
        period: float = 1.0 / 400.0,
        control_period: float = 0.04,
    ) -> None:
        super().__init__()
        count = cable_robot.cables
        require(control in CONTROLS, "winches: control", control, " or ".join(CONTROLS))
        require(overload in OVERLOADS, "winches: overload", overload, " or ".join(OVERLOADS))
        for name, value in (("speed", speed), ("force_limit", force_limit)):
            require(value > 0.0, f"winches: {name}", f"{value:g}", "> 0")
        for name, value in (("encoder_step", encoder_step), ("force_step", force_step)):
            good = math.isfinite(value) and value >= 0.0
            require(good, f"winches: {name}", f"{value:g}", ">= 0")
        self._every = round(control_period / period)
        good = self._every >= 1 and abs(self._every * period - control_period) < 1e-9
        allowed = f"a multiple of {period:g} s"
        require(good, "winches: control_period", f"{control_period:g} s", allowed)
        first = np.asarray(first_lengths, dtype=np.float64)
        if first.shape != (count,) or not np.all(first > 0.0):
            raise InputError(
                f"winches: first_lengths of shape {first.shape}; must be ({count},), > 0 m"
            )
        self._count, self._control, self._slips = count, control, overload == "slip"
        self._speed, self._force_limit, self._bandwidth = speed, force_limit, bandwidth
        self._encoder_step, self._force_step = encoder_step, force_step
        self._error = np.broadcast_to(np.asarray(calibration_error, dtype=float), count).copy()
        self._period, self._control_period = period, control_period
        self._flexibility = 1.0 / cable_robot.axial_stiffness
        ports = [self.DeclareVectorInputPort(name, count) for name in ("command", "tensions")]
        ports.append(self.DeclareVectorInputPort("brake", 1))
        ports.append(self.DeclareVectorInputPort("command_rate", count))
        self._command, self._tensions, self._brake, self._command_rate = (
            int(port.get_index()) for port in ports
        )
        reeled = rounded(first, encoder_step) + self._error
        self._lengths = self.DeclareDiscreteState(reeled)
        self._rates = self.DeclareDiscreteState(count)
        # Commands that are written at a time are read one update later.
        self._left = self.DeclareDiscreteState([1.0])
        self.DeclareStateOutputPort("unstretched", self._lengths)
        self.DeclareStateOutputPort("rate", self._rates)
        self.DeclareVectorOutputPort(
            "encoder",
            count,
            self._calc_encoder,
            prerequisites_of_calc={self.discrete_state_ticket(self._lengths)},
        )
        self.DeclareVectorOutputPort(
            "force_reading",
            count,
            self._calc_force_reading,
            prerequisites_of_calc={self.input_port_ticket(ports[1].get_index())},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        # They hold the present values.
        lengths = values.get_mutable_vector(self._lengths).get_mutable_value()
        rates = values.get_mutable_vector(self._rates).get_mutable_value()
        left = values.get_mutable_vector(self._left).get_mutable_value()
        lengths += rates * self._period
        tensions = input_values(self, context, self._tensions)
        if self._control == "length":
            if left[0] < 0.5:
                command = rounded(input_values(self, context, self._command), self._encoder_step)
                missing = command + self._error - lengths
                np.clip(missing / self._control_period, -self._speed, self._speed, out=rates)
                left[0] = self._every
            left[0] -= 1.0
        else:
            excess = rounded(tensions, self._force_step)
            excess -= input_values(self, context, self._command)
            wanted = self._bandwidth * lengths * self._flexibility * excess
            moving = self.EvalVectorInput(context, self._command_rate)
            if moving is not None:
                wanted += moving.value()
            np.clip(wanted, -self._speed, self._speed, out=rates)
        over = tensions - self._force_limit
        if over.max() >= 0.0:
            limited = over >= 0.0
            least = over * lengths * self._flexibility / SLIP_TIME if self._slips else 0.0
            rates[:] = np.where(limited, np.maximum(rates, least), rates)
        brake = self.EvalVectorInput(context, self._brake)
        if brake is not None and brake.value()[0] > 0.5:
            rates[:] = 0.0

    def _calc_encoder(self, context: Context, output: BasicVector) -> None:
        reeled = context.get_discrete_state(self._lengths).value() - self._error
        output.SetFromVector(rounded(reeled, self._encoder_step))

    def _calc_force_reading(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(rounded(input_values(self, context, self._tensions), self._force_step))
