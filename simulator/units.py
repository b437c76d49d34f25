"""Numbers that users write: tables, and values with units by suffix.

A key may end in any unit of its kind, and its value is converted to the internal unit.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibration import tables
from simulator.errors import SimulationError

if TYPE_CHECKING:
    import pandas as pd

line_of, numbers_of = tables.line_of, tables.numbers_of
# By internal suffix: other suffixes, and the factors for their values. Longer suffixes come first.
OTHER_ENDINGS: dict[str, dict[str, float]] = {
    "g_mm2": {"kg_m2": 1e9},
    "rpm": {"rad_s": 60 / (2 * math.pi)},
    "mm": {"m": 1e3},
    "mN": {"N": 1e3},
    "g": {"kg": 1e3},
}
UNIT_IN_BRACKETS = re.compile(r"\s*(\w.*?)\s*[\[(]\s*([^\])]+?)\s*[\])]\s*")
OTHER_UNITS = {"°": "deg", "µs": "us", "sec": "s", "seconds": "s", "1/min": "rpm"}
DATES = ("time", "timestamp", "stamp", "date", "datetime", "date_time", "utc")  # columns of dates with times


def in_standard_units(content: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    """The content with every value under a key of `names`, which end in mm, g, mN, rpm or g_mm2.

    Values may be numbers or lists of them; others are unchanged and left to later validation. Raises ValueError if a
    value is given in two units.
    """
    result = dict(content)
    for name in names:
        for key, factor in other_keys(name).items():
            if key not in content or key in names:
                continue
            if name in content:
                raise ValueError(f"{name} and {key} are both given; keep one of them")
            result[name] = _times(result.pop(key), factor)
    return result


def other_keys(name: str) -> dict[str, float]:
    """Keys for the same quantity in other units, with the factors for their values; none for a key without unit."""
    for ending, others in OTHER_ENDINGS.items():
        if name == ending or name.endswith(f"_{ending}"):
            stem = name.removesuffix(ending)
            return {f"{stem}{other}": factor for other, factor in others.items()}
    return {}


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, list | tuple):
        return [_times(item, factor) for item in value]
    return value * factor if isinstance(value, int | float) and not isinstance(value, bool) else value


def read_table(path: Path, **options: Any) -> pd.DataFrame:
    """Read a table as calibration.tables does. Raises SimulationError, OSError."""
    try:
        return tables.read_table(path, **options)
    except tables.TableError as error:
        raise SimulationError(str(error)) from error


def with_plain_columns(table: pd.DataFrame) -> pd.DataFrame:
    """A table with the columns of other programs renamed: "Time [s]" is time_s, and dates with times are time_s, too.

    Dates (ISO 8601) become seconds since 1970, if the table has no other time; without an offset they are UTC.
    """
    import pandas as pd

    names = {name: plain_name(str(name)) for name in table}
    once = Counter(names.values())  # of two names that would be equal both stay
    table = table.rename(columns={name: plain for name, plain in names.items() if once[plain] == 1})
    if any(str(name).startswith("time_") for name in table):
        return table
    for name in table:
        cells = table[name]
        if str(name).strip().lower() in DATES and pd.api.types.is_string_dtype(cells.dtype):
            times = pd.to_datetime(cells, format="ISO8601", utc=True, errors="coerce")
            if not (times.isna() & cells.notna()).any():
                found = table.assign(time_s=(times - pd.Timestamp(0, tz="UTC")) / pd.Timedelta(seconds=1))
                found.attrs = table.attrs
                return found
    return table


def plain_name(name: str) -> str:
    """A name with its unit in brackets as a key with a suffix: "Left wheel (rad/s)" is left_wheel_rad_s."""
    found = UNIT_IN_BRACKETS.fullmatch(name)
    if found is None:
        return name
    unit = re.sub(r"\W+", "_", OTHER_UNITS.get(found[2], found[2]))
    return f"{re.sub(r'[^0-9A-Za-z]+', '_', found[1].lower())}_{unit}"
