"""Video files: frames are compressed as they come, so a long run needs no more memory than a short.

Needs PyAV, the package's extra `video`.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.config import require
from pips_drake.errors import InputError

Picture = NDArray[np.uint8]

#: Quality of the compression: 18 looks like the original, 28 is coarse.
_RATE_FACTOR = 22


def video_available() -> str | None:
    """None if videos can be written here, else one line that says what is missing."""
    if importlib.util.find_spec("av") is not None:
        return None
    return "PyAV is missing (pip install pips-drake[video])"


class VideoFile:
    """An MP4 file (H.264) that frames are written to; it appears whole when the block ends.

        with VideoFile(file, size=(640, 480), fps=24) as video:
            video.write(picture)

    Args:
        file: where.
        size: width and height, pixels; both even, as H.264's colours need them.
        fps: frames a second.

    Raises:
        InputError: PyAV is missing, or the size is odd.
    """

    def __init__(self, file: Path, *, size: tuple[int, int], fps: int) -> None:
        missing = video_available()
        if missing is not None:
            raise InputError(f"no {file.name}: {missing}")
        require(size[0] % 2 == 0 and size[1] % 2 == 0, "video size", size, "even numbers")
        self._file, self._size, self._fps = file, size, fps
        self._partial = file.with_name(f".{file.name}.partial")
        self.frames = 0

    def __enter__(self) -> VideoFile:
        import av

        self._container: Any = av.open(str(self._partial), "w", format="mp4")
        self._stream = self._container.add_stream("libx264", rate=self._fps)
        self._stream.width, self._stream.height = self._size
        self._stream.pix_fmt = "yuv420p"  # what every player knows
        # One thread compresses the same frames to the same bytes.
        self._stream.options = {"crf": str(_RATE_FACTOR), "threads": "1"}
        return self

    def write(self, picture: ArrayLike) -> None:
        """Adds a frame (height, width, 3) of 0 to 255."""
        import av

        pixels = np.ascontiguousarray(picture, dtype=np.uint8)
        if pixels.shape != (self._size[1], self._size[0], 3):
            raise InputError(
                f"frame of shape {pixels.shape}; must be {(self._size[1], self._size[0], 3)}"
            )
        frame = av.VideoFrame.from_ndarray(pixels, format="rgb24")
        for packet in self._stream.encode(frame):
            self._container.mux(packet)
        self.frames += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            for packet in self._stream.encode():
                self._container.mux(packet)
        self._container.close()
        if kind is None and self.frames > 0:
            self._partial.replace(self._file)
        else:
            self._partial.unlink(missing_ok=True)


def caption(picture: ArrayLike, text: str, *, size: int = 15) -> Picture:
    """The picture (height, width, 3) with white text on a dark strip in its lower left corner.

    Args:
        size: of the letters, about their height in pixels.
    """
    from matplotlib import font_manager
    from matplotlib.ft2font import FT2Font

    font = FT2Font(font_manager.findfont("DejaVu Sans"))
    font.set_size(size, 72.0)
    font.set_text(text)
    font.draw_glyphs_to_bitmap()
    letters = np.asarray(font.get_image(), dtype=np.float64)[:, :, None] / 255.0
    result = np.array(picture, dtype=np.uint8)
    edge = size // 3
    height, width = letters.shape[0] + 2 * edge, letters.shape[1] + 2 * edge
    cover = np.zeros((height, width, 1))
    cover[edge:-edge, edge:-edge] = letters
    rows, columns = min(height, result.shape[0]), min(width, result.shape[1])
    strip, cover = result[-rows:, :columns], cover[-rows:, :columns]
    result[-rows:, :columns] = np.rint(0.35 * strip * (1.0 - cover) + 255.0 * cover)
    return result
