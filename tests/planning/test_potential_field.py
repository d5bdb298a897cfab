"""Repulsion: its force is its energy's slope, it ends at its reach and never blows up."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.planning.potential_field import Repulsion

REPULSION = Repulsion(strength=0.3, reach=0.4, clamp=0.05)
DISTANCES = np.linspace(-0.2, 0.6, 801)


def test_the_energy_is_eq_16_between_clamp_and_reach():
    for r in (0.051, 0.1, 0.2, 0.399):
        expected = 0.15 * (1.0 / r - 2.5) ** 2
        assert REPULSION.energy(np.array([r]))[0] == pytest.approx(expected, rel=1e-14)


def test_force_and_stiffness_are_numeric_derivatives_of_the_energy():
    h = 1e-6
    # Not across the clamp and the reach, where the slope of the force leaps.
    r = DISTANCES
    for edge in (REPULSION.clamp, REPULSION.reach):
        r = r[np.abs(r - edge) > 2.0 * h]
    slope = (REPULSION.energy(r + h) - REPULSION.energy(r - h)) / (2.0 * h)
    # Differences of energies of 30 N: rounding 1e-15 * 30 / 1e-6 and a third derivative times h^2.
    np.testing.assert_allclose(-REPULSION.push(r), slope, rtol=1e-8, atol=1e-7)
    inside = r[r > REPULSION.clamp]
    slope = (REPULSION.push(inside + h) - REPULSION.push(inside - h)) / (2.0 * h)
    np.testing.assert_allclose(-REPULSION.stiffness(inside), slope, rtol=1e-8, atol=1e-5)


def test_nothing_is_felt_beyond_the_reach():
    far = np.array([0.4, 0.5, 100.0])
    for function in (REPULSION.energy, REPULSION.push, REPULSION.stiffness):
        np.testing.assert_array_equal(function(far), 0.0)


def test_inside_an_obstacle_the_force_is_that_at_the_clamp_and_leads_out():
    clamp = REPULSION.push(np.array([REPULSION.clamp]))[0]
    np.testing.assert_array_equal(REPULSION.push(np.array([0.04, 0.0, -3.0])), clamp)
    assert clamp > 0.0
    energy = REPULSION.energy(np.array([-3.0, -1.0, 0.0, 0.05]))
    assert (np.diff(energy) < 0.0).all()
    # A straight line: equal falls for equal ways.
    assert energy[0] - energy[1] == pytest.approx(2.0 * clamp, rel=1e-12)


def test_the_stiffness_bounds_the_slope_of_the_force_wherever_it_is_nearer_than_that():
    """What the snake's step relies on: U'' falls with the distance."""
    stiffness = REPULSION.stiffness(DISTANCES)
    assert (np.diff(stiffness) <= 0.0).all()


@pytest.mark.parametrize(
    "wrong",
    [
        {"strength": 0.0},
        {"strength": math.nan},
        {"reach": math.inf},
        {"clamp": -0.1},
        {"clamp": 0.4},
    ],
)
def test_numbers_that_mean_nothing_are_refused(wrong):
    name = next(iter(wrong))
    with pytest.raises(InputError, match=f"repulsion {name} = "):
        Repulsion(**({"strength": 0.3, "reach": 0.4, "clamp": 0.05} | wrong))
