"""What the camera at the arm's tip saw of a run: its film, and the surface that it has seen.

Made after the run from what was recorded, so that rendering slows no simulation down.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common import MemoryFile
from pydrake.geometry import (
    GeometryInstance,
    InMemoryMesh,
    Mesh,
    PerceptionProperties,
    QueryObject,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from tqdm import tqdm

from pips_drake.serpentine.runs.assessment import RunData
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import (
    AddCameraStation,
    SerpentineSetup,
    camera_target,
    make_plant,
)
from pips_drake.twin.camera import PinholeCamera, seen_distances
from pips_drake.twin.rendering import (
    FIELD_OF_VIEW,
    add_renderer,
    corner_points,
    fit_view,
    render_available,
    render_depth,
    render_view,
)
from pips_drake.twin.seen_figure import (
    ColoredPatches,
    color_patches,
    seen_surface_figure,
)
from pips_drake.twin.surface import SeenSurface, body_surface
from pips_drake.twin.systems.camera_station import CameraStation
from pips_drake.twin.video import VideoFile, caption, video_available

Array = NDArray[np.float64]

#: Pixels of the picture in the figure.
PICTURE_SIZE = (900, 1000)
#: Intensity of the lamp beside the camera, without which what hangs in a bay is black.
HEADLIGHT = 0.7
#: Different colours of the patches in it: each is a mesh of its own to the renderer.
COLOR_LEVELS = 12


@dataclass(frozen=True, kw_only=True)
class Film:
    """What the camera has to say about a run.

    Attributes:
        summary: its keys of `summary.json`.
        note: one line for the replay.
        patches: what it has seen, coloured by the least distance.
    """

    summary: dict[str, Any]
    note: str = ""
    patches: ColoredPatches | None = None


def film_run(
    folder: Path,
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    *,
    data: RunData,
    pan_tilt: Array,
) -> Film:
    """Writes `camera.mp4` and `figures/seen_surface.png`; what cannot be made here is named.

    Args:
        pan_tilt: of the camera at the data's times, (N, 2) rad.
    """
    rig = _Rig.make(scenario, setup)
    end = int(np.argmax(data.tip_arc_lengths))
    missing = render_available()
    video_missing = missing or video_available()
    seen = None
    if rig.target_name:
        seen = SeenSurface(surface=rig.surface())
    config = scenario.camera
    frames = _frames(data.time, config.picture_period_s)
    track, errors = [], []
    with contextlib.ExitStack() as stack:
        video = None
        if video_missing is None:
            size = (config.width, config.height)
            file = VideoFile(folder / "camera.mp4", size=size, fps=config.fps)
            video = stack.enter_context(file)
        for sample in tqdm(frames, desc="filming", unit="picture", disable=None, leave=False):
            rig.pose(data.joints[sample], pan_tilt[sample])
            X_WC = rig.camera_pose()
            to_target = rig.target - X_WC.translation()
            track.append(X_WC.translation().copy())  # Drake's own, which changes with the context
            errors.append(_angle(X_WC.rotation().col(2), to_target))
            text = f"t = {data.time[sample]:.1f} s"
            if seen is not None:
                depth = rig.depth_image() if missing is None else None
                seen.add(rig.station.camera, X_WC, depth_image=depth)
                gap = np.linalg.norm(seen.surface.patches.points - X_WC.translation(), axis=1)
                text += f"    {gap.min():.2f} m to {rig.target_name.split('::')[0]}"
                text += f"    seen {100.0 * seen.fraction:.0f} %"
            if video is not None:
                video.write(caption(rig.color_image(), text))
    rig.pose(data.joints[end], pan_tilt[end])
    eye = rig.camera_pose().translation()
    summary: dict[str, Any] = {
        "camera_target_distance_end_m": np.linalg.norm(rig.target - eye),
        "camera_aim_error_max_rad": max(errors),
        "camera_aim_error_end_rad": _angle(rig.camera_pose().rotation().col(2), rig.target - eye),
        "camera_pictures": len(frames),
    }
    if video_missing is not None:
        summary["camera_film_missing"] = video_missing
    if seen is None:
        return Film(summary=summary)
    near = np.linalg.norm(seen.surface.patches.points - eye, axis=1).min()
    summary |= {
        "camera_surface_distance_end_m": near,
        "seen_area_m2": seen.area,
        "seen_fraction": seen.fraction,
        "seen_distance_min_m": seen.distance.min() if seen.seen.any() else None,
    }
    notes = ["Seen: in the picture and in range, sharp, facing the camera, nothing before it."]
    if missing is not None:
        notes = ["Seen: in the picture and in range, sharp, facing the camera."]
        notes += ["What stands before it is not looked for without a renderer."]
    summary["seen_checks_hiding"] = missing is None
    if seen.surface.left_out:
        notes.append(f"Left out: {', '.join(seen.surface.left_out)}.")
    patches = color_patches(seen)
    picture = None
    if missing is None:
        joints = data.joints[end]
        picture = _picture(scenario, setup, seen, color_patches(seen, levels=COLOR_LEVELS), joints)
    (folder / "figures").mkdir(exist_ok=True)
    seen_surface_figure(
        folder / "figures" / "seen_surface.png",
        seen,
        focal_length=rig.station.camera.focal_length,
        camera_track=np.array(track),
        picture=picture,
        notes=tuple(notes),
    )
    note = (
        f"seen of {rig.target_name}: {100.0 * seen.fraction:.0f} %, coloured by least distance "
        "(yellow near, violet far)"
    )
    return Film(summary=summary, note=note, patches=patches)


@dataclass(kw_only=True)
class _Rig:
    """A posed arm in its scene with its camera."""

    diagram: Diagram
    plant: MultibodyPlant
    model: ModelInstanceIndex
    scene_graph: SceneGraph
    station: CameraStation
    target_name: str
    target: Array
    context: Context = field(init=False)

    def __post_init__(self) -> None:
        self.context = self.diagram.CreateDefaultContext()
        self._at_plant = self.plant.GetMyMutableContextFromRoot(self.context)
        self._at_station = self.station.GetMyContextFromRoot(self.context)

    @classmethod
    def make(cls, scenario: SerpentineScenario, setup: SerpentineSetup) -> _Rig:
        builder = DiagramBuilder()
        plant, scene_graph, model = make_plant(builder, setup, scenario)
        station = AddCameraStation(
            builder,
            plant=plant,
            scene_graph=scene_graph,
            model=model,
            arm=setup.arm,
            config=scenario.camera,
        )
        if render_available() is None:
            add_renderer(scene_graph, headlight=HEADLIGHT)
        builder.ExportInput(station.GetInputPort("pan_tilt"), "pan_tilt")
        _, target = camera_target(plant, scenario)
        return cls(
            diagram=builder.Build(),
            plant=plant,
            model=model,
            scene_graph=scene_graph,
            station=station,
            target_name=scenario.camera.target_body,
            target=target,
        )

    def pose(self, joints: Array, pan_tilt: Array) -> None:
        self.plant.SetPositions(self._at_plant, self.model, joints)
        self.diagram.GetInputPort("pan_tilt").FixValue(self.context, pan_tilt)

    def surface(self) -> Any:
        model, body = self.target_name.split("::")
        instance = self.plant.GetModelInstanceByName(model)
        geometries = self.plant.GetCollisionGeometriesForBody(
            self.plant.GetBodyByName(body, instance)
        )
        return body_surface(self.query(), geometries, self.target_name)

    def query(self) -> QueryObject:
        at_scene = self.scene_graph.GetMyContextFromRoot(self.context)
        return self.scene_graph.get_query_output_port().Eval(at_scene)

    def camera_pose(self) -> RigidTransform:
        return self.station.GetOutputPort("camera_pose").Eval(self._at_station)

    def color_image(self) -> NDArray[np.uint8]:
        image = self.station.GetOutputPort("color_image").Eval(self._at_station)
        pixels: NDArray[np.uint8] = np.array(image.data)[:, :, :3]
        return pixels

    def depth_image(self) -> Array:
        image = self.station.GetOutputPort("depth_image").Eval(self._at_station)
        depth: Array = np.array(image.data, dtype=np.float64)[:, :, 0]
        return depth


def _frames(time: Array, period: float) -> NDArray[np.int_]:
    """Indices of the samples nearest to every `period` s, from the first on."""
    count = 1 + int((time[-1] - time[0]) / period + 1e-9)
    wanted = time[0] + period * np.arange(count)
    later = np.clip(np.searchsorted(time, wanted), 1, max(1, len(time) - 1))
    if len(time) == 1:
        return np.zeros(1, dtype=np.int_)
    nearer = wanted - time[later - 1] < time[later] - wanted
    frames: NDArray[np.int_] = np.where(nearer, later - 1, later)
    return frames


def _angle(a: Array, b: Array) -> float:
    """Angle between two directions, rad."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _picture(
    scenario: SerpentineScenario,
    setup: SerpentineSetup,
    seen: SeenSurface,
    patches: ColoredPatches,
    joints: Array,
) -> NDArray[np.uint8]:
    """The body with its seen patches, and the arm, from the side that was seen."""
    builder = DiagramBuilder()
    plant, scene_graph, model = make_plant(builder, setup, scenario)
    add_renderer(scene_graph, headlight=HEADLIGHT)
    _add_patches(scene_graph, patches)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant.SetPositions(plant.GetMyContextFromRoot(context), model, joints)
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    X_WC = _best_view(query, seen)
    return render_view(query, X_WC, size=PICTURE_SIZE)


def _best_view(query: QueryObject, seen: SeenSurface) -> RigidTransform:
    """A camera round the body that sees the most of what was seen."""
    body = corner_points(query, models=[seen.surface.name.split("::")[0]])
    patches = seen.surface.patches.select(seen.seen)
    if len(patches) == 0:
        return fit_view(body, [0.6, 0.45, -0.6], size=PICTURE_SIZE)
    outward = patches.areas @ patches.normals
    camera = PinholeCamera(
        width=90, height=100, field_of_view=FIELD_OF_VIEW, near=0.1, far=100.0, incidence=1.5
    )
    best, most = None, -1.0
    for turn in np.radians([20.0, -20.0, 40.0, -40.0, 60.0, -60.0, 0.0]):
        for height in (0.5, 0.2, -0.2, -0.5):
            level = RotationMatrix.MakeZRotation(turn) @ (outward * [1.0, 1.0, 0.0])
            level /= max(1e-9, float(np.linalg.norm(level)))
            X_WC = fit_view(body, -level - [0.0, 0.0, height], size=PICTURE_SIZE, margin=0.08)
            depth = render_depth(
                query,
                X_WC,
                size=(camera.width, camera.height),
                field_of_view=camera.field_of_view,
            )
            found = seen_distances(
                camera,
                X_WC.translation(),
                X_WC.rotation().matrix(),
                patches.points,
                patches.normals,
                depth_image=depth,
            )
            area = float(patches.areas[np.isfinite(found)].sum())
            if area > most:
                best, most = X_WC, area
    assert best is not None
    return best


def _add_patches(scene_graph: SceneGraph, patches: ColoredPatches) -> None:
    """Adds the patches to what is rendered, a mesh a colour."""
    source = scene_graph.RegisterSource("seen_surface")
    colors, which = np.unique(patches.colors, axis=0, return_inverse=True)
    for number, color in enumerate(colors):
        corners = patches.corners[which.ravel() == number].reshape(-1, 3)
        lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in corners]
        across = np.cross(corners[1::3] - corners[::3], corners[2::3] - corners[::3])
        across /= np.linalg.norm(across, axis=1)[:, None]
        lines += [f"vn {x:.6f} {y:.6f} {z:.6f}" for x, y, z in across]
        for n, k in enumerate(range(1, len(corners), 3), start=1):
            lines.append(f"f {k}//{n} {k + 1}//{n} {k + 2}//{n}")
        name = f"seen_{number}"
        mesh = InMemoryMesh(mesh_file=MemoryFile("\n".join(lines) + "\n", ".obj", f"{name}.obj"))
        instance = GeometryInstance(RigidTransform(), Mesh(mesh), name)
        properties = PerceptionProperties()
        properties.AddProperty("phong", "diffuse", Rgba(*color, 1.0))
        instance.set_perception_properties(properties)
        scene_graph.RegisterAnchoredGeometry(source, instance)
