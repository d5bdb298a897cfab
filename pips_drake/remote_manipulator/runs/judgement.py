"""What a run is judged by: the phases it went through, inhibits, clearance, contact, tracking."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pips_drake.remote_manipulator.configuration import JOINTS, RemoteManipulatorConfig
from pips_drake.remote_manipulator.drives import ARM_JOINTS
from pips_drake.remote_manipulator.geometry import docking_port, probe_tip
from pips_drake.remote_manipulator.phases import Phase
from pips_drake.remote_manipulator.runs.data import RunData
from pips_drake.remote_manipulator.runs.run import Run
from pips_drake.remote_manipulator.scenario import CheckConfig, RemoteManipulatorScenario
from pips_drake.remote_manipulator.station.station import CLEARANCE_RANGE
from pips_drake.units import DEGREE

Array = NDArray[np.float64]


def summarize(
    run: Run, config: RemoteManipulatorConfig, checks: CheckConfig, *, whole: bool
) -> dict[str, Any]:
    """The numbers of a run, for its summary.

    Args:
        whole: the scenario leaves the end to its operator.
    """
    data = run.data
    judged = judged_frames(data, config, checks)
    clear = np.where(judged, data.clearance, np.inf)
    nearest = int(np.argmin(clear))
    shares = data.torque_fractions(config)[1:]
    strongest = np.unravel_index(int(np.argmax(shares)), shares.shape) if len(shares) else (0, 0)
    tracking = data.tracking_error(config)
    margins = np.minimum(data.arm[:, 1:7] - config.arm.lower, config.arm.upper - data.arm[:, 1:7])
    tightest = int(np.argmin(margins.min(axis=0)))
    summary: dict[str, Any] = {
        "phases": data.phases,
        "phase_times_s": [0.0, *data.time[1:][np.diff(data.phase) != 0].round(6).tolist()],
        "inhibits": data.inhibits,
        "frames": len(data.time),
        "frames_inhibited": int(np.sum(data.flags[:, 2] | data.flags[:, 3])),
        "clearance_sampled_min_m": float(min(clear[nearest], CLEARANCE_RANGE)),
        "clearance_in_range": bool(clear[nearest] < CLEARANCE_RANGE),
        "clearance_min_pair": data.pairs[nearest],
        "clearance_min_time_s": float(data.time[nearest]),
        "penetration_max_m": float(data.penetration.max()),
        "penetration_max_time_s": float(data.time[int(np.argmax(data.penetration))]),
        "palm_error_max_m": float(tracking.max()),
        "torque_fraction_max": float(shares[strongest]) if len(shares) else 0.0,
        "torque_fraction_max_joint": ARM_JOINTS[int(strongest[1])],
        "joint_margin_min_rad": float(margins.min()),
        "joint_margin_min_joint": JOINTS[tightest],
        "weld_slip_max_m": run.slip_max,
        "payload_mass_kg": config.payload.mass_kg,
        "simulated_s": run.run_time.simulated_s,
        "wall_s": run.run_time.wall_s,
        "real_time_rate": run.run_time.real_time_rate,
        "operator_finished": run.finished or not whole,
        "operator_stopped": run.stopped,
    }
    before, after = data.phase[:-1], data.phase[1:]
    docked = np.flatnonzero((after == Phase.DOCKED_HELD) & (before == Phase.MANOEUVRING))
    if docked.size:
        row = int(docked[-1]) + 1  # of the frame that decided
        summary |= {
            "docked_at_s": float(data.time[row]),
            "docking_distance_m": float(data.display["docking_distance_m"][row]),
            "docking_angle_rad": float(data.display["docking_angle_rad"][row]),
        }
    return summary


def judged_frames(
    data: RunData, config: RemoteManipulatorConfig, checks: CheckConfig
) -> NDArray[np.bool_]:
    """The frames whose clearance is judged: (N,).

    Not those in which the payload is docked, or its probe is so near the port that it must touch.
    """
    tip, port = (
        poses[:, 4:] + Rotation.from_quat(poses[:, :4], scalar_first=True).apply(point)
        for poses, point in (
            (data.payload, probe_tip(config)),
            (data.cae, docking_port(config)),
        )
    )
    far = np.linalg.norm(tip - port, axis=1) > checks.docking_zone_m
    docked = np.isin(data.phase, [Phase.DOCKED, Phase.DOCKED_HELD])
    return np.asarray(far & ~docked)


def judge(scenario: RemoteManipulatorScenario, summary: dict[str, Any]) -> list[str]:
    """Sentences about what a run did not keep."""
    checks, failures = scenario.checks, []
    if summary["operator_stopped"]:
        failures.append(summary["operator_stopped"])
    phases = summary["phases"]
    if checks.phases and phases != checks.phases:
        failures.append(f"phases: {' -> '.join(phases)}; must be {' -> '.join(checks.phases)}")
    inhibits = summary["inhibits"]
    if not checks.inhibits_min <= inhibits <= checks.inhibits_max:
        allowed = f"{checks.inhibits_min} .. {checks.inhibits_max}"
        failures.append(f"motion was inhibited {inhibits} times; must be {allowed}")
    least = summary["clearance_sampled_min_m"]
    # Without a least clearance contact is allowed, as deep as the next check says.
    if checks.clearance_min_mm > 0.0 and least < checks.clearance_min_mm * 1e-3:
        pair = " to ".join(summary["clearance_min_pair"] or ())
        failures.append(
            f"clearance {least * 1e3:.1f} mm ({pair}) at {summary['clearance_min_time_s']:.2f} s; "
            f"must be >= {checks.clearance_min_mm:g} mm"
        )
    depth = summary["penetration_max_m"]
    if depth > checks.penetration_max_mm * 1e-3:
        failures.append(
            f"bodies were pressed {depth * 1e3:.1f} mm into each other at "
            f"{summary['penetration_max_time_s']:.2f} s; must be <= "
            f"{checks.penetration_max_mm:g} mm"
        )
    error = summary["palm_error_max_m"]
    if error > checks.tracking_error_max_mm * 1e-3:
        failures.append(
            f"the palm was {error * 1e3:.0f} mm from where it was sent; must be <= "
            f"{checks.tracking_error_max_mm:g} mm"
        )
    if summary["joint_margin_min_rad"] < -0.5 * DEGREE:
        failures.append(
            f"joint {summary['joint_margin_min_joint']} was "
            f"{-summary['joint_margin_min_rad'] / DEGREE:.2f} deg beyond its hard limit; must be "
            "within"
        )
    if not summary["operator_finished"] and not summary["operator_stopped"]:
        failures.append(f"the operator was not done after {summary['simulated_s']:.0f} s")
    return failures
