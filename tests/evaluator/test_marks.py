"""Marks CSV of other programs: blanks, line ends and the order of columns are theirs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.errors import InputError
from evaluator.interchange.tracker_faults import mended
from evaluator.marks import columns_of, read_marks, write_marks

COLUMNS = ("time_s", *columns_of(("green", "yellow")))
ROWS = ["0.0, 1.0, 2.0, 3.0, 4.0", "0.1, , , 3.1, 4.1", "0.2,1.2,2.2,3.2,4.2"]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("between", [",", ", "])
def test_blanks_after_commas_and_any_line_end_are_read(tmp_path: Path, between: str, end: str) -> None:
    path = tmp_path / "marks.csv"
    path.write_bytes((end.join([between.join(COLUMNS), *ROWS]) + end).encode())
    table = read_marks(path)
    assert list(table) == list(COLUMNS)
    assert np.isnan(table["green_x_mm"].iloc[1])
    assert table["yellow_y_mm"].tolist() == [4.0, 4.1, 4.2]


def test_semicolons_with_decimal_commas_are_read(tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    path.write_text("time_s;green_x_mm;green_y_mm;yellow_x_mm;yellow_y_mm\n0,5;-1,25;2;3;4,75\n0,52;;;3;4\n", "utf-8")
    table = read_marks(path, ("green", "yellow"))
    assert table.iloc[0].tolist() == [0.5, -1.25, 2.0, 3.0, 4.75]
    assert table.iloc[1].isna().sum() == 2


def test_marks_may_be_asked_for_by_any_series_of_names(tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    path.write_text("\n".join([",".join(COLUMNS), *ROWS]) + "\n", encoding="utf-8")
    assert len(read_marks(path, iter(("green", "yellow", "blue")))) == 3  # two of three suffice
    with pytest.raises(InputError, match="lacks red_x_mm, red_y_mm"):
        read_marks(path, iter(("red", "green")))


@pytest.mark.parametrize("name", ["time_s", "green_y_mm", "green_x_px", "green_xy_cov_mm2"])
def test_text_in_a_column_of_numbers_is_refused_with_its_line(tmp_path: Path, name: str) -> None:
    path = tmp_path / "marks.csv"
    table = pd.DataFrame({"time_s": [0, 1], "note": ["a", "b"], name: ["2", "left"]})
    write_marks(table, path)
    with pytest.raises(InputError, match=f"line 3, {name} = 'left' is not a number"):
        read_marks(path)


def test_whole_numbers_are_read_as_such_of_any_other_column_and_notes_stay(tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    write_marks(pd.DataFrame({"time_s": [0, 1], "green_x_mm": [3, 4], "note": ["a", "b"]}), path)
    table = read_marks(path)
    assert (table["time_s"].dtype, table["green_x_mm"].dtype) == (float, float)
    assert table["note"].tolist() == ["a", "b"]


def test_a_time_that_goes_back_is_told_with_its_line_and_the_one_before(tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    path.write_text("time_s\n0.5\n0.75\n0.7\n0.8\n0.3\n", "utf-8")
    with pytest.raises(InputError, match=r"line 4, time_s = 0\.7 does not come after 0\.75 of the line before"):
        read_marks(path)


def test_rows_written_twice_count_once_and_later_lines_keep_their_numbers(tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    rows = ["0,1,2,lost,", "0,1,2,again,", "1,,,,", "1,,,,", "2,3,4,,"]
    path.write_text("\n".join(["time_s,green_x_mm,green_y_mm,note,green_x_sigma_mm", *rows]) + "\n", "utf-8")
    table = read_marks(path)
    assert table["time_s"].tolist() == [0.0, 1.0, 2.0]
    assert table.index.tolist() == [0, 1, 2]
    assert table.attrs["repeated"] == 2
    assert mended(table, ["green"]).notes == ["2 rows written twice, with the same time and places, count once"]
    for other in ("2,3,5,,", "2,,4,,", "2,3,4,,0.1"):  # another place at the same time, or another uncertainty
        path.write_text(path.read_text("utf-8").rstrip("\n") + f"\n{other}\n", "utf-8")
        with pytest.raises(InputError, match="line 7, time_s = 2 does not come after 2"):
            read_marks(path)


def test_a_place_farther_than_a_thousand_kilometres_is_none_on_a_plate(tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    path.write_text("time_s,green_x_mm,green_y_mm\n0,-1e9,\n1,1,1\n", "utf-8")
    assert read_marks(path)["green_x_mm"].iloc[0] == -1e9
    path.write_text("time_s,green_x_mm,green_y_mm\n0,1,1\n1,1,-1.01e9\n", "utf-8")
    with pytest.raises(InputError, match=r"line 3, green_y_mm = -1\.01e\+09 is not a position"):
        read_marks(path)


def test_an_infinite_place_is_a_missing_one(tmp_path: Path) -> None:
    path = tmp_path / "marks.csv"
    path.write_text("time_s,green_x_mm,green_y_mm,green_x_px,green_y_px\n0,inf,1,3,-inf\n1,1,1,3,3\n", "utf-8")
    table = read_marks(path)
    np.testing.assert_array_equal(table["green_x_mm"], [np.nan, 1])
    np.testing.assert_array_equal(table["green_y_px"], [np.nan, 3])


def test_a_file_may_be_named_by_its_text(tmp_path: Path) -> None:
    written, name = tmp_path / "marks.csv", str(tmp_path / "again.csv")
    written.write_text("\n".join([",".join(COLUMNS), *ROWS]) + "\n", encoding="utf-8")
    write_marks(read_marks(str(written)), name)
    assert read_marks(name).iloc[0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


@pytest.mark.parametrize(
    ("times", "said"),
    [
        (["0", "1e13", "2", "2e13"], "line 3, time_s = 1e+13 is not a time in seconds"),
        (["0", "1", "1", "0.5"], "line 5, "),  # the third row is the second, written twice
    ],
)
def test_the_first_line_with_an_impossible_time_is_named(tmp_path: Path, times: list[str], said: str) -> None:
    path = tmp_path / "marks.csv"
    path.write_text("\n".join([",".join(COLUMNS), *(f"{time},1,2,3,4" for time in times)]) + "\n", encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_marks(path)
    assert said in str(error.value)
