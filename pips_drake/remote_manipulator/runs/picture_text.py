"""Text and edges in pictures."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Color = tuple[int, int, int]

WHITE: Color = (255, 255, 255)
AMBER: Color = (255, 190, 60)


def framed(picture: Picture) -> Picture:
    """The picture with a white edge."""
    result = picture.copy()
    result[[0, -1]] = 255
    result[:, [0, -1]] = 255
    return result


def write_strip(picture: Picture, lines: Sequence[str], *, size: int) -> None:
    """Lines at the picture's bottom, on a darker strip; those that begin with "!" are amber."""
    pitch = round(1.45 * size)
    height = min(picture.shape[0], pitch * len(lines) + size // 2)
    top = picture.shape[0] - height
    picture[top:] = (0.3 * picture[top:]).astype(np.uint8)
    for row, line in enumerate(lines):
        warns = line.startswith("!")
        where = (size // 2, top + size // 4 + row * pitch)
        color = AMBER if warns else WHITE
        write_text(picture, line.removeprefix("!").strip(), where, size=size, color=color)


def write_text(
    picture: Picture,
    text: str,
    corner: tuple[int, int],
    *,
    size: int,
    color: Color = WHITE,
) -> None:
    """Writes text, with a dark edge, from its upper left corner (across, down) on, in pixels."""
    if not text:
        return
    cover, edge = _letters(text, size)
    left, top = corner
    rows, columns = picture.shape[0] - top, picture.shape[1] - left
    cover, edge = cover[: max(0, rows), : max(0, columns)], edge[: max(0, rows), : max(0, columns)]
    area = picture[top : top + cover.shape[0], left : left + cover.shape[1]]
    area[:] = np.rint(area * (1.0 - edge) * (1.0 - cover) + np.array(color) * cover)


@functools.lru_cache(maxsize=256)
def _letters(text: str, size: int) -> tuple[Array, Array]:
    """Cover of the letters, and of a dark edge round them, (height, width, 1) of 0 to 1.

    As high for every text of a size, so that lines stay level.
    """
    from matplotlib import font_manager
    from matplotlib.ft2font import FT2Font
    from scipy.ndimage import maximum_filter

    font = FT2Font(font_manager.findfont("DejaVu Sans"))
    font.set_size(size, 72.0)
    font.set_text(text)
    font.draw_glyphs_to_bitmap()
    letters = np.asarray(font.get_image(), dtype=np.float64) / 255.0
    height = round(1.4 * size)
    cover = np.zeros((height, letters.shape[1] + 2))
    # Below the base line, by the descent of what is written.
    base = round(1.1 * size) + round(font.get_descent() / 64.0)
    top = max(0, base - letters.shape[0])
    rows = min(letters.shape[0], height - top)
    cover[top : top + rows, 1:-1] = letters[:rows]
    edge = 0.7 * maximum_filter(cover, size=3)
    return cover[:, :, None], edge[:, :, None]
