"""Scenarios by name: which machine, which file, and running from Python."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from pips_drake import scenarios
from pips_drake.errors import InputError, UnknownNameError
from pips_drake.scenarios import load_scenario, scenario_descriptions, simulate
from pips_drake.scene.packages import list_names, scenarios_directory
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.twin.verdict import Verdict


@pytest.mark.parametrize("name", list_names("scenario"))
def test_shipped_scenarios_load_with_their_machine(name: str) -> None:
    loaded = load_scenario(name)
    assert loaded.name == name
    assert isinstance(loaded.config, scenarios.MACHINES[loaded.machine].schema)
    assert loaded.folder == scenarios_directory()


def test_every_shipped_scenario_says_what_it_is_in_one_line() -> None:
    descriptions = scenario_descriptions()
    assert list(descriptions) == list_names("scenario")
    assert all(text and "\n" not in text for text in descriptions.values())


def test_a_file_is_loaded_with_its_folder_and_overrides(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("machine: serpentine\npath: trajectory_4\n")
    loaded = load_scenario(str(tmp_path / "mine.yaml"), {"motion.dwell_s": "2", "seed": "3"})
    assert (loaded.name, loaded.machine, loaded.folder) == ("mine", "serpentine", tmp_path)
    expected = SerpentineScenario(path="trajectory_4", seed=3)
    expected.motion.dwell_s = 2.0
    assert loaded.config == expected


def test_a_name_goes_before_a_file_of_that_name(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "trajectory_4").write_text("machine: serpentine\npath: trajectory_1\n")
    assert load_scenario("trajectory_4").folder == scenarios_directory()
    assert load_scenario("./trajectory_4").config.path == "trajectory_1"


BAD = {
    "no machine": (
        "path: trajectory_4\n",
        "no key 'machine'; must be one of cable_robot, planner, remote_manipulator, serpentine",
    ),
    "unknown machine": (
        "machine: crane\n",
        "unknown machine 'crane'; known: cable_robot, planner, remote_manipulator, serpentine",
    ),
    "misspelt machine": ("machine: serpentin\n", "did you mean 'serpentine'"),
    "no text for a machine": ("machine: {a: 1}\n", "unknown machine"),
    "no mapping": ("- machine\n", "must be a mapping"),
    "unknown key": ("machine: serpentine\npath: a\nspeed: 1\n", "unknown key 'speed'"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_refused_by_its_name(tmp_path: Path, case: str) -> None:
    text, words = BAD[case]
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        load_scenario(str(tmp_path / "bad.yaml"))
    assert str(caught.value).startswith(f"{tmp_path / 'bad.yaml'}: ")
    assert words in str(caught.value)


def test_an_unknown_scenario_lists_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'trajectory_4'") as caught:
        load_scenario("trajectori_4")
    assert "trajectory_4" in caught.value.known


def test_the_machine_of_a_scenario_simulates_it(tmp_path: Path, monkeypatch: Any) -> None:
    calls: list[Any] = []

    def run(config: Any, **kwargs: Any) -> Verdict:
        calls.append((config, kwargs))
        return Verdict(failures=(), summary={})

    machine = dataclasses.replace(scenarios.MACHINES["serpentine"], simulate=run)
    monkeypatch.setitem(scenarios.MACHINES, "serpentine", machine)
    loaded = load_scenario("trajectory_4")
    assert simulate(loaded, out=str(tmp_path / "result"), force=True).passed
    ((config, kwargs),) = calls
    assert config is loaded.config
    assert kwargs == dict(
        name="trajectory_4",
        out=tmp_path / "result",
        force=True,
        folder=scenarios_directory(),
        scene_file=None,
        meshcat=None,
    )
