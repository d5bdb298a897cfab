"""Output appears whole or not at all, and replaces nothing that is not an earlier result."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pips_drake.errors import InputError
from pips_drake.twin import output_folder as module
from pips_drake.twin.output_folder import output_folder, write_whole


def write_result(folder: Path, text: str = "{}") -> None:
    (folder / "summary.json").write_text(text)
    (folder / "figures").mkdir()


def test_the_folder_appears_when_the_block_ends(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "out"
    with output_folder(target) as folder:
        write_result(folder)
        assert not target.exists()
        assert folder.parent.parent == target.parent  # the same file system: a rename will do
    assert sorted(file.name for file in target.iterdir()) == ["figures", "summary.json"]
    assert list(target.parent.iterdir()) == [target]
    plain = tmp_path / "plain"
    plain.mkdir()
    assert target.stat().st_mode == plain.stat().st_mode


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_any_error_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    with pytest.raises(error), output_folder(tmp_path / "deep" / "out") as folder:
        write_result(folder)
        raise error
    assert list(tmp_path.iterdir()) == []


def test_an_existing_result_stays_without_force(tmp_path: Path) -> None:
    write_whole(tmp_path / "summary.json", "{}")
    with pytest.raises(InputError, match="exists; use --force to repl"), output_folder(tmp_path):
        pytest.fail("work was begun")
    assert [file.name for file in tmp_path.iterdir()] == ["summary.json"]


def test_force_replaces_an_earlier_result_whole(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    write_result(target, "old")
    (target / "only_in_old").touch()
    with output_folder(target, force=True) as folder:
        write_result(folder, "new")
        assert (target / "summary.json").read_text() == "old"
    assert (target / "summary.json").read_text() == "new"
    assert not (target / "only_in_old").exists()
    assert list(tmp_path.iterdir()) == [target]


def test_a_failure_keeps_the_result_that_force_would_replace(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    write_result(target, "old")
    with pytest.raises(KeyboardInterrupt), output_folder(target, force=True) as folder:
        write_result(folder, "new")
        raise KeyboardInterrupt
    assert (target / "summary.json").read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_force_replaces_an_empty_folder(tmp_path: Path) -> None:
    with output_folder(tmp_path / "out"):
        pass
    with output_folder(tmp_path / "out", force=True) as folder:
        write_result(folder)
    assert (tmp_path / "out" / "summary.json").exists()


def test_force_does_not_replace_what_is_no_result(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(InputError, match=r"no summary\.json"), output_folder(tmp_path, force=True):
        pytest.fail("work was begun")
    assert (tmp_path / "thesis.tex").exists()


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "out").touch()
    with pytest.raises(InputError, match="is a file"), output_folder(tmp_path / "out", force=True):
        pytest.fail("work was begun")
    with (
        pytest.raises(InputError, match="cannot be written"),
        output_folder(tmp_path / "out" / "a"),
    ):
        pytest.fail("work was begun")


def test_current_home_and_root_directories_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, home = tmp_path / "here", tmp_path / "home" / "me"
    for folder in (here, home):
        folder.mkdir(parents=True)
        (folder / "summary.json").touch()
    monkeypatch.chdir(here)
    monkeypatch.setenv("HOME", str(home))
    for target in (Path(), here, home, home.parent, tmp_path, Path("/")):
        refused = pytest.raises(InputError, match=r"(is|contains) (the current|your home) dir")
        with refused, output_folder(target, force=True):
            pytest.fail("work was begun")
    assert (here / "summary.json").exists()
    assert (home / "summary.json").exists()


def test_a_target_made_meanwhile_is_not_overwritten(tmp_path: Path) -> None:
    target = tmp_path / "out"
    with pytest.raises(InputError, match="exists"), output_folder(target):
        target.mkdir()
        write_result(target, "somebody else's")
    assert (target / "summary.json").read_text() == "somebody else's"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_parent_without_access_is_said_so(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(InputError, match="cannot be written"), output_folder(tmp_path / "out"):
            pytest.fail("work was begun")
    finally:
        tmp_path.chmod(0o700)


def test_a_link_is_followed(tmp_path: Path) -> None:
    real = tmp_path / "real"
    real.mkdir()
    write_result(real, "old")
    link = tmp_path / "link"
    link.symlink_to(real)
    with output_folder(link, force=True) as folder:
        write_result(folder, "new")
    assert link.is_symlink()
    assert (real / "summary.json").read_text() == "new"


def killed(target: Path, *, replaced: bool = False) -> Path:
    """What a run to the target leaves behind that was killed with no chance to clean up."""
    workplace = target.parent / f".{target.name}.ab3_d_9z.partial"
    (workplace / target.name / "figures").mkdir(parents=True)
    if replaced:
        target.rename(workplace / f"{target.name}.replaced")
    return workplace


def test_the_next_run_removes_what_a_killed_one_left(tmp_path: Path) -> None:
    target = tmp_path / "out"
    leftover = killed(target)
    with output_folder(target) as folder:
        assert not leftover.exists()
        write_result(folder)
    assert list(tmp_path.iterdir()) == [target]


def test_leftovers_go_even_when_the_run_is_refused(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    write_result(target)
    killed(target)
    with pytest.raises(InputError, match="exists"), output_folder(target):
        pytest.fail("work was begun")
    assert list(tmp_path.iterdir()) == [target]


def test_what_a_living_run_writes_is_left_alone(tmp_path: Path) -> None:
    target = tmp_path / "out"
    with output_folder(target) as first:
        write_result(first, "first")
        with output_folder(target) as second:
            write_result(second, "second")
            assert first.is_dir()
        assert first.is_dir()
        (target / "summary.json").unlink()
        (target / "figures").rmdir()
        target.rmdir()
    assert (target / "summary.json").read_text() == "first"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("name", [".out.partial", ".out.backups_.partial", "out.ab3_d_9z.partial"])
def test_folders_of_other_people_are_no_leftovers(tmp_path: Path, name: str) -> None:
    (tmp_path / name / "thesis").mkdir(parents=True)
    with output_folder(tmp_path / "out") as folder:
        write_result(folder)
    assert (tmp_path / name / "thesis").is_dir()


def test_a_result_that_was_being_replaced_comes_back(tmp_path: Path) -> None:
    """Killed between two renames, on a file system that cannot exchange folders."""
    target = tmp_path / "out"
    target.mkdir()
    write_result(target, "old")
    killed(target, replaced=True)
    with pytest.raises(InputError, match="exists"), output_folder(target):
        pytest.fail("work was begun")
    assert (target / "summary.json").read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_with_force_the_target_is_there_at_every_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The target is never renamed away: one system call exchanges it (Linux, macOS)."""
    target = tmp_path / "out"
    target.mkdir()
    write_result(target, "old")
    rename = Path.rename

    def guarded(self: Path, to: Path) -> Path:
        assert self != target, "for a moment there is no result"
        return rename(self, to)

    monkeypatch.setattr(Path, "rename", guarded)
    with output_folder(target, force=True) as folder:
        write_result(folder, "new")
    assert (target / "summary.json").read_text() == "new"


def test_force_also_works_where_folders_cannot_be_exchanged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_exchange", lambda one, other: False)
    test_force_replaces_an_earlier_result_whole(tmp_path)


def test_a_second_interrupt_does_not_stop_the_cleaning_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    remove, calls = module.shutil.rmtree, []

    def impatient(*args: object, **kwargs: object) -> None:
        calls.append(args)
        if len(calls) == 1:
            raise KeyboardInterrupt
        remove(*args, **kwargs)

    monkeypatch.setattr(module.shutil, "rmtree", impatient)
    with pytest.raises(KeyboardInterrupt), output_folder(tmp_path / "out"):
        raise KeyboardInterrupt
    assert len(calls) == 2
    assert list(tmp_path.iterdir()) == []


def test_links_in_a_circle_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(InputError), output_folder(tmp_path / "a" / "out"):
        pytest.fail("work was begun")
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["a", "b"]
