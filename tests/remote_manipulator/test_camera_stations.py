"""Stations are where their bodies carry them; control words pan, tilt, zoom and switch them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.remote_manipulator.camera_stations import CameraState, CameraStations, station_index
from pips_drake.remote_manipulator.configuration import STATIONS, load_configuration
from pips_drake.remote_manipulator.control_word import ControlWord, encode

CONFIG = load_configuration()
CAMERAS = CameraStations(CONFIG)
HOME = np.array([2.0, *CONFIG.arm.home, 0.6])
STOWED = np.array([1.0, 0.0, 0.0, 0.0, *CONFIG.payload.location_m])
CAE = np.array([1.0, 0.0, 0.0, 0.0, *CONFIG.central_assembly_element.location_m])
#: Of a frame: 10 and 5 deg/s for 1/20 s.
TURN, ZOOM = math.radians(0.5), math.radians(0.25)


def word(station="A", **fields):
    return ControlWord(station=station, **fields)


def run(state, *words):
    for each in words:
        state = CAMERAS.advance(state, each)
    return state


def degrees(state, station):
    return np.degrees(state.cameras[STATIONS.index(station)])


def views(arm=HOME, payload=STOWED, cae=CAE, cameras=None):
    angles = CAMERAS.initial_state().cameras if cameras is None else cameras
    return CAMERAS.poses(angles, arm_vector=arm, payload_pose=payload, cae_pose=cae)


def moved(before, after):
    """Letters of the stations that stand elsewhere, or look elsewhere."""
    change = np.abs(after.p_RC - before.p_RC).max(axis=1)
    change += np.abs(after.R_RC - before.R_RC).max(axis=(1, 2))
    return "".join(np.array(list(STATIONS))[change > 1e-6])


@pytest.mark.parametrize("seed", range(5))
def test_each_station_is_where_rotations_by_hand_put_it(seed):
    rng = np.random.default_rng(seed)
    cameras = rng.uniform(-1.5, 1.5, (13, 3))
    height, (h0, p0, p1, *rest) = 3.3, rng.uniform(-2.0, 2.0, 6)
    bodies = {}
    # Turned about the fixed z last: heading, then pitch about the turned y.
    arm_0 = Rotation.from_euler("ZY", [h0, p0])
    arm_1 = Rotation.from_euler("ZY", [h0, p0 + p1])
    shoulder = np.array([0.0, 0.0, -height])
    bodies["R"] = np.eye(3), np.zeros(3)
    bodies["0"] = arm_0.as_matrix(), shoulder
    bodies["1"] = arm_1.as_matrix(), shoulder + arm_0.apply([CONFIG.arm.arm_0_m, 0.0, 0.0])
    poses = {}
    for name in "PC":
        turn, place = Rotation.random(random_state=rng), rng.uniform(-9.0, 9.0, 3)
        x, y, z, w = turn.as_quat()
        bodies[name] = turn.as_matrix(), place
        poses[name] = np.array([w, x, y, z, *place])
    found = views(
        np.array([height, h0, p0, p1, *rest, 0.5]), poses["P"], poses["C"], cameras=cameras
    )
    for k, station in enumerate(CONFIG.cameras.stations):
        R, p = bodies[station.frame]
        look = R @ Rotation.from_euler("ZY", cameras[k, :2]).as_matrix()
        # Right, down and ahead of the camera are y, z and x of the station. Rounding of products.
        np.testing.assert_allclose(found.R_RC[k], look[:, [1, 2, 0]], atol=1e-12)
        np.testing.assert_allclose(found.p_RC[k], R @ station.position_m + p, atol=1e-11)


def test_a_positive_pan_turns_to_the_right_and_a_positive_tilt_looks_up():
    cameras = np.zeros((13, 3))
    a = STATIONS.index("A")
    ahead = views(cameras=cameras).R_RC[a]
    # Aft; right of that is port, y; down is z.
    np.testing.assert_allclose(ahead, np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]).T, atol=1e-15)
    for column, direction in ((0, [1.0, 1.0, 0.0]), (1, [1.0, 0.0, -1.0])):
        turned = cameras.copy()
        turned[a, column] = math.pi / 4
        look = views(cameras=turned).R_RC[a][:, 2]
        np.testing.assert_allclose(look, np.array(direction) / math.sqrt(2.0), atol=1e-15)


def test_every_station_rides_on_its_own_body():
    before = views()
    for column, riders in ((0, "FG"), (1, "FG"), (2, "FG"), (3, "G"), (4, ""), (5, ""), (6, "")):
        arm = HOME.copy()
        arm[column] += 0.1
        assert moved(before, views(arm=arm)) == riders, column
    shift = np.array([0.0, 0.0, 0.0, 0.0, 0.3, -0.2, 0.1])
    assert moved(before, views(payload=STOWED + shift)) == "JK"
    assert moved(before, views(cae=CAE + shift)) == "HL"
    turned = np.array([math.cos(0.1), 0.0, math.sin(0.1), 0.0, *STOWED[4:]])
    assert moved(before, views(payload=turned)) == "JK"


def test_many_arm_vectors_at_once_are_each_of_them():
    arms = HOME + np.linspace(0.0, 0.2, 3)[:, None]
    together = views(arm=arms)
    assert together.R_RC.shape == (3, 13, 3, 3)
    for k, arm in enumerate(arms):
        alone = views(arm=arm)
        np.testing.assert_allclose(together.p_RC[k], alone.p_RC, atol=1e-13)
        np.testing.assert_allclose(together.R_RC[k], alone.R_RC, atol=1e-13)


@pytest.mark.parametrize(
    ("fields", "column", "step"),
    [
        ({"pan": 1}, 0, TURN),
        ({"pan": -1}, 0, -TURN),
        ({"tilt": 1}, 1, TURN),
        ({"tilt": -1}, 1, -TURN),
        ({"zoom": 1}, 2, -ZOOM),
    ],
)
def test_a_frame_moves_the_chosen_camera_by_rate_times_frame(fields, column, step):
    first = CAMERAS.initial_state("C")
    after = run(first, *[word("C", **fields)] * 20)
    expected = first.cameras.copy()
    expected[STATIONS.index("C"), column] += 20 * step
    np.testing.assert_allclose(after.cameras, expected, atol=1e-12)


def test_zoom_stops_exactly_at_25_and_at_60_degrees():
    state = CAMERAS.initial_state("B")
    # 35 deg at a quarter of a degree a frame.
    inwards = [word("B", zoom=1)]
    assert degrees(run(state, *inwards * 139), "B")[2] > 25.0 + 0.2
    narrow = run(state, *inwards * 141)
    assert narrow.camera[2] == math.radians(25.0)
    wide = run(narrow, *[word("B", zoom=-1)] * 141)
    assert wide.camera[2] == math.radians(60.0)


def test_tilt_stops_straight_up_and_straight_down_and_pan_goes_round():
    state = CAMERAS.initial_state("I")
    assert run(state, *[word("I", tilt=1)] * 400).camera[1] == 0.5 * math.pi
    assert run(state, *[word("I", tilt=-1)] * 400).camera[1] == -0.5 * math.pi
    round_once = run(state, *[word("I", pan=1)] * 720)
    # 720 sums of rounded numbers.
    np.testing.assert_allclose(round_once.camera, state.camera, atol=1e-11)


def test_pan_and_zoom_go_together():
    state = run(CAMERAS.initial_state(), word("D", pan=1, zoom=1))
    change = state.cameras - CAMERAS.initial_state().cameras
    np.testing.assert_allclose(change[STATIONS.index("D")], [TURN, 0.0, -ZOOM], atol=1e-15)


def test_switching_keeps_what_each_camera_was_turned_to():
    words = [word("A", pan=1)] * 10 + [word("G", tilt=-1)] * 4 + [word("M", zoom=1)] * 6
    state = run(CAMERAS.initial_state(), *words, word("A"))
    assert STATIONS[state.station] == "A"
    change = np.degrees(state.cameras - CAMERAS.initial_state().cameras)
    expected = np.zeros((13, 3))
    expected[[0, 6, 12], [0, 1, 2]] = 5.0, -2.0, -1.5
    np.testing.assert_allclose(change, expected, atol=1e-10)
    # And goes on from there.
    assert degrees(run(state, word("G", tilt=-1)), "G")[1] == pytest.approx(-40.0 - 2.5)


def test_initialize_puts_every_camera_back_and_moves_none():
    words = [word("A", pan=1)] * 10 + [word("G", tilt=-1, zoom=1)] * 4
    state = run(CAMERAS.initial_state(), *words, word("K", initialize=True, pan=1))
    np.testing.assert_array_equal(state.cameras, CAMERAS.initial_state().cameras)
    assert STATIONS[state.station] == "K"


def test_a_state_survives_its_vector():
    state = run(CAMERAS.initial_state("F"), word("J", pan=1))
    back = CameraState.of_vector(state.vector())
    assert back.station == state.station
    np.testing.assert_array_equal(back.cameras, state.cameras)


def test_recorded_words_give_the_cameras_of_a_run():
    words = [word("A", pan=1), word("A", pan=1), word("H"), word("H", zoom=1), word("C")]
    stations, cameras = CAMERAS.follow([encode(each) for each in words])
    assert "".join(STATIONS[k] for k in stations) == "AAHHC"
    state = CAMERAS.initial_state()
    for each, found in zip(words, cameras, strict=True):
        state = CAMERAS.advance(state, each)
        np.testing.assert_array_equal(found, state.cameras)
    assert CAMERAS.follow([])[1].shape == (0, 13, 3)
    with pytest.raises(InputError, match="bits 8-11 say station 5"):
        CAMERAS.follow([encode(words[0]), 0x005001])


@pytest.mark.parametrize("name", ["N", "", "AB", "a"])
def test_an_unknown_station_is_refused(name):
    with pytest.raises(UnknownNameError, match="camera station"):
        station_index(name)
