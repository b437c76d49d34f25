"""marks CSV: marks on the plane of the marks, plate frame, mm, over presentation time.

A marks table is a pandas DataFrame with time_s and NAME_x_mm, NAME_y_mm for every mark; those of turnscope's tracker
also have frame, NAME_x_sigma_mm …, NAME_status. A missing mark is NaN in the table and an empty cell in the file.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.tables import line_of, numbers_of
from evaluator.errors import InputError
from evaluator.files import quoted
from evaluator.files.csv_tables import read_table, write_table

# Larger numbers are no measurement: a thousand kilometres, and thirty thousand years in seconds (a clock that counts
# nanoseconds since 1970 is beyond it, too). Squares of smaller lengths stay far from the limits of a float.
LARGEST_MM = 1e9
LATEST_S = 1e12
NUMBERS = ("_mm", "_mm2", "_px")  # suffixes of columns of numbers


def columns_of(names: Iterable[str], unit: str = "mm") -> list[str]:
    """Columns of the positions of some marks."""
    return [f"{name}_{axis}_{unit}" for name in names for axis in "xy"]


def mark_names(table: pd.DataFrame, unit: str = "mm") -> tuple[str, ...]:
    """Marks of a table, in its order."""
    names = [str(name).removesuffix(f"_x_{unit}") for name in table if str(name).endswith(f"_x_{unit}")]
    return tuple(name for name in names if f"{name}_y_{unit}" in table)


def is_of_film(table: pd.DataFrame) -> bool:
    """Whether a table is of turnscope's tracker, and thus of a film."""
    return any(str(name).endswith("_status") for name in table)


def points_of(table: pd.DataFrame, names: Iterable[str], unit: str = "mm") -> NDArray[np.float64]:
    """Positions (n, m, 2) of some marks; NaN if a mark is missing."""
    # column by column: a table of several columns is made ten times as slowly as an array of each
    return np.stack(
        [np.column_stack([table[column].to_numpy(float) for column in columns_of([name], unit)]) for name in names],
        axis=1,
    )


def read_marks(
    path: Path | str, names: Iterable[str] | None = None, called: Mapping[str, str] | None = None
) -> pd.DataFrame:
    """Read a marks CSV. Raises InputError for a file that is not one.

    names: required marks, in mm; of three or more, two of them suffice. Without names, only time_s is required. called:
    names that marks have in the file, by mark; one that is not there is of another file. Rows with the time and the
    numbers of the one before are left out; attrs["repeated"] of the table counts them. Infinite places are missing.
    """
    path = Path(path)
    try:
        table = read_table(path)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    if "time_s" not in table:
        raise InputError(f"{path}: lacks time_s; a marks CSV has {_described(names or ['NAME'])}")
    table = _by_mark(table, called or {}, path)
    if names is not None:
        names = list(names)
        there = [name for name in names if set(columns_of([name])) <= set(table)]
        require_marks(table, str(path), there if len(there) > 1 else names)
    for name, kind in zip(table.columns, table.dtypes, strict=True):
        if kind == np.float64 or not (name == "time_s" or str(name).endswith(NUMBERS)):
            continue
        values = numbers_of(table[name])
        bad = values.isna() & table[name].notna()
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            cell = quoted(table[name].iloc[row])
            raise InputError(f"{path}: line {line_of(table, row)}, {name} = {cell} is not a number")
        table[name] = values.astype(float)
    for name in columns_of(mark_names(table)) + columns_of(mark_names(table, "px"), "px"):
        if np.isinf(places := table[name].to_numpy()).any():  # nowhere: what a program writes that divided by zero
            table[name] = np.where(np.isinf(places), np.nan, places)
    if (table["time_s"].diff() == 0).any():  # seldom, and the numbers of hours of frames are many
        twice = repeats(table[["time_s", *(name for name in table if str(name).endswith(NUMBERS))]].to_numpy(float))
        table = table[~twice]
        table.attrs["repeated"] = int(twice.sum())
    check_marks(table, path)
    return table.reset_index(drop=True)


def _by_mark(table: pd.DataFrame, called: Mapping[str, str], path: Path) -> pd.DataFrame:
    """A table with its columns named by mark, where they have the names that these marks are called by."""
    there = {*mark_names(table), *mark_names(table, "px")}
    marks = {name: mark for mark, name in called.items() if name in there and name != mark}
    for mark in marks.values():
        if mark in there and mark not in marks:
            raise InputError(
                f"{path}: holds {mark} itself beside {called[mark]}, which [tracks] calls {mark}; name both"
            )

    def of_mark(column: str) -> str:
        name = max((name for name in there if column.startswith(f"{name}_")), key=len, default="")
        return marks.get(name, name) + column[len(name) :]

    return table.rename(columns=lambda column: of_mark(str(column))) if marks else table


def repeats(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Rows (n,) of values (n, k) that equal the one before; missing values are equal."""
    known = np.nan_to_num(values, nan=np.inf)
    return np.asarray(np.r_[False, (known[1:] == known[:-1]).all(axis=1)][: len(values)], dtype=np.bool_)


def require_marks(table: pd.DataFrame, name: str, marks: Iterable[str]) -> None:
    """Refuse a table without the marks needed, in mm; name: of the table, for the message. Raises InputError."""
    needed = ["time_s", *columns_of(marks := list(marks))]
    missing = [column for column in needed if column not in table]
    if not missing:
        return
    if all(column in table or column.replace("_mm", "_px") in table for column in needed):
        raise InputError(
            f"{name}: the marks are in px and must be placed on the plate with a camera; track with --camera or call "
            "evaluator.place_on_plate(table, camera, height_mm)"
        )
    raise InputError(f"{name}: lacks {', '.join(missing)}; a marks CSV has {_described(marks)}")


def _described(marks: Iterable[str]) -> str:
    return ", ".join(["time_s", *columns_of(marks)])


def check_marks(table: pd.DataFrame, path: Path) -> None:
    """Refuse a table with times that do not increase, or impossible lengths. Raises InputError that names the line."""
    time = table["time_s"].to_numpy(float)
    if len(time) < 2:
        raise InputError(f"{path}: {len(time)} rows; time_s must hold at least two values and increase from row to row")
    wrong = np.flatnonzero(~(np.abs(time) <= LATEST_S))
    if len(wrong):
        line = line_of(table, wrong[0])
        raise InputError(f"{path}: line {line}, time_s = {time[wrong[0]]:g} is not a time in seconds")
    back = np.flatnonzero(np.diff(time) <= 0)
    if len(back):
        before, after, line = time[back[0]], time[back[0] + 1], line_of(table, back[0] + 1)
        raise InputError(
            f"{path}: line {line}, time_s = {after:.15g} does not come after {before:.15g} of the line before; "
            "time_s must increase from row to row"
        )
    for name in table:
        if str(name).endswith(("_x_mm", "_y_mm")):
            values = table[name].to_numpy(float)
            far = np.abs(values) > LARGEST_MM
            if far.any() and len(rows := np.flatnonzero(far & np.isfinite(values))):
                line = line_of(table, rows[0])
                raise InputError(f"{path}: line {line}, {name} = {values[rows[0]]:g} is not a position on a plate")


def write_marks(table: pd.DataFrame, path: Path | str) -> None:
    """Write a marks table as CSV, completely or not at all; missing marks become empty cells."""
    write_table(table, Path(path))
