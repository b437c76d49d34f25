"""Repetitions of each command about their mean, with the scatter between runs and the uncertainty of each run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.patches import Rectangle

from evaluator.report.pages.colors import FAINT, INK
from evaluator.report.runs import RunView
from evaluator.report.style import MEASURED, Figure, drawing
from evaluator.turning.motion.curvature import Z_975

MOST_ROWS = 30  # more would be unreadable; the commands that scatter most are kept


def repetitions(runs: Sequence[RunView], pooled: pd.DataFrame) -> Figure | None:
    """A row per command with at least two turns; None without repetitions."""
    rows = []
    for row in pooled.to_dict("records"):
        key = (str(row["group"]), row["left_rpm"], row["right_rpm"])
        turns = [run for run in runs if (run.group, run.left_rpm, run.right_rpm) == key and run.turns]
        if len(turns) >= 2:
            rows.append((row, turns))
    if not rows:
        return None
    rows = sorted(rows, key=lambda item: -item[0]["radius_between_mm"] / item[0]["radius_mm"])[:MOST_ROWS]
    data = []
    with drawing("repetitions", height=1.2 + 0.3 * len(rows)) as canvas:
        (axes,) = canvas.axes
        axes.axvline(0, color=INK, lw=0.8)
        for place, (row, turns) in zip(range(len(rows))[::-1], rows, strict=True):
            between = 100 * row["radius_between_mm"] / row["radius_mm"]
            axes.add_patch(Rectangle((-between, place - 0.32), 2 * between, 0.64, fc=FAINT, ec="none"))
            off = np.array([100 * (run.value("radius_mm") / row["radius_mm"] - 1) for run in turns])
            sigma = np.array([100 * run.value("radius_random_mm") / row["radius_mm"] for run in turns])
            heights = place + np.linspace(-0.2, 0.2, len(turns))
            axes.errorbar(off, heights, xerr=Z_975 * sigma, **MEASURED.markers(), capsize=2, lw=1.0)
            data += [
                (run.id, run.group, run.left_rpm, run.right_rpm, *numbers, between)
                for run, *numbers in zip(turns, off, sigma, strict=True)
            ]
        names = [" ".join(filter(None, (turns[0].command.removesuffix(" rpm"), turns[0].group))) for _, turns in rows]
        axes.set_yticks(range(len(rows))[::-1], names)
        axes.set_ylim(-0.7, len(rows) - 0.3)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("radius against the mean of its command, %")
    columns = ["run", "group", "left_rpm", "right_rpm", "off_percent", "sigma_percent", "between_percent"]
    return Figure(
        "repetitions",
        "Scatter of repetitions",
        "Circles: runs with 95 % intervals from noise. Grey band: scatter from run to run (one standard deviation, "
        "noise subtracted). A band wider than the bars means that the robot varies, not the measurement.",
        (canvas.svg,),
        pd.DataFrame(data, columns=columns),
    )
