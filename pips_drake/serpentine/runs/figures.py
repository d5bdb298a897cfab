"""Figures of a serpentine arm, after FTL-95's Figures D.2 to D.4 and beyond them.

Each function takes plain arrays in SI units and writes one PNG. Nothing here computes: what a
figure says is what its arguments say.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.twin.figures import (
    COLORS,
    Limit,
    Line,
    Mark,
    Panel,
    save_figure,
    time_series_figure,
    where_least,
)
from pips_drake.twin.run_figures import clearance_figure, tracking_figure
from pips_drake.units import DEGREE, INCH

__all__ = [
    "XAxis",
    "actuators_figure",
    "clearance_figure",
    "iterations_figure",
    "joint_values_figure",
    "symbol",
    "time_axis",
    "tip_travel",
    "tracking_figure",
]

Array = NDArray[np.float64]

# Spine errors are drawn down to this part of the tolerance.
_DECADES = 1e-4
# Follow-the-leader leaves the last joint at zero. It gets a panel only if it moves more than this,
# rad: a simulated one always quivers.
_STILL = 0.1 * DEGREE


@dataclass(frozen=True, kw_only=True)
class XAxis:
    """What the samples are listed by. Make one with `tip_travel` or `time_axis`.

    Attributes:
        values: (N,), in the label's unit.
        label: with its unit.
        second: label of a second axis and what the values are multiplied with there.
    """

    values: Array
    label: str
    second: tuple[str, float] | None = None


def tip_travel(tip_arc_lengths: ArrayLike, home_arc_length: float) -> XAxis:
    """Distance that the tip has travelled since home, from arc lengths (N,) m; in, and m above."""
    travel = np.asarray(tip_arc_lengths, dtype=np.float64) - home_arc_length
    return XAxis(values=travel / INCH, label="tip travel (in)", second=("tip travel (m)", INCH))


def time_axis(time: ArrayLike) -> XAxis:
    """Time (N,) s."""
    return XAxis(values=np.asarray(time, dtype=np.float64), label="time (s)")


def joint_values_figure(file: Path, arm: SerpentineArm, x: XAxis, joints: ArrayLike) -> None:
    """All joints with their limits, after FTL-95 Figure D.3: motion base first, then the modules.

    Args:
        x: from `tip_travel` or `time_axis`, N samples.
        joints: (N, joints) m and rad; NaN leaves a gap.
    """
    q = np.atleast_2d(np.asarray(joints, dtype=np.float64))
    base = len(arm.base.joint_names)
    sliding = [j for j in range(base) if arm.is_prismatic[j]]
    turning = [j for j in range(base) if not arm.is_prismatic[j]]
    panels = []
    if sliding:
        lines = [
            Line(x=x.values, y=q[:, j] / INCH, label=symbol(arm.joint_names[j])) for j in sliding
        ]
        limits = _limits(arm.joint_lower[sliding] / INCH, arm.joint_upper[sliding] / INCH)
        panels.append(
            Panel(
                title="base, sliding",
                y_label="position (in)",
                lines=lines,
                limits=limits,
                second_y=("position (m)", INCH),
            )
        )
    if turning:
        panels.append(_angle_panel("base, turning", arm, x, q, turning, from_home=True))
    for module in range(arm.modules):
        pair = [base + 2 * module, base + 2 * module + 1]
        panels.append(_angle_panel(f"module {module + 1}", arm, x, q, pair))
    last = range(base + 2 * arm.modules, arm.joints)
    rest = [j for j in last if np.any(np.abs(q[:, j]) > _STILL)]
    if rest:
        panels.append(_angle_panel("tip", arm, x, q, rest))
    figure = time_series_figure(
        panels,
        x.label,
        title=f"Joint values, arm '{arm.name}' (limits dashed)",
        columns=3,
        second_x=x.second,
    )
    save_figure(figure, file)


def iterations_figure(
    file: Path,
    x: XAxis,
    spine_error: ArrayLike,
    iterations: ArrayLike,
    *,
    tolerance: float,
) -> None:
    """Spine error and iterations at every tip point, after FTL-95 Figure D.4.

    Args:
        x: from `tip_travel`, N samples.
        spine_error: largest distance of a spine point from where it should be, (N,) m.
        iterations: (N,).
        tolerance: m.
    """
    error = np.asarray(spine_error, dtype=np.float64) / INCH
    error = np.where(np.isfinite(error), error, np.nan)
    count = np.asarray(iterations)
    few = "o" if error.size <= 100 else ""
    worst = where_least(-error[:, None])
    marks = []
    if worst is not None:
        marks = [_mark(x, error[:, None], worst, f"largest {_short(error[worst[0]])} in")]
    panels = [
        Panel(
            title="spine error after the last iteration",
            y_label="error (in)",
            lines=[Line(x=x.values, y=np.where(error > 0.0, error, np.nan), marker=few)],
            limits=[
                Limit(value=tolerance / INCH, label=f"tolerance {_short(tolerance / INCH)} in")
            ],
            marks=marks,
            log=True,
            # Errors of exact points (home) are rounding, many decades below.
            y_range=(
                _DECADES * tolerance / INCH,
                4.0 * max(tolerance / INCH, np.nanmax(error, initial=0.0)),
            ),
        ),
        Panel(
            title=f"iterations (total {int(count.sum())} at {count.size} tip points)",
            y_label="iterations",
            lines=[Line(x=x.values, y=count, marker=few, steps=True, color=COLORS[2])],
            y_range=(0.0, float(count.max(initial=1)) + 0.5),
            whole_y=True,
        ),
    ]
    figure = time_series_figure(
        panels, x.label, title="Follow-the-leader iteration", second_x=x.second
    )
    save_figure(figure, file)


def actuators_figure(
    file: Path,
    arm: SerpentineArm,
    x: XAxis,
    lengths: ArrayLike,
    forces: ArrayLike | None = None,
) -> None:
    """Actuators L3 .. : lengths with the strokes' ends, forces as fractions of their limits.

    A column for each size of actuator (equal force limit), strongest first. The title says the
    least stroke left and the largest fraction of a force, and rings mark where they are.

    Args:
        x: from `tip_travel` or `time_axis`, N samples.
        lengths: (N, A) m.
        forces: (N, A) N, positive when pushing; None leaves the lower row out.
    """
    linkage = arm.linkage
    length = np.atleast_2d(np.asarray(lengths, dtype=np.float64))
    left = np.minimum(length - linkage.length_lower, linkage.length_upper - length)
    tightest = where_least(left)
    said = []
    if tightest is not None:
        name = arm.actuator_names[tightest[1]]
        said.append(f"least stroke left {left[tightest] * 1e3:.1f} mm ({name})")
    fraction = np.full(length.shape, np.nan)
    if forces is not None:
        fraction = np.atleast_2d(np.asarray(forces, dtype=np.float64)) / linkage.force_limit
    hardest = where_least(-np.abs(fraction))
    if hardest is not None:
        name = arm.actuator_names[hardest[1]]
        said.append(f"largest force {abs(fraction[hardest]):.0%} of its limit ({name})")

    sizes = np.unique(linkage.force_limit)[::-1]
    groups = [np.flatnonzero(linkage.force_limit == size) for size in sizes]
    panels = []
    for group in groups:
        lower, upper = linkage.length_lower[group] * 1e3, linkage.length_upper[group] * 1e3
        marks = []
        if tightest is not None and tightest[1] in group:
            marks = [_mark(x, length * 1e3, tightest, arm.actuator_names[tightest[1]])]
        panels.append(
            Panel(
                title=f"{_span([arm.actuator_names[a] for a in group])}: length",
                y_label="length (mm)",
                lines=[
                    Line(x=x.values, y=length[:, a] * 1e3, label=arm.actuator_names[a])
                    for a in group
                ],
                limits=_limits(lower, upper),
                marks=marks,
                long_legend=True,
            )
        )
    for group, size in zip(groups, sizes, strict=True) if forces is not None else ():
        marks = []
        if hardest is not None and hardest[1] in group:
            marks = [_mark(x, fraction, hardest, arm.actuator_names[hardest[1]])]
        panels.append(
            Panel(
                title=f"force, limit {size / 1e3:g} kN",
                y_label="force / limit",
                lines=[Line(x=x.values, y=fraction[:, a]) for a in group],
                limits=_limits([-1.0], [1.0]),
                marks=marks,
            )
        )
    figure = time_series_figure(
        panels,
        x.label,
        title="Actuators: " + (", ".join(said) or "no posture"),
        columns=len(groups),
        panel_height=3.2,
        second_x=x.second,
    )
    save_figure(figure, file)


def _angle_panel(
    title: str,
    arm: SerpentineArm,
    x: XAxis,
    q: Array,
    joints: list[int],
    *,
    from_home: bool = False,
) -> Panel:
    """Angles in deg, each by default from zero, with the limits that they have in common or not."""
    lines = []
    for k, j in enumerate(joints):
        label = symbol(arm.joint_names[j])
        home = arm.joint_home[j] / DEGREE if from_home else 0.0
        if abs(home) > 1e-9:
            label += f" {'+' if home < 0.0 else '−'} {abs(home):g}°"
        lines.append(
            Line(x=x.values, y=q[:, j] / DEGREE - home, label=label, width=1.2 if k else 2.2)
        )
        # The first is wide, so that it shows under another of the same value.
    homes = arm.joint_home[joints] if from_home else 0.0
    return Panel(
        title=title,
        y_label="angle (deg)",
        lines=lines,
        limits=_limits(
            (arm.joint_lower[joints] - homes) / DEGREE, (arm.joint_upper[joints] - homes) / DEGREE
        ),
    )


def symbol(joint_name: str) -> str:
    """A joint's name as the report writes it: `theta4` is θ₄."""
    subscripts = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
    return joint_name.replace("theta", "θ").translate(subscripts)


def _short(value: float) -> str:
    """Three digits, without a needless zero in the exponent."""
    return f"{value:.3g}".replace("e-0", "e-")


def _span(names: list[str]) -> str:
    return f"{names[0]} to {names[-1]}" if len(names) > 2 else " and ".join(names)


def _limits(lower: ArrayLike, upper: ArrayLike) -> list[Limit]:
    """Lines for limits, each different one once."""
    values = np.concatenate([np.ravel(lower), np.ravel(upper)])
    return [Limit(value=float(value)) for value in np.unique(np.round(values, 6))]


def _mark(x: XAxis, y: Array, where: tuple[int, int], text: str) -> Mark:
    return Mark(x=float(x.values[where[0]]), y=float(y[where]), text=text)
