"""The film shows the task from the chosen station, others as insets, and the operator's numbers."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.remote_manipulator.camera_stations import CameraStations
from pips_drake.remote_manipulator.configuration import STATIONS, load_configuration
from pips_drake.remote_manipulator.display import DISPLAY
from pips_drake.remote_manipulator.kinematics import nearest_angles
from pips_drake.remote_manipulator.phases import Phase
from pips_drake.remote_manipulator.runs import film
from pips_drake.remote_manipulator.runs.film import (
    FilmScript,
    FilmSettings,
    film_frame,
    film_samples,
    film_task,
    inset_stations,
)
from pips_drake.remote_manipulator.runs.film_lines import directed_stations, display_lines
from pips_drake.remote_manipulator.runs.picture_text import WHITE, write_text
from pips_drake.remote_manipulator.runs.task_scene import TaskScene, station_sheet
from pips_drake.remote_manipulator.station.plant import X_WR, docked_pose, stowed_pose
from pips_drake.scene.rendering import can_render
from pips_drake.twin.rendering import render_available

CONFIG = load_configuration()
X_RC = RigidTransform(np.array(CONFIG.central_assembly_element.location_m))
SMALL = FilmSettings(size=(192, 108), fps=5, speed=2.0, insets=("G", "H"))
#: From the palm's top to the payload's middle, with the palm on the bar.
BELOW = (
    CONFIG.effector.palm.length_m + CONFIG.receptacle.height_m + 0.5 * CONFIG.payload.across_flats_m
)


@pytest.fixture(scope="module")
def scene():
    if not can_render():
        pytest.skip(str(render_available()))
    return TaskScene.make(CONFIG)


def positions(scene, payload, *, height):
    """The plant's, with the effector on the bar of a payload."""
    machine = scene.machine
    context = machine.plant.CreateDefaultContext()
    down = np.column_stack([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    palm = payload.translation() - [0.0, 0.0, BELOW]
    angles = nearest_angles(CONFIG.arm, palm, down, height, CONFIG.arm.home)
    assert angles is not None
    machine.plant.SetPositions(context, machine.arm, [height, *angles, 0.24])
    machine.place_payload(context, payload)
    return machine.plant.GetPositions(context).copy()


def stowed(scene):
    return positions(scene, stowed_pose(CONFIG), height=2.0)


def docked(scene):
    return positions(scene, docked_pose(CONFIG, X_RC), height=4.0)


def make_script(scene, count=11, station="C"):
    """From stowed to docked in ten seconds, straight through everything."""
    u = np.linspace(0.0, 1.0, count)[:, None]
    cameras = CameraStations(CONFIG).initial_state().cameras
    return FilmScript(
        time=10.0 * u[:, 0],
        positions=(1.0 - u) * stowed(scene) + u * docked(scene),
        station=np.full(count, STATIONS.index(station)),
        cameras=np.tile(cameras, (count, 1, 1)),
        lines=[(f"row {k}", "! warned") for k in range(count)],
    )


def test_the_film_reads_back(scene, tmp_path):
    av = pytest.importorskip("av")
    script = make_script(scene)
    file = tmp_path / "film.mp4"
    assert film_task(file, script, CONFIG, settings=SMALL, scene=scene) is None
    with av.open(str(file)) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height) == SMALL.size
        assert float(stream.average_rate) == 5.0
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    # Ten seconds, two in one, five frames a second; and the first.
    assert len(frames) == 26
    scene.pose(script.positions[-1])
    last = film_frame(scene, script, 10, SMALL)
    # Compressed: edges smear.
    assert np.abs(frames[-1].astype(float) - last).mean() < 6.0
    assert np.abs(frames[0].astype(float) - last).mean() > 12.0
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]


@pytest.mark.render
def test_insets_show_other_stations_and_the_rest_is_the_main_view(scene):
    script = make_script(scene)
    scene.pose(script.positions[3])
    plain, inset = scene.pictures(script.cameras[3], [(2, SMALL.size), (6, (50, 28))])
    frame = film_frame(scene, script, 3, SMALL)
    corner = frame[2:30, 2:52]
    # The inset's picture, below its label and within its frame.
    np.testing.assert_array_equal(corner[15:-1, 1:-1], inset[15:-1, 1:-1])
    assert np.abs(corner.astype(float) - plain[2:30, 2:52]).mean() > 20.0
    np.testing.assert_array_equal(frame[35:70], plain[35:70])
    # The strip is dark, with white and amber letters in it.
    strip = frame[-28:].astype(float)
    assert strip.mean() < 0.6 * plain[-28:].mean()
    assert (strip.min(axis=2) > 180.0).any()
    assert ((strip[:, :, 0] > 180.0) & (strip[:, :, 2] < 100.0)).any()


@pytest.mark.render
def test_every_station_shows_something_stowed_and_docked(scene):
    """None looks at nothing but one wall."""
    cameras = scene.stations.initial_state().cameras
    for place in (stowed(scene), docked(scene)):
        scene.pose(place)
        views = scene.pictures(cameras, [(k, (96, 54)) for k in range(13)])
        for name, view in zip(STATIONS, views, strict=True):
            _, counts = np.unique(view.reshape(-1, 3) // 16, axis=0, return_counts=True)
            # J sees the bay's wall, and the probe before it, until it is lifted out.
            assert counts.max() < 0.9 * counts.sum(), name
            assert np.sum(counts > 0.005 * counts.sum()) >= 2, name


def test_no_station_is_inside_a_solid(scene):
    """Stowed, on the way and docked; Drake's distances from points are the judge."""
    on_the_way = RigidTransform([7.5, -2.7, -4.3])
    for place in (
        stowed(scene),
        positions(scene, on_the_way, height=4.0),
        docked(scene),
    ):
        scene.pose(place)
        poses = scene.station_poses(scene.stations.initial_state().cameras)
        for name, point in zip(STATIONS, poses.p_RC, strict=True):
            near = scene.query().ComputeSignedDistanceToPoint(X_WR.multiply(point), 1.0)
            # Half of a camera's box.
            assert min((found.distance for found in near), default=1.0) > 0.04, name


@pytest.mark.render
def test_the_sheet_has_all_thirteen_views_each_of_its_own(scene):
    sheet = station_sheet(scene, docked(scene), size=(80, 45), columns=4)
    assert sheet.shape == (4 * 45, 4 * 80, 3)
    cells = [sheet[k // 4 * 45 :, k % 4 * 80 :][20:44, 1:79].astype(float) for k in range(16)]
    for k, cell in enumerate(cells[:13]):
        others = cells[:k] + cells[k + 1 : 13]
        assert min(np.abs(cell - other).mean() for other in others) > 2.0, STATIONS[k]
    assert all((cell == 255.0).all() for cell in cells[13:])


def test_without_pyav_or_renderer_there_is_a_note_and_no_film(monkeypatch, tmp_path):
    script = FilmScript(
        time=np.zeros(1),
        positions=np.zeros((1, 3)),
        station=np.zeros(1, dtype=int),
        cameras=np.zeros((1, 13, 3)),
        lines=[("",)],
    )
    monkeypatch.setattr(film, "render_available", lambda: None)
    monkeypatch.setattr(film, "video_available", lambda: "PyAV is missing")
    assert film_task(tmp_path / "film.mp4", script, CONFIG) == "PyAV is missing"
    monkeypatch.setattr(film, "render_available", lambda: "no EGL")
    assert film_task(tmp_path / "film.mp4", script, CONFIG) == "no EGL"
    assert not list(tmp_path.iterdir())


def test_positions_of_another_plant_are_refused(scene, monkeypatch):
    monkeypatch.setattr(film, "video_available", lambda: None)
    script = make_script(scene)
    short = FilmScript(**{**vars(script), "positions": script.positions[:, :-1]})
    count = scene.machine.plant.num_positions()
    with pytest.raises(InputError, match=f"positions of a sample = {count - 1}; must be {count}"):
        film_task(Path("film.mp4"), short, CONFIG, scene=scene)


def test_samples_are_those_nearest_to_the_frames():
    settings = FilmSettings(fps=10, speed=1.0)
    np.testing.assert_array_equal(film_samples([0.0, 0.09, 0.16, 0.5], settings),
                                  [0, 1, 2, 2, 3, 3])  # fmt: skip
    np.testing.assert_array_equal(film_samples([7.0], settings), [0])
    # 20 s at eight times the speed, 15 frames a second.
    assert len(film_samples(np.linspace(0.0, 20.0, 401), FilmSettings())) == 38


def test_a_station_is_never_its_own_inset():
    assert inset_stations(STATIONS.index("A"), "GH") == [6, 7]
    assert inset_stations(STATIONS.index("G"), "GH") == [2, 7]
    assert inset_stations(STATIONS.index("C"), "CGH") == [6, 7, 0]
    for main in range(13):
        for wanted in ("GGG", "CGH", "JKL", ""):
            found = inset_stations(main, wanted)
            assert len({main, *found}) == 1 + len(wanted)


def test_bad_films_are_refused():
    with pytest.raises(UnknownNameError, match="camera station"):
        FilmSettings(insets=("Z",))
    with pytest.raises(InputError, match="film: insets"):
        FilmSettings(insets=("A", "B", "C", "D"))
    with pytest.raises(InputError, match="film: samples of station = 2; must be 1"):
        FilmScript(
            time=np.zeros(1),
            positions=np.zeros((1, 3)),
            station=np.zeros(2, dtype=int),
            cameras=np.zeros((1, 13, 3)),
            lines=[("",)],
        )


def test_the_director_follows_the_phases_and_stays_a_while():
    time = np.arange(0.0, 40.0, 1.0)
    phase = np.full(40, int(Phase.MANOEUVRING))
    phase[:10], phase[35:] = Phase.STOWED, Phase.DOCKED_HELD
    # In and out of the port's neighbourhood every second: no station may flicker.
    distance = np.where(time % 2 == 0, 1.0, 9.0)
    names = "".join(STATIONS[k] for k in directed_stations(time, phase, distance))
    assert names.startswith("K" * 10)
    assert names.endswith("L")
    assert set(names) == set("KJML")
    shots = [len(run) for run in _runs(names)]
    assert min(shots[:-1]) >= 4


def _runs(text):
    runs = [text[0]]
    for letter in text[1:]:
        if letter == runs[-1][-1]:
            runs[-1] += letter
        else:
            runs.append(letter)
    return runs


def test_lines_say_what_the_operator_is_shown():
    display = {name: np.zeros(2) for name in DISPLAY}
    display["docking_distance_m"][:] = 1.25, 0.1
    display["docking_angle_rad"][:] = math.radians(3.0)
    display["acquisition_distance_m"][:] = 0.75
    display["warning_soft"][1], display["warning_hard"][1] = 4.0, 65.0
    display["warning_reach"][1] = 1.0
    free, held = display_lines(
        time=[1.5, 62.0],
        phase=[Phase.STOWED, Phase.MANOEUVRING],
        flags=[[0, 0, 0, 0], [1, 1, 1, 0]],
        display=display,
        clearance=[math.inf, 0.1234],
        pairs=[None, ("rms_payload::payload", "rms_cargo_bay::cargo_bay")],
    )
    assert free == (
        "t = 1.5 s   mode 1, stowed",
        "nothing near   to acquisition 0.75 m, 0.0°",
        "",
    )
    assert held == (
        "t = 62.0 s   mode 3, manoeuvring",
        "clearance 0.123 m: payload - cargo bay   to docking 0.10 m, 3.0°"
        "   to stowing 0.00 m, 0.0°",
        "! COLLISION: arm, finger   MOTION INHIBITED: arm   LIMIT: H0, stand   near limit: P1"
        "   END OF REACH",
    )


def test_text_stays_within_its_picture():
    picture = np.zeros((20, 40, 3), dtype=np.uint8)
    write_text(picture, "a line that is much too long for it", (4, 15), size=12)
    assert picture[:15].max() == 0 and picture[:, :3].max() == 0 and picture.max() > 200
    before = picture.copy()
    write_text(picture, "", (0, 0), size=12)
    write_text(picture, "beyond", (60, 30), size=12, color=WHITE)
    np.testing.assert_array_equal(picture, before)
