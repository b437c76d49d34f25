"""What tables look like as text."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluator.files import csv_tables as module
from evaluator.files.csv_tables import csv_text, read_runs, write_table


def of_pandas(table: pd.DataFrame) -> str:
    return table.to_csv(index=False, float_format="%.9g")


@given(st.lists(st.tuples(st.floats(), st.integers(-(2**63), 2**63 - 1), st.text("ab .", max_size=3)), max_size=9))
def test_text_of_a_table_is_that_of_pandas_to_the_byte(rows: Sequence[tuple[float, int, str]]) -> None:
    table = pd.DataFrame(
        {
            "time_s": np.array([row[0] for row in rows], float),
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
