"""Studies: what is kept, what is computed again, and what the table says whatever happened."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import pytest

from pips_drake.config import load_yaml, validate
from pips_drake.errors import InputError
from pips_drake.twin.study.cases import Case, Outcome, compute
from pips_drake.twin.study.figure import study_figure
from pips_drake.twin.study.run import run_cases
from pips_drake.twin.study.store import open_store
from pips_drake.twin.study.study_file import StudyFile, VaryConfig
from pips_drake.twin.study.table import table_rows, write_table


def cases_of(work: str, count: int = 6, function: str = "square") -> list[Case]:
    return [
        Case(
            number=number,
            values={"thing.x": float(number)},
            task={"x": number},
            work=f"{work}:{function}",
            versions={"drake": "1"},
        )
        for number in range(1, count + 1)
    ]


class Here:
    """Computes in this process, last case first; is interrupted after some."""

    def __init__(self, patience: int = 1000) -> None:
        self.patience = patience
        self.computed: list[int] = []

    def run(self, cases: Sequence[Case]) -> Iterator[tuple[Case, Outcome]]:
        for case in reversed(cases):
            if len(self.computed) == self.patience:
                raise KeyboardInterrupt
            self.computed.append(case.number)
            yield case, compute(case.work, case.task)


def run_into(folder: Path, cases: list[Case], workers: Here, *, force: bool = False) -> bytes:
    with open_store(folder, name="squares", force=force) as store:
        outcomes = run_cases(cases, store=store, workers=workers, name="squares")
        write_table(folder / "study.csv", table_rows(cases, outcomes, ["square", "word"]))
    return (folder / "study.csv").read_bytes()


def test_the_table_says_what_came_of_every_case_in_order(work, tmp_path):
    table = run_into(tmp_path / "out", cases_of(work, 4), Here()).decode().splitlines()
    assert table == [
        "case,thing.x,status,square,word,reason",
        "1,1,done,1,x1,",
        "2,2,done,4,x2,",
        "3,3,failed,,,ValueError: three is refused",
        "4,4,done,16,x4,",
    ]


@pytest.mark.parametrize("patience", range(6))
def test_a_stopped_study_goes_on_where_it_was_and_ends_with_the_same_table(
    work, tmp_path, patience
):
    whole = run_into(tmp_path / "whole", cases_of(work), Here())
    first, second = Here(patience), Here()
    with pytest.raises(KeyboardInterrupt):
        run_into(tmp_path / "out", cases_of(work), first)
    assert run_into(tmp_path / "out", cases_of(work), second) == whole
    assert len(first.computed) == patience
    # No case twice, none left out; one that failed is a result too.
    assert sorted(first.computed + second.computed) == [1, 2, 3, 4, 5, 6]


def test_cases_that_compute_something_else_now_are_computed_again(work, tmp_path):
    cases = cases_of(work)
    run_into(tmp_path / "out", cases, Here())
    cases[1] = replace(cases[1], task={"x": 20})
    cases[4] = replace(cases[4], versions={"drake": "2"})
    again = Here()
    table = run_into(tmp_path / "out", cases, again)
    assert sorted(again.computed) == [2, 5]
    assert b"2,2,done,400,x20," in table


@pytest.mark.parametrize(
    "left", ["", "{", '{"key": 1}', "[]", '{"key": "KEY", "outcome": {"state": 1}}']
)
def test_a_damaged_result_is_computed_again(work, tmp_path, left):
    cases = cases_of(work)
    whole = run_into(tmp_path / "out", cases, Here())
    file = tmp_path / "out" / "cases" / "0002.json"
    file.write_text(left.replace("KEY", cases[1].key))
    again = Here()
    assert run_into(tmp_path / "out", cases, again) == whole
    assert again.computed == [2]


def test_a_study_with_fewer_cases_leaves_none_of_the_others(work, tmp_path):
    run_into(tmp_path / "out", cases_of(work, 6), Here())
    (tmp_path / "out" / "cases" / ".0006.json.123.partial").write_text("half")
    run_into(tmp_path / "out", cases_of(work, 2), Here())
    names = {file.name for file in (tmp_path / "out" / "cases").iterdir()}
    assert names == {"0001.json", "0002.json"}


def test_numbers_that_are_none_are_kept_as_none_and_other_things_fail(work):
    assert compute(f"{work}:square", {"x": 2}).numbers["nothing"] is None
    unfit = compute(f"{work}:unfit", {"x": 2})
    assert (unfit.status, unfit.numbers) == ("failed", {})
    assert "square is a list" in unfit.reason
    assert compute("no_such_module_at_all:run", {}).status == "failed"


def test_a_whole_study_is_replaced_by_force_alone(work, tmp_path):
    out, cases = tmp_path / "out", cases_of(work, 2)
    run_into(out, cases, Here())
    (out / "summary.json").write_text("{}")
    (out / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="--force"):
        run_into(out, cases, Here())
    again = Here()
    run_into(out, cases, again, force=True)
    assert sorted(again.computed) == [1, 2]
    assert not (out / "summary.json").exists()
    assert (out / "notes.txt").read_text() == "mine"


def test_folders_of_anything_else_are_left_alone(work, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.txt").write_text("mine")
    for force in (False, True):
        with pytest.raises(InputError, match=r"study\.json"):
            run_into(tmp_path / "out", cases_of(work), Here(), force=force)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "study.json").write_text(json.dumps({"study": "cubes"}))
    with pytest.raises(InputError, match="holds study 'cubes'"):
        run_into(tmp_path / "other", cases_of(work), Here())
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file"):
        run_into(tmp_path / "file", cases_of(work), Here())


def test_two_runs_do_not_write_one_folder(work, tmp_path):
    with (
        open_store(tmp_path / "out", name="squares"),
        pytest.raises(InputError, match="another run"),
    ):
        run_into(tmp_path / "out", cases_of(work), Here())


def test_grids_vary_the_last_field_fastest_and_lists_all_at_once():
    vary = [VaryConfig(field="a", values=[1.0, 2.0]), VaryConfig(field="b", words=["x", "y"])]
    grid = StudyFile(scenario="s", vary=vary).combinations()
    assert [tuple(row.values()) for row in grid] == [(1, "x"), (1, "y"), (2, "x"), (2, "y")]
    listed = StudyFile(scenario="s", combine="list", vary=vary).combinations()
    assert listed == [{"a": 1, "b": "x"}, {"a": 2, "b": "y"}]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scenario": ""}, "scenario"),
        ({"combine": "random"}, "grid or list"),
        ({"vary": []}, "list of fields"),
        ({"vary": [VaryConfig(field="a")]}, "either 'values' or 'words'"),
        ({"vary": [VaryConfig(field="a", values=[1.0], words=["b"])]}, "either"),
        ({"vary": [VaryConfig(field="a", values=[1.0, 1.0])]}, "without repetition"),
        ({"vary": [VaryConfig(field="a", values=[float("nan")])]}, "finite"),
        ({"vary": [VaryConfig(field="a", values=[1.0])] * 2}, "without repeated fields"),
        ({"set": {"a": "1"}}, "not varied as well"),
        ({"case_limit_s": -1.0}, "case_limit_s"),
        (
            {"vary": [VaryConfig(field=f"{i}", values=[*map(float, range(50))]) for i in range(3)]},
            "number of cases",
        ),
        (
            {
                "combine": "list",
                "vary": [
                    VaryConfig(field="a", values=[1.0]),
                    VaryConfig(field="b", values=[1.0, 2.0]),
                ],
            },
            "one length",
        ),
    ],
)
def test_studies_that_mean_nothing_are_refused(change, message):
    study = StudyFile(scenario="s", vary=[VaryConfig(field="a", values=[1.0])])
    validate(study)
    with pytest.raises(InputError, match=message):
        validate(replace(study, **change))


def test_a_study_file_says_numbers_and_words(tmp_path):
    (tmp_path / "s.yaml").write_text(
        "scenario: trajectory_4\nset: {scene: ''}\n"
        "vary:\n  - {field: a.b, values: [1, 2.5]}\n  - {field: c, words: ['true', x]}\n"
    )
    study = load_yaml(StudyFile, tmp_path / "s.yaml")
    assert [vary.choices for vary in study.vary] == [[1.0, 2.5], ["true", "x"]]
    assert study.set == {"scene": ""}


def test_the_figure_draws_gaps_words_and_more_lines_than_colours(tmp_path):
    rows = [
        {"case": 1, "x": x, "y": y, "z": None if x == 2.0 else x * y}
        for y in range(9)
        for x in (3.0, 1.0, 2.0)
    ]
    columns = {"z": ("Product", "mm", 1e3)}
    study_figure(tmp_path / "a.png", rows, x="x", others=["y"], columns=columns, title="numbers")
    words = [{"w": word, "z": z} for word, z in (("arcs", 1.0), ("table", 2.0))]
    study_figure(tmp_path / "b.png", words, x="w", others=[], columns=columns, title="words")
    for name in ("a.png", "b.png"):
        picture = matplotlib.image.imread(tmp_path / name)
        assert picture.shape[1] == 1500
        assert picture[..., :3].min() < 0.5, "something is drawn"
    alike = [{"x": x, "z": 1.0} for x in (1.0, 2.0)]
    study_figure(tmp_path / "c.png", alike, x="x", others=[], columns=columns, title="alike")
    assert not (tmp_path / "c.png").exists(), "there is nothing to see"
