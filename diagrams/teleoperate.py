"""An operator moves the arm by its snake: a recorded session, or sliders and keys in the browser.

    python diagrams/teleoperate.py [FILE] [--seconds 4] [--out picture.png]
    python diagrams/teleoperate.py [FILE] --meshcat [--record FILE]

Diagram: SnakeTeleoperator -> ActuatorLengthMap -> drives -> MultibodyPlant with the scene;
ClearanceMonitor -> MotionSupervisor -> SnakeTeleoperator. The inputs come from the file (by default
teleoperate.yaml beside this script), or from the page.
"""

import argparse
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, MeshcatVisualizer, Rgba, Sphere
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from pips_drake.errors import InputError, PipsError
from pips_drake.planning.controls import OperatorDesk, WishKeeper
from pips_drake.planning.extension import Extending
from pips_drake.planning.live_arm import LiveArm
from pips_drake.planning.live_snake import Wish
from pips_drake.planning.live_state import LiveArmSettings, LiveState
from pips_drake.planning.operator_recording import (
    OperatorRecording,
    read_recording,
    write_recording,
)
from pips_drake.planning.station import MakeTeleoperationStation
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import SignedDistanceField, read_distance_field
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import mounting_pose
from pips_drake.twin.output_folder import write_whole
from pips_drake.twin.replay import make_meshcat


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="?", type=Path, default=Path(__file__).with_suffix(".yaml"))
    parser.add_argument("--seconds", type=float, default=0.0, help="stop early; 0: all of it")
    parser.add_argument("--out", type=Path, help="draw what the tip did there (PNG)")
    parser.add_argument("--meshcat", action="store_true", help="operate it in the browser")
    parser.add_argument("--record", type=Path, help="write there what the operator did (YAML)")
    options = parser.parse_args()
    try:
        return run(options)
    except PipsError as error:
        print(error, file=sys.stderr)
        return 2 if isinstance(error, InputError) else 1


def run(options: argparse.Namespace) -> int:
    recording = read_recording(options.file)
    arm, scene_file = load_arm(recording.arm), find_scene_file(recording.scene)
    field = read_distance_field(scene_file)
    # The feed stands where the home tip is at the path's beginning.
    home = kinematics.spine_points(arm, arm.joint_home)[0, -1]
    shift = recording.path[0, 2] - home[2] if arm.rail_is_placed_for_the_path else 0.0
    # Nearly as fast as the feed: its limit is 100 mm/s.
    settings = LiveArmSettings(tip_speed=0.085, tip_acceleration=0.17)
    live = LiveArm(arm, field, rail_shift=shift, settings=settings)
    start = live.lay(recording.path, extended=recording.extended, settled=True)
    # The bay stands upright, as on the pad.
    scenario = SerpentineScenario(
        arm=recording.arm, path="live", scene=recording.scene, mounting="laboratory"
    )
    station = MakeTeleoperationStation(scenario, live, start, scene_file=scene_file)

    builder = DiagramBuilder()
    builder.AddNamedSystem("station", station)
    for index in range(station.num_input_ports()):
        builder.ExportInput(station.get_input_port(index), station.get_input_port(index).get_name())
    meshcat = make_meshcat() if options.meshcat else None
    if meshcat is not None:
        # The scene graph is the station's own: what it shows goes out through its query port.
        visualizer = builder.AddSystem(MeshcatVisualizer(meshcat))
        builder.Connect(
            station.GetOutputPort("scene_graph.query"), visualizer.query_object_input_port()
        )
    diagram = builder.Build()
    simulator = Simulator(diagram)
    operator = station.GetSubsystemByName("snake_teleoperator")
    context = simulator.get_mutable_context()
    station_context = station.GetMyContextFromRoot(context)

    desk, keeper = None, WishKeeper()
    if meshcat is not None:
        desk = OperatorDesk(
            meshcat,
            goal=start.live.goal,
            reach=arm.joint_upper[0] - arm.joint_lower[0],
            tension=settings.snake.snake.tension,
            bending_stiffness=settings.snake.snake.bending_stiffness,
        )
        X_WF = mounting_pose(scenario)
        target = start.live.snake.points[len(start.live.snake.points) // 2]
        meshcat.SetCameraPose(X_WF @ clearest_place(field, target, 1.6), X_WF @ target)
        simulator.set_target_realtime_rate(1.0)
        print(f"open {meshcat.web_url()}")
    duration = options.seconds or (np.inf if options.meshcat else recording.duration)
    log = _Log(live)
    try:
        while context.get_time() < duration:
            time = context.get_time()
            state = operator.live_state(operator.GetMyContextFromRoot(context))
            wish = desk.read(state.live.snake) if desk else recording.at(time)
            keeper.keep(time, wish)
            tell(diagram, context, wish)
            simulator.AdvanceTo(min(time + settings.period, duration))
            log.note(station, station_context, state)
            if meshcat is not None:
                show_snake(meshcat, X_WF, state)
    except KeyboardInterrupt:
        print()
    if options.record:
        done = OperatorRecording(
            arm=recording.arm,
            scene=recording.scene,
            path=recording.path,
            extended=recording.extended,
            duration=context.get_time(),
            times=tuple(keeper.times),
            wishes=tuple(keeper.wishes),
        )
        write_whole(options.record, write_recording(done))
    if options.out:
        draw(log, options.out)
    return verdict(log)


def tell(diagram: Diagram, context: Context, wish: Wish) -> None:
    """Puts a wish on the station's inputs."""

    def fix(name: str, value: object) -> None:
        diagram.GetInputPort(f"snake_teleoperator.{name}").FixValue(context, value)

    if wish.goal is not None:
        fix("goal", wish.goal)
    fix("pull", np.concatenate(wish.pulls[0]) if wish.pulls else np.zeros(6))
    fix("nails", Value[object](wish.nails))
    if wish.tension is not None:
        fix("tension", [wish.tension])
    if wish.bending_stiffness is not None:
        fix("bending_stiffness", [wish.bending_stiffness])
    fix("reach", [wish.reach])
    fix("command", [wish.word])


class _Log:
    """What happened, a row a tick."""

    def __init__(self, live: LiveArm) -> None:
        self.live = live
        self.times: list[float] = []
        self.clearances: list[float] = []
        self.bounds: list[float] = []
        self.margins: list[float] = []
        self.errors: list[float] = []
        self.tips: list[np.ndarray] = []
        self.refused = self.held = 0
        self.state: LiveState | None = None

    def note(self, station: Diagram, context: Context, state: LiveState) -> None:
        """Notes an instant of the run, and the state that it began with."""
        arm = self.live.arm
        joints = station.GetOutputPort("plant.state").Eval(context)[: arm.joints]
        wanted = station.GetOutputPort("snake_teleoperator.joint_state").Eval(context)
        spine = kinematics.spine_points(arm, np.stack([joints, wanted[: arm.joints]]))
        inside = np.minimum(joints - arm.joint_lower, arm.joint_upper - joints)
        self.times.append(context.get_time())
        self.clearances.append(
            station.GetOutputPort("clearance_monitor.clearance").Eval(context)[0]
        )
        self.bounds.append(state.clearance)
        self.margins.append(float(inside[1:].min()))
        self.errors.append(float(np.linalg.norm(spine[0] - spine[1], axis=1).max()))
        self.tips.append(spine[0, -1] + self.live.shift)
        self.refused += state.live.goal_refused
        self.held += station.GetOutputPort("motion_supervisor.mode").Eval(context)[0] != 0.0
        self.state = state


def clearest_place(field: SignedDistanceField, target: np.ndarray, far: float) -> np.ndarray:
    """Of places around a target (3,) m, as `far` (m) from it, the one with most room around it."""
    # Even over the sphere: equal steps of height, the golden angle between them.
    steps = np.arange(200)
    height, angle = (steps + 0.5) / 100.0 - 1.0, steps * np.pi * (3.0 - np.sqrt(5.0))
    flat = np.sqrt(1.0 - height**2)
    around = np.column_stack([flat * np.cos(angle), flat * np.sin(angle), height])
    places = target + far * around
    return places[np.argmax(field.distances(places))]


def show_snake(meshcat: Meshcat, X_WF: RigidTransform, state: LiveState) -> None:
    """Draws the snake, and balls at its nails."""
    meshcat.SetLine("/snake", X_WF @ state.live.snake.points.T, 4.0, Rgba(0.9, 0.5, 0.1))
    meshcat.Delete("/nails")
    for k, place in enumerate(state.live.held):
        meshcat.SetObject(f"/nails/{k}", Sphere(0.03), Rgba(0.8, 0.1, 0.1))
        meshcat.SetTransform(f"/nails/{k}", RigidTransform(X_WF @ place))


def draw(log: _Log, file: Path) -> None:
    """The tip's way, seen from the side, and what was left between the arm and the scene."""
    tips = np.array(log.tips)
    figure, (side, left) = plt.subplots(2, 1, figsize=(9, 7), layout="constrained")
    snake = log.state.live.snake.points
    side.plot(snake[:, 2], snake[:, 1], color="0.7", lw=4, label="snake at the end")
    side.plot(tips[:, 2], tips[:, 1], color="C1", label="tip")
    side.plot(*tips[0, [2, 1]], "o", color="C1", mfc="white", label="tip at the start")
    side.set(xlabel="along the bay, z0 (m)", ylabel="across, y0 (m)")
    side.set_aspect("equal", adjustable="datalim")
    side.legend(loc="best")
    left.plot(log.times, 1e3 * np.array(log.clearances), label="simulated arm (monitor)")
    left.plot(
        log.times,
        1e3 * np.array(log.bounds),
        ":",
        label="commanded arm (bound, as close as need be)",
    )
    left.axhline(1e3 * log.live.settings.clearance, color="C3", ls="--", label="must be kept")
    most = 1.3e3 * max(*log.clearances, *log.bounds)
    left.set(xlabel="time (s)", ylabel="clearance (mm)", ylim=(0.0, most))
    left.legend(loc="upper center", ncols=3)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def verdict(log: _Log) -> int:
    """Prints what became of it; 0 if it was in order."""
    state = log.state
    least, need = min(log.clearances), log.live.settings.clearance
    far = float(np.linalg.norm(log.tips[-1] - state.live.goal))
    passed = least >= need and min(log.margins) > 0.0
    print(
        f"{'pass' if passed else 'fail'}: {log.times[-1]:.1f} s; least clearance "
        f"{1e3 * least:.1f} mm (must be {1e3 * need:g}); joints "
        f"{np.degrees(min(log.margins)):.1f} deg or more within their limits; "
        f"{1e3 * max(log.errors):.1f} mm or less from the command"
    )
    print(
        f"at the end: {Extending(state.extending).name.lower()}, tip {state.extended:.3f} m out, "
        f"{1e3 * far:.0f} mm from its goal; goal refused in {log.refused} ticks, "
        f"supervisor intervened in {log.held}"
    )
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
