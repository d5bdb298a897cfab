"""What the fastest motion along a path is, and which limit holds it back where."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.serpentine.drives import drive_names
from pips_drake.serpentine.motion_limits import KINDS, FastestMotion, profile_shares
from pips_drake.serpentine.motion_profile import MotionProfile
from pips_drake.serpentine.runs.figures import symbol, tip_travel
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import (
    SerpentineSetup,
    make_constant_profile,
    make_fastest_motion,
)
from pips_drake.twin.figures import (
    COLORS,
    MUTED_COLOR,
    Limit,
    Line,
    Panel,
    add_second_axis,
    draw_panel,
    figure_style,
    new_figure,
    save_figure,
)

Array = NDArray[np.float64]

#: At most this many limits get a curve, and this many drives a colour.
_CURVES, _COLORED = 6, 5
#: Colours besides black.
_HUES = len(COLORS) - 1
#: Instants over which the drives' shares are drawn and their largest are taken.
_INSTANTS = 4001


def motion_report(
    scenario: SerpentineScenario, setup: SerpentineSetup, *, figure: Path | None = None
) -> tuple[dict[str, Any], list[str]]:
    """The motions that a path allows: numbers for `summary.json`, and why the one wanted cannot be.

    Args:
        figure: a PNG to write.

    Raises:
        InputError: the fastest motion is wanted on a path with corners.
    """
    wanted = scenario.motion.profile
    constant = make_constant_profile(scenario, setup)
    numbers: dict[str, Any] = {
        "motion_profile": wanted,
        "motion_duration_constant_s": constant.duration,
    }
    try:
        fastest = make_fastest_motion(scenario, setup)
    except (InputError, NotFollowableError) as error:
        if wanted == "constant":
            numbers["motion_duration_s"] = constant.duration
            return numbers | {"motion_fastest_missing": str(error)}, []
        if isinstance(error, InputError):
            raise
        return numbers, [f"no fastest motion: {error}"]
    if figure is not None:
        fastest_motion_figure(figure, fastest, constant, home=setup.path.home_arc_length)
    used: MotionProfile = fastest.profile if wanted == "fastest" else constant
    numbers |= {"motion_duration_s": used.duration} | fastest_numbers(fastest)
    if wanted == "fastest":
        numbers |= _drive_fractions(fastest)
    return numbers, []


def fastest_numbers(fastest: FastestMotion) -> dict[str, Any]:
    """The numbers of the fastest motion for `summary.json`; shares are of the drives' own limits.

    `motion_binding_segments` has a row for each part of the path: the limit that binds there, from
    and to which travel (m), and for how long (s) before smoothing.
    """
    profile = fastest.profile
    numbers: dict[str, Any] = {
        "motion_duration_fastest_s": profile.duration,
        "motion_fastest_tip_speed_max_m_per_s": float(
            profile.motion(np.linspace(0.0, profile.duration, _INSTANTS))[1].max()
        ),
        "motion_fastest_slowdown": profile.slowdown,
        "motion_limit_share": fastest.share,
        "motion_binding_limits_s": fastest.binding_time,
        "motion_binding_segments": [
            [part.name, part.start, part.end, part.duration] for part in fastest.segments
        ],
    }
    for kind, part in zip(KINDS, _drive_shares(fastest), strict=True):
        numbers[f"motion_fastest_{kind}_max_fraction"] = float(part.max())
    return numbers


def _drive_shares(fastest: FastestMotion) -> tuple[Array, Array, Array]:
    """What the smoothed motion uses of the drives' own limits: speed, acceleration and force.

    (T, J) each, at `_INSTANTS` from start to end.
    """
    profile, drives = fastest.profile, fastest.motion.arm.joints
    times = np.linspace(0.0, profile.duration, _INSTANTS)
    speeds, bands = profile_shares(fastest.limits, profile, times)
    used = np.abs(np.hstack([speeds[:, 1:], bands])) * fastest.share
    return used[:, :drives], used[:, drives : 2 * drives], used[:, 2 * drives :]


def _drive_fractions(fastest: FastestMotion) -> dict[str, Any]:
    """The drives' numbers of a check, of the motion instead of statics and constant speed."""
    speed, _, force = _drive_shares(fastest)
    return {
        "drive_speed_max_fraction": float(speed.max()),
        "drive_effort_max_fraction": float(force.max()),
        "actuator_force_max_fraction": float(
            force[:, fastest.motion.arm.first_actuated_joint :].max()
        ),
    }


def steady_speed_limits(fastest: FastestMotion) -> Array:
    """The speed at which each limit alone is reached without acceleration, (N - 1, V + B) m/s.

    Infinite where no speed reaches it.
    """
    limits = fastest.limits
    speeds = np.minimum(limits.speed[:-1], limits.speed[1:])
    room = 1.0 - np.sign(limits.curve) * limits.offset
    with np.errstate(divide="ignore"):
        bands = np.sqrt(np.maximum(room, 0.0) / np.abs(limits.curve))
    return np.hstack([speeds, bands])


def fastest_motion_figure(
    file: Path, fastest: FastestMotion, constant: MotionProfile, *, home: float
) -> None:
    """Speed along the path, coloured by the limit that binds, and the drives' shares over time.

    Thin curves are the speeds at which a limit alone would be reached without acceleration: those
    that bind, and the next ones that would.

    Args:
        constant: the report's motion, for comparison.
        home: the tip's arc length there, m.
    """
    limits, profile = fastest.limits, fastest.profile
    which, _ = fastest.binding
    binding = sorted(set(which.tolist()), key=lambda k: -fastest.binding_time[limits.names[k]])
    # Black is left to the motions; with more limits than colours, the second round is dotted.
    color = {k: COLORS[i % _HUES] for i, k in enumerate(binding)}
    dash = {k: "-" if i < _HUES else ":" for i, k in enumerate(binding)}
    middle = tip_travel(home + 0.5 * (limits.travel[1:] + limits.travel[:-1]), home)
    speed = np.sqrt(0.5 * (fastest.squared_speed[1:] + fastest.squared_speed[:-1])) * 1e3
    top = 2.2 * float(speed.max())
    lines = _limit_curves(fastest, middle.values, color, top)
    for k in binding:
        # A point on either side, so that neighbouring parts meet.
        here = which == k
        near = here | np.roll(here, 1) & (np.arange(len(here)) > 0)
        lines.append(
            Line(
                x=middle.values,
                y=np.where(near, speed, np.nan),
                label=f"at the limit of {_name(limits.names[k])}",
                color=color[k],
                style=dash[k],
                width=3.5,
            )
        )
    for motion, label, style in ((profile, "fastest, smoothed", "-"), (constant, "constant", "--")):
        times = np.linspace(0.0, motion.duration, _INSTANTS)
        travel, rate = np.array([motion(time) for time in times.tolist()]).T
        lines.append(
            Line(
                x=tip_travel(home + travel, home).values,
                y=rate * 1e3,
                label=f"{label}: {motion.duration:.1f} s",
                color="black",
                style=style,
                width=1.0,
            )
        )
    above = Panel(
        title="Speed of the tip along its path",
        y_label="tip speed (mm/s)",
        lines=lines,
        y_range=(0.0, top),
        long_legend=True,
    )
    title = (
        f"Fastest motion within {100.0 * fastest.share:g} % of the drives' limits: "
        f"{profile.duration:.1f} s, at constant speed {constant.duration:.1f} s"
    )
    with figure_style():
        drawing = new_figure(10.0, title=title)
        cells = drawing.subplots(4, 1, height_ratios=[2.0, 1.0, 1.0, 1.0])
        draw_panel(cells[0], above)
        cells[0].set_xlabel(middle.label)
        if middle.second is not None:
            add_second_axis(cells[0], "x", *middle.second)
        panels = _share_panels(fastest)
        for axes, panel in zip(cells[1:], panels, strict=True):
            draw_panel(axes, panel)
            axes.sharex(cells[1])
        cells[-1].set_xlabel("time (s)")
        drawing.align_ylabels()
    save_figure(drawing, file)


def _limit_curves(
    fastest: FastestMotion, x: Array, color: dict[int, str], top: float
) -> list[Line]:
    """Steady speeds at single limits: those that bind, then the lowest of the others."""
    curves = steady_speed_limits(fastest) * 1e3
    order = [k for k in np.argsort(curves.min(axis=0)).tolist() if curves[:, k].min() < top]
    binding = [k for k in order if k in color]
    others = [k for k in order if k not in color][: max(0, _CURVES - len(binding))]
    lines = []
    grey = iter((":", "-.", (0, (1, 3)), (0, (5, 1, 1, 1, 1, 1)), (0, (3, 3)), "--"))
    for k in binding + others:
        lines.append(
            Line(
                x=x,
                y=np.where(curves[:, k] < 1.5 * top, curves[:, k], np.nan),
                label="" if k in color else f"next: {_name(fastest.limits.names[k])}",
                color=color.get(k, MUTED_COLOR),
                style="-" if k in color else next(grey),  # type: ignore[arg-type]
                width=1.0,
            )
        )
    return lines


def _share_panels(fastest: FastestMotion) -> list[Panel]:
    """The drives' shares of their own limits over time, a panel a kind."""
    profile, arm = fastest.profile, fastest.motion.arm
    time = np.linspace(0.0, profile.duration, _INSTANTS)
    parts = _drive_shares(fastest)
    # The drives that come nearest to a limit of any kind have a colour, the same in all panels.
    nearest = np.argsort(-np.array([part.max(axis=0) for part in parts]).max(axis=0), kind="stable")
    color = {int(j): COLORS[i] for i, j in enumerate(nearest[:_COLORED])}
    names = drive_names(arm)
    panels = []
    for kind, part in zip(KINDS, parts, strict=True):
        lines = [
            Line(x=time, y=part[:, j], color="#C8C8C8", width=0.8)
            for j in range(arm.joints)
            if j not in color
        ]
        for j in sorted(color):
            label = symbol(names[j]) if kind == KINDS[0] else ""
            lines.append(Line(x=time, y=part[:, j], color=color[j], label=label))
        panels.append(
            Panel(
                title=f"Drives: {kind}, largest {part.max():.0%} of the limit "
                f"({symbol(names[int(part.max(axis=0).argmax())])})",
                y_label=f"{kind} / limit",
                lines=lines,
                limits=[Limit(value=fastest.share), Limit(value=1.0)],
                y_range=(0.0, 1.08),
            )
        )
    return panels


def _name(limit: str) -> str:
    drive, _, kind = limit.partition(" ")
    return f"{symbol(drive)} {kind}"
