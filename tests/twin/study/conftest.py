"""Work that studies send to other processes."""

from __future__ import annotations

from pathlib import Path

import pytest

WORK = """
import os, time

def square(task):
    x = task["x"]
    if x == 3:
        raise ValueError("three is\\n refused")
    return {
        "square": x * x, "nothing": float("nan"), "word": f"x{x}", "process": os.getpid()
    }

def fragile(task):
    if task["x"] == 2:
        os.kill(os.getpid(), 9)
    return {"square": task["x"] ** 2}

def endless(task):
    while task["x"] == 1:
        time.sleep(0.01)
    return {"square": task["x"] ** 2}

def unfit(task):
    return {"square": [1]}
"""


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A module that this process and its children can import."""
    (tmp_path / "modules").mkdir()
    (tmp_path / "modules" / "work_of_a_study.py").write_text(WORK)
    monkeypatch.syspath_prepend(str(tmp_path / "modules"))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "modules"))
    return "work_of_a_study"
