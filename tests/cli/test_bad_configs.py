"""Bad scenarios, arms and scenes: exit 2, one line that names file, key and what is allowed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from pips_drake.config import dump_yaml
from pips_drake.errors import InputError
from pips_drake.scenarios import load_scenario
from pips_drake.scene.packages import find_arm_file, find_path_file
from pips_drake.serpentine.arm import load_arm
from pips_drake.serpentine.path_file import load_path
from pips_drake.serpentine.scenario import SerpentineScenario

# In a fresh checkout the first command of each kind waits for numba's compilation.
pytestmark = pytest.mark.timeout(300)

GOOD = "x_in,y_in,z_in\n16.255,0,0\n16.255,0,174.902\n16.255,0,176\n"

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
    "unknown machine": (
        dict(machine="crane"),
        "unknown machine 'crane'; known: cable_robot, planner, remote_manipulator, serpentine",
    ),
    "no machine": (
        dict(machine=None),
        "no key 'machine'; must be one of cable_robot, planner, remote_manipulator, serpentine",
    ),
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
    "fidelity": (dict(actuation=dict(fidelity="wire")), "actuation.fidelity = wire; must be"),
    "far away": (dict(mounting_position_m=[0, 0, 1e9]), "must be 3 numbers within +-1000"),
    "flat": (dict(mounting_position_m=[0, 0]), "mounting_position_m = [0.0, 0.0]; must be 3"),
    "blind": (dict(checks=dict(clearance_min_mm=501)), "must be > the clearances that checks"),
    **{
        f"negative {key}": (dict(checks={key: -0.1}), f"checks.{key} = -0.1; must be >= 0")
        for key in (
            "clearance_min_mm",
            "self_clearance_min_mm",
            "joint_overrun_max_deg",
            "rail_overrun_max_mm",
        )
    },
    "nothing allowed": (dict(checks=dict(force_fraction_max=0)), "force_fraction_max = 0.0; must"),
}


@pytest.mark.parametrize("case", SCENARIOS)
def test_a_bad_scenario_is_refused(assert_refused, pips_here, tmp_path, case):
    change, words = SCENARIOS[case]
    scenario = {"machine": "serpentine", "path": "trajectory_4"} | change
    (tmp_path / "bad.yaml").write_text(yaml.safe_dump(scenario))
    assert_refused(pips_here("simulate", "bad.yaml"), tmp_path, {"bad.yaml"}, words)


def bomb(first: str, next_one: str) -> bytes:
    """YAML of a key a line, each of which stands for ten times the one before."""
    lines = [f"a0: &a0 {first.format()}"]
    for i in range(1, 10):
        lines.append(f"a{i}: &a{i} " + next_one.format(",".join([f"*a{i - 1}"] * 10)))
    return "\n".join(lines).encode()


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
    "52 levels": (b"[" * 52 + b"]" * 52, "line 1: nested too deeply; must be at most 50 levels"),
    # Ten lines that stand for 10^9 values: what looks at each of them would never end.
    "a bomb of lists": (bomb("[1]", "[{}]"), "stands for over 100000 values"),
    "a bomb of merges": (bomb("{{x: 1}}", "{{<<: [{}]}}"), "stands for over 100000 values"),
    "too long": (b"#" * 500_001, "size = 500001 bytes; must be <= 500000"),
    "a long key": (b"k" * 1000 + b": 1\n", "no key 'machine'"),
    "a long name": (b"machine: " + b"k" * 99_999, "unknown machine 'kkk"),
    "UTF-16": ("machine: serpentine\n".encode("utf-16"), "not a text file in UTF-8"),
    "no such day": (b"machine: 2026-99-99\n", "not usable YAML: month must be in 1..12"),
    "endless digits": (b"machine: " + b"1" * 5000, "not usable YAML"),
    "an object": (b"!!python/object/apply:os.getcwd []", "line 1: not YAML"),
    "itself": (b"&a [*a]", "line 1: contains itself"),
    "a list for a key": (b"? [1]\n: 2\n", "bad.yaml: "),
}


@pytest.mark.parametrize("case", FILES)
def test_a_file_that_is_no_scenario_is_refused(assert_refused, pips_here, tmp_path, case):
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
def test_a_bad_arm_is_refused(assert_refused, pips_here, tmp_path, case):
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
        ["export", "bad.yaml"],
    ):
        outcome = pips_here(*command)
        assert_refused(outcome, tmp_path, {"bad.yaml", "scenario.yaml"}, "bad.yaml: ", words)


def mappings(data: Any, where: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every mapping in plain data, by the name that messages give it."""
    if isinstance(data, dict):
        yield where, data
        for key, item in data.items():
            yield from mappings(item, f"{where}.{key}" if where else key)
    elif isinstance(data, list):
        for index, item in enumerate(data):
            yield from mappings(item, f"{where}[{index}]")


def numbers(data: Any, where: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Every number that is no whole one in plain data: its name, and where to put another."""
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, item in items:
        dotted = f"{where}.{key}" if where else key
        name = dotted if isinstance(data, dict) else f"{where}[{key}]"
        if isinstance(item, dict | list):
            yield from numbers(item, name)
        elif isinstance(item, float):
            yield name, data, key


def whole_scenario() -> Any:
    return yaml.safe_load(dump_yaml(SerpentineScenario(path="trajectory_4")))


#: Good files with every key that there is: how to make one, and how to read it.
WHOLE: dict[str, tuple[Callable[[], Any], Callable[[Path], Any]]] = {
    "arm": (lambda: yaml.safe_load(find_arm_file("prototype").read_text()), load_arm),
    "path": (lambda: yaml.safe_load(find_path_file("trajectory_4_arcs").read_text()), load_path),
    "scenario": (whole_scenario, lambda file: load_scenario(str(file))),
}


def message(read: Callable[[Path], Any], file: Path, data: Any) -> str:
    """What is said of the data in a file."""
    file.write_text(yaml.safe_dump(data))
    with pytest.raises(InputError) as caught:
        read(file)
    return str(caught.value)


@pytest.mark.parametrize("kind", WHOLE)
def test_an_unknown_key_is_refused_at_every_level_and_said_where(tmp_path, kind):
    make, read = WHOLE[kind]
    file = tmp_path / "file.yaml"
    # Names of boxes are free.
    places = [where for where, _ in mappings(make()) if where != "boxes"]
    assert len(places) >= {"arm": 38, "path": 4, "scenario": 8}[kind]
    for where in places:
        data = make()
        dict(mappings(data))[where]["nothing"] = 1
        said = message(read, file, data)
        place = f"{where}: " if where else ""
        assert said.startswith(f"{file}: {place}unknown key 'nothing'"), said
        assert "; known: " in said


@pytest.mark.slow
@pytest.mark.parametrize("kind", WHOLE)
def test_a_number_that_is_none_is_refused_wherever_it_stands(tmp_path, kind):
    make, read = WHOLE[kind]
    file = tmp_path / "file.yaml"
    places = [where for where, _, _ in numbers(make())]
    assert len(places) >= {"arm": 100, "path": 9, "scenario": 30}[kind]
    for index, place in enumerate(places):
        value = (float("nan"), float("inf"), float("-inf"))[index % 3]
        data = make()
        (found,) = ((holder, key) for where, holder, key in numbers(data) if where == place)
        found[0][found[1]] = value
        said = message(read, file, data)
        assert said == f"{file}: {place} = {value}; must be a finite number"


@pytest.mark.slow
def test_no_mass_length_stiffness_or_limit_of_an_arm_may_be_negative_or_zero(tmp_path):
    make, read = WHOLE["arm"]
    file, count = tmp_path / "file.yaml", 0
    words = ("mass", "length", "width", "stiffness", "anchor", "limit", "size")
    for place, _, _ in list(numbers(make())):
        if not any(word in place for word in words):
            continue
        for value in (-1.0, 0.0):
            data = make()
            (found,) = ((holder, key) for where, holder, key in numbers(data) if where == place)
            found[0][found[1]] = value
            said = message(read, file, data)
            assert place.rpartition(".")[2].partition("[")[0] in said, (place, said)
            assert "> 0" in said
        count += 1
    assert count >= 40


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
def test_a_bad_scene_is_refused(assert_refused, pips_here, tmp_path, case):
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
