"""The supervisor's thresholds: the scenario's in SI, and none that make no sense."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pips_drake.errors import InputError

from .supervised_moments import CONFIG, THRESHOLDS

#: Latency and half of the half second's ramp.
STOPPING_TIME = 0.35

BAD = {
    "hold_clearance_mm": (9.0, r"supervisor.hold_clearance_mm = 9.0; must be > retract_clearance"),
    "resume_clearance_mm": (20.0, "> hold_clearance_mm"),
    "retract_clearance_mm": (-1.0, ">= 0"),
    "own_resume_clearance_mm": (5.0, "> own_hold_clearance_mm"),
    "tracking_resume_mm": (0.0, "> 0"),
    "tracking_hold_mm": (25.0, "> tracking_resume_mm"),
    "tracking_growth_mm": (-1.0, ">= 0"),
    "quiet_s": (-0.1, ">= 0"),
    "force_fraction_hold": (0.8, "> force_fraction_resume"),
    "closing_speed_mm_per_s": (-1.0, ">= 0"),
    "give_way_mm": (-1.0, ">= 0"),
    "hold_ramp_s": (0.0, "> 0"),
    "patience_s": (-1.0, ">= 0"),
    "safe_speed_fraction": (0.0, "0.01 .. 1"),
    "overtime_s": (1e6, "<= 86400"),
}


@pytest.mark.parametrize("name", sorted(BAD))
def test_thresholds_that_make_no_sense_are_refused(name):
    value, message = BAD[name]
    with pytest.raises(InputError, match=message):
        replace(CONFIG, **{name: value}).validate()


def test_thresholds_are_the_scenarios_in_si():
    assert THRESHOLDS.hold_clearance == pytest.approx(0.020)
    assert THRESHOLDS.stopping_time == pytest.approx(STOPPING_TIME)
    assert THRESHOLDS.tracking_growth == pytest.approx(0.020)
    assert (THRESHOLDS.quiet_time, THRESHOLDS.patience) == (0.5, 5.0)
