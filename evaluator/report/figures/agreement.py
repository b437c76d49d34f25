"""Disagreement of simulation and experiment, run by run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from evaluator.report.pages.colors import INK
from evaluator.report.runs import RunView, column
from evaluator.report.style import MEASURED, SIMULATED, Figure, drawing

MOST_ROWS = 40  # more would be unreadable; the runs that disagree most are kept


def radius_agreement(runs: Sequence[RunView]) -> Figure | None:
    """Simulated minus measured radius in percent, with the measured 95 % interval around zero."""
    turning = [run for run in runs if run.turns]
    if not turning:
        return None
    off = column(turning, "radius_difference_percent", "comparison")
    order = np.argsort(-np.abs(off), kind="stable")[:MOST_ROWS]
    chosen = [turning[index] for index in sorted(order)]
    radius, low, high = (column(chosen, name) for name in ("radius_mm", "radius_low_mm", "radius_high_mm"))
    off = column(chosen, "radius_difference_percent", "comparison")
    below, above = 100 * (low / radius - 1), 100 * (high / radius - 1)
    rows = np.arange(len(chosen))[::-1]
    with drawing("radius-agreement", height=1.1 + 0.21 * len(chosen)) as canvas:
        (axes,) = canvas.axes
        axes.axvline(0, color=INK, lw=0.8)
        axes.hlines(rows, np.minimum(off, 0), np.maximum(off, 0), color=SIMULATED.color, lw=0.8)
        axes.hlines(
            rows, below, np.where(np.isfinite(above), above, 0), color=MEASURED.color, lw=4, label="measured, 95 %"
        )
        axes.plot(off, rows, **SIMULATED.markers(), label="simulated")
        axes.set_yticks(rows, [run.id for run in chosen])
        axes.set_ylim(-0.7, len(chosen) - 0.3)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("simulated against measured radius, %")
        canvas.canvas.legend(loc="outside upper right", ncols=2)
    return Figure(
        "radius-agreement",
        "Where model and robot disagree",
        "Bar: 95 % interval of the measured radius, relative to it. Square: deviation of the simulated radius. Squares "
        "on one side suggest a wrong parameter; a pattern by direction or speed suggests a missing effect.",
        (canvas.svg,),
        pd.DataFrame(
            {
                "run": [run.id for run in chosen],
                "difference_percent": off,
                "measured_low_percent": below,
                "measured_high_percent": above,
            }
        ),
    )
