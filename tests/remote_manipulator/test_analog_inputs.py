"""The operator's channels mean what Table I says; what it does not say is refused."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pips_drake.errors import InputError
from pips_drake.remote_manipulator.analog_inputs import (
    AngleScaling,
    angle_scaling,
    decode_channels,
    decode_frame,
    encode_channels,
    encode_frame,
)
from pips_drake.remote_manipulator.configuration import load_configuration
from pips_drake.remote_manipulator.operator_inputs import (
    FIELDS,
    INITIALIZE_SELECTS,
    OperatorInputs,
    frames_of,
)

SCALING = angle_scaling(load_configuration().arm)
#: RMS-71, Table I, in parts of the full scale; misprints of a half mended. Then what is assumed.
TABLE_1 = (
    (1, "initialize", {0.0: False, 1.0: True}),
    (2, "initialize_select", {0.0: "full", 1.0: "mode_1", -1.0: "mode_2_or_3"}),
    (9, "telescope", {0.0: 0, 1.0: 1, -1.0: -1}),
    (10, "pan", {1.0: 1, 0.5: -1, 0.0: 0, -0.5: 0, -1.0: 0}),
    (10, "tilt", {1.0: 0, 0.5: 0, 0.0: 0, -0.5: 1, -1.0: -1}),
    (11, "zoom", {0.0: 0, 1.0: 1, -1.0: -1}),
    (12, "station", {1.0: "A", 0.75: "B", 0.5: "C", 0.25: "D", 0.0: "E"}),
    (12, "station", {-0.25: "F", -0.5: "G", -1.0: "H"}),
    (12, "station", {-0.75: "I", 0.875: "J", 0.625: "K", 0.375: "L", 0.125: "M"}),
    (13, "prong", {0.0: 0, 1.0: 1, -1.0: -1}),
    (14, "shuttle", {1.0: (1, 0, 0), -1.0: (-1, 0, 0)}),
    (15, "shuttle", {1.0: (0, 1, 0), -1.0: (0, -1, 0)}),
    (16, "shuttle", {1.0: (0, 0, 1), -1.0: (0, 0, -1), 0.0: (0, 0, 0)}),
    (17, "open_latch", {0.0: False, -1.0: True}),
)
LEVELS = [
    pytest.param(channel, field, part, meaning, id=f"{channel}: {part:+g} V is {field} {meaning}")
    for channel, field, levels in TABLE_1
    for part, meaning in levels.items()
]


def channels(**volts: float) -> np.ndarray:
    """17 channels at 0 V but those that are named, c1 to c17."""
    frame = np.zeros(17)
    for name, value in volts.items():
        frame[int(name[1:]) - 1] = value
    return frame


@pytest.mark.parametrize(("channel", "field", "part", "meaning"), LEVELS)
def test_a_level_means_what_the_table_says_and_is_what_is_sent(channel, field, part, meaning):
    volts = channels(**{f"c{channel}": 10.0 * part})
    inputs = decode_frame(volts, SCALING)
    assert getattr(inputs, field) == meaning
    assert encode_frame(inputs, SCALING)[channel - 1] == volts[channel - 1]


@pytest.mark.parametrize("full_scale", [10.0, 5.0, 100.0])
def test_levels_scale_with_the_full_scale_and_are_meant_within_the_dead_band(full_scale):
    scaling = angle_scaling(load_configuration().arm, full_scale)
    for channel, field, levels in TABLE_1:
        for part, meaning in levels.items():
            for noise in (-0.0499, 0.0499):
                volts = channels(**{f"c{channel}": full_scale * (part + noise)})
                assert getattr(decode_frame(volts, scaling), field) == meaning


def levels_of(channel: int) -> list[float]:
    return [10.0 * part for c, _, levels in TABLE_1 for part in levels if c == channel]


@pytest.mark.parametrize("channel", [1, 2, 9, 10, 11, 12, 13, 14, 15, 16, 17])
def test_a_voltage_between_levels_is_refused_with_channel_and_volts(channel):
    legal = np.array([*levels_of(channel), 0.0])
    refused = 0
    for volts in np.arange(-12.0, 12.0, 0.0625):
        near = np.abs(volts - legal).min()
        frame = channels(**{f"c{channel}": volts})
        if near < 0.5:
            decode_frame(frame, SCALING)
        elif near > 0.5:
            refused += 1
            with pytest.raises(InputError, match=rf"^channel {channel} = {volts:g} V; must be "):
                decode_frame(frame, SCALING)
    assert refused > 40


def test_the_message_lists_the_levels_of_the_channel():
    frames = np.array([channels(), channels(c10=2.5)])
    message = "frame 2: channel 10 = 2.5 V; must be within 0.5 V of -10, -5, 0, 5, 10"
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        decode_channels(frames, SCALING)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize("channel", range(1, 18))
def test_no_channel_takes_what_is_no_voltage(channel, value):
    with pytest.raises(InputError, match=rf"^channel {channel} = .* V; must be"):
        decode_frame(channels(**{f"c{channel}": value}), SCALING)


def test_the_first_wrong_channel_of_the_first_wrong_frame_is_named():
    frames = np.array([channels(), channels(c13=3.0, c5=11.0), channels(c1=5.0)])
    with pytest.raises(InputError, match=r"^frame 2: channel 5 = 11 V; must be within \+-10 V"):
        decode_channels(frames, SCALING)


def test_full_scale_is_half_a_turn_and_447_degrees_of_roll():
    volts = channels(c3=10.0, c4=-10.0, c5=5.0, c6=2.5, c7=-5.0, c8=10.0)
    angles = decode_frame(volts, SCALING).angles
    # Three roundings.
    np.testing.assert_allclose(np.degrees(angles), [180.0, -180.0, 90.0, 45.0, -90.0, 447.0], 1e-15)


@pytest.mark.parametrize("column", range(6))
def test_an_angle_beyond_full_scale_is_refused_both_ways(column):
    volts = channels(**{f"c{column + 3}": -10.001})
    with pytest.raises(InputError, match=rf"^channel {column + 3} = -10.001 V; must be within"):
        decode_frame(volts, SCALING)
    angles = np.zeros(6)
    angles[column] = 1.001 * SCALING.largest_angles[column]
    joint = ("H0", "P0", "P1", "H2", "P2", "R2")[column]
    with pytest.raises(InputError, match=rf"^{joint} = .* deg; must be within .*{column + 3}$"):
        encode_frame(OperatorInputs(angles=angles), SCALING)
    angles[column] = np.nan
    with pytest.raises(InputError, match=rf"^{joint} = nan deg"):
        encode_frame(OperatorInputs(angles=angles), SCALING)


def test_every_angle_that_the_arm_can_have_can_be_sent():
    arm = load_configuration().arm
    for angles in (arm.lower, arm.upper):
        sent = encode_frame(OperatorInputs(angles=angles), SCALING)
        # Two roundings.
        np.testing.assert_allclose(decode_frame(sent, SCALING).angles, angles, rtol=5e-16)


def every_input() -> list[OperatorInputs]:
    """All combinations of channels 1, 2, 9 to 13 and 17, with the others along."""
    cameras = ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
    turns = itertools.product((0, 1), INITIALIZE_SELECTS, (-1, 0, 1), cameras, (-1, 0, 1))
    shuttles = itertools.cycle(itertools.product((-1, 0, 1), repeat=3))
    rng = np.random.default_rng(1)
    return [
        OperatorInputs(
            angles=rng.uniform(-1.0, 1.0, 6) * SCALING.largest_angles,
            initialize=bool(initialize),
            initialize_select=select,
            telescope=telescope,
            pan=camera[0],
            tilt=camera[1],
            zoom=zoom,
            station=station,
            prong=prong,
            shuttle=shuttle,
            open_latch=latch,
        )
        for (initialize, select, telescope, camera, zoom), shuttle in zip(
            turns, shuttles, strict=False
        )
        for station in "ABCDEFGHIJKLM"
        for prong in (-1, 0, 1)
        for latch in (False, True)
    ]


def test_every_legal_input_round_trips():
    inputs = every_input()
    assert len(inputs) == 2 * 3 * 3 * 5 * 3 * 13 * 3 * 2
    frames = frames_of(inputs)
    volts = encode_channels(frames, SCALING)
    back = decode_channels(volts, SCALING)
    np.testing.assert_array_equal(back.switches, frames.switches)
    np.testing.assert_allclose(back.angles, frames.angles, rtol=5e-16)  # two roundings
    assert len(np.unique(volts[:, [0, 1, 8, 9, 10, 11, 12, 16]], axis=0)) == len(inputs)
    for row in range(0, len(inputs), 997):
        one, given_one = back.frame(row), inputs[row]
        for name in ("initialize", "initialize_select", "station", "shuttle", "open_latch"):
            assert getattr(one, name) == getattr(given_one, name)


@pytest.mark.parametrize("count", [13, 16])
def test_channels_that_are_not_there_are_off(count):
    volts = channels(c9=10.0, c13=-10.0)[np.newaxis, :count]
    (row,) = decode_channels(volts, SCALING).switches
    expected = dict.fromkeys(FIELDS, 0) | {"telescope": 1, "prong": -1, "station": 4}
    assert dict(zip(FIELDS, row, strict=True)) == expected


@pytest.mark.parametrize("shape", [(13,), (2, 12), (2, 14), (2, 18), (1, 2, 13)])
def test_another_number_of_channels_is_refused(shape):
    with pytest.raises(InputError, match=rf"^channels: shape = {re.escape(str(shape))}"):
        decode_channels(np.zeros(shape), SCALING)


def test_no_frames_are_no_inputs():
    assert len(decode_channels(np.zeros((0, 13)), SCALING)) == 0
    assert encode_channels(frames_of([]), SCALING).shape == (0, 17)


@given(channel=st.integers(1, 17), volts=st.floats(-11.0, 11.0))
@settings(max_examples=200, derandomize=True, deadline=None)
def test_what_is_understood_is_what_would_be_sent(channel, volts):
    """A voltage is either refused or within the dead band of what its meaning is sent as."""
    frame = channels(**{f"c{channel}": volts})
    try:
        inputs = decode_frame(frame, SCALING)
    except InputError:
        return
    tolerance = 1e-14 if 3 <= channel <= 8 else 0.5 + 1e-12  # angles have no levels
    np.testing.assert_allclose(encode_frame(inputs, SCALING), frame, rtol=0.0, atol=tolerance)


BAD_INPUTS = {
    "telescope = 2; must be -1, 0 or 1": {"telescope": 2},
    "pan and tilt together; they share a channel": {"pan": 1, "tilt": -1},
    "shuttle = (0, 0); must be three of -1, 0 or 1": {"shuttle": (0, 0)},
    "shuttle = (0, 2, 0); must be three of -1, 0 or 1": {"shuttle": (0, 2, 0)},
    "unknown camera station 'N'": {"station": "N"},
    "unknown camera station 'AB'": {"station": "AB"},
    "unknown camera station ''": {"station": ""},
    "unknown initialize_select 'mode_4'": {"initialize_select": "mode_4"},
    "angles: shape = (5,); must be (6,)": {"angles": np.zeros(5)},
}


@pytest.mark.parametrize("message", BAD_INPUTS)
def test_inputs_that_no_operator_can_give_are_refused(message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        OperatorInputs(**({"angles": np.zeros(6)} | BAD_INPUTS[message]))


BAD_SCALINGS = {
    "AngleScaling.full_scale = 0.0 V": {"full_scale": 0.0},
    "AngleScaling.full_scale = nan V": {"full_scale": np.nan},
    "AngleScaling.dead_band = 0.0625": {"dead_band": 0.0625},
    "AngleScaling.dead_band = 0.0;": {"dead_band": 0.0},
    "AngleScaling.radians_per_volt = [0.0": {"radians_per_volt": np.zeros(6)},
    "AngleScaling.radians_per_volt = [1.0, 1.0]": {"radians_per_volt": np.ones(2)},
}


@pytest.mark.parametrize("message", BAD_SCALINGS)
def test_adjustments_that_make_no_sense_are_refused(message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        AngleScaling(**({"radians_per_volt": np.ones(6)} | BAD_SCALINGS[message]))
