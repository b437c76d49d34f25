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
    missing = [name for name in COLUMNS if name not in table]
    if missing:
        raise InputError(f"{path}: column {', '.join(missing)} is missing; a marks CSV has {', '.join(COLUMNS)}")
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


def write_marks(table: pd.DataFrame, path: Path) -> None:
    """Write a marks table as CSV, whole or not at all; missing marks become empty cells."""
    write_table(table, path)
