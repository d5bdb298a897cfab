"""Three models of the actuators agree: springs at the joints, springs between pins, two-part legs.

Independent of all three: gravity's work from Drake on the undivided arm, lengths and levers by the
law of cosines.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from pips_drake.serpentine.legs import leg_coordinates, lightened, make_legs
from pips_drake.serpentine.runs.pictures import write_run_replay
from pips_drake.serpentine.runs.placed_arm import place_arm
from pips_drake.serpentine.runs.simulate import simulate
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import (
    AddActuation,
    LegServer,
    MakeSerpentineStation,
    MakeSimulator,
    legs_name,
    load_setup,
    make_plant,
    set_leg_positions,
)
from pips_drake.serpentine.systems.tip_path_source import HOLD
from pips_drake.twin.replay import Replay

FIDELITIES = ("joint", "leg", "truss")
INCH = 0.0254
#: The arm's README: pins a = b from the hinge, at 90 deg where it is straight, and stiffness.
PINS = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
STIFFNESS = np.repeat([4e7, 3e7, 2e7], [7, 6, 3])
#: README: all bodies but the rail, kg.
ARM_MASS = 3 * 24.0 + 3 * 14.0 + 2 * 7.0 + 7 * 1.5 + 40.0 + 25.0 + 4.0


def lengths(theta):
    """Actuators between their pins, (..., 16) m, by the law of cosines."""
    return PINS * np.sqrt(2.0 - 2.0 * np.cos(np.pi / 2.0 + theta))


def levers(theta, step=1e-6):
    """dL/dtheta by differences, (16,) m/rad."""
    return (lengths(theta + step) - lengths(theta - step)) / (2.0 * step)


def scenario(fidelity, *, plant_hz=512, compensate=True, retract=False):
    made = SerpentineScenario(path="trajectory_4_arcs")
    made.actuation.fidelity, made.actuation.compensate_deflection = fidelity, compensate
    made.clocks.plant_hz = plant_hz
    made.motion.retract = retract
    made.validate()
    return made


@cache
def postures():
    """Home, the middle and the end of trajectory 4, (3, 18)."""
    setup = load_setup(scenario("joint"))
    path = setup.path
    places = path.home_arc_length + path.travel * np.array([0.0, 0.5, 1.0])
    return setup.solver.solve(path, places).joints


def gravity_work(q):
    """What holds the arm at q, (18,) N and Nm, by Drake's gravity on the undivided arm."""
    made = scenario("joint")
    placed = place_arm(made, load_setup(made))
    plant = placed.plant
    context = plant.GetMyMutableContextFromRoot(placed.diagram.CreateDefaultContext())
    plant.SetPositions(context, placed.model, q)
    return -plant.CalcGravityGeneralizedForces(context)


class Still:
    """Plant and actuation alone, sent to one posture; not yet simulated."""

    def __init__(self, fidelity, posture, **options):
        made = scenario(fidelity, **options)
        setup = load_setup(made)
        builder = DiagramBuilder()
        plant, _, model = make_plant(builder, setup, made, visual_period=1.0, fidelity=fidelity)
        plant.SetDefaultPositions(model, posture)
        drives = np.concatenate([posture[:2], lengths(posture[2:]), np.zeros(18)])
        sources = {
            "drive_state": builder.AddSystem(ConstantVectorSource(drives)),
            "joint_state": builder.AddSystem(
                ConstantVectorSource(np.append(posture, np.zeros(18)))
            ),
        }
        ports = AddActuation(
            builder,
            plant=plant,
            model=model,
            setup=setup,
            config=made.actuation,
            period=1.0 / made.clocks.control_hz,
            **{name: source.get_output_port() for name, source in sources.items()},
        )
        builder.ExportOutput(plant.get_state_output_port(model), "plant.state")
        builder.ExportOutput(ports.drive_effort, "drive_effort")
        if ports.free_length is not None:
            builder.ExportOutput(ports.free_length, "leg_springs.free_length")
        if ports.loop_gap is not None:
            builder.ExportOutput(ports.loop_gap, "gap")
        self.diagram, self.plant = builder.Build(), plant
        self.simulator = Simulator(self.diagram)
        if fidelity == "leg":
            self.simulator.set_monitor(LegServer(self.diagram).monitor)
        self.context = self.simulator.get_mutable_context()
        self.simulator.Initialize()

    def __getitem__(self, port):
        return np.array(self.diagram.GetOutputPort(port).Eval(self.context))

    @property
    def joints(self):
        return self["plant.state"][:18]


@pytest.mark.parametrize("variant", [{}, {"mirrored": True}, {"base": "gimbal"}])
def test_legs_lie_in_the_plane_of_their_hinge_and_are_as_long_as_the_triangle_says(
    arm_variant, random_postures, variant
):
    arm = arm_variant(**variant)
    for q in random_postures(arm, 20):
        turn, aside, length = leg_coordinates(arm, q)[0].T
        # Roundings of products of 18 matrices, and the arcsine's near 0.
        np.testing.assert_allclose(length, lengths(q[2:]), rtol=0, atol=1e-14)
        np.testing.assert_allclose(aside, 0.0, atol=1e-13)
        # Half the hinge's angle: a = b makes the triangle isosceles.
        np.testing.assert_allclose(np.abs(turn), np.abs(q[2:]) / 2.0, rtol=0, atol=1e-13)


def test_arm_and_legs_weigh_what_the_arm_weighs(arm):
    parts = sum(body.mass for body in lightened(arm).bodies)
    assert min(body.mass for body in lightened(arm).bodies) > 1.0
    assert parts + make_legs(arm).mass.sum() == pytest.approx(ARM_MASS, rel=1e-14)
    # Three large, three medium, two small segments, the last of which has one actuator; the
    # crane's is a twentieth of its own 25 kg.
    legs = 0.05 * (25.0 + 2 * 3 * 24.0 + 2 * 3 * 14.0 + 3 * 7.0)
    assert make_legs(arm).mass.sum() == pytest.approx(legs, rel=1e-14)


def test_a_truss_drive_has_its_actuators_stiffness_force_limit_and_stroke(arm):
    plant = Still("truss", postures()[0]).plant
    model = plant.GetModelInstanceByName(legs_name(arm))
    for k, name in enumerate(arm.actuator_names):
        drive, slide = (
            get(name, model) for get in (plant.GetJointActuatorByName, plant.GetJointByName)
        )
        assert drive.get_controller_gains().p == STIFFNESS[k]
        assert drive.get_controller_gains().d == STIFFNESS[k] * 5e-3
        assert drive.effort_limit() == np.repeat([25000.0, 6000.0, 600.0], [7, 6, 3])[k]
        # 30 deg either way, and 2 mm.
        stroke = [lengths(-np.pi / 6.0)[k] - 2e-3, lengths(np.pi / 6.0)[k] + 2e-3]
        np.testing.assert_allclose(
            [slide.position_lower_limits()[0], slide.position_upper_limits()[0]], stroke, rtol=1e-14
        )
    # The hinges have no drives beside their legs.
    assert plant.num_actuators() == 2 + 16


@pytest.mark.parametrize("place", [0, 1, 2])
def test_springs_between_the_pins_hold_what_gravity_weighs(place):
    posture = postures()[place]
    still = Still("leg", posture)
    still.simulator.AdvanceTo(0.125)
    # It begins where it stands, so nothing swings: what is left is the sag of the sag, 1e-3 of 0.2
    # deg, which is not compensated.
    np.testing.assert_allclose(still.joints[1:], posture[1:], rtol=0, atol=np.radians(1e-3))
    expected = gravity_work(posture)
    force = still["drive_effort"]
    np.testing.assert_allclose(force[1], expected[1], rtol=1e-3)
    # Forces of 40 N to 10 kN within a thousandth: a tenth of a newton for those near zero.
    np.testing.assert_allclose(force[2:], expected[2:] / levers(posture[2:]), rtol=1e-3, atol=0.1)


def test_a_bent_hinge_gives_way_by_the_stiffness_of_its_posture():
    posture = postures()[2]
    bent = np.abs(posture[2:]) > np.radians(15.0)
    assert bent.sum() >= 7
    sag = {}
    for fidelity in ("joint", "leg"):
        still = Still(fidelity, posture, compensate=False)
        still.simulator.AdvanceTo(0.125)
        torque = gravity_work(still.joints)
        sag[fidelity] = (posture - still.joints)[2:]
        at = np.zeros(16) if fidelity == "joint" else still.joints[2:]
        expected = torque[2:] / (STIFFNESS * levers(at) ** 2)
        # To first order in the sag, a fifth of a degree, over which a lever changes by 0.3 %.
        np.testing.assert_allclose(sag[fidelity], expected, rtol=1e-2, atol=1e-7)
    # What distinguishes the two: -32 to +75 % where hinges are bent that far, by cosines.
    ratio = sag["leg"][bent] / sag["joint"][bent]
    assert np.all(np.abs(ratio - 1.0) > 0.1)


@pytest.mark.parametrize("wrapped", [False, True])
def test_the_plant_gets_the_lengths_that_are_asked_for_and_none_without_a_server(wrapped):
    made = scenario("leg")
    setup = load_setup(made)
    diagram = station = MakeSerpentineStation(made, setup=setup)
    if wrapped:  # in somebody else's diagram, under another name
        builder = DiagramBuilder()
        builder.AddNamedSystem("arm of mine", station)
        diagram = builder.Build()
    plant = station.GetSubsystemByName("plant")

    def granted(simulator):
        context = plant.GetMyContextFromRoot(simulator.get_context())
        ids = sorted(plant.GetConstraintIds(), key=lambda number: number.get_value())
        return [plant.GetDistanceConstraintParams(context, i).distance() for i in ids]

    simulator = MakeSimulator(diagram, made)
    simulator.AdvanceTo(0.25)
    mine = station.GetMyContextFromRoot(simulator.get_context())
    asked = station.GetOutputPort("leg_springs.free_length").Eval(mine)
    np.testing.assert_array_equal(granted(simulator), asked)
    left_alone = Simulator(diagram)
    left_alone.AdvanceTo(1.0 / 64.0)
    default = lengths(setup.arm.joint_home[2:])
    np.testing.assert_allclose(granted(left_alone), default, rtol=1e-14)
    assert np.abs(asked - default).max() > 1e-5  # the arm's weight, at least


def test_truss_forces_in_a_static_pose_and_gaps_that_shrink_with_the_square_of_the_step():
    posture, gaps = postures()[2], {}
    for plant_hz in (512, 1024):
        still = Still("truss", posture, plant_hz=plant_hz)
        still.simulator.AdvanceTo(3.0)
        gaps[plant_hz] = still["gap"]
        # 0.1 deg is the aim; the gaps' own softness turns the most loaded hinge by 0.01 deg.
        error = np.degrees(np.abs(still.joints - posture)[1:]).max()
        assert error < 0.02
        force, expected = still["drive_effort"][2:], gravity_work(posture)[2:]
        # Aim 5 %. The legs weigh where they are and not where the segments' middles are: 2.5 % on
        # the last hinge, that a leg of 0.35 kg shares with a head of 4 kg.
        np.testing.assert_allclose(force, expected / levers(posture[2:]), rtol=0.05)
    assert gaps[512].max() < 30e-6
    # SAP softens a constraint in proportion to the step's square; loads swing by a percent yet.
    np.testing.assert_allclose(gaps[512] / gaps[1024], 4.0, rtol=0.05)


def test_a_truss_starts_with_its_loops_closed_and_its_rods_slide(arm):
    made = scenario("truss")
    station = MakeSerpentineStation(made)
    simulator = MakeSimulator(station, made)
    simulator.Initialize()
    context = simulator.get_context()
    # Roundings of places a few metres from the world's origin.
    assert station.GetOutputPort("loop_gap_meter.gap").Eval(context).max() < 1e-14
    plant = station.GetSubsystemByName("plant")
    model = plant.GetModelInstanceByName(legs_name(arm))
    for bend in (0.3, -0.3):
        q = arm.joint_home.copy()
        q[2:] = bend
        mine = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        plant.SetPositions(mine, plant.GetModelInstanceByName(arm.name), q)
        set_leg_positions(plant, mine, arm, q)
        for k, name in enumerate(arm.actuator_names):
            tube, rod = (
                plant.EvalBodyPoseInWorld(mine, plant.GetBodyByName(f"{name}_{part}", model))
                for part in ("tube", "rod")
            )
            apart = np.linalg.norm(tube.translation() - rod.translation())
            assert apart == pytest.approx(lengths(bend)[k], abs=1e-14)


@pytest.mark.parametrize("fidelity", FIDELITIES)
def test_the_ports_of_a_station_are_the_same_and_still(fidelity):
    made = scenario(fidelity)
    station = MakeSerpentineStation(made)
    simulator = MakeSimulator(station, made)
    context = simulator.get_mutable_context()
    station.GetInputPort("tip_path_source.command").FixValue(context, [HOLD])
    simulator.AdvanceTo(1.0 / 16.0)
    for name, size in (
        ("plant.state", 36),
        ("plant.net_actuation", 18),
        ("actuator_force_map.drive_effort", 18),
    ):
        values = station.GetOutputPort(name).Eval(context)
        assert values.shape == (size,) and np.all(np.isfinite(values))
    home = station.GetOutputPort("follow_the_leader.joint_state").Eval(context)[:18]
    joints = station.GetOutputPort("plant.state").Eval(context)[:18]
    assert np.degrees(np.abs(joints - home)[1:]).max() < 0.02


def follow(fidelity):
    """Joints, drive efforts and phase of a run, a row each quarter of a second, and largest gap."""
    made = scenario(fidelity, retract=True)
    station = MakeSerpentineStation(made)
    simulator = MakeSimulator(station, made)
    context = simulator.get_context()
    duration = station.GetSubsystemByName("tip_path_source").duration + 2.0
    rows, efforts, gap = [], [], 0.0
    for k in range(1, int(4 * duration)):
        simulator.AdvanceTo(0.25 * k)
        rows.append(station.GetOutputPort("plant.state").Eval(context)[:18])
        efforts.append(station.GetOutputPort("actuator_force_map.drive_effort").Eval(context))
        if fidelity == "truss":
            gap = max(gap, station.GetOutputPort("loop_gap_meter.gap").Eval(context).max())
    return np.array(rows), np.array(efforts), gap


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_the_three_agree_over_trajectory_4_out_dwell_and_back():
    joint, forces, _ = follow("joint")
    for fidelity, degrees in (("leg", 0.001), ("truss", 0.02)):
        other, other_forces, gap = follow(fidelity)
        # 0.1 deg is asked for; measured 2.4e-5 and 0.0093.
        assert np.degrees(np.abs(other - joint)[:, 1:]).max() < degrees
        assert np.abs(other - joint)[:, 0].max() < 1e-5
        # At rest at the end, and a second before the dwell of five ends.
        for row in (len(joint) - 1, len(joint) // 2):
            np.testing.assert_allclose(other_forces[row, 2:], forces[row, 2:], rtol=0.05)
        assert gap < 30e-6


@pytest.mark.slow
def test_a_truss_run_quotes_its_gaps_with_the_step_and_replays_its_rods(tmp_path):
    made = scenario("truss")
    made.duration_s = 0.5
    verdict = simulate(made, name="truss", out=tmp_path / "out")
    assert verdict.summary["actuation_fidelity"] == "truss"
    assert verdict.summary["plant_step_s"] == 1.0 / 512.0
    lines = (tmp_path / "out" / "loop_gaps.csv").read_text().splitlines()
    assert lines[0].split(",") == ["time_s"] + [f"L{j}_gap_m" for j in range(3, 19)]
    gaps = np.array([[float(word) for word in line.split(",")] for line in lines[1:]])[:, 1:]
    assert gaps.max() == pytest.approx(verdict.summary["loop_gap_max_m"], rel=1e-6)
    assert 0.0 < gaps.max() < 1e-4
    page = (tmp_path / "out" / "replay.html").read_text(errors="ignore")
    assert len(page) > 100_000


@pytest.mark.slow
def test_in_the_replay_of_a_truss_rods_slide_out_of_their_tubes(arm, tmp_path, monkeypatch):
    made = scenario("truss")
    setup = load_setup(made)
    builder = DiagramBuilder()
    plant, _, _ = make_plant(builder, setup, made, fidelity="truss")
    diagram = builder.Build()
    context = plant.GetMyMutableContextFromRoot(diagram.CreateDefaultContext())
    bends = np.array([-0.4, 0.0, 0.4])
    joints = np.tile(arm.joint_home, (3, 1))
    joints[:, 2:] = bends[:, None]
    legs = []
    for row in joints:
        set_leg_positions(plant, context, arm, row)
        legs.append(plant.GetPositions(context, plant.GetModelInstanceByName(legs_name(arm))))
    seen, add_sample = [], Replay.add_sample

    def watch(self, query):
        inspector = query.inspector()
        frames = {inspector.GetName(frame): frame for frame in inspector.GetAllFrameIds()}
        ends = [
            query.GetPoseInWorld(frames[f"{legs_name(arm)}::L4_{part}"]).translation()
            for part in ("tube", "rod")
        ]
        seen.append(np.linalg.norm(ends[0] - ends[1]))
        add_sample(self, query)

    monkeypatch.setattr(Replay, "add_sample", watch)
    write_run_replay(
        tmp_path / "replay.html",
        made,
        setup,
        title="bending",
        time=[0.0, 0.25, 0.5],
        joints=joints,
        legs=legs,
    )
    np.testing.assert_allclose(seen, lengths(bends[:, None])[:, 1], rtol=0, atol=1e-13)
    assert seen[2] > 1.4 * seen[0]
