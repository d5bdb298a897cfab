"""The autopilot's ways, flown with an arm that goes where it is sent."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pips_drake.errors import NotFollowableError
from pips_drake.remote_manipulator import straight_way
from pips_drake.remote_manipulator.autopilot import Autopilot, AutopilotState, Seen
from pips_drake.remote_manipulator.configuration import RemoteManipulatorConfig, load_configuration
from pips_drake.remote_manipulator.geometry import payload_parts
from pips_drake.remote_manipulator.kinematics import forward_kinematics
from pips_drake.remote_manipulator.phases import Phase
from pips_drake.remote_manipulator.script import ScriptStep

FRAME = 0.05
# Palm straight down below a raised elbow: inside all limits, wrist well bent.
HOME = np.radians([0.0, 60.0, -100.0, 0.0, -50.0, 0.0])


@pytest.fixture(scope="module")
def config() -> RemoteManipulatorConfig:
    return load_configuration()


def start(config: RemoteManipulatorConfig, phase: Phase = Phase.STOWED) -> Seen:
    place = np.eye(3), np.array(config.payload.location_m)
    arm = np.array([4.0, *HOME, config.effector.prong_open_gap_m])
    return Seen(phase=phase, arm=arm, X_RP=place, X_RC=place)


def fly(
    pilot: Autopilot, seen: Seen, *, drift: float = 0.0
) -> tuple[NDArray[np.float64], AutopilotState, Seen]:
    """Angles of each frame, (n, 6), while the payload drifts along y, m/s."""
    state, angles = pilot.first_state(seen.arm[1:7]), [seen.arm[1:7]]
    while not pilot.finished(state):
        state, inputs = pilot.advance(state, seen)
        angles.append(np.array(inputs.angles))
        arm = np.concatenate([seen.arm[:1], angles[-1], seen.arm[7:]])
        R, p = seen.X_RP
        seen = replace(seen, arm=arm, X_RP=(R, p + np.array([0.0, drift * FRAME, 0.0])))
        assert len(angles) < 10000
    return np.array(angles), state, seen


def palms(config: RemoteManipulatorConfig, angles: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([forward_kinematics(config.arm, q, 4.0).palm for q in angles])


def test_a_way_is_straight_and_within_speed_acceleration_and_rates(
    config: RemoteManipulatorConfig,
) -> None:
    by = np.array([0.5, -1.0, 0.8])
    pilot = Autopilot(config, [ScriptStep(do="carry", by_m=by.tolist())])
    angles, _, _ = fly(pilot, start(config))
    way = palms(config, angles)
    # Rounding of the inverse kinematics only.
    np.testing.assert_allclose(way[-1] - way[0], by, atol=1e-7)
    assert np.linalg.norm(np.cross(way - way[0], by / np.linalg.norm(by)), axis=1).max() < 1e-7
    speed = np.diff(way, axis=0) / FRAME
    # Differences of a smooth way are means of it, so never above its largest.
    assert np.linalg.norm(speed, axis=1).max() <= straight_way.FREE_SPEED + 1e-6
    acceleration = np.linalg.norm(np.diff(speed, axis=0) / FRAME, axis=1)
    # 5.774 is rounded to 4 figures.
    assert acceleration.max() <= straight_way.FREE_ACCELERATION * 1.001
    assert np.all(np.abs(np.diff(angles, axis=0)) <= np.array(config.arm.rates) * FRAME)


@pytest.mark.parametrize("drift", [0.0, 0.01])
def test_an_approach_ends_above_the_bar_across_it_though_it_drifts(
    config: RemoteManipulatorConfig, drift: float
) -> None:
    pilot = Autopilot(config, [ScriptStep(do="approach", height_m=1.5)])
    angles, _, seen = fly(pilot, start(config), drift=drift)
    pose = forward_kinematics(config.arm, angles[-1], 4.0)
    bar = np.asarray(payload_parts(config)[2].position) + seen.X_RP[1]
    # The last frame's drift, 0.5 mm, is not yet seen.
    np.testing.assert_allclose(pose.palm[:2], bar[:2], atol=drift * FRAME + 1e-6)
    assert 1.5 < bar[2] - pose.palm[2] < 2.5
    np.testing.assert_allclose(pose.R_R2[:, 0], [0.0, 0.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(np.abs(pose.R_R2[:, 2]), [1.0, 0.0, 0.0], atol=1e-6)


def test_while_it_closes_the_palm_stays_with_a_payload_that_drifts(
    config: RemoteManipulatorConfig,
) -> None:
    pilot = Autopilot(config, [ScriptStep(do="close", seconds=5.0)])
    angles, _, seen = fly(pilot, start(config), drift=0.01)
    first, last = (forward_kinematics(config.arm, q, 4.0).palm for q in (angles[0], angles[-1]))
    drifted = seen.X_RP[1] - start(config).X_RP[1]
    assert np.linalg.norm(drifted) > 0.04
    # Two frames' drift are not yet seen.
    np.testing.assert_allclose(last - first, drifted, atol=2.0 * 0.01 * FRAME + 1e-6)


def test_a_descent_that_catches_the_payload_is_over_and_the_arm_stays_where_it_was(
    config: RemoteManipulatorConfig,
) -> None:
    pilot = Autopilot(config, [ScriptStep(do="descend"), ScriptStep(do="wait", seconds=0.1)])
    free = start(config)
    state = pilot.first_state(HOME)
    for _ in range(40):
        state, _ = pilot.advance(state, free)
    # The way is in the payload's frame: read in {R} it would lie metres elsewhere.
    after, inputs = pilot.advance(state, replace(free, phase=Phase.EXTRACTION))
    assert after.step == 1
    np.testing.assert_array_equal(inputs.angles, state.angles)


def test_what_cannot_be_reached_is_told_with_its_step(config: RemoteManipulatorConfig) -> None:
    script = [ScriptStep(do="wait", seconds=0.1), ScriptStep(do="carry", by_m=[40.0, 0.0, 0.0])]
    with pytest.raises(NotFollowableError, match=r"step 2 \(carry\)"):
        fly(Autopilot(config, script), start(config))


def test_angles_beyond_a_hard_limit_are_told_with_joint_and_step(
    config: RemoteManipulatorConfig,
) -> None:
    script = [ScriptStep(do="move_joints", angles_deg=[0.0, 150.0, -90.0, 0.0, 0.0, 0.0])]
    message = r"step 1 \(move_joints\): P0 = 150 deg; must be -2 .. 145 deg"
    with pytest.raises(NotFollowableError, match=message):
        fly(Autopilot(config, script), start(config))


def test_a_close_that_acquires_nothing_ends_after_its_time(
    config: RemoteManipulatorConfig,
) -> None:
    pilot = Autopilot(config, [ScriptStep(do="close", seconds=2.0)])
    angles, _, _ = fly(pilot, start(config))
    assert abs((len(angles) - 1) * FRAME - 2.0) <= 2.0 * FRAME
    held, _, _ = fly(pilot, start(config, Phase.EXTRACTION))
    assert len(held) == 2


def test_a_state_is_the_same_out_of_its_numbers(config: RemoteManipulatorConfig) -> None:
    pilot = Autopilot(config, [ScriptStep(do="carry", turn_deg=[0.0, 0.0, 5.0])])
    state, _ = pilot.advance(pilot.first_state(HOME), start(config))
    assert state.duration > 0.0
    again = AutopilotState.of_vector(state.vector())
    np.testing.assert_array_equal(again.vector(), state.vector())
    turned = Rotation.from_rotvec(again.start[:3]).inv() * Rotation.from_rotvec(again.goal[:3])
    assert turned.magnitude() == pytest.approx(np.radians(5.0), rel=1e-9)
