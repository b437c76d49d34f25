"""Tables as CSV files.

The text is what pandas writes, byte for byte, but tables of numbers and plain words are written four times as fast.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.tables import TableError, numbers_of
from calibration.tables import read_table as read_any_table
from evaluator.errors import InputError
from evaluator.files.reading import refuse_stream
from evaluator.files.writing import written_whole

DIGITS = 9
FLOAT = f"%.{DIGITS}g"
TIME, MICROSECONDS = "time_s", 6  # end of the name of a column of times, and digits after their decimal point
MOST_DIGITS = 17  # of a double
ROWS = 4096  # converted to text at once; more would take memory without gain in time
QUOTED = frozenset(',"\r\n')  # characters for which a cell needs quotes
FORMULAS = ("=", "+", "-", "@", "\t", "\r")  # beginnings of cells that spreadsheets evaluate
Column = NDArray[np.generic] | list[str]


def read_table(path: Path, **options: Any) -> pd.DataFrame:
    """Read a table as programs and spreadsheets write it (calibration.tables). Raises InputError, OSError."""
    refuse_stream(path)
    try:
        return read_any_table(path, **options)
    except TableError as error:
        raise InputError(str(error)) from error


def read_runs(path: Path) -> pd.DataFrame:
    """Read a table about runs: ids and groups are text, also "01", and an id such as "null" is no empty cell."""
    return pd.read_csv(path, dtype={"run": str, "group": str}, keep_default_na=False, na_values=[""])


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a table as CSV, completely or not at all: nine significant digits, NaN as an empty cell."""
    with written_whole(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        file.writelines(csv_text(table))


def csv_text(table: pd.DataFrame) -> Iterator[str]:
    """The text of a table in pieces: nine significant digits, of late times more, NaN as an empty cell, no index."""
    table = _with_late_times(_without_formulas(table))
    names = table.columns.tolist()
    columns = [_plain(column) for _, column in table.items()]
    plain = [column for column in columns if column is not None]
    if len(plain) < max(len(columns), 2) or not _unquoted(names):
        yield table.to_csv(index=False, float_format=FLOAT)
        return
    yield ",".join(map(str, names)) + os.linesep
    for first in range(0, len(table), ROWS):
        yield _lines([column[first : first + ROWS] for column in plain])


def _without_formulas(table: pd.DataFrame) -> pd.DataFrame:
    """The table with an apostrophe before texts that begin like formulas, so that spreadsheets do not evaluate them."""
    for name, column in table.items():
        if column.dtype == object or isinstance(column.dtype, pd.StringDtype):
            words = {word for word in column.tolist() if _begins_formula(word)}
            if words:
                table = table.assign(**{str(name): column.replace({word: f"'{word}" for word in words})})
    begun = {name: f"'{name}" for name in table.columns if _begins_formula(name)}
    return table.rename(columns=begun) if begun else table


def _with_late_times(table: pd.DataFrame) -> pd.DataFrame:
    """The table with times beyond a thousand seconds as text, to the microsecond: clocks count from a distant start."""
    for name in [name for name in table if str(name).endswith(TIME)]:
        column = numbers_of(table[name]).to_numpy(float)
        latest = np.max(np.abs(column[np.isfinite(column)]), initial=0.0)
        digits = min(len(str(int(latest))) + MICROSECONDS, MOST_DIGITS)
        if digits > DIGITS:
            words = ["" if math.isnan(value) else f"{value:.{digits}g}" for value in column.tolist()]
            table = table.assign(**{str(name): words})
    return table


def _begins_formula(word: object) -> bool:
    return isinstance(word, str) and len(word) > 1 and word.startswith(FORMULAS)


def _plain(column: pd.Series) -> Column | None:
    """Values of a column in which no cell needs quotes; None for other columns."""
    if column.dtype in (np.dtype(float), np.dtype(int)):
        return column.to_numpy()
    words = column.tolist()
    return words if _unquoted(words) else None


def _unquoted(words: Sequence[object]) -> bool:
    """Whether all are texts that need no quotes."""
    return all(isinstance(word, str) for word in words) and QUOTED.isdisjoint("".join(map(str, set(words))))


def _lines(columns: list[Column]) -> str:
    """Lines of some rows."""
    kinds, cells = [], list[list[Any]]()
    for column in columns:
        values: list[Any] = list(column) if isinstance(column, list) else column.tolist()
        kind = "%s" if isinstance(column, list) else "%d" if column.dtype == int else FLOAT
        if kind == FLOAT and np.isnan(column).any():
            kind, values = "%s", ["" if math.isnan(value) else FLOAT % value for value in values]
        kinds.append(kind)
        cells.append(values)
    line = ",".join(kinds) + os.linesep
    return "".join([line % row for row in zip(*cells, strict=True)])
