"""Draws docs/images/fastest_*.png: trajectory 4 with the prototype's rail, and with a quick one.

python docs/make_fastest.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pips_drake.serpentine.runs.motion_report import fastest_motion_figure
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import load_setup, make_constant_profile, make_fastest_motion

IMAGES = Path(__file__).resolve().parent / "images"
#: How much faster the quick rail is.
FACTOR = 8.0


def main() -> None:
    """Draws both."""
    scenario = SerpentineScenario(path="trajectory_4_arcs")
    setup = load_setup(scenario)
    quick = replace(setup.arm, base_speed_limit=setup.arm.base_speed_limit * [FACTOR, 1.0])
    for name, arm in (("motion", setup.arm), ("motion_quick_rail", quick)):
        this = replace(setup, arm=arm)
        fastest_motion_figure(
            IMAGES / f"fastest_{name}.png",
            make_fastest_motion(scenario, this),
            make_constant_profile(scenario, this),
            home=setup.path.home_arc_length,
        )


if __name__ == "__main__":
    main()
