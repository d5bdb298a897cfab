"""The whole pipe as one diagram: ports and systems by name, where it starts, what it refuses."""

from __future__ import annotations

import re

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.scenarios import load_scenario
from pips_drake.serpentine import kinematics
from pips_drake.serpentine.plan import make_plan
from pips_drake.serpentine.station import (
    BASE_FRAME,
    MakeSerpentineStation,
    gravity_in_frame_0,
    load_setup,
    mounting_pose,
)
from pips_drake.serpentine.systems.tip_path_source import HOLD

from .station_bench import Bench, scenario, spine_distance

G = 9.81


def documented_ports():
    """Names of the station's ports, from its docstring."""
    text = MakeSerpentineStation.__doc__
    inputs, outputs = text.split("Input port:")[1].split("Output ports")
    found = [re.findall(r"`(\w+\.\w+)`", part.split("Latencies")[0]) for part in (inputs, outputs)]
    return set(found[0]), set(found[1])


@pytest.fixture(scope="module")
def shipped():
    return Bench(load_scenario("trajectory_4").config)


def test_every_documented_port_is_exported_and_no_other(shipped):
    station = shipped.station
    inputs = {station.get_input_port(i).get_name() for i in range(station.num_input_ports())}
    outputs = {station.get_output_port(i).get_name() for i in range(station.num_output_ports())}
    assert (inputs, outputs) == documented_ports()


@pytest.mark.parametrize("camera", [True, False])
@pytest.mark.parametrize("compensate", [True, False])
def test_every_documented_system_is_there_by_name_and_no_other(compensate, camera):
    # Both ways of the supervisor in the same four stations.
    supervised = compensate == camera
    station = MakeSerpentineStation(
        scenario(
            actuation__compensate_deflection=compensate,
            camera__enabled=camera,
            supervisor__enabled=supervised,
        )
    )
    text = MakeSerpentineStation.__doc__.split("Systems, by name:")[1].split("Input port")[0]
    names = set(re.findall(r"`(\w+)`", text))
    if not compensate:
        names.remove("deflection_compensator")
    if not camera:
        names -= {"camera_pointer", "camera_station"}
    if not supervised:
        names.remove("motion_supervisor")
    assert {system.get_name() for system in station.GetSystems()} == names
    assert station.get_name() == "serpentine_station"


def test_port_sizes_are_those_documented(shipped):
    sizes = {
        "tip_path_source.tip": 2,
        "follow_the_leader.joint_state": 36,
        "actuator_length_map.drive_state": 36,
        "actuator_servo.setpoint": 36,
        "actuator_force_map.drive_effort": 18,
        "clearance_monitor.clearance": 3,
        "clearance_monitor.witness": 7,
        "motion_supervisor.command": 1,
        "motion_supervisor.measured": 15,
        "plant.state": 36,
        "plant.net_actuation": 18,
    }
    for name, size in sizes.items():
        assert shipped.station.GetOutputPort(name).size() == size, name


def test_the_shipped_scenario_runs_for_a_sixteenth_of_a_second(shipped):
    shipped.advance(1.0 / 16.0)
    assert np.all(np.isfinite(shipped["plant.state"]))
    clearance, rate, own = shipped["clearance_monitor.clearance"]
    assert 0.0 < clearance <= shipped.scenario.clearance_range_m
    assert own > 0.01 and not np.isnan(clearance)
    assert np.isnan(rate) == (clearance == shipped.scenario.clearance_range_m)


def test_it_starts_where_the_plan_starts(shipped):
    bench = Bench(scenario())
    plan = make_plan(bench.setup.arm, bench.setup.path)
    np.testing.assert_array_equal(bench["follow_the_leader.joint_state"][:18], plan.joints[0])
    np.testing.assert_array_equal(bench["follow_the_leader.joint_state"][18:], 0.0)
    # The arm begins where it will stand: off the plan by the sag of the sag.
    assert spine_distance(bench.setup.arm, bench.joints, plan.joints[0]) < 0.2e-3
    np.testing.assert_array_equal(bench["plant.state"][18:], 0.0)


@pytest.mark.parametrize("mounting", ["laboratory", "pad", "pad_below"])
def test_the_arm_stands_in_the_world_as_mounted(mounting):
    made = scenario(mounting=mounting, mounting_position_m=[1.0, 2.0, 3.0])
    bench = Bench(made, command=HOLD)
    arm, plant = bench.setup.arm, bench.plant
    X_W0 = mounting_pose(made)
    mine = plant.GetMyContextFromRoot(bench.context)
    frames = kinematics.frames(arm, bench.joints)[0]
    for body, frame in zip(arm.bodies, frames, strict=True):
        X_WB = plant.EvalBodyPoseInWorld(mine, plant.GetBodyByName(body.name))
        expected = X_W0.GetAsMatrix4() @ frame
        np.testing.assert_allclose(X_WB.GetAsMatrix4(), expected, rtol=0, atol=1e-13)
    # Gravity stays along the world's -z.
    down = X_W0.rotation() @ gravity_in_frame_0(plant)
    np.testing.assert_allclose(down, [0.0, 0.0, -G], rtol=0, atol=1e-14)
    assert plant.GetFrameByName(BASE_FRAME).GetFixedPoseInBodyFrame().IsExactlyEqualTo(X_W0)


def test_an_unconnected_command_means_run():
    bench = Bench(scenario())
    bench.advance(0.5)
    assert bench["tip_path_source.tip"][1] > 0.0


def test_the_same_run_twice_is_the_same_to_the_last_bit():
    states = []
    for _ in range(2):
        bench = Bench(scenario())
        bench.advance(0.25)
        states.append(bench["plant.state"])
    np.testing.assert_array_equal(*states)


def test_a_path_whose_home_cannot_be_reached_is_refused(tmp_path):
    (tmp_path / "aside.csv").write_text("x_in,y_in,z_in\n60,0,0\n60,0,174.902\n60,0,190\n")
    made = scenario()
    made.path = "aside.csv"
    setup = load_setup(made, folder=tmp_path)
    with pytest.raises(InputError, match=r"tip at .* of path 'aside' .*motion base does not reach"):
        MakeSerpentineStation(made, setup=setup)


def test_names_that_are_not_there_are_refused():
    for field, kind in (("arm", "arm"), ("path", "path"), ("scene", "scene")):
        with pytest.raises(InputError, match=f"unknown {kind} 'nowhere'"):
            load_setup(scenario(**{field: "nowhere"}))
