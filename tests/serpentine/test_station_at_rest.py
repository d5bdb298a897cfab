"""Held at rest the arm sags by statics over stiffness, and compensation takes the sag away."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.serpentine import kinematics
from pips_drake.serpentine.systems.tip_path_source import HOLD

from .station_bench import INCH, Bench, load_home, scenario, spine_distance


def test_without_compensation_the_arm_sags_by_statics_over_stiffness():
    bench = Bench(
        scenario(actuation__compensate_deflection=False),
        command=HOLD,
        # From the unsagged posture, so that it is the plant that finds the sag.
        start=load_home(),
    )
    home = bench["follow_the_leader.joint_state"][:18]
    np.testing.assert_array_equal(bench.joints, home)
    # Damping over stiffness is 5 ms: at 3 Hz 5 % of critical, so amplitude falls to 1 % within 5 s.
    bench.advance(5.0)
    turned = bench.joints - home
    expected = -bench.holding_efforts(home) / bench.stiffness
    # Within 2 %: loads are those of the straight arm, and the sag changes levers by a thousandth.
    heavy = np.abs(expected) > 1e-5
    assert heavy.sum() >= 14
    np.testing.assert_allclose(turned[heavy], expected[heavy], rtol=0.02)
    sag = kinematics.spine_points(bench.setup.arm, np.array([bench.joints, home]))[:, -1]
    statics = kinematics.jacobian(bench.setup.arm, home)[0, 3:] @ expected
    # Down is x0 on the pad.
    assert sag[0, 0] - sag[1, 0] == pytest.approx(statics[0], rel=0.02)
    assert 5e-3 < statics[0] < 50e-3


@pytest.fixture(scope="module")
def standing():
    """Held at home, compensated, from the uncompensated posture: 17 mm down at the tip."""
    home = load_home()
    rest = Bench(scenario(), command=HOLD)
    sagged = home - rest.holding_efforts(home) / rest.stiffness
    bench = Bench(scenario(), command=HOLD, start=sagged)
    assert spine_distance(bench.setup.arm, bench.joints, home) > 10e-3
    bench.advance(5.0)
    return bench


def test_with_compensation_the_arm_stands_within_0_2_mm(standing):
    home = standing["follow_the_leader.joint_state"][:18]
    assert spine_distance(standing.setup.arm, standing.joints, home) < 0.2e-3


def test_at_rest_the_drives_forces_are_the_static_holding_forces(standing):
    q = standing.joints
    # Closed form: lever of the isosceles triangle, a cos(45 deg + theta / 2).
    pins = INCH * np.repeat([9.0, 7.5, 6.0, 2.7], [7, 6, 2, 1])
    lever = np.append([1.0, 1.0], pins * np.cos(0.25 * np.pi + 0.5 * q[2:]))
    expected = standing.holding_efforts(q) / lever
    found = standing["actuator_force_map.drive_effort"]
    # 1 %, of what is left of the motion after 5 s; the rail carries no load along itself here.
    np.testing.assert_allclose(found[1:], expected[1:], rtol=0.01)
    assert abs(found[0]) < 1.0


def test_the_default_start_is_at_rest():
    bench = Bench(scenario(), command=HOLD)
    bench.advance(0.5)
    # A start off its standing posture would swing by its sag; 1e-6 is a ten thousandth of that.
    assert np.abs(bench["plant.state"][18:]).max() < 1e-6
