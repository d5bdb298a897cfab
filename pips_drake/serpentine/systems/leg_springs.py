"""Actuators as springs whose free length is commanded: what to ask of the plant, and the force."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import write_drive_state
from pips_drake.serpentine.faults import Fault, stiffness_shares
from pips_drake.twin.systems.inputs import input_values

Array = NDArray[np.float64]


class LegSprings(LeafSystem):
    """From leg commands to the free lengths that a plant's springs take, and the forces they make.

    .. pydrake_system::

        name: LegSprings
        input_ports:
        - leg_command
        - joint_state
        output_ports:
        - free_length
        - leg_force
        - stiffness_share

    Input ports (A actuators, L3 ..):

    - `leg_command`, (2 A,): commanded lengths, m, and their rates, m/s.
    - `joint_state`, (2 J,): the plant's joint values, m and rad, and their rates.

    Output ports:

    - `free_length`, (A,): m, with feedthrough of the command: a request, which only the plant's
      owner can grant (`station.legs.LegServer`), at the plant's next step.
    - `leg_force`, (A,): N, a pushing actuator is positive; with feedthrough of the joint state
      alone.
    - `stiffness_share`, (A,): a request as `free_length`, of time alone: 1 for a sound actuator.

    State, discrete, updated every `period` s and at initialization: the free lengths, m, and the
    shares of stiffness with which the plant makes its present step, (2 A,).

    A spring that is damped against the plant's rate alone would hold a moving leg back by its
    damping time d / k: the free length leads the command by that time, L0 = L_c + (d / k) L_c'.
    The force is that of the plant's own spring, F = s (k (L0 - L) - d L'), with the share s that
    faults leave.

    Args:
        arm: the arm.
        period: the plant's step, s.
        faults: of the drives, of which `weak` ones count (`faults.make_drive_faults`).
    """

    def __init__(self, arm: SerpentineArm, *, period: float, faults: Sequence[Fault] = ()) -> None:
        super().__init__()
        self._faults = tuple(faults)
        self._triangles, self._joints = arm.linkage.triangles, arm.joints
        self._first, self._legs = arm.first_actuated_joint, len(arm.actuator_names)
        self._stiffness, self._lead = arm.linkage.stiffness, arm.actuator_damping_time
        command_port = self.DeclareVectorInputPort("leg_command", 2 * self._legs)
        joint_port = self.DeclareVectorInputPort("joint_state", 2 * arm.joints)
        self._command_index = int(command_port.get_index())
        self._joint_index = int(joint_port.get_index())
        self._applied = self.DeclareDiscreteState(2 * self._legs)
        self.DeclareVectorOutputPort(
            "free_length",
            self._legs,
            self._calc_free_length,
            prerequisites_of_calc={self.input_port_ticket(command_port.get_index())},
        )
        self.DeclareVectorOutputPort(
            "leg_force",
            self._legs,
            self._calc_leg_force,
            prerequisites_of_calc={
                self.input_port_ticket(joint_port.get_index()),
                self.xd_ticket(),
            },
        )
        self.DeclareVectorOutputPort(
            "stiffness_share",
            self._legs,
            self._calc_stiffness_share,
            prerequisites_of_calc={self.time_ticket()},
        )
        self.DeclareInitializationDiscreteUpdateEvent(self._update)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _free_length(self, context: Context) -> Array:
        command = input_values(self, context, self._command_index)
        wanted: Array = command[: self._legs] + self._lead * command[self._legs :]
        return wanted

    def _calc_free_length(self, context: Context, output: BasicVector) -> None:
        output.get_mutable_value()[:] = self._free_length(context)

    def _calc_stiffness_share(self, context: Context, output: BasicVector) -> None:
        time, shares = context.get_time(), output.get_mutable_value()
        stiffness_shares(self._faults, time, self._first, shares)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        applied = values.get_mutable_vector(self._applied).get_mutable_value()
        applied[: self._legs] = self._free_length(context)
        stiffness_shares(self._faults, context.get_time(), self._first, applied[self._legs :])

    def _calc_leg_force(self, context: Context, output: BasicVector) -> None:
        drive_state = np.empty(2 * self._joints)
        write_drive_state(
            self._triangles, input_values(self, context, self._joint_index), drive_state
        )
        length, rate = drive_state.reshape(2, -1)[:, self._first :]
        applied, share = context.get_discrete_state(self._applied).value().reshape(2, -1)
        stiffness = share * self._stiffness
        output.get_mutable_value()[:] = stiffness * (applied - length - self._lead * rate)
