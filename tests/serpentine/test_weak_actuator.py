"""An actuator that has lost stiffness gives way by what statics says of a softer spring.

Independent: gravity's work from Drake, lengths and levers by the law of cosines.
"""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.station import MakeSerpentineStation, MakeSimulator
from pips_drake.serpentine.systems.tip_path_source import HOLD

from .station_bench import INCH, scenario

#: README of the prototype: pins from their hinges, m, 90 deg apart; stiffness, N/m.
PINS = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
STIFFNESS = np.repeat([4e7, 3e7, 2e7], [7, 6, 3])
SHARE, L12 = 0.1, 9
WEAK = FaultConfig(kind="weak", drive="L12", size=SHARE, start_s=1 / 16)


def lengths(theta):
    return PINS * np.sqrt(2.0 - 2.0 * np.cos(np.pi / 2.0 + theta))


def levers(theta, step=1e-6):
    return (lengths(theta + step) - lengths(theta - step)) / (2.0 * step)


class Held:
    """A station with the fidelity `leg`, held at home."""

    def __init__(self, faults):
        made = scenario(actuation__fidelity="leg", faults=faults)
        self.station = MakeSerpentineStation(made)
        self.simulator = MakeSimulator(self.station, made)
        self.context = self.simulator.get_mutable_context()
        self.station.GetInputPort("tip_path_source.command").FixValue(self.context, [HOLD])
        self.plant = self.station.GetSubsystemByName("plant")

    def __getitem__(self, port):
        return np.array(self.station.GetOutputPort(port).Eval(self.context))

    @property
    def joints(self):
        return self["plant.state"][:18]

    def leg_forces(self, q):
        """What gravity asks of the actuators at q, (16,) N."""
        mine = self.plant.CreateDefaultContext()
        self.plant.SetPositions(mine, q)
        return -self.plant.CalcGravityGeneralizedForces(mine)[2:18] / levers(q[2:])

    @property
    def stiffness(self):
        """Of the plant's springs now, (16,) N/m."""
        mine = self.plant.GetMyContextFromRoot(self.context)
        ids = sorted(self.plant.GetConstraintIds(), key=lambda number: number.get_value())
        return np.array(
            [self.plant.GetDistanceConstraintParams(mine, one).stiffness() for one in ids]
        )


def test_a_weak_leg_gives_way_by_force_over_its_share_of_the_stiffness():
    held = Held([WEAK])
    left = np.where(np.arange(16) == L12, SHARE, 1.0)
    held.simulator.AdvanceTo(1 / 32)
    start = held.joints
    np.testing.assert_array_equal(held.stiffness, STIFFNESS)
    sent = lengths(start[2:]) + held.leg_forces(start) / STIFFNESS
    # What it carries falls and swings; after two seconds by 0.05 micrometres (measured).
    held.simulator.AdvanceTo(2.0)
    np.testing.assert_allclose(held.stiffness, left * STIFFNESS, rtol=1e-15)
    end = held.joints
    expected = sent - held.leg_forces(end) / (left * STIFFNESS)
    # A thousandth of what it gives way by; the others do not.
    np.testing.assert_allclose(lengths(end[2:]), expected, rtol=0, atol=3e-7)
    given = lengths(start[2:]) - lengths(end[2:])
    assert given[L12] > 3e-4 and np.abs(np.delete(given, L12)).max() < 1e-6
    # It carries what it carried, and gave way by F / k when it was sound, by F / (s k) now.
    force = held["actuator_force_map.drive_effort"][2:]
    np.testing.assert_allclose(force, held.leg_forces(end), rtol=1e-3, atol=0.1)
    assert given[L12] == pytest.approx((1.0 / SHARE - 1.0) * force[L12] / STIFFNESS[L12], rel=2e-3)


def test_only_in_its_time_is_an_actuator_weak():
    fault = FaultConfig(kind="weak", drive="L12", size=SHARE, start_s=1 / 32, duration_s=1 / 32)
    held, seen = Held([fault]), []
    for time in (1 / 64, 3 / 64, 5 / 64):
        held.simulator.AdvanceTo(time)
        seen.append(held.stiffness[L12] / STIFFNESS[L12])
    assert seen == pytest.approx([1.0, SHARE, 1.0])
