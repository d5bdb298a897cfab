"""A run's replay in a browser: its script has nothing to complain of, and the arm is seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from pips_drake.scenarios import load_scenario
from pips_drake.serpentine.runs.pictures import write_run_replay
from pips_drake.serpentine.station import load_setup

SIZE = (1600, 1000)
#: Of the screenshot; the page's controls, which are blue too, are below.
ROWS = 850
HIDE_ARM = "<script>viewer.set_property(['replay', 'prototype'], 'visible', false)</script>"
#: What a console says of a page in which something is wrong.
WRONG = (
    "<script>console.error('said'); setTimeout(() => { throw new Error('thrown'); }, 10)</script>"
)


def arm_pixels(picture: Path) -> dict[str, int]:
    """How many pixels have colours that only the arm has: yellow, brown and grey is the scene."""
    red, green, blue = matplotlib.image.imread(picture)[:ROWS, :, :3].reshape(-1, 3).T
    brightest = np.maximum(np.maximum(red, green), blue)
    found = {
        "camera head": (blue > 2.0 * red) & (blue > 1.4 * green) & (blue > 0.3),
        # The path's line is redder, the payload yellower.
        "crane": (red > 1.42 * green) & (red < 1.8 * green) & (blue < 0.4 * green) & (red > 0.7),
        "rail and crossheads": (brightest < 0.32) & (blue > red),
    }
    return {name: int(np.count_nonzero(pixels)) for name, pixels in found.items()}


@pytest.mark.slow
def test_a_browser_shows_the_arm_and_has_nothing_to_complain_of(
    tmp_path: Path, browser: Any
) -> None:
    loaded = load_scenario("trajectory_4")
    setup = load_setup(loaded.config, folder=loaded.folder)
    arc_lengths = setup.path.samples(0.25)
    joints = setup.solver.solve(setup.path, arc_lengths).joints
    time = np.arange(float(arc_lengths.size))
    file = tmp_path / "replay.html"
    write_run_replay(file, loaded.config, setup, title="Replay", time=time, joints=joints)
    page = file.read_text()

    def screenshot(name: str) -> dict[str, int]:
        picture = tmp_path / f"{name}.png"
        size = f"--window-size={SIZE[0]},{SIZE[1]}"
        # At 8 of 10 s, between the walls, with the head before the farther one.
        address = file.as_uri() + "#t=8&pause"
        _, console = browser.open(address, size, f"--screenshot={picture}")
        assert console == []
        return arm_pixels(picture)

    seen = screenshot("with_arm")
    file.write_text(page.replace("</body>", HIDE_ARM + "</body>"))
    unseen = screenshot("without_arm")
    for part, least in {"camera head": 150, "crane": 500, "rail and crossheads": 10_000}.items():
        assert seen[part] > least, part
        assert unseen[part] < 0.2 * least, part


@pytest.mark.slow
def test_what_a_page_complains_of_is_heard(tmp_path: Path, browser: Any) -> None:
    file = tmp_path / "wrong.html"
    file.write_text(f"<html><body>{WRONG}</body></html>")
    _, console = browser.open(file.as_uri(), "--dump-dom")
    assert [line.split('"')[1] for line in console] == ["said", "Uncaught Error: thrown"]
