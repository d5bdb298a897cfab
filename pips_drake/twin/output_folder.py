"""Output appears whole or not at all: a temporary folder beside the target, then a rename."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from pips_drake.errors import InputError

#: The file that every output folder of ours has; nothing without it is ever replaced.
SUMMARY_NAME = "summary.json"


@contextlib.contextmanager
def output_folder(target: Path, *, force: bool = False) -> Iterator[Path]:
    """Yields an empty folder to write into; it becomes `target` when the block ends normally.

    Whatever ends the block otherwise, an interrupt included, leaves the target as it was and
    nothing beside it. A run whose verdict is `fail` ends normally.

    Args:
        target: the folder to make; missing parents are made too.
        force: replace an earlier result. Only an empty folder or one with a `summary.json` is
            taken for one.

    Raises:
        InputError: before any work, the target exists or must not be replaced, or its parent
            cannot be written to; after it, somebody else made the target meanwhile.
    """
    shown, target = target, target.absolute().resolve()
    _check_target(target, shown, force=force)
    made = _make_parents(target.parent, shown)
    finished = False
    try:
        try:
            # Within it the folder itself gets the usual access rights; mkdtemp's are the owner's.
            workplace = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
        except OSError as error:
            raise _cannot_write(shown, error) from None
        try:
            folder = workplace / target.name
            folder.mkdir()
            yield folder
            _move_into_place(folder, target, shown, force=force)
            finished = True
        finally:
            shutil.rmtree(workplace, ignore_errors=True)
    finally:
        if not finished:
            for parent in made:
                with contextlib.suppress(OSError):  # no longer empty: somebody else uses it
                    parent.rmdir()


def write_whole(file: Path, data: str | bytes) -> None:
    """Writes a file under a temporary name and renames it, so that no reader sees half of it."""
    temporary = file.with_name(f".{file.name}.{os.getpid()}.partial")
    try:
        temporary.write_bytes(data.encode() if isinstance(data, str) else data)
        temporary.replace(file)
    finally:
        temporary.unlink(missing_ok=True)


def _check_target(target: Path, shown: Path, *, force: bool) -> None:
    precious = {"the current directory": Path.cwd()}
    with contextlib.suppress(RuntimeError):
        precious["your home directory"] = Path.home().resolve()
    for name, place in precious.items():
        if place.is_relative_to(target):
            holds = "is" if place == target else "contains"
            raise InputError(f"{shown}: {holds} {name}; give a folder of its own")
    if not target.exists():
        return
    if not target.is_dir():
        raise InputError(f"{shown}: is a file; must be a folder")
    if not force:
        raise InputError(f"{shown} exists; use --force to replace it")
    if os.path.ismount(target):
        raise InputError(f"{shown}: is a mount point and cannot be replaced; give a folder in it")
    if any(target.iterdir()) and not (target / SUMMARY_NAME).is_file():
        raise InputError(
            f"{shown}: has no {SUMMARY_NAME}, so it is no earlier result and is not replaced"
        )


def _make_parents(parent: Path, shown: Path) -> list[Path]:
    """Makes a folder and what it lacks above; returns what was made, innermost first."""
    missing = []
    for folder in [parent, *parent.parents]:
        if folder.exists():
            break
        missing.append(folder)
    try:
        parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _cannot_write(shown, error) from None
    return missing


def _move_into_place(folder: Path, target: Path, shown: Path, *, force: bool) -> None:
    # Checked again: the work took time, and the user may have used the name for something else.
    _check_target(target, shown, force=force)
    replaced = folder.parent / f"{folder.name}.replaced"
    if not target.exists():
        folder.rename(target)
        return
    target.rename(replaced)
    try:
        folder.rename(target)
    except BaseException:
        replaced.rename(target)
        raise


def _cannot_write(shown: Path, error: OSError) -> InputError:
    return InputError(f"{shown}: cannot be written ({error.strerror})")
