"""The summary is strict JSON in a reader's order and names no folder of this machine."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pips_drake.twin.summary import read_summary, versions, write_summary


def test_versions_name_everything_a_result_depends_on() -> None:
    found = versions()
    assert list(found) == ["pips_drake", "drake", "python", "numpy", "scipy", "numba", "platform"]
    assert found["numpy"] == np.__version__
    assert found["drake"].startswith("1.")


def test_keys_stand_in_a_readers_order(tmp_path: Path) -> None:
    file = tmp_path / "summary.json"
    write_summary(
        file, {"versions": {"b": 1, "a": 2}, "wall_s": 1.0, "z": 1, "a": 2, "verdict": "pass"}
    )
    assert list(read_summary(file)) == ["verdict", "a", "z", "wall_s", "versions"]
    assert list(read_summary(file)["versions"]) == ["b", "a"]
    assert [other.name for other in tmp_path.iterdir()] == ["summary.json"]


def test_numpy_is_made_plain_and_what_json_lacks_is_null(tmp_path: Path) -> None:
    write_summary(
        tmp_path / "a.json",
        {
            "array": np.array([[1.5, np.nan]]),
            "flag": np.bool_(True),
            "count": np.int64(3),
            "size": np.float32(0.5),
            "worst": float("inf"),
            "pair": ("a", None),
        },
    )
    text = (tmp_path / "a.json").read_text()
    strict = json.loads(text, parse_constant=pytest.fail)
    assert strict == {
        "array": [[1.5, None]],
        "flag": True,
        "count": 3,
        "size": 0.5,
        "worst": None,
        "pair": ["a", None],
    }


def test_no_absolute_path_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    paths = [tmp_path / "runs" / "a.csv", Path("/opt/secret/b.csv"), Path("runs/c.csv")]
    write_summary(tmp_path / "a.json", {"files": paths})
    assert read_summary(tmp_path / "a.json") == {"files": ["runs/a.csv", "b.csv", "runs/c.csv"]}


def test_a_failure_leaves_the_earlier_file(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    write_summary(file, {"verdict": "pass"})
    with pytest.raises(TypeError, match=r"numbers\.first is a complex"):
        write_summary(file, {"numbers": {"first": 1j}})
    assert read_summary(file) == {"verdict": "pass"}
