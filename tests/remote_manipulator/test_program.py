"""The collision program in an ideal world: the task both ways, its options and what it shows."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.remote_manipulator.acquisition import AcquisitionTest
from pips_drake.remote_manipulator.bodies import Placement, convex_body
from pips_drake.remote_manipulator.geometry import effector_parts
from pips_drake.remote_manipulator.kinematics import (
    heading_matrix,
    pitch_matrix,
)
from pips_drake.remote_manipulator.phases import Phase
from pips_drake.remote_manipulator.program import Measured
from pips_drake.remote_manipulator.program_collisions import CollisionTest
from pips_drake.remote_manipulator.program_motion import effector_pose
from pips_drake.remote_manipulator.program_state import (
    ANGLES,
    GAP,
    HEIGHT,
    OFFSET,
    ProgramSettings,
    pose_of,
)
from pips_drake.units import FOOT

from .program_world import CONFIG, DOWN, PALM_TOP, STOWED, World, arm_over, docked_payload, world

HELD_GAP = 0.25


def raised(up: float, aside: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """The stowed payload, lifted and moved to port, m."""
    return STOWED[0], STOWED[1] + [0.0, aside, -up]


def in_the_bay(settings: ProgramSettings | None = None) -> World:
    """Just acquired from the bay's latches."""
    there = world(settings, arm=arm_over(STOWED, height=3.5, gap=HELD_GAP))
    there.frame()
    assert there.state.phase is Phase.EXTRACTION
    return there


def before_the_port(away: float = 0.15) -> World:
    """Just acquired, flying in front of the port."""
    payload = docked_payload(away=away)
    there = world(
        phase=Phase.FREE_FLYING, payload=payload, arm=arm_over(payload, height=4.0, gap=HELD_GAP)
    )
    there.frame()
    assert there.state.phase is Phase.MANOEUVRING
    return there


def names(there: World) -> list[str]:
    return [name for _, name in there.events]


def test_the_payload_is_acquired_when_the_prong_has_closed():
    there = world(arm=arm_over(STOWED, height=3.5))
    for _ in range(200):
        before = there.state.sent[GAP]
        if there.frame(prong=1).phase is Phase.EXTRACTION:
            break
    # The hardware is a frame behind: what was sent before is what decides.
    limit = CONFIG.acquisition.prong_gap_m
    assert before < limit <= before + CONFIG.effector.prong_rate_m_s * 0.05
    assert names(there) == ["ACQUIRED"]
    np.testing.assert_allclose(pose_of(there.state.held)[1], there._X_2P[1], atol=1e-12)


def test_an_operator_who_opens_the_prong_does_not_acquire():
    there = world(arm=arm_over(STOWED, height=3.5, gap=0.262))
    there.frame(prong=-1)
    there.frame(prong=-1)
    assert there.state.phase is Phase.STOWED
    there.frame()
    assert there.state.phase is Phase.EXTRACTION


def test_a_payload_out_of_the_bay_is_manoeuvred_and_back_in_it_is_inserted():
    there = in_the_bay()
    bottom = STOWED[1][2] + 0.5 * CONFIG.payload.across_flats_m
    there.go(arm_over(raised(bottom + 0.02), height=3.5))
    assert names(there) == ["ACQUIRED", "LEFT_BAY"]
    assert there.state.phase is Phase.MANOEUVRING
    # A payload that hovers about face c is not in and out by turns.
    for up in (-0.02, 0.02, -0.02, 0.02):
        there.go(arm_over(raised(bottom + up), height=3.5))
    assert names(there) == ["ACQUIRED", "LEFT_BAY"]
    there.go(arm_over(raised(bottom - 0.06), height=3.5))
    assert there.state.phase is Phase.EXTRACTION


def test_a_payload_that_is_let_go_near_its_latches_is_stowed_elsewhere_it_flies():
    for up, phase in ((0.05, Phase.STOWED), (0.2, Phase.FREE_FLYING)):
        there = in_the_bay()
        there.go(arm_over(raised(up), height=3.5))
        for _ in range(40):
            there.frame(prong=-1)
        assert there.state.phase is phase
        assert names(there) == ["ACQUIRED", "RELEASED"]
    # From there it can be acquired again: it flies inside of the bay.
    there.close()
    assert there.state.phase is Phase.EXTRACTION


def test_docking_undocking_and_docking_again():
    there = before_the_port()
    assert not there.shown.docking.docked
    there.go(arm_over(docked_payload(away=0.02)), until=lambda: there.state.phase != 4)
    assert there.state.phase is Phase.DOCKED_HELD
    assert there.shown.docking.distance <= CONFIG.docking.distance_ft * 0.3048
    # Held at both ends, nothing but the prong moves.
    still = there.state.sent[:GAP].copy()
    for _ in range(5):
        there.frame(angles=CONFIG.arm.home, telescope=-1, shuttle=(1, 0, 0))
    np.testing.assert_array_equal(there.state.sent[:GAP], still)
    np.testing.assert_array_equal(there.state.sent[OFFSET], 0.0)
    there.frame(open_latch=True)
    assert there.state.phase is Phase.MANOEUVRING
    # The port takes nothing before the payload has been away.
    for _ in range(5):
        there.frame()
    assert there.state.phase is Phase.MANOEUVRING
    there.go(arm_over(docked_payload(away=0.12)))
    there.go(arm_over(docked_payload(away=0.02)), until=lambda: there.state.phase != 4)
    assert names(there) == ["ACQUIRED", "DOCKED", "UNDOCKED", "DOCKED"]


def test_a_docked_payload_is_released_and_acquired_again():
    there = before_the_port()
    there.go(arm_over(docked_payload(away=0.02)), until=lambda: there.state.phase != 4)
    for _ in range(40):
        there.frame(prong=-1)
    assert there.state.phase is Phase.DOCKED
    there.close()
    assert there.state.phase is Phase.DOCKED_HELD
    # The latch of a port whose payload nobody holds stays shut.
    there.frame(prong=-1)


def test_a_released_payload_flies_and_is_captured_where_it_is():
    there = before_the_port(away=1.0)
    for _ in range(40):
        there.frame(prong=-1)
    assert there.state.phase is Phase.FREE_FLYING
    there.close()
    assert there.state.phase is Phase.MANOEUVRING


def planes_separate(there: World) -> bool:
    """D1 to D3 have all vertices of palm, finger, prong on one side, the bar's on the other."""
    machine = there.program.collisions.machine
    placed = there.program._placement(there.state, there.state.command, there_measured(there))
    R, p = machine.poses(placed)
    bar = machine.vertices("bar", R, p)
    for plane, name in zip(there.state.planes, ("palm", "finger", "prong"), strict=True):
        above = machine.vertices(name, R, p) @ plane[:3] - plane[3]
        below = bar @ plane[:3] - plane[3]
        if above.min() < -1e-9 or below.max() > 1e-9:
            return False
    return True


def there_measured(there: World):
    return Measured(there.payload, there.cae_now())


@pytest.mark.parametrize("collision", ["exact", "report"])
def test_the_planes_separate_effector_and_bar_in_every_frame(collision):
    settings = ProgramSettings(collision=collision)
    there = world(settings, arm=arm_over(STOWED, height=3.5, up=0.4))
    rng = np.random.default_rng(3)
    checked = 0
    for _ in range(40):
        wanted = there.state.command[ANGLES] + rng.normal(0.0, 0.02, 6)
        for _ in range(4):
            state = there.frame(angles=wanted, telescope=int(rng.integers(-1, 2)))
            if there.shown.contact.separation > 0.0:
                checked += 1
                assert planes_separate(there)
            assert np.linalg.norm(state.planes[:, :3], axis=1) == pytest.approx(1.0)
    assert checked > 100
    there = in_the_bay(settings)
    there.go(arm_over(raised(0.1), height=3.5))
    assert planes_separate(there)


def test_what_whole_bodies_see_and_vertices_miss_and_what_the_report_sees_that_is_not_there():
    X_RC = np.eye(3), np.array(CONFIG.central_assembly_element.location_m)
    exact, report = (CollisionTest(CONFIG, report=literal) for literal in (False, True))
    reach = 0.5 * (CONFIG.payload.across_flats_m + CONFIG.central_assembly_element.across_flats_m)
    far = np.eye(3), np.array([30.0, 30.0, -30.0])
    along, across = np.eye(3), heading_matrix(np.pi / 2)
    end = 0.5 * CONFIG.central_assembly_element.across_flats_m + 0.5 * CONFIG.payload.length_m
    for R, shift, really, reported in (
        # Broadside, 0.1 m deep: the payload's corners are 7 m left and right of the CAE.
        (across, [reach - 0.1, 0.0, 0.0], True, False),
        (across, [reach + 0.1, 0.0, 0.0], False, False),
        # End on: the probe is in the CAE.
        (along, [end + 0.5, 0.0, 0.0], True, True),
        # Over the CAE, whose faces a to e have no end in z.
        (along, [end - 3.0, 0.0, -8.0], False, True),
    ):
        placed = Placement(far, (R, X_RC[1] + shift), X_RC, HELD_GAP, 3.0)
        assert exact(Phase.MANOEUVRING, placed).any == really
        assert report(Phase.MANOEUVRING, placed).any == reported


def test_beyond_8_ft_the_report_looks_at_no_bar_and_hands_on_its_top():
    settings = ProgramSettings(collision="report")
    there = world(settings, arm=arm_over(STOWED, height=3.5, up=2.5))
    there.frame()
    top = STOWED[1][2] - 0.5 * CONFIG.payload.across_flats_m - CONFIG.receptacle.height_m
    np.testing.assert_allclose(there.state.planes, np.tile([0.0, 0.0, -1.0, -top], (3, 1)))


@pytest.mark.parametrize(("step", "far"), [(-1e-9, False), (1e-9, True)])
def test_the_8_ft_are_from_the_palms_bottom_to_the_bars_middle(step, far):
    # From the bar's middle to its top, and 10 mm to the palm.
    up = CONFIG.acquisition.far_ft * FOOT - 0.5 * CONFIG.receptacle.height_m - 0.01 + step
    there = world(ProgramSettings(collision="report"), arm=arm_over(STOWED, height=3.5, up=up))
    there.frame()
    planes = there.state.planes
    # One plane for all three, or palm and fingers each their own.
    assert np.allclose(planes[0], planes[1]) == far


def test_the_reports_edges_are_those_of_acquisition():
    report = CollisionTest(CONFIG, report=True)._report
    acquisition = AcquisitionTest(CONFIG)
    palm = effector_parts(CONFIG.effector, CONFIG.arm.arm_2_m)[0]
    corners = convex_body(palm).vertices
    rng = np.random.default_rng(6)
    touched = 0
    for _ in range(300):
        turn = pitch_matrix(rng.normal(0.0, 0.05)) @ heading_matrix(rng.normal(0.0, 0.3)) @ DOWN
        wrist = STOWED[1] - [0.0, 0.0, PALM_TOP + CONFIG.arm.arm_2_m]
        wrist = wrist + rng.normal(0.0, [0.3, 0.05, 0.01])
        found = acquisition((turn, wrist), HELD_GAP, STOWED).edge_touches
        assert report._edge_touches(corners @ turn.T + wrist - STOWED[1]) == found
        touched += found
    assert 50 < touched < 250


def test_the_reports_program_extracts_too():
    there = in_the_bay(ProgramSettings(collision="report"))
    there.go(arm_over(raised(0.3), height=3.5))
    assert there.state.inhibits == 0
    aside = arm_over(raised(0.3, aside=0.3), height=3.5)
    there.go(aside, until=lambda: there.state.inhibited)
    assert there.state.inhibited


def test_a_payload_slides_up_a_side_wall_without_inhibit():
    room = 0.5 * (CONFIG.cargo_bay.width_m - CONFIG.payload.across_flats_m)
    ups = {}
    for slide in (False, True):
        there = in_the_bay(ProgramSettings(slide_along_walls=slide))
        there.go(arm_over(raised(0.3), height=3.5))
        there.go(arm_over(raised(1.0, aside=room + 0.1), height=3.5), most=400)
        moved = there.payload[1] - STOWED[1]
        ups[slide] = -moved[2]
        assert moved[1] < room
        if slide:
            assert there.state.inhibits == 0
            # A millimetre off the wall, with that end of it that got there first.
            contact = there.shown.contact
            pair = there.program.collisions.pair_names(contact.pair, held=True)
            assert pair == ("hull", "wall_port")
            assert contact.separation == pytest.approx(1e-3, abs=5e-4)
        else:
            assert there.state.inhibited
    assert ups[True] == pytest.approx(1.0, abs=1e-3)
    assert ups[False] < 0.8


def test_the_payload_can_be_held_at_right_angles():
    askew = heading_matrix(0.01) @ pitch_matrix(0.005), STOWED[1]
    for snap in (False, True):
        there = world(
            ProgramSettings(snap_to_right_angles=snap),
            payload=askew,
            arm=arm_over(STOWED, height=3.5, gap=HELD_GAP),
        )
        there.frame()
        assert there.state.phase is Phase.EXTRACTION
        R = effector_pose(CONFIG.arm, there.state.sent)[0] @ pose_of(there.state.held)[0]
        np.testing.assert_allclose(R, np.eye(3) if snap else askew[0], atol=1e-12)


def test_a_flyer_that_moves_into_a_held_arm_is_left_by_steps_that_gain():
    payload = docked_payload(away=1.0)
    there = world(phase=Phase.FREE_FLYING, payload=payload, arm=arm_over(payload, height=3.0))
    R, p = there.payload
    for k in range(10):
        there.payload = R, p - [0.0, 0.0, 0.005 * k]
        there.frame()
    # 35 mm in the palm, and the arm is held.
    assert there.state.arm_inhibit
    deep = there.shown.contact.separation
    assert deep == pytest.approx(-0.035, abs=1e-9)
    held = there.state.sent[HEIGHT]
    there.frame(telescope=-1)
    assert there.state.sent[HEIGHT] == held
    seen = [there.frame(telescope=1).arm_inhibit for _ in range(13)]
    assert seen == [True] * 11 + [False] * 2


def test_what_stands_still_in_space_moves_against_the_orbiter():
    there = before_the_port(away=0.15)
    for _ in range(40):
        there.frame(prong=-1)
    distance = there.shown.docking.distance
    for _ in range(20):
        there.frame(shuttle=(0, 0, -1))
    step = CONFIG.orbiter.rate_m_s * 0.05
    np.testing.assert_allclose(there.state.sent[OFFSET], [0.0, 0.0, -20 * step])
    # The payload flies beside the CAE; it is the arm that moves away.
    assert there.shown.docking.distance == pytest.approx(distance, abs=1e-9)
    assert there.state.phase is Phase.FREE_FLYING
