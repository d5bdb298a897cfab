"""Output appears whole or not at all: a temporary folder beside the target, then a rename.

The temporary folder, the workplace, is `.NAME.xxxxxxxx.partial`. Its maker holds a lock on it while
it lives, so that what a killed run left behind can be told from what another is writing: the next
run to the same target removes it.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import fcntl
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from pips_drake.errors import InputError

#: The file that every output folder of ours has; nothing without it is ever replaced.
SUMMARY_NAME = "summary.json"
#: Ends the names of temporary folders and files.
PARTIAL = ".partial"


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
    shown, target = target, _resolve(target)
    _remove_leftovers(target)
    _check_target(target, shown, force=force)
    made = _make_parents(target.parent, shown)
    finished = False
    try:
        try:
            workplace, lock = _make_workplace(target)
        except OSError as error:
            raise _cannot_write(shown, error) from None
        try:
            # Within it the folder itself gets the usual access rights; mkdtemp's are the owner's.
            folder = workplace / target.name
            folder.mkdir()
            yield folder
            _move_into_place(folder, target, shown, force=force)
            finished = True
        finally:
            _remove(workplace)
            os.close(lock)
    finally:
        if not finished:
            for parent in made:
                with contextlib.suppress(OSError):  # no longer empty: somebody else uses it
                    parent.rmdir()


def write_whole(file: Path, data: str | bytes) -> None:
    """Writes a file under a temporary name and renames it, so that no reader sees half of it."""
    temporary = file.with_name(f".{file.name}.{os.getpid()}{PARTIAL}")
    try:
        temporary.write_bytes(data.encode() if isinstance(data, str) else data)
        temporary.replace(file)
    finally:
        temporary.unlink(missing_ok=True)


def _resolve(target: Path) -> Path:
    try:
        return target.absolute().resolve()
    except (OSError, RuntimeError):  # links in a circle; which of the two depends on Python
        raise InputError(f"{target}: cannot be written (links that lead nowhere)") from None


def _make_workplace(target: Path) -> tuple[Path, int]:
    """A new temporary folder beside the target, and the descriptor that holds its lock."""
    while True:
        name = tempfile.mkdtemp(prefix=f".{target.name}.", suffix=PARTIAL, dir=target.parent)
        lock = os.open(name, os.O_RDONLY)
        with contextlib.suppress(OSError):  # a file system without locks: leftovers stay
            fcntl.flock(lock, fcntl.LOCK_EX)
        # Another run may have taken it for a leftover before it was locked.
        if Path(name).is_dir():
            return Path(name), lock
        os.close(lock)


def _remove_leftovers(target: Path) -> None:
    """Removes the workplaces of runs to this target that were killed."""
    ours = re.compile(rf"\.{re.escape(target.name)}\.\w{{8}}{re.escape(PARTIAL)}")
    try:
        found = [entry for entry in target.parent.iterdir() if ours.fullmatch(entry.name)]
    except OSError:
        return
    for workplace in found:
        with contextlib.suppress(OSError):
            inside = {entry.name for entry in workplace.iterdir()}
            if not inside <= {target.name, _replaced_name(target)}:
                continue  # somebody else's
            lock = os.open(workplace, os.O_RDONLY)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                replaced = workplace / _replaced_name(target)
                if replaced.is_dir() and not target.exists():  # killed between two renames
                    replaced.rename(target)
                _remove(workplace)
            finally:
                os.close(lock)


def _remove(folder: Path) -> None:
    """Removes a folder for good, even when the user presses Ctrl-C once more meanwhile."""
    try:
        shutil.rmtree(folder, ignore_errors=True)
    except KeyboardInterrupt:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def _replaced_name(target: Path) -> str:
    return f"{target.name}.replaced"


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
    if not target.exists():
        folder.rename(target)
        return
    if _exchange(folder, target):
        return
    replaced = folder.parent / _replaced_name(target)
    target.rename(replaced)
    try:
        folder.rename(target)
    except BaseException:
        replaced.rename(target)
        raise


def _exchange(one: Path, other: Path) -> bool:
    """Swaps two folders in one step, so that at no moment either is missing; False: cannot."""
    library = ctypes.CDLL(None, use_errno=True)
    first, second = os.fsencode(one), os.fsencode(other)
    if sys.platform == "darwin":
        call, arguments = "renamex_np", (first, second, 2)  # RENAME_SWAP
    else:
        here = -100  # AT_FDCWD
        call, arguments = "renameat2", (here, first, here, second, 2)  # RENAME_EXCHANGE
    function = getattr(library, call, None)
    if function is None:
        return False
    if function(*arguments) == 0:
        return True
    number = ctypes.get_errno()
    # Not on this file system.
    if number in (errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EXDEV):
        return False
    raise OSError(number, os.strerror(number), str(other))


def _cannot_write(shown: Path, error: OSError) -> InputError:
    return InputError(f"{shown}: cannot be written ({error.strerror})")
