"""The free flyer's jets make the limit cycle that a double integrator's closed form says."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from pips_drake.remote_manipulator.systems.attitude_limit_cycle import AttitudeLimitCycle

#: Of the body, about its axes, kg m^2.
MOMENTS = np.array([2.0e4, 2.0e5, 2.0e5])
BAND, TORQUE, RETURN = np.radians(0.5), 200.0, np.radians(0.05)
#: The jets are looked at this often, s.
PERIOD = 0.02
#: Another attitude than that of the world is kept.
KEPT = RotationMatrix.MakeXRotation(2.0) @ RotationMatrix.MakeZRotation(0.7)


class Flyer:
    """A free body with its jets, and who may hold it."""

    def __init__(self, spin):
        builder = DiagramBuilder()
        self.plant = builder.AddSystem(MultibodyPlant(0.01))
        mass = 1.0e4
        # A box's proportions that have those moments.
        inertia = UnitInertia(*(MOMENTS / mass))
        body = self.plant.AddRigidBody("flyer", SpatialInertia(mass, np.zeros(3), inertia))
        self.plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        self.plant.Finalize()
        jets = builder.AddSystem(
            AttitudeLimitCycle(
                body.index(),
                attitude=KEPT.matrix(),
                dead_band=BAND,
                torque=TORQUE,
                return_rate=RETURN,
                period=PERIOD,
            )
        )
        self._asked = builder.AddSystem(ConstantVectorSource(np.zeros(3)))
        builder.Connect(self._asked.get_output_port(), jets.GetInputPort("attachment"))
        state = self.plant.get_state_output_port()
        builder.Connect(state, jets.GetInputPort("payload_state"))
        builder.Connect(
            jets.GetOutputPort("spatial_force"), self.plant.get_applied_spatial_force_input_port()
        )
        self.simulator = Simulator(builder.Build())
        self.context = self.plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        self.jets, self.body = jets, body
        self.plant.SetFreeBodyPose(self.context, body, RigidTransform(KEPT, [1.0, 2.0, 3.0]))
        velocity = np.concatenate([KEPT.matrix() @ spin, np.zeros(3)])
        self.plant.SetVelocities(self.context, velocity)

    def ask(self, values):
        root = self.simulator.get_mutable_context()
        context = self._asked.GetMyMutableContextFromRoot(root)
        self._asked.get_mutable_source_value(context).set_value(np.asarray(values, dtype=float))

    def angles(self, duration, every=0.1):
        """Rows of the angles about the kept attitude's axes, small, rad."""
        rows, now = [], self.simulator.get_context().get_time()
        for k in range(round(duration / every)):
            self.simulator.AdvanceTo(now + (k + 1) * every)
            X = self.plant.EvalBodyPoseInWorld(self.context, self.body)
            R = KEPT.matrix().T @ X.rotation().matrix()
            rows.append(0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]))
        return np.array(rows)


@pytest.mark.parametrize("axis", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_period_and_amplitude_are_the_closed_forms(axis):
    spin = RETURN * np.eye(3)[axis]
    flyer = Flyer(spin)
    angle = flyer.angles(260.0)[:, axis]
    inertia = MOMENTS[axis]
    # A look every 20 ms sees the band's end late by as much, and lets a jet end so late.
    late = PERIOD
    amplitude = BAND + RETURN**2 * inertia / (2.0 * TORQUE)
    assert angle.max() == pytest.approx(amplitude, abs=2.0 * RETURN * late)
    assert angle.min() == pytest.approx(-amplitude, abs=2.0 * RETURN * late)
    rising = np.flatnonzero((angle[:-1] < 0.0) & (angle[1:] >= 0.0))
    crossings = rising + angle[rising] / (angle[rising] - angle[rising + 1])
    period = 0.1 * np.diff(crossings)
    expected = 4.0 * BAND / RETURN + 4.0 * RETURN * inertia / TORQUE
    # The rate of return is up to 20 ms of torque too fast: 20 ms * 1e-3 rad/s^2 of 8.7e-4 rad/s.
    assert len(period) >= 4
    np.testing.assert_allclose(period, expected, rtol=0.03)


def test_first_swing_is_as_wide_as_the_torque_allows():
    spin = np.radians(0.4)
    flyer = Flyer([0.0, spin, 0.0])
    angle = flyer.angles(20.0)[:, 1]
    widest = BAND + spin**2 * MOMENTS[1] / (2.0 * TORQUE)
    assert angle.max() == pytest.approx(widest, rel=0.02)
    # It has come back, and stays.
    flyer.angles(40.0, every=1.0)
    later = flyer.angles(30.0, every=0.5)[:, 1]
    assert np.abs(later).max() < BAND + 2.0 * RETURN**2 * MOMENTS[1] / TORQUE


@pytest.mark.slow
def test_all_axes_stay_in_their_bands_together():
    flyer = Flyer(np.radians([0.2, -0.1, 0.15]))
    flyer.angles(60.0)
    angles = flyer.angles(200.0)
    assert np.abs(angles).max() < 1.2 * BAND
    assert np.ptp(angles, axis=0).min() > BAND  # and they do swing


def test_jets_do_not_push_it_away():
    flyer = Flyer(np.radians([0.2, -0.1, 0.15]))
    flyer.angles(20.0)
    X = flyer.plant.EvalBodyPoseInWorld(flyer.context, flyer.body)
    np.testing.assert_allclose(X.translation(), [1.0, 2.0, 3.0], atol=1e-9)


def test_jets_are_off_once_it_is_held_until_a_reset():
    spin = np.radians(0.4)
    flyer = Flyer([0.0, spin, 0.0])
    torque = flyer.jets.GetOutputPort("torque")
    context = flyer.jets.GetMyContextFromRoot(flyer.simulator.get_context())
    flyer.angles(2.0)
    assert torque.Eval(context)[1] == -TORQUE
    for asked, off in (
        ([1.0, 0.0, 0.0], True),
        ([0.0, 0.0, 0.0], True),
        ([0.0, 0.0, 1.0], False),
        ([0.0, 2.0, 1.0], True),
    ):
        flyer.ask(asked)
        flyer.angles(0.1)
        assert (torque.Eval(context)[1] == 0.0) == off
