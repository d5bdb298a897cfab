"""Accidents at random moments: signals, a disk that fills up, damaged files. All seeded.

Whatever happens, an output folder is the old one, or the new one, whole; what a kill without notice
leaves beside it is removed by the next run.
"""

from __future__ import annotations

import json
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import pips_drake
from pips_drake.scene.packages import find_arm_file, find_path_file, find_scenario_file

pytestmark = pytest.mark.timeout(280)

ROOT = Path(pips_drake.__file__).resolve().parents[1]
INTERRUPTED = "pips: interrupted; nothing was written\n"
SHORT = "x_in,y_in,z_in\n16.255,0,0\n16.255,0,174.902\n16.255,0,180\n"
#: Short runs of what writes folders; `write_inputs` writes what they read.
RUNS = {
    "follow": ["follow", "short.csv"],
    "check": ["check", "short.csv"],
    "simulate": ["simulate", "short.yaml"],
}
INPUTS = {"short.csv", "short.yaml"}


def write_inputs(folder: Path) -> None:
    (folder / "short.csv").write_text(SHORT)
    (folder / "short.yaml").write_text("machine: serpentine\npath: short.csv\nduration_s: 0.25\n")


def wait_for_work(process: subprocess.Popen[str], folder: Path) -> None:
    """Waits until the temporary folder says that it has begun."""
    deadline = time.monotonic() + 120.0
    while not list(folder.glob("**/.*.partial")) and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.02)


def end(process: subprocess.Popen[str], number: int) -> tuple[int, str, str]:
    """Sends a signal, once, and waits."""
    with process:
        try:
            process.send_signal(number)
            out, err = process.communicate(timeout=60)
        finally:
            process.kill()
    return process.returncode, out, err


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGINT,
        pytest.param(signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, marks=pytest.mark.slow),
    ],
)
def test_an_interrupted_simulation_leaves_nothing(start_pips, tmp_path, number):
    process = start_pips("simulate", "trajectory_4", cwd=tmp_path)
    wait_for_work(process, tmp_path)
    time.sleep(0.5)
    code, out, err = end(process, number)
    # Interrupted in code that was compiled from text, Python ends by SIGINT itself: to a shell that
    # is 130 too.
    assert code in (130, -signal.SIGINT)
    assert out == ""
    assert err == INTERRUPTED
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_an_interrupt_is_not_lost_in_numbas_compiler(start_pips, tmp_path, monkeypatch):
    """In callbacks from C, of which numba has many, Python drops exceptions."""
    chance = random.Random(4)
    for case in range(6):
        # Nothing is compiled yet; once the first function is, many are left.
        cache = tmp_path / f"cache_{case}"
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
        folder = tmp_path / f"work_{case}"
        folder.mkdir()
        process = start_pips("follow", "trajectory_4", cwd=folder)
        while not list(cache.glob("*/*.nbc")):
            assert process.poll() is None
            time.sleep(0.02)
        time.sleep(3.0 * chance.random())
        begin = time.monotonic()
        code, out, err = end(process, signal.SIGINT)
        assert code in (130, -signal.SIGINT), err
        assert (out, err) == ("", INTERRUPTED)
        # Python looks for signals between two instructions, which LLVM makes far apart.
        assert time.monotonic() - begin < 20.0
        assert list(folder.iterdir()) == []


def complete(folder: Path, names: set[str]) -> bool:
    """Whether a result has all its files, and none is cut short."""
    found = {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}
    for file in folder.rglob("*.csv"):
        header, *_, last = file.read_text().split("\n")
        assert header and last == "", file
    assert json.loads((folder / "summary.json").read_text())["verdict"] in ("pass", "fail")
    return found == names


@pytest.mark.slow
@pytest.mark.parametrize("command", RUNS)
def test_signals_at_random_moments_leave_the_old_result_or_the_new_one(
    pips, start_pips, tmp_path, command
):
    chance = random.Random(command)
    write_inputs(tmp_path)
    words = [*RUNS[command], "--out", "result", "--force"]
    for _ in range(2):  # the first may compile
        begin = time.monotonic()
        assert pips(*words, cwd=tmp_path).code in (0, 1)
        duration = time.monotonic() - begin
    result = tmp_path / "result"
    names = {str(file.relative_to(result)) for file in result.rglob("*") if file.is_file()}
    kinds = set()
    for case in range(6):
        number = (signal.SIGKILL, signal.SIGINT, signal.SIGTERM)[case % 3]
        (result / "old.txt").write_text("of the earlier result")
        process = start_pips(*words, cwd=tmp_path)
        # From early to late, so that some come in time however the machine's speed changes.
        time.sleep(duration * (0.1 + 0.95 * (case + chance.random()) / 6))
        code, _, err = end(process, number)
        is_old = (result / "old.txt").exists()
        kinds.add(is_old)
        assert complete(result, names | ({"old.txt"} if is_old else set())), (case, number)
        if number == signal.SIGKILL:
            assert code in (0, 1, -signal.SIGKILL)
            continue
        assert code in (0, 1, 130, -number), (case, err)
        if code in (0, 1):
            assert not is_old
        elif "Traceback" in err:  # while modules are imported, before the command has begun
            assert is_old and err.endswith("KeyboardInterrupt\n") and "_run(" not in err
        else:
            assert err in (INTERRUPTED, "")
        assert {entry.name for entry in tmp_path.iterdir()} == INPUTS | {"result"}, case
    assert True in kinds, "no signal came early enough to show anything"
    # The next run removes what the kills left, be it refused or not.
    assert pips(*words[:-1], cwd=tmp_path).code == 2
    assert {entry.name for entry in tmp_path.iterdir()} == INPUTS | {"result"}


def limited(*words: str, cwd: Path, size: int) -> tuple[int, str, str]:
    """Runs `pips` where no file may grow beyond a size, bytes: as on a full disk, writing fails."""
    script = (
        "import resource, sys\n"
        f"sys.path.insert(0, {str(ROOT)!r})\n"
        "from pips_drake.cli import main\n"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, resource.RLIM_INFINITY))\n"
        "main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, *words],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=200,
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("command", RUNS)
def test_no_room_on_disk_is_said_in_one_line_and_leaves_nothing(pips, tmp_path, command):
    write_inputs(tmp_path)
    words = [*RUNS[command], "--out", "result"]
    assert pips(*words, cwd=tmp_path).code in (0, 1)  # so that everything is compiled
    sizes = {file.stat().st_size for file in (tmp_path / "result").rglob("*") if file.is_file()}
    shutil.rmtree(tmp_path / "result")
    # Each lets other files through: none, tables, all but the largest (a page, whose size differs
    # from run to run by some bytes).
    for size in sorted({0, sorted(sizes)[len(sizes) // 2] - 1, int(0.9 * max(sizes))}):
        code, out, err = limited(*words, cwd=tmp_path, size=size)
        assert code == 2, (size, err)
        assert out == ""
        assert re.fullmatch(r"pips: .+: (File too large|No space left on device)\n", err), err
        assert {entry.name for entry in tmp_path.iterdir()} == INPUTS


#: Damaged on the way to a command of its own: the file, and the command.
VICTIMS: dict[str, tuple[Path, list[str]]] = {
    "path.csv": (find_path_file("trajectory_4"), ["follow"]),
    "smooth.csv": (find_path_file("trajectory_3"), ["check"]),
    "pieces.yaml": (find_path_file("trajectory_1_arcs"), ["check"]),
    "arm.yaml": (find_arm_file("prototype"), ["follow", "short.csv", "--arm"]),
    "export.yaml": (find_arm_file("pcr_concept"), ["export"]),
    "scenario.yaml": (find_scenario_file("trajectory_2"), ["simulate"]),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", VICTIMS)
def test_damaged_files_end_commands_in_an_orderly_way(pips, tmp_path, name):
    file, words = VICTIMS[name]
    content, chance = file.read_bytes(), random.Random(name)
    option = ["--set", "duration_s=0.25"] if words[0] == "simulate" else []
    codes = []
    for case in range(4):
        folder = tmp_path / str(case)
        folder.mkdir()
        (folder / "short.csv").write_text(SHORT)
        data = bytearray(content)
        if case % 3 == 0:
            del data[chance.randrange(len(data)) :]
        else:
            for _ in range(3 * case):
                data[chance.randrange(len(data))] = chance.randrange(256 if case % 3 == 1 else 128)
        (folder / name).write_bytes(data)
        before = {entry.name for entry in folder.iterdir()}
        outcome = pips(*words, name, *option, cwd=folder)
        codes.append(outcome.code)
        assert outcome.code in (0, 1, 2), outcome
        assert "Traceback" not in outcome.err
        if outcome.code == 2:
            assert outcome.err.startswith("pips: ") and outcome.err.count("\n") == 1
            assert {entry.name for entry in folder.iterdir()} == before
    assert 2 in codes
