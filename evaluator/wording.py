"""Numbers and units in sentences."""

from __future__ import annotations

import math
import re

MM_PER = {
    "um": 1e-3,
    "mm": 1.0,
    "cm": 10.0,
    "m": 1000.0,
    "inch": 25.4,
}  # of other programs and people
NOTHING_MISSING = "the model explains the data within noise and tolerances"  # the reason of a verdict "none"
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def counted(count: int, noun: str) -> str:
    """A number with its noun: "1 frame", "2 frames"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def verb(count: int, one: str, several: str) -> str:
    """The form of a verb that agrees with a number."""
    return one if count == 1 else several


def with_bounds(value: float, low: float, high: float) -> tuple[str, str, str]:
    """A value and its 95 % bounds with as many decimals as the interval justifies, never with exponents.

    A quarter of the interval is about the standard uncertainty; the last decimal is its first digit. If the half of the
    shorter side bears more, there is one more: a factor of 0.49 between 0.09 and 5 is not 0. Three digits if the
    interval is zero, and at most nine: drawn paths are exact to the last bit.
    """
    if not 0 < high - low < math.inf:
        return f"{value:.3g}", f"{low:.3g}", f"{high:.3g}"
    borne, shown = -math.floor(math.log10((high - low) / 4)), 8 - math.floor(math.log10(max(-low, high)))
    shorter = min(value - low, high - value)
    if shorter > 0:
        borne = max(borne, min(borne + 1, -math.floor(math.log10(shorter / 2))))
    decimals = max(0, min(borne, shown))
    best, least, most = (f"{round(item, decimals) + 0.0:.{decimals}f}" for item in (value, low, high))
    return best, least, most


def power_of_ten(exponent: float) -> str:
    """A factor with too many digits, as a power of ten: "10⁶⁰⁸"."""
    return f"10{f'{exponent:.0f}'.translate(SUPERSCRIPTS)}"


# Values of all wheels together; of a list of wheels the places count by their ratio.
OF_WHEELS = {"radius_mm": "radius of the wheels", "x_mm": "wheelbase", "y_mm": "track"}


def name_of_value(key: str) -> str:
    """The name of a value of robot.toml by its dotted key, without its unit: "lateral friction"."""
    table, _, name = key.rpartition(".")
    if table in ("wheel", "wheels") and name in OF_WHEELS:
        return OF_WHEELS[name]
    if key.startswith("magnetic_attraction."):
        return f"attraction of a {name.removesuffix('_mN').replace('_', ' ')}"
    return re.sub(r"_(mm|m|g|kg|mN|deg|g_mm2)$", "", name).replace("_", " ")
