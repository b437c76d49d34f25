"""marks CSV: the two marks on the plane of the marks, plate frame, mm, over presentation time.

A marks table is a pandas DataFrame with at least COLUMNS; what turnscope's tracker writes has more: frame,
green_x_sigma_mm …, green_status, yellow_status. A missing mark is NaN in the table and an empty cell in the file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from evaluator.errors import InputError
from evaluator.files import write_table

MARKS = ("green", "yellow")
COLUMNS = ("time_s", "green_x_mm", "green_y_mm", "yellow_x_mm", "yellow_y_mm")


def read_marks(path: Path) -> pd.DataFrame:
    """Read a marks CSV; only COLUMNS are needed. Raises InputError for a file that is not one."""
    try:
        table = pd.read_csv(path, skipinitialspace=True)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a CSV table ({str(error).strip()})") from error
    require_columns(table, str(path))
    numeric = [name for name in table if name in COLUMNS or str(name).endswith("_mm")]
    for name in numeric:
        values = pd.to_numeric(table[name], errors="coerce")
        bad = values.isna() & table[name].notna()
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            raise InputError(f"{path}: line {row + 2}, {name} = {table[name].iloc[row]!r} is not a number")
        table[name] = values.astype(float)
    time = table["time_s"].to_numpy()
    if len(time) < 2 or not np.all(np.diff(time) > 0):
        raise InputError(f"{path}: time_s must hold at least two values and increase from row to row")
    return table


def require_columns(table: pd.DataFrame, name: str) -> None:
    """Refuse a table without COLUMNS; name: of the table, for the message. Raises InputError."""
    missing = [column for column in COLUMNS if column not in table]
    if not missing:
        return
    if all(column in table or column.replace("_mm", "_px") in table for column in COLUMNS):
        raise InputError(
            f"{name}: the marks are in px, and only a camera tells where on the plate they are; track with --camera "
            "or call evaluator.place_on_plate(table, camera, height_mm)"
        )
    raise InputError(f"{name}: column {', '.join(missing)} is missing; a marks CSV has {', '.join(COLUMNS)}")


def write_marks(table: pd.DataFrame, path: Path) -> None:
    """Write a marks table as CSV, whole or not at all; missing marks become empty cells."""
    write_table(table, path)
