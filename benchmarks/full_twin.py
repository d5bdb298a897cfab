"""The full twin beside a bare Drake plant that is told where to be, and where the rest goes."""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any
from unittest import mock

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from benchmarks.measuring import Array, Line, measure_in_turn
from pips_drake.scenarios import load_scenario
from pips_drake.scene.loading import AddScene
from pips_drake.serpentine.motion_profile import RestToRestProfile
from pips_drake.serpentine.runs.run import make_run_diagram
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.statics import sag
from pips_drake.serpentine.station import (
    BASE_FRAME,
    AddSerpentineArm,
    SerpentineSetup,
    gravity_in_frame_0,
    load_setup,
    mounting_pose,
)
from pips_drake.twin.systems.clearance_monitor import ClearanceMonitor

#: Simulated time that each simulator advances before it is the next one's turn, s.
CHUNK = 2.0
#: Spacing of the trajectory's breaks, s: closer than the plan's own motion changes.
BREAK_SPACING = 1.0 / 16.0
#: What is neither the plant's nor a Python system's: Drake's own systems, and calling ours.
REST = "logs, Meldis, set-points and dispatch"
#: How the names of callbacks begin that Drake calls in a Python system.
CALLBACKS = ("_calc", "_update", "_publish")


def measure(*, quick: bool) -> list[Line]:
    """Simulated seconds a second, over the whole of trajectory 4: out, dwell and back."""
    loaded = load_scenario("trajectory_4")
    scenario: SerpentineScenario = loaded.config
    setup = load_setup(scenario, folder=loaded.folder)
    bare = make_bare_diagram(scenario, setup)
    built = make_run_diagram(scenario, setup)
    with mock.patch.object(ClearanceMonitor, "_update_clearance", _do_nothing):
        without = make_run_diagram(scenario, setup).diagram
    clock = CallbackClock()
    with clock.installed(built.station):
        timed = make_run_diagram(scenario, setup).diagram
    runs = {
        "bare": _Run(bare),
        "full": _Run(built.diagram),
        "without": _Run(without),
        "timed": _Run(timed),
    }
    # A round is a chunk of each; together they make the whole run.
    chunk = 0.25 if quick else CHUNK
    rounds = 3 if quick else int(built.duration / chunk) - 1
    apart = []

    def full_turn() -> float:
        done = runs["full"].advance(chunk)
        if runs["full"].time == runs["bare"].time:
            apart.append(np.linalg.norm(_tip(runs["full"], setup) - _tip(runs["bare"], setup)))
        return done

    def timed_turn() -> float:
        first = runs["timed"].time == 0.0
        done = runs["timed"].advance(chunk)
        if first:
            clock.clear()  # the warm-up, in which compiled functions are loaded or made
        return done

    seconds = measure_in_turn(
        {
            "bare": lambda: runs["bare"].advance(chunk),
            "full": full_turn,
            "without": lambda: runs["without"].advance(chunk),
            "timed": timed_turn,
        },
        rounds=rounds,
    )
    rates = {name: 1.0 / values for name, values in seconds.items()}
    parts = _breakdown(seconds, clock, simulated=chunk * rounds)
    agreement = {"tips apart at most (m)": float(np.max(apart))}
    python = sum(parts.values()) - parts["plant"] - parts[REST]
    limits = (
        f"Of {sum(parts.values()):.0f} ms a simulated s the plant takes {parts['plant']:.0f}, "
        f"systems in Python {python:.0f}, {REST} {parts[REST]:.0f}"
    )
    hertz = scenario.clocks.clearance_hz
    shared: dict[str, Any] = {
        "unit": "simulated s / s",
        "beside": "bare C++ plant and scene with a TrajectorySource, same step",
        "peer": rates["bare"],
        "more_is_better": True,
        "agreement": agreement,
    }
    step = f"1/{scenario.clocks.plant_hz} s"
    return [
        Line(
            name="twin_clearance",
            what=f"Full twin, step {step}, clearance at {hertz} Hz",
            ours=rates["full"],
            ratio_aim=0.8,
            limits=limits,
            parts=parts,
            **shared,
        ),
        Line(
            name="twin_without",
            what=f"Full twin, step {step}, without clearance",
            ours=rates["without"],
            ratio_aim=0.9,
            limits=f"The same, less the clearance monitor's {parts['ClearanceMonitor']:.1f} ms",
            **shared,
        ),
    ]


def make_bare_diagram(scenario: SerpentineScenario, setup: SerpentineSetup) -> Diagram:
    """Plant and scene as the station has them, sent along the plan by a trajectory.

    Nothing of it is Python: it is the least that simulates this arm in this scene.
    """
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=1.0 / scenario.clocks.plant_hz, discrete_contact_approximation="lagged"
        ),
        builder,
    )
    model = AddSerpentineArm(plant, setup.arm, mounting_pose(scenario), setup.rail_shift)
    if setup.scene_file is not None:
        AddScene(plant, setup.scene_file, base_frame=BASE_FRAME)
    plant.Finalize()
    motion = scenario.motion
    profile = RestToRestProfile.make(
        travel=setup.path.travel, speed=motion.tip_speed_mm_per_s * 1e-3, ramp=motion.ramp_s
    )
    end = 2.0 * profile.duration + motion.dwell_s
    times = np.arange(0.0, end + BREAK_SPACING, BREAK_SPACING)
    # Out, dwell and back: the profile's own time runs up, stands and runs down.
    own = np.clip(np.minimum(times, end - times), 0.0, profile.duration)
    tips = setup.path.home_arc_length + np.array([profile(t)[0] for t in own])
    joints = setup.solver.solve(setup.path, tips).joints
    # Sent as much farther as gravity bends the arm, as the station's compensator does.
    gravity = gravity_in_frame_0(plant)
    sent = joints + sag(setup.arm, joints, gravity)
    trajectory = PiecewisePolynomial.CubicShapePreserving(times, sent.T)
    source = builder.AddNamedSystem(
        "trajectory_source", TrajectorySource(trajectory, output_derivative_order=1)
    )
    builder.Connect(source.get_output_port(), plant.get_desired_state_input_port(model))
    plant.SetDefaultPositions(model, joints[0])
    plant.set_name("plant")
    return builder.Build()


class _Run:
    """A simulator that advances a chunk at a time."""

    def __init__(self, diagram: Diagram) -> None:
        self.diagram = diagram
        self.simulator = Simulator(diagram)
        self.simulator.Initialize()
        self.time = 0.0

    def advance(self, chunk: float) -> float:
        self.time += chunk
        self.simulator.AdvanceTo(self.time)
        return chunk


def _tip(run: _Run, setup: SerpentineSetup) -> Array:
    """Where the arm's tip is in the world, (3,) m."""
    station = run.diagram
    if station.HasSubsystemNamed("station"):
        station = station.GetSubsystemByName("station")
    plant = station.GetSubsystemByName("plant")
    body = plant.GetBodyByName(setup.arm.bodies[-1].name)
    context = plant.GetMyContextFromRoot(run.simulator.get_context())
    tip: Array = plant.EvalBodyPoseInWorld(context, body).translation()
    return tip


def _do_nothing(*_: object) -> None:
    pass


class CallbackClock:
    """Time spent in the callbacks of Python systems, without that of callbacks called in turn.

    Attributes:
        seconds: by the system's class.
    """

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        self._inner: list[float] = []

    def clear(self) -> None:
        """Forgets what was measured."""
        self.seconds.clear()

    @contextlib.contextmanager
    def installed(self, station: Diagram) -> Iterator[None]:
        """Diagrams built meanwhile have the clock in every class of system that `station` has."""
        with contextlib.ExitStack() as stack:
            for kind in {type(system) for system in station.GetSystems()}:
                if not (issubclass(kind, LeafSystem) and kind.__module__.startswith("pips_drake")):
                    continue
                for name in [name for name in vars(kind) if name.startswith(CALLBACKS)]:
                    wrapped = self._wrap(kind.__name__, vars(kind)[name])
                    stack.enter_context(mock.patch.object(kind, name, wrapped))
            yield

    def _wrap(self, name: str, callback: Callable[..., None]) -> Callable[..., None]:
        def timed(*args: object) -> None:
            start = time.thread_time()
            self._inner.append(0.0)
            callback(*args)
            spent = time.thread_time() - start
            self.seconds[name] += spent - self._inner.pop()
            if self._inner:
                self._inner[-1] += spent

        return timed


def _breakdown(
    seconds: dict[str, Array], clock: CallbackClock, *, simulated: float
) -> dict[str, float]:
    """Milliseconds a simulated second: plant, each class of Python systems, and what is left.

    The clocks' own time counts as what is left, and is a millisecond or so.
    """
    parts = {"plant": 1e3 * float(seconds["bare"].mean())}
    for name, spent in clock.seconds.most_common():
        parts[name] = 1e3 * spent / simulated
    known = sum(parts.values())
    parts[REST] = 1e3 * float(seconds["timed"].mean()) - known
    return parts
