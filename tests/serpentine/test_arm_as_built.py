"""An arm that is not built as plan and controllers believe: where it then stands.

Independent: FTL-95's matrices with the printed table, and the law of cosines.
"""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.config import load_yaml
from pips_drake.errors import InputError, UnknownNameError
from pips_drake.scene.packages import find_arm_file
from pips_drake.serpentine.arm_file import ArmFile
from pips_drake.serpentine.fault_config import FaultConfig
from pips_drake.serpentine.runs.assessment import Assessment
from pips_drake.serpentine.runs.run import run_station
from pips_drake.serpentine.station import (
    MakeSerpentineStation,
    MakeSimulator,
    built_arm,
    load_setup,
)
from pips_drake.serpentine.systems.tip_path_source import HOLD
from pips_drake.serpentine.tolerances import arm_as_built
from pips_drake.serpentine.truss import actuator_pins

from .station_bench import INCH, scenario

SEGMENT = FaultConfig(kind="segment_length", segment=3, size=15.0)
ANCHOR = FaultConfig(kind="anchor", drive="L8", size=3.0)
#: README of the prototype: L8 is a large box's, its pins 9 in from the hinge and 90 deg apart.
PIN, L8 = 9.0 * INCH, 7
#: How far a standing joint may be from where its drive is sent, rad. The sag of the sag, which is
#: not compensated, is 1e-3 of 0.2 deg; the truss's loops give way too (docs: within 0.1 deg).
LEFT_RAD = {"joint": np.radians(2e-3), "leg": np.radians(2e-3), "truss": np.radians(0.02)}


@pytest.fixture(scope="module")
def config() -> ArmFile:
    return load_yaml(ArmFile, find_arm_file("prototype"))


def angle_of_l8(believed: float) -> float:
    """The hinge's angle, rad, where the actuator has the length of the believed one."""
    outer = PIN + 3e-3
    squared = 2.0 * PIN**2 * (1.0 - np.cos(np.pi / 2.0 + believed))
    return float(np.arccos((PIN**2 + outer**2 - squared) / (2.0 * PIN * outer)) - np.pi / 2.0)


def test_a_longer_segment_is_a_longer_box_and_nothing_else(arm, config):
    built = arm_as_built(config, [SEGMENT, FaultConfig(kind="late")])
    longer = np.zeros(8)
    longer[2] = 15e-3
    assert built.segment_length - arm.segment_length == pytest.approx(longer, abs=1e-15)
    assert built.segment_offset.tolist() == arm.segment_offset.tolist()
    for body, other in zip(arm.bodies, built.bodies, strict=True):
        more = 15e-3 if body.name == "segment_3" else 0.0
        assert other.size - body.size == pytest.approx([more, 0.0, 0.0], abs=1e-15)
        assert other.centre - body.centre == pytest.approx([0.5 * more, 0.0, 0.0], abs=1e-15)
        assert other.mass == body.mass


def test_the_first_segment_is_the_bases_too(arm, config):
    built = arm_as_built(config, [FaultConfig(kind="segment_length", segment=1, size=-15.0)])
    assert built.base.parameters - arm.base.parameters == pytest.approx([0, 0, 0, 0, -15e-3])


def test_a_pin_elsewhere_leaves_the_actuator_its_stroke_and_turns_the_hinge(arm, config):
    built = arm_as_built(config, [ANCHOR])
    assert built.linkage.length_lower.tolist() == arm.linkage.length_lower.tolist()
    assert built.linkage.length_upper.tolist() == arm.linkage.length_upper.tolist()
    (inner, outer), (inner_before, outer_before) = actuator_pins(built), actuator_pins(arm)
    np.testing.assert_array_equal(inner, inner_before)
    moved = np.linalg.norm(outer - outer_before, axis=1)
    assert moved == pytest.approx(np.where(np.arange(16) == L8 - 2, 3e-3, 0.0), abs=1e-15)
    for believed in (-0.4, 0.0, 0.4):
        length = arm.linkage.length(np.full(16, believed))
        found = built.linkage.angle(length)[L8 - 2]
        assert found == pytest.approx(angle_of_l8(believed), abs=1e-14)
        assert abs(found - believed) > 5e-3


@pytest.mark.parametrize(
    ("fault", "error", "text"),
    [
        (FaultConfig(kind="segment_length", segment=9, size=1.0), InputError, "must be 1 .. 8"),
        (
            FaultConfig(kind="segment_length", segment=8, size=-400.0),
            InputError,
            "segment 8, m = -",
        ),
        (
            FaultConfig(kind="anchor", drive="theta8", size=1.0),
            UnknownNameError,
            "actuator 'theta8'",
        ),
        (FaultConfig(kind="anchor", drive="L8", size=250.0), InputError, "L8, 478.6 mm from"),
        (FaultConfig(kind="anchor", drive="L8", size=-230.0), InputError, "must close a triangle"),
    ],
)
def test_an_arm_that_cannot_be_is_refused(config, fault, error, text):
    with pytest.raises(error, match=text):
        arm_as_built(config, [fault])


def test_only_what_is_loaded_from_a_file_is_built_otherwise():
    setup = load_setup(scenario())
    assert built_arm(setup, [FaultConfig(kind="jam", drive="L3")]) is setup.arm


def standing(fidelity: str, faults: list[FaultConfig]):
    """Believed and real joints (18,) of a station held at home, and its tip in frame 0, (3,) m."""
    made = scenario(actuation__fidelity=fidelity, faults=faults)
    setup = load_setup(made)
    station = MakeSerpentineStation(made, setup=setup)
    simulator = MakeSimulator(station, made)
    context = simulator.get_mutable_context()
    station.GetInputPort("tip_path_source.command").FixValue(context, [HOLD])
    simulator.AdvanceTo(0.125)
    plant = station.GetSubsystemByName("plant")
    mine = plant.GetMyContextFromRoot(context)
    tip = plant.GetBodyByName("camera_head").body_frame()
    X_0T = tip.CalcPose(mine, plant.GetFrameByName("frame_0"))
    wanted, real = (
        station.GetOutputPort(port).Eval(context)[:18]
        for port in ("follow_the_leader.joint_state", "plant.state")
    )
    return np.array(wanted), np.array(real), X_0T.translation()


@pytest.mark.parametrize("fidelity", ["joint", "leg", "truss"])
def test_a_longer_segment_takes_the_tip_where_the_longer_chain_ends(
    report_frames, table_a1, fidelity
):
    wanted, real, tip = standing(fidelity, [SEGMENT])
    np.testing.assert_allclose(real[1:], wanted[1:], rtol=0, atol=LEFT_RAD[fidelity])
    longer = table_a1.copy()
    row = 7  # Table A.1: S_3 stands in joint 8's row
    assert longer[row, 1] == pytest.approx(20.035 * INCH)
    longer[row, 1] += 15e-3
    # Roundings of products of 18 matrices; the arm is a chain in every fidelity.
    np.testing.assert_allclose(tip, report_frames(longer, real)[-1][:3, 3], rtol=0, atol=1e-12)
    believed = report_frames(table_a1, wanted)[-1][:3, 3]
    # The rest of the 3 m to the tip turns with what is left of the hinges' angles.
    assert np.linalg.norm(tip - believed) == pytest.approx(15e-3, abs=3.0 * LEFT_RAD[fidelity])


@pytest.mark.parametrize("fidelity", ["joint", "leg", "truss"])
def test_an_actuator_goes_to_the_believed_length_and_holds_another_angle(
    report_frames, table_a1, fidelity
):
    wanted, real, tip = standing(fidelity, [ANCHOR])
    expected = wanted.copy()
    expected[L8] = angle_of_l8(wanted[L8])
    assert abs(expected[L8] - wanted[L8]) > 5e-3
    np.testing.assert_allclose(real[1:], expected[1:], rtol=0, atol=LEFT_RAD[fidelity])
    np.testing.assert_allclose(tip, report_frames(table_a1, real)[-1][:3, 3], rtol=0, atol=1e-12)


def test_a_run_says_where_the_real_tip_is_and_what_the_real_actuators_do(report_frames, table_a1):
    made = scenario(faults=[SEGMENT, ANCHOR], duration_s=0.125)
    setup = load_setup(made)
    data = run_station(made, setup).data
    found = Assessment.of(made, setup, data)
    longer = table_a1.copy()
    longer[7, 1] += 15e-3
    error = [
        np.linalg.norm(report_frames(longer, q)[-1][:3, 3] - report_frames(table_a1, c)[-1][:3, 3])
        for q, c in zip(data.joints, data.commanded_joints, strict=True)
    ]
    assert found.summary()["tip_error_max_m"] == pytest.approx(max(error), abs=1e-9)
    assert any("spine point 18 is" in text for text in found.failures())

    def length(angle):
        outer = PIN + 3e-3
        return np.sqrt(PIN**2 + outer**2 - 2.0 * PIN * outer * np.cos(np.pi / 2.0 + angle))

    angle, torque, step = data.joints[1:, L8], data.joint_efforts[1:, L8], 1e-6
    coordinates, efforts = found.drive_coordinates[1:, L8], found.drive_efforts[1:, L8]
    np.testing.assert_allclose(coordinates, length(angle), rtol=1e-13)
    lever = (length(angle + step) - length(angle - step)) / (2.0 * step)
    # Differences over 1e-6 rad of lengths of 0.3 m with 16 digits.
    np.testing.assert_allclose(efforts, torque / lever, rtol=1e-8)
    # What the believed linkage would say: half a per cent away, and more.
    believed = found.arm.linkage.lever(data.joints[1:, 2:])[:, L8 - 2]
    assert np.abs(efforts * believed / torque - 1.0).min() > 5e-3
