"""Tables with the coordinates of points: of a script of one's own, TrackMate, trackpy, ImageJ.

Recognised columns, in upper or lower case: t, time, time_s (or _ms, _us, _ns) or frame; x and y, NAME_x and NAME_y, or
x1 and y1, each with _px, _um, _mm, _cm or _m behind it or without a unit. A table with a row for each point of a frame
has a column that names the point (track_id, particle, id …). TrackMate calls its columns POSITION_X, POSITION_T
and so on, and writes further names and units, such as (micron), in the lines below.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluator.errors import InputError
from evaluator.interchange.delimited_text import cells_of, delimiter_of, lines_of, number_of, numbers_of
from evaluator.interchange.named_points import FileHints, NamedPoints
from evaluator.wording import MM_PER
from simulator.command import SECONDS
from simulator.units import plain_name

FRAMES = ("frame", "frame_number", "frame_index", "frame_no", "frame_idx", "slice", "index")
# Columns that name the point of a row, in order of preference: TrackMate also writes an ID that differs in every row.
POINTS = ("track_id", "track", "trajectory", "particle", "mark", "marker", "object", "id")
COORDINATE = re.compile(r"(?:(?P<owner>\w+?)_)?(?P<axis>[xy])_?(?P<number>\d*)(?:_(?P<unit>px|um|mm|cm|m))?")
ALONE = "tracked"  # name of a point that has none
# Further lines of names and units below the header; TrackMate writes three.
MOST_HEADERS = 4
UNITS = {"pixel": "px", "pixels": "px", "micron": "um", "microns": "um", "µm": "um", "in": "inch", "inches": "inch"}
TIMES_S = {"sec": 1.0, "second": 1.0, "seconds": 1.0, "min": 60.0, **SECONDS}

Array = NDArray[np.float64]
Line = tuple[int, list[str]]  # its number, and its cells


class _Columns(NamedTuple):
    """Columns of x and y by point, unit of length if it is stated, and the columns of times with its unit in s.

    whose: column that names the point of a row, and its name, of a table with a row for every point of a frame.
    down: whether y points down whatever the unit, as in an image.
    """

    points: dict[str, dict[str, int]]
    unit: str | None
    time: tuple[int, float] | None
    frame: int | None
    whose: tuple[int, str] | None
    down: bool


def columns_of(header: str) -> _Columns | None:
    """What the columns of a header line hold; None if they hold no point."""
    names = [_plain_name(name) for name in cells_of(header, delimiter_of(header))]
    points, units, time = dict[str, dict[str, int]](), set[str | None](), None
    for index, name in enumerate(names):
        if found := COORDINATE.fullmatch(name):
            point = "_".join(filter(None, (found["owner"], found["number"]))) or ALONE
            points.setdefault(point if point.isidentifier() else f"mark{point}", {})[found["axis"]] = index
            units.add(found["unit"])
        elif re.fullmatch(r"t|time|(t|time|timestamp)_(s|ms|us|ns)", name):
            time = index, SECONDS.get(name.rpartition("_")[2], 1.0)
    points = {name: axes for name, axes in points.items() if len(axes) == 2}
    if not points:
        return None
    frame = next((names.index(name) for name in FRAMES if name in names), None)
    whose = next(((names.index(name), name.removesuffix("_id")) for name in POINTS if name in names), None)
    return _Columns(
        points,
        next(iter(units)) if len(units) == 1 else None,
        time,
        frame,
        whose,
        header.upper().count("POSITION_Y") > 0,
    )


def _plain_name(name: str) -> str:
    """Name of a column in small letters: TrackMate's POSITION_X is x, "Track n°" of ImageJ track, "Time [s]" time_s."""
    return re.sub(r" n\W*$", "", plain_name(name).lower()).removeprefix("position_")


def read_plain(path: Path, said: FileHints) -> NamedPoints:
    """Read the points of a table; frames are counted at the stated rate if it holds no times."""
    lines = lines_of(path)
    header, delimiter = lines[0][1], delimiter_of(lines[0][1])
    columns = columns_of(header)
    assert columns is not None
    width = len(cells_of(header, delimiter))
    rows = [(number, (cells_of(line, delimiter) + [""] * width)[:width]) for number, line in lines[1:]]
    used = sorted({index for axes in columns.points.values() for index in axes.values()})
    heads, rows = _below_header(rows, used, delimiter)
    columns = _with_units(columns, [cells for _, cells in heads])
    if columns.whose is not None and len(columns.points) == 1 and _names_points(rows, columns.whose[0]):
        return _by_point(path, rows, columns, delimiter, said)
    table = _numbers(path, rows, used, delimiter)
    points = {name: table[:, [used.index(axes[axis]) for axis in "xy"]] for name, axes in columns.points.items()}
    return NamedPoints(_times_s(path, rows, columns, delimiter, said), points, columns.unit)


def _below_header(rows: list[Line], used: Sequence[int], delimiter: str | None) -> tuple[list[Line], list[Line]]:
    """Further lines of names and units, and the lines of numbers.

    A line with words and without any number in the columns that are read is one of names and units. One of missing
    values is none: a mark may be hidden at first, and frames without times are counted from the first line on.
    """

    def kind(cell: str) -> str:
        try:
            return "number" if np.isfinite(number_of(cell, delimiter)) else "missing"
        except ValueError:
            return "word"

    kinds = [{kind(cells[index]) for index in used} for _, cells in rows[: MOST_HEADERS + 1]]
    first = next((k for k, there in enumerate(kinds) if "number" in there or "word" not in there), 0)
    return rows[:first], rows[first:]


def _with_units(columns: _Columns, heads: Sequence[Sequence[str]]) -> _Columns:
    """The columns with the units of length and time in the lines below the header, such as (micron) and (sec)."""

    def stated(index: int) -> set[str]:
        cells = (cells[index].strip("()[] ").lower() for cells in heads)
        return {UNITS.get(cell, cell) for cell in cells}

    lengths = [stated(index) & {"px", *MM_PER} for axes in columns.points.values() for index in axes.values()]
    same = set.intersection(*lengths)
    unit, time = columns.unit or (same.pop() if len(same) == 1 else None), columns.time
    if time is not None:
        if stated(time[0]) & {"frame", "frames"}:  # TrackMate without a frame interval counts frames
            return columns._replace(unit=unit, time=None, frame=time[0] if columns.frame is None else columns.frame)
        time = time[0], next((TIMES_S[cell] for cell in stated(time[0]) if cell in TIMES_S), time[1])
    return columns._replace(unit=unit, time=time)


def _names_points(rows: Sequence[Line], column: int) -> bool:
    """Whether a column tells points apart: a number of the row does not occur twice."""
    names = [cells[column] for _, cells in rows if cells[column]]
    return len(set(names)) < len(names)


def _by_point(path: Path, rows: list[Line], columns: _Columns, delimiter: str | None, said: FileHints) -> NamedPoints:
    """Points of a table with a row for every point of a frame, named after their column and its value: track0."""
    assert columns.whose is not None
    column, word = columns.whose
    rows = [row for row in rows if row[1][column].lower() not in ("", "none", "nan")]  # points of no track
    axes = next(iter(columns.points.values()))
    places = _numbers(path, rows, [axes["x"], axes["y"]], delimiter)
    if columns.down and (said.unit or columns.unit) != "px":
        places[:, 1] *= -1
    times_s, at = np.unique(_times_s(path, rows, columns, delimiter, said), return_inverse=True)
    points = dict[str, Array]()
    for (_, cells), row, place in zip(rows, at, places, strict=True):
        value = re.sub(r"\W", "_", cells[column].removesuffix(".0"))
        name = value if value.isidentifier() else f"{word}{value}"
        points.setdefault(name, np.full((len(times_s), 2), np.nan))[row] = place
    return NamedPoints(times_s, points, columns.unit)


def _times_s(path: Path, rows: list[Line], columns: _Columns, delimiter: str | None, said: FileHints) -> Array:
    if columns.time is not None:
        index, unit_s = columns.time
        return _numbers(path, rows, [index], delimiter)[:, 0] * unit_s
    if said.rate_hz is None:
        raise InputError(f"{path}: holds no times; give the frame rate: --rate-hz, or rate_hz in [tracks]")
    if columns.frame is None:
        return np.arange(len(rows)) / said.rate_hz
    return _numbers(path, rows, [columns.frame], delimiter)[:, 0] / said.rate_hz


def _numbers(path: Path, rows: list[Line], used: Sequence[int], delimiter: str | None) -> Array:
    """The cells of some columns (rows, used) as numbers; other columns may hold words."""
    table = [numbers_of(path, number, [cells[index] for index in used], delimiter) for number, cells in rows]
    return np.array(table, dtype=float).reshape(-1, len(used))
