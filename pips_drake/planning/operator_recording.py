"""What an operator did, over time, as a file: to be repeated, and to be tested.

A YAML file with the arm, the scene, the path that the snake is laid on, and events. An event states
what changes at its time; what it does not state stays as it was.

    arm: cmu_92
    scene: cargo_bay
    path_m: [[0.412877, 0.0, 4.4425], [0.412877, 0.0, 6.0], [0.4, 0.5, 7.5]]
    extended_m: 1.0
    events:
    - {time_s: 0.0, word: run}
    - {time_s: 20.0, goal_m: [0.35, 0.6, 7.6]}
    - {time_s: 30.0, pull_at_m: [0.4, 0.2, 6.5], pull_N: [0.0, 3.0, 0.0]}
    - {time_s: 35.0, pull_N: [0.0, 0.0, 0.0], nails_m: [[0.4, 0.2, 6.5]]}
    - {time_s: 60.0, word: hold}
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from pips_drake.config import load_plain, require
from pips_drake.errors import InputError, UnknownNameError
from pips_drake.planning.live_snake import Wish
from pips_drake.serpentine.motion_words import EXTEND, HOLD, RETRACT, RUN

Array = NDArray[np.float64]

#: Words of a file, and what they mean.
WORDS_BY_NAME = {"run": RUN, "hold": HOLD, "retract": RETRACT, "extend": EXTEND}
_KEYS = ("arm", "scene", "path_m", "extended_m", "duration_s", "events")
_EVENT_KEYS = (
    "time_s",
    "goal_m",
    "pull_at_m",
    "pull_N",
    "nails_m",
    "tension_N",
    "bending_stiffness_N_m2",
    "reach_m",
    "word",
)


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatorRecording:
    """An operator's session.

    Attributes:
        arm, scene: shipped names.
        path: that the snake is laid on, (P, 3) m in the scene's frame.
        extended: how far out along it the tip is at first, m.
        duration: s.
        times: of the changes, (E,) s, from 0, increasing.
        wishes: what is wanted from then on, (E,).
    """

    arm: str
    scene: str
    path: Array
    extended: float
    duration: float
    times: tuple[float, ...]
    wishes: tuple[Wish, ...]

    def at(self, time: float) -> Wish:
        """What is wanted at a time, s."""
        return self.wishes[max(bisect_right(self.times, time) - 1, 0)]


def read_recording(file: Path) -> OperatorRecording:
    """Reads an operator's session.

    Raises:
        InputError: the file cannot be used; says what and where.
    """
    data = load_plain(file)
    try:
        return _parsed(data)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None


def write_recording(recording: OperatorRecording) -> str:
    """The text of a file that `read_recording` reads back."""
    events: list[dict[str, Any]] = []
    before: dict[str, Any] = {}
    for time, wish in zip(recording.times, recording.wishes, strict=True):
        now = _stated(wish)
        changes = {key: value for key, value in now.items() if before.get(key) != value}
        events.append({"time_s": time, **changes})
        before = now
    head = {
        "arm": recording.arm,
        "scene": recording.scene,
        "path_m": np.asarray(recording.path).tolist(),
        "extended_m": recording.extended,
        "duration_s": recording.duration,
        "events": events,
    }
    text: str = yaml.safe_dump(head, sort_keys=False, default_flow_style=None, width=100)
    return text


def _stated(wish: Wish) -> dict[str, Any]:
    """A wish as an event states it."""
    stated: dict[str, Any] = {"nails_m": wish.nails.tolist()}
    if wish.goal is not None:
        stated["goal_m"] = wish.goal.tolist()
    if wish.pulls:
        place, force = wish.pulls[0]
        stated |= {"pull_at_m": place.tolist(), "pull_N": force.tolist()}
    else:
        stated["pull_N"] = [0.0, 0.0, 0.0]
    if wish.tension is not None:
        stated["tension_N"] = wish.tension
    if wish.bending_stiffness is not None:
        stated["bending_stiffness_N_m2"] = wish.bending_stiffness
    if math.isfinite(wish.reach):
        stated["reach_m"] = wish.reach
    stated["word"] = next(name for name, word in WORDS_BY_NAME.items() if word == wish.word)
    return stated


def _parsed(data: Mapping[str, Any]) -> OperatorRecording:
    for key in data:
        if key not in _KEYS:
            raise UnknownNameError("key", str(key), _KEYS)
    names = []
    for key in ("arm", "scene"):
        name = data.get(key, "")
        require(isinstance(name, str) and name != "", key, name, "a name")
        names.append(name)
    events = data.get("events", [])
    require(isinstance(events, list) and len(events) > 0, "events", events, "a list of events")
    times: list[float] = []
    wishes: list[Wish] = []
    wish, place = Wish(), None
    for k, event in enumerate(events):
        where = f"events[{k}]"
        require(isinstance(event, dict), where, event, "a mapping")
        for key in event:
            if key not in _EVENT_KEYS:
                raise UnknownNameError(f"key in {where}", str(key), _EVENT_KEYS)
        time = _number(f"{where}.time_s", event.get("time_s", math.nan))
        first = "0 in the first event" if k == 0 else f"> {times[-1]:g}" if times else ""
        require(time == 0.0 if k == 0 else time > times[-1], f"{where}.time_s", time, first)
        wish, place = _changed(wish, place, event, where)
        times.append(time)
        wishes.append(wish)
    duration = _number("duration_s", data.get("duration_s", times[-1] + 1.0))
    require(duration > times[-1], "duration_s", duration, f"> {times[-1]:g}, the last event's")
    return OperatorRecording(
        arm=names[0],
        scene=names[1],
        path=_rows("path_m", data.get("path_m", [])),
        extended=_number("extended_m", data.get("extended_m", 0.0)),
        duration=duration,
        times=tuple(times),
        wishes=tuple(wishes),
    )


def _changed(
    wish: Wish, place: Array | None, event: Mapping[str, Any], where: str
) -> tuple[Wish, Array | None]:
    """A wish after an event, and the place where the operator pulls."""
    changes: dict[str, Any] = {}
    if "goal_m" in event:
        changes["goal"] = _rows(f"{where}.goal_m", [event["goal_m"]])[0]
    if "pull_at_m" in event:
        place = _rows(f"{where}.pull_at_m", [event["pull_at_m"]])[0]
    if "pull_N" in event or ("pull_at_m" in event and wish.pulls):
        known = wish.pulls[0][1].tolist() if wish.pulls else None
        force = _rows(f"{where}.pull_N", [event.get("pull_N", known)])[0]
        if force.any() and place is None:
            raise InputError(f"{where}.pull_N = {force.tolist()}; must come with pull_at_m")
        changes["pulls"] = ((place, force),) if force.any() else ()
    if "nails_m" in event:
        changes["nails"] = _rows(f"{where}.nails_m", event["nails_m"])
    for key, name in (
        ("tension_N", "tension"),
        ("bending_stiffness_N_m2", "bending_stiffness"),
        ("reach_m", "reach"),
    ):
        if key in event:
            changes[name] = _number(f"{where}.{key}", event[key])
    if "word" in event:
        word = event["word"]
        if word not in WORDS_BY_NAME:
            raise UnknownNameError(f"{where}.word", str(word), tuple(WORDS_BY_NAME))
        changes["word"] = WORDS_BY_NAME[word]
    try:
        return replace(wish, **changes), place
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _number(name: str, value: object) -> float:
    good = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    require(good, name, value, "a finite number")
    return float(value)  # type: ignore[arg-type]


def _rows(name: str, value: object) -> Array:
    """Rows (K, 3) of finite numbers."""
    good = isinstance(value, Sequence) and all(
        isinstance(row, Sequence)
        and len(row) == 3
        and all(isinstance(x, int | float) and math.isfinite(x) for x in row)
        for row in value
    )
    require(good, name, value, "three finite numbers (a row)")
    return np.array(value, dtype=np.float64).reshape(-1, 3)
