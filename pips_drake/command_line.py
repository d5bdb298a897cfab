"""What stands around every command: signals, the current directory, the parser's complaints."""

from __future__ import annotations

import re
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Any

from pips_drake.errors import InputError

#: How soon an interrupt that got lost comes again, s.
_AGAIN = 0.02


class Interrupts:
    """Makes every polite way to stop the program an interrupt that cleans up and is never lost.

    A kill, and a terminal that is closed, clean up as Ctrl-C does: no half-written folder stays
    behind. Under nohup the latter is ignored, and stays so; so is Ctrl-C in a shell's background.

    An exception raised in a callback from C (numba's compiler has many) goes no farther than the
    callback: Python reports it to a hook and carries on, with whatever the callback left undone. So
    the interrupt comes once more; and what breaks after the first breaks because of it.

    Attributes:
        came: whether there was an interrupt.
    """

    def __init__(self) -> None:
        self.came, self._lost, self._over = False, False, False
        self._report = sys.unraisablehook

    def install(self) -> None:
        """Takes the process's signals, its alarm clock, and Python's hook."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                signal.signal(number, self._interrupt)
        signal.signal(signal.SIGALRM, self._interrupt_again)
        sys.unraisablehook = self._look

    def end(self) -> None:
        """The command is done, well or not: no interrupt comes again.

        To be called before the last `except` or `try` is left: between there and the end an
        interrupt on its way finds no exception, and nobody who would catch it.
        """
        self._over = True  # first, for the one that is on its way
        if self._lost:  # else the clock may be another's
            signal.setitimer(signal.ITIMER_REAL, 0.0)

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        self.came = True
        raise KeyboardInterrupt

    def _interrupt_again(self, number: int, frame: FrameType | None) -> None:
        if sys.exception() is None and not self._over:
            raise KeyboardInterrupt
        # On the way out already, perhaps cleaning up, which must not be cut short.
        self._come_again()

    def _look(self, unraisable: Any) -> None:
        if issubclass(unraisable.exc_type, KeyboardInterrupt):
            self._come_again()
        elif not self.came:  # else it is of something that the interrupt left half made
            self._report(unraisable)

    def _come_again(self) -> None:
        self._lost = True
        if not self._over:
            signal.setitimer(signal.ITIMER_REAL, _AGAIN)


def tell_of_compiling() -> None:
    """Says on a terminal when the machine's first run compiles: half a minute of silence else."""
    if not sys.stderr.isatty():
        return
    # Here, because it takes half a second, and a help text needs none of it.
    from numba.core import event

    class Notice(event.Listener):
        def __init__(self) -> None:
            self.told = False

        def on_start(self, event: Any) -> None:
            if not self.told:
                self.told = True
                words = "compiling the mathematics for this machine, which is done once"
                sys.stderr.write(f"pips: {words}; up to a minute\n")

        def on_end(self, event: Any) -> None:
            pass

    event.register("numba:compile", Notice())


def check_current_directory() -> None:
    """Refuses to work in a directory that is gone: no relative name means anything there.

    Raises:
        InputError: says why.
    """
    try:
        Path.cwd()
    except OSError as error:
        raise InputError(
            f"the current directory cannot be used ({error.strerror}); go to another"
        ) from None


#: What Python says of text that is no number, and what is allowed instead.
_NUMBERS = {
    r"could not convert string to float: (.+?)$": "a number",
    r"invalid literal for int\(\) with base 10: (.+?)$": "a whole number",
}


def complaint_in(box: str) -> str:
    """tyro's box of several lines as one line: what is wrong, and where the help is."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", box)
    # Rules divide the title, what is wrong, help on the option, and where there is more help. Where
    # the output is not UTF-8 there is no box, and rules are of hyphens.
    rule = re.compile(r"[-─╭╮╰╯] ?.*[-─]{3,}[╮╯]?")
    lines = [line.strip("│ ") for line in plain.splitlines()]
    if lines and not rule.fullmatch(lines[0]):
        del lines[0]
    blocks: list[list[str]] = [[]]
    for line in lines:
        if rule.fullmatch(line):
            blocks.append([])
        elif line:
            blocks[-1].append(line)
    parts = [" ".join(" ".join(block).split()) for block in blocks if block] or ["no words"]
    where = re.search(r"pips [\w ]*--help", parts[-1])
    wrong = parts[0]
    if wrong.startswith("Missing from "):  # then comes the option, and then its help
        missing = next(block for block in blocks if block)
        wrong = f"{missing[0].removeprefix('Missing from pips ')} {missing[1]} is missing"
    option = re.match(r"Error parsing (-\S+):", wrong)
    for pattern, allowed in _NUMBERS.items():
        number = re.search(pattern, wrong)
        if option and number:
            wrong = f"{option[1]} {number[1]}: must be {allowed}"
    if len(parts) > 2 and parts[1].startswith("Available subcommands"):
        wrong += f"; known: {parts[1].partition(': ')[2]}"
    return f"{wrong.rstrip('.')}; see {where[0] if where else 'pips --help'}"
