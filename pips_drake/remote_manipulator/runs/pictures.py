"""Pictures of a run: the arm in its phases, all camera stations, the replay, the film."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pips_drake.remote_manipulator.configuration import STATIONS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.phases import PHASES, TABLE, Phase
from pips_drake.remote_manipulator.runs.data import Event, RunData
from pips_drake.remote_manipulator.runs.film import FilmScript, FilmSettings, film_task
from pips_drake.remote_manipulator.runs.film_lines import directed_stations, display_lines
from pips_drake.remote_manipulator.runs.run import Run
from pips_drake.remote_manipulator.runs.task_scene import TaskScene, station_sheet
from pips_drake.remote_manipulator.scenario import VideoConfig
from pips_drake.twin.figures import figure_style, new_figure, save_figure
from pips_drake.twin.rendering import (
    look_at,
    render_available,
    render_view,
    save_png,
)
from pips_drake.twin.replay import Bookmark, write_replay

Array = NDArray[np.float64]

#: Where the whole scene is looked at from and at what, m in the world: from port, aft and above.
EYE, TARGET = (20.0, -26.0, 15.0), (6.0, 2.2, 2.0)
#: Width and height of a picture, pixels.
SIZE = (1200, 750)
#: More phases than this have no room in the figure.
MOST_PHASES = 6


def phases_figure(file: Path, scene: TaskScene, data: RunData) -> None:
    """The scene in each phase that the run went through, in the middle of its time.

    And at the end, where a place is left.
    """
    starts = [0, *(np.flatnonzero(np.diff(data.phase)) + 1)]
    ends = [*starts[1:], len(data.time)]
    spans = list(zip(starts, ends, strict=True))
    if len(spans) > MOST_PHASES:  # the longest ones
        kept = sorted(spans, key=lambda span: span[0] - span[1])[:MOST_PHASES]
        spans = sorted(kept)
    moments = [_telling_row(data, start, end) for start, end in spans]
    if len(moments) % 2:
        moments.append(len(data.time) - 1)
    rows = len(moments) // 2
    with figure_style():
        figure = new_figure(3.35 * rows)
        grid = figure.subplots(rows, 2, squeeze=False).ravel()
        for axes, row in zip(grid, moments, strict=True):
            axes.set_axis_off()
            phase = Phase(int(data.phase[row]))
            axes.imshow(overview(scene, data.positions[row]))
            name = PHASES[phase].replace("_", " ")
            axes.set_title(f"{name} (mode {TABLE[phase].mode}), t = {data.time[row]:.0f} s")
        save_figure(figure, file)


def _telling_row(data: RunData, start: int, end: int) -> int:
    """The middle of a phase; of the first one its last third, when the arm has come near."""
    share = 0.85 if start == 0 else 0.5
    return start + int(share * (end - 1 - start))


def overview(scene: TaskScene, positions: Array) -> NDArray[np.uint8]:
    """The whole scene from port, aft and above, (height, width, 3)."""
    scene.pose(positions)
    return render_view(scene.query(), look_at(EYE, TARGET), size=SIZE)


def write_pictures(
    folder: Path, run: Run, config: RemoteManipulatorConfig, video: VideoConfig
) -> str | None:
    """`figures/phases.png`, `figures/stations.png` and `camera.mp4`.

    Returns:
        None, or one line that says what is missing here.
    """
    missing = render_available()
    if missing is not None:
        return missing
    data = run.data
    scene = TaskScene.make(config, run.station.machine.settings)
    phases_figure(folder / "figures" / "phases.png", scene, data)
    sheet = station_sheet(scene, data.positions[len(data.time) // 2])
    save_png(sheet, folder / "figures" / "stations.png")
    if not video.enabled:
        return None
    settings = FilmSettings(
        size=(video.width, video.height),
        fps=video.fps,
        speed=video.speed,
        insets=tuple(video.insets),
    )
    return film_task(
        folder / "camera.mp4", film_script(run, scene), config, settings=settings, scene=scene
    )


def film_script(run: Run, scene: TaskScene) -> FilmScript:
    """What the film shows: the operator's stations, or a director's where none was chosen."""
    data = run.data
    first = scene.stations.initial_state(STATIONS[int(data.station[0])])
    stations, cameras = scene.stations.follow(data.control_word, first)
    if np.all(stations == stations[0]):
        distance = data.display["docking_distance_m"]
        stations = directed_stations(data.time, data.phase, distance)
    return FilmScript(
        time=data.time,
        positions=data.positions,
        station=stations,
        cameras=cameras,
        lines=display_lines(
            time=data.time,
            phase=data.phase,
            flags=data.flags,
            display=data.display,
            clearance=data.clearance,
            pairs=data.pairs,
        ),
    )


def write_run_replay(file: Path, run: Run, *, title: str, events: list[Event]) -> None:
    """`replay.html`: the run in three dimensions, with its phases and inhibits to jump to."""
    data, machine = run.data, run.station.machine
    plant = machine.plant
    models = [machine.arm, machine.payload]
    if machine.orbiter_motion is not None:
        models.append(machine.orbiter_motion)
    parts = {
        model: np.array([plant.GetPositionsFromArray(model, q) for q in data.positions])
        for model in models
    }
    first, *others = models
    marks = [
        Bookmark(label=event.text.rpartition("-> ")[2].replace("_", " "), time=event.time)
        for event in events
        if event.kind in ("phase", "inhibit")
    ]
    write_replay(
        file,
        diagram=run.diagram,
        plant=plant,
        model=first,
        time=data.time,
        positions=parts[first],
        more_positions={model: parts[model] for model in others},
        eye=EYE,
        target=TARGET,
        title=title,
        sample_rate=2.0,
        speed=16.0,
        bookmarks=marks[:12],
    )
