"""Bad input: exit 2, one line that says what is wrong and what is allowed, nothing left behind."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

# In a fresh checkout the first command of each kind waits for numba's compilation.
pytestmark = pytest.mark.timeout(300)

HEADER = "x_in,y_in,z_in\n"
BASE = HEADER + "16.255,0,0\n16.255,0,174.902\n"
GOOD = BASE + "16.255,0,176\n"


#: Path files that nobody can use: content (None: no file) and what the message says.
PATHS: dict[str, tuple[str | bytes | None, list[str]]] = {
    "missing": (None, ["path.csv", "known: trajectory_1"]),
    "empty": ("", ["path.csv", "empty", "x_in,y_in,z_in"]),
    "header only": (HEADER, ["path.csv", "0 rows", "two or more"]),
    "one row": (HEADER + "16.255,0,0\n", ["path.csv", "1 rows", "two or more"]),
    "nothing beyond home": (
        BASE,
        ["path.csv: ends at the home tip; must have a point beyond row 2"],
    ),
    "short row": (BASE + "1,2\n", ["path.csv", "row 3 has 2 values; must be 3"]),
    "text": (BASE + "16,a,2\n", ["path.csv", "row 3, y = 'a'; must be a number"]),
    "NaN": (BASE + "16,0,nan\n", ["path.csv", "row 3, z = nan; must be finite"]),
    "infinity": (BASE + "-inf,0,0\n", ["path.csv", "row 3, x = -inf; must be finite"]),
    "binary": (bytes(range(256)), ["path.csv", "not a text file"]),
    "zeros": (bytes(64), ["path.csv", "not a text file"]),
    "UTF-16": (GOOD.encode("utf-16"), ["path.csv", "not a text file in UTF-8"]),
    "an underscore": (BASE + "16,0,1_90\n", ["path.csv: row 3, z = '1_90'; must be a number"]),
    "a long word": (BASE + "16,0," + "x" * 10**5, ["row 3, z = 'xxx", "...'; must be a number"]),
    "a long line": (BASE + "1," * 10**5, ["row 3 has 100001 values; must be 3"]),
    "long": (BASE + "#" * 20_000_000, ["path.csv: size = 20000", "must be <= 20000000"]),
    "rows": (BASE + "16.255,0,176\n" * 20_000, ["number of rows = 20002; must be <= 20000"]),
    "repeated point": (BASE + "16.255,0,174.902\n", ["path.csv", "row 3 repeats row 2"]),
    "no unit": (GOOD.replace("_in", ""), ["header 'x,y,z'", "must be x_in,y_in,z_in or x_m,"]),
    "unknown unit": (GOOD.replace("_in", "_ft"), ["header 'x_ft,y_ft,z_ft'", "must be x_in"]),
    "mixed units": (GOOD.replace("y_in", "y_m"), ["header 'x_in,y_m,z_in'", "must be x_in"]),
    "home off the base line": (
        GOOD.replace("16.255,0,174.902", "16.255,0.06,174.902"),
        ["path.csv: row 2 is 0.060 in off the base line", "must be within 0.05 in"],
    ),
    "home out of reach": (
        HEADER + "16.255,0,0\n16.255,0,150\n16.255,0,160\n",
        ["path.csv: the home tip (row 2)", "d1 = -0.002 in; must be 24.900 .. 114.500 in"],
    ),
    "huge": (BASE + "1e300,0,0\n", ["row 3, x = 1e300; must be within +-39370.1 in"]),
    "huge in metres": (GOOD.replace("_in", "_m") + "0,0,-1e4\n", ["z = -1e4", "+-1000 m"]),
    "too long to plan": (BASE + "16.255,0,30000\n", ["path.csv: ", "must be at most 20000 steps"]),
}
COMMANDS = ("follow", "check", "simulate")


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("case", PATHS)
def test_a_bad_path_file_is_refused(assert_refused, pips_here, tmp_path, command, case):
    content, words = PATHS[case]
    if content is not None:
        (tmp_path / "path.csv").write_bytes(
            content if isinstance(content, bytes) else content.encode()
        )
    target = "path.csv"
    if command == "simulate":
        target = "scenario.yaml"
        (tmp_path / target).write_text("machine: serpentine\npath: path.csv\n")
    before = {entry.name for entry in tmp_path.iterdir()}
    assert_refused(pips_here(command, target), tmp_path, before, *words)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_folder_for_a_file_is_refused(assert_refused, pips_here, tmp_path, command):
    (tmp_path / "things").mkdir()
    outcome = pips_here(command, "things")
    assert_refused(outcome, tmp_path, {"things"}, "'things' is a folder; must be a shipped name")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_that_cannot_be_read_is_refused(
    assert_refused, pips_here, tmp_path, monkeypatch, command
):
    file = tmp_path / "locked"
    file.write_text("")

    usual = Path.read_text

    # For root every file can be read, so its access rights alone are no test.
    def read_text(self: Path, *args: Any, **kwargs: Any) -> str:
        if self.name == "locked":
            raise PermissionError(13, "Permission denied", str(self))
        return usual(self, *args, **kwargs)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "read_text", read_text)
        outcome = pips_here(command, "locked")
    assert_refused(outcome, tmp_path, {"locked"}, "locked: cannot be read (Permission denied)")


def test_a_path_that_turns_straight_back_cannot_be_smooth(assert_refused, pips_here, tmp_path):
    (tmp_path / "back.csv").write_text(BASE + "16.255,0,190\n16.255,0,185\n")
    outcome = pips_here("check", "back.csv")
    words = "back.csv: path 'back': turns straight back at row 3", "less than 180 deg"
    assert_refused(outcome, tmp_path, {"back.csv"}, *words)


#: Options that nobody can use, after `pips`.
OPTIONS = {
    "follow trajectory_4 --tolerance_in 0": "tolerance_in = 0.0; must be > 0",
    "follow trajectory_4 --tolerance_in -1": "tolerance_in = -1.0; must be > 0",
    "follow trajectory_4 --tolerance_in nan": "tolerance_in = nan; must be > 0",
    "follow trajectory_4 --tolerance_in inf": "tolerance_in = inf; must be > 0 and <= 1",
    "follow trajectory_4 --tolerance_in 1e300": "tolerance_in = 1e+300; must be > 0 and <= 1",
    "follow trajectory_4 --step_in 0": "step_in = 0.0 in; must be > 0",
    "follow trajectory_4 --step_in -0.25": "step_in = -0.25 in; must be > 0",
    "follow trajectory_4 --step_in nan": "step_in = nan in; must be > 0",
    "follow trajectory_4 --step_in inf": "step_in = inf in; must be > 0 and finite",
    "follow trajectory_4 --step_in 1e-300": "steps of 1e-300 in; must be at most 20000 steps",
    "follow trajectory_4 --max_iterations 0": "max_iterations = 0; must be >= 1",
    "follow trajectory_4 --max_iterations 99999999999999999999": "must be >= 1 and <= 1000",
    "follow trajectory_4 --arm nobody": "unknown arm 'nobody'; known: ",
    "follow trajectory_5": "unknown path 'trajectory_5' (did you mean 'trajectory_",
    "check trajectory_5": "unknown path 'trajectory_5' (did you mean 'trajectory_",
    "check trajectory_4 --arm nobody": "unknown arm 'nobody'; known: ",
    "check trajectory_4 --scene nowhere": "unknown scene 'nowhere'; known: ",
    "check trajectory_4 --mounting ceiling": (
        "unknown mounting 'ceiling'; known: laboratory, pad, pad_below"
    ),
    "check trajectory_4 --corner_deviation_in -1": "corner_deviation_in = -1.0; must be >= 0",
    "check trajectory_4 --corner_deviation_in nan": "corner_deviation_in = nan; must be a finite",
    "check trajectory_4 --corner_deviation_in 1e300": "= 1e+300; must be within +-1e+12",
    "simulate nothing": "unknown scenario 'nothing'; known: berth_payload",
    "simulate trajectory_4 --set motion.dwell_s": "must be KEY=VALUE, such as motion.dwell_s=2",
    "simulate trajectory_4 --set =2": "must be KEY=VALUE",
    "simulate trajectory_4 --set nothing=2": "unknown key 'nothing'; known: ",
    "simulate trajectory_4 --set motion.nothing=2": "unknown key 'nothing'; known: dwell_s, ",
    "simulate trajectory_4 --set motion.dwell_s.x=2": "has no fields of its own",
    "simulate trajectory_4 --set motion=2": "cannot be set from the command line",
    "simulate trajectory_4 --set motion.dwell_s=long": "'long' is not a number",
    "simulate trajectory_4 --set motion.dwell_s=nan": "motion.dwell_s = nan; must be a finite",
    "simulate trajectory_4 --set motion.dwell_s=-1": "motion.dwell_s = -1.0; must be >= 0",
    "simulate trajectory_4 --set motion.retract=2": "'2' is not true or false",
    "simulate trajectory_4 --set seed=1.5": "'1.5' is not a whole number",
    "simulate trajectory_4 --set machine=crane": "machine = crane; must be serpentine",
    "simulate trajectory_4 --set path=../cli.py": "'../cli.py'",
    "simulate trajectory_4 --set path=/etc/hostname": "lies outside",
    "export nobody": "unknown arm 'nobody'; known: ",
    "export prototype --out nowhere/arm.sdf": "nowhere: no such folder",
    "export prototype --force --out .": ".: is a folder; must be a file",
    "view nobody": "unknown model 'nobody'; known: ",
}


@pytest.mark.parametrize("words", OPTIONS)
def test_a_bad_option_is_refused(assert_refused, pips_here, tmp_path, words):
    assert_refused(pips_here(*words.split()), tmp_path, set(), OPTIONS[words])


@pytest.mark.parametrize("name", ["", "a\nb", "a\0b", "x" * 5000, "\x1b[31mred", "caf\udce9"])
def test_a_name_of_any_letters_is_refused_on_one_plain_line(
    assert_refused, pips_here, tmp_path, name
):
    for command in COMMANDS:
        outcome = pips_here(command, name)
        assert_refused(outcome, tmp_path, set())
        assert outcome.err[:-1].isprintable()


@pytest.mark.parametrize(
    "words",
    [
        "follow nobody.csv",
        "check nobody.csv",
        "simulate nobody.yaml",
        "simulate trajectory_4 --set x",
    ],
)
def test_so_it_is_from_a_shell(assert_refused, pips, tmp_path, words):
    outcome = pips(*words.split(), cwd=tmp_path)
    assert_refused(outcome, tmp_path, set())


#: Command lines that cannot be read, and what is said of them.
UNREADABLE = {
    "": "Expected one of {follow, check, plan, simulate, ",
    "nothing": "Unrecognized options: nothing; known: follow, check, plan, simulate, ",
    "follow": "follow: PATH is missing; see pips follow --help",
    "simulate": "simulate: SCENARIO is missing; see pips simulate --help",
    "follow a b": "Unrecognized options: b; see pips --help",
    "follow a --nothing": "Unrecognized options: --nothing; see pips --help",
    "follow a --step_in x": "--step_in 'x': must be a number; see pips --help",
    "follow a --tolerance_in 1,5": "--tolerance_in '1,5': must be a number; see pips --help",
    "follow a --max_iterations 1.5": "--max_iterations '1.5': must be a whole number; see pips",
    "check a --scene": "Missing value for argument '--scene'. Expected 1 values; see pips check",
}


@pytest.mark.parametrize("words", UNREADABLE)
def test_a_command_line_that_cannot_be_read_is_refused(assert_refused, pips_here, tmp_path, words):
    said = f"pips: {UNREADABLE[words]}"
    assert_refused(pips_here(*words.split()), tmp_path, set(), said, "--help")


@pytest.mark.slow
def test_so_it_is_on_a_terminal_that_draws_boxes(assert_refused, tmp_path, pips, monkeypatch):
    for encoding in ("utf-8", "ascii"):
        monkeypatch.setenv("PYTHONIOENCODING", encoding)
        for words in UNREADABLE:
            outcome = pips(*words.split(), cwd=tmp_path)
            assert_refused(outcome, tmp_path, set(), f"pips: {UNREADABLE[words]}", "--help")


def test_a_current_directory_that_is_gone_is_refused(assert_refused, pips_here, tmp_path):
    gone = tmp_path / "gone"
    gone.mkdir()
    os.chdir(gone)
    gone.rmdir()
    for words in (["follow", "trajectory_4"], ["check", "trajectory_4"], ["list"]):
        said = "the current directory cannot be used (No such file or directory); go to another"
        assert_refused(pips_here(*words), tmp_path, set(), said)


def test_what_is_no_plain_file_is_never_read(assert_refused, pips_here, tmp_path):
    """Reading a pipe or /dev/zero would not end."""
    os.mkfifo(tmp_path / "pipe")
    for name in ("pipe", "/dev/zero", "/dev/stdin"):
        for words in (*([command] for command in (*COMMANDS, "export", "view")), [*ARM]):
            outcome = pips_here(*words, name)
            assert_refused(outcome, tmp_path, {"pipe"}, f"'{name}'; known: ")


ARM = ("follow", "trajectory_4", "--arm")

#: Models that `pips view` cannot show.
MODELS: dict[str, tuple[bytes, str]] = {
    "empty.sdf": (b"", "empty.sdf: "),
    "broken.sdf": (b"<sdf><model", "broken.sdf: "),
    "binary.urdf": (bytes(range(256)), "binary.urdf: "),
    "table.csv": (GOOD.encode(), "table.csv: "),
}


@pytest.mark.parametrize("name", MODELS)
def test_a_bad_model_is_refused(assert_refused, pips_here, tmp_path, name):
    content, words = MODELS[name]
    (tmp_path / name).write_bytes(content)
    assert_refused(pips_here("view", name, "--once"), tmp_path, {name}, words)
