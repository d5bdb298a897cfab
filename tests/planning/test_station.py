"""The teleoperation station: the twin goes where the operator says; the supervisor's hold holds."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from pips_drake.planning.live_arm import LiveArm
from pips_drake.planning.live_state import LiveArmSettings
from pips_drake.planning.station import OPERATOR_PORTS, MakeTeleoperationStation
from pips_drake.scene.packages import find_scene_file
from pips_drake.scene.signed_distance import read_distance_field
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.supervision import Mode
from pips_drake.serpentine.supervision_causes import Cause

TIP = np.array([0.412877, 0.0, 4.4425])
PATH = TIP + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.5]])


@pytest.fixture(scope="module")
def arm():
    return load_arm("cmu_92")


def make_station(arm, **supervisor):
    scene = find_scene_file("cargo_bay")
    shift = float(TIP[2] - kinematics.spine_points(arm, arm.joint_home)[0, -1, 2])
    settings = LiveArmSettings(tip_speed=0.08, tip_acceleration=0.16)
    live = LiveArm(arm, read_distance_field(scene), rail_shift=shift, settings=settings)
    start = live.lay(PATH, extended=1.0, settled=True)
    scenario = SerpentineScenario(
        arm="cmu_92", path="live", scene="cargo_bay", mounting="laboratory"
    )
    for name, value in supervisor.items():
        setattr(scenario.supervisor, name, value)
    return live, start, MakeTeleoperationStation(scenario, live, start, scene_file=scene)


def read(station, context, name):
    return station.GetOutputPort(name).Eval(context)


@pytest.mark.slow
def test_the_simulated_arm_goes_out_along_the_snake_near_to_its_command(arm):
    live, start, station = make_station(arm)
    names = {station.get_input_port(i).get_name() for i in range(station.num_input_ports())}
    wanted = {f"snake_teleoperator.{name}" for name in (*OPERATOR_PORTS, "command")}
    assert names == wanted
    simulator = Simulator(station)
    simulator.AdvanceTo(1.5)
    context = simulator.get_context()
    went = read(station, context, "snake_teleoperator.tip")[0] - start.tip
    # 1.5 s at 80 mm/s, less half of the ramp's half second, and a tick.
    assert went == pytest.approx(1.5 * 0.08 - 0.5 * 0.5 * 0.08, abs=0.08 / 16.0)
    joints = read(station, context, "plant.state")[: arm.joints]
    commanded = read(station, context, "snake_teleoperator.joint_state")[: arm.joints]
    spine = kinematics.spine_points(arm, np.stack([joints, commanded]))
    # Latency of some 80 ms at 80 mm/s.
    assert np.linalg.norm(spine[0] - spine[1], axis=1).max() < 0.01
    # The bound that is kept, and the distance that Drake finds.
    bound = read(station, context, "snake_teleoperator.status")[5]
    clearance = read(station, context, "clearance_monitor.clearance")[0]
    assert live.settings.clearance <= bound <= clearance + 0.01
    assert read(station, context, "motion_supervisor.mode")[0] == Mode.PERMIT


def test_where_the_supervisor_holds_tip_and_snake_stand(arm):
    """A threshold below what drives always lag behind: soon the supervisor holds, and for good."""
    thresholds = dict(tracking_hold_mm=0.2, tracking_resume_mm=1e-6, patience_s=0.0)
    _, start, station = make_station(arm, **thresholds)
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    goal = start.live.goal + np.array([0.0, 0.3, 0.0])
    station.GetInputPort("snake_teleoperator.goal").FixValue(context, goal)
    simulator.AdvanceTo(1.0)
    before = read(station, context, "snake_teleoperator.joint_state").copy()
    snake = read(station, context, "snake_teleoperator.snake").points.copy()
    simulator.AdvanceTo(1.5)
    assert read(station, context, "motion_supervisor.mode")[0] == Mode.HOLD
    assert read(station, context, "motion_supervisor.cause")[0] == Cause.TRACKING
    assert not before[arm.joints :].any()
    np.testing.assert_allclose(
        read(station, context, "snake_teleoperator.joint_state"), before, rtol=0, atol=0
    )
    after = read(station, context, "snake_teleoperator.snake").points
    np.testing.assert_allclose(after, snake, rtol=0, atol=0)
    # Until it was told it had begun, and it came to rest over its ramp.
    assert np.linalg.norm(after[-1] - start.live.goal) < 0.05
