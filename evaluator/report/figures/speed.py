"""Speed of the marks in straight runs: the paper's Figure 17."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from evaluator.report.pages.colors import INK
from evaluator.report.runs import RunView, column
from evaluator.report.style import THEORY, Figure, drawing, mark_lines


def straight_speed(runs: Sequence[RunView], wheel_radius_mm: float) -> Figure | None:
    """Figure 17: speeds of the marks over rotational frequency, and theory for a wheel without slip."""
    straight = [run for run in runs if run.straight and run.left_rpm]
    if not straight:
        return None
    rpm = np.array([run.left_rpm for run in straight])
    slope = 2 * np.pi * wheel_radius_mm / 60
    line = np.array([min(0.0, rpm.min()), max(0.0, rpm.max())]) * 1.08
    names = list(dict.fromkeys(name for run in straight for name in run.mark_names))
    speed = {name: column(straight, f"{name}_speed_mm_s") for name in names}
    with drawing("straight-speed") as canvas:
        (axes,) = canvas.axes
        axes.plot(line, slope * line, color=THEORY.color, ls="-", lw=1.0, label="theory: no slip")
        for k, (name, look) in enumerate(zip(names, mark_lines(names), strict=True)):
            marker: dict[str, Any] = {"marker": "x", "mew": 1.6} if k % 2 else {"marker": "o", "mfc": "none", "ms": 7}
            axes.plot(rpm, speed[name], color=look.drawn["color"], ls="none", label=look.text, **marker)
        axes.axhline(0, color=INK, lw=0.6)
        axes.axvline(0, color=INK, lw=0.6)
        axes.set_xlabel("rotational frequency, rpm (negative: backward)")
        axes.set_ylabel("speed of the mark, mm/s")
        axes.legend()
    return Figure(
        "straight-speed",
        "Straight runs: speed against rotational frequency",
        "Line: rolling without slip. Different speeds of the marks mean that the run was not straight; points below "
        "the line, that the wheels slip or turn slower than commanded. (Figure 17 of the paper.)",
        (canvas.svg,),
        pd.DataFrame(
            {
                "run": [run.id for run in straight],
                "rpm": rpm,
                "theory_mm_s": slope * rpm,
                **{f"{name}_mm_s": values for name, values in speed.items()},
            }
        ),
    )
