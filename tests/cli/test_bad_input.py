"""Bad input: exit 2, one line that says what is wrong and what is allowed, nothing left behind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from pips_drake.scene.packages import find_arm_file

# In a fresh checkout the first command of each kind waits for numba's compilation.
pytestmark = pytest.mark.timeout(300)

HEADER = "x_in,y_in,z_in\n"
BASE = HEADER + "16.255,0,0\n16.255,0,174.902\n"
GOOD = BASE + "16.255,0,176\n"


def assert_refused(outcome: Any, folder: Path, before: set[str], *words: str) -> None:
    assert outcome.code == 2, outcome
    assert outcome.out == ""
    assert outcome.err.startswith("pips: ")
    assert outcome.err.count("\n") == 1 and outcome.err.endswith("\n")
    for word in words:
        assert word in outcome.err
    assert "Traceback" not in outcome.err
    assert {entry.name for entry in folder.iterdir()} == before, "something was left"


#: Path files that nobody can use: content (None: no file) and what the message says.
PATHS: dict[str, tuple[str | bytes | None, list[str]]] = {
    "missing": (None, ["path.csv", "known: trajectory_1"]),
    "empty": ("", ["path.csv", "empty", "x_in,y_in,z_in"]),
    "header only": (HEADER, ["path.csv", "0 rows", "two or more"]),
    "one row": (HEADER + "16.255,0,0\n", ["path.csv", "1 rows", "two or more"]),
    "nothing beyond home": (BASE, ["'path'", "must have a point beyond row 2"]),
    "short row": (BASE + "1,2\n", ["path.csv", "row 3 has 2 values; must be 3"]),
    "text": (BASE + "16,a,2\n", ["path.csv", "row 3, y = 'a'; must be a number"]),
    "NaN": (BASE + "16,0,nan\n", ["path.csv", "row 3, z = nan; must be finite"]),
    "infinity": (BASE + "-inf,0,0\n", ["path.csv", "row 3, x = -inf; must be finite"]),
    "binary": (bytes(range(256)), ["path.csv", "not a text file"]),
    "zeros": (bytes(64), ["path.csv", "not a text file"]),
    "repeated point": (BASE + "16.255,0,174.902\n", ["path.csv", "row 3 repeats row 2"]),
    "no unit": (GOOD.replace("_in", ""), ["header 'x,y,z'", "must be x_in,y_in,z_in or x_m,"]),
    "unknown unit": (GOOD.replace("_in", "_ft"), ["header 'x_ft,y_ft,z_ft'", "must be x_in"]),
    "mixed units": (GOOD.replace("y_in", "y_m"), ["header 'x_in,y_m,z_in'", "must be x_in"]),
    "home off the base line": (
        GOOD.replace("16.255,0,174.902", "16.255,0.06,174.902"),
        ["row 2 is 0.060 in off the base line", "must be within 0.05 in"],
    ),
    "home out of reach": (
        HEADER + "16.255,0,0\n16.255,0,150\n16.255,0,160\n",
        ["d1 = -0.002 in; must be 24.900 .. 114.500 in"],
    ),
    "huge": (BASE + "1e300,0,0\n", ["row 3, x = 1e300; must be within +-39370.1 in"]),
    "huge in metres": (GOOD.replace("_in", "_m") + "0,0,-1e4\n", ["z = -1e4", "+-1000 m"]),
    "too long to plan": (BASE + "16.255,0,30000\n", ["must be at most 20000 steps"]),
}
COMMANDS = ("follow", "check", "simulate")


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("case", PATHS)
def test_a_bad_path_file_is_refused(pips_here, tmp_path, command, case):
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
def test_a_folder_for_a_file_is_refused(pips_here, tmp_path, command):
    (tmp_path / "things").mkdir()
    outcome = pips_here(command, "things")
    assert_refused(outcome, tmp_path, {"things"}, "'things' is a folder; must be a shipped name")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_that_cannot_be_read_is_refused(pips_here, tmp_path, monkeypatch, command):
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


def test_a_path_that_turns_straight_back_cannot_be_smooth(pips_here, tmp_path):
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
    "check trajectory_4 --scene nowhere": "unknown scene 'nowhere'; known: trajectory_",
    "check trajectory_4 --mounting ceiling": (
        "unknown mounting 'ceiling'; known: laboratory, pad, pad_below"
    ),
    "check trajectory_4 --corner_deviation_in -1": "corner_deviation_in = -1.0; must be >= 0",
    "check trajectory_4 --corner_deviation_in nan": "corner_deviation_in = nan; must be a finite",
    "check trajectory_4 --corner_deviation_in 1e300": "= 1e+300; must be within +-1e+12",
    "simulate nothing": "unknown scenario 'nothing'; known: trajectory_",
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
def test_a_bad_option_is_refused(pips_here, tmp_path, words):
    assert_refused(pips_here(*words.split()), tmp_path, set(), OPTIONS[words])


@pytest.mark.parametrize("name", ["", "a\nb", "a\0b", "x" * 5000, "\x1b[31mred", "caf\udce9"])
def test_a_name_of_any_letters_is_refused_on_one_plain_line(pips_here, tmp_path, name):
    for command in COMMANDS:
        outcome = pips_here(command, name)
        assert_refused(outcome, tmp_path, set())
        assert outcome.err[:-1].isprintable()


#: What a scenario may not say, on top of a good one, and what is said of it.
SCENARIOS: dict[str, tuple[dict[str, Any], str]] = {
    "unknown key": (dict(speed=1), "unknown key 'speed'"),
    **{
        f"unknown key in {part}": ({part: dict(nothing=1)}, f"{part}: unknown key 'nothing'")
        for part in ("motion", "solver", "actuation", "clocks", "checks", "view")
    },
    "NaN": (dict(motion=dict(dwell_s=float("nan"))), "motion.dwell_s = nan; must be a finite"),
    "infinity": (dict(duration_s=float("inf")), "duration_s = inf; must be a finite"),
    "huge": (dict(clearance_range_m=1e300), "clearance_range_m = 1e+300; must be within"),
    "no path": (dict(path=""), "path = ''; must be a shipped path or a file"),
    "nothing for a path": (dict(path=None), "path = null; must be text"),
    "unknown path": (dict(path="nowhere"), "unknown path 'nowhere'"),
    "unknown arm": (dict(arm="nobody"), "unknown arm 'nobody'"),
    "unknown scene": (dict(scene="nowhere"), "unknown scene 'nowhere'"),
    "unknown mounting": (dict(mounting="ceiling"), "unknown mounting 'ceiling'"),
    "unknown machine": (dict(machine="crane"), "unknown machine 'crane'; known: serpentine"),
    "no machine": (dict(machine=None), "no key 'machine'; must be one of serpentine"),
    "a list for a machine": (dict(machine=["serpentine"]), "unknown machine"),
    "a path outside": (dict(path="../../secret.csv"), "'../../secret.csv'"),
    "no speed": (dict(motion=dict(tip_speed_mm_per_s=0)), "tip_speed_mm_per_s = 0.0; must be > 0"),
    "no end in sight": (dict(motion=dict(tip_speed_mm_per_s=1e-9)), "must be 0.1 .. 1e4"),
    "waits for ever": (
        dict(motion=dict(dwell_s=1e9)),
        "motion.dwell_s = 1000000000.0; must be <= 86400",
    ),
    "no ramp": (dict(motion=dict(ramp_s=0)), "motion.ramp_s = 0.0; must be > 0"),
    "no tolerance": (dict(solver=dict(tolerance_in=0)), "solver.tolerance_in = 0.0; must be > 0"),
    "no iterations": (dict(solver=dict(max_iterations=0)), "solver.max_iterations = 0; must be"),
    "too many": (dict(solver=dict(max_iterations=10**6)), "must be >= 1 and <= 1000"),
    "other clock": (dict(clocks=dict(plant_hz=100)), "clocks.plant_hz = 100; must be a power"),
    "slow clock": (dict(clocks=dict(plant_hz=16)), "clocks.control_hz = 64; must be <= plant_hz"),
    "wild clock": (dict(clocks=dict(plant_hz=2**20)), "must be <= 65536"),
    "too short to record": (dict(duration_s=0.01), "duration_s = 0.01; must be 0, or at least"),
    "fidelity": (dict(actuation=dict(fidelity="truss")), "actuation.fidelity = truss; must be"),
    "far away": (dict(mounting_position_m=[0, 0, 1e9]), "must be 3 numbers within +-1000"),
    "flat": (dict(mounting_position_m=[0, 0]), "mounting_position_m = [0.0, 0.0]; must be 3"),
    "blind": (dict(checks=dict(clearance_min_mm=501)), "must be > the clearances that checks"),
    "nothing allowed": (dict(checks=dict(force_fraction_max=0)), "force_fraction_max = 0.0; must"),
}


@pytest.mark.parametrize("case", SCENARIOS)
def test_a_bad_scenario_is_refused(pips_here, tmp_path, case):
    change, words = SCENARIOS[case]
    scenario = {"machine": "serpentine", "path": "trajectory_4"} | change
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump(scenario))
    assert_refused(pips_here("simulate", "bad.yaml"), tmp_path, {"bad.yaml"}, words)


#: Files that are no scenario: content, and what is said of them.
FILES: dict[str, tuple[bytes, str]] = {
    "empty": (b"", "empty; must be a mapping"),
    "a list": (b"- 1\n", "the file = [1]; must be a mapping"),
    "a table": (GOOD.encode(), "must be a mapping"),
    "binary": (bytes(range(256)), "not a text file in UTF-8"),
    "zeros": (bytes(8), "not YAML"),
    "broken": (b"machine: [1, 2\n", "line 2: not YAML"),
    "a key twice": (b"machine: serpentine\nmachine: x\n", "line 2: key 'machine' repeats line 1's"),
    "deep": (b"[" * 20000, "nested too deeply"),
    "no such day": (b"machine: 2026-99-99\n", "not usable YAML: month must be in 1..12"),
    "endless digits": (b"machine: " + b"1" * 5000, "not usable YAML"),
    "an object": (b"!!python/object/apply:os.getcwd []", "line 1: not YAML"),
    "itself": (b"&a [*a]", "must be a mapping"),
    "a list for a key": (b"? [1]\n: 2\n", "bad.yaml: "),
}


@pytest.mark.parametrize("case", FILES)
def test_a_file_that_is_no_scenario_is_refused(pips_here, tmp_path, case):
    content, words = FILES[case]
    (tmp_path / "bad.yaml").write_bytes(content)
    outcome = pips_here("simulate", "bad.yaml")
    assert_refused(outcome, tmp_path, {"bad.yaml"}, "pips: bad.yaml: ", words)
    # For an arm it is as useless.
    outcome = pips_here("follow", "trajectory_4", "--arm", "bad.yaml")
    assert_refused(outcome, tmp_path, {"bad.yaml"}, "pips: bad.yaml: ")


#: What an arm may not say: text in the prototype's file, what stands there instead, and words.
ARMS: dict[str, tuple[str, str, str]] = {
    "negative mass": ("mass_kg: 24.0", "mass_kg: -24.0", "mass_kg = -24.0; must be > 0"),
    "NaN": ("mass_kg: 24.0", "mass_kg: .nan", "boxes.large.mass_kg = nan; must be a finite"),
    "huge": ("width_in: 9.0", "width_in: 1e300", "boxes.large.width_in = 1e+300; must be within"),
    "unknown key": ("name: prototype", "nam: prototype", "unknown key 'nam' (did you mean 'name'"),
    "unknown key in a box": ("mass_kg: 24.0", "mas_kg: 24.0", "boxes.large: unknown key 'mas_kg'"),
    "unknown key in a segment": (
        "{length_in: 20.035, offset_in: 1.250",
        "{len_in: 20.035, offset_in: 1.250",
        "segments[0]: unknown key 'len_in'",
    ),
    "unknown key in a joint": (
        "{name: d1, unit: in",
        "{name: d1, units: in",
        "joints[0]: unknown key 'units'",
    ),
    "unknown key in a drive": (
        "torque_limit_Nm:",
        "torque_Nm:",
        "motion_base_drives.theta2: unknown key 'torque_Nm'",
    ),
    "unknown box": ("box: large", "box: vast", "segments.box = vast; must be one of"),
    "no length": ("length_in: 20.035", "length_in: 0", "segments[0]"),
    "limits crossed": (
        "name: theta3, unit: deg, home: 0.0, lower: -30.0, upper: 30.0",
        "name: theta3, unit: deg, home: 0.0, lower: 30.0, upper: -30.0",
        "joints.theta3.lower = 30.0; must be < upper",
    ),
    "limits that no triangle has": (
        "name: theta3, unit: deg, home: 0.0, lower: -30.0",
        "name: theta3, unit: deg, home: 0.0, lower: -95.0",
        "joints.theta3: limits -95 .. 30 deg; must be inside -90 .. 90 deg",
    ),
    "a unit of another kind": ("unit: in, home", "unit: deg, home", "joints.d1.unit = deg; must"),
    "joints out of order": ("name: theta3,", "name: theta4,", "joints.name = theta4; must be"),
    "unknown base": ("kind: rail_crane", "kind: stewart", "motion_base.kind = stewart; must be"),
    "no name": ("name: prototype", "name: ''", "name = ''; must be a word"),
    "a path for a name": ("name: prototype", "name: ../up", "name = '../up'; must be a word"),
}


@pytest.mark.parametrize("case", ARMS)
def test_a_bad_arm_is_refused(pips_here, tmp_path, case):
    old, new, words = ARMS[case]
    text = find_arm_file("prototype").read_text()
    assert old in text
    (tmp_path / "bad.yaml").write_text(text.replace(old, new, 1))
    (tmp_path / "scenario.yaml").write_text(
        "machine: serpentine\npath: trajectory_4\narm: bad.yaml\n"
    )
    for command in (
        ["follow", "trajectory_4", "--arm", "bad.yaml"],
        ["check", "trajectory_4", "--arm", "bad.yaml"],
        ["simulate", "scenario.yaml"],
    ):
        outcome = pips_here(*command)
        assert_refused(outcome, tmp_path, {"bad.yaml", "scenario.yaml"}, "bad.yaml: ", words)


def model(link: str) -> str:
    return (
        "<sdf version='1.9'><model name='m'><static>true</static>"
        f"<link name='wall'>{link}</link></model></sdf>"
    )


BOX = "<collision name='c'><geometry><box><size>1 1 1</size></box></geometry></collision>"
#: Scene files that nobody can use: name, content, words.
SCENES: dict[str, tuple[str, str, str]] = {
    "loose body": (
        "s.sdf",
        f"<sdf version='1.9'><model name='m'><link name='wall'>{BOX}</link><link name='door'/>"
        "<joint name='hinge' type='revolute'><parent>wall</parent><child>door</child>"
        "<axis><xyz>0 0 1</xyz></axis></joint></model></sdf>",
        "body 'm::door' is loose; must be welded",
    ),
    "unknown tag": ("s.sdf", model(BOX + "<hue>red</hue>"), "hue"),
    "unknown directive": ("s.dmd.yaml", "directives:\n- add_wall: {name: a}\n", "add_wall"),
    "missing model": (
        "s.dmd.yaml",
        "directives:\n- add_model: {name: a, file: package://pips_drake/sdf/none.sdf}\n",
        "none.sdf",
    ),
    "unknown package": (
        "s.dmd.yaml",
        "directives:\n- add_model: {name: a, file: package://nobody/a.sdf}\n",
        "'nobody'",
    ),
    "nothing to touch": ("s.sdf", model(""), "no body has collision geometry"),
    "negative mass": ("s.sdf", model(BOX + "<inertial><mass>-1</mass></inertial>"), "inertia"),
    "empty": ("s.sdf", "", "s.sdf: "),
    "broken": ("s.sdf", "<sdf><model", "s.sdf: "),
    "no scene at all": ("s.csv", GOOD, "not a scene; must be one of *.dmd.yaml, *.sdf"),
    "empty directives": ("s.dmd.yaml", "", "s.dmd.yaml: "),
}


@pytest.mark.parametrize("case", SCENES)
def test_a_bad_scene_is_refused(pips_here, tmp_path, case):
    name, content, words = SCENES[case]
    (tmp_path / name).write_text(content)
    (tmp_path / "short.csv").write_text(GOOD)
    (tmp_path / "scenario.yaml").write_text(
        f"machine: serpentine\npath: short.csv\nscene: {name}\n"
    )
    for command in (["check", "short.csv", "--scene", name], ["simulate", "scenario.yaml"]):
        outcome = pips_here(*command)
        before = {name, "short.csv", "scenario.yaml"}
        assert_refused(outcome, tmp_path, before, f"pips: {name}: ", words)


@pytest.mark.parametrize(
    "words",
    [
        "follow nobody.csv",
        "check nobody.csv",
        "simulate nobody.yaml",
        "simulate trajectory_4 --set x",
    ],
)
def test_so_it_is_from_a_shell(pips, tmp_path, words):
    outcome = pips(*words.split(), cwd=tmp_path)
    assert_refused(outcome, tmp_path, set())


@pytest.mark.parametrize(
    "words", ["", "nothing", "follow", "follow a b", "follow a --nothing", "follow a --step_in x"]
)
def test_a_command_line_that_cannot_be_read_exits_2_and_points_at_the_help(
    pips_here, tmp_path, words
):
    outcome = pips_here(*words.split())
    assert outcome.code == 2
    assert outcome.out == ""
    assert "--help" in outcome.err
    assert "Traceback" not in outcome.err
