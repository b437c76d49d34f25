"""What tables look like as text."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration import tables
from evaluator.errors import InputError
from evaluator.files import csv_tables as module
from evaluator.files import read_with
from evaluator.files.csv_tables import csv_text, read_runs, write_table
from evaluator.marks import read_marks
from evaluator.settings import load_measured
from simulator import units


def of_pandas(table: pd.DataFrame) -> str:
    return table.to_csv(index=False, float_format="%.9g")


@given(st.lists(st.tuples(st.floats(), st.integers(-(2**63), 2**63 - 1), st.text("ab .", max_size=3)), max_size=9))
def test_text_of_a_table_is_that_of_pandas_to_the_byte(rows: Sequence[tuple[float, int, str]]) -> None:
    table = pd.DataFrame(
        {
            "x_mm": np.array([row[0] for row in rows], float),
            "frame": np.array([row[1] for row in rows], int),
            "status": [row[2] for row in rows],
        }
    )
    assert "".join(csv_text(table)) == of_pandas(table)


@pytest.mark.parametrize(
    "table",
    [
        pd.DataFrame({"a": [1.0, 2.0], "b": ["one, two", 'say "so"']}),
        pd.DataFrame({"a": [1.0, 2.0], "b": ["two\nlines", "x"]}),
        pd.DataFrame({"a": [1.0, 2.0], "b": ["x", None]}),
        pd.DataFrame({"a": [1.0, 2.0], "b": [True, False]}),
        pd.DataFrame({"a": [1.0, 2.0], "b": [1, "x"]}),
        pd.DataFrame({"a": [1.0, 2.0], "b": [[1], [2]]}),
        pd.DataFrame({"a, b": [1.0], "c": [2.0]}),
        pd.DataFrame({"only": ["", "x"]}),
        pd.DataFrame({"a": np.array([0.1, 2.0], np.float32), "b": np.array([1, 2], np.uint8)}),
        pd.DataFrame({"a": pd.array([1, None], dtype="Int64"), "b": [1.0, math.inf]}),
        pd.DataFrame({"a": [], "b": []}),
        pd.DataFrame(),
    ],
)
def test_cells_that_need_more_than_writing_down_are_left_to_pandas(table: pd.DataFrame) -> None:
    assert "".join(csv_text(table)) == of_pandas(table)


@pytest.mark.parametrize("words", [["ok"] * 5, ['"', "a,b", "", "x", "y"]])
@pytest.mark.parametrize("begin_s", [0.0, 36_000.0, 1e6, 1.7e9, -1.7e9])
def test_times_of_a_clock_that_counts_from_long_ago_keep_their_microseconds(
    words: Sequence[str], begin_s: float, tmp_path: Path
) -> None:
    times = begin_s + np.arange(5) / 60
    write_table(pd.DataFrame({"time_s": [*times[:4], math.nan], "note": words}), tmp_path / "t.csv")
    written = pd.read_csv(tmp_path / "t.csv")["time_s"]
    assert written[:4].to_numpy() == pytest.approx(times[:4], rel=0, abs=1e-6)
    assert math.isnan(written[4])
    assert len(str(written[0])) < 20


def test_times_within_a_thousand_seconds_have_nine_digits_and_no_number_more_than_it_holds() -> None:
    table = pd.DataFrame({"time_s": [999.1234567891, math.inf, -math.inf], "start_time_s": [1e300, 0.1, 0.2]})
    assert "".join(csv_text(table)).splitlines()[1:] == [
        "999.123457,1.0000000000000001e+300",
        "inf,0.10000000000000001",
        "-inf,0.20000000000000001",
    ]


def test_a_long_table_is_written_in_pieces_and_each_row_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ROWS", 4)
    table = pd.DataFrame({"a": np.arange(11) / 7, "b": np.where(np.arange(11) == 5, np.nan, 1e-9), "c": ["ok"] * 11})
    pieces = list(csv_text(table))
    assert len(pieces) == 4
    assert "".join(pieces) == of_pandas(table)


@pytest.mark.parametrize("name", ["01", "1e5", "null", "NA", "nan"])
def test_ids_of_runs_that_look_like_numbers_or_like_nothing_are_read_as_they_were_written(
    name: str, tmp_path: Path
) -> None:
    write_table(pd.DataFrame({"run": [name], "radius_mm": [np.nan], "group": ["01"]}), tmp_path / "turning.csv")
    read = read_runs(tmp_path / "turning.csv")
    assert read["run"].tolist() == [name]
    assert read["radius_mm"].isna().all()
    assert read["group"].tolist() == ["01"]


NUMBERS = pd.DataFrame({"time_s": [0.0, 0.5, 1.25], "x_mm": [1.5, math.nan, -2.0]})
TEXT = "time_s,x_mm\n0.0,1.5\n0.5,\n1.25,-2.0\n"


@pytest.mark.parametrize("read", [module.read_table, units.read_table])
@pytest.mark.parametrize(
    "written",
    [
        TEXT.encode("utf-8-sig"),
        TEXT.replace(",", ";").replace(".", ",").encode(),
        TEXT.replace(",", "\t").replace(".", ",").encode(),
        TEXT.replace("time_s,x_mm", '"time_s", "x_mm"').encode(),
        f"{TEXT},\n,\n".replace("\n", "\r\n").encode(),
        f"# rig 2; light, left\n#\n\n# 0 to 2 s\n{TEXT}".encode("utf-8-sig"),
        f"# {TEXT}".encode(),
        f"# rig 2\n#{TEXT}".encode("utf-8-sig"),
        f"# {TEXT}".replace(",", ";").replace(".", ",").encode(),
        f"sep=;\n# {TEXT}".replace(",", ";").replace(".", ",").encode(),
    ],
    ids=[
        *("byte order mark", "semicolons", "tabs", "quotes", "empty rows at the end"),
        *("comments", "names of numpy.savetxt", "the last comment names", "with decimal commas", "separator, names"),
    ],
)
def test_a_table_is_read_as_spreadsheets_write_it(
    read: Callable[[Path], pd.DataFrame], written: bytes, tmp_path: Path
) -> None:
    (tmp_path / "t.csv").write_bytes(written)
    pd.testing.assert_frame_equal(read(tmp_path / "t.csv"), NUMBERS)


@pytest.mark.parametrize(("head", "line"), [("", 3), ("# a\n# b\n", 5), ("sep=,\n# c\n\n", 6)])
def test_rows_have_the_numbers_of_their_lines_after_comments(head: str, line: int, tmp_path: Path) -> None:
    for text in (head + TEXT, head + TEXT.replace("time_s", "# time_s")):
        (tmp_path / "t.csv").write_text(text)
        assert tables.line_of(module.read_table(tmp_path / "t.csv"), 1) == line


@pytest.mark.parametrize("text", ["# time_s,x_mm\n", "# notes\n# more\n", "# one, two, three\n0,1\n1,2\n"])
def test_comments_are_no_table(text: str, tmp_path: Path) -> None:
    """Three words are not the names of two columns."""
    (tmp_path / "t.csv").write_text(text)
    head = tables.table_head(text.splitlines())
    assert not head.commented
    with pytest.raises(InputError, match=r"lacks time_s|is empty"):
        read_marks(tmp_path / "t.csv")


@pytest.mark.parametrize("read", [module.read_table, units.read_table])
@pytest.mark.parametrize(
    ("written", "said"),
    [
        (TEXT.replace(",", "\t").encode("utf-16"), "probably in UTF-16, the Unicode text of spreadsheets"),
        (TEXT.encode("utf-16-be"), "probably in UTF-16, the Unicode text of spreadsheets"),
        ("µ,time_s\n0,1\n".encode("latin-1"), "not a CSV table in UTF-8 (byte 0)"),
    ],
)
def test_a_table_in_another_encoding_says_how_to_save_it(
    read: Callable[[Path], pd.DataFrame], written: bytes, said: str, tmp_path: Path
) -> None:
    (tmp_path / "t.csv").write_bytes(written)
    with pytest.raises(ValueError, match=r"save it as CSV UTF-8$") as error:
        read(tmp_path / "t.csv")
    assert str(error.value) == f"{tmp_path / 't.csv'}: {said}; save it as CSV UTF-8"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("root\nsync\n# mail\nlist,Mail,/var,no\n", "line 4 has 4 cells, the lines before it have 1"),
        ("# notes\na,b\n1,2\n\n1,2,3\n", "line 5 has 3 cells, the lines before it have 2"),
        ('a,b\n1,2\n"1,2\n3,4\n', "a quotation mark in it is not closed"),
    ],
)
def test_a_text_that_is_no_table_is_told_without_words_of_the_parser(text: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(InputError) as error:
        module.read_table(tmp_path / "t.csv")
    assert str(error.value) == f"{tmp_path / 't.csv'}: not a CSV table ({why})"


@pytest.mark.parametrize("read", [module.read_table, units.read_table])
def test_an_empty_file_is_told_as_such(read: Callable[[Path], pd.DataFrame], tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("")
    with pytest.raises(ValueError, match=r"t.csv: the file is empty$"):
        read(tmp_path / "t.csv")


@pytest.mark.parametrize("head", ["time_s,x_mm", '"time_s";"x_mm"', "time_s\tx_mm\r"])
def test_a_table_in_place_of_settings_is_told_as_such(head: str, tmp_path: Path) -> None:
    (tmp_path / "r01.csv").write_text(f"{head}\n0,1\n")
    with pytest.raises(InputError, match=r"r01.csv: not valid TOML: it is a table; give a file of settings, such as"):
        read_with(load_measured, tmp_path / "r01.csv")
