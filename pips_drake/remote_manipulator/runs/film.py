"""The film of a task: what the operator saw, with other stations as insets.

It is made after the run, from the plant's recorded positions: the run itself renders nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tqdm import tqdm

from pips_drake.config import require
from pips_drake.remote_manipulator.camera_stations import station_index
from pips_drake.remote_manipulator.configuration import STATIONS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.runs.picture_text import framed, write_strip, write_text
from pips_drake.remote_manipulator.runs.task_scene import TaskScene, station_label
from pips_drake.remote_manipulator.station.plant import PlantSettings
from pips_drake.twin.rendering import render_available
from pips_drake.twin.video import VideoFile, video_available

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

#: An inset's share of the film's width, and what shows instead of one that is the main view.
INSET_SHARE, STAND_INS = 0.26, "CGHA"


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmScript:
    """What happened, sample by sample, N of them, in order of time.

    Attributes:
        time: (N,) s.
        positions: (N, n), the plant's.
        station: (N,), the main view's, indices of `STATIONS`.
        cameras: (N, 13, 3), pan, tilt and field of view of every station, rad.
        lines: of each sample, one or more: what the operator is shown; one that begins with "!" is
            a warning.
    """

    time: Array
    positions: Array
    station: NDArray[np.int64]
    cameras: Array
    lines: Sequence[tuple[str, ...]]

    def __post_init__(self) -> None:
        count = len(self.time)
        require(count > 0, "film: samples", count, "> 0")
        for name in ("positions", "station", "cameras", "lines"):
            length = len(getattr(self, name))
            require(length == count, f"film: samples of {name}", length, f"{count}, as of time")
        shape = np.shape(self.cameras)[1:]
        require(shape == (len(STATIONS), 3), "film: shape of cameras", shape, "(N, 13, 3)")


@dataclass(frozen=True, kw_only=True)
class FilmSettings:
    """How a task is filmed.

    Attributes:
        size: width and height, pixels, even.
        fps: frames a second.
        speed: simulated seconds a second of watching.
        insets: letters of the stations that are shown small, three at most.
    """

    size: tuple[int, int] = (960, 540)
    fps: int = 15
    speed: float = 8.0
    insets: tuple[str, ...] = ("G", "H")

    def __post_init__(self) -> None:
        require(self.fps >= 1, "film: fps", self.fps, ">= 1")
        require(self.speed > 0.0, "film: speed", self.speed, "> 0")
        require(len(self.insets) <= 3, "film: insets", self.insets, "three at most")
        for name in self.insets:
            station_index(name)


def film_task(
    file: Path,
    script: FilmScript,
    config: RemoteManipulatorConfig,
    *,
    plant_settings: PlantSettings | None = None,
    settings: FilmSettings | None = None,
    scene: TaskScene | None = None,
) -> str | None:
    """Writes the film of a task; None, or one line that says why it cannot be made here.

    The main view is the script's station, the others are insets in the upper corners; below is what
    the operator is shown.

    Args:
        plant_settings: of the run.
        settings: size, speed and insets.
        scene: one that is there already; `plant_settings` is then not needed.
    """
    missing = render_available() or video_available()
    if missing is not None:
        return missing
    settings = settings or FilmSettings()
    scene = scene or TaskScene.make(config, plant_settings)
    wanted, found = scene.machine.plant.num_positions(), np.shape(script.positions)[1]
    require(found == wanted, "film: positions of a sample", found, f"{wanted}, as the plant has")
    samples = film_samples(script.time, settings)
    with VideoFile(file, size=settings.size, fps=settings.fps) as video:
        for sample in tqdm(samples, desc="filming", unit="picture", disable=None, leave=False):
            scene.pose(script.positions[sample])
            video.write(film_frame(scene, script, int(sample), settings))
    return None


def film_samples(time: ArrayLike, settings: FilmSettings) -> NDArray[np.int64]:
    """Indices of the samples nearest to the film's frames, from the first to the last one."""
    t = np.asarray(time, dtype=np.float64)
    step = settings.speed / settings.fps
    wanted = t[0] + step * np.arange(1 + math.floor((t[-1] - t[0]) / step + 1e-9))
    middles = 0.5 * (t[1:] + t[:-1])
    return np.searchsorted(middles, wanted, side="right").astype(np.int64)


def film_frame(
    scene: TaskScene, script: FilmScript, sample: int, settings: FilmSettings
) -> Picture:
    """One frame of the film, (height, width, 3); the scene must stand as in the sample."""
    main = int(script.station[sample])
    cameras = script.cameras[sample]
    insets = inset_stations(main, settings.insets)
    width, height = settings.size
    small = (round(INSET_SHARE * width), round(INSET_SHARE * height))
    views = [(main, settings.size), *((station, small) for station in insets)]
    picture, *others = scene.pictures(cameras, views)
    size = max(9, height // 36)
    gap = max(2, height // 90)
    # Upper left, upper right, then below the latter.
    corners = ((gap, gap), (width - small[0] - gap, gap), (width - small[0] - gap, 0))
    order = {1: (1,), 2: (0, 1), 3: (0, 1, 2)}.get(len(insets), ())
    for station, inset, corner in zip(insets, others, order, strict=True):
        left, top = corners[corner]
        if corner == 2:
            top = 2 * gap + small[1]
        label = station_label(station, cameras[station])
        write_text(inset, label, (gap, gap), size=max(8, size - 3))
        picture[top : top + small[1], left : left + small[0]] = framed(inset)
    first, *rest = script.lines[sample]
    label = station_label(main, cameras[main])
    lines = (f"{first}   {label}   {settings.speed:g} times as fast", *rest)
    write_strip(picture, lines, size=size)
    return picture


def inset_stations(main: int, wanted: Sequence[str]) -> list[int]:
    """Stations of the insets: those wanted, and another one for what is the main view already."""
    chosen: list[int] = []
    for name in wanted:
        taken = {main, *chosen}
        candidates = [station_index(letter) for letter in (name, *STAND_INS)]
        chosen.append(next(index for index in candidates if index not in taken))
    return chosen
