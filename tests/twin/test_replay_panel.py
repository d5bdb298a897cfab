"""A flat view in a replay's page: it holds what it was given, and moves with the page's time."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.twin.replay_panel import CameraView, PanelLine, ReplayPanel, panel_html

from .test_replay import write

#: Three lines, one a second from 0.5 s on.
MOVING = [np.array([[0.0, 0.0], [1.0 + k, 0.5 * k]]) for k in range(3)]


def make_panel(**changed: Any) -> ReplayPanel:
    arguments: dict[str, Any] = {
        "title": "Flat <view>",
        "x_label": "along, m",
        "y_label": "around, deg",
        "x_range": (0.0, 4.0),
        "y_range": (-90.0, 90.0),
        "picture": np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]),
        "lines": [
            PanelLine(points=[[0, 0], [np.nan, 0], [1, 2.0004]], color="#d55e00", label="path"),
            PanelLine(points=[[3.0, 45.0]], color="#e69f00", label="goal", marker=True),
        ],
        "times": [0.5, 1.0, 1.5],
        "moving": MOVING,
        "moving_label": "arm",
        "views": [CameraView(label="above", eye=[0.0, 0.1, 5.0], target=[0.0, 0.0, 0.0])],
        "see_through": ["slider::standing"],
    }
    return ReplayPanel(**(arguments | changed))


def panel_data(text: str) -> dict[str, Any]:
    found = re.search(r'id="replay-panel-data">([^<]*)</script>', text)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def test_the_page_holds_what_the_panel_was_given() -> None:
    data = panel_data(panel_html(make_panel(), 0.25))
    assert data["title"] == "Flat <view>"  # not as a tag in the page's text
    assert data["times"] == [0.25, 0.75, 1.25]  # from the page's start
    assert data["moving"][2] == [[0.0, 0.0], [3.0, 1.0]]
    assert data["lines"][0]["points"] == [[0.0, 0.0], None, [1.0, 2.0]]
    assert data["picture"].startswith("data:image/png;base64,")
    assert panel_html(make_panel(), 0.25) == panel_html(make_panel(), 0.25)


def test_a_moving_line_needs_a_time_for_each() -> None:
    with pytest.raises(InputError, match=r"times of shape \(2,\) for 3 lines; must be one each"):
        panel_html(make_panel(times=[0.0, 1.0]), 0.0)


def test_a_page_without_a_panel_has_none(tmp_path: Path) -> None:
    write(tmp_path / "plain.html")
    assert "replay-panel" not in (tmp_path / "plain.html").read_text()


@pytest.mark.slow
def test_a_browser_moves_the_line_with_time_and_looks_from_a_view(
    tmp_path: Path, browser: Any
) -> None:
    """Stopped at 1.2 s the second of three lines is shown; the camera went where the view says."""
    write(tmp_path / "replay.html", panel=make_panel())
    probe = """<script>setTimeout(() => {
      const mover = document.getElementById("replay-panel-mover");
      const eye = viewer.camera.getWorldPosition(viewer.camera.position.clone());
      let faint = 0;
      viewer.scene_tree.find(["replay", "slider", "standing"]).object.traverse((one) => {
        if (one.material && one.material.opacity <= 0.2) faint += 1;
      });
      console.log("panel " + JSON.stringify({ sample: mover.dataset.sample, eye: eye.toArray(),
        faint, paths: document.querySelectorAll("#replay-panel path").length }));
    }, 3000);</script>"""
    text = (tmp_path / "replay.html").read_text()
    body, end, rest = text.rpartition("</body>")
    (tmp_path / "replay.html").write_text(body + probe + end + rest)
    _, said = browser.open(f"file://{tmp_path}/replay.html#t=1.2&pause&view=above", "--dump-dom")
    (line,) = [one for one in said if "panel {" in one]
    found = json.loads(line[line.index("{") : line.rindex("}") + 1])
    assert found["sample"] == "1"
    assert found["faint"] >= 1
    assert found["paths"] > 10
    # The page's y is up: (x, z, -y) of the world.
    np.testing.assert_allclose(found["eye"], [0.0, 5.0, -0.1], atol=1e-6)
    assert not [one for one in said if "rror" in one]
