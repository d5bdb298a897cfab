"""How long `pips --help` keeps one waiting."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable

from benchmarks.measuring import Line, measure_in_turn


def measure(*, quick: bool) -> list[Line]:
    """Wall seconds of whole processes."""
    rounds = 2 if quick else 9
    commands = {
        "help": ["-m", "pips_drake", "--help"],
        "nothing": ["-c", "pass"],
        "drake": ["-c", "import pydrake.all"],
    }
    seconds = measure_in_turn(
        {name: _process(arguments) for name, arguments in commands.items()},
        rounds=rounds,
        clock=time.perf_counter,
    )
    shared = {"unit": "s", "ours": seconds["help"], "value_aim": 0.5}
    return [
        Line(
            name="help_drake",
            what="`pips --help`",
            beside='python -c "import pydrake.all"',
            peer=seconds["drake"],
            limits="Python's start, and tyro building the commands' help; Drake is not imported",
            **shared,
        ),
        Line(
            name="help_nothing",
            what="`pips --help`",
            beside='python -c "pass"',
            peer=seconds["nothing"],
            limits="The difference is tyro: its import, and building the commands' help",
            **shared,
        ),
    ]


def _process(arguments: list[str]) -> Callable[[], float]:
    def run() -> float:
        subprocess.run(
            [sys.executable, *arguments],
            check=True,
            stdout=subprocess.DEVNULL,
            env={**os.environ, "PYTHONWARNINGS": ""},
            timeout=60,
        )
        return 1

    return run
