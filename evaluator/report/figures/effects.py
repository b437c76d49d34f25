"""Influence of an effect on a turn, seen from above."""

from __future__ import annotations

import math

import pandas as pd

from evaluator.report.pages.colors import INK, SOFT, VERMILLION
from evaluator.report.style import Figure, drawing


def effect_figure(effect_id: str, sizes: str, table: pd.DataFrame) -> Figure:
    """Two paths of the robot's centre as a camera measures it, without and with an effect.

    sizes: of the effect, in words; table: time_s, x_mm, y_mm without and with_x_mm, with_y_mm with the effect, a row
    for every frame.
    """
    last = table.iloc[-1]
    apart = math.hypot(last["with_x_mm"] - last["x_mm"], last["with_y_mm"] - last["y_mm"])
    seconds = table[(table["time_s"] + 1e-9) % 1.0 < 1e-6]
    with drawing(f"effect-{effect_id}", width=3.6, height=3.0) as canvas:
        (axes,) = canvas.axes
        for prefix, color, line, label in (("", SOFT, "-", "without"), ("with_", VERMILLION, "--", "with the effect")):
            axes.plot(table[f"{prefix}x_mm"], table[f"{prefix}y_mm"], color=color, ls=line, label=label)
            axes.plot(seconds[f"{prefix}x_mm"], seconds[f"{prefix}y_mm"], color=color, marker=".", ls="none")
        axes.plot(0, 0, marker="o", color=INK, mfc="none", ls="none", label="start, heading right")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x, mm")
        axes.set_ylabel("y, mm")
        axes.legend(loc="best", fontsize=7.0)
    caption = f"A dot every second of measured time; at the end the paths are {apart:.2g} mm apart."
    return Figure(f"effect-{effect_id}", sizes, caption, (canvas.svg,), table)
