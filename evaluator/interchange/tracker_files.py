"""Files of OSP Tracker as named points: its delimited text, and its own projects."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from evaluator.interchange.delimited_text import cells_of, delimiter_of, lines_of, numbers_of
from evaluator.interchange.named_points import FileHints, NamedPoints
from evaluator.wording import MM_PER


def read_tracker_text(path: Path, said: FileHints) -> NamedPoints:
    """Two header lines: names of the tracks above their columns, then t, x, y …; any usual delimiter."""
    del said
    lines = lines_of(path)
    delimiter = delimiter_of(lines[1][1])
    names, columns = (cells_of(line, delimiter) for _, line in lines[:2])
    names = (names + [""] * len(columns))[: len(columns)]
    if names[0] and columns[0] == "t":  # a table of one track carries its name above the time
        names = ["", names[0], *names[1:-1]] if len(names) > 1 else names
    owner = ""
    place: dict[tuple[str, str], int] = {}
    for index, (name, column) in enumerate(zip(names, columns, strict=True)):
        owner = name or owner
        place.setdefault((plain_name(owner), column), index)
    rows = [numbers_of(path, number, cells_of(line, delimiter), delimiter) for number, line in lines[2:]]
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
    unit = project.length_unit if project.length_unit in MM_PER else None
    return NamedPoints(project.times_s(frames, said.rate_hz), points, unit)


def plain_name(name: str) -> str:
    """Name of a track in a text file: Tracker writes "mass A" as mass_A."""
    return name.strip().lstrip("#").replace(" ", "_")
