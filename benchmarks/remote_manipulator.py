"""The remote manipulator: a frame of its collision program, and the rate of the docking task."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from pydrake.geometry import (
    Convex,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    ProximityProperties,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from benchmarks.measuring import Array, Line, measure_in_turn
from pips_drake.remote_manipulator.bodies import MachineBodies, Placement
from pips_drake.remote_manipulator.configuration import load_configuration
from pips_drake.remote_manipulator.kinematics import nearest_angles
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.phases import Phase
from pips_drake.remote_manipulator.program import CollisionProgram, Measured
from pips_drake.remote_manipulator.program_motion import effector_pose
from pips_drake.remote_manipulator.program_state import ANGLES, GAP, HEIGHT, pose_of, vector_of
from pips_drake.remote_manipulator.runs.operators import make_operator
from pips_drake.remote_manipulator.runs.run import Setup, load_setup, make_station, run_station
from pips_drake.remote_manipulator.station.plant import make_plant
from pips_drake.scenarios import load_scenario

#: Of a frame's collisions and planes, ms: what the operator's 20 Hz leave, and what is aimed for.
LIMIT, AIM = 50.0, 5.0
#: Milliseconds a simulated second at 20 times real time.
RATE_AIM = 1e3 / 20.0
#: Simulated time that each simulator advances before it is the next one's turn, s.
CHUNK = 10.0
#: The effector holds the payload this far below its palm's top, and points down.
BELOW = 0.16 + 0.40
DOWN = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])


def measure(*, quick: bool) -> list[Line]:
    """Milliseconds: of a frame, its 99th percentile; of a simulated second of docking."""
    return [measure_frames(quick=quick), measure_docking(quick=quick)]


def measure_frames(*, quick: bool) -> Line:
    """A payload is swung in the bay, from wall to wall; the same placements are given to Drake."""
    count, rounds = (20, 2) if quick else (400, 7)
    program, machine = make_program()
    drake = DrakeDistances(machine)
    worst: dict[str, list[float]] = {"ours": [], "drake": []}
    every: list[float] = []
    for i in range(-1, rounds):
        times, placements, inhibited = swing(program, count)
        beside = [drake.time(machine, one) for one in placements]
        if i < 0:
            continue  # compiled functions are loaded or made
        worst["ours"].append(1e3 * float(np.quantile(times, 0.99)))
        worst["drake"].append(1e3 * float(np.quantile(beside, 0.99)))
        every += (1e3 * times).tolist()
    apart, signs = drake.disagreement(machine, placements[:: max(1, count // 20)])
    pairs = len(machine.held_pairs)
    return Line(
        name="collision_program_frame",
        what=f"A frame of the collision program, payload held, {pairs} pairs of convex bodies: "
        f"99th percentile of {count} frames",
        ours=np.array(worst["ours"]),
        peer=np.array(worst["drake"]),
        unit="ms",
        beside="Drake's signed distances of the same pairs of hulls, called one by one from Python",
        value_aim=AIM,
        limits="A frame in collision asks up to three times; the rest is Python around the kernels",
        agreement={
            "median (ms)": float(np.median(every)),
            "longest (ms)": float(np.max(every)),
            "beyond 50 ms": float(np.sum(np.array(every) > LIMIT)),
            "frames inhibited": float(inhibited),
            "pairs of another sign": float(signs),
            "more than Drake's distance by at most (m)": apart,
        },
    )


def make_program() -> tuple[CollisionProgram, MachineBodies]:
    """The shipped machine's program with the payload held, 1.5 m above its place in the bay."""
    config = load_configuration()
    middle = np.array(config.payload.location_m) - [0.0, 0.0, 1.5]
    palm = middle - [0.0, 0.0, 0.5 * config.payload.across_flats_m + BELOW]
    height = config.stand.upper_m
    angles = nearest_angles(config.arm, palm, DOWN, height, config.arm.home)
    if angles is None:
        raise RuntimeError("the arm does not reach the payload")
    program = CollisionProgram(config, arm=[height, *angles, config.effector.prong_closed_gap_m])
    return program, program.collisions.machine


def swing(program: CollisionProgram, count: int) -> tuple[Array, list[Placement], int]:
    """Processor seconds of each frame, (count,), where everything was, and frames inhibited."""
    config, first = program.config, program.first_state()
    R_R2, p_R2 = effector_pose(config.arm, first.command)
    middle = np.array(config.payload.location_m) - [0.0, 0.0, 1.5]
    held = vector_of((R_R2.T, R_R2.T @ (middle - p_R2)))
    state = replace(first, phase=Phase.EXTRACTION, held=held)
    X_RC = np.eye(3), np.array(config.central_assembly_element.location_m)
    times, placements, inhibited = np.empty(count), [], 0
    for k in range(count):
        angles = first.command[ANGLES].copy()
        # A degree of heading moves the payload by more than the bay's six inches of room.
        angles[0] += np.radians(1.2) * np.sin(2.0 * np.pi * k / 200.0)
        X_R2 = effector_pose(config.arm, state.sent)
        R, p = pose_of(held)
        X_RP = X_R2[0] @ R, X_R2[0] @ p + X_R2[1]
        gap, height = float(state.sent[GAP]), float(state.sent[HEIGHT])
        placements.append(Placement(X_R2, X_RP, X_RC, gap, height))
        inputs, measured = OperatorInputs(angles=angles), Measured(X_RP, X_RC)
        began = time.thread_time()
        state, _ = program.advance(state, inputs, measured)
        times[k] = time.thread_time() - began
        inhibited += state.inhibited
    if count > 100 and not 0 < inhibited < count:
        raise RuntimeError("the payload should be inhibited at times, and free at others")
    return times, placements, inhibited


class DrakeDistances:
    """Drake's signed distances of the program's pairs of convex bodies."""

    def __init__(self, machine: MachineBodies) -> None:
        self._graph = SceneGraph()
        self._source = self._graph.RegisterSource("bodies")
        self._frames, self._shapes = [], []
        for k, body in enumerate(machine.bodies.bodies):
            frame = self._graph.RegisterFrame(self._source, GeometryFrame(f"frame_{k}"))
            shape = Convex(body.vertices.T, f"hull_{k}")
            instance = GeometryInstance(RigidTransform(), shape, f"hull_{k}")
            instance.set_proximity_properties(ProximityProperties())
            self._shapes.append(self._graph.RegisterGeometry(self._source, frame, instance))
            self._frames.append(frame)
        self._context = self._graph.CreateDefaultContext()
        self._port = self._graph.get_source_pose_port(self._source)
        self._pairs = [(self._shapes[a], self._shapes[b]) for a, b in machine.held_pairs]

    def distances(self, machine: MachineBodies, placement: Placement) -> Array:
        """Of all pairs, m."""
        poses = FramePoseVector()
        for frame, R, p in zip(self._frames, *machine.poses(placement), strict=True):
            poses.set_value(frame, RigidTransform(RotationMatrix(R), p))
        self._port.FixValue(self._context, poses)
        query = self._graph.get_query_output_port().Eval(self._context)
        ask = query.ComputeSignedDistancePairClosestPoints
        return np.array([ask(*pair).distance for pair in self._pairs])

    def time(self, machine: MachineBodies, placement: Placement) -> float:
        """Processor seconds of `distances`."""
        began = time.thread_time()
        self.distances(machine, placement)
        return time.thread_time() - began

    def disagreement(
        self, machine: MachineBodies, placements: list[Placement]
    ) -> tuple[float, int]:
        """How much more our separation is than Drake's distance at most, m; pairs of other sign.

        Ours is the largest gap along an axis: at most the distance. What is nearer to touching than
        a nanometre has no sign.
        """
        most, signs = -np.inf, 0
        for placement in placements:
            ours = machine.bodies.separations(machine.held_pairs, *machine.poses(placement))
            theirs = self.distances(machine, placement)
            most = max(most, float((ours.separation - theirs).max()))
            surely = (np.abs(theirs) > 1e-9) & (np.abs(ours.separation) > 1e-9)
            signs += int(np.sum(surely & ((ours.separation > 0.0) != (theirs > 0.0))))
        return most, signs


def measure_docking(*, quick: bool) -> Line:
    """`dock_payload` without figures, beside its plant sent along the same way."""
    loaded = load_scenario("dock_payload")
    setup = load_setup(loaded.config, folder=loaded.folder)
    chunk, rounds = (0.5, 2) if quick else (CHUNK, 54)

    def station():  # type: ignore[no-untyped-def]
        operator = make_operator(loaded.config, setup, folder=loaded.folder)
        return make_station(setup, operator.system, camera=loaded.config.station)

    whole = run_station(station(), duration=chunk * (rounds + 1))
    twin = station()
    simulator = Simulator(twin.diagram)
    twin.attachments.initialize(simulator.get_mutable_context())
    simulator.set_monitor(twin.attachments.monitor)
    machine, bare = make_bare(setup, whole.data.time, whole.data.setpoint)

    def turn(one: Simulator) -> float:
        one.AdvanceTo(one.get_context().get_time() + chunk)
        return chunk

    seconds = measure_in_turn(
        {"bare": lambda: turn(bare), "full": lambda: turn(simulator)}, rounds=rounds
    )
    rate = 1.0 / float(seconds["full"].mean())
    arms = []
    for diagram, context in (
        (twin.diagram, simulator.get_context()),
        (machine, bare.get_context()),
    ):
        plant = diagram.GetSubsystemByName("plant")
        assert isinstance(plant, MultibodyPlant)
        mine = plant.GetMyContextFromRoot(context)
        arms.append(plant.GetPositions(mine, plant.GetModelInstanceByName("rms_arm")))
    return Line(
        name="docking_task",
        what=f"The docking task, step 1/{loaded.config.dynamics.plant_hz} s, ms a simulated second",
        ours=1e3 * seconds["full"],
        peer=1e3 * seconds["bare"],
        unit="ms / simulated s",
        beside="bare C++ plant and scene, the arm sent along the same way, same step, payload in "
        "the bay",
        value_aim=RATE_AIM,
        limits="Beside the plant: the collision program at 20 Hz, clearance to all shapes at 20 Hz,"
        " the slave arm at 100 Hz",
        agreement={
            "simulated s / s": rate,
            "angles apart at most (rad)": float(np.abs(arms[0] - arms[1])[1:7].max()),
        },
    )


def make_bare(setup: Setup, times: Array, setpoints: Array) -> tuple[Diagram, Simulator]:
    """The plant of a scenario, its arm sent along set-points (N, 11) by a trajectory."""
    builder = DiagramBuilder()
    machine = make_plant(builder, setup.config, setup.plant)
    # A set-point is reached a frame and a control period after it was written.
    knots = np.concatenate([[0.0], times + 0.06])
    way = np.vstack([setpoints[:1], setpoints])[:, : GAP + 1]
    source = builder.AddNamedSystem(
        "trajectory_source",
        TrajectorySource(
            PiecewisePolynomial.FirstOrderHold(knots, way.T), output_derivative_order=1
        ),
    )
    builder.Connect(
        source.get_output_port(), machine.plant.get_desired_state_input_port(machine.arm)
    )
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = machine.plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    machine.set_initial_state(context)
    return diagram, simulator
