"""Lines and cells of delimited text as programs and spreadsheets write it."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from calibration.tables import table_head
from evaluator.errors import InputError


def lines_of(path: Path) -> list[tuple[int, str]]:
    """Lines that are not empty, each with its number, from the line of names of the table on."""
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    head = table_head(lines)
    numbered = [(head.number, head.names), *enumerate(lines[head.number :], start=head.number + 1)]
    return [(number, line) for number, line in numbered if line.strip()]


def delimiter_of(line: str) -> str | None:
    """Delimiter of a line; None for blanks, if names contain none."""
    return next((mark for mark in "\t;,|" if mark in line), None)


def cells_of(line: str, delimiter: str | None) -> list[str]:
    """Cells of a line, without quotes and blanks around them."""
    line = line.rstrip("\r\n")
    if '"' in line and delimiter is not None:
        return [cell.strip() for row in csv.reader([line], delimiter=delimiter, skipinitialspace=True) for cell in row]
    return [cell.strip().strip('"') for cell in line.split(delimiter)]


def number_of(cell: str, delimiter: str | None) -> float:
    """The number in a cell, NaN if it is empty. Raises ValueError.

    If the delimiter is not a comma, a comma is the decimal separator of the computer that wrote the file.
    """
    if not cell or cell.lower() in ("none", "-", "--"):
        return np.nan
    return float(cell if delimiter == "," else cell.replace(",", "."))


def numbers_of(path: Path, number: int, cells: list[str], delimiter: str | None) -> list[float]:
    """Numbers of the cells of a line. Raises InputError that names the line."""
    try:
        return [number_of(cell, delimiter) for cell in cells]
    except ValueError as error:
        raise InputError(f"{path}: line {number} holds something that is not a number") from error
