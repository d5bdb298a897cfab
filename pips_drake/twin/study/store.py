"""The folder of a study: a file a finished case, so that a killed study goes on where it was.

    FOLDER/study.json       marks the folder as a study's: its name
    FOLDER/cases/0001.json  what came of case 1, with the key of what was computed
    FOLDER/summary.json     written last: the study is whole

While a study runs it holds a lock on the folder.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pips_drake.errors import InputError
from pips_drake.twin.output_folder import PARTIAL, SUMMARY_NAME, write_whole
from pips_drake.twin.study.cases import Case, Outcome

#: Marks a study's folder from its first moment on.
MARK_NAME = "study.json"
_CASES = "cases"


@dataclass(frozen=True, kw_only=True)
class ResultStore:
    """The results of a study's cases in its folder. Make one with `open_store`."""

    folder: Path

    def file(self, case: Case) -> Path:
        """Where a case's result stands."""
        return self.folder / _CASES / f"{case.number:04d}.json"

    def read(self, case: Case) -> Outcome | None:
        """What came of a case; None if it was not computed, or something else was."""
        try:
            data = json.loads(self.file(case).read_text(encoding="utf-8"))
            return Outcome(**data["outcome"]) if data["key"] == case.key else None
        except (OSError, ValueError, KeyError, TypeError):  # not there, or not whole
            return None

    def write(self, case: Case, outcome: Outcome) -> None:
        """Keeps what came of a case: from here on it is not computed again."""
        data = {
            "case": case.number,
            "key": case.key,
            "values": dict(case.values),
            "outcome": outcome.as_plain(),
            "versions": dict(case.versions),
        }
        text = json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        write_whole(self.file(case), text)

    def keep_only(self, cases: Sequence[Case]) -> None:
        """Removes files of cases that the study no longer has, and halves that a kill left."""
        wanted = {self.file(case) for case in cases}
        for file in (self.folder / _CASES).iterdir():
            ours = file.suffix == ".json" or file.name.endswith(PARTIAL)
            if ours and file not in wanted:
                file.unlink()


@contextlib.contextmanager
def open_store(folder: Path, *, name: str, force: bool = False) -> Iterator[ResultStore]:
    """Makes or takes up a study's folder, and holds its lock.

    Args:
        name: of the study; a folder of another one is not taken up.
        force: start anew where a study has results.

    Raises:
        InputError: the folder is something else, is whole, or is being written by another run.
    """
    _check(folder, name, force=force)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"{folder}: another run of the study writes it now") from None
        except OSError:  # a file system without locks
            pass
        _check(folder, name, force=force)  # the other run may have ended meanwhile
        if force:
            _clear(folder)
        try:
            write_whole(folder / MARK_NAME, json.dumps({"study": name}) + "\n")
            (folder / _CASES).mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
        try:
            yield ResultStore(folder=folder)
        finally:
            _remove_if_nothing_came(folder)
    finally:
        os.close(lock)


def _check(folder: Path, name: str, *, force: bool) -> None:
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InputError(f"{folder}: is a file; must be a folder")
    if not any(folder.iterdir()):
        return
    try:
        found = json.loads((folder / MARK_NAME).read_text(encoding="utf-8"))["study"]
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(
            f"{folder}: has no {MARK_NAME}, so it is no study's and is not written to"
        ) from None
    if force:
        return
    if found != name:
        raise InputError(f"{folder} holds study '{found}'; use --force to replace it")
    if (folder / SUMMARY_NAME).is_file():
        raise InputError(f"{folder} exists; use --force to replace it")


def _remove_if_nothing_came(folder: Path) -> None:
    """Leaves no folder behind where not even one case was computed."""
    with contextlib.suppress(OSError):
        (folder / _CASES).rmdir()  # fails where there are cases
        (folder / MARK_NAME).unlink()
        folder.rmdir()


def _clear(folder: Path) -> None:
    """Removes what a study writes, and nothing else."""
    (folder / SUMMARY_NAME).unlink(missing_ok=True)
    if (folder / _CASES).is_dir():
        shutil.rmtree(folder / _CASES)
    for file in folder.glob("study.*"):
        file.unlink()
