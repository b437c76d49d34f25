"""Files of OSP Tracker as named points: its delimited text, and its own projects."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evaluator.errors import InputError
from evaluator.interchange.named_points import FileHints, NamedPoints


def read_tracker_text(path: Path, said: FileHints) -> NamedPoints:
    """Two header lines: names of the tracks above their columns, then t, x, y …; any usual delimiter."""
    del said
    lines = [line for line in path.read_text(encoding="utf-8-sig", errors="replace").splitlines() if line.strip()]
    delimiter = delimiter_of(lines[1])
    names, columns = cells_of(lines[0], delimiter), cells_of(lines[1], delimiter)
    names = (names + [""] * len(columns))[: len(columns)]
    if names[0] and columns[0] == "t":  # a table of one track carries its name above the time
        names = ["", names[0], *names[1:-1]] if len(names) > 1 else names
    owner = ""
    place: dict[tuple[str, str], int] = {}
    for index, (name, column) in enumerate(zip(names, columns, strict=True)):
        owner = name or owner
        place.setdefault((plain_name(owner), column), index)
    rows = [numbers_of(path, number, line, delimiter) for number, line in enumerate(lines[2:], start=3)]
    width = len(columns)
    table = np.array([(row + [np.nan] * width)[:width] for row in rows], dtype=float).reshape(-1, width)
    points = {
        name: table[:, [index, place[name, "y"]]]
        for (name, column), index in place.items()
        if name and column == "x" and (name, "y") in place
    }
    return NamedPoints(table[:, columns.index("t")], points)


def read_project(path: Path, said: FileHints) -> NamedPoints:
    """A project of OSP Tracker: in its coordinate system, or in px if [tracks] states so."""
    from evaluator.interchange.tracker_project import Project

    project = Project(path)
    frames = np.array(sorted(set().union(*project.points_px.values())), dtype=float)
    points = {}
    for name, places in project.points_px.items():
        place = np.array([places.get(int(frame), (np.nan, np.nan)) for frame in frames]).reshape(-1, 2)
        # The origin of px is the corner of the image in Tracker, elsewhere the centre of the first pixel.
        points[name] = place - 0.5 if said.unit == "px" or not len(place) else project.on_plate(frames, place)
    return NamedPoints(project.times_s(frames, said.rate_hz), points)


def project_unit(path: Path) -> str:
    """Unit of length that a project states."""
    from evaluator.interchange.tracker_project import Project

    return Project(path).length_unit


def delimiter_of(line: str) -> str | None:
    """Delimiter of a line; None for blanks, if names contain none."""
    return next((mark for mark in "\t;,|" if mark in line), None)


def cells_of(line: str, delimiter: str | None) -> list[str]:
    """Cells of a line, without quotes and blanks around them."""
    return [cell.strip().strip('"') for cell in line.rstrip("\r\n").split(delimiter)]


def plain_name(name: str) -> str:
    """Name of a track in a text file: Tracker writes "mass A" as mass_A."""
    return name.strip().lstrip("#").replace(" ", "_")


def numbers_of(path: Path, number: int, line: str, delimiter: str | None) -> list[float]:
    """Numbers of a line, NaN for an empty cell."""
    try:
        # If the delimiter is not a comma, a comma is the decimal separator of the computer that wrote the file.
        plain = line if delimiter == "," else line.replace(",", ".")
        return [float(cell) if cell and cell.lower() != "none" else np.nan for cell in cells_of(plain, delimiter)]
    except ValueError as error:
        raise InputError(f"{path}: line {number} holds something that is not a number") from error
