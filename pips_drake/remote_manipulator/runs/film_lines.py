"""What a film shows beside its pictures, and from where: the operator's numbers, and a director."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.remote_manipulator.camera_stations import station_index
from pips_drake.remote_manipulator.configuration import JOINTS
from pips_drake.remote_manipulator.phases import PHASES, TABLE, Phase

#: Where the director looks from in a phase; near the port and held, from NEAR_STATION.
DIRECTOR = {
    Phase.STOWED: "K",
    Phase.EXTRACTION: "E",
    Phase.MANOEUVRING: "M",
    Phase.DOCKED_HELD: "L",
    Phase.DOCKED: "M",
    Phase.FREE_FLYING: "M",
}
NEAR_STATION, NEAR_PORT = "J", 2.5
#: Whose limits a warning's bits mean.
LIMITED = (*JOINTS, "stand", "prong")


def directed_stations(
    time: ArrayLike,
    phase: ArrayLike,
    docking_distance: ArrayLike,
    *,
    shortest: float = 4.0,
) -> NDArray[np.int64]:
    """Stations (N,) of a director who knows the phases, where the operator chooses none.

    Args:
        time: (N,) s.
        phase: (N,), indices of `PHASES`.
        docking_distance: (N,) m, of the probe from the port.
        shortest: no station is left before it has been shown so long, s.
    """
    t = np.asarray(time, dtype=np.float64)
    near = np.asarray(docking_distance, dtype=np.float64) < NEAR_PORT
    wanted = [
        NEAR_STATION if close and number == Phase.MANOEUVRING else DIRECTOR[Phase(number)]
        for number, close in zip(np.asarray(phase, dtype=int).tolist(), near.tolist(), strict=True)
    ]
    chosen = np.empty(len(t), dtype=np.int64)
    now, since = wanted[0], t[0]
    for k, station in enumerate(wanted):
        if station != now and t[k] - since >= shortest:
            now, since = station, t[k]
        chosen[k] = station_index(now)
    return chosen


def display_lines(
    *,
    time: ArrayLike,
    phase: ArrayLike,
    flags: ArrayLike,
    display: Mapping[str, ArrayLike],
    clearance: ArrayLike,
    pairs: Sequence[tuple[str, str] | None],
) -> list[tuple[str, ...]]:
    """What the operator is shown, as lines of text of each of N samples, for `FilmScript`.

    Args:
        time: (N,) s.
        phase: (N,), indices of `PHASES`.
        flags: (N, 4), collision of arm and finger, motion inhibit of arm and finger.
        display: (N,) each, by the names of `display.DISPLAY`.
        clearance: (N,) m, the least one; not finite: nothing is near.
        pairs: of each sample, between what; None: nothing is near.
    """
    shown = {name: np.asarray(values, dtype=np.float64) for name, values in display.items()}
    raised = np.asarray(flags, dtype=bool)
    gaps = np.asarray(clearance, dtype=np.float64)
    lines: list[tuple[str, ...]] = []
    for k, t in enumerate(np.asarray(time, dtype=np.float64)):
        number = Phase(int(np.asarray(phase)[k]))
        facts = TABLE[number]
        first = f"t = {t:.1f} s   mode {facts.mode}, {PHASES[number].replace('_', ' ')}"
        kinds = ["docking", "stowing"] if facts.grasped else ["acquisition"]
        measures = [
            f"{word} {shown[f'{name}_distance_m'][k]:.2f} m, "
            f"{math.degrees(shown[f'{name}_angle_rad'][k]):.1f}°"
            for word, name in zip(
                kinds, ("docking", "berthing") if facts.grasped else ("acquisition",), strict=True
            )
        ]
        second = "   to ".join([_clearance(gaps[k], pairs[k]), *measures])
        warnings = _warnings({name: values[k] for name, values in shown.items()}, raised[k])
        lines.append((first, second, f"! {warnings}" if warnings else ""))
    return lines


def _clearance(gap: float, pair: tuple[str, str] | None) -> str:
    if pair is None or not math.isfinite(gap):
        return "nothing near"
    first, second = (name.split("::")[-1].replace("_", " ") for name in pair)
    return f"clearance {gap:.3f} m: {first} - {second}"


def _warnings(shown: Mapping[str, float], raised: NDArray[np.bool_]) -> str:
    """Collisions, inhibited motion, and limits, in words; empty where there is nothing."""
    parts = []
    for word, which in (("COLLISION", raised[:2]), ("MOTION INHIBITED", raised[2:])):
        names = [name for name, on in zip(("arm", "finger"), which, strict=True) if on]
        if names:
            parts.append(f"{word}: {', '.join(names)}")
    for word, entry in (("LIMIT", "warning_hard"), ("near limit", "warning_soft")):
        bits = int(shown[entry])
        names = [name for k, name in enumerate(LIMITED) if bits >> k & 1]
        if names:
            parts.append(f"{word}: {', '.join(names)}")
    if shown["warning_reach"]:
        parts.append("END OF REACH")
    return "   ".join(parts)
