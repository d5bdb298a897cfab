"""Candidate cablings over the survey's working poses, and the one that the shipped robot has."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from pips_drake.cable_robot.cablings import (
    CABLINGS,
    DISTURBANCE,
    Frame,
    bay_obstacles,
    best_cabling,
    cabling_table,
    compare_cablings,
    make_cabling,
    survey_poses,
)
from pips_drake.cable_robot.capability import wrench_capability
from pips_drake.cable_robot.configuration import load_robot
from pips_drake.cable_robot.interference import clearances
from pips_drake.cable_robot.panels import BAY_RADIUS, panel_coordinates, radiator_panels
from pips_drake.errors import InputError, UnknownNameError


@pytest.fixture(scope="module")
def shipped():
    return load_robot("radiator_crossed").robot()


@pytest.fixture(scope="module")
def rows(shipped):
    return compare_cablings(shipped, poses=survey_poses(5, 3)[0])


def test_the_best_cabling_is_the_shipped_robot_s(shipped, rows):
    best = best_cabling(rows)
    assert best.name == "crossed_round"
    assert best.frame == Frame()
    np.testing.assert_allclose(best.robot.anchors, shipped.anchors)
    np.testing.assert_allclose(best.robot.attachments, shipped.attachments)
    assert best.usable == 1.0
    assert min(best.cable_cable, best.cable_obstacle, best.platform_obstacle) > 0.05


def test_low_anchors_lead_cables_through_doors_and_straight_ones_bear_no_moment(rows):
    low = [row for row in rows if row.frame.upper < 6.0 or row.frame.lower == 0.0]
    assert len(low) == 3
    assert all(row.cable_obstacle == 0.0 for row in low)
    straight = [row for row in rows if row.name == "straight"]
    assert all(row.feasible < 0.5 for row in straight)


def test_crossing_makes_a_robot_ten_times_as_accurate_and_stiff(rows):
    suspended = {row.name: row for row in rows if row.frame == Frame()}
    crossed, straight = suspended["crossed_round"], suspended["straight"]
    assert crossed.rotation_error < 0.1 * straight.rotation_error
    assert crossed.softest > 10.0 * straight.softest


def test_a_share_is_that_of_the_sweep(rows):
    for row in rows:
        assert row.usable <= row.feasible <= row.held
        assert row.usable == pytest.approx(row.result.usable.mean())


def test_working_poses_look_square_at_the_panels_from_the_standoff():
    poses, looking = survey_poses(3, 3)
    assert looking.sum() == 2 * 3 * 3
    cameras = poses.position[looking] - [0.0, 0.0, 0.28]
    starboard, port = (next(p for p in radiator_panels() if p.side == side) for side in (1, -1))
    panel = [starboard if y > 0 else port for y in cameras[:, 1]]
    heights = [panel_coordinates(p, [c])[0, 2] for p, c in zip(panel, cameras, strict=True)]
    np.testing.assert_allclose(heights, 1.0, atol=1e-9)
    assert np.all(poses.position[~looking][:, 2] >= 0.5)
    assert np.abs(poses.position[:, 0]).max() < 9.144


def test_obstacles_hold_the_doors_inner_faces_and_the_bay():
    obstacles = bay_obstacles()
    corners = np.concatenate([one.corners() for one in obstacles])
    assert len(obstacles) == 17
    # The hinges, the doors' far edges below the sills, and no more than the door's thickness out.
    assert corners[:, 2].min() == pytest.approx(-BAY_RADIUS, abs=0.2)
    assert corners[:, 2].max() == pytest.approx(0.0, abs=0.03)
    assert np.abs(corners[:, 1]).max() == pytest.approx(2.0 * BAY_RADIUS, abs=0.2)


def test_the_table_has_a_line_a_cabling_as_wide_as_its_head(rows):
    lines = cabling_table(rows).splitlines()
    assert len(lines) == 1 + len(rows)
    assert {len(line) for line in lines} == {len(lines[0])}
    assert lines[1].split()[0] == rows[0].name


def test_a_cabling_uses_every_anchor_once(shipped):
    for name in CABLINGS:
        robot = make_cabling(name, Frame(), shipped)
        assert len(np.unique(robot.anchors, axis=0)) == 8
        assert len(np.unique(robot.attachments, axis=0)) == 8


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"upper": 1.0, "lower": 2.0}, "rising"),
        ({"half_length": -1.0}, "half_length"),
    ],
)
def test_bad_frames_are_refused(change, words):
    with pytest.raises(InputError, match=words):
        Frame(**change)


def test_an_unknown_cabling_lists_the_known(shipped):
    with pytest.raises(UnknownNameError, match="crossed_round"):
        make_cabling("knotted", Frame(), shipped)


@pytest.mark.slow
def test_eight_of_all_symmetric_cablings_clear_the_doors_and_bear_moments(shipped):
    signs = np.array([[2 * (i >> k & 1) - 1 for k in range(3)] for i in range(8)])
    index = {tuple(sign): i for i, sign in enumerate(signs)}
    every = set()
    for mirror in ((-1, -1, 1), (-1, 1, 1), (1, -1, 1)):
        image = [index[tuple(sign * mirror)] for sign in signs]
        firsts = [i for i in range(8) if i < image[i]]
        for choice in itertools.product(range(8), repeat=4):
            assigned = [0] * 8
            for i, j in zip(firsts, choice, strict=True):
                assigned[i], assigned[image[i]] = j, image[j]
            if len(set(assigned)) == 8:
                every.add(tuple(assigned))
    assert len(every) == 1088
    poses, obstacles = survey_poses(3, 3)[0], bay_obstacles()
    posts = make_cabling("straight", Frame(), shipped).anchors
    force, moment = DISTURBANCE
    box = [force] * 3 + [moment] * 3
    good = {}
    for assigned in every:
        robot = replace(
            shipped, anchors=posts[list(assigned)], attachments=0.5 * signs * shipped.box
        )
        near = clearances(robot, poses, obstacles)
        if near.least.min() < 0.05 or near.cable_platform.min() == 0.0:
            continue
        margin = wrench_capability(robot, poses, disturbance=box).margin.min()
        if margin >= 1.0:
            good[assigned] = margin
    assert len(good) == 8
    assert good[CABLINGS["crossed_round"]] == pytest.approx(max(good.values()))
