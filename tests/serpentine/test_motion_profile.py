"""The profile's speed is the derivative of its travel, and its acceleration has no jump."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from pips_drake.errors import InputError
from pips_drake.serpentine.motion_profile import RestToRestProfile

PROFILES = [
    pytest.param(RestToRestProfile.make(travel=2.2, speed=0.025, ramp=2.0), id="long"),
    pytest.param(RestToRestProfile.make(travel=0.05, speed=0.025, ramp=2.0), id="barely full"),
    pytest.param(RestToRestProfile.make(travel=0.01, speed=0.025, ramp=2.0), id="short"),
]


def values(profile, times):
    return np.array([profile(time) for time in times]).T


@pytest.mark.parametrize("profile", PROFILES)
def test_it_starts_and_ends_at_rest(profile):
    assert profile(0.0) == (0.0, 0.0)
    assert profile(-1.0) == (0.0, 0.0)
    assert profile(profile.duration) == (profile.travel, 0.0)
    assert profile(profile.duration + 1.0) == (profile.travel, 0.0)


@pytest.mark.parametrize("profile", PROFILES)
def test_the_integral_of_speed_is_the_travel(profile):
    corners = [profile.ramp, profile.duration - profile.ramp]
    integral, _ = quad(
        lambda t: profile(t)[1], 0.0, profile.duration, points=corners, epsabs=0.0, epsrel=1e-13
    )
    # Gauss-Kronrod is exact for the cubic pieces: roundings of a sum.
    assert integral == pytest.approx(profile.travel, rel=1e-12)


@pytest.mark.parametrize("profile", PROFILES)
def test_speed_is_the_derivative_of_travel(profile):
    times, step = np.linspace(0.0, profile.duration, 997), 1e-4 * profile.ramp
    ahead, behind = values(profile, times + step)[0], values(profile, times - step)[0]
    # Central differences: step^2 / 6 of s''' <= 6 speed / ramp^2 where they lie within a piece, as
    # much again where s''' jumps; and roundings of the travel over the step.
    bound = 2e-8 * profile.speed + 2e-16 * profile.travel / step
    np.testing.assert_allclose(
        (ahead - behind) / (2.0 * step), values(profile, times)[1], rtol=0, atol=bound
    )


@pytest.mark.parametrize("profile", PROFILES)
def test_acceleration_has_no_jump_and_peaks_at_1_5_speed_over_ramp(profile):
    peak = 1.5 * profile.speed / profile.ramp
    jumps = []
    for count in (1001, 4001):
        times = np.linspace(-0.1 * profile.ramp, profile.duration + 0.1 * profile.ramp, count)
        acceleration = np.gradient(values(profile, times)[1], times)
        assert np.abs(acceleration).max() <= peak * (1.0 + 1e-9)
        jumps.append(np.abs(np.diff(acceleration)).max())
        # The steepest acceleration changes by 6 speed / ramp^2 a second.
        assert jumps[-1] <= 6.0 * profile.speed / profile.ramp**2 * np.diff(times)[0] * (1 + 1e-6)
    # So steps of acceleration vanish with the step of time: no jump.
    assert jumps[1] == pytest.approx(jumps[0] / 4.0, rel=0.3)
    # Mid-ramp the peak is reached.
    step = 1e-4 * profile.ramp
    ahead, behind = profile(0.5 * profile.ramp + step)[1], profile(0.5 * profile.ramp - step)[1]
    assert (ahead - behind) / (2.0 * step) == pytest.approx(peak, rel=1e-7)


def test_full_speed_is_kept_between_the_ramps():
    profile = RestToRestProfile.make(travel=2.2, speed=0.025, ramp=2.0)
    _, speeds = values(profile, np.linspace(2.0, profile.duration - 2.0, 50))
    np.testing.assert_array_equal(speeds, 0.025)
    assert profile.duration == pytest.approx(2.2 / 0.025 + 2.0, rel=1e-15)


def test_a_short_travel_lowers_the_speed_and_not_the_ramps():
    profile = RestToRestProfile.make(travel=0.01, speed=0.025, ramp=2.0)
    assert profile.duration == pytest.approx(2.0 * profile.ramp, rel=1e-15)
    # Two ramps at mean speed one half: travel = speed ramp.
    assert profile(profile.ramp)[1] == pytest.approx(0.01 / 2.0, rel=1e-15)


@given(
    travel=st.floats(1e-6, 100.0),
    speed=st.floats(1e-6, 10.0),
    ramp=st.floats(1e-3, 100.0),
    fraction=st.floats(0.0, 1.0),
)
def test_there_and_back_look_alike(travel, speed, ramp, fraction):
    profile = RestToRestProfile.make(travel=travel, speed=speed, ramp=ramp)
    time = fraction * profile.duration
    (there, speed_there), (back, speed_back) = profile(time), profile(profile.duration - time)
    # duration - time has roundings of the duration, times the speed, or acceleration.
    slack = 1e-13 * profile.duration
    assert there + back == pytest.approx(travel, abs=slack * profile.speed + 1e-13 * travel)
    assert speed_there == pytest.approx(
        speed_back, abs=1.5 * slack * profile.speed / ramp + 1e-15 * profile.speed
    )
    assert 0.0 <= there <= travel * (1.0 + 1e-15)
    assert 0.0 <= speed_there <= min(speed, profile.speed) * (1.0 + 1e-15)


@pytest.mark.parametrize("name", ["travel", "speed", "ramp"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_what_is_not_positive_is_refused_by_name(name, value):
    given = {"travel": 1.0, "speed": 1.0, "ramp": 1.0} | {name: value}
    with pytest.raises(InputError, match=rf"RestToRestProfile: {name} = .*; must be > 0"):
        RestToRestProfile.make(**given)
