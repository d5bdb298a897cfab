"""Judges a simulated run: how far from the plan, how near to limits, what failed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import SerpentineArm
from pips_drake.serpentine.drives import (
    drive_efforts,
    drive_limits,
    drive_names,
    drives_from_joints,
    levers,
)
from pips_drake.serpentine.plan import joint_margins
from pips_drake.serpentine.planned_motion import PlannedMotion
from pips_drake.serpentine.scenario import CheckConfig, SerpentineScenario
from pips_drake.serpentine.station import SerpentineSetup
from pips_drake.units import DEGREE

Array = NDArray[np.float64]

Pair = tuple[str, str]


@dataclass(frozen=True, kw_only=True, eq=False)
class RunData:
    """What a run recorded, N samples; J joints, in joint order.

    Attributes:
        time: (N,) s.
        tip_arc_lengths: how far along its way the motion was commanded, (N,) m: of a path the
            tip's arc length.
        commanded_joints: where the joints were sent, (N, J).
        joints, joint_rates: what the plant did, (N, J).
        joint_efforts: of the plant's drives, (N, J), N and Nm; NaN before the first step.
        clearance: arm to scene, (N,) m, at most the monitor's range.
        self_clearance: arm to arm and rail, (N,) m.
        pairs: the nearest bodies, N of them; None where nothing was in range.
        solution: spine error (m) and iterations of the controller, (N, 2); None if the joints were
            given.
        witness: nearest points on arm and scene, (N, 2, 3) m in the world; NaN where nothing was in
            range. None if not recorded.
        built: the arm that did it; None for the one that the plan believes in.
    """

    time: Array
    tip_arc_lengths: Array
    commanded_joints: Array
    joints: Array
    joint_rates: Array
    joint_efforts: Array
    clearance: Array
    self_clearance: Array
    pairs: tuple[Pair | None, ...]
    solution: Array | None
    witness: Array | None = None
    built: SerpentineArm | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Assessment:
    """Numbers of a run and their verdict.

    Attributes:
        arm: as the plan has it, which says where every point should be; where it is, and what its
            drives do, are those of the arm that was built (`RunData.built`).
    """

    arm: SerpentineArm
    motion: PlannedMotion
    checks: CheckConfig
    data: RunData
    clearance_range: float

    @staticmethod
    def of(scenario: SerpentineScenario, setup: SerpentineSetup, data: RunData) -> Assessment:
        """Of a scenario's run."""
        return Assessment(
            arm=setup.arm,
            motion=setup.motion,
            checks=scenario.checks,
            data=data,
            clearance_range=scenario.clearance_range_m,
        )

    @property
    def built(self) -> SerpentineArm:
        """The arm as it stands."""
        return self.data.built or self.arm

    @cached_property
    def spine_errors(self) -> Array:
        """Distance of each spine point from where it was commanded at that time, (N, M + 1) m."""
        wanted = kinematics.spine_points(self.arm, self.data.commanded_joints)
        reached = kinematics.spine_points(self.built, self.data.joints)
        return np.linalg.norm(reached - wanted, axis=-1)

    @cached_property
    def drive_coordinates(self) -> Array:
        """Drive coordinates (N, J), m and rad."""
        return drives_from_joints(self.built, self.data.joints)

    @cached_property
    def drive_efforts(self) -> Array:
        """Drive efforts (N, J), N and Nm."""
        return drive_efforts(self.built, self.data.joints, self.data.joint_efforts)

    @cached_property
    def effort_fractions(self) -> Array:
        """Drive efforts over their limits, (N, J)."""
        return np.abs(self.drive_efforts) / drive_limits(self.arm)[3]

    @cached_property
    def speed_fractions(self) -> Array:
        """Drive speeds over their limits, (N, J)."""
        speeds = levers(self.built, self.data.joints) * self.data.joint_rates
        return np.abs(speeds) / drive_limits(self.arm)[2]

    @cached_property
    def stroke_margins(self) -> Array:
        """Distance of the actuators L3 .. to the nearer end of their stroke, (N, A) m."""
        lengths = self.drive_coordinates[:, self.arm.first_actuated_joint :]
        linkage = self.arm.linkage
        return np.minimum(lengths - linkage.length_lower, linkage.length_upper - lengths)

    @cached_property
    def deviation(self) -> Array | None:
        """Farthest point of the simulated centre line from the path, (N,) m; None without one."""
        data = self.data
        return self.motion.path_deviation(self.built, data.joints, data.tip_arc_lengths)

    @property
    def nearest(self) -> int:
        """Index of the sample with the least clearance to the scene."""
        return int(np.argmin(self.data.clearance))

    def summary(self) -> dict[str, Any]:
        """The numbers of `summary.json`."""
        data, first = self.data, self.arm.first_actuated_joint
        margins = joint_margins(self.arm, data.joints)
        hinge = np.where(self.arm.is_prismatic, np.inf, margins)
        rail = np.where(self.arm.is_prismatic, margins, np.inf)
        drive = np.unravel_index(np.nanargmax(self.effort_fractions), self.effort_fractions.shape)
        worst_joint = int(np.argmin(hinge.min(axis=0)))
        return {
            "clearance_sampled_min_m": data.clearance.min(),
            "clearance_min_pair": list(data.pairs[self.nearest] or ()),
            "clearance_min_time_s": data.time[self.nearest],
            "clearance_in_range": bool(data.clearance.min() < self.clearance_range),
            "self_clearance_sampled_min_m": data.self_clearance.min(),
            "tip_error_max_m": self.spine_errors[:, -1].max(),
            "spine_error_max_m": self.spine_errors.max(),
            "path_deviation_max_m": None if self.deviation is None else self.deviation.max(),
            "joint_margin_min_rad": hinge.min(),
            "joint_margin_min_joint": self.arm.joint_names[worst_joint],
            "rail_margin_min_m": rail.min(),
            "actuator_stroke_margin_min_m": self.stroke_margins.min(),
            "actuator_force_max_fraction": np.nanmax(self.effort_fractions[:, first:]),
            "drive_effort_max_fraction": np.nanmax(self.effort_fractions),
            "drive_effort_max_drive": drive_names(self.arm)[int(drive[1])],
            "drive_effort_max_time_s": data.time[drive[0]],
            "drive_speed_max_fraction": self.speed_fractions.max(),
        }

    def failures(self) -> list[str]:
        """What the run did not keep, a sentence each."""
        data, checks = self.data, self.checks
        found = []
        least = data.clearance[self.nearest]
        if least < checks.clearance_min_mm * 1e-3:
            robot, other = data.pairs[self.nearest] or ("the arm", "the scene")
            word = "penetrates" if least < 0.0 else "comes too near to"
            # The least distance can be long after the first fault: an arm that is held by what it
            # ran into presses hardest somewhere in between.
            first = data.time[int(np.argmax(data.clearance < checks.clearance_min_mm * 1e-3))]
            touching = data.time[int(np.argmax(data.clearance < 0.0))]
            contact = f" (contact at {touching:.2f} s)" if least < 0.0 else ""
            found.append(
                f"{robot} {word} {other}: {least * 1e3:.1f} mm at {data.time[self.nearest]:.2f} s; "
                f"must be >= {checks.clearance_min_mm:g} mm, first broken at {first:.2f} s{contact}"
            )
        i = int(np.argmin(data.self_clearance))
        if data.self_clearance[i] < checks.self_clearance_min_mm * 1e-3:
            found.append(
                f"the arm comes too near to itself or its rail: {data.self_clearance[i] * 1e3:.1f} "
                f"mm at {data.time[i]:.2f} s; must be >= {checks.self_clearance_min_mm:g} mm"
            )
        worst = self.spine_errors.max(axis=1)
        i = int(np.argmax(worst))
        if worst[i] > checks.tracking_error_max_mm * 1e-3:
            point = self.arm.spine_indices[int(np.argmax(self.spine_errors[i]))]
            found.append(
                f"spine point {point} is {worst[i] * 1e3:.1f} mm from the plan at "
                f"{data.time[i]:.2f} s; must be <= {checks.tracking_error_max_mm:g} mm"
            )
        found += self._fraction_failures(self.effort_fractions, checks.force_fraction_max, "effort")
        found += self._fraction_failures(self.speed_fractions, checks.speed_fraction_max, "speed")
        found += self._joint_failures()
        margin = self.stroke_margins
        row, k = np.unravel_index(int(np.argmin(margin)), margin.shape)
        if margin[row, k] < 0.0:
            found.append(
                f"actuator {self.arm.actuator_names[k]} is {-margin[row, k] * 1e3:.2f} mm beyond "
                f"its stroke at {data.time[row]:.2f} s"
            )
        return found

    def _fraction_failures(self, fractions: Array, limit: float, what: str) -> list[str]:
        i, j = np.unravel_index(int(np.nanargmax(fractions)), fractions.shape)
        if fractions[i, j] <= limit:
            return []
        drive = drive_names(self.arm)[int(j)]
        return [
            f"drive {drive} needs {100.0 * fractions[i, j]:.0f} % of its {what} limit at "
            f"{self.data.time[i]:.2f} s; must be <= {100.0 * limit:g} %"
        ]

    def _joint_failures(self) -> list[str]:
        """The joint that the plant took farthest beyond its limits."""
        margins, checks = joint_margins(self.arm, self.data.joints), self.checks
        slack = np.where(
            self.arm.is_prismatic,
            checks.rail_overrun_max_mm * 1e-3,
            checks.joint_overrun_max_deg * DEGREE,
        )
        over = margins + slack
        i, j = np.unravel_index(int(np.argmin(over)), over.shape)
        if over[i, j] >= 0.0:
            return []
        unit, word = (1e-3, "mm") if self.arm.is_prismatic[j] else (DEGREE, "deg")
        return [
            f"joint {self.arm.joint_names[j]} is {-margins[i, j] / unit:.2f} {word} beyond its "
            f"limit at {self.data.time[i]:.2f} s"
        ]
