"""What a rope's material does to the lengths, beside closed forms and exact catenaries."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from pips_drake.cable_robot.kinematics import make_poses
from pips_drake.cable_robot.materials import (
    MATERIALS,
    RopeNeed,
    compare_materials,
    judge_material,
    material_table,
    recommend_material,
    rope_need,
)
from pips_drake.cable_robot.statics import characteristic_length, distribute_tensions
from pips_drake.cable_robot.stiffness import elastic_stiffness, stiffness_directions
from pips_drake.errors import InputError

from .robots import box_robot

NEED = RopeNeed(strength=10_000.0, axial_stiffness=1e6, longest=24.4, tension=200.0, slackest=90.0)


@pytest.fixture(scope="module")
def rows():
    return compare_materials(NEED)


def test_every_rope_is_strong_and_stiff_enough_and_no_thicker(rows):
    for row in rows:
        enough = row.strength / NEED.strength, row.axial_stiffness / NEED.axial_stiffness
        assert min(enough) == pytest.approx(1.0)


def test_sag_is_a_catenary_s_nearly(rows):
    for row in rows:
        weight = 9.81 * row.mass_per_length
        # Level, with the tension of its lowest point: sag T/w (cosh(w l / 2 T) - 1).
        a, half = NEED.slackest / weight, 0.5 * NEED.longest
        sag = a * (np.cosh(half / a) - 1.0)
        longer = 2.0 * a * np.sinh(half / a) - NEED.longest
        # The parabola leaves out terms of the order (w l / 2 T)^2 / 12, at most 0.2 percent.
        assert row.sag == pytest.approx(sag, rel=2e-3)
        assert row.sag_error == pytest.approx(longer, rel=5e-3)


def test_errors_are_in_proportion_to_what_makes_them():
    material = MATERIALS[-1]
    one = judge_material(material, NEED)
    long = judge_material(material, replace(NEED, longest=2.0 * NEED.longest))
    warm = judge_material(material, replace(NEED, temperature_change=10.0))
    taut = judge_material(material, replace(NEED, slackest=2.0 * NEED.slackest))
    assert long.sag == pytest.approx(4.0 * one.sag)
    assert long.sag_error == pytest.approx(8.0 * one.sag_error)
    assert warm.thermal_error == pytest.approx(2.0 * one.thermal_error)
    assert taut.sag_error == pytest.approx(0.25 * one.sag_error)
    assert one.thermal_error == pytest.approx(4.8e-6 * 5.0 * 24.4)
    assert one.stretch == pytest.approx(200.0 * 24.4 / one.axial_stiffness)


def test_stiff_and_light_wins_among_stiff_ropes_and_steel_is_too_heavy(rows):
    chosen = recommend_material(rows)
    assert chosen.material.name == "HMPE"
    steel = next(row for row in rows if row.material.name == "steel wire rope")
    assert steel.sag_error > 10.0 * chosen.sag_error
    assert steel.length_error > 5.0 * chosen.length_error


def test_without_a_stiffness_to_keep_creep_and_heat_choose():
    rows = compare_materials(replace(NEED, axial_stiffness=0.0))
    assert recommend_material(rows).material.name == "Vectran"


def test_what_does_not_bear_bending_is_not_recommended(rows):
    aramid = [row for row in rows if not row.material.bends]
    assert [row.material.name for row in aramid] == ["aramid"]
    with pytest.raises(InputError, match="bending"):
        recommend_material(aramid)


def test_a_robot_s_softest_stiffness_is_that_with_its_rope():
    robot = replace(box_robot(crossed=True), tension_min=10.0, tension_max=2000.0)
    poses = make_poses([[0.2, 0.1, -0.3]])
    need = rope_need(robot, poses, distribute_tensions(robot, poses).tensions)
    assert need.strength == pytest.approx(5.0 * 2000.0)
    row = judge_material(MATERIALS[0], need, robot, poses)
    roped = replace(robot, axial_stiffness=np.array([row.axial_stiffness]))
    K = elastic_stiffness(roped, poses)
    known = stiffness_directions(roped, K, characteristic_length(roped)).values.min()
    assert row.softest == pytest.approx(known, rel=1e-9)


def test_the_thickness_at_which_sag_and_stretch_add_up_least_is_between():
    # A thicker rope stretches less and sags more: the derivative of the sum changes its sign.
    def slope(stiffness: float) -> float:
        def total(k: float) -> float:
            row = judge_material(MATERIALS[-1], replace(NEED, axial_stiffness=k, strength=1.0))
            return row.length_error

        return total(1.001 * stiffness) - total(0.999 * stiffness)

    best = brentq(slope, 1e5, 1e7)
    assert 1e5 < best < 1e6


def test_the_table_has_a_line_a_material(rows):
    lines = material_table(rows).splitlines()
    assert len(lines) == 1 + len(MATERIALS)
    assert all(line.startswith(m.name) for line, m in zip(lines[1:], MATERIALS, strict=True))
    assert len({len(line.split("  yes")[0].split("  no")[0]) for line in lines[1:]}) == 1


@pytest.mark.parametrize("change", [{"strength": 0.0}, {"longest": np.nan}, {"tension": -1.0}])
def test_bad_needs_are_refused(change):
    with pytest.raises(InputError, match="rope"):
        replace(NEED, **change)


def test_every_material_says_where_its_numbers_are_from():
    for material in MATERIALS:
        assert material.source
        assert material.remark
