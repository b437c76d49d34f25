"""Tables as CSV files.

The text is what pandas writes, byte for byte, but tables of numbers and plain words are written four times as fast.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
import pandas as pd
from numpy.typing import NDArray

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
DECIMAL_COMMA = re.compile(r"^([-+]?\d*),(\d+(?:[eE][-+]?\d+)?)$")
Column = NDArray[np.generic] | list[str]


class Dialect(TypedDict):
    """Separator of cells, decimal mark and number of lines before the header of a CSV file."""

    sep: str
    decimal: str
    skiprows: int


def read_table(path: Path, **options: Any) -> pd.DataFrame:
    """Read a table as programs and spreadsheets write it; options: of pandas.read_csv.

    Rows without a value at the end, which spreadsheets leave, are left out. Raises InputError, OSError.
    """
    refuse_stream(path)
    dialect = _dialect(path)
    try:
        table = pd.read_csv(path, skipinitialspace=True, **dialect, **options)
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a CSV table in UTF-8 (byte {error.start}); save it as CSV UTF-8") from error
    except pd.errors.EmptyDataError as error:
        raise InputError(f"{path}: the file is empty") from error
    except pd.errors.ParserError as error:
        raise InputError(f"{path}: not a CSV table ({str(error).strip()})") from error
    used = _without_empty_end(table)
    if dialect["decimal"] == ",":  # pandas leaves a column with a word in it as it is
        words = {name: used[name] for name in used if pd.api.types.is_string_dtype(used[name].dtype)}
        used = used.assign(
            **{str(name): cells.replace(DECIMAL_COMMA, r"\1.\2", regex=True) for name, cells in words.items()}
        )
    used.attrs["lines_before"] = dialect["skiprows"]
    return used


def _without_empty_end(table: pd.DataFrame) -> pd.DataFrame:
    """The table without the rows at its end that hold no value."""
    if len(table) and any(not pd.isna(cells.iloc[-1]) for _, cells in table.items()):
        return table  # of most tables one cell tells
    filled = np.flatnonzero(table.notna().any(axis=1))
    return table.iloc[: filled[-1] + 1 if len(filled) else 0]


def line_of(table: pd.DataFrame, row: int) -> int:
    """Number of the line of its file that holds a row of a table, counted from 0; rows left out keep their lines."""
    return int(table.index[row]) + 2 + int(table.attrs.get("lines_before", 0))


ZIPPED = "PK\x03\x04"  # begin of an archive
NO_TEXT = "is a workbook or another archive, and no table in text; save the sheet as CSV"


def separator_line(line: str) -> str | None:
    """The separator that a first line "sep=;" tells spreadsheets; None for any other line."""
    found = re.fullmatch(r'\ufeff?"?sep=(.)"?[,;\t]*\s*', line, re.IGNORECASE)
    return found[1] if found else None


def _dialect(path: Path) -> Dialect:
    """The dialect of a table by its first line: semicolons and tabs come with decimal commas."""
    with path.open(encoding="utf-8", errors="replace") as lines:
        first = lines.readline(4096)
    if first.startswith(ZIPPED):
        raise InputError(f"{path}: {NO_TEXT}")
    if 3 * first.count("\0") > len(first):  # every second byte of English text in UTF-16
        raise InputError(f"{path}: probably in UTF-16, the Unicode text of spreadsheets; save it as CSV UTF-8")
    if "\0" in first:
        raise InputError(f"{path}: is no text but a binary file; give a table as CSV")
    said = separator_line(first)
    sep = said or max(",;\t", key=first.count)
    return {"sep": sep, "decimal": "." if sep == "," else ",", "skiprows": 0 if said is None else 1}


def numbers_of(column: pd.Series) -> pd.Series:
    """The cells of a column as numbers: NaN where there is none, infinity for an integer beyond the largest double."""
    try:
        return pd.to_numeric(column, errors="coerce")
    except OverflowError:  # pandas keeps an integer of hundreds of digits as it is
        return pd.to_numeric(column.map(str), errors="coerce")


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
