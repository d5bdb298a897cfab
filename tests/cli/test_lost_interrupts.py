"""An interrupt that Python drops in a callback from C comes again, and tells what broke by it.

Each case is a command of its own in a fresh interpreter, because signals, the alarm clock and the
hook belong to the process; pytest and its time limit use all three.
"""

from __future__ import annotations

import subprocess
import sys

import pytest

from .conftest import Outcome, environment

INTERRUPTED = "pips: interrupted; nothing was written\n"
#: What every script begins with; its command is `work`.
BEGIN = """
import atexit, ctypes, os, signal, sys, time
from pips_drake import cli
from pips_drake.errors import InputError, NotFollowableError

def call_from_c(function):
    "A function of ctypes is C, and what it calls is called from C."
    ctypes.CFUNCTYPE(None)(function)()

def interrupt():
    os.kill(os.getpid(), signal.SIGINT)
    print("not reached")

def busy(seconds):
    "Works, so that a signal finds an instruction to come between."
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        pass

class Command:
    def run(self):
        return work()

cli._parse = lambda args: Command()
"""


def run(script: str) -> Outcome:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", f"{BEGIN}\n{script}\ncli.main()\n"],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=60,
    )
    return Outcome(done.returncode, done.stdout, done.stderr)


def test_python_drops_an_interrupt_in_a_callback_from_c():
    """What the rest of this file is about: by itself Python carries on, and says so."""
    outcome = run("""
def work():
    call_from_c(interrupt)
    print("carried on")
    return 0

cli.Interrupts.install = lambda self: signal.signal(signal.SIGINT, signal.default_int_handler)
""")
    assert (outcome.code, outcome.out) == (0, "carried on\n")
    assert outcome.err.startswith("Exception ignored") and "KeyboardInterrupt" in outcome.err


def test_an_interrupt_that_is_dropped_in_a_callback_comes_again():
    outcome = run("""
def work():
    call_from_c(interrupt)
    print("carried on")
    time.sleep(5)
    return 0
""")
    assert outcome == Outcome(130, "carried on\n", INTERRUPTED)


def test_an_interrupt_that_is_dropped_again_comes_again():
    outcome = run("""
def work():
    call_from_c(interrupt)
    call_from_c(lambda: busy(1))
    print("carried on")
    call_from_c(lambda: busy(1))
    print("and on")
    time.sleep(5)
    return 0
""")
    assert outcome == Outcome(130, "carried on\nand on\n", INTERRUPTED)


@pytest.mark.parametrize("number", ["SIGTERM", "SIGHUP"])
def test_so_do_a_kill_and_the_end_of_a_terminal(number):
    outcome = run(f"""
def work():
    call_from_c(lambda: os.kill(os.getpid(), signal.{number}))
    time.sleep(5)
    return 0
""")
    assert outcome == Outcome(130, "", INTERRUPTED)


@pytest.mark.parametrize(
    "error", ["AttributeError('half made')", "InputError('half made')", "OSError(28, 'half made')"]
)
def test_what_breaks_while_an_interrupt_is_lost_ends_as_interrupted(error):
    outcome = run(f"""
def work():
    call_from_c(interrupt)
    raise {error}
""")
    assert outcome == Outcome(130, "", INTERRUPTED)


def test_what_a_lost_interrupt_left_half_made_is_not_reported_at_its_end():
    outcome = run("""
class HalfMade:
    def __del__(self):
        self.compiler

def work():
    call_from_c(interrupt)
    HalfMade()
    time.sleep(5)
""")
    assert outcome == Outcome(130, "", INTERRUPTED)


def test_without_an_interrupt_what_breaks_is_an_error_with_its_trace():
    outcome = run("""
class HalfMade:
    def __del__(self):
        self.compiler

def work():
    HalfMade()
    raise AttributeError("half made")
""")
    assert outcome.code == 1
    assert "Exception ignored" in outcome.err and "compiler" in outcome.err
    assert outcome.err.endswith("AttributeError: half made\n")


@pytest.mark.parametrize("leave", ["time.sleep(5)", "raise AttributeError('half made')"])
def test_an_interrupt_that_comes_again_does_not_cut_short_cleaning_up(leave):
    """The second way out begins before the interrupt is back, which then finds it cleaning up."""
    outcome = run(f"""
def work():
    try:
        call_from_c(interrupt)
        {leave}
    finally:
        busy(0.2)
        print("cleaned up")
""")
    assert outcome == Outcome(130, "cleaned up\n", INTERRUPTED)


@pytest.mark.parametrize("way", ["complain", "end"])
def test_an_interrupt_on_its_way_out_finds_nobody_to_disturb(way):
    """It comes again at every instant of the way out: while we complain, and before the end."""
    outcome = run(f"""
from pips_drake import command_line
spot = cli.complain if "{way}" == "complain" else command_line.Interrupts.end

def stretched(*args):
    busy(0.1)
    result = spot(*args)
    busy(0.1)
    return result

if "{way}" == "complain":
    cli.complain = stretched
else:
    command_line.Interrupts.end = stretched

def work():
    call_from_c(interrupt)
    raise AttributeError("half made")
""")
    assert outcome == Outcome(130, "", INTERRUPTED)


@pytest.mark.parametrize("code", [0, 1])
def test_no_interrupt_comes_after_the_end(code):
    """A command that is done is done: its folder stands, and its code says what it found."""
    outcome = run(f"""
from pips_drake import command_line
command_line._AGAIN = 1.0  # later than the end, however slow the machine
atexit.register(busy, 1.2)

def work():
    call_from_c(interrupt)
    print("done")
    return {code}
""")
    assert outcome == Outcome(code, "done\n", "")
