"""Renews the pictures of docs/cable_robot.md from the folders of runs.

    python docs/make_cable_robot.py RUNS

RUNS holds the folders that `pips simulate NAME --out RUNS/NAME` wrote.
"""

import shutil
import sys
from pathlib import Path

IMAGES = Path(__file__).resolve().parent / "images"
#: Pictures of runs, and what they are called here.
PICTURES = {
    "planar_example/figures/pose_1.png": "cable_robot_planar.png",
    "cable_workspace/figures/cablings.png": "cable_robot_cablings.png",
    "cable_workspace/figures/volume.png": "cable_robot_volume.png",
    "cable_workspace/figures/accuracy.png": "cable_robot_accuracy.png",
    "cable_break/figures/swing.png": "cable_robot_break.png",
    "radiator_survey/figures/map_after.png": "cable_robot_map.png",
}


def main() -> None:
    runs = Path(sys.argv[1])
    for name, copy in PICTURES.items():
        shutil.copyfile(runs / name, IMAGES / copy)


if __name__ == "__main__":
    main()
