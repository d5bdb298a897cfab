"""Mechanics that need no reference: energy is conserved, and the arm sags as its springs say.

And the twin's discrete steps against a continuous plant's error-controlled ones. Measurements that
docs/physics.md shows are those of docs/make_physics.py.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from pips_drake.scenarios import load_scenario
from pips_drake.serpentine.runs.run import run_station
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import MakeSerpentineStation, MakeSimulator, load_setup
from pips_drake.serpentine.systems.tip_path_source import DONE, HOLD

DOCS = Path(__file__).resolve().parents[2] / "docs"
#: Gravity in the world, m/s^2, and how frame 0 stands there on the pad: x0, y0, z0 as columns.
GRAVITY = np.array([0.0, 0.0, -9.81])
PAD = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
INCH = 0.0254
#: Stiffness of the joints from FACTS' assumed table: k along the actuator times its lever squared,
#: a / sqrt 2 where the hinge is straight; the rail's and the crane's are the arm file's.
PINS = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
STIFFNESS = np.append([2e7, 4e6], np.repeat([4e7, 3e7, 2e7], [7, 6, 3]) * PINS**2 / 2.0)


@pytest.fixture(scope="module")
def physics():
    """docs/make_physics.py as a module."""
    spec = importlib.util.spec_from_file_location("make_physics", DOCS / "make_physics.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Bodies:
    """The arm's bodies in the world, by Table A.1's matrices; of the arm only masses and boxes."""

    def __init__(self, arm, table, report_frames):
        self.masses = np.array([body.mass for body in arm.bodies])
        self.centres = np.array([body.centre for body in arm.bodies])
        squares = np.array([body.size**2 for body in arm.bodies])
        # Uniform boxes: m (b^2 + c^2) / 12 about each axis.
        self.inertias = self.masses[:, None] * (squares.sum(axis=1)[:, None] - squares) / 12.0
        self._table, self._report_frames = table, report_frames

    def frames(self, q):
        """Rotations (18, 3, 3) and origins (18, 3) m of the bodies in the world."""
        frames = self._report_frames(self._table, q)
        return PAD @ frames[:, :3, :3], frames[:, :3, 3] @ PAD.T

    def mass_centres(self, q):
        rotations, origins = self.frames(q)
        return origins + np.einsum("bij,bj->bi", rotations, self.centres)

    def potential_energy(self, q):
        """Sum of m g h, J."""
        return -self.masses @ self.mass_centres(q) @ GRAVITY

    def kinetic_energy(self, q, v, step=1e-6):
        """Sum of m v^2 / 2 and w I w / 2, J, velocities by differences of the matrices."""
        ahead, behind = q + step * v, q - step * v
        velocity = (self.mass_centres(ahead) - self.mass_centres(behind)) / (2.0 * step)
        change = (self.frames(ahead)[0] - self.frames(behind)[0]) / (2.0 * step)
        # R^T R' is the cross product with the angular velocity in the body.
        spin = np.einsum("bji,bjk->bik", self.frames(q)[0], change)
        omega = np.column_stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]])
        return 0.5 * (self.masses @ np.sum(velocity**2, axis=1) + np.sum(self.inertias * omega**2))

    def gravity_efforts(self, q):
        """What gravity does to the joints, (18,) N and Nm: m g x r of all that hangs on each."""
        rotations, origins = self.frames(q)
        centres = self.mass_centres(q)
        efforts = np.zeros(18)
        for j in range(18):
            axis = rotations[j][:, 2]
            weights = self.masses[j:, None] * GRAVITY
            if j == 0:
                efforts[j] = axis @ weights.sum(axis=0)
            else:
                efforts[j] = axis @ np.cross(centres[j:] - origins[j], weights).sum(axis=0)
        return efforts

    def sagged(self, command):
        """Where springs at `command` and gravity are in balance, (18,)."""
        q = command
        for _ in range(20):  # the sag changes its own loads by a thousandth a turn
            q = command + self.gravity_efforts(q) / STIFFNESS
        return q

    def tip(self, q):
        return self.frames(q)[1][-1]


@pytest.fixture(scope="module")
def bodies(arm, table_a1, report_frames):
    return Bodies(arm, table_a1, report_frames)


def orders(measure, rates):
    """Observed orders between neighbouring rates, by twos."""
    assert np.all(np.diff(np.log2(rates)) == 1.0)
    errors = np.array([measure(rate) for rate in rates])
    return np.log2(errors[:-1] / errors[1:])


def test_the_plants_energies_are_sums_over_the_bodies(physics, bodies):
    plant = physics.free_plant(0.0)
    context = plant.CreateDefaultContext()
    rng = np.random.default_rng(4)
    for _ in range(5):
        q, v = rng.uniform(-0.5, 0.5, 18), rng.normal(0.0, 1.0, 18)
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        potential = plant.CalcPotentialEnergy(context)
        np.testing.assert_allclose(potential, bodies.potential_energy(q), rtol=0, atol=1e-9)
        kinetic = plant.CalcKineticEnergy(context)
        # Differences of numbers up to 5 m over 1e-6 s: 1e-9 m/s on some metres a second.
        assert kinetic == pytest.approx(bodies.kinetic_energy(q, v), rel=1e-7)
        mass_matrix = plant.CalcMassMatrix(context)
        assert kinetic == pytest.approx(0.5 * v @ mass_matrix @ v, rel=1e-12)


# Drift is of the integrator's order once its leading term is all that counts; the rates are those
# from which on it is, by measurement, within the tolerance.
@pytest.mark.parametrize(
    ("scheme", "order", "rates"),
    [
        # Semi-implicit Euler steps.
        ("discrete", 1.0, (512, 1024, 2048)),
        ("runge_kutta2", 2.0, (512, 1024, 2048)),
        ("runge_kutta3", 3.0, (256, 512, 1024)),
        ("radau3", 3.0, (256, 512, 1024)),
    ],
)
def test_energy_without_gains_drifts_by_the_order_of_the_integrator(physics, scheme, order, rates):
    observed = orders(lambda rate: physics.energy_drift(scheme, rate), rates)
    np.testing.assert_allclose(observed, order, rtol=0, atol=0.15)


def test_energy_drifts_little_beside_what_moves(physics):
    # 1.1 kJ of kinetic energy after half a second of falling: at the twin's step 1 % of it changes,
    # and a thousandth of a thousandth at that of the third order.
    assert physics.energy_drift("discrete", 512) < 0.01 * 1.1e3
    assert physics.energy_drift("runge_kutta3", 512) < 1e-6 * 1.1e3


def hold_still(end, duration):
    """Holds the arm, not compensated, at home or at the path's end, from the unsagged posture.

    Returns:
        The commanded posture and the one after `duration` s, (18,) each, and the rates then.
    """
    scenario = SerpentineScenario(path="trajectory_4_arcs")
    scenario.actuation.compensate_deflection = False
    scenario.clocks.clearance_hz = 1  # nobody looks
    station = MakeSerpentineStation(scenario)
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    station.GetInputPort("tip_path_source.command").FixValue(context, [HOLD])
    if end:
        source = station.GetSubsystemByName("tip_path_source")
        at_end = [1e3, 0.0, DONE, 0.0]  # farther on the profile than there is: the path's end
        source.GetMyMutableContextFromRoot(context).SetDiscreteState(at_end)
    command = station.GetOutputPort("follow_the_leader.joint_state").Eval(context)[:18].copy()
    interpolator = station.GetSubsystemByName("setpoint_interpolator")
    interpolator.GetMyMutableContextFromRoot(context).SetDiscreteState(command)
    plant = station.GetSubsystemByName("plant")
    model = plant.GetModelInstanceByName("prototype")
    plant.SetPositions(plant.GetMyMutableContextFromRoot(context), model, command)
    simulator.AdvanceTo(duration)
    state = station.GetOutputPort("plant.state").Eval(context)
    return command, state[:18], state[18:]


@pytest.mark.parametrize("end", [False, True], ids=["home", "end of trajectory 4"])
def test_the_arm_sags_by_what_its_stiffness_says(bodies, end):
    # Damping over stiffness is 5 ms: 5 % of critical at 3 Hz, so 10 s leave e^-9 of the swing.
    command, q, rates = hold_still(end, 10.0)
    assert np.abs(command[5:]).max() > (0.4 if end else 0.0)
    assert np.abs(rates).max() < 1e-5
    compliance = command + bodies.gravity_efforts(command) / STIFFNESS
    start, found = bodies.tip(command), bodies.tip(q) - bodies.tip(command)
    linear, balance = bodies.tip(compliance) - start, bodies.tip(bodies.sagged(command)) - start
    # It is a sag worth the name, and downwards.
    assert -50e-3 < found[2] < -5e-3
    # Compliance times the loads of the unsagged arm: within 2 %, which the changed levers are.
    assert np.linalg.norm(found - linear) < 0.02 * np.linalg.norm(linear)
    # Balance at the sagged posture: no approximation, so only what still swings.
    np.testing.assert_allclose(found, balance, rtol=0, atol=1e-3 * np.linalg.norm(balance))
    heavy = np.abs(q - command) > 1e-5
    assert heavy.sum() >= 12
    expected = bodies.gravity_efforts(q) / STIFFNESS
    np.testing.assert_allclose((q - command)[heavy], expected[heavy], rtol=2e-3)


def test_a_continuous_station_needs_no_hold_and_starts_at_rest():
    scenario = SerpentineScenario(path="trajectory_4_arcs")
    scenario.integration.scheme = "radau3"
    setup = load_setup(scenario)
    station = MakeSerpentineStation(scenario, setup=setup)
    names = {system.get_name() for system in station.GetSystems()}
    discrete = MakeSerpentineStation(SerpentineScenario(path="trajectory_4_arcs"), setup=setup)
    assert names == {system.get_name() for system in discrete.GetSystems()} - {"setpoint_hold"}
    assert station.GetSubsystemByName("plant").time_step() == 0.0
    simulator = MakeSimulator(station, scenario)
    assert simulator.get_integrator().get_target_accuracy() == scenario.integration.accuracy
    assert simulator.get_integrator().get_fixed_step_mode() is False
    context = simulator.get_context()
    station.GetInputPort("tip_path_source.command").FixValue(
        simulator.get_mutable_context(), [HOLD]
    )
    simulator.AdvanceTo(0.25)
    rates = station.GetOutputPort("plant.state").Eval(context)[18:]
    # As the discrete one: a start off its standing posture would swing ten thousand times as fast.
    assert np.abs(rates).max() < 1e-6


def test_a_shipped_scenario_runs_and_is_recorded_under_radau3():
    scenario = load_scenario("trajectory_4").config
    scenario.duration_s = 0.25
    setup, runs = load_setup(scenario), {}
    for scheme in ("discrete", "radau3"):
        scenario.integration.scheme = scheme
        runs[scheme] = run_station(scenario, setup).data
    for data in runs.values():
        assert data.time[-1] == 0.25
        assert np.all(np.isfinite(data.joint_efforts[1:]))
    # Three steps' way at the rate of each joint, of which the camera's turns fastest; the others
    # swing by fractions of a microradian.
    change = np.abs(runs["radau3"].joints - runs["discrete"].joints).max(axis=0)
    way = 3.0 / 512.0 * np.abs(runs["radau3"].joint_rates).max(axis=0)
    assert np.all(change < 1.1 * way + 1e-6)
    assert way[-1] > 1e-4
    clearances = [run.clearance for run in runs.values()]
    np.testing.assert_allclose(*clearances, rtol=0, atol=1e-4)


@pytest.fixture(scope="module")
def reference(physics):
    """States (N, 36) and tips (N, 3) m of the continuous twin on the way out."""
    return physics.way_out("radau3")


@pytest.fixture(scope="module")
def discrete_tips(physics):
    """Tips (N, 3) m of the discrete twin on the way out, by steps a second."""
    return {rate: physics.way_out("discrete", rate)[1] for rate in physics.TIP_RATES}


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_steps_of_1_512_s_are_within_a_millimetre_of_radau3_all_over_trajectory_4(
    reference, discrete_tips
):
    _, tips = reference
    # All of the path has been travelled: 2.24 m at 25 mm/s.
    assert len(tips) > 90 * 32
    distance = np.linalg.norm(discrete_tips[512] - tips, axis=1)
    assert distance.max() < 1e-3
    # The integration leaves much less than that: see below.
    assert distance.max() < 0.16e-3


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_difference_is_the_documented_delay_and_shrinks_with_the_step(
    physics, reference, discrete_tips
):
    _, tips = reference
    rates = physics.TIP_RATES
    largest = np.array([np.linalg.norm(discrete_tips[rate] - tips, axis=1).max() for rate in rates])
    # First order, and known before: set-points are two steps late, and the plant's state another.
    np.testing.assert_allclose(np.log2(largest[:-1] / largest[1:]), 1.0, rtol=0, atol=0.1)
    delay = 3.0 / np.array(rates)
    # 4 micrometres are the reference's own error (accuracy 1e-4 against 1e-5).
    np.testing.assert_allclose(largest, 0.025 * delay, rtol=0, atol=4e-6)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_but_for_the_delay_steps_of_1_512_s_are_within_10_micrometres(
    bodies, reference, discrete_tips
):
    states, _ = reference
    # The tip where it was three steps before; its acceleration adds a micrometre.
    q = states[:, :18] - 3.0 / 512.0 * states[:, 18:]
    earlier = np.array([bodies.tip(posture) for posture in q]) @ PAD
    assert np.linalg.norm(discrete_tips[512] - earlier, axis=1).max() < 10e-6
