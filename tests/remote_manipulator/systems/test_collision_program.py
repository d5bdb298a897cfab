"""The collision program as a system: ports, first outputs, and the same frames as the program's."""

from __future__ import annotations

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.acquisition import CONDITIONS
from pips_drake.remote_manipulator.analog_inputs import angle_scaling, encode_frame
from pips_drake.remote_manipulator.control_word import decode
from pips_drake.remote_manipulator.display import DISPLAY
from pips_drake.remote_manipulator.operator_inputs import OperatorInputs
from pips_drake.remote_manipulator.output_block import decode_block
from pips_drake.remote_manipulator.phases import SUPPORTS, Phase
from pips_drake.remote_manipulator.program import CollisionProgram as Program
from pips_drake.remote_manipulator.program_state import ANGLES, GAP, HEIGHT, ProgramSettings
from pips_drake.remote_manipulator.systems.collision_program import CollisionProgram

from ..program_world import CONFIG, STOWED, World, arm_over, world

SCALING = angle_scaling(CONFIG.arm)
OPEN, HELD = 0.6, 0.25


def pose(at: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Of a body along {R}, (7,)."""
    return np.concatenate([[1.0, 0.0, 0.0, 0.0], at[1]])


def volts(**inputs) -> np.ndarray:
    return encode_frame(OperatorInputs(**inputs), SCALING)


def system_at(arm: np.ndarray, **inputs) -> tuple[CollisionProgram, Context]:
    """The system with the payload stowed, nothing moving but the program."""
    system = CollisionProgram(Program(CONFIG, ProgramSettings(), arm=arm))
    context = system.CreateDefaultContext()
    angles = inputs.pop("angles", arm[ANGLES])
    system.GetInputPort("channels").FixValue(context, volts(angles=angles, **inputs))
    system.GetInputPort("payload_pose").FixValue(context, pose(STOWED))
    cae = np.array(CONFIG.central_assembly_element.location_m)
    system.GetInputPort("cae_pose").FixValue(context, pose((np.eye(3), cae)))
    return system, context


def output(system: CollisionProgram, context: Context, name: str) -> np.ndarray:
    return np.array(system.GetOutputPort(name).Eval(context))


def shown(system: CollisionProgram, context: Context) -> dict[str, float]:
    return dict(zip(DISPLAY, output(system, context, "display"), strict=True))


def test_nothing_feeds_through():
    system, _ = system_at(arm_over(STOWED))
    assert not system.HasAnyDirectFeedthrough()


def test_outputs_are_right_at_the_start():
    arm = arm_over(STOWED, height=3.5)
    system, context = system_at(arm)
    Simulator(system, context).Initialize()
    np.testing.assert_array_equal(output(system, context, "setpoint"), [*arm, 0.0, 0.0, 0.0])
    assert output(system, context, "phase") == Phase.STOWED
    np.testing.assert_array_equal(output(system, context, "flags"), [0.0] * 4)
    np.testing.assert_array_equal(
        output(system, context, "attachment"), [0.0, SUPPORTS.index("bay"), 0.0]
    )
    display = shown(system, context)
    # Palm and bar: 10 mm.
    assert display["separation_m"] == pytest.approx(0.01, abs=1e-9)
    pair = system.program.collisions.pair_names(int(display["pair"]), held=bool(display["held"]))
    assert pair == ("palm", "bar")
    missing = 1 << CONDITIONS.index("prong_closed")
    assert display["acquisition_conditions"] == (1 << 6) - 1 - missing
    assert display["acquisition_distance_m"] == 0.0
    assert display["frames"] == 0.0
    assert decode(int(output(system, context, "control_word")[0])).mode == 1


def test_a_frame_passes_every_twentieth_of_a_second():
    system, context = system_at(arm_over(STOWED, height=3.5), telescope=1)
    simulator = Simulator(system, context)
    simulator.Initialize()
    for time, frames in ((0.0, 1), (0.04, 1), (0.06, 2), (1.01, 21)):
        simulator.AdvanceTo(time)
        assert shown(system, context)["frames"] == frames
        height = 3.5 + frames * CONFIG.stand.rate_m_s * 0.05
        assert output(system, context, "setpoint")[HEIGHT] == pytest.approx(height)


def test_the_system_does_what_the_program_does():
    arm = arm_over(STOWED, height=3.5)
    there: World = world(arm=arm)
    angles = arm[ANGLES] + 0.01
    for _ in range(40):
        there.frame(angles=angles, telescope=-1, prong=1)
    system, context = system_at(arm, angles=angles, telescope=-1, prong=1)
    simulator = Simulator(system, context)
    simulator.AdvanceTo(39.5 * 0.05)
    np.testing.assert_allclose(output(system, context, "setpoint"), there.state.sent, atol=1e-12)
    assert output(system, context, "phase") == there.state.phase
    block = decode_block(output(system, context, "output_block"))
    np.testing.assert_allclose(block.normals, there.state.planes[:, :3], atol=1e-6)
    # Words of B11 in feet: half of 2^-12 ft.
    np.testing.assert_allclose(block.distances, there.state.planes[:, 3], atol=0.3048 * 2.0**-13)
    np.testing.assert_allclose(block.angles, there.state.sent[ANGLES], atol=1e-6)
    assert int(output(system, context, "control_word")[0]) == int(
        output(system, context, "output_block")[0]
    )


def test_acquisition_goes_by_the_measured_arm_where_there_is_one():
    arm = arm_over(STOWED, height=3.5, gap=HELD)
    for gap, phase in ((None, Phase.EXTRACTION), (OPEN, Phase.STOWED)):
        system, context = system_at(arm)
        if gap is not None:
            really = arm.copy()
            really[GAP] = gap
            system.GetInputPort("arm_measured").FixValue(context, really)
        Simulator(system, context).AdvanceTo(0.12)
        assert output(system, context, "phase") == phase
        held = [1.0, 0.0] if phase is Phase.EXTRACTION else [0.0, SUPPORTS.index("bay")]
        np.testing.assert_array_equal(output(system, context, "attachment")[:2], held)
    # The payload's middle in {2}: down along x2 from the wrist.
    system, context = system_at(arm)
    Simulator(system, context).AdvanceTo(0.12)
    down = 0.5 * CONFIG.payload.across_flats_m + CONFIG.receptacle.height_m + 0.01
    down += CONFIG.arm.arm_2_m + CONFIG.effector.palm.length_m
    np.testing.assert_allclose(system.held_pose(context)[4:], [down, 0.0, 0.0], atol=1e-9)


def test_a_voltage_between_levels_is_refused_by_name():
    system, context = system_at(arm_over(STOWED))
    bad = volts(angles=arm_over(STOWED)[ANGLES])
    bad[8] = 3.3
    system.GetInputPort("channels").FixValue(context, bad)
    with pytest.raises(InputError, match=r"channel 9 = 3\.3 V"):
        Simulator(system, context).AdvanceTo(0.1)
