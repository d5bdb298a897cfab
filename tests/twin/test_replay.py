"""A replay holds the run's poses, asks nothing of a server, and its page's script runs."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pydrake.geometry
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.geometry import Box, Meshcat, MeshcatAnimation
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, PrismaticJoint, SpatialInertia
from pydrake.systems.framework import Diagram, DiagramBuilder

from pips_drake.errors import InputError
from pips_drake.twin.replay import (
    Bookmark,
    LineInSpace,
    make_meshcat,
    needed_keys,
    write_replay,
)

TIME = np.arange(129) / 64
#: Still for a second, then a metre in a second.
POSITIONS = np.maximum(0.0, TIME - 1.0)[:, None]


def make_slider() -> tuple[Diagram, MultibodyPlant, ModelInstanceIndex]:
    """A box that slides along x, beside one that stands still."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    model = plant.AddModelInstance("slider")
    inertia = SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1)
    color = np.array([0.2, 0.4, 0.8, 1.0])
    for name in ("moving", "standing"):
        body = plant.AddRigidBody(name, model, inertia)
        plant.RegisterVisualGeometry(body, RigidTransform(), Box(0.1, 0.1, 0.1), name, color)
    frame = plant.GetFrameByName("moving")
    plant.AddJoint(PrismaticJoint("x", plant.world_frame(), frame, [1.0, 0.0, 0.0]))
    X_WS = RigidTransform([0.0, 1.0, 0.0])
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("standing"), X_WS)
    plant.Finalize()
    return builder.Build(), plant, model


def write(file: Path, **changed: object) -> None:
    diagram, plant, model = make_slider()
    arguments: dict[str, object] = {
        "time": TIME,
        "positions": POSITIONS,
        "eye": [0.0, -3.0, 1.0],
        "target": [0.0, 0.0, 0.0],
        "title": "Out & back",
        "lines": [LineInSpace(name="path", points=[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])],
    }
    arguments.update(changed)
    write_replay(file, diagram=diagram, plant=plant, model=model, **arguments)  # type: ignore


def page_data(file: Path) -> dict[str, Any]:
    """What the page's controls are told."""
    found = re.search(r'<script type="application/json"[^>]*>([^<]*)</script>', file.read_text())
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def test_meshcat_listens_on_localhost_alone() -> None:
    meshcat = make_meshcat()
    assert meshcat.web_url().startswith("http://localhost:")
    with pytest.raises(InputError, match=f"no Meshcat on port {meshcat.port()}"):
        make_meshcat(meshcat.port())


def test_what_moves_has_a_key_a_sample_and_what_stands_has_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys: list[tuple[int, str, float]] = []

    class Noting(MeshcatAnimation):
        def SetTransform(  # noqa: N802
            self, frame: int, path: str, X_ParentPath: RigidTransform
        ) -> None:
            keys.append((frame, path, float(X_ParentPath.translation()[0])))
            super().SetTransform(frame, path, X_ParentPath)

    monkeypatch.setattr(pydrake.geometry, "MeshcatAnimation", Noting)
    write(tmp_path / "a.html", sample_rate=4.0)
    assert {path for _, path, _ in keys} == {"/replay/slider/moving"}
    # Still for a second, then even: three keys say it all. x = t - 1 at t = frame / 4.
    assert [frame for frame, _, _ in keys] == [0, 4, 8]
    for frame, _, x in keys:
        assert x == pytest.approx(max(0.0, frame / 4.0 - 1.0), abs=1e-12)


def test_the_page_stands_alone_and_is_the_same_each_time(tmp_path: Path) -> None:
    write(tmp_path / "a.html")
    write(tmp_path / "b.html")
    page = (tmp_path / "a.html").read_text()
    assert page == (tmp_path / "b.html").read_text()
    assert "<title>Out &amp; back</title>" in page
    assert "<b>Out &amp; back</b>" in page
    assert not re.search(r"<(script|link)[^>]*(src|href)=", page), "it loads another file"
    assert len(page) < 3e6


def test_the_given_camera_is_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    poses: list[tuple[list[float], list[float]]] = []

    class Noting(Meshcat):
        def SetCameraPose(  # noqa: N802
            self, camera: np.ndarray, target: np.ndarray
        ) -> None:
            poses.append((list(camera), list(target)))

    monkeypatch.setattr(pydrake.geometry, "Meshcat", Noting)
    write(tmp_path / "a.html", eye=[1.0, 2.0, 3.0], target=[4.0, 5.0, 6.0])
    assert poses == [([1.0, 2.0, 3.0], [4.0, 5.0, 6.0])]


@pytest.mark.parametrize(
    ("time", "positions"), [([], np.empty((0, 1))), ([0.0, 1.0], [[0.0]]), ([0.0], [[0.0, 0.0]])]
)
def test_shapes_that_disagree_are_refused(
    tmp_path: Path, time: list[float], positions: list[list[float]]
) -> None:
    with pytest.raises(InputError, match=r"a\.html: time of shape .* must be"):
        write(tmp_path / "a.html", time=time, positions=positions)


def test_one_sample_is_a_still(tmp_path: Path) -> None:
    write(tmp_path / "a.html", time=[0.0], positions=[[0.5]])
    assert page_data(tmp_path / "a.html")["duration"] == 0.0


BOOKMARK = Bookmark(
    label="</script><b>&least",
    time=11.5,
    line=LineInSpace(
        name="nearest", points=np.outer([0.0, 0.5, 1.0], [0.0, 0.0, 1.0]), color=(1.0, 0.5, 0.0)
    ),
)


def test_the_controls_know_bookmarks_and_phases(tmp_path: Path) -> None:
    for name in ("a.html", "b.html"):
        write(
            tmp_path / name,
            time=TIME + 10.0,
            bookmarks=[BOOKMARK, Bookmark(label="end", time=12.0)],
            phases={"out": 10.0, "back": 11.0},
            speed=2.0,
            note="1 < 2",
        )
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    assert "1 &lt; 2" in (tmp_path / "a.html").read_text()
    data = page_data(tmp_path / "a.html")
    assert (data["start"], data["duration"], data["speed"]) == (10.0, 2.0, 2.0)
    assert data["speeds"] == [1.0, 2.0, 4.0, 8.0, 16.0]
    assert data["bookmarks"] == [
        {
            "label": BOOKMARK.label,
            "time": 1.5,
            "line": [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            "color": "#ff8000",
        },
        {"label": "end", "time": 2.0, "color": "#222"},
    ]
    assert data["phases"] == [{"label": "out", "time": 0.0}, {"label": "back", "time": 1.0}]


@given(
    st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 2), min_size=1, max_size=30),
    st.sampled_from([1e-6, 0.1, 3.0]),
)
def test_left_out_rows_lie_on_the_lines_between_the_others(
    rows: list[tuple[float, float]], tolerance: float
) -> None:
    track = np.array(rows)
    keys = needed_keys(track, tolerance)
    assert list(keys) == sorted(set(keys))
    at = np.arange(len(track))
    lines = np.column_stack([np.interp(at, keys, column) for column in track[keys].T])
    assert np.abs(lines - track).max() <= tolerance + 1e-12
    if tolerance == 3.0:
        assert list(keys) == [0], "nothing changes"


# Without a window no frame is drawn, so a timer stands in for them. It notes the page's clock since
# play began, and the time that is shown, s.
FRAMES = """
<pre id="said"></pre>
<script>
  const frames = [];
  setInterval(() => {
    const animator = viewer.animator;
    animator.update();
    if (!animator.playing) return;
    frames.push([(performance.now() - animator.clock.startTime) * 1e-3, animator.time]);
    document.getElementById("said").textContent = JSON.stringify(frames);
  }, 100);
</script>
"""

# What the controls say after each of some keys and clicks, once the page has loaded.
KEYS = """
<script>
  const noted = [];
  function say() {
    viewer.animator.update();
    const name = (css) => (document.querySelector(css) || {}).textContent;
    noted.push([
      name("#replay-time"), name("#replay-bookmarks .replay-on"), name("#replay-lines text"),
      viewer.animator.playing, viewer.animator.time,
    ]);
  }
  function press(key) {
    document.body.dispatchEvent(new KeyboardEvent("keydown", { key: key, bubbles: true }));
    say();
  }
  setTimeout(() => {
    say();
    press("ArrowRight");
    press(" ");
    document.querySelector("#replay-bookmarks a").click();
    say();
    document.querySelector("#replay-speeds button").click();
    say();
    const result = document.createElement("pre");
    result.id = "said";
    result.textContent = JSON.stringify(noted);
    document.body.appendChild(result);
  }, 3000);
</script>
"""


def open_page(browser: Any, file: Path, script: str, *, fragment: str = "") -> str:
    """The page's document after ten seconds in a browser, with a script added."""
    file.write_text(file.read_text().replace("</body>", script + "</body>"))
    page, console = browser.open(file.as_uri() + fragment, "--dump-dom")
    assert console == []
    return page


def said(page: str) -> Any:
    """What a script above left in the document."""
    found = re.search(r'<pre id="said">(.*)</pre>', page)
    assert found is not None
    return json.loads(html.unescape(found[1]))


@pytest.mark.slow
def test_a_browser_plays_it_at_the_given_speed(tmp_path: Path, browser: Any) -> None:
    time = np.arange(0.0, 1000.25, 0.25)
    file = tmp_path / "a.html"
    write(file, time=time, positions=0.001 * time[:, None], speed=8.0)
    page = open_page(browser, file, FRAMES)
    frames = np.array(said(page))
    assert np.ptp(frames[:, 0]) > 5.0
    # From the first frame on: what went by while the page loaded is not played.
    assert frames[:, 1] == pytest.approx(8.0 * frames[:, 0], abs=0.02)
    assert "of 1000.0 s, at 8 x" in page


@pytest.mark.slow
def test_a_browser_opens_it_at_a_time_and_obeys_keys_and_bookmarks(
    tmp_path: Path, browser: Any
) -> None:
    time = np.arange(10.0, 1010.25, 0.25)
    file = tmp_path / "a.html"
    write(file, time=time, positions=0.001 * time[:, None], bookmarks=[BOOKMARK])
    page = open_page(browser, file, KEYS, fragment="#t=93.1&pause")
    opened, stepped, played, jumped, slower = said(page)
    # The page counts from 0, its label from the start of the recording.
    assert opened[:3] == ["t = 93.1 s of 1010.0 s, at 8 x", None, None]
    assert opened[3:] == [False, pytest.approx(83.1)]
    assert stepped[3:] == [False, pytest.approx(84.1)]
    assert played[3] is True
    assert jumped[1:3] == ["</script><b>&least at 11.5 s", "</script><b>&least"]
    assert jumped[3:] == [False, pytest.approx(1.5)]
    assert slower[0] == "t = 11.5 s of 1010.0 s, at 1 x"
