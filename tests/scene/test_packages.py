"""Shipped files are found by name, and nothing else is taken for one."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.scene import packages

KINDS = ("arm", "path", "model", "scene", "scenario", "study")


@pytest.fixture
def data_root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small stand-in for the shipped files, with one file of every kind and some strays."""
    for file in (
        "models/package.xml",
        "models/arms/elbow.yaml",
        "models/arms/notes.txt",
        "models/paths/straight.csv",
        "models/paths/bend.yaml",
        "models/sdf/bay/bay.sdf",
        "models/sdf/bay/README.md",
        "models/scenes/hangar.dmd.yaml",
        "models/scenes/notes.yaml",
        "scenarios/look.yaml",
    ):
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text(file)
    monkeypatch.setattr(packages, "_PACKAGE", tmp_path / "pips_drake")
    return tmp_path


def test_models_and_scenarios_are_there() -> None:
    assert (packages.models_directory() / "package.xml").is_file()
    assert packages.scenarios_directory().parent == packages.models_directory().parent


def test_the_prototype_arm_is_shipped() -> None:
    assert "prototype" in packages.list_names("arm")
    assert packages.find_arm_file("prototype").name == "prototype.yaml"


@pytest.mark.parametrize("kind", KINDS)
def test_every_listed_name_is_found(kind: str) -> None:
    for name in packages.list_names(kind):
        assert packages.find_file(kind, name).is_file()


@pytest.mark.parametrize("kind", KINDS)
def test_no_two_shipped_files_share_a_name(kind: str) -> None:
    root = packages.models_directory().parent
    files = [file for pattern in packages._PATTERNS[kind] for file in root.glob(pattern)]
    assert len(packages.list_names(kind)) == len(files)


def test_a_kind_lists_its_own_files_only(data_root: Path) -> None:
    assert packages.list_names("arm") == ["elbow"]
    assert packages.list_names("path") == ["bend", "straight"]
    assert packages.list_names("model") == ["bay"]
    assert packages.list_names("scene") == ["hangar"]
    assert packages.list_names("scenario") == ["look"]


def test_each_finder_finds_its_kind(data_root: Path) -> None:
    models = data_root / "models"
    assert packages.find_arm_file("elbow") == models / "arms/elbow.yaml"
    assert packages.find_path_file("straight") == models / "paths/straight.csv"
    assert packages.find_path_file("bend") == models / "paths/bend.yaml"
    assert packages.find_model_file("bay") == models / "sdf/bay/bay.sdf"
    assert packages.find_scene_file("hangar") == models / "scenes/hangar.dmd.yaml"
    assert packages.find_scenario_file("look") == data_root / "scenarios/look.yaml"


def test_data_inside_the_package_is_preferred(data_root: Path) -> None:
    """In a wheel; a folder `models` beside the package is then somebody else's."""
    inside = data_root / "pips_drake/models"
    inside.mkdir(parents=True)
    (inside / "package.xml").touch()
    assert packages.models_directory() == inside
    assert packages.list_names("arm") == []


def test_the_path_of_a_file_is_itself(
    data_root: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path_factory.mktemp("elsewhere")
    (folder / "mine.csv").touch()
    assert packages.find_path_file(str(folder / "mine.csv")) == folder / "mine.csv"
    monkeypatch.chdir(folder)
    assert packages.find_path_file("mine.csv") == Path("mine.csv")


def test_a_shipped_name_wins_over_a_file_of_that_name(
    data_root: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))
    Path("straight").touch()
    assert packages.find_path_file("straight").name == "straight.csv"
    assert packages.find_path_file("./straight") == Path("straight")


def test_an_unknown_name_lists_the_known_ones(data_root: Path) -> None:
    with pytest.raises(UnknownNameError) as raised:
        packages.find_path_file("foo")
    assert str(raised.value) == "unknown path 'foo'; known: bend, straight"
    assert (raised.value.kind, raised.value.name) == ("path", "foo")
    assert raised.value.known == ["bend", "straight"]


def test_an_unknown_kind_lists_the_known_ones() -> None:
    known = r"unknown kind of file 'zzz'; known: arm, cable robot, joint motion, manipulator, "
    with pytest.raises(UnknownNameError, match=known):
        packages.list_names("zzz")


@pytest.mark.parametrize("name", ["", "a\0b", "x" * 5000])
def test_what_cannot_be_a_file_is_an_unknown_name(name: str) -> None:
    with pytest.raises(UnknownNameError):
        packages.find_path_file(name)


@pytest.mark.parametrize("name", [".", "/"])
def test_a_folder_is_called_one(name: str) -> None:
    with pytest.raises(InputError, match=f"path '{name}' is a folder; must be a shipped name or"):
        packages.find_path_file(name)


@given(st.text())
def test_any_text_is_found_or_refused(name: str) -> None:
    with contextlib.suppress(InputError):
        assert packages.find_arm_file(name).is_file()


def test_paths_in_a_file_start_at_its_folder(
    data_root: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("project")
    (folder / "mine.csv").touch()
    assert packages.find_path_file("mine.csv", inside=folder) == folder / "mine.csv"
    assert packages.find_path_file("straight", inside=folder).name == "straight.csv"
    shipped = data_root / "models/paths/straight.csv"
    assert packages.find_path_file(str(shipped), inside=folder) == shipped


@pytest.mark.parametrize("how", ["relative", "absolute", "symbolic link"])
def test_paths_in_a_file_cannot_leave_its_folder(
    how: str, data_root: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    top = tmp_path_factory.mktemp("top")
    folder = top / "project"
    folder.mkdir()
    secret = top / "secret.csv"
    secret.touch()
    (folder / "link.csv").symlink_to(secret)
    name = {
        "relative": "../secret.csv",
        "absolute": str(secret),
        "symbolic link": "link.csv",
    }[how]
    with pytest.raises(InputError, match=r"lies outside .*project; must be shipped or inside it"):
        packages.find_path_file(name, inside=folder)


def test_a_parser_resolves_package_urls() -> None:
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    parser = Parser(MultibodyPlant(time_step=0.0))
    packages.add_package(parser)
    packages.add_package(parser)
    resolved = parser.package_map().ResolveUrl("package://pips_drake/arms/prototype.yaml")
    assert Path(resolved).samefile(packages.find_arm_file("prototype"))


def test_looking_up_a_name_imports_nothing_heavy() -> None:
    """`pips --help` has to start at once."""
    code = (
        "import sys\n"
        "from pips_drake.scene import packages\n"
        "packages.find_arm_file('prototype')\n"
        "heavy = {'matplotlib', 'numba', 'numpy', 'pydrake', 'scipy'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, env=os.environ)
