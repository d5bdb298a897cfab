"""A series survives its CSV file, and files that are no series are refused with their reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pips_drake.errors import InputError, UnknownNameError
from pips_drake.twin.recording import Series, read_csv, write_csv

NUMBERS = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False)


def make_series(rows: int = 3) -> Series:
    time = np.arange(rows) / 64
    return Series(
        time=time, values=np.column_stack([time**2, -time]), columns=("d1_m", "theta2_rad")
    )


@given(st.lists(st.tuples(NUMBERS, NUMBERS), max_size=20))
def test_numbers_read_back_to_one_part_in_1e12(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float]]
) -> None:
    file = tmp_path_factory.mktemp("csv") / "series.csv"
    table = np.array(rows).reshape(-1, 2)
    write_csv(Series(time=table[:, 0], values=table[:, 1:], columns=("x_m",)), file)
    back = read_csv(file)
    np.testing.assert_allclose(back.time, table[:, 0], rtol=1e-12, atol=0.0)
    np.testing.assert_allclose(back.values, table[:, 1:], rtol=1e-12, atol=0.0)


def test_the_file_has_a_header_with_units_and_short_numbers(tmp_path: Path) -> None:
    write_csv(make_series(), tmp_path / "a.csv", index="tip_arc_length_m")
    assert (tmp_path / "a.csv").read_text().splitlines() == [
        "tip_arc_length_m,d1_m,theta2_rad",
        "0,0,0",
        "0.015625,0.000244140625,-0.015625",
        "0.03125,0.0009765625,-0.03125",
    ]
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]


def test_nan_is_kept(tmp_path: Path) -> None:
    write_csv(Series(time=[0.0], values=[[np.nan]], columns=("x_m",)), tmp_path / "a.csv")
    assert np.isnan(read_csv(tmp_path / "a.csv").values).all()


def test_columns_are_found_by_name() -> None:
    series = make_series()
    np.testing.assert_array_equal(series.column("theta2_rad"), -series.time)
    assert series.select(["theta2_rad"]).columns == ("theta2_rad",)
    assert series.select([]).values.shape == (3, 0)
    with pytest.raises(UnknownNameError, match=r"theta3_rad.*theta2_rad"):
        series.column("theta3_rad")


@pytest.mark.parametrize(
    ("time", "values", "columns", "message"),
    [
        ([0.0, 1.0], [[1.0]], ("x_m",), r"\(2,\), values of shape \(1, 1\), 1 columns"),
        ([0.0], [[1.0]], ("x_m", "y_m"), "2 columns"),
        ([[0.0]], [[1.0]], ("x_m",), r"time of shape \(1, 1\)"),
        ([0.0], [[1.0, 2.0]], ("x_m", "x_m"), "x_m twice"),
        ([np.nan], [[1.0]], ("x_m",), "finite"),
    ],
)
def test_shapes_that_disagree_are_refused(
    time: list[float], values: list[list[float]], columns: tuple[str, ...], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Series(time=np.array(time), values=np.array(values), columns=columns)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "first column is nothing; must be 'time_s'"),
        ("s_m,x_m\n0,1\n", "first column is 's_m'; must be 'time_s'"),
        ("time_s,x_m\n0,1\n0,1,2\n", "line 3 has 3 values; must be 2"),
        ("time_s,x_m\n0,one\n", "line 2: .*'one'"),
        ("time_s,x_m,x_m\n0,1,2\n", "x_m twice"),
    ],
)
def test_files_that_are_no_series_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match=rf"a\.csv: .*{message}"):
        read_csv(tmp_path / "a.csv")


def test_a_missing_file_is_said_to_be_missing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_csv(tmp_path / "a.csv")


def test_the_index_may_not_be_a_value_too(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'d1_m' is the index and a value"):
        write_csv(make_series(), tmp_path / "a.csv", index="d1_m")
