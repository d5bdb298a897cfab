"""`pips study` as a user runs it: listed, refused, killed, resumed, interrupted, on a cluster."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pips_drake import cli
from pips_drake.design_studies import study_descriptions
from pips_drake.errors import InputError
from pips_drake.scene.packages import find_file, find_study_file, list_names
from pips_drake.serpentine.runs.study import COLUMNS, make_cases, run_case
from pips_drake.twin.study.study_file import StudyFile, VaryConfig

ROOT = Path(cli.__file__).resolve().parents[1]

#: Two cases that are computed, one that cannot be (a value that its arm has not).
STUDY = """
scenario: trajectory_4
set: {scene: "", certificate.enabled: "false"}
vary:
  - {field: path.travel_in, values: [20.0, 40.0, 60.0]}
  - {field: arm.joint_limit_deg, values: [30.0, 10.0]}
"""


def run_study(folder: Path, *words: str) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main(["study", *words])
    return int(ended.value.code or 0)


def test_every_shipped_study_is_listed_with_a_line_and_can_be_made_into_cases(capsys):
    for name in list_names("study"):
        config = cli_config(name)
        assert make_cases(config, find_file("scenario", config.scenario))
        assert study_descriptions()[name]
    with pytest.raises(SystemExit):
        cli.main(["list"])
    assert "studies (pips study NAME)" in capsys.readouterr().out


def cli_config(name: str) -> StudyFile:
    from pips_drake.config import load_yaml

    return load_yaml(StudyFile, find_study_file(name))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("scenario: nowhere\nvary: [{field: path, words: [a]}]\n", "unknown scenario 'nowhere'"),
        ("scenario: trajectory_4\n", "vary"),
        ("scenario: trajectory_4\nvary: [{field: motion.sped, values: [1]}]\n", "sped"),
        ("scenario: trajectory_4\nvary: [{field: arm.lenght, values: [1]}]\n", "arm.lenght"),
        ("scenario: trajectory_4\nvary: [{field: path.turn, values: [1]}]\n", "path.travel_in"),
        ("scenario: trajectory_4\nvary: [{field: arm.travel_in, words: [far]}]\n", "a number"),
        ("scenario: trajectory_4\nvary: [{field: arm.travel_in, values: [-1]}]\n", "travel_in"),
        (
            "scenario: trajectory_4\nset: {path: trajectory_4}\n"
            "vary: [{field: path.travel_in, values: [9]}]\n",
            "is a table",
        ),
    ],
)
def test_studies_that_cannot_be_run_are_refused_in_one_line(
    text, words, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(text)
    assert run_study(tmp_path, "mine.yaml") == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert [file.name for file in tmp_path.iterdir()] == ["mine.yaml"]


def test_a_case_says_where_a_path_ends_that_cannot_be_followed():
    study = StudyFile(
        scenario="trajectory_4",
        set={"scene": "", "certificate.enabled": "false"},
        vary=[VaryConfig(field="arm.travel_in", values=[45.0])],
    )
    (case,) = make_cases(study, find_file("scenario", "trajectory_4"))
    numbers = run_case(case.task)
    assert set(numbers) <= set(COLUMNS)
    assert numbers["verdict"] == "fail"
    # The tip travels as the base does, nearly: 45 in of 89.5 in (two quarter circles).
    assert numbers["followed_share"] == pytest.approx(45.0 / 89.535, abs=0.01)
    assert "joint d1 leaves its limits" in numbers["failures"]


def test_a_cases_key_follows_what_it_computes_and_not_its_number():
    def keys(**changes: object) -> list[str]:
        study = StudyFile(
            scenario="trajectory_4", vary=[VaryConfig(field="arm.travel_in", values=[45.0, 60.0])]
        )
        for name, value in changes.items():
            setattr(study, name, value)
        return [c.key for c in make_cases(study, find_file("scenario", "trajectory_4"))]

    first, second = keys()
    assert first != second
    assert keys(vary=[VaryConfig(field="arm.travel_in", values=[60.0])]) == [second]
    assert keys() == [first, second]
    assert set(keys(simulate=True)).isdisjoint({first, second})
    assert set(keys(set={"scene": "trajectory_4_blocked"})).isdisjoint({first, second})


def start(folder: Path, *words: str) -> subprocess.Popen[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, "-m", "pips_drake", "study", "mine.yaml", *words],
        cwd=folder,
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def wait_for_a_case(process: subprocess.Popen[str], out: Path) -> None:
    deadline = time.monotonic() + 300.0
    while not list(out.glob("cases/0*.json")):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.02)


def members(group: int) -> list[int]:
    """Processes of a group that still run; zombies, whose parent has not looked yet, do not."""
    said = subprocess.run(["ps", "-eo", "pid=,pgid=,stat="], capture_output=True, text=True).stdout
    rows = [line.split() for line in said.splitlines()]
    return [int(pid) for pid, pgid, state in rows if int(pgid) == group and state[0] != "Z"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study that nobody disturbed."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "mine.yaml").write_text(STUDY)
    process = start(folder, "--out", "out", "--jobs", "1")
    _, said = process.communicate(timeout=500)
    assert process.returncode == 0, said
    return folder / "out"


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_study_has_its_table_its_figure_and_its_summary(whole):
    with (whole / "study.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["case"] for row in rows] == ["1", "2", "3", "4", "5", "6"]
    assert {row["status"] for row in rows} == {"done"}
    # 10 deg do not reach around a quarter circle of 28 in; 30 deg do, as the report says.
    assert [row["verdict"] for row in rows] == ["pass", "fail"] * 3
    assert (whole / "study.png").stat().st_size > 10_000
    assert json.loads((whole / "summary.json").read_text())["cases_by_status"]["done"] == 6


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_a_killed_study_resumes_and_ends_with_the_same_table(whole, tmp_path, how):
    (tmp_path / "mine.yaml").write_text(STUDY)
    out = tmp_path / "out"
    process = start(tmp_path, "--out", "out", "--jobs", "2")
    wait_for_a_case(process, out)
    os.kill(process.pid, how)
    _, said = process.communicate(timeout=60)
    deadline = time.monotonic() + 20.0
    while members(process.pid):  # its processes end with it
        assert time.monotonic() < deadline, members(process.pid)
        time.sleep(0.05)
    if how != signal.SIGKILL:
        assert process.returncode == 130
        assert "finished cases are kept in out: the same command goes on" in said
    assert not (out / "summary.json").exists()
    kept = {file: file.stat().st_mtime_ns for file in out.glob("cases/0*.json")}
    assert 1 <= len(kept) < 6
    again = start(tmp_path, "--out", "out", "--jobs", "2")
    _, said = again.communicate(timeout=500)
    assert again.returncode == 0, said
    assert {file: file.stat().st_mtime_ns for file in kept} == kept, "computed twice"
    assert (out / "study.csv").read_bytes() == (whole / "study.csv").read_bytes()


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.filterwarnings("ignore")  # what Dask's own processes and sockets leave behind
def test_a_cluster_ends_with_the_same_table(whole, tmp_path, monkeypatch):
    import distributed

    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    (tmp_path / "mine.yaml").write_text(STUDY)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        process = start(tmp_path, "--out", "out", "--cluster", cluster.scheduler_address)
        _, said = process.communicate(timeout=500)
    assert process.returncode == 0, said
    assert (tmp_path / "out" / "study.csv").read_bytes() == (whole / "study.csv").read_bytes()


def test_a_cluster_that_is_not_there_is_said_so(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert run_study(tmp_path, "travel", "--cluster", "tcp://127.0.0.1:9") == 2
    assert "pips-drake[cluster]" in capsys.readouterr().err
    assert not (tmp_path / "out" / "study_travel").exists()


def test_python_gets_the_same_errors(tmp_path):
    from pips_drake.design_studies import study

    with pytest.raises(InputError, match="--jobs = 0"):
        study("travel", out=tmp_path / "out", jobs=0)
