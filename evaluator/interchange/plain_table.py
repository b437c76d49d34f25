"""Tables as a script of one's own writes them: times or frame numbers, and x and y of one or more points.

Recognised columns, in upper or lower case: t, time, time_s (or _ms, _us, _ns) or frame; x and y, NAME_x and NAME_y, or
x1 and y1, each with _px, _mm, _cm or _m behind it or without a unit.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from evaluator.errors import InputError
from evaluator.interchange.named_points import FileHints, NamedPoints
from evaluator.interchange.tracker_files import cells_of, delimiter_of, numbers_of
from simulator.command import SECONDS

FRAMES = ("frame", "frame_number", "frame_index", "frame_no", "index")
COORDINATE = re.compile(r"(?:(?P<owner>\w+?)_)?(?P<axis>[xy])_?(?P<number>\d*)(?:_(?P<unit>px|mm|cm|m))?")
ALONE = "tracked"  # name of a point that has none


class _Columns(NamedTuple):
    """Columns of x and y by point, unit of length if it is stated, and the column of times with its unit in s."""

    points: dict[str, dict[str, int]]
    unit: str | None
    time: tuple[int, float] | None
    frame: int | None


def columns_of(header: str) -> _Columns | None:
    """What the columns of a header line hold; None if they hold no point."""
    names = [name.lower() for name in cells_of(header, delimiter_of(header))]
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
    return _Columns(points, next(iter(units)) if len(units) == 1 else None, time, frame)


def read_plain(path: Path, said: FileHints) -> NamedPoints:
    """Read the points of a table; frames are counted at the stated rate if it holds no times."""
    lines = [line for line in path.read_text(encoding="utf-8-sig", errors="replace").splitlines() if line.strip()]
    columns, delimiter = columns_of(lines[0]), delimiter_of(lines[0])
    assert columns is not None
    width = len(cells_of(lines[0], delimiter))
    rows = [numbers_of(path, number, line, delimiter) for number, line in enumerate(lines[1:], start=2)]
    table = np.array([(row + [np.nan] * width)[:width] for row in rows], dtype=float).reshape(-1, width)
    if columns.time is not None:
        index, unit_s = columns.time
        time_s = table[:, index] * unit_s
    elif said.rate_hz is None:
        raise InputError(f"{path}: holds no times; give the frame rate: --rate-hz, or rate_hz in [tracks]")
    else:
        time_s = (np.arange(len(table)) if columns.frame is None else table[:, columns.frame]) / said.rate_hz
    return NamedPoints(time_s, {name: table[:, [axes["x"], axes["y"]]] for name, axes in columns.points.items()})


def plain_unit(path: Path) -> str | None:
    """Unit of length that the names of the columns state."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        columns = columns_of(file.readline())
    return None if columns is None else columns.unit
