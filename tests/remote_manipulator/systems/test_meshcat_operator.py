"""Keys, sliders and a gamepad say what they should, through the channels, to the program."""

from __future__ import annotations

import re

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.systems.analysis import Simulator

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.analog_inputs import angle_scaling, decode_frame
from pips_drake.remote_manipulator.kinematics import forward_kinematics
from pips_drake.remote_manipulator.meshcat_controls import (
    ANGLE_KEYS,
    ANGLE_STEP,
    BUTTONS,
    MeshcatControls,
)
from pips_drake.remote_manipulator.phases import Phase
from pips_drake.remote_manipulator.runs.operators import make_operator
from pips_drake.remote_manipulator.runs.run import load_setup
from pips_drake.remote_manipulator.scenario import OperatorConfig, RemoteManipulatorScenario
from pips_drake.remote_manipulator.straight_way import FREE_SPEED, HELD_SPEED
from pips_drake.remote_manipulator.systems.meshcat_operator import MeshcatOperator

from ..fake_meshcat import FakeMeshcat, Pad
from ..program_world import CONFIG

HOME = np.array(CONFIG.arm.home)
ARM = np.array([3.0, *HOME, 0.6])
FRAME = 0.05


class Desk:
    """Controls in a page, read frame after frame."""

    def __init__(self, station: int = 0) -> None:
        self.page = FakeMeshcat()
        self.controls = MeshcatControls(self.page, CONFIG, angles=HOME, station=station)
        self.angles = HOME

    def frame(self, *keys, arm=ARM, grasped=False):
        for key in keys:
            self.page.press(key)
        inputs = self.controls.read(self.angles, arm, grasped=grasped)
        self.angles = inputs.angles
        return inputs


def test_nothing_is_wanted_until_something_is_pressed():
    inputs = Desk(station=4).frame()
    assert np.array_equal(inputs.angles, HOME)
    assert inputs.station == "E"
    switches = (inputs.telescope, inputs.pan, inputs.tilt, inputs.zoom, inputs.prong)
    assert switches == (0, 0, 0, 0, 0)
    assert inputs.shuttle == (0, 0, 0)
    assert not (inputs.initialize or inputs.open_latch)


@pytest.mark.parametrize("row", range(6))
def test_two_keys_move_each_angle_and_no_other(row):
    desk = Desk()
    keys = list(ANGLE_KEYS.values())[row]
    moved = desk.frame(keys.more, keys.more).angles - HOME
    # The slider begins rounded to a step: at most half of one is lost or won.
    assert 1.5 * ANGLE_STEP <= np.degrees(moved[row]) <= 2.5 * ANGLE_STEP
    assert np.count_nonzero(moved) == 1
    back = desk.frame(keys.less).angles
    assert np.degrees(HOME[row] + moved[row] - back[row]) == pytest.approx(ANGLE_STEP)


@pytest.mark.parametrize(
    ("key", "field", "value"),
    [
        ("PageUp", "telescope", 1),
        ("PageDown", "telescope", -1),
        ("KeyM", "prong", 1),
        ("KeyN", "prong", -1),
        ("ArrowRight", "pan", 1),
        ("ArrowLeft", "pan", -1),
        ("ArrowUp", "tilt", 1),
        ("ArrowDown", "tilt", -1),
        ("Equal", "zoom", 1),
        ("Minus", "zoom", -1),
        ("Digit1", "shuttle", (-1, 0, 0)),
        ("Digit4", "shuttle", (0, 1, 0)),
        ("Digit6", "shuttle", (0, 0, 1)),
        ("Digit0", "open_latch", True),
        ("KeyC", "station", "B"),
        ("KeyX", "station", "M"),
    ],
)
def test_keys_switch_and_switches_stay(key, field, value):
    desk = Desk()
    assert getattr(desk.frame(key), field) == value
    assert getattr(desk.frame(), field) == value


def test_the_opposite_key_takes_a_switch_back_and_space_takes_all_back():
    desk = Desk()
    desk.frame("PageUp")
    assert desk.frame("PageDown").telescope == 0
    desk.frame("PageUp", "KeyM", "Digit0", "KeyD")
    reached = ARM + 0.01
    inputs = desk.frame("Space", arm=reached)
    assert (inputs.telescope, inputs.prong, inputs.open_latch) == (0, 0, False)
    assert np.array_equal(inputs.angles, reached[1:7])
    assert np.array_equal(desk.frame().angles, reached[1:7])


def test_pan_comes_before_tilt():
    inputs = Desk().frame("ArrowUp", "ArrowLeft")
    assert (inputs.pan, inputs.tilt) == (-1, 0)


def test_initialize_lasts_a_frame_and_puts_the_master_arm_where_it_began():
    desk = Desk(station=2)
    desk.frame("KeyD", "KeyW", "KeyC", "PageUp")
    inputs = desk.frame("Delete")
    assert inputs.initialize
    assert (inputs.station, inputs.telescope) == ("C", 0)
    assert np.array_equal(inputs.angles, HOME)
    assert not desk.frame().initialize


@pytest.mark.parametrize(("grasped", "speed"), [(False, FREE_SPEED), (True, HELD_SPEED)])
@pytest.mark.parametrize(
    ("axes", "way"),
    [
        ([0.0, -1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]),
        ([1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0]),
        ([0.1, 0.1, 0.1, -1.0], [0.0, 0.0, -1.0]),
    ],
    ids=["forward", "starboard", "up"],
)
def test_sticks_move_the_palm_straight_and_keep_its_attitude(axes, way, grasped, speed):
    desk = Desk()
    desk.page.pad = Pad(index=0, button_values=[0.0] * 16, axes=axes)
    before = forward_kinematics(CONFIG.arm, HOME, ARM[0])
    for _ in range(20):
        desk.frame(grasped=grasped)
    after = forward_kinematics(CONFIG.arm, desk.angles, ARM[0])
    # The inverse kinematics' rounding.
    assert after.palm - before.palm == pytest.approx(speed * 20 * FRAME * np.array(way), abs=1e-9)
    assert pytest.approx(before.R_R2, abs=1e-9) == after.R_R2


def test_gamepad_buttons_switch_while_they_are_held():
    desk = Desk()
    for button, field, value in ((5, "prong", 1), (3, "telescope", 1), (14, "pan", -1)):
        desk.page.pad = Pad(index=0, button_values=[float(k == button) for k in range(16)])
        assert getattr(desk.frame(), field) == value
        desk.page.pad = Pad(index=0, button_values=[0.0] * 16)
        assert getattr(desk.frame(), field) == 0


def test_the_gamepads_camera_button_counts_once_a_press():
    desk = Desk()
    desk.page.pad = Pad(index=0, button_values=[1.0])
    assert [desk.frame().station for _ in range(3)] == ["B", "B", "B"]
    desk.page.pad = Pad(index=0, button_values=[0.0])
    desk.frame()
    desk.page.pad = Pad(index=0, button_values=[1.0])
    assert desk.frame().station == "C"


def test_a_stick_that_leads_out_of_reach_leaves_the_palm_where_it_is():
    desk = Desk()
    desk.page.pad = Pad(index=0, axes=[0.0, 1.0, 0.0, 0.0])
    for _ in range(1500):
        inputs = desk.frame()
    assert np.all(np.isfinite(inputs.angles))
    # It has gone aft as far as it can: 11 m more would be beyond the straight arm.
    assert np.array_equal(inputs.angles, desk.frame().angles)
    palm = forward_kinematics(CONFIG.arm, inputs.angles, ARM[0]).palm
    assert np.linalg.norm(palm - [0.0, 0.0, -ARM[0]]) < 6.378 + 7.06 + 1.4224


def test_every_key_is_in_the_docstring():
    text = MeshcatControls.__doc__ or ""
    named = {
        "PageDown": "Page Down",
        "PageUp": "Page Up",
        **dict.fromkeys(("ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown"), "Arrows"),
    }
    for key in Desk().page.keys:
        word = named.get(key, re.sub("Key|Digit", "", key))
        assert re.search(rf"\b{word}\b", text), key


def test_the_system_gives_the_controls_as_volts():
    page = FakeMeshcat()
    controls = MeshcatControls(page, CONFIG, angles=HOME)
    system = MeshcatOperator(controls, angles=HOME)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("phase").FixValue(context, [float(Phase.STOWED)])
    system.GetInputPort("arm_measured").FixValue(context, ARM)
    page.press("KeyM")
    simulator.AdvanceTo(0.06)
    volts = system.GetOutputPort("channels").Eval(context)
    inputs = decode_frame(volts, angle_scaling(CONFIG.arm))
    assert inputs.prong == 1
    assert inputs.angles == pytest.approx(HOME, abs=1e-12)
    assert not system.HasAnyDirectFeedthrough()


def scenario() -> RemoteManipulatorScenario:
    made = RemoteManipulatorScenario(operator=OperatorConfig(kind="meshcat"), duration_s=10.0)
    made.validate()
    return made


def test_without_a_meshcat_there_is_no_such_operator():
    made = scenario()
    with pytest.raises(InputError, match=r"operator\.kind = meshcat; must be run with --meshcat"):
        make_operator(made, load_setup(made))


def test_a_real_meshcat_takes_the_controls_and_works_in_real_time():
    made = scenario()
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    operator = make_operator(made, load_setup(made), meshcat=meshcat)
    assert operator.real_time
    assert all(meshcat.GetButtonClicks(name) == 0 for name in BUTTONS)
    system, context = operator.system, operator.system.CreateDefaultContext()
    system.GetInputPort("phase").FixValue(context, [float(Phase.STOWED)])
    system.GetInputPort("arm_measured").FixValue(context, ARM)
    meshcat.SetSliderValue("prong (open, close)", 1.0)
    values = system.EvalUniquePeriodicDiscreteUpdate(context)
    volts = values.value()
    assert decode_frame(volts, angle_scaling(CONFIG.arm)).prong == 1
