"""The `pips` command.

Exit codes: 0 done and passed; 1 readable, but not followable or failed its checks (the folder is
kept: it shows where); 2 bad input (one line, nothing written); 130 interrupted.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Sequence
from typing import Any

import tyro

from pips_drake.command_line import (
    Interrupts,
    check_current_directory,
    complaint_in,
    tell_of_compiling,
)
from pips_drake.command_report import BAD_INPUT, FAILED, INTERRUPTED, complain
from pips_drake.commands import Check, Command, Follow, Plan, Simulate, Study, Verify
from pips_drake.errors import InputError, PipsError

# Where results cannot be written: no room, no right, or a medium that fails.
_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EIO}
_NOTHING_WRITTEN = "interrupted; nothing was written"
# What a shell says of a program that wrote to a closed pipe (128 + SIGPIPE).
PIPE_CLOSED = 141


def main(args: Sequence[str] | None = None) -> None:
    """Parses the command line, runs the command, and exits with its code."""
    try:
        try:
            code = _run(args)
        finally:
            sys.stdout.flush()  # here, where a closed pipe is an exception that can be caught
    except BrokenPipeError:
        # Whoever read our output has seen enough (`pips list | head -1`). What Python still holds
        # for it goes nowhere, or flushing it at exit would complain.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = PIPE_CLOSED
    if code == INTERRUPTED and args is None:
        # Everything is cleaned up, but a compiler that was interrupted may crash when taken down.
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


def _run(args: Sequence[str] | None) -> int:
    """Parses and runs; returns the exit code."""
    interrupts = Interrupts()
    if args is None:
        interrupts.install()
    try:
        command = _parse(args)
        check_current_directory()
        if isinstance(command, Follow | Check | Plan | Simulate | Verify | Study):
            tell_of_compiling()
        code: int = command.run()
        interrupts.end()
        return code
    except KeyboardInterrupt:
        interrupts.end()
        return complain(_NOTHING_WRITTEN, INTERRUPTED)
    except Exception as error:
        interrupts.end()
        if interrupts.came:
            return complain(_NOTHING_WRITTEN, INTERRUPTED)
        return _complain_of(error)
    finally:
        interrupts.end()  # for what else leaves, such as the parser's exit


def _complain_of(error: Exception) -> int:
    """Says what went wrong, in a line; returns the exit code. What is our own mistake is raised."""
    match error:
        case InputError():
            return complain(error, BAD_INPUT)
        case PipsError():
            return complain(error, FAILED)
        case OSError() if error.errno in _NO_ROOM:
            return complain(f"{error.filename or 'output'}: {error.strerror}", BAD_INPUT)
    raise error


def _parse(args: Sequence[str] | None) -> Any:
    """The command that the words of a command line stand for.

    Raises:
        InputError: they stand for none.
    """
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                Command,
                prog="pips",
                description="Digital twin of NASA's PIPS serpentine arm: will it touch anything, "
                "and can the arm do it?",
                args=args,
                use_underscores=True,
                config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.FlagCreatePairsOff),
            )
    except SystemExit as ended:
        if ended.code != BAD_INPUT:
            raise
    raise InputError(complaint_in(said.getvalue()))


if __name__ == "__main__":
    main()
