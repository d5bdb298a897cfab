"""Cables that pull and never push, straight or hanging in Irvine's elastic catenary."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from pips_drake.cable_robot.cable_forces import cable_pull, catenary
from pips_drake.cable_robot.kinematics import Poses, cable_lengths, jacobian, make_poses
from pips_drake.cable_robot.robot import CableRobot
from pips_drake.cable_robot.statics import structure_matrix
from pips_drake.errors import InputError

from .robots import box_robot

ROBOT = box_robot(seed=1)
RNG = np.random.default_rng(3)
POSES = make_poses(RNG.uniform(-0.8, 0.8, (20, 3)), RNG.uniform(-0.4, 0.4, (20, 3)))


def one_cable(stiffness=1e5):
    """One cable that matters, from (5, 0, 0) to the origin of a platform; the others are broken."""
    anchors = np.array([[5.0, 0, 0]] + [[k, 9.0, 9.0] for k in range(5)])
    robot = CableRobot(
        name="one", anchors=anchors, attachments=np.zeros((6, 3)), axial_stiffness=[stiffness]
    )
    return robot, np.array([0, 1, 1, 1, 1, 1])


def test_wrench_is_that_of_the_structure_matrix():
    """Tensions are those of springs, and A T of the statics is what they do together."""
    l0 = cable_lengths(ROBOT, POSES) * RNG.uniform(0.98, 1.02, (20, 8))
    found = cable_pull(ROBOT, POSES, l0)
    stretch = cable_lengths(ROBOT, POSES) - l0
    expected = np.maximum(0.0, ROBOT.axial_stiffness * stretch / l0)
    # Lengths of 5 m round to 1e-15 m, at 2e4 N/m.
    np.testing.assert_allclose(found.tensions, expected, rtol=1e-9, atol=1e-9)
    wrench = (structure_matrix(ROBOT, POSES) @ found.tensions[..., None])[..., 0]
    np.testing.assert_allclose(found.wrench, wrench, rtol=1e-10, atol=1e-8)
    assert np.all(found.tensions[stretch <= 0.0] == 0.0), "a slack cable pulls"
    assert (stretch <= 0.0).sum() > 20


def test_damping_resists_the_rate_of_the_stretch_and_never_pushes():
    robot, broken = one_cable()
    for rate, reeled in ((0.2, 0.0), (0.0, 0.3), (-5.0, 0.0)):
        found = cable_pull(
            robot, make_poses([0, 0, 0]), np.full(6, 4.9), twist=[-rate, 0, 0, 0, 0, 0],
            rates=np.full(6, reeled), damping_time=0.01, broken=broken,
        )  # fmt: skip
        expected = max(0.0, 1e5 / 4.9 * (0.1 + 0.01 * (rate - reeled)))
        # 0.1 m is a difference of numbers near 5.
        assert found.tensions[0, 0] == pytest.approx(expected, rel=1e-12)
        assert found.wrench[0, 0] == pytest.approx(expected, rel=1e-12)
    slack = cable_pull(
        robot, make_poses([0, 0, 0]), np.full(6, 5.1), twist=[-9, 0, 0, 0, 0, 0],
        damping_time=1.0, broken=broken,
    )  # fmt: skip
    assert slack.tensions[0, 0] == 0.0, "a slack cable resists its lengthening"


def test_damping_takes_the_power_of_the_lengths_rates():
    """With dl/dt = L t from the kinematics."""
    l0 = cable_lengths(ROBOT, POSES) * 0.98
    twist = RNG.normal(size=(20, 6))
    still, moving = (
        cable_pull(ROBOT, POSES, l0, twist=t, damping_time=1e-4) for t in (None, twist)
    )
    rates = (jacobian(ROBOT, POSES) @ twist[..., None])[..., 0]
    expected = ROBOT.axial_stiffness / l0 * 1e-4 * rates
    np.testing.assert_allclose(moving.tensions - still.tensions, expected, rtol=0, atol=1e-9)


def hang(x, z, l0, EA, w):
    H, V, met = catenary(x, z, l0, EA, w)
    assert met
    return H, V


@pytest.mark.parametrize(("l0", "w"), [(10.2, 1.0), (9.99, 2.0), (14.0, 0.5), (9.9, 0.01)])
def test_level_catenary_is_the_analytic_one(l0, w):
    """Ends level: V = -w l0 / 2, and H from Irvine's one equation, by bisection."""
    EA, x = 1e5, 10.0

    def gap(H):
        return H * l0 / EA + 2.0 * H / w * math.asinh(0.5 * w * l0 / H) - x

    H, V = hang(x, 0.0, l0, EA, w)
    assert pytest.approx(brentq(gap, 1e-6, 1e5, xtol=1e-13, rtol=1e-14), rel=1e-9) == H
    assert pytest.approx(-0.5 * w * l0, rel=1e-9, abs=1e-9 * H) == V


@pytest.mark.parametrize(("x", "z", "l0"), [(8, 5, 9.4), (8, -5, 9.6), (2, 9, 9.3), (1, -6, 9.0)])
def test_sloping_catenary_has_the_least_energy_of_a_chain(x, z, l0):
    """A chain of springs and weights, whose energy knows nothing of catenaries."""
    EA, w, links = 2e3, 3.0, 60
    part, tops = l0 / links, np.linspace([0.0, 0.0], [x, z], links + 1)

    def energy(inner):
        points = tops.copy()
        points[1:-1] = inner.reshape(-1, 2)
        spans = np.diff(points, axis=0)
        lengths = np.linalg.norm(spans, axis=1)
        stretch = np.maximum(lengths - part, 0.0)
        forces = (EA / part * stretch / lengths)[:, None] * spans
        gradient = forces[:-1] - forces[1:]
        gradient[:, 1] += w * part
        value = 0.5 * EA / part * stretch @ stretch + w * part * points[1:-1, 1].sum()
        return value, gradient.ravel()

    start = tops[1:-1] - np.outer(np.sin(np.pi * np.arange(1, links) / links), [0.0, 0.5])
    options = {"maxiter": 20000, "maxfun": 40000, "ftol": 1e-15, "gtol": 1e-7}
    found = minimize(energy, start.ravel(), jac=True, method="L-BFGS-B", options=options)
    first = found.x[:2]
    pull = EA / part * (np.linalg.norm(first) - part) * first / np.linalg.norm(first)
    H, V = hang(x, z, l0, EA, w)
    # The first link bears the tension at its own end: half a link's weight is missing, and the
    # chain's bends are coarse, most of all where the tension is small.
    np.testing.assert_allclose([H, V], pull - [0.0, 0.5 * w * part], atol=5e-3 * np.hypot(H, V))


def test_ends_of_the_catenary_are_met_over_the_whole_range():
    """Against quadrature of the tangent along the cable, for taut, slack and steep ones."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    rng = np.random.default_rng(5)
    for _ in range(300):
        x, z = rng.uniform(0.5, 12), rng.uniform(-8, 8)
        l0 = math.hypot(x, z) * rng.choice([0.995, 0.9999, 1.0, 1.001, 1.1])
        EA, w = 10 ** rng.uniform(4, 6), 10 ** rng.uniform(-3, 1)
        H, V = hang(x, z, l0, EA, w)
        s = 0.5 * l0 * (nodes + 1.0)
        up = V + w * s
        T = np.hypot(H, up)
        ends = [0.5 * l0 * weights @ (part * (1 / T + 1 / EA)) for part in (np.full(400, H), up)]
        np.testing.assert_allclose(ends, [x, z], atol=1e-7)


def test_weightless_cable_is_the_straight_spring():
    for w, share in ((1e-3, 1e-4), (1e-9, 1e-9)):
        for x, z in ((8.0, 5.0), (8.0, -5.0), (0.3, 9.0), (9.0, 0.0)):
            chord = math.hypot(x, z)
            l0 = 0.999 * chord
            H, V = hang(x, z, l0, 1e5, w)
            T = 1e5 * (chord - l0) / l0
            np.testing.assert_allclose([H, V], [T * x / chord, T * z / chord], atol=share * T)


def test_hanging_cables_pull_the_platform_down_by_their_share_of_the_weight():
    """All forces on a cable add up: with both ends level, half of its weight is the platform's."""
    robot, broken = one_cable()
    found = cable_pull(robot, make_poses([0, 0, 0]), np.full(6, 5.2), weight=2.0, broken=broken)
    assert found.wrench[0, 2] == pytest.approx(-0.5 * 2.0 * 5.2, rel=1e-9)
    assert found.wrench[0, 0] > 0.0
    straight_down = robot.anchors[0] - [0.0, 0.0, 4.0]
    found = cable_pull(robot, make_poses(straight_down), np.full(6, 3.9), weight=2.0, broken=broken)
    # The stretch is T / k with the mean of the tensions at both ends.
    expected = 1e5 * 0.1 / 3.9 - 0.5 * 2.0 * 3.9
    assert found.wrench[0, 2] == pytest.approx(expected, rel=1e-6)


def test_many_poses_are_each_pose_alone():
    l0 = cable_lengths(ROBOT, POSES) * 0.999
    for weight in (0.0, 0.3):
        many = cable_pull(ROBOT, POSES, l0, weight=weight)
        for n in (0, 7):
            pose = Poses(POSES.position[n : n + 1], POSES.rotation[n : n + 1])
            one = cable_pull(ROBOT, pose, l0[n], weight=weight)
            np.testing.assert_array_equal(one.wrench[0], many.wrench[n])
            np.testing.assert_array_equal(one.tensions[0], many.tensions[n])


def test_bad_input_is_refused():
    pose = make_poses([0, 0, 0])
    with pytest.raises(InputError, match=r"unstretched lengths of shape \(7,\); must be \(8,\)"):
        cable_pull(ROBOT, pose, np.ones(7))
    with pytest.raises(InputError, match="unstretched length = -1 m; must be > 0"):
        cable_pull(ROBOT, pose, -np.ones(8))
    with pytest.raises(InputError, match="weight of cables = -1 N/m; must be >= 0"):
        cable_pull(ROBOT, pose, np.ones(8), weight=-1.0)
