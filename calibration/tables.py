"""Tables in text as programs and spreadsheets write them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import pandas as pd

ZIPPED = "PK\x03\x04"  # begin of an archive
NO_TEXT = "is a workbook or another archive, and no table in text; save the sheet as CSV"
TOO_MANY_CELLS = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")  # as pandas says it
DECIMAL_COMMA = re.compile(r"^([-+]?\d*),(\d+(?:[eE][-+]?\d+)?)$")


class TableError(ValueError):
    """A file is no table that can be read; the message says what was found and what to do."""


class TableHead(NamedTuple):
    """Where a table begins: the separator that its first line states, the number of its line of names, and the names.

    commented: whether the names are in a comment, as numpy.savetxt writes them.
    """

    separator: str | None
    number: int
    names: str
    commented: bool = False


def table_head(lines: Iterable[str]) -> TableHead:
    """The head of a table by its first lines, empty ones and comments, which begin with #, among them."""
    stated, comment, number, first = None, "", 0, ""
    for number, line in enumerate(lines, start=1):
        if number == 1 and (stated := _separator_line(line)) is not None:
            continue
        text = line.removeprefix("\ufeff").strip()
        if text and not text.startswith("#"):
            first = line
            break
        comment = text.removeprefix("#").strip() or comment
    else:
        number += 1
    sep = stated or _separator_of(comment)
    if comment and _is_row(cells := first.split(sep)) and len(comment.split(sep)) == len(cells):
        return TableHead(stated, number - 1, comment, commented=True)
    return TableHead(stated, number, first)


def _separator_of(names: str) -> str:
    return max(",;\t", key=names.count)


def _separator_line(line: str) -> str | None:
    """The separator that a first line "sep=;" tells spreadsheets; None for any other line."""
    found = re.fullmatch(r'\ufeff?"?sep=(.)"?[,;\t]*\s*', line, re.IGNORECASE)
    return found[1] if found else None


def _is_row(cells: Sequence[str]) -> bool:
    """Whether the cells of a line begin with a number."""
    try:
        float(cells[0].replace(",", "."))
    except ValueError:
        return False
    return True


def read_table(path: Path, **options: Any) -> pd.DataFrame:
    """Read a table as programs and spreadsheets write it; options: of pandas.read_csv. Raises TableError, OSError.

    Commas, or semicolons or tabs with decimal commas; comments before it begin with #. Rows without a value at the end,
    which spreadsheets leave, are left out.
    """
    import pandas as pd

    with path.open(encoding="utf-8", errors="replace") as lines:
        head = table_head(iter(lambda: lines.readline(4096), ""))
    first = head.names
    if first.startswith(ZIPPED):
        raise TableError(f"{path}: {NO_TEXT}")
    if 3 * first.count("\0") > len(first):  # every second byte of English text in UTF-16
        raise TableError(f"{path}: probably in UTF-16, the Unicode text of spreadsheets; save it as CSV UTF-8")
    if "\0" in first:
        raise TableError(f"{path}: is no text but a binary file; give a table as CSV")
    sep = head.separator or _separator_of(first)
    names = [cell.strip().strip('"') for cell in first.split(sep)] if head.commented else None
    named: dict[str, Any] = {"names": names, "header": None} if names else {}
    skipped = head.number if head.commented else head.number - 1
    form: dict[str, Any] = {"sep": sep, "decimal": "." if sep == "," else ",", "skiprows": skipped}
    try:
        table = pd.read_csv(path, skipinitialspace=True, **form, **named, **options)
    except UnicodeDecodeError as error:
        raise TableError(f"{path}: not a CSV table in UTF-8 (byte {error.start}); save it as CSV UTF-8") from error
    except pd.errors.EmptyDataError as error:
        raise TableError(f"{path}: the file is empty") from error
    except pd.errors.ParserError as error:
        raise TableError(f"{path}: not a CSV table ({_of_parser(str(error))})") from error
    used = _without_empty_end(table)
    if form["decimal"] == ",":  # pandas leaves a column with a word in it as it is
        words = {name: used[name] for name in used if pd.api.types.is_string_dtype(used[name].dtype)}
        used = used.assign(
            **{str(name): cells.replace(DECIMAL_COMMA, r"\1.\2", regex=True) for name, cells in words.items()}
        )
    used.attrs["lines_before"] = head.number - 1
    return used


def _of_parser(message: str) -> str:
    """Why a text is no table, from what pandas says of it."""
    if cells := TOO_MANY_CELLS.search(message):
        return f"line {cells[2]} has {cells[3]} cells, the lines before it have {cells[1]}"
    if "EOF inside string" in message:
        return "a quotation mark in it is not closed"
    return message.strip().removeprefix("Error tokenizing data. ").removeprefix("C error: ")


def _without_empty_end(table: pd.DataFrame) -> pd.DataFrame:
    """The table without the rows at its end that hold no value."""
    import pandas as pd

    if len(table) and any(not pd.isna(cells.iloc[-1]) for _, cells in table.items()):
        return table  # of most tables one cell tells
    filled = table.notna().any(axis=1).to_numpy().nonzero()[0]
    return table.iloc[: filled[-1] + 1 if len(filled) else 0]


def line_of(table: pd.DataFrame, row: int) -> int:
    """Number of the line of its file that holds a row of a table, counted from 0; rows left out keep their lines."""
    return int(table.index[row]) + 2 + int(table.attrs.get("lines_before", 0))


def numbers_of(column: pd.Series) -> pd.Series:
    """The cells of a column as numbers: NaN where there is none, infinity for an integer beyond the largest double."""
    import pandas as pd

    try:
        return pd.to_numeric(column, errors="coerce")
    except OverflowError:  # pandas keeps an integer of hundreds of digits as it is
        return pd.to_numeric(column.map(str), errors="coerce")
