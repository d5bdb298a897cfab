"""Task `cable_break`: a cable breaks; is the platform held, in its swing and at rest after it?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from scipy.spatial.transform import Rotation

from pips_drake.cable_robot.configuration import CableRobotConfig
from pips_drake.cable_robot.kinematics import Poses, cable_vectors, make_poses
from pips_drake.cable_robot.platform_motion import MotionLimits, PlatformMotion
from pips_drake.cable_robot.rest_posture import RestPosture, rest_posture
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.runs.platform_replay import write_platform_replay
from pips_drake.cable_robot.runs.robot_figure import robot_figure
from pips_drake.cable_robot.runs.station_flight import bay_boxes, poses_of, station_settings
from pips_drake.cable_robot.runs.task import TaskResult
from pips_drake.cable_robot.scenario import CableRobotScenario
from pips_drake.cable_robot.statics import distribute_tensions
from pips_drake.cable_robot.station import MakeCableRobotStation, Station, least_distances
from pips_drake.errors import InputError
from pips_drake.twin.diagram_file import write_diagram
from pips_drake.twin.figures import Limit, Line, Mark, Panel, save_figure, time_series_figure
from pips_drake.twin.recording import Series, write_csv
from pips_drake.twin.replay import Bookmark, LineInSpace
from pips_drake.twin.sheet import SheetPicture, SheetRow
from pips_drake.twin.simulation import RunTime, advance

Array = NDArray[np.float64]

#: s between logged values.
_PERIOD = 0.02
#: At rest, m/s and rad/s: slower than that at the end of the run.
_STILL = 0.01


@dataclass(frozen=True, kw_only=True, eq=False)
class BreakRun:
    """What became of the platform.

    Attributes:
        time: (N,) s.
        poses: N.
        twist: velocity and angular velocity, (N, 6).
        tensions, unstretched: (N, M) N and m.
        clearance: least distance of the platform, (N,) m; negative where it is pressed in.
        rest: the posture below where it hung, computed from the lengths after the winches locked.
        rest_clearance: of that posture, m.
        run_time: of the simulation.
        station: which was simulated.
    """

    time: Array
    poses: Poses
    twist: Array
    tensions: Array
    unstretched: Array
    clearance: Array
    rest: RestPosture
    rest_clearance: float
    run_time: RunTime
    station: Station

    @property
    def turned(self) -> Array:
        """By how much the platform is turned from where it hung, (N,) rad."""
        away = self.poses.rotation[0].T @ self.poses.rotation
        return np.asarray(Rotation.from_matrix(away).magnitude())


def prepare(
    scenario: CableRobotScenario, config: CableRobotConfig
) -> Callable[[Path, str], TaskResult]:
    """Checks cable and pose; returns what breaks it.

    Raises:
        InputError: no such cable, a pose outside the robot's region or one that no tensions hold.
    """
    asked, robot = scenario.cable_break, config.robot()
    if config.planar:
        raise InputError(f"{config.name}: a planar robot; cables break in space here")
    config.require_box()
    if asked.cable > robot.cables:
        raise InputError(
            f"cable_break.cable = {asked.cable}; must be 1 .. {robot.cables}, the cables of "
            f"{config.name}"
        )
    pose = make_poses([asked.pose.position_m], np.radians(asked.pose.angles_deg))
    config.require_inside(pose)
    chosen = distribute_tensions(robot, pose)
    if not chosen.feasible[0]:
        raise InputError(
            f"cable_break.pose: no tensions within {robot.tension_min:g} .. "
            f"{robot.tension_max:g} N hold {config.name} there; they miss by "
            f"{-chosen.slack[0]:.3g} N"
        )

    least = float(least_distances(_station(scenario, config, pose), pose)[0])
    if least <= 0.0:
        raise InputError(
            f"cable_break.pose: the platform would stand {-1e3 * least:.0f} mm inside a panel, "
            "door or sill; must be clear of them"
        )

    def work(folder: Path, name: str) -> TaskResult:
        run = run_break(scenario, config, pose)
        return _write(folder, name, scenario, robot, run)

    return work


def run_break(scenario: CableRobotScenario, config: CableRobotConfig, pose: Poses) -> BreakRun:
    """Simulates it, and finds where the platform would come to rest."""
    asked, robot = scenario.cable_break, config.robot()
    cable = asked.cable - 1
    station = _station(scenario, config, pose)
    simulator = Simulator(station.diagram)
    run_time = advance(simulator, asked.duration_s)
    context = simulator.get_context()
    logs = {name: sink.FindLog(context).data().T for name, sink in station.systems.logs.items()}
    sink = station.systems.logs["plant.platform_state"]
    broken = np.zeros(robot.cables)
    broken[cable] = 1.0
    states, unstretched = logs["plant.platform_state"], logs["winches.unstretched"]
    rest = rest_posture(robot, pose, unstretched[-1], broken=broken)
    return BreakRun(
        time=sink.FindLog(context).sample_times(),
        poses=poses_of(states),
        twist=np.hstack([states[:, 10:13], states[:, 7:10]]),
        tensions=logs["cable_forces.tensions"],
        unstretched=unstretched,
        clearance=logs["clearance_monitor.clearance"][:, 0],
        rest=rest,
        rest_clearance=float(least_distances(station, rest.poses)[0]),
        run_time=run_time,
        station=station,
    )


def _station(scenario: CableRobotScenario, config: CableRobotConfig, pose: Poses) -> Station:
    asked = scenario.cable_break
    settings = replace(
        station_settings(config, scenario.station),
        breaks=[(asked.cable - 1, asked.time_s)],
        reaction=asked.reaction_s,
        log_period=_PERIOD,
        clearance_period=_PERIOD,
    )
    motion = PlatformMotion(pose, None, MotionLimits())
    return MakeCableRobotStation(config.robot(), motion, settings, obstacles=bay_boxes())


def _write(
    folder: Path, name: str, scenario: CableRobotScenario, robot: CableRobot, run: BreakRun
) -> TaskResult:
    numbers = _numbers(scenario, robot, run)
    failures = _judge(scenario, robot, run)
    figures = folder / "figures"
    save_figure(_time_figure(scenario, run), figures / "swing.png")
    before, after = Poses(run.poses.position[:1], run.poses.rotation[:1]), run.rest.poses
    for file, pose, tensions, title in (
        ("before.png", before, run.tensions[0], f"{name}: before"),
        ("rest.png", after, run.rest.tensions[0],
         f"{name}: at rest without cable {scenario.cable_break.cable}"),
    ):  # fmt: skip
        save_figure(robot_figure(robot, pose, 0, tensions=tensions, title=title), figures / file)
    _write_series(folder, robot, run)
    _write_replay(folder / "replay.html", name, scenario, robot, run)
    write_diagram(folder, run.station.diagram)
    words = "the others hold it, clear of all" if not failures else "it cannot be held clear"
    return TaskResult(
        numbers=numbers,
        failures=failures,
        lead=f"cable {scenario.cable_break.cable} breaks: {words}",
        rows=_rows(scenario, robot, run),
        pictures=[
            SheetPicture(file=figures / "swing.png", caption="the swing after the break"),
            SheetPicture(file=figures / "before.png", caption="before"),
            SheetPicture(file=figures / "rest.png", caption="at rest without the cable"),
        ],
    )


def _numbers(scenario: CableRobotScenario, robot: CableRobot, run: BreakRun) -> dict[str, Any]:
    rest = run.rest
    least = int(np.argmin(run.clearance))
    return {
        "cable": scenario.cable_break.cable,
        "clearance_sampled_min_m": float(run.clearance[least]),
        "clearance_min_time_s": float(run.time[least]),
        "rest_clearance_m": run.rest_clearance,
        "rest_found": bool(rest.found[0]),
        "rest_stable": bool(rest.stable[0]),
        "rest_least_stiffness_N_m": rest.least_stiffness[0],
        "rest_position_m": rest.poses.position[0],
        "rest_tensions_N": rest.tensions[0],
        "rest_slack_cables": (np.flatnonzero(rest.slack[0]) + 1).tolist(),
        "displacement_max_m": _displacement(run).max(),
        "turned_max_rad": run.turned.max(),
        "tension_max_N": run.tensions.max(),
        "ended_at_rest": bool(np.abs(run.twist[-1]).max() < _STILL),
        "end_to_rest_m": float(np.linalg.norm(run.poses.position[-1] - rest.poses.position[0])),
        "simulated_s": run.run_time.simulated_s,
        "wall_s": run.run_time.wall_s,
        "real_time_rate": run.run_time.real_time_rate,
        "tension_limit_N": robot.tension_max,
    }


def _displacement(run: BreakRun) -> Array:
    return np.asarray(np.linalg.norm(run.poses.position - run.poses.position[0], axis=1))


def _judge(scenario: CableRobotScenario, robot: CableRobot, run: BreakRun) -> list[str]:
    least, rest = scenario.checks.clearance_min_mm, run.rest
    failures = []
    if not rest.found[0]:
        failures.append("no rest posture was found without the cable")
    elif not rest.stable[0]:
        failures.append("the rest posture without the cable is not held in every direction")
    if 1e3 * run.rest_clearance < least:
        failures.append(
            f"at rest without the cable the platform would be {1e3 * run.rest_clearance:.0f} mm "
            f"from the nearest panel, door or sill; must be >= {least:g} mm"
        )
    swing = float(run.clearance.min())
    if 1e3 * swing < least:
        when = run.time[int(np.argmin(run.clearance))] - scenario.cable_break.time_s
        said = "touches" if swing <= 0.0 else f"comes within {1e3 * swing:.0f} mm of"
        failures.append(
            f"swinging, the platform {said} a panel, door or sill {when:.2f} s after the break; "
            f"must stay >= {least:g} mm away"
        )
    most = max(float(run.tensions.max()), float(rest.tensions.max()))
    if most > robot.tension_max:
        failures.append(f"a cable pulls {most:.0f} N; must be <= {robot.tension_max:g} N")
    return failures


def _rows(scenario: CableRobotScenario, robot: CableRobot, run: BreakRun) -> list[SheetRow]:
    least = scenario.checks.clearance_min_mm
    swing, rest = 1e3 * float(run.clearance.min()), 1e3 * run.rest_clearance
    most = float(run.tensions.max())
    slack = int(np.count_nonzero(run.rest.slack[0]))
    return [
        SheetRow(label="clearance while it swings", value=f"{swing:.0f} mm",
                 allowed=f">= {least:g} mm", good=swing >= least),
        SheetRow(label="clearance at rest", value=f"{rest:.0f} mm", allowed=f">= {least:g} mm",
                 good=rest >= least),
        SheetRow(label="cables hold it in every direction",
                 value="yes" if run.rest.stable[0] else "no",
                 good=bool(run.rest.stable[0])),
        SheetRow(label="largest tension", value=f"{most:.0f} N",
                 allowed=f"<= {robot.tension_max:g} N", good=most <= robot.tension_max),
        SheetRow(label="moved by, at most", value=f"{1e3 * _displacement(run).max():.0f} mm"),
        SheetRow(label="turned by, at most", value=f"{np.degrees(run.turned.max()):.0f} deg"),
        SheetRow(label="slack or broken at rest", value=f"{slack} of {robot.cables} cables"),
        SheetRow(label="simulated", value=f"{run.run_time.real_time_rate:.0f}",
                 allowed="times real time"),
    ]  # fmt: skip


def _time_figure(scenario: CableRobotScenario, run: BreakRun) -> Any:
    least = scenario.checks.clearance_min_mm
    lowest = int(np.argmin(run.clearance))
    panels = [
        Panel(
            title="Least distance of the platform to panels, doors and sills",
            y_label="distance (mm)",
            lines=[Line(x=run.time, y=1e3 * run.clearance)],
            limits=[Limit(value=least, label="allowed"),
                    ],
            marks=[Mark(x=float(run.time[lowest]), y=1e3 * float(run.clearance[lowest]),
                        text=f"{1e3 * run.clearance[lowest]:.0f} mm")],
        ),
        Panel(
            title="From where it hung",
            y_label="moved (mm)",
            lines=[Line(x=run.time, y=1e3 * _displacement(run))],
        ),
        Panel(
            title="Turned",
            y_label="angle (deg)",
            lines=[Line(x=run.time, y=np.degrees(run.turned))],
        ),
        Panel(
            title="Tensions",
            y_label="tension (N)",
            lines=[
                Line(x=run.time, y=column, label=str(k + 1), style="--" if k == 7 else "-")
                for k, column in enumerate(run.tensions.T)
            ],
        ),
    ]  # fmt: skip
    words = f"Cable {scenario.cable_break.cable} breaks at {scenario.cable_break.time_s:g} s"
    return time_series_figure(panels, "time (s)", title=words, panel_height=2.0)


def _write_series(folder: Path, robot: CableRobot, run: BreakRun) -> None:
    values = np.column_stack(
        [run.poses.position, run.turned, run.twist, run.clearance, run.tensions, run.unstretched]
    )
    numbers = range(1, robot.cables + 1)
    columns = (
        "x_m", "y_m", "z_m", "turned_rad", "vx_m_s", "vy_m_s", "vz_m_s", "wx_rad_s", "wy_rad_s",
        "wz_rad_s", "clearance_m",
        *(f"tension_{k}_N" for k in numbers), *(f"unstretched_{k}_m" for k in numbers),
    )  # fmt: skip
    write_csv(Series(time=run.time, values=values, columns=columns), folder / "platform.csv")


def _write_replay(
    file: Path, name: str, scenario: CableRobotScenario, robot: CableRobot, run: BreakRun
) -> None:
    vectors, arms = cable_vectors(robot, run.rest.poses)
    inner = run.rest.poses.position[0] + arms[0]
    lines = [
        LineInSpace(
            name=f"cables at rest/{k + 1}",
            points=np.array([inner[k], inner[k] + vectors[0, k]]),
            color=(0.0, 0.447, 0.698),
        )
        for k in range(robot.cables)
        if not run.rest.slack[0, k]
    ]
    asked = scenario.cable_break
    broken = np.zeros((len(run.time), robot.cables))
    broken[run.time >= asked.time_s, asked.cable - 1] = 1.0
    x, y, z = run.poses.position[0]
    least = int(np.argmin(run.clearance))
    write_platform_replay(
        file,
        robot,
        run.time,
        run.poses,
        broken=broken,
        sample_rate=25.0,
        speed=1.0,
        eye=(x + 3.5, y - 0.5 * np.sign(y or 1.0), z + 2.0),
        target=(x, y, z),
        title=f"{name}: cable {asked.cable} breaks",
        note="thin blue lines: the taut cables of the rest posture",
        lines=lines,
        bookmarks=[
            Bookmark(label="the cable breaks", time=asked.time_s),
            Bookmark(label="least clearance", time=float(run.time[least])),
        ],
    )
