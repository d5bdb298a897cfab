"""Figures are reproducible, show nothing cut off or on top of another, and leave no trace."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import matplotlib.figure
import matplotlib.image
import numpy as np
import pytest

from pips_drake.twin import run_figures
from pips_drake.twin.figures import (
    Limit,
    Line,
    Mark,
    Panel,
    save_figure,
    time_series_figure,
    where_least,
)

from ..figure_layout import check_layout

TIME = np.linspace(0.0, 185.0, 400)


def border_is_white(file: Path) -> bool:
    """Whether nothing touches the picture's edge."""
    pixels = mpl.image.imread(file)
    edge = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
    return bool((edge == 1.0).all())


def make_panels(count: int) -> list[Panel]:
    wave = np.sin(TIME / 20.0)
    return [
        Panel(
            title=f"panel {k + 1}",
            y_label="angle (deg)",
            lines=[Line(x=TIME, y=wave, label="first"), Line(x=TIME, y=-wave, label="second")],
            limits=[Limit(value=1.5)],
            marks=[Mark(x=TIME[100], y=wave[100], text="a point\nof note")],
        )
        for k in range(count)
    ]


@pytest.mark.parametrize(("count", "columns"), [(1, 1), (2, 1), (7, 3), (9, 3)])
def test_texts_stand_apart_and_inside(tmp_path: Path, count: int, columns: int) -> None:
    figure = time_series_figure(
        make_panels(count),
        "tip travel (in)",
        title="A title",
        columns=columns,
        second_x=("tip travel (m)", 0.0254),
    )
    save_figure(figure, tmp_path / "a.png")
    check_layout(figure)
    assert border_is_white(tmp_path / "a.png")
    assert mpl.image.imread(tmp_path / "a.png").shape[1] == 1500


def test_every_column_has_an_x_label_where_its_last_panel_is() -> None:
    figure = time_series_figure(make_panels(7), "time (s)", columns=3)
    assert len(figure.axes) == 7
    assert [axes.get_xlabel() for axes in figure.axes] == [""] * 4 + ["time (s)"] * 3


def test_a_figure_has_the_same_bytes_each_time_whatever_the_users_settings(
    tmp_path: Path,
) -> None:
    save_figure(time_series_figure(make_panels(2), "time (s)"), tmp_path / "a.png")
    with mpl.rc_context({"font.size": 20.0, "savefig.bbox": "tight", "lines.linewidth": 9.0}):
        save_figure(time_series_figure(make_panels(2), "time (s)"), tmp_path / "b.png")
        assert mpl.rcParams["font.size"] == 20.0
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert b"Software" not in (tmp_path / "a.png").read_bytes()


def test_a_mark_covers_no_line_where_there_is_room() -> None:
    panel = Panel(
        title="",
        y_label="",
        lines=[Line(x=TIME, y=np.abs(TIME - 90.0))],
        marks=[Mark(x=90.0, y=0.0, text="the least of all these distances")],
        y_range=(-20.0, 100.0),
    )
    figure = time_series_figure([panel], "time (s)")
    figure.canvas.draw()
    axes = figure.axes[0]
    box = mpl.text.Text.get_window_extent(axes.texts[0])
    line = axes.transData.transform(np.column_stack([TIME, np.abs(TIME - 90.0)]))
    assert not np.any(np.all((line >= box.min) & (line <= box.max), axis=1))
    assert axes.bbox.contains(*box.min)
    assert axes.bbox.contains(*box.max)


def test_where_least_looks_at_numbers_alone() -> None:
    assert where_least(np.array([[np.nan, 3.0], [2.0, np.nan]])) == (1, 0)
    assert where_least(np.full((2, 1), np.nan)) is None
    assert where_least(np.empty((0, 2))) is None


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[mpl.figure.Figure]:
    """Figures of `run_figures` instead of files."""
    figures: list[mpl.figure.Figure] = []
    monkeypatch.setattr(run_figures, "save_figure", lambda figure, file: figures.append(figure))
    return figures


def test_clearance_says_least_distance_pair_and_time(drawn: list[mpl.figure.Figure]) -> None:
    distance = np.minimum(0.031 + 0.01 * np.abs(TIME - TIME[250]), 0.25)
    run_figures.clearance_figure(
        Path("a.png"),
        TIME,
        distance,
        pair=("prototype::camera_head", "payload::payload"),
        threshold=0.02,
        max_distance=0.25,
        own_distance=distance + 0.05,
    )
    said = check_layout(drawn[0])
    assert "31.0 mm at 115.91 s\nprototype::camera_head to\npayload::payload" in said
    assert "must stay above 20 mm" in said
    line = drawn[0].axes[0].get_lines()[0].get_ydata()
    assert np.nanmax(line) < 250.0, "where the monitor sees nothing the line has a gap"


def test_clearance_without_anything_near_says_so(drawn: list[mpl.figure.Figure]) -> None:
    far = np.full(TIME.shape, 0.25)
    run_figures.clearance_figure(Path("a.png"), TIME, far, max_distance=0.25, own_distance=far)
    assert "nothing within the monitor's reach" in check_layout(drawn[0])


def test_penetration_is_drawn_below_zero(drawn: list[mpl.figure.Figure]) -> None:
    run_figures.clearance_figure(Path("a.png"), TIME, 0.1 - 0.001 * TIME, threshold=0.02)
    assert "least -85.0 mm" in check_layout(drawn[0])
    assert drawn[0].axes[0].get_ylim()[0] < -85.0


def test_tracking_shows_both_runs(drawn: list[mpl.figure.Figure]) -> None:
    error = 0.002 + 0.001 * np.sin(TIME / 20.0)
    run_figures.tracking_figure(
        Path("a.png"), TIME, error, 0.5 * error, uncompensated=(TIME, 9 * error, error), limit=0.01
    )
    said = check_layout(drawn[0])
    assert "3.00 mm at" in said
    assert "27.00 mm at" in said
    assert "limit 10 mm" in said
