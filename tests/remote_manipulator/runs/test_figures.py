"""Figures of a run: what they say, that all of it can be read, and that any run can be drawn."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import matplotlib.figure
import numpy as np
import pytest

from pips_drake.remote_manipulator.runs import figures
from pips_drake.units import FOOT

from ...figure_layout import check_layout
from .made_run import CONFIG, flags, made_data, phases

NOWHERE = Path("a.png")


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[mpl.figure.Figure]:
    """The figures instead of files."""
    found: list[mpl.figure.Figure] = []
    monkeypatch.setattr(figures, "save_figure", lambda figure, file: found.append(figure))
    return found


def docking_run(count=200):
    """Carried to the port, 30 s; what is held there; and let go."""
    third = count // 4
    way = phases(
        *["extraction"] * third,
        *["manoeuvring"] * (count - 2 * third),
        *["docked_held"] * (third - 10),
        *["docked"] * 10,
    )
    distance = np.maximum(np.linspace(5.0, -1.5, count), 0.07)
    display = made_data(count).display | {
        "docking_distance_m": distance,
        "docking_angle_rad": np.full(count, 0.01),
    }
    rows = [""] * count
    rows[10:14], rows[60:62] = ["a", "aA", "aA", "aA"], ["afAF"] * 2
    return made_data(
        count,
        time=np.linspace(0.0, 30.0, count),
        phase=way,
        display=display,
        flags=flags(*rows),
        clearance=np.linspace(0.9, 0.0, count),
    )


def test_the_timeline_names_phases_flags_and_the_nearest_pair(drawn):
    data = docking_run()
    judged = data.clearance > 0.4
    figures.timeline_figure(NOWHERE, data, judged)
    said = check_layout(drawn[0])
    for words in ("extraction (mode 2)", "manoeuvring (mode 3)", "docked held (mode 4)"):
        assert words in said
    assert "stowed" not in said, "a phase that never was"
    for words in ("arm collision", "finger inhibit", "clearance (m)", "time (s)"):
        assert words in said
    least = data.clearance[judged].min()
    assert f"{1e3 * least:.0f} mm, payload to cargo bay" in said
    assert "none" not in said
    # The bars of the flags are where the flags are.
    top, middle, _ = drawn[0].axes
    bars = [
        (path.vertices[:, 0].min(), path.vertices[:, 0].max())
        for collection in middle.collections
        for path in collection.get_paths()
    ]
    begin, end = data.time[11], data.time[14]  # the arm's inhibit
    assert any(np.allclose(bar, (begin, end), atol=1e-9) for bar in bars)
    line = top.get_lines()[0]
    np.testing.assert_array_equal(np.unique(line.get_ydata()), [0.0, 1.0, 2.0, 3.0])


def test_the_timeline_of_a_run_without_flags_says_so(drawn):
    data = made_data()
    figures.timeline_figure(NOWHERE, data, np.ones(6, dtype=bool))
    assert "none" in check_layout(drawn[0])


def test_joints_stand_with_their_limits_and_what_was_sent(drawn):
    data = docking_run()
    data.arm[:, 5] = np.radians(np.linspace(-20.0, 20.0, len(data.time)))
    data.arm[:, 4] += 1e-5 * np.linspace(0.0, 1.0, len(data.time))
    data.arm_efforts[0] = np.nan
    data.arm_efforts[77, 2] = 0.6 * 1570.0
    figures.joints_figure(NOWHERE, data, CONFIG)
    said = check_layout(drawn[0])
    for words in (
        "H0, deg: -180 .. 180",
        "P1, deg: -161 .. 2.4",
        "stand, m: 2 .. 4",
        "gap, m: 0.24 ..",
    ):
        assert words in said
    axes = drawn[0].axes
    sent, found = axes[4].get_lines()
    np.testing.assert_allclose(found.get_ydata(), np.degrees(data.arm[:, 5]))
    np.testing.assert_allclose(sent.get_ydata(), np.degrees(data.setpoint[:, 5]))
    low, high = axes[3].get_ylim()
    assert high - low >= 4.999, "deg: a joint that rests is drawn even"
    # Of the shares of torque the largest of every second stays, also of one that is a frame long.
    (line, _) = axes[8].get_lines()
    assert line.get_ydata().max() == pytest.approx(60.0)
    assert len(line.get_ydata()) == 31  # 30 s, and the frame at the end of them
    assert np.all(np.isfinite(line.get_ydata()))


def test_the_way_into_the_port_ends_where_it_is_let_go(drawn):
    data = docking_run()
    assert figures.docking_figure(NOWHERE, data, CONFIG)
    said = check_layout(drawn[0])
    for words in ("docked", "docks below", "distance (m)", "angle (deg)"):
        assert words in said
    above, below = drawn[0].axes
    line, limit = above.get_lines()[:2]
    assert limit.get_ydata()[0] == pytest.approx(0.25 * FOOT)
    assert below.get_lines()[1].get_ydata()[0] == pytest.approx(2.53, abs=0.01)  # 2 deg 32 min
    near = (data.display["docking_distance_m"] < 2.0) & (data.phase != 1)
    np.testing.assert_array_equal(line.get_xdata(), data.time[near])


def test_there_is_no_docking_figure_of_a_run_far_from_the_port(drawn):
    data = made_data(display=made_data().display | {"docking_distance_m": np.full(6, 9.0)})
    assert not figures.docking_figure(NOWHERE, data, CONFIG)
    # Nor of a payload that is docked, and nobody holds.
    docked = made_data(phase=phases(*["docked"] * 6))
    assert not figures.docking_figure(NOWHERE, docked, CONFIG)
    assert drawn == []


def test_a_run_that_ends_with_its_first_frame_can_be_drawn(drawn):
    data = made_data(1, arm_efforts=np.full((1, 8), np.nan))
    figures.timeline_figure(NOWHERE, data, np.ones(1, dtype=bool))
    figures.joints_figure(NOWHERE, data, CONFIG)
    assert not figures.docking_figure(NOWHERE, data, CONFIG)
    for figure in drawn:
        check_layout(figure)
