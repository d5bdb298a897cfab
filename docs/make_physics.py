"""Measures what docs/physics.md says of energy and step size, and draws docs/images/physics.png.

    python docs/make_physics.py

Takes some minutes. tests/serpentine/test_physics.py asserts the orders of the same measurements.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig

from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.mounting import mounting_rotation
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.sdf import make_sdf
from pips_drake.serpentine.station import MakeSerpentineStation, MakeSimulator, load_setup

Array = NDArray[np.float64]

IMAGE = Path(__file__).resolve().parent / "images" / "physics.png"
#: Steps a second that are compared.
ENERGY_RATES = {
    "discrete": (128, 256, 512, 1024, 2048),
    "runge_kutta2": (256, 512, 1024, 2048),
    "runge_kutta3": (128, 256, 512, 1024),
    "radau3": (128, 256, 512, 1024),
}
TIP_RATES = (128, 256, 512, 1024)
#: Time that the arm falls for, s; its kinetic energy is then 1.1 kJ.
FALL = 0.5
#: Between two looks at a run, s.
PERIOD = 1.0 / 32.0


def free_plant(time_step: float) -> MultibodyPlant:
    """The prototype on the pad without gains, damping, actuators, stops and contact."""
    root = ET.fromstring(make_sdf(load_arm("prototype")))
    for joint in root.iter("joint"):
        for gains in joint.findall("{http://drake.mit.edu}controller_gains"):
            joint.remove(gains)
        axis = joint.find("axis")
        axis.remove(axis.find("limit"))
    plant = MultibodyPlant(time_step)
    if time_step > 0.0:
        plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)
    (model,) = Parser(plant).AddModelsFromString(ET.tostring(root, encoding="unicode"), "sdf")
    pad = RigidTransform(RotationMatrix(mounting_rotation("pad")), np.zeros(3))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("rail", model), pad)
    plant.Finalize()
    return plant


def release_posture() -> Array:
    """A posture (18,) to fall from, bent in every joint: the same in every run."""
    posture = np.random.default_rng(4).uniform(-0.3, 0.3, 18)
    posture[0] = 1.5
    posture[1] -= 0.5 * np.pi
    return posture


def energy_drift(scheme: str, rate: int) -> float:
    """Largest change of the falling arm's energy, J, at `rate` steps a second."""
    plant = free_plant(1.0 / rate if scheme == "discrete" else 0.0)
    simulator = Simulator(plant)
    if scheme != "discrete":
        config = SimulatorConfig(
            integration_scheme=scheme,
            max_step_size=1.0 / rate,
            use_error_control=False,
            accuracy=1e-9,  # implicit schemes iterate until that
        )
        ApplySimulatorConfig(config, simulator)
    context = simulator.get_mutable_context()
    plant.SetPositions(context, release_posture())
    energies = []
    for k in range(round(FALL * 64) + 1):
        simulator.AdvanceTo(k / 64)
        energies.append(plant.CalcPotentialEnergy(context) + plant.CalcKineticEnergy(context))
    return float(np.ptp(energies))


def way_out(scheme: str, rate: int = 512) -> tuple[Array, Array]:
    """Joint states (N, 36) and tips (N, 3) m of the twin on trajectory 4's way out, 32 a second."""
    scenario = SerpentineScenario(path="trajectory_4_arcs")
    scenario.motion.retract = False
    scenario.integration.scheme = scheme
    scenario.clocks.plant_hz = rate
    scenario.clocks.clearance_hz = 1  # nobody looks
    setup = load_setup(scenario)
    station = MakeSerpentineStation(scenario, setup=setup)
    simulator = MakeSimulator(station, scenario)
    simulator.Initialize()
    port, context = station.GetOutputPort("plant.state"), simulator.get_context()
    duration = station.GetSubsystemByName("tip_path_source").duration + 2.0
    states = []
    for k in range(round(duration / PERIOD) + 1):
        simulator.AdvanceTo(k * PERIOD)
        states.append(port.Eval(context).copy())
    rows = np.array(states)
    return rows, kinematics.spine_points(setup.arm, rows[:, :18])[:, -1]


def main() -> None:
    """Measures, prints and draws."""
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for scheme, rates in ENERGY_RATES.items():
        drifts = [energy_drift(scheme, rate) for rate in rates]
        print(scheme, ", ".join(f"1/{r} s: {d:.3g} J" for r, d in zip(rates, drifts, strict=True)))
        left.loglog(1.0 / np.array(rates), drifts, "o-", label=scheme)
    left.set(xlabel="step, s", ylabel="largest change of energy, J")
    left.set_title(f"Arm falling freely for {FALL:g} s")
    states, reference = way_out("radau3")
    arm = load_arm("prototype")
    largest, left_over = [], []
    for rate in TIP_RATES:
        tips = way_out("discrete", rate)[1]
        earlier = states[:, :18] - 3.0 / rate * states[:, 18:]
        late = kinematics.spine_points(arm, earlier)[:, -1]
        largest.append(1e3 * np.linalg.norm(tips - reference, axis=1).max())
        left_over.append(1e3 * np.linalg.norm(tips - late, axis=1).max())
        print(f"1/{rate} s: {largest[-1]:.5f} mm, but for three steps {left_over[-1]:.5f} mm")
    steps = 1.0 / np.array(TIP_RATES)
    right.loglog(steps, largest, "o-", label="as it is")
    right.loglog(steps, left_over, "s-", label="but for three steps of delay")
    right.loglog(steps, 25.0 * 3.0 * steps, "k:", label="3 steps at 25 mm/s")
    right.set(xlabel="step, s", ylabel="largest distance of the tips, mm")
    right.set_title("Twin on trajectory 4, discrete against radau3")
    for axes in (left, right):
        axes.set_xticks(
            1.0 / np.array(ENERGY_RATES["discrete"]),
            [f"1/{rate}" for rate in ENERGY_RATES["discrete"]],
        )
        axes.minorticks_off()
        axes.grid(True, alpha=0.3)
        axes.legend()
    figure.savefig(IMAGE, dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
