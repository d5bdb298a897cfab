"""Running the command as users do, and in this process where many cases are tried."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import pips_drake
from pips_drake import cli

ROOT = Path(pips_drake.__file__).resolve().parents[1]


@dataclass(frozen=True)
class Outcome:
    """What a command left on its outputs."""

    code: int
    out: str
    err: str


#: A message fits on a few lines of a terminal, whatever the input.
LONGEST_MESSAGE = 600


@pytest.fixture(scope="session")
def assert_refused() -> Callable[..., None]:
    """Fails unless a command refused its input: exit 2, one line with these words, no traces."""

    def check(outcome: Outcome, folder: Path, before: set[str], *words: str) -> None:
        assert outcome.code == 2, outcome
        assert outcome.out == ""
        assert outcome.err.startswith("pips: ")
        assert outcome.err.count("\n") == 1 and outcome.err.endswith("\n")
        assert len(outcome.err) <= LONGEST_MESSAGE
        for word in words:
            assert word in outcome.err
        assert "Traceback" not in outcome.err
        assert {entry.name for entry in folder.iterdir()} == before, "something was left"

    return check


def environment() -> dict[str, str]:
    """This process's, with the package found from any folder, installed or not."""
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    return os.environ | {"PYTHONPATH": os.pathsep.join(path for path in paths if path)}


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "pips_drake", *words]


@pytest.fixture(scope="session")
def pips() -> Callable[..., Outcome]:
    """Runs `pips` in a process of its own: pips(*words, cwd=folder)."""

    def run(*words: str, cwd: Path) -> Outcome:
        done = subprocess.run(
            command(*words), cwd=cwd, env=environment(), capture_output=True, text=True, timeout=280
        )
        return Outcome(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture(scope="session")
def start_pips() -> Callable[..., subprocess.Popen[str]]:
    """Starts `pips` and returns its process: start_pips(*words, cwd=folder)."""

    def start(*words: str, cwd: Path) -> subprocess.Popen[str]:
        return subprocess.Popen(
            command(*words),
            cwd=cwd,
            env=environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    return start


@pytest.fixture
def pips_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Outcome]:
    """Runs `pips` in this process, in `tmp_path`: much quicker, and warnings are errors."""
    monkeypatch.chdir(tmp_path)

    def run(*words: str) -> Outcome:
        capsys.readouterr()
        with pytest.raises(SystemExit) as caught:
            cli.main(list(words))
        said = capsys.readouterr()
        return Outcome(int(caught.value.code or 0), said.out, said.err)

    return run


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out what `pips follow` takes longest for, where a test looks at something else."""
    monkeypatch.setattr(
        "pips_drake.serpentine.runs.follow.write_plan_figures", lambda folder, plan: None
    )


@pytest.fixture(autouse=True)
def children_that_listen() -> Iterator[None]:
    """Signals that this process ignores (in the background, under nohup), children would too."""
    ignored = [n for n in (signal.SIGINT, signal.SIGHUP) if signal.getsignal(n) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, lambda *_: None)  # a handler of one's own is not inherited
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)
