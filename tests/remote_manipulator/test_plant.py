"""The modelled hardware: what is held stays, what is sent is followed, energy does not grow."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.drives import make_drives, step_response
from pips_drake.remote_manipulator.geometry import docking_port, probe_tip
from pips_drake.remote_manipulator.station.plant import (
    X_WR,
    PlantSettings,
    docked_pose,
    home_arm_vector,
    make_plant,
)
from pips_drake.scene.loading import AddPlacedFrame, AddScene
from pips_drake.scene.packages import find_scene_file
from pips_drake.twin.model_viewer import view_model

from .plant_bench import BELOW, CONFIG, Bench, carry, holding

#: Beside the docked payload.
ASIDE = home_arm_vector(CONFIG) + math.radians(80.0) * np.eye(8)[1]
#: Above the bay, the cabin and the stand, aft of the CAE.
HIGH = np.array([9.0, -2.7, -7.2])
#: The payload a hand's breadth above its place in the bay.
LOW = np.array([10.6, -2.7, -0.6])


def loaded(*, at=HIGH, mass_times=1.0, **settings):
    """The payload in the effector, whose palm is `at`."""
    bench = Bench(
        support="none",
        X_RP=RigidTransform(at + np.array([0.0, 0.0, BELOW])),
        arm_vector=holding(at),
        **settings,
    )
    if mass_times != 1.0:
        body, context = bench.machine.payload_body, bench.context
        inertia = body.CalcSpatialInertiaInBodyFrame(context)
        heavier = type(inertia)(
            inertia.get_mass() * mass_times, inertia.get_com(), inertia.get_unit_inertia()
        )
        body.SetSpatialInertiaInBodyFrame(context, heavier)
    bench.ask(grasped=True)
    bench.step()
    return bench


@pytest.mark.parametrize("translates", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "settings",
    [{"support": "bay"}, {"support": "none"}, {"support": "port", "arm_vector": ASIDE}],
    ids=["bay", "none", "port"],
)
def test_at_rest_nothing_touches_and_nothing_moves(settings, translates):
    bench = Bench(orbiter_translates=translates, **settings)
    assert bench.penetrations() == []
    before = bench.positions()
    bench.run(10.0)
    # A fifth of a millimetre would be seen as drift in a long run; the arm bends by 5 um.
    np.testing.assert_allclose(bench.positions(), before, atol=1e-5)
    assert bench.penetrations() == []


def test_everything_stands_where_the_configuration_says():
    bench = Bench(support="bay", cae_offset=[0.5, 0.0, -0.25])
    machine, R = bench.machine, bench.machine.orbiter.body_frame()
    assert bench.plant.EvalBodyPoseInWorld(bench.context, machine.orbiter).IsNearlyEqualTo(
        X_WR, 1e-12
    )
    X_RP = bench.payload_in(R)
    np.testing.assert_allclose(X_RP.translation(), CONFIG.payload.location_m, atol=1e-12)
    np.testing.assert_allclose(X_RP.rotation().matrix(), np.eye(3), atol=1e-12)
    X_RC = bench.plant.CalcRelativeTransform(bench.context, R, machine.cae.body_frame())
    place = CONFIG.central_assembly_element.location_m + np.array([0.5, 0.0, -0.25])
    np.testing.assert_allclose(X_RC.translation(), place, atol=1e-12)
    np.testing.assert_allclose(bench.arm_vector(), home_arm_vector(CONFIG), atol=1e-12)


def test_scene_that_is_looked_at_stands_as_the_plant_does():
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.0)
    AddPlacedFrame(plant, "frame_0", RigidTransform())
    AddScene(plant, find_scene_file("remote_manipulator"))
    plant.Finalize()
    context, bench = plant.CreateDefaultContext(), Bench(support="bay")
    machine = bench.machine
    for body in (machine.orbiter, machine.effector, machine.payload_body, machine.cae):
        seen = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(body.name()))
        X_WB = bench.plant.EvalBodyPoseInWorld(bench.context, body)
        assert seen.IsNearlyEqualTo(X_WB, 1e-9), body.name()
    view_model("remote_manipulator", once=True)


def test_docked_payload_has_its_probe_in_the_port():
    X_RC = RigidTransform(CONFIG.central_assembly_element.location_m)
    tip = docked_pose(CONFIG, X_RC).multiply(probe_tip(CONFIG))
    np.testing.assert_allclose(tip, X_RC.multiply(docking_port(CONFIG)), atol=1e-12)


def test_free_flyer_goes_straight_on_with_its_spin():
    """No gravity, no drag: momentum stays to the last digits that an implicit step leaves."""
    velocity, spin = [0.01, -0.02, -0.03], [0.0, 0.0, 0.002]
    place = RigidTransform([12.0, -2.7, -20.0])
    bench = Bench(support="none", X_RP=place, velocity=velocity, spin=spin)
    bench.run(10.0)
    X_RP = bench.payload_in(bench.machine.orbiter.body_frame())
    expected = place.translation() + 10.0 * np.array(velocity)
    np.testing.assert_allclose(X_RP.translation(), expected, atol=1e-9)
    heading = math.atan2(X_RP.rotation().matrix()[1, 0], X_RP.rotation().matrix()[0, 0])
    assert heading == pytest.approx(10.0 * 0.002, abs=1e-6)


def test_step_of_the_prong_is_the_closed_forms():
    """Its drive alone is soft enough to see the inertia: J q'' + d q' + p q = p q_d."""
    bench = Bench(support="bay")
    drives = make_drives(CONFIG)
    vector = bench.arm_vector()
    target, step = vector.copy(), -0.05
    target[7] += step
    bench.send(target)
    times, found = np.arange(1, 41) * 0.05, []
    for _ in times:
        bench.run(0.05)
        found.append(bench.arm_vector()[7] - vector[7])
    expected = step * step_response(
        times, CONFIG.effector.prong_mass_kg, drives.stiffness[7], drives.damping[7]
    )
    # Implicit Euler: an error of the order of the step times the fastest rate of 36 1/s.
    np.testing.assert_allclose(found, expected, atol=0.05 * abs(step))
    assert found[-1] == pytest.approx(step, rel=0.01)


def test_loaded_shoulder_turns_by_no_more_than_its_torque():
    """A far target: 1570 N m turn the payload by (T / J) t^2 / 2, J from the mass matrix."""
    bench = loaded()
    arm = bench.plant.GetJointByName("H0", bench.machine.arm).velocity_start()
    inertia = bench.plant.CalcMassMatrix(bench.context)
    inertia = inertia[arm, arm] + _payload_inertia_about_stand(bench)
    target = bench.arm_vector()
    target[1] += 0.5
    before = bench.arm_vector()[1]
    bench.send(target)
    bench.run(4.0)
    turned = bench.arm_vector()[1] - before
    # The other joints give way under the payload's inertia: they are held by drives too.
    assert turned == pytest.approx(0.5 * 1570.0 / inertia * 4.0**2, rel=0.1)
    efforts = bench.plant.get_net_actuation_output_port(bench.machine.arm).Eval(bench.context)
    limits = make_drives(CONFIG).effort
    assert np.all(np.abs(efforts) <= limits * (1.0 + 1e-9))
    assert abs(efforts[1]) == pytest.approx(1570.0)


def _payload_inertia_about_stand(bench):
    X = bench.payload_in(bench.machine.orbiter.body_frame()).translation()
    mass = CONFIG.payload.mass_kg
    _, _, across = (
        bench.machine.payload_body.default_spatial_inertia().get_unit_inertia().get_moments()
    )
    return mass * (X[0] ** 2 + X[1] ** 2 + across)


def test_bounce_on_the_bays_wall_takes_energy_and_stays_shallow():
    bench = Bench(support="none", velocity=[0.0, 0.06, 0.0])
    gap = 0.5 * (CONFIG.cargo_bay.width_m - CONFIG.payload.across_flats_m)
    energy, deepest = [], 0.0
    for _ in range(60):
        bench.run(0.1)
        energy.append(bench.plant.CalcKineticEnergy(bench.context))
        moved = bench.payload_in(bench.machine.orbiter.body_frame()).translation()[1]
        deepest = max(deepest, moved - CONFIG.payload.location_m[1] - gap)
    # v sqrt(m / k): 1.9 mm with two surfaces of 2e7 N/m in series and no damping.
    assert 0.1e-3 < deepest < 1.9e-3
    assert energy[0] == pytest.approx(0.5 * CONFIG.payload.mass_kg * 0.06**2, rel=1e-6)
    assert 0.0 < energy[-1] < 0.5 * energy[0]
    # While they touch, some of it is in the contact; else it only falls.
    assert max(energy[30:]) <= energy[30] * (1.0 + 1e-6)


def test_tracks_a_straight_carry():
    """10 t at 10 m and 0.06 m/s, within millimetres if it begins and ends gently."""
    bench = loaded()
    way = carry(HIGH, [-1.0, 0.0, 0.0], length=0.5, speed=0.06, acceleration=0.01)
    # Reach of the torques: 0.011 m/s^2 (`drives`). The rest is the frame's discrete ramp.
    assert bench.follow(*way) < 5e-3
    bench.run(2.0)
    assert bench.monitor.slip(bench.root) < 1e-6


@pytest.mark.slow
def test_abrupt_starts_and_stops_of_the_loaded_arm_cost_a_tenth_of_a_metre_and_no_overshoot():
    """From v^2 / (2 a): the torque limits, not the drives, say how far the payload goes on."""
    bench = loaded(at=LOW)
    times, vectors = carry(LOW, [0.0, 0.0, -1.0], length=2.0, speed=0.06, acceleration=10.0)
    worst = bench.follow(times, vectors)
    assert 0.01 < worst < 0.2
    goal, beyond = LOW[2] - 2.0, []
    for _ in range(200):
        bench.run(0.2)
        beyond.append(goal - bench.palm()[2])
    assert max(beyond) < 0.2
    # No swinging: once it is back it stays.
    assert np.abs(beyond[100:]).max() < 2e-3


@pytest.mark.slow
def test_empty_arm_tracks_within_millimetres():
    bench = Bench(support="bay", arm_vector=holding(HIGH))
    for speed in (0.06, 0.2):
        way = carry(bench.palm(), [-1.0, 0.0, 0.0], length=2.0, speed=speed, acceleration=0.05)
        assert bench.follow(*way) < 2e-3
        bench.run(2.0)
        back = way[0], way[1][::-1]
        assert bench.follow(*back) < 2e-3
        bench.run(2.0)


@pytest.mark.slow
def test_heaviest_payload_is_held_and_carried():
    """The flight limit of 29,484 kg, with drives that were laid out for 10 t."""
    bench = loaded(mass_times=2.9484)
    way = carry(HIGH, [-1.0, 0.0, 0.0], length=1.0, speed=0.03, acceleration=0.003)
    assert bench.follow(*way) < 20e-3
    bench.run(30.0)
    assert np.linalg.norm(bench.plant.GetVelocities(bench.context)) < 1e-3


@pytest.mark.slow
def test_shorter_steps_change_nothing_that_matters():
    ends = []
    for hz in (100, 200, 500):
        bench = loaded(time_step=1.0 / hz)
        way = carry(HIGH, [-1.0, 0.0, 0.0], length=0.6, speed=0.06, acceleration=10.0)
        ends.append((bench.follow(*way), *bench.palm()))
    # Where the payload is while it is braked, of steps of 10, 5 and 2 ms: first order, so that
    # 10 ms at 0.06 m/s may be 0.6 mm off.
    for one in ends[:2]:
        np.testing.assert_allclose(one, ends[2], atol=1e-3)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (PlantSettings(support="floor"), "payload.support = 'floor'; must be none or bay or port"),
        (PlantSettings(support="bay", velocity=[0.1, 0.0, 0.0]), "must be zero"),
        (PlantSettings(arm_vector=np.zeros(7)), "must be (8,)"),
        (PlantSettings(arm_vector=np.zeros(8)), "height = 0 m; must be 2 .. 4 m"),
    ],
)
def test_bad_settings_are_refused(settings, words):
    with pytest.raises(InputError) as caught:
        make_plant(DiagramBuilder(), CONFIG, settings)
    assert words in str(caught.value)
