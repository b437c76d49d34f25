"""Corrections by hand: a CSV with frame, mark, x, y (px), or "absent" in place of x.

frame,mark,x,y
120,front,311.4,200.9
121,rear,absent,
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from calibration.tables import line_of
from evaluator.errors import InputError
from evaluator.files.csv_tables import read_table

# Standard uncertainty of a centre placed by hand.
HAND_SIGMA_PX = 0.5
PLACED, REMOVED = "corrected", "absent by hand"


def read_corrections(path: Path) -> pd.DataFrame:
    """Read corrections: frame, mark, x, y, with x and y NaN for absent. Raises InputError that names the line."""
    try:
        table = read_table(path, dtype=str).rename(columns=str.strip)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    missing = [name for name in ("frame", "mark", "x", "y") if name not in table]
    if missing:
        raise InputError(f"{path}: lacks {', '.join(missing)}; corrections have frame, mark, x, y")
    gone = table["x"].str.strip().str.lower() == "absent"
    read = pd.DataFrame({"frame": pd.to_numeric(table["frame"], errors="coerce"), "mark": table["mark"].str.strip()})
    for axis in ("x", "y"):
        read[axis] = pd.to_numeric(table[axis].where(~gone).str.replace(",", "."), errors="coerce")
    wrong = read["frame"].isna() | (~gone & (read["x"].isna() | read["y"].isna()))
    if wrong.any():
        line = line_of(table, np.flatnonzero(wrong)[0])
        raise InputError(f'{path}: line {line} needs a frame number, a mark, and x, y in px or the word "absent"')
    return read


def correct(table: pd.DataFrame, corrections: pd.DataFrame, source: str = "corrections") -> pd.DataFrame:
    """Apply corrections to a table of `track`; the status says so. Raises InputError for unknown frames or marks."""
    corrected = table.copy()
    rows = {int(frame): row for row, frame in enumerate(table["frame"])}
    for line, (frame, mark, x, y) in enumerate(corrections.itertuples(index=False), start=2):
        if f"{mark}_x_px" not in table:
            raise InputError(f"{source}: line {line}: there is no mark {mark!r} in this recording")
        if int(frame) not in rows:
            raise InputError(f"{source}: line {line}: the recording has no frame {int(frame)}")
        row, placed = rows[int(frame)], bool(np.isfinite(x))
        sigma = HAND_SIGMA_PX if placed else float("nan")
        values = {
            "x_px": x,
            "y_px": y,
            "x_sigma_px": sigma,
            "y_sigma_px": sigma,
            "xy_cov_px2": 0.0 if placed else np.nan,
        }
        for part, value in values.items():
            corrected.loc[row, f"{mark}_{part}"] = value
        corrected.loc[row, f"{mark}_status"] = PLACED if placed else REMOVED
    return corrected
