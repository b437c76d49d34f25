"""The uncertainty budget of a run as a section of the report: a table, and bars for the radius."""

from __future__ import annotations

import numpy as np
import pandas as pd

from evaluator.report.numbers import significant
from evaluator.report.pages.colors import BLUE, ORANGE
from evaluator.report.pages.html import Section, Table
from evaluator.report.runs import RunView
from evaluator.report.style import Figure, drawing, in_units
from evaluator.turning.budget import Budget, Contribution

LEAST_PERCENT = 1e-4  # shorter bars are not visible
LEAST_DEG = 1e-6  # smaller values are rounding errors


def budget_section(run: RunView, budget: Budget) -> Section:
    """Section on the contribution of each source to radius, speed and heading of one run."""
    radius = budget.turning.radius_mm
    measured = budget.combined(measured_only=True)
    everything = budget.combined(measured_only=False)
    rows = tuple(_row(item, radius) for item in (*budget.contributions, measured, everything))
    caption = (
        f"Standard uncertainties (GUM, JCGM 100) of run {run.id}, measured again with one source more at a time. "
        "The intervals of this report contain those of the measurement, and of the marks what [known_to] of robot.toml "
        "states. Errors of robot.toml and the clock are common to all runs of a robot: they affect a comparison with "
        "the model, not one between runs."
    )
    head = ("source", "radius, µm", "radius, %", "speed, µm/s", "heading, deg", "")
    figure = _bars(run, budget)
    return Section("budget", "Uncertainty budget", (_sentence(budget),), (figure,), (Table(caption, head, rows),))


def _sentence(budget: Budget) -> str:
    radius, measured = budget.turning.radius_mm, budget.combined(measured_only=True)
    largest = max(budget.contributions, key=lambda item: np.nan_to_num(item.radius_mm))  # NaN: unknown for this run
    return (
        f"Standard uncertainty of the radius in its interval: "
        f"{significant(100 * measured.radius_mm / radius, 2)} %. "
        f"Largest source of all: {largest.source}, {significant(100 * largest.radius_mm / radius, 2)} %."
    )


def _row(item: Contribution, radius_mm: float) -> tuple[str, ...]:
    kind = "" if item.measured else "not in the intervals"
    return (
        item.source,
        significant(1000 * item.radius_mm, 2),
        significant(100 * item.radius_mm / radius_mm, 2),
        significant(1000 * item.speed_mm_s, 2),
        significant(item.heading_deg if item.heading_deg > LEAST_DEG else 0.0, 2),
        kind,
    )


def _bars(run: RunView, budget: Budget) -> Figure:
    names = [item.source for item in budget.contributions]
    percent = np.array([100 * item.radius_mm / budget.turning.radius_mm for item in budget.contributions])
    places = np.arange(len(names))[::-1]
    with drawing("budget", width=6.4, height=0.9 + 0.33 * len(names)) as canvas:
        (axes,) = canvas.axes
        for measured, color, label in ((True, BLUE, "in the interval"), (False, ORANGE, "not in the interval")):
            chosen = np.array([item.measured is measured for item in budget.contributions])
            axes.barh(places[chosen], np.maximum(percent[chosen], LEAST_PERCENT), color=color, height=0.6, label=label)
        axes.set_yticks(places, names)
        axes.set_xscale("log")
        in_units(axes.xaxis, 1.0)
        axes.set_xlim(LEAST_PERCENT, max(3 * float(np.nan_to_num(percent).max()), 10 * LEAST_PERCENT))
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("standard uncertainty of the radius, %")
        axes.legend(loc="lower right")
    return Figure(
        "budget-radius",
        f"Sources of the uncertainty of the radius, run {run.id}",
        f"Standard uncertainty of the radius from each source; values below {LEAST_PERCENT:g} % are drawn as "
        f"{LEAST_PERCENT:g} %.",
        (canvas.svg,),
        pd.DataFrame({"source": names, "radius_percent": percent}),
    )
