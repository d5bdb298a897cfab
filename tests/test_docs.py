"""The documents say what the code does: ports, error texts, and the tutorial's numbers."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import matplotlib as mpl
import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"


def test_the_page_of_ports_is_what_the_docstrings_say():
    spec = importlib.util.spec_from_file_location("make_ports", DOCS / "make_ports.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    page = (DOCS / "ports.md").read_text(encoding="utf-8")
    assert page == module.make(), "run `python docs/make_ports.py` and commit what it writes"
    for system in ("TipPathSource", "FollowTheLeaderController", "ActuatorServo", "CameraStation"):
        assert f"## {system}\n" in page


def test_the_diagram_of_the_remote_manipulators_phases_is_the_machines_table():
    spec = importlib.util.spec_from_file_location("make", DOCS / "make_remote_manipulator.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    page = (DOCS / "remote_manipulator.md").read_text(encoding="utf-8")
    renew = "run `python docs/make_remote_manipulator.py` and commit what it writes"
    assert page == module.with_diagram(page), renew
    assert "stowed --> extraction: acquired" in page


def _source_text() -> str:
    """All source with adjacent string literals joined, as the messages read when printed."""
    files = sorted((ROOT / "pips_drake").rglob("*.py"))
    source = "\n".join(file.read_text(encoding="utf-8") for file in files)
    return re.sub(r'"\s*\n\s*f?"', "", source)


def test_every_message_that_troubleshooting_quotes_is_one_of_ours():
    rows = (DOCS / "troubleshooting.md").read_text(encoding="utf-8").splitlines()
    quoted = [match.group(1) for row in rows if (match := re.match(r"\| `([^`]+)` \|", row))]
    assert len(quoted) >= 10
    source = _source_text()
    missing = [text for text in quoted if text not in source]
    assert not missing


def _cells() -> list[str]:
    notebook = json.loads((DOCS / "tutorial.ipynb").read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]


@pytest.mark.slow
def test_the_tutorial_runs_and_prints_what_it_promises(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mpl.use("Agg")
    names: dict[str, object] = {}
    for number, cell in enumerate(_cells()):
        exec(compile(cell, f"tutorial cell {number}", "exec"), names)  # noqa: S102
    out = capsys.readouterr().out
    # The report's Figure D.4, and FACTS for trajectory 4's end.
    assert "iterations: 2 1 1 1 1 1 1 1 1 1 1 1 1" in out
    assert "largest spine error: 0.0676 in" in out
    assert "d1 at the end: 113.194525 in" in out
    assert "-24.858013 24.576912 deg" in out
    assert "joint theta" in out, "the tight path breaks a joint's limit"
    assert re.search(r"pass: 39\.\d mm between \S+segment_3 pallet::pallet", out)
    assert "payload::payload" in out, "the blocked scene names what is hit"
    assert names["jump_arcs"] < 0.1 * names["jump_table"]
    assert list(tmp_path.iterdir()) == [], "the tutorial leaves nothing behind"


def test_the_example_of_planning_makes_a_plan_that_the_arm_can_follow(capsys):
    page = (DOCS / "planning.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    exec(compile(example, "planning.md", "exec"), {})  # noqa: S102
    assert capsys.readouterr().out == "True ()\n"


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda file: file.name)
def test_links_of_the_documents_lead_somewhere(page):
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target
