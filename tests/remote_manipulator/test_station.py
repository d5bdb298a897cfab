"""The whole station as one diagram: ports and systems by name, where it starts, when it acts."""

from __future__ import annotations

import re

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.analog_inputs import angle_scaling, encode_frame
from pips_drake.remote_manipulator.configuration import STATIONS
from pips_drake.remote_manipulator.control_word import decode
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.phases import SUPPORTS, Phase
from pips_drake.remote_manipulator.program_state import ANGLES, GAP, HEIGHT, ProgramSettings
from pips_drake.remote_manipulator.station.plant import PlantSettings
from pips_drake.remote_manipulator.station.station import JetConfig, MakeRemoteManipulatorStation

from .program_world import CONFIG, STOWED, arm_over

SCALING = angle_scaling(CONFIG.arm)
#: So far open that the prong closes round the bar in less than a second.
NEARLY = 0.28
#: The arm over the bar, the stand halfway.
OVER = arm_over(STOWED, height=3.0, gap=NEARLY)
HOME = np.array([CONFIG.stand.lower_m, *CONFIG.arm.home, CONFIG.effector.prong_open_gap_m])


class Bench:
    """A station without an operator, in a running simulator; outputs by name."""

    def __init__(self, *, arm=None, program=None, **settings):
        self.arm = HOME if arm is None else arm
        self.made = MakeRemoteManipulatorStation(
            CONFIG,
            settings=PlantSettings(arm_vector=self.arm, **settings),
            program_settings=program,
            camera="C",
        )
        self.station = self.made.diagram
        self.start(self.station.CreateDefaultContext())
        self.made.attachments.initialize(self.context)
        self.send()
        self.simulator.Initialize()

    def start(self, context):
        self.simulator = Simulator(self.station, context)
        self.context = self.simulator.get_mutable_context()
        self.simulator.set_monitor(self.made.attachments.monitor)

    def send(self, *, angles=None, context=None, **inputs):
        """What the operator does from now on; the station on the cabin's roof."""
        angles = self.arm[ANGLES] if angles is None else angles
        volts = encode_frame(OperatorInputs(angles=angles, station="C", **inputs), SCALING)
        port = self.station.GetInputPort("operator.channels")
        port.FixValue(self.context if context is None else context, volts)

    def to(self, time):
        self.simulator.AdvanceTo(time)

    def __getitem__(self, port):
        return np.array(self.station.GetOutputPort(port).Eval(self.context))


@pytest.fixture(scope="module")
def at_first():
    return Bench()


@pytest.fixture(scope="module")
def acquired():
    """The arm over the bar, which takes the payload by closing its prong."""
    bench = Bench(arm=OVER)
    bench.send(prong=1)
    bench.to(1.01)
    return bench


def documented(begin, end):
    text = MakeRemoteManipulatorStation.__doc__
    return text.split(begin)[1].split(end)[0]


def test_every_system_is_there_by_name_and_no_other(at_first):
    names = set(re.findall(r"`(\w+)`", documented("Systems, by name:", "Input port")))
    live = {system.get_name() for system in at_first.station.GetSystems()}
    assert live == names - {"operator", "attitude_limit_cycle"}
    jets = JetConfig(dead_band=0.01, torque=100.0)
    free = PlantSettings(support="none")
    flying = MakeRemoteManipulatorStation(CONFIG, settings=free, jets=jets)
    assert flying.diagram.HasSubsystemNamed("attitude_limit_cycle")
    assert at_first.station.get_name() == "remote_manipulator_station"


def test_every_port_of_its_parts_is_exported_by_its_name(at_first):
    station = at_first.station
    inputs = [station.get_input_port(i).get_name() for i in range(station.num_input_ports())]
    assert inputs == ["operator.channels"]
    outputs = {station.get_output_port(i).get_name() for i in range(station.num_output_ports())}
    told = documented("Output ports", "Latencies")
    parts = ["collision_program", "relative_poses", "clearance_monitor", "visual_scene_program"]
    for name in parts:
        assert f"`{name}`" in told
        system = station.GetSubsystemByName(name)
        ports = {system.get_output_port(i).get_name() for i in range(system.num_output_ports())}
        left_out = {"urgent", "own_urgent"}  # of interest to a supervisor alone
        assert all(f"`{port}`" in told for port in ports & left_out)
        for port in ports - left_out:
            assert f"{name}.{port}" in outputs
    plant = {"plant.state", "plant.arm_state", "plant.arm_effort", "plant.contact_results"}
    for port in plant | {"scene_graph.query"}:
        assert f"`{port}`" in told and port in outputs
    rest = {"slave_arm.arm_desired_state", "scene_graph.query"} | plant
    assert {name for name in outputs if name.split(".")[0] not in parts} == rest


def test_port_sizes_are_those_documented(at_first):
    sizes = {"plant.arm_state": 16, "plant.arm_effort": 8, "collision_program.setpoint": 11}
    for name, size in sizes.items():
        assert at_first.station.GetOutputPort(name).size() == size, name
    assert at_first.station.GetInputPort("operator.channels").size() == 17


def test_at_the_start_everything_is_where_the_configuration_has_it(at_first):
    bench = at_first
    np.testing.assert_array_equal(bench["collision_program.setpoint"], [*HOME, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(bench["slave_arm.arm_desired_state"], [*HOME, *[0.0] * 8])
    np.testing.assert_array_equal(bench["plant.arm_state"], [*HOME, *[0.0] * 8])
    np.testing.assert_array_equal(bench["relative_poses.arm_measured"], HOME)
    # Through the world and back: two rotations by half a turn.
    payload, cae = bench["relative_poses.payload_pose"], bench["relative_poses.cae_pose"]
    for pose, place in (
        (payload, CONFIG.payload.location_m),
        (cae, CONFIG.central_assembly_element.location_m),
    ):
        np.testing.assert_allclose(np.abs(pose[:4]), [1.0, 0.0, 0.0, 0.0], atol=1e-15)
        np.testing.assert_allclose(pose[4:], place, atol=1e-14)
    assert bench["collision_program.phase"] == Phase.STOWED
    np.testing.assert_array_equal(bench["collision_program.flags"], [0.0] * 4)
    bay = SUPPORTS.index("bay")
    np.testing.assert_array_equal(bench["collision_program.attachment"], [0.0, bay, 0.0])
    word = decode(int(bench["collision_program.control_word"][0]))
    assert (word.mode, word.station) == (1, "C")
    assert STATIONS[int(bench["visual_scene_program.station"][0])] == "C"
    # The payload lies 15 cm above the bay's floor, nearer than its walls and the arm.
    across, bay = CONFIG.payload.across_flats_m, CONFIG.cargo_bay
    floor = bay.location_m[2] + bay.depth_m - CONFIG.payload.location_m[2] - 0.5 * across
    assert bench["clearance_monitor.clearance"][0] == pytest.approx(floor, abs=1e-9)
    assert floor == pytest.approx(0.15, abs=0.005)


def test_a_station_begins_in_the_phase_of_what_holds_its_payload():
    for support, phase in (("port", Phase.DOCKED), ("none", Phase.FREE_FLYING)):
        bench = Bench(support=support)
        assert bench["collision_program.phase"] == phase
        index = SUPPORTS.index(support)
        np.testing.assert_array_equal(bench["collision_program.attachment"], [0.0, index, 0.0])
        # What is held holds still, and so does what flies without velocity.
        before = bench["relative_poses.payload_pose"]
        bench.to(0.3)
        assert bench["collision_program.phase"] == phase
        # The solver's welds and contacts give by micrometres.
        np.testing.assert_allclose(bench["relative_poses.payload_pose"], before, atol=1e-5)


def test_what_the_operator_does_is_decided_at_the_frames_end_and_done_a_frame_later():
    bench = Bench()
    bench.to(0.225)  # in the midst of a frame
    # Within the joint's rate, 0.0635 deg a frame, so that one frame does.
    wanted = HOME[ANGLES] + [np.radians(0.05), 0.0, 0.0, 0.0, 0.0, 0.0]
    bench.send(angles=wanted)
    bench.to(0.245)
    # Angles become volts and angles again: a rounding or two.
    same = dict(rtol=1e-14, atol=1e-16)
    np.testing.assert_allclose(bench["collision_program.setpoint"][ANGLES], HOME[ANGLES], **same)
    bench.to(0.251)
    np.testing.assert_allclose(bench["collision_program.setpoint"][ANGLES], wanted, **same)
    np.testing.assert_allclose(bench["slave_arm.arm_desired_state"][:8], HOME, **same)
    # The slave arm's straight way begins a control period of 10 ms after, and takes a frame.
    for time, share in ((0.265, 0.2), (0.285, 0.6), (0.305, 1.0), (0.355, 1.0)):
        bench.to(time)
        way = bench["slave_arm.arm_desired_state"][1] - HOME[1]
        assert way == pytest.approx(share * (wanted[0] - HOME[1]), rel=1e-9), time


def test_without_motion_the_arm_stays(at_first):
    bench = Bench()
    bench.to(0.5)
    assert not bench["collision_program.flags"].any()
    # The made-up gravity that the contact solver needs bends it by micrometres.
    np.testing.assert_allclose(bench["relative_poses.arm_measured"], HOME, atol=2e-6)


def test_closing_the_prong_takes_the_payload_out_of_the_bays_hands(acquired):
    assert acquired["collision_program.phase"] == Phase.EXTRACTION
    np.testing.assert_array_equal(acquired["collision_program.attachment"], [1.0, 0.0, 0.0])
    done = [(event.action, event.name) for event in acquired.made.attachments.events]
    # At first the bay holds; nothing is loose at the hand-over.
    assert done[-2:] == [("hold", "grasp"), ("release", "bay")]
    assert acquired.made.attachments.slip(acquired.context) < 1e-6
    place = acquired["relative_poses.payload_pose"][4:]
    np.testing.assert_allclose(place, CONFIG.payload.location_m, atol=1e-4)


def test_a_context_that_is_cloned_runs_the_same(acquired):
    acquired.send(telescope=1)
    twin = acquired.context.Clone()
    first, now = acquired.simulator, acquired.context
    ends = []
    for context in (now, twin):
        acquired.start(context)
        acquired.to(1.51)
        ends.append((acquired["plant.state"], acquired["collision_program.display"]))
    acquired.simulator, acquired.context = first, now
    for one, other in zip(*ends, strict=True):
        np.testing.assert_array_equal(one, other)
    # Something has moved: the stand has begun to lift ten tons.
    assert acquired["relative_poses.payload_pose"][6] < CONFIG.payload.location_m[2] - 1e-3


def test_a_context_of_another_run_is_not_reset_by_this_ones():
    bench = Bench()
    twin = bench.context.Clone()
    bench.send(initialize=True)
    bench.to(0.2)
    assert bench["collision_program.attachment"][2] == 1.0
    bench.start(twin)
    bench.send()
    bench.to(0.2)
    assert bench["collision_program.attachment"][2] == 0.0
    resets = [event for event in bench.made.attachments.events if event.action == "reset"]
    assert len(resets) == 1, "the first one's alone"


def test_the_same_station_twice_is_the_same_to_the_last_bit():
    ends = []
    for _ in range(2):
        bench = Bench(arm=OVER)
        bench.send(prong=1)
        bench.to(0.81)
        ends.append([bench["plant.state"], bench["collision_program.output_block"]])
        assert bench["collision_program.phase"] == Phase.EXTRACTION
    for one, other in zip(*ends, strict=True):
        np.testing.assert_array_equal(one, other)


def test_initialize_puts_everything_back():
    arm = OVER
    bench = Bench(arm=arm, orbiter_translates=True)
    first = bench["plant.state"]
    bench.send(prong=1)
    bench.to(0.9)
    assert bench["collision_program.phase"] == Phase.EXTRACTION
    bench.send(telescope=1, shuttle=(1, 0, 0))
    bench.to(1.6)
    moved = bench["relative_poses.arm_measured"]
    assert moved[HEIGHT] > arm[HEIGHT] + 0.01 and moved[GAP] < NEARLY - 0.01
    assert bench["collision_program.setpoint"][8] > 0.01
    assert np.abs(bench["plant.state"] - first).max() > 0.01
    bench.send(initialize=True)
    bench.to(1.67)
    assert bench["collision_program.phase"] == Phase.STOWED
    bay = SUPPORTS.index("bay")
    np.testing.assert_array_equal(bench["collision_program.attachment"], [0.0, bay, 1.0])
    np.testing.assert_array_equal(bench["collision_program.setpoint"], [*arm, 0.0, 0.0, 0.0])
    # Four steps of settling since, by micrometres.
    np.testing.assert_allclose(bench["plant.state"], first, atol=1e-5)
    # And it goes on from there.
    bench.send(prong=1)
    bench.to(2.7)
    assert bench["collision_program.phase"] == Phase.EXTRACTION


def test_a_payload_may_be_held_at_right_angles(acquired):
    snapping = ProgramSettings(snap_to_right_angles=True)
    bench = Bench(arm=OVER, program=snapping)
    bench.send(prong=1)
    bench.to(1.01)
    assert bench["collision_program.phase"] == Phase.EXTRACTION
    # It stood at right angles before: the report's way is the true one then.
    np.testing.assert_allclose(
        bench["relative_poses.payload_pose"], acquired["relative_poses.payload_pose"], atol=0.05
    )


def test_an_arm_beyond_its_limits_is_refused():
    arm = HOME.copy()
    arm[3] = 1.0
    with pytest.raises(InputError, match=r"arm: P1 = 57\.2958 deg; must be -161 \.\. 2\.4 deg"):
        Bench(arm=arm)
