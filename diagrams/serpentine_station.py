"""The full station: path source, follow-the-leader, linkage, servo, plant, clearance monitor.

    python diagrams/serpentine_station.py [--seconds 10]

Builds the scenario's station, runs it, and reads its exported ports.
"""

import argparse

import numpy as np
from pydrake.systems.analysis import Simulator

from pips_drake.scenarios import load_scenario
from pips_drake.serpentine.station import MakeSerpentineStation


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated time")
    seconds = parser.parse_args().seconds

    scenario = load_scenario("trajectory_4").config
    station = MakeSerpentineStation(scenario)
    monitor = station.GetSubsystemByName("clearance_monitor")

    simulator = Simulator(station)
    simulator.Initialize()
    for time in np.linspace(0.0, seconds, 6):
        simulator.AdvanceTo(time)
        context = simulator.get_context()
        arc_length, speed = station.GetOutputPort("tip_path_source.tip").Eval(context)
        distance, rate, _ = station.GetOutputPort("clearance_monitor.clearance").Eval(context)
        witness = station.GetOutputPort("clearance_monitor.witness").Eval(context)
        efforts = station.GetOutputPort("actuator_force_map.drive_effort").Eval(context)
        pair = monitor.pair_name(witness[0]) or ("nothing near", "")
        print(
            f"{time:5.1f} s: tip at {arc_length:.3f} m, {1e3 * speed:4.1f} mm/s; "
            f"clearance {1e3 * distance:5.1f} mm ({1e3 * rate:+.2f} mm/s), {' to '.join(pair)}; "
            f"largest actuator force {1e-3 * np.abs(efforts[2:]).max():.1f} kN"
        )


if __name__ == "__main__":
    main()
