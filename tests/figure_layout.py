"""What a drawn figure says, and that it can be read: nothing cut off or on top of another."""

from __future__ import annotations

from itertools import combinations

import matplotlib as mpl
import matplotlib.figure
import pytest


def drawn_texts(figure: mpl.figure.Figure) -> list[mpl.text.Text]:
    """The texts that drawing the figure draws (tick labels out of range exist, but are not)."""
    found = []
    draw = mpl.text.Text.draw

    def draw_and_note(text: mpl.text.Text, renderer: object) -> None:
        if text.get_visible() and text.get_text().strip() and text not in found:
            found.append(text)
        draw(text, renderer)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mpl.text.Text, "draw", draw_and_note)
        figure.canvas.draw()
    return found


def check_layout(figure: mpl.figure.Figure) -> str:
    """Fails if a text leaves the figure or overlaps another; returns all texts."""
    boxes = [
        (text.get_text(), mpl.text.Text.get_window_extent(text)) for text in drawn_texts(figure)
    ]
    whole = figure.bbox
    for text, box in boxes:
        assert whole.contains(*box.min), f"'{text}' is cut off"
        assert whole.contains(*box.max), f"'{text}' is cut off"
    for (a, first), (b, second) in combinations(boxes, 2):
        across = min(first.x1, second.x1) - max(first.x0, second.x0)
        up = min(first.y1, second.y1) - max(first.y0, second.y0)
        # A pixel, which letters leave free of their boxes.
        assert across <= 1.0 or up <= 1.0, f"'{a}' overlaps '{b}'"
    return " | ".join(text for text, _ in boxes)
