"""A run on one page: verdict, numbers beside what is allowed, pictures. As PNG and as HTML."""

from __future__ import annotations

import base64
import html
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pips_drake.twin.figures import figure_style, new_figure, save_figure
from pips_drake.twin.output_folder import write_whole

_PASS, _FAIL, _PLAIN = "#1B7F4B", "#B22222", "#333333"


@dataclass(frozen=True, kw_only=True)
class SheetRow:
    """A number of the sheet.

    Attributes:
        label, value, allowed: as text, with units; `allowed` may be empty.
        good: whether the value is allowed; None if nothing is asked of it.
    """

    label: str
    value: str
    allowed: str = ""
    good: bool | None = None


@dataclass(frozen=True, kw_only=True)
class SheetPicture:
    """A picture (PNG) with its own title, and what it shows in words, for the page."""

    file: Path
    caption: str


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """What stands on the page. The first picture is the large one; two more fit below the table."""

    title: str
    passed: bool
    lead: str
    failures: Sequence[str]
    rows: Sequence[SheetRow]
    pictures: Sequence[SheetPicture]


def write_sheet(folder: Path, sheet: Sheet) -> None:
    """Writes `summary.png` and `summary.html` (one file, pictures inside)."""
    _write_png(folder / "summary.png", sheet)
    write_whole(folder / "summary.html", _as_html(sheet))


def _write_png(file: Path, sheet: Sheet) -> None:
    from matplotlib.image import imread

    with figure_style():
        figure = new_figure(7.4)
        layout = figure.add_gridspec(
            3, 2, height_ratios=[0.16, 1.0, 0.62], width_ratios=[1.0, 1.25]
        )
        head = figure.add_subplot(layout[0, :])
        head.set_axis_off()
        colour, word = (_PASS, "PASS") if sheet.passed else (_FAIL, "FAIL")
        head.text(
            0.012, 0.5, f" {word} ", fontsize=18, weight="bold", color="white", va="center",
            bbox={"facecolor": colour, "edgecolor": colour, "boxstyle": "round,pad=0.25"},
        )  # fmt: skip
        head.text(0.14, 0.78, sheet.title, fontsize=13, weight="bold", va="center")
        head.text(0.14, 0.22, sheet.lead, fontsize=9.5, va="center", color=_PLAIN)
        _draw_table(figure.add_subplot(layout[1, 0]), sheet)
        places = [layout[1, 1], layout[2, 0], layout[2, 1]]
        for place, picture in zip(places, sheet.pictures, strict=False):
            axes = figure.add_subplot(place)
            axes.imshow(imread(picture.file))
            axes.set_axis_off()
        save_figure(figure, file)


def _draw_table(axes, sheet: Sheet) -> None:  # type: ignore[no-untyped-def]
    axes.set_axis_off()
    lines = [line for failure in sheet.failures for line in textwrap.wrap(failure, 62)]
    step = 1.0 / max(13.0, len(sheet.rows) + len(lines) + 1.5)
    y = 1.0 - 0.5 * step
    left = 0.03
    for row in sheet.rows:
        colour = {True: _PASS, False: _FAIL, None: _PLAIN}[row.good]
        axes.text(left, y, row.label, fontsize=8.5, va="center")
        axes.text(0.74, y, row.value, fontsize=8.5, va="center", ha="right", color=colour,
                  weight="bold")  # fmt: skip
        axes.text(0.77, y, row.allowed, fontsize=8, va="center", color="#666666")
        y -= step
    y -= 0.5 * step
    for line in lines:
        axes.text(left, y, line, fontsize=8, va="center", color=_FAIL)
        y -= step
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)


def _as_html(sheet: Sheet) -> str:
    word, colour = ("PASS", _PASS) if sheet.passed else ("FAIL", _FAIL)
    rows = "\n".join(
        f'<tr class="{ {True: "good", False: "bad", None: ""}[row.good] }">'
        f"<td>{html.escape(row.label)}</td><td>{html.escape(row.value)}</td>"
        f"<td>{html.escape(row.allowed)}</td></tr>"
        for row in sheet.rows
    )
    failures = "".join(f"<li>{html.escape(text)}</li>" for text in sheet.failures)
    pictures = "\n".join(
        f'<figure><img alt="{html.escape(picture.caption)}" src="data:image/png;base64,'
        f'{base64.b64encode(picture.file.read_bytes()).decode()}">'
        f"<figcaption>{html.escape(picture.caption)}</figcaption></figure>"
        for picture in sheet.pictures
    )
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{html.escape(sheet.title)}: {word}</title>
<style>
body {{ font: 15px/1.4 system-ui, sans-serif; max-width: 64em; margin: 2em auto; padding: 0 1em;
  color: #222; }}
h1 {{ font-size: 1.4em; }}
h1 span {{ background: {colour}; color: white; border-radius: .3em; padding: .1em .5em; }}
table {{ border-collapse: collapse; }}
td {{ padding: .15em 1em .15em 0; border-bottom: 1px solid #e5e5e5; }}
td:nth-child(2) {{ font-weight: bold; text-align: right; }}
td:nth-child(3), figcaption {{ color: #666; }}
.good td:nth-child(2) {{ color: {_PASS}; }} .bad td:nth-child(2), li {{ color: {_FAIL}; }}
img {{ max-width: 100%; }} figure {{ margin: 1.5em 0; }}
</style>
</head>
<body>
<h1><span>{word}</span> {html.escape(sheet.title)}</h1>
<p>{html.escape(sheet.lead)}</p>
<ul>{failures}</ul>
<table>
{rows}
</table>
{pictures}
</body>
</html>
"""
