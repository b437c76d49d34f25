"""Every number and ordering in the paper's text, published and computed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from simulator.paper import tables
from simulator.paper.checks import (
    AGREEMENT,
    CLOSE,
    CLOSENESS,
    CONJECTURE,
    DIFFERS,
    FITTED,
    Check,
    number,
    standing,
    statement,
)
from simulator.paper.forward_backward import direction_checks, scope
from simulator.paper.machines import PUBLISHED_TURNS, TIRE_PEAK_FRICTION, machine_of
from simulator.paper.readings import RIGHT_ANGLES, published_radii
from simulator.paper.slip_numbers import slip_checks
from simulator.robot import load_robot

if TYPE_CHECKING:
    import pandas as pd

EQUATION_10 = (0.0524, 0.00007)
EQUATION_11 = (2.5735, -1.5141)


@dataclass(frozen=True)
class PowerLaw:
    """factor · ratio^exponent fitted to radii, as Eq. (11); residual_rms: of ln(radius)."""

    factor: float
    exponent: float
    residual_rms: float


def power_law(ratio: pd.Series[float], radius_mm: pd.Series[float]) -> PowerLaw:
    """Regression of ln(radius) on ln(ratio), as spreadsheets fit a power curve."""
    x, y = np.log(ratio.to_numpy(float)), np.log(radius_mm.to_numpy(float))
    exponent, level = np.polyfit(x, y, 1)
    rms = float(np.sqrt(np.mean((y - level - exponent * x) ** 2)))
    return PowerLaw(float(np.exp(level)), float(exponent), rms)


def equation_11(ratio: np.ndarray) -> np.ndarray:
    """Published minimum turning radius in mm at a ratio (n_L - n_R)/n_L."""
    factor, exponent = EQUATION_11
    return np.asarray(factor * np.asarray(ratio, float) ** exponent)


def published_numbers() -> list[Check]:
    """All checks, in the order of the paper."""
    checks = slip_checks()
    checks += _attraction_checks()
    checks += _tire_against_magnetic_checks()
    checks += _straight_checks()
    checks += _turning_checks()
    checks += direction_checks()
    checks += _wheel_type_checks()
    checks += scope()
    return checks


def _attraction_checks() -> list[Check]:
    radii = {turn.case: tables.radius_mm(machine_of(turn), 70.0, 100.0) for turn in PUBLISHED_TURNS}
    checks = [
        number(f"Fig. {turn.case}", "minimum radius, tire", turn.radius_mm, radii[turn.case], "mm", turn.last_digit_mm)
        for turn in PUBLISHED_TURNS
    ]
    published = np.array([turn.radius_mm for turn in PUBLISHED_TURNS])
    off = np.abs(published_radii(RIGHT_ANGLES) / published - 1).max()
    what = "these radii, slip angle of Eq. (5) in right angles"
    right_angles = statement("Fig. 9, 10", what, "as above", f"all within {off:.2%}", off <= AGREEMENT)
    checks += standing([right_angles], CONJECTURE)
    a, b, c, none, strong = (radii[turn.case] for turn in PUBLISHED_TURNS)
    found = f"{c:.2f} < {b:.2f} < {a:.2f} mm"
    checks.append(statement("Fig. 9", "order of the radii", "c < b < a", found, c < b < a))
    first, second = 1 - c / none, 1 - strong / c
    ours = f"first 1 W: {first:.0%} tighter, next 8.5 W: {second:.0%}"
    checks.append(
        statement("Sec. 4.2", "gain from 1 W to 9.5 W", "not significant beyond 1 W", ours, second < first / 3)
    )
    return checks


def _tire_against_magnetic_checks() -> list[Check]:
    table = tables.tire_against_magnetic().pivot_table(index="right_rpm", columns="wheel", values="radius_mm")
    checks = []
    for wheel in ("column", "barrel"):
        for tire in ("tire, friction 0.3", f"tire, friction {TIRE_PEAK_FRICTION}"):
            pairs = ", ".join(f"{row[wheel]:.1f} < {row[tire]:.1f}" for _, row in table.iterrows())
            what = f"{wheel} against {tire}; 60, 70, 80 rpm"
            tighter = bool((table[wheel] < table[tire]).all())
            checks.append(statement("Fig. 11", what, "turns tighter", f"{pairs} mm", tighter))
    return checks


def _straight_checks() -> list[Check]:
    table = tables.straight_speeds()
    slope, intercept = np.polyfit(table.rpm, table.speed_mm_s, 1)
    published_slope, published_intercept = EQUATION_10
    return [
        number("Eq. (10)", "speed over rpm", published_slope, float(slope), "mm/s/rpm", 0.0001),
        statement(
            "Eq. (10)",
            "intercept",
            f"{published_intercept} mm/s, no slip",
            f"{intercept:.1g} mm/s",
            abs(intercept) <= published_intercept,
        ),
    ]


def _turning_checks() -> list[Check]:
    checks = []
    grid = np.round(np.arange(0.1, 0.7001, 0.05), 2)
    for wheel in ("barrel", "column"):
        robot = load_robot(wheel)
        table = tables.turning_map(robot)
        law = power_law(table["ratio"], table["radius_mm"])
        law_checks = [
            number("Eq. (11)", f"factor, {wheel}", EQUATION_11[0], law.factor, "mm"),
            number("Eq. (11)", f"exponent, {wheel}", EQUATION_11[1], law.exponent),
        ]
        radii = np.array([tables.radius_mm(robot, 35.0, 35.0 * (1 - ratio)) for ratio in grid])
        off = radii / equation_11(grid) - 1
        worst, rms = np.abs(off).max(), np.sqrt(np.mean(off**2))
        ours = f"largest {worst:.1%} at {grid[np.abs(off).argmax()]:g}, RMS {rms:.1%}"
        what = f"deviation, ratios 0.1 to 0.7, {wheel}"
        met = CLOSE if worst <= CLOSENESS else DIFFERS
        law_checks.append(Check("Eq. (11)", what, "2.5735 r^-1.5141", ours, "", met))
        checks += standing(law_checks, FITTED)
        spread = _spread_over_speed(table)
        what = f"one radius a ratio over 20 to 50 rpm, {wheel}"
        checks.append(statement("Fig. 14", what, "one to one", f"equal within {spread:.2%}", spread < 0.005))
    return checks


def _spread_over_speed(table: pd.DataFrame) -> float:
    """Largest relative difference of radius between runs of one ratio and different speed."""
    groups = table.assign(key=table["ratio"].round(9)).groupby("key")["radius_mm"]
    return float((groups.max() / groups.min() - 1).max())


def _wheel_type_checks() -> list[Check]:
    """Figure 22: barrel and column wheels; their slip laws were fitted to this difference."""
    table = tables.prototype_turns()
    paired = table[table["figure"] == "22"].pivot_table(index="difference_rpm", columns="wheel", values="radius_mm")
    gain = paired["barrel"] / paired["column"] - 1
    small, large = float(gain.loc[4.8]), gain.loc[[19.4, 28.5]].abs().max()
    few, much = "barrel over column, 4.8 rpm difference", "barrel over column, 19.4 and 28.5 rpm"
    rows = [
        statement("Fig. 22", few, "tighter", f"{small:+.1%}", small < -0.01),
        statement("Fig. 22", much, "not much different", f"within {large:.1%}", large < 0.01),
    ]
    return standing(rows, FITTED)
