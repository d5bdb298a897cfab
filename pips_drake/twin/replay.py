"""`replay.html`: a run in three dimensions, in one file that opens without a server.

The replay is made after the run, from recorded positions: nothing is published while the run goes
on, and the samples can be as far apart as the motion allows (the page interpolates between them).
"""

from __future__ import annotations

import contextlib
import html
import json
import logging
import math
import string
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.errors import InputError
from pips_drake.twin.output_folder import write_whole
from pips_drake.twin.rendering import FIELD_OF_VIEW
from pips_drake.twin.replay_panel import ReplayPanel, panel_html
from pips_drake.twin.seen_figure import ColoredPatches

if TYPE_CHECKING:
    from pydrake.geometry import FrameId, Meshcat, MeshcatAnimation, QueryObject
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import ModelInstanceIndex
    from pydrake.systems.framework import Diagram

Array = NDArray[np.float64]

#: Samples a simulated second.
SAMPLE_RATE = 4.0
#: Simulated seconds a second of watching.
SPEED = 8.0
#: A pose is left out if the page's own interpolation is as near as this, m (at most 1 m from the
#: body's origin). Most of the motion is so even that a quarter of the samples is left.
_TOLERANCE = 0.5e-3
_ROOT = "/replay"
_GREY = (0.6, 0.6, 0.6, 1.0)

# Below the view: title, bookmarks, time. The animation's time is the simulated one.
_CONTROLS = Path(__file__).with_name("replay_controls.html")
_SPEEDS = (1.0, 4.0, 8.0, 16.0)


@dataclass(frozen=True, kw_only=True)
class LineInSpace:
    """A line to draw in a replay.

    Attributes:
        name: its path in the page's tree of objects.
        points: (N, 3) m in the world.
        color: red, green, blue, 0 to 1.
        width: pixels; many browsers draw 1 whatever it says.
    """

    name: str
    points: ArrayLike
    color: tuple[float, float, float] = (0.835, 0.369, 0.0)
    width: float = 3.0


@dataclass(frozen=True, kw_only=True)
class Bookmark:
    """A moment to jump to in a replay.

    Attributes:
        label: what is there; the page adds the time.
        time: s, on the recorded positions' clock.
        line: shown near that moment alone, with the label, through whatever stands before it; its
            first and last points are joined.
    """

    label: str
    time: float
    line: LineInSpace | None = None


def make_meshcat(port: int | None = None) -> Meshcat:
    """A Meshcat server that only this machine can reach.

    Args:
        port: a free one by default.

    Raises:
        InputError: the port is taken.
    """
    from pydrake.geometry import Meshcat, MeshcatParams

    try:
        return Meshcat(MeshcatParams(host="localhost", port=port, show_stats_plot=False))
    except RuntimeError as error:
        raise InputError(f"no Meshcat on port {port or 'any'}: {error}") from None


@contextlib.contextmanager
def _without_news() -> Iterator[None]:
    """Drake says where a Meshcat listens, but a replay's is for nobody to look at."""
    logger = logging.getLogger("drake")
    level = logger.level
    logger.setLevel(logging.WARNING)
    try:
        yield
    finally:
        logger.setLevel(level)


class Replay:
    """Shapes, lines and poses over time, to be written as a page.

    Args:
        query_object: of the scene graph; what has an illustration role is shown.
        sample_rate: samples a second.
    """

    def __init__(self, query_object: QueryObject, *, sample_rate: float = SAMPLE_RATE) -> None:
        self.sample_rate = sample_rate
        self.samples = 0
        with _without_news():
            self._meshcat = make_meshcat()
        self._paths = self._add_shapes(query_object)
        self._tracks: dict[FrameId, list[Array]] = {frame: [] for frame in self._paths}
        self._set_scenery()

    def add_line(self, line: LineInSpace) -> None:
        """Draws a line that stays."""
        from pydrake.geometry import Rgba

        vertices = np.asarray(line.points, dtype=np.float64).reshape(-1, 3).T
        self._meshcat.SetLine(f"{_ROOT}/{line.name}", vertices, line.width, Rgba(*line.color, 1.0))

    def add_patches(self, patches: ColoredPatches, *, name: str) -> None:
        """Draws coloured triangles that stay; `name` is their path in the page's tree."""
        from pydrake.geometry import Meshcat

        if len(patches.corners) == 0:
            return
        vertices = patches.corners.reshape(-1, 3).T
        faces = np.arange(vertices.shape[1], dtype=np.int32).reshape(-1, 3).T
        self._meshcat.SetTriangleColorMesh(
            f"{_ROOT}/{name}",
            np.asfortranarray(vertices),
            np.asfortranarray(faces),
            np.asfortranarray(np.repeat(patches.colors, 3, axis=0).T),
            side=Meshcat.SideOfFaceToRender.kFrontSide,
        )

    def add_sample(self, query_object: QueryObject) -> None:
        """Adds poses, one `1 / sample_rate` s after the last."""
        for frame, track in self._tracks.items():
            # Numbers, not the pose: that one is Drake's own, and changes with the context.
            X_WF = query_object.GetPoseInWorld(frame)
            quaternion = X_WF.rotation().ToQuaternion().wxyz()
            if track and np.dot(quaternion, track[-1][3:]) < 0.0:
                quaternion = -quaternion  # the same rotation, the short way from the last
            track.append(np.concatenate([X_WF.translation(), quaternion]))
        self.samples += 1

    def write(
        self,
        file: Path,
        *,
        eye: ArrayLike,
        target: ArrayLike,
        title: str,
        note: str = "",
        start: float = 0.0,
        speed: float = SPEED,
        bookmarks: Sequence[Bookmark] = (),
        phases: Mapping[str, float] | None = None,
        panel: ReplayPanel | None = None,
    ) -> None:
        """Writes the page.

        Args:
            eye, target: where the camera stands and looks at first, (3,) m.
            title: of the page and its label.
            note: below the title.
            start: time of the first sample, s.
            speed: simulated seconds a second of watching; the page offers others.
            bookmarks: moments to jump to.
            phases: when each begins, s, by name, in order; marked on the time slider.
            panel: a flat view below.
        """
        from pydrake.geometry import Meshcat

        self._meshcat.SetAnimation(self._make_animation())
        camera = Meshcat.PerspectiveCamera(fov=math.degrees(FIELD_OF_VIEW))
        self._meshcat.SetCamera(camera)  # the same as in pictures; Meshcat's own sees 75 deg
        self._meshcat.SetCameraPose(np.asarray(eye, float), np.asarray(target, float))
        duration = max(0, self.samples - 1) / self.sample_rate
        controls = string.Template(_CONTROLS.read_text(encoding="utf-8")).substitute(
            title=html.escape(title),
            note=f"<br>{html.escape(note)}" if note else "",
            data=_page_data(duration, start, speed, bookmarks, phases),
        )
        controls += panel_html(panel, start) if panel is not None else ""
        page = self._meshcat.StaticHtml()
        page = page.replace("<title>Drake MeshCat</title>", f"<title>{html.escape(title)}</title>")
        body, end, rest = page.rpartition("</body>")
        write_whole(file, body + controls + end + rest)

    def _make_animation(self) -> MeshcatAnimation:
        """Places what stands still, and returns keys for what moves."""
        from pydrake.common.eigen_geometry import Quaternion
        from pydrake.geometry import MeshcatAnimation
        from pydrake.math import RigidTransform

        animation = MeshcatAnimation(frames_per_second=self.sample_rate)
        animation.set_repetitions(1000)
        for frame, poses in self._tracks.items():
            path, track = self._paths[frame], np.array(poses)
            keys = needed_keys(track, _TOLERANCE)
            for key in keys:
                wxyz = track[key, 3:] / np.linalg.norm(track[key, 3:])
                X_WF = RigidTransform(Quaternion(wxyz), track[key, :3])
                if key == 0:
                    self._meshcat.SetTransform(path, X_WF)
                if len(keys) > 1:
                    animation.SetTransform(int(key), path, X_WF)
        return animation

    def _add_shapes(self, query_object: QueryObject) -> dict[FrameId, str]:
        """Draws the shapes in their frames; returns the frames' paths in Meshcat's tree."""
        from pydrake.geometry import Rgba, Role

        inspector = query_object.inspector()
        paths: dict[FrameId, str] = {}
        for frame in inspector.GetAllFrameIds():
            path = f"{_ROOT}/{inspector.GetName(frame).replace('::', '/')}"
            for geometry in inspector.GetGeometries(frame, Role.kIllustration):
                properties = inspector.GetIllustrationProperties(geometry)
                color = properties.GetPropertyOrDefault("phong", "diffuse", Rgba(*_GREY))
                name = f"{path}/{inspector.GetName(geometry).replace('::', '/')}"
                self._meshcat.SetObject(name, inspector.GetShape(geometry), color)
                self._meshcat.SetTransform(name, inspector.GetPoseInFrame(geometry))
                paths[frame] = path
        return paths

    def _set_scenery(self) -> None:
        meshcat = self._meshcat
        meshcat.SetProperty("/Axes", "visible", False)
        meshcat.SetProperty("/Grid", "visible", False)
        meshcat.SetProperty("/Background/<object>", "top_color", [0.90, 0.93, 0.96])
        meshcat.SetProperty("/Background/<object>", "bottom_color", [0.98, 0.98, 0.98])
        # Meshcat's lamps hang 2 m above the origin, below much of what is large: an even light and
        # one from above instead.
        meshcat.SetProperty("/Lights/PointLightNegativeX", "visible", False)
        meshcat.SetProperty("/Lights/PointLightPositiveX", "visible", False)
        meshcat.SetProperty("/Lights/AmbientLight/<object>", "intensity", 0.9)
        meshcat.SetProperty("/Lights/FillLight/<object>", "intensity", 2.2)
        meshcat.SetProperty("/Lights/FillLight", "position", [-7.0, -3.0, 10.0])


def _page_data(
    duration: float,
    start: float,
    speed: float,
    bookmarks: Sequence[Bookmark],
    phases: Mapping[str, float] | None,
) -> str:
    """What the page's controls know, as JSON that HTML takes for text; times from `start` on."""
    marks: list[dict[str, Any]] = []
    for bookmark in bookmarks:
        mark = {"label": bookmark.label, "time": bookmark.time - start, "color": "#222"}
        if bookmark.line is not None:
            points = np.asarray(bookmark.line.points, dtype=np.float64).reshape(-1, 3)
            mark["line"] = points[[0, -1]].round(6).tolist()
            mark["color"] = "#" + "".join(f"{round(255 * c):02x}" for c in bookmark.line.color)
        marks.append(mark)
    begins = [{"label": name, "time": time - start} for name, time in (phases or {}).items()]
    data = {
        "duration": duration,
        "start": start,
        "speed": speed,
        "speeds": sorted({*_SPEEDS, speed}),
        "bookmarks": marks,
        "phases": begins,
    }
    return json.dumps(data).replace("<", "\\u003c")


def needed_keys(track: Array, tolerance: float) -> NDArray[np.int_]:
    """Rows of a track (N, K) between which straight lines are within `tolerance` of all rows.

    The first and last rows and, as Douglas and Peucker do it, the row farthest from each line that
    is not near enough; the first alone if nothing changes.
    """
    if np.ptp(track, axis=0).max() <= tolerance:
        return np.array([0])
    kept, spans = {0, len(track) - 1}, [(0, len(track) - 1)]
    while spans:
        first, last = spans.pop()
        fraction = np.linspace(0.0, 1.0, last - first + 1)[:, None]
        line = track[first] + fraction * (track[last] - track[first])
        distance = np.abs(track[first : last + 1] - line).max(axis=1)
        worst = first + int(np.argmax(distance))
        if distance[worst - first] > tolerance:
            kept.add(worst)
            spans += [(first, worst), (worst, last)]
    return np.array(sorted(kept))


def write_replay(
    file: Path,
    *,
    diagram: Diagram,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
    time: ArrayLike,
    positions: ArrayLike,
    more_positions: Mapping[ModelInstanceIndex, ArrayLike] | None = None,
    eye: ArrayLike,
    target: ArrayLike,
    title: str,
    note: str = "",
    lines: Sequence[LineInSpace] = (),
    seen: ColoredPatches | None = None,
    sample_rate: float = SAMPLE_RATE,
    speed: float = SPEED,
    bookmarks: Sequence[Bookmark] = (),
    phases: Mapping[str, float] | None = None,
    panel: ReplayPanel | None = None,
) -> None:
    """Writes the recorded motion of a model as a page; about 4 MB.

    Args:
        diagram: holds the plant and its scene graph, at any depth; a context of its own is used.
        model: whose positions were recorded; other models stay at their defaults.
        time: of the recorded positions, ascending, (N,) s.
        positions: (N, model's positions) m and rad.
        more_positions: of further models that were recorded, likewise.
        eye, target: where the camera stands and looks at first, (3,) m.
        title: of the page.
        note: below the title.
        lines: drawn in the world, such as the path.
        seen: coloured patches of what a camera has seen.
        sample_rate: samples a simulated second; the nearest recorded positions are taken.
        speed: simulated seconds a second of watching; the page offers others.
        bookmarks: moments to jump to.
        phases: when each begins, s, by name, in order; marked on the time slider.
        panel: a flat view below.
    """
    recorded = np.asarray(time, dtype=np.float64)
    motions = {
        moved: np.asarray(values, dtype=np.float64)
        for moved, values in {model: positions, **(more_positions or {})}.items()
    }
    for moved, q in motions.items():
        if recorded.size == 0 or q.shape != (recorded.size, plant.num_positions(moved)):
            raise InputError(
                f"{file.name}: time of shape {recorded.shape}, positions of shape {q.shape}; "
                f"must be (N > 0,) and (N, {plant.num_positions(moved)})"
            )
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    query_port = plant.get_geometry_query_input_port()
    replay = Replay(query_port.Eval(plant_context), sample_rate=sample_rate)
    for line in lines:
        replay.add_line(line)
    if seen is not None:
        replay.add_patches(seen, name="seen surface")
    count = 1 + int(np.ceil((recorded[-1] - recorded[0]) * sample_rate - 1e-9))
    for wanted in recorded[0] + np.arange(count) / sample_rate:
        nearest = int(np.argmin(np.abs(recorded - wanted)))
        for moved, q in motions.items():
            plant.SetPositions(plant_context, moved, q[nearest])
        replay.add_sample(query_port.Eval(plant_context))
    replay.write(
        file,
        eye=eye,
        target=target,
        title=title,
        note=note,
        start=float(recorded[0]),
        speed=speed,
        bookmarks=bookmarks,
        phases=phases,
        panel=panel,
    )
