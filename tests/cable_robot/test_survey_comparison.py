"""Two maps of the same panels: what is new, gone, grown or as it was."""

from __future__ import annotations

import numpy as np
import pytest

from pips_drake.cable_robot.defect_map import Finding
from pips_drake.cable_robot.survey_comparison import compare_surveys
from pips_drake.errors import InputError


def finding(name: str, u: float, v: float, size: float, panel: str = "port_2") -> Finding:
    return Finding(
        name=name,
        panel=panel,
        u=u,
        v=v,
        size_m=size,
        width_m=size,
        contrast=-0.3,
        kind="ding",
        cut=False,
        images=(0,),
        image=0,
        pixel=(0.0, 0.0),
        spread=0.0,
    )


def names(findings) -> list[str]:
    return [f.name for f in findings]


def test_what_is_new_gone_and_grown_is_told_apart():
    before = [
        finding("a", 1.0, 1.0, 0.010),
        finding("b", 2.0, 1.0, 0.010),
        finding("c", 3.0, 1.0, 0.010),
        finding("d", 4.0, 1.0, 0.040),
    ]
    after = [
        finding("p", 1.003, 1.001, 0.011),
        finding("q", 2.001, 0.998, 0.016),
        finding("r", 3.5, 1.0, 0.010),
        finding("s", 4.0, 1.0, 0.045),
    ]
    compared = compare_surveys(before, after, radius=0.008)
    assert names(compared.new) == ["r"] and names(compared.gone) == ["c"]
    assert [names(pair) for pair in compared.grown] == [["b", "q"]]
    # 5 mm of 40 is less than the share by which a size must grow.
    assert [names(pair) for pair in compared.unchanged] == [["a", "p"], ["d", "s"]]


def test_the_same_place_on_another_panel_is_another_place():
    compared = compare_surveys(
        [finding("a", 1.0, 1.0, 0.01)], [finding("b", 1.0, 1.0, 0.01, "starboard_2")], radius=0.008
    )
    assert names(compared.new) == ["b"] and names(compared.gone) == ["a"]


def test_neighbours_are_not_exchanged_for_a_nearer_first_choice():
    # Shifted by 6 mm, the second of a row is nearest to the first one's old place plus a gap.
    u = 1.0 + 0.01 * np.arange(5)
    before = [finding(f"a{k}", x, 1.0, 0.003) for k, x in enumerate(u)]
    after = [finding(f"b{k}", x + 0.006, 1.0, 0.003) for k, x in enumerate(u)]
    compared = compare_surveys(before, after, radius=0.008)
    assert [names(pair) for pair in compared.unchanged] == [[f"a{k}", f"b{k}"] for k in range(5)]


def test_a_survey_compared_with_itself_shows_no_change():
    rng = np.random.default_rng(0)
    one = [finding(str(k), *rng.uniform(0.0, 3.0, 2), 0.01) for k in range(40)]
    compared = compare_surveys(one, one, radius=0.008)
    assert not (compared.new or compared.gone or compared.grown)
    assert all(a is b for a, b in compared.unchanged) and len(compared.unchanged) == 40
    assert names(compare_surveys([], one, radius=0.008).new) == names(one)


def test_a_radius_must_be_positive():
    with pytest.raises(InputError, match="radius to match findings in = -1 m"):
        compare_surveys([], [], radius=-1.0)
