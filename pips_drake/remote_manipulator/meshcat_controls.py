"""An operator's desk in the browser: Meshcat's sliders, keys and a gamepad, read frame by frame."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.remote_manipulator.analog_inputs import angle_scaling
from pips_drake.remote_manipulator.configuration import JOINTS, STATIONS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.kinematics import forward_kinematics, nearest_angles
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.program_state import ANGLES, FRAME_PERIOD, HEIGHT
from pips_drake.remote_manipulator.straight_way import FREE_SPEED, HELD_SPEED

if TYPE_CHECKING:
    from pydrake.geometry import Meshcat

Array = NDArray[np.float64]


class Keys(NamedTuple):
    """Keys that move a slider by a step: less, more."""

    less: str
    more: str


#: Sliders of the master arm's angles, deg.
ANGLE_KEYS = {
    "H0": Keys("KeyA", "KeyD"),
    "P0": Keys("KeyS", "KeyW"),
    "P1": Keys("KeyF", "KeyR"),
    "H2": Keys("KeyJ", "KeyL"),
    "P2": Keys("KeyK", "KeyI"),
    "R2": Keys("KeyU", "KeyO"),
}
#: What a key turns a joint by, deg.
ANGLE_STEP = 0.25
#: Sliders with three places, -1, 0 and 1: the operator's input, label and keys.
SWITCHES = {
    "telescope": ("stand (down, up)", Keys("PageDown", "PageUp")),
    "prong": ("prong (open, close)", Keys("KeyN", "KeyM")),
    "pan": ("pan (left, right)", Keys("ArrowLeft", "ArrowRight")),
    "tilt": ("tilt (down, up)", Keys("ArrowDown", "ArrowUp")),
    "zoom": ("zoom (out, in)", Keys("Minus", "Equal")),
    "shuttle_x": ("orbiter x (forward, aft)", Keys("Digit1", "Digit2")),
    "shuttle_y": ("orbiter y (starboard, port)", Keys("Digit3", "Digit4")),
    "shuttle_z": ("orbiter z (up, down)", Keys("Digit5", "Digit6")),
}
#: A slider with two places, and its keys.
LATCH = ("port's latch (shut, open)", Keys("Digit9", "Digit0"))
#: Buttons and their keys.
BUTTONS = {
    "stop": "Space",
    "next camera": "KeyC",
    "previous camera": "KeyX",
    "initialize": "Delete",
}
#: A gamepad's buttons in the browser's standard order: which input they switch, and to what.
PAD_SWITCHES = {
    2: ("telescope", -1),
    3: ("telescope", 1),
    4: ("prong", -1),
    5: ("prong", 1),
    6: ("zoom", -1),
    7: ("zoom", 1),
    12: ("tilt", 1),
    13: ("tilt", -1),
    14: ("pan", -1),
    15: ("pan", 1),
}
#: The gamepad's button for the next camera.
PAD_CAMERA = 0
#: A stick within this part of its way is at rest.
DEAD_ZONE = 0.15


class MeshcatControls:
    """Sliders, buttons and a gamepad in a Meshcat's page.

    Keys, each of which moves a slider by a step or presses a button:

    - A D, S W, F R: H0, P0, P1 less and more; J L, K I, U O: H2, P2, R2. Sliders hold the master
      arm's angles; the arm follows as fast as it can.
    - Page Down, Page Up: the stand down and up. N, M: the prong opens and closes.
    - Arrows: the camera pans and tilts. Minus, Equal: it zooms out and in. X, C: the camera before,
      the next one.
    - 1 2, 3 4, 5 6: the orbiter forward and aft, to starboard and port, up and down.
    - 9, 0: the docking port's latch shut and open.
    - Space: all switches off, and the master arm where the arm is. Delete: initialize.

    Switches stay where they are put: the opposite key takes them back. Pan comes before tilt, as
    they share a channel.

    Gamepad: the left stick moves the palm over the deck (forward, aft, to the sides), the right one
    up and down, and to its sides it rolls the wrist; the shoulder buttons open and close the prong,
    the triggers zoom, the cross pans and tilts, X and Y move the stand down and up, A chooses the
    next camera. (Buttons by the names and places of the browser's standard gamepad.)

    Args:
        meshcat: where they are added.
        config: the machine.
        angles: of the master arm at first, (6,) rad.
        station: camera station at first, a number.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        config: RemoteManipulatorConfig,
        *,
        angles: ArrayLike,
        station: int = 0,
    ) -> None:
        self.config = config
        self._meshcat = meshcat
        self._first = np.array(angles, dtype=np.float64)
        self._station = self._first_station = station
        self._full_scale = angle_scaling(config.arm).largest_angles
        arm = config.arm
        # What a slider says is rounded to its step: only one that has been moved is believed.
        self._shown = [
            meshcat.AddSlider(
                _label(name),
                math.degrees(low),
                math.degrees(high),
                ANGLE_STEP,
                math.degrees(angle),
                *ANGLE_KEYS[name],
            )
            for name, low, high, angle in zip(
                JOINTS, arm.lower, arm.upper, self._first, strict=True
            )
        ]
        for label, keys in SWITCHES.values():
            meshcat.AddSlider(label, -1.0, 1.0, 1.0, 0.0, *keys)
        meshcat.AddSlider(LATCH[0], 0.0, 1.0, 1.0, 0.0, *LATCH[1])
        for name, key in BUTTONS.items():
            meshcat.AddButton(name, key)
        self._clicks = {name: meshcat.GetButtonClicks(name) for name in BUTTONS}
        self._pad_pressed = False

    def read(self, angles: ArrayLike, arm: ArrayLike, *, grasped: bool) -> OperatorInputs:
        """What the operator wants in this frame.

        Args:
            angles: of the master arm in the last frame, (6,) rad.
            arm: as measured: height m, six angles rad, gap m, (8,).
            grasped: the effector holds the payload, and the gamepad moves the palm slowly.
        """
        arm = np.asarray(arm, dtype=np.float64)
        clicks = {name: self._new_clicks(name) for name in BUTTONS}
        if clicks["stop"] or clicks["initialize"]:
            self._switches_off()
            wanted = self._first.copy() if clicks["initialize"] else arm[ANGLES].copy()
            self._show(wanted)
        else:
            wanted = self._slid(np.array(angles, dtype=np.float64))
        values = {field: self._switch(label) for field, (label, _) in SWITCHES.items()}
        turns = clicks["next camera"] - clicks["previous camera"]
        pad = self._meshcat.GetGamepad()
        if pad.index is not None:
            pressed = [float(value) > 0.5 for value in pad.button_values]
            for button, (field, value) in PAD_SWITCHES.items():
                if button < len(pressed) and pressed[button]:
                    values[field] = value
            now = bool(pressed) and pressed[PAD_CAMERA]
            turns += int(now and not self._pad_pressed)
            self._pad_pressed = now
            wanted = self._moved(wanted, float(arm[HEIGHT]), pad.axes, grasped=grasped)
        self._station = (self._station + turns) % len(STATIONS)
        if clicks["initialize"]:
            self._station = self._first_station
        return OperatorInputs(
            angles=np.clip(wanted, -self._full_scale, self._full_scale),
            initialize=clicks["initialize"] > 0,
            telescope=values["telescope"],
            pan=values["pan"],
            tilt=0 if values["pan"] else values["tilt"],
            zoom=values["zoom"],
            station=STATIONS[self._station],
            prong=values["prong"],
            shuttle=(values["shuttle_x"], values["shuttle_y"], values["shuttle_z"]),
            open_latch=self._switch(LATCH[0]) == 1,
        )

    def _new_clicks(self, name: str) -> int:
        clicks = int(self._meshcat.GetButtonClicks(name))
        new, self._clicks[name] = clicks - self._clicks[name], clicks
        return new

    def _switch(self, label: str) -> int:
        return round(self._meshcat.GetSliderValue(label))

    def _switches_off(self) -> None:
        for label, _ in (*SWITCHES.values(), LATCH):
            self._meshcat.SetSliderValue(label, 0.0)

    def _slid(self, angles: Array) -> Array:
        """Angles of the sliders that have been moved, and of the others as they were, (6,) rad."""
        for row, name in enumerate(JOINTS):
            value = float(self._meshcat.GetSliderValue(_label(name)))
            if value != self._shown[row]:
                self._shown[row], angles[row] = value, math.radians(value)
        return angles

    def _show(self, angles: Array) -> None:
        """Puts the sliders at angles, (6,) rad."""
        self._shown = [
            self._meshcat.SetSliderValue(_label(name), math.degrees(angle))
            for name, angle in zip(JOINTS, angles, strict=True)
        ]

    def _moved(self, angles: Array, height: float, axes: ArrayLike, *, grasped: bool) -> Array:
        """Angles (6,) rad when the sticks have moved the palm; where it cannot go, it stays."""
        sticks = np.zeros(4)
        given = np.asarray(axes, dtype=np.float64)[:4]
        sticks[: len(given)] = np.where(np.abs(given) > DEAD_ZONE, given, 0.0)
        if not sticks.any():
            return angles
        arm = self.config.arm
        speed = HELD_SPEED if grasped else FREE_SPEED
        pose = forward_kinematics(arm, angles, height)
        # A stick's axes are to the right and towards oneself; one looks forward, -x of {R}.
        right, back, roll, down = sticks
        palm = pose.palm + speed * FRAME_PERIOD * np.array([back, -right, down])
        moved = nearest_angles(arm, palm, pose.R_R2, height, angles)
        if moved is None:
            return angles
        moved = moved.copy()
        share = speed / FREE_SPEED
        moved[5] = np.clip(
            moved[5] + share * roll * arm.rates[5] * FRAME_PERIOD, arm.lower[5], arm.upper[5]
        )
        self._show(moved)
        return moved


def _label(joint: str) -> str:
    return f"{joint} (deg)"
