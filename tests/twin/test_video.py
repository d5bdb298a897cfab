"""A film holds its frames, at its size and speed, and appears whole or not at all."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.twin import video
from pips_drake.twin.video import VideoFile, caption

SIZE = (64, 48)


def frames(count: int) -> list[np.ndarray]:
    """A white bar that goes from left to right."""
    made = []
    for k in range(count):
        frame = np.zeros((SIZE[1], SIZE[0], 3), dtype=np.uint8)
        frame[:, 4 * k : 4 * k + 8] = 255
        made.append(frame)
    return made


def write(file, count=10):
    with VideoFile(file, size=SIZE, fps=12) as film:
        for frame in frames(count):
            film.write(frame)


def test_what_is_written_reads_back(tmp_path):
    av = pytest.importorskip("av")
    write(tmp_path / "a.mp4")
    with av.open(str(tmp_path / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height) == SIZE
        assert float(stream.average_rate) == 12.0
        found = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(found) == 10
    for frame, truth in zip(found, frames(10), strict=True):
        # Compressed: a little of each edge smears.
        assert np.abs(frame.astype(float) - truth).mean() < 6.0
    assert [path.name for path in tmp_path.iterdir()] == ["a.mp4"]


def test_the_same_frames_give_the_same_bytes(tmp_path):
    pytest.importorskip("av")
    write(tmp_path / "a.mp4")
    write(tmp_path / "b.mp4")
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_a_stopped_film_leaves_nothing(tmp_path):
    pytest.importorskip("av")
    with pytest.raises(KeyboardInterrupt), VideoFile(tmp_path / "a.mp4", size=SIZE, fps=12) as film:
        film.write(frames(1)[0])
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_frames_of_another_size_and_odd_sizes_are_refused(tmp_path):
    pytest.importorskip("av")
    with pytest.raises(InputError, match=r"video size = \(63, 48\); must be even numbers"):
        VideoFile(tmp_path / "a.mp4", size=(63, 48), fps=12)
    with (
        pytest.raises(InputError, match=r"frame of shape \(2, 2, 3\); must be \(48, 64, 3\)"),
        VideoFile(tmp_path / "a.mp4", size=SIZE, fps=12) as film,
    ):
        film.write(np.zeros((2, 2, 3)))


def test_without_pyav_the_message_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setattr(video.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"no a\.mp4: PyAV is missing \(pip install .*\[video\]\)"):
        VideoFile(tmp_path / "a.mp4", size=SIZE, fps=12)


def test_a_caption_stands_in_the_lower_left_corner():
    plain = np.full((100, 300, 3), 200, dtype=np.uint8)
    written = caption(plain, "t = 1.0 s")
    changed = np.argwhere((written != plain).any(axis=2))
    assert changed.min(axis=0)[0] > 60 and changed.max(axis=0)[1] < 150
    assert tuple(changed.max(axis=0)[:1]) == (99,) and changed.min(axis=0)[1] == 0
    assert written.max() == 255, "white letters"
    assert (plain == 200).all(), "the picture given is left alone"
