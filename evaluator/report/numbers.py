"""Numbers as text for people; light to import."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from evaluator.turning.circular_test import Estimate, Series

HYPHEN_OF_A_NUMBER = re.compile(r"(?<![\w.])-(?=[\d.])")
UNKNOWN = "–"  # for an unknown number


@dataclass(frozen=True)
class LengthUnit:
    """The unit of lengths, and a smaller one for errors; mm, small_mm: their sizes."""

    name: str
    mm: float
    small: str
    small_mm: float

    def text(self, length_mm: float) -> str:
        """A length with three significant figures and its unit."""
        return f"{significant(length_mm / self.mm)} {self.name}"


MILLIMETRES, METRES = LengthUnit("mm", 1.0, "µm", 1e-3), LengthUnit("m", 1000.0, "mm", 1.0)
METRES_FROM_MM = 100.0  # length of a robot from which its radii, a few such lengths, are in metres


def unit_for(robot_length_mm: float) -> LengthUnit:
    """The unit of lengths for a robot of this length."""
    return METRES if robot_length_mm >= METRES_FROM_MM else MILLIMETRES


def true_minus(text: str) -> str:
    """Text for people: numbers have a minus sign instead of a hyphen; names such as turn-33 are kept."""
    return HYPHEN_OF_A_NUMBER.sub("−", text)


def command_text(left_rpm: float, right_rpm: float) -> str:
    """A command as text; a dash if there is none, as for a log without phases."""
    if not (np.isfinite(left_rpm) and np.isfinite(right_rpm)):
        return UNKNOWN
    return true_minus(f"{left_rpm:.4g} / {right_rpm:.4g}")


def number(value: float, digits: int, *, sign: bool = False) -> str:
    """A number with a true minus sign; a dash if it is unknown."""
    if not np.isfinite(value):
        return UNKNOWN if np.isnan(value) else "∞"
    return f"{round(value, digits) + 0.0:{'+' if sign else ''}.{digits}f}".replace("-", "−")  # no minus before zero


def significant(value: float, count: int = 3, *, sign: bool = False) -> str:
    """A number with `count` significant figures, including zeros, without exponent; all integer digits are kept."""
    if not np.isfinite(value) or value == 0:
        return number(value, 0)
    power = int(f"{value:.{count - 1}e}".split("e")[1])  # of the rounded number: 99.97 is 100
    return number(value, max(count - 1 - power, 0), sign=sign)


def interval(low: float, high: float, digits: int = 3, *, sign: bool = False) -> str:
    """Bounds as "low to high"; a dash if they are unknown."""
    return UNKNOWN if np.isnan(low) else f"{number(low, digits, sign=sign)} to {number(high, digits, sign=sign)}"


SERIES_HEAD = (
    "constant",
    "direction, side",
    "runs",
    "",
    "command over path",
    "understeer, °/(m/s²)",
    "sideslip, °/(m/s²)",
)


def series_row(who: str, series: Series) -> list[str]:
    """A series of a circular test under SERIES_HEAD, gradients with their 95 % intervals."""
    held = f"ratio {series.held:.3f}" if series.method == "constant command" else f"radius {series.held:.4g} mm"
    way = f"{series.direction}, {series.side}"
    estimates = (_estimate(item) for item in (series.steering, series.understeer, series.sideslip))
    return [held, way, str(len(series.runs)), who, *estimates]


def _estimate(item: Estimate) -> str:
    """A value and its interval, with the digits that the interval supports."""
    half = (item.high - item.low) / 2
    if not np.isfinite(half):
        return UNKNOWN
    digits = int(np.clip(2 - np.ceil(np.log10(half)), 0, 6)) if half > 0 else 3
    return f"{number(item.value, digits)} ({interval(item.low, item.high, digits)})"
