"""The fastest motion: closed forms, a bound that nothing beats, symmetries, and its profile."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pips_drake.errors import InputError, NotFollowableError
from pips_drake.serpentine.time_optimal import (
    TimeOptimalProfile,
    TravelLimits,
    binding_limits,
    binding_segments,
    fastest_squared_speed,
    travel_time,
)

from .least_duration import least_duration


def make_limits(travel, *, speed=10.0, bands=()):
    """Limits from a speed bound and bands (slope, curve, offset): numbers, or functions of s."""
    middle = 0.5 * (travel[1:] + travel[:-1])

    def on(where, value):
        return np.broadcast_to(value(where) if callable(value) else value, where.shape)

    rows = [np.column_stack([on(middle, band[k]) for band in bands]) for k in range(3)]
    return TravelLimits(
        travel=travel,
        speed=on(travel, speed)[:, None].astype(float),
        slope=rows[0].astype(float),
        curve=rows[1].astype(float),
        offset=rows[2].astype(float),
        names=("speed", *(f"band {k}" for k in range(len(bands)))),
    )


def duration(limits, x):
    return travel_time(limits.travel, x)[-1]


def random_limits(seed, count=150):
    """Smooth random bands along 2 m, some with sign changes of slope and curve."""
    rng = np.random.default_rng(seed)

    def wave(scale):
        c, k, phase = scale * rng.normal(size=3), rng.uniform(1, 6, 3), rng.uniform(0, 6, 3)
        return lambda s: sum(
            ci * np.sin(ki * s + pi) for ci, ki, pi in zip(c, k, phase, strict=True)
        )

    bands = [(wave(1.0), wave(3.0), (lambda w: lambda s: 0.8 * np.tanh(w(s)))(wave(0.5)))]
    bands += [(wave(1.0), wave(2.0), 0.0) for _ in range(4)]
    bound = wave(0.3)
    travel = np.linspace(0.0, 2.0, count + 1)
    return make_limits(travel, speed=lambda s: 0.3 + np.abs(bound(s)), bands=bands)


GRID = np.linspace(0.0, 2.0, 201)


def test_a_mass_with_a_force_limit_goes_bang_bang():
    limits = make_limits(GRID, bands=[(1.0 / 3.0, 0.0, 0.0)])
    x = fastest_squared_speed(limits)
    # x = 2 a s is linear, as the grid's motions are: exact but for roundings.
    np.testing.assert_allclose(x, 6.0 * np.minimum(GRID, 2.0 - GRID), rtol=1e-12, atol=1e-12)
    assert duration(limits, x) == pytest.approx(2.0 * math.sqrt(2.0 / 3.0), rel=1e-12)


def test_with_a_speed_limit_it_cruises():
    limits = make_limits(GRID, speed=1.0, bands=[(1.0 / 2.0, 0.0, 0.0)])
    x = fastest_squared_speed(limits)
    # a = 2, v = 1: a quarter metre to reach speed (on the grid), so v / a + L / v.
    assert duration(limits, x) == pytest.approx(1.0 / 2.0 + 2.0 / 1.0, rel=1e-12)
    which, used = binding_limits(limits, x)
    np.testing.assert_allclose(used, 1.0, rtol=1e-12)
    segments = binding_segments(limits, x, which)
    assert [segment.name for segment in segments] == ["band 0", "speed", "band 0"]
    assert segments[1].start == pytest.approx(0.25)
    assert segments[1].end == pytest.approx(1.75)
    assert [segment.duration for segment in segments] == pytest.approx([0.5, 1.5, 0.5])


def test_weight_makes_starting_slow_and_stopping_fast():
    """A lift with force 1 and weight 0.5 of it: a = 0.5 up; the brakes have 1.5."""
    limits = make_limits(GRID, bands=[(1.0, 0.0, 0.5)])
    x = fastest_squared_speed(limits)
    # 2 (0.5) s = 2 (1.5) (2 - s) at s = 1.5, which is a point of the grid.
    np.testing.assert_allclose(x, np.minimum(GRID, 3.0 * (2.0 - GRID)), rtol=1e-12, atol=1e-12)


def test_the_error_falls_with_the_square_of_the_grid():
    """u + k x <= 1 makes x = (1 - exp(-2 k s)) / k; both ends alike when the band is -1 .. 1."""
    k, errors = 1.5, []
    for count in (50, 100, 200):
        travel = np.linspace(0.0, 2.0, count + 1)
        x = fastest_squared_speed(make_limits(travel, bands=[(1.0, k, 0.0)]))
        rising = travel < 0.5  # long before the brakes
        exact = (1.0 - np.exp(-2.0 * k * travel)) / k
        errors.append(np.abs(x - exact)[rising].max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    # The implicit midpoint rule is of second order.
    np.testing.assert_allclose(rates, 2.0, atol=0.1)


@pytest.mark.parametrize("seed", range(12))
def test_nothing_is_faster(seed):
    limits = random_limits(seed)
    x = fastest_squared_speed(limits)
    assert np.abs(limits.band_values(x)).max() <= 1.0 + 1e-9
    assert np.all(x <= limits.speed_bound**2 * (1.0 + 1e-12))
    # The two passes are greedy point by point; where a band's slope vanishes, a little less at one
    # point may buy more at the next, so optimal is proved up to this.
    assert duration(limits, x) <= 1.01 * least_duration(limits, x)


@pytest.mark.parametrize("seed", range(4))
def test_the_bound_rises_above_a_motion_that_is_not_the_fastest(seed):
    """Checks the check: a slower motion is told from the fastest."""
    limits = random_limits(seed)
    x = fastest_squared_speed(limits)
    assert duration(limits, 0.9 * x) > 1.02 * least_duration(limits, 0.9 * x)


@pytest.mark.parametrize("seed", range(4))
def test_nearly_every_interval_is_at_a_limit(seed):
    limits = random_limits(seed)
    _, used = binding_limits(limits, fastest_squared_speed(limits))
    # Not where one limit hands over to another inside an interval.
    assert np.mean(used > 1.0 - 1e-9) > 0.9


@pytest.mark.parametrize("seed", range(4))
def test_the_way_back_is_the_same_motion_backwards(seed):
    limits = random_limits(seed)
    back = TravelLimits(
        travel=limits.travel,
        speed=limits.speed[::-1],
        slope=-limits.slope[::-1],
        curve=limits.curve[::-1],
        offset=limits.offset[::-1],
        names=limits.names,
    )
    there, back_again = fastest_squared_speed(limits), fastest_squared_speed(back)
    # One is found by its second pass where the other is by its first. They agree to what greed
    # loses where slopes vanish (see above).
    assert duration(limits, there) == pytest.approx(duration(back, back_again), rel=0.01)


@given(factor=st.floats(0.1, 10.0), seed=st.integers(0, 20))
def test_another_unit_of_time_or_length_changes_nothing_else(factor, seed):
    limits = random_limits(seed, count=60)
    x = fastest_squared_speed(limits)
    quicker = TravelLimits(
        travel=limits.travel,
        speed=factor * limits.speed,
        slope=limits.slope / factor**2,
        curve=limits.curve / factor**2,
        offset=limits.offset,
        names=limits.names,
    )
    longer = TravelLimits(
        travel=factor * limits.travel,
        speed=factor * limits.speed,
        slope=limits.slope / factor,
        curve=limits.curve / factor**2,
        offset=limits.offset,
        names=limits.names,
    )
    # Roundings of a hundred steps, each of which divides by slopes that may be small.
    for other in (quicker, longer):
        np.testing.assert_allclose(
            fastest_squared_speed(other), factor**2 * x, rtol=1e-7, atol=1e-9 * factor**2
        )


def test_looser_limits_are_never_slower():
    limits = random_limits(3)
    looser = TravelLimits(
        travel=limits.travel,
        speed=1.1 * limits.speed,
        slope=limits.slope / 1.1,
        curve=limits.curve / 1.1,
        offset=limits.offset / 1.1,
        names=limits.names,
    )
    assert np.all(fastest_squared_speed(looser) >= fastest_squared_speed(limits) - 1e-9)


def test_what_cannot_be_held_still_is_refused_with_its_name_and_place():
    limits = make_limits(GRID, bands=[(1.0, 0.0, lambda s: np.where(s > 1.0, 1.25, 0.5))])
    with pytest.raises(NotFollowableError, match=r"at rest 1\.0000 m from home, band 0 stands at "):
        fastest_squared_speed(limits)


def test_what_stands_exactly_at_its_limit_can_still_move_down():
    """At offset 1 there is no force left to speed up with, but some to brake: nothing moves."""
    limits = make_limits(GRID, bands=[(1.0, 0.0, lambda s: np.where(s > 1.0, -1.0, 0.0))])
    x = fastest_squared_speed(limits)
    assert np.all(x >= 0.0)
    assert np.abs(limits.band_values(x)).max() <= 1.0 + 1e-9


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(travel=GRID[::-1]), "must rise from 0"),
        (dict(travel=GRID + 1.0), "must rise from 0"),
        (dict(speed=np.zeros((201, 1))), "speed: must be > 0"),
        (dict(speed=np.full((201, 1), np.nan)), "speed: must be > 0"),
        (dict(speed=np.full((201, 1), np.inf)), "nothing bounds the speed"),
        (dict(slope=np.full((200, 1), np.nan)), "must be finite"),
        (dict(curve=np.zeros((201, 1))), r"curve of shape \(201, 1\); must be \(200, 1\)"),
        (dict(names=("speed",)), "must be one a bound and a band"),
    ],
)
def test_unusable_limits_are_refused(change, message):
    good = make_limits(GRID, bands=[(1.0, 0.0, 0.0)])
    fields = {name: getattr(good, name) for name in good.__dataclass_fields__}
    with pytest.raises(InputError, match=message):
        TravelLimits(**(fields | change))


LIMITS = random_limits(5)
SQUARED = fastest_squared_speed(LIMITS)
PROFILES = [
    pytest.param(TimeOptimalProfile(points=LIMITS.travel, squared_speed=SQUARED), id="plain"),
    pytest.param(
        TimeOptimalProfile(points=LIMITS.travel, squared_speed=SQUARED, smoothing=0.5), id="smooth"
    ),
    pytest.param(
        TimeOptimalProfile(
            points=LIMITS.travel, squared_speed=SQUARED, smoothing=0.5, slowdown=1.25
        ),
        id="slowed",
    ),
    # Longer than the motion itself.
    pytest.param(
        TimeOptimalProfile(points=LIMITS.travel, squared_speed=SQUARED, smoothing=50.0), id="long"
    ),
]


@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_starts_and_ends_at_rest(profile):
    assert profile(0.0) == profile(-1.0) == (0.0, 0.0)
    assert profile(profile.duration) == profile(profile.duration + 1.0) == (2.0, 0.0)
    assert profile.travel == 2.0
    for time in (0.0, profile.duration):
        near, speed = profile(abs(time - 1e-7))
        # One ten-millionth of a second at the largest acceleration.
        assert speed == pytest.approx(0.0, abs=1e-5)
        assert near == pytest.approx(2.0 * (time > 0.0), abs=1e-9)


@pytest.mark.parametrize("profile", PROFILES)
def test_speed_is_the_derivative_of_travel_and_acceleration_that_of_speed(profile):
    rng = np.random.default_rng(2)
    time, step = rng.uniform(0.0, profile.duration, 500), 1e-6
    (s0, v0, _), (s1, v1, _) = profile.motion(time - step), profile.motion(time + step)
    _, speed, acceleration = profile.motion(time)
    # Roundings of travel over the step; half the jump of acceleration times the step.
    np.testing.assert_allclose((s1 - s0) / (2 * step), speed, rtol=0.0, atol=1e-7)
    slope = (v1 - v0) / (2 * step)
    if profile.smoothing:
        np.testing.assert_allclose(slope, acceleration, rtol=0.0, atol=1e-4)
    else:
        # Where a jump lies within the step, neither side is right: few of 500.
        assert np.mean(np.abs(slope - acceleration) < 1e-6) > 0.99


@pytest.mark.parametrize("profile", PROFILES)
def test_one_instant_and_many_agree(profile):
    times = np.linspace(-0.1, profile.duration + 0.1, 333)
    travel, speed, _ = profile.motion(times)
    one = np.array([profile(time) for time in times.tolist()])
    # Differences of integrals of some m s over the window.
    np.testing.assert_allclose(one, np.column_stack([travel, speed]), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("profile", PROFILES)
def test_the_integral_of_speed_is_the_travel(profile):
    time = np.linspace(0.0, profile.duration, 100_001)
    # The trapezoidal rule on pieces of lines and parabolas.
    assert np.trapezoid(profile.motion(time)[1], time) == pytest.approx(profile.travel, rel=1e-7)


def test_smoothing_makes_the_acceleration_continuous():
    plain, smooth = (param.values[0] for param in PROFILES[:2])
    peak = np.abs(np.diff(plain.squared_speed) / (2.0 * np.diff(plain.points))).max()
    steps = []
    for count in (2000, 8000):
        time = np.linspace(-0.1, smooth.duration + 0.1, count)
        acceleration = smooth.motion(time)[2]
        assert np.abs(acceleration).max() <= peak * (1.0 + 1e-9)
        steps.append(np.abs(np.diff(acceleration)).max())
        # At most 2 / w times the largest acceleration a second.
        assert steps[-1] <= 2.0 / 0.5 * peak * (time[1] - time[0]) * (1.0 + 1e-6)
    assert smooth.duration == pytest.approx(plain.duration + 0.5, rel=1e-12)


def test_an_average_over_its_period_excites_no_vibration():
    """What a window of w leaves of an oscillator of period w when the motion is over: nothing."""
    plain, smooth = (param.values[0] for param in PROFILES[:2])

    def left(profile):
        time = np.linspace(0.0, profile.duration, 200_001)
        wave = np.exp(2j * np.pi * time / 0.5)
        return abs(np.trapezoid(profile.motion(time)[2] * wave, time))

    assert left(smooth) < 1e-4 * left(plain)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (dict(smoothing=-1.0), "smoothing = -1.0 s; must be >= 0"),
        (dict(slowdown=0.5), "slowdown = 0.5; must be >= 1"),
        (dict(squared_speed=np.ones(151)), "must be zero at both ends alone"),
        (dict(squared_speed=np.zeros(151)), "must be zero at both ends alone"),
    ],
)
def test_unusable_profiles_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        TimeOptimalProfile(**(dict(points=LIMITS.travel, squared_speed=SQUARED) | change))
