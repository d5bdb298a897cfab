"""Who holds the payload: switches the plant's welds as the program asks, between steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, EventStatus, System

from pips_drake.remote_manipulator.phases import SUPPORTS
from pips_drake.remote_manipulator.station.plant import Hold, RemoteManipulatorPlant

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class AttachmentEvent:
    """A weld that was switched, or a reset.

    Attributes:
        time: s.
        action: `hold`, `release` or `reset`.
        name: of the weld: `grasp`, `bay` or `port`; empty for a reset.
        slip: of a release: how far the weld's sides had come apart, m.
    """

    time: float
    action: str
    name: str
    slip: float = 0.0


class AttachmentMonitor:
    """Does at the end of every step what the program's `attachment` port asks for.

    Only the plant's own context says which welds are on, and no system may write there: a simulator
    calls `monitor` at the end of every step. Latency: none beside that step; where the payload is
    then, it is held, so that nothing jumps.

    Taking hold comes before letting go, so that nothing is loose at a hand-over.

    Args:
        machine: the plant with its welds.
        program: the system with the port `attachment` (3,): grasped 0 or 1; support, an index of
            `SUPPORTS`; number of resets so far. The simulated diagram or a part of it.
        port: the port's name on that system.
        grasped_pose: gives X_2P (7,), quaternion w x y z and position, m, from the root context, at
            which the payload is put when it is grasped; None: it is held where it is. That is a
            jump, as the report's snap to right angles is.
        on_reset: called with the root context after a reset; for what else begins anew.
    """

    def __init__(
        self,
        machine: RemoteManipulatorPlant,
        program: System,
        *,
        port: str = "attachment",
        grasped_pose: Callable[[Context], Array] | None = None,
        on_reset: Callable[[Context], None] | None = None,
    ) -> None:
        self._machine = machine
        self._program = program
        self._port = program.GetOutputPort(port)
        self._grasped_pose, self._on_reset = grasped_pose, on_reset
        self._contexts: tuple[Context, Context] | None = None
        self._last: tuple[float, ...] = ()
        #: What has been done, in order.
        self.events: list[AttachmentEvent] = []

    def initialize(self, root_context: Context) -> None:
        """Puts the plant into its initial state; call it once with every new context."""
        self._machine.set_initial_state(self._plant_context(root_context))
        self._contexts, self._last = None, ()
        self.events.clear()

    def monitor(self, root_context: Context) -> EventStatus:
        """Switches what has to be; what `Simulator.set_monitor` takes."""
        # The program's own context is looked up once a run: this is called every step.
        if self._contexts is None or self._contexts[0] is not root_context:
            self._contexts = root_context, self._program.GetMyContextFromRoot(root_context)
            self._last = ()  # what another context was asked for says nothing of this one
        asked = tuple(self._port.Eval(self._contexts[1]).tolist())
        if asked == self._last:
            return EventStatus.DidNothing()
        before, self._last = self._last, asked
        context = self._plant_context(root_context)
        if before and asked[2] != before[2]:
            self._reset(root_context, context)
        machine = self._machine
        wanted = {"grasp"} if asked[0] > 0.5 else set()
        support = SUPPORTS[round(asked[1])]
        if support != "none":
            wanted.add(support)
        on = {name for name, hold in machine.holds.items() if machine.is_engaged(context, hold)}
        # Bay and port share an adapter, so one lets go before the other takes hold.
        if {"bay", "port"} <= wanted | on:
            self._release(context, [name for name in ("bay", "port") if name in on - wanted])
            on &= wanted | {"grasp"}
        for name in sorted(wanted - on):
            if name == "grasp" and self._grasped_pose is not None:
                self._put_into_effector(context, self._grasped_pose(root_context))
            machine.engage(context, machine.holds[name])
            self._note(context, "hold", name)
        self._release(context, sorted(on - wanted))
        return EventStatus.Succeeded()

    def slip(self, root_context: Context) -> float:
        """The largest distance between the two sides of a weld that is on, m."""
        context = self._plant_context(root_context)
        machine = self._machine
        slips = [
            machine.slip(context, hold)
            for hold in machine.holds.values()
            if machine.is_engaged(context, hold)
        ]
        return max(slips, default=0.0)

    def _plant_context(self, root_context: Context) -> Context:
        return self._machine.plant.GetMyMutableContextFromRoot(root_context)

    def _note(self, context: Context, action: str, name: str = "", slip: float = 0.0) -> None:
        event = AttachmentEvent(time=context.get_time(), action=action, name=name, slip=slip)
        self.events.append(event)

    def _release(self, context: Context, names: list[str]) -> None:
        for name in names:
            hold: Hold = self._machine.holds[name]
            self._note(context, "release", name, self._machine.slip(context, hold))
            self._machine.release(context, hold)

    def _reset(self, root_context: Context, context: Context) -> None:
        self._machine.set_initial_state(context)
        self._note(context, "reset")
        if self._on_reset is not None:
            self._on_reset(root_context)

    def _put_into_effector(self, context: Context, pose: Array) -> None:
        """Places the payload, with its velocity, at X_2P."""
        machine = self._machine
        X_2P = RigidTransform(Quaternion(wxyz=pose[:4] / np.linalg.norm(pose[:4])), pose[4:])
        X_W2 = machine.plant.EvalBodyPoseInWorld(context, machine.effector)
        machine.plant.SetFreeBodyPose(context, machine.payload_body, X_W2.multiply(X_2P))
