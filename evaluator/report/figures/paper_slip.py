"""Slip characteristics: the paper's Figures 3, 7 and 8, and the bench's own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from evaluator.report.pages.colors import BLUE, GREEN, INK, ORANGE, PURPLE, SKY, VERMILLION, YELLOW
from evaluator.report.style import Figure, drawing
from simulator.slip.curves import CURVE_RATIOS

COLORS = (INK, BLUE, SKY, GREEN, YELLOW, ORANGE, VERMILLION, PURPLE)
LINES = ("-", "--", "-.", ":", "-", "--", "-.", ":")
# Panel, its abscissa, its ordinate, the parameter of its curves, and their names.
PANELS = (
    ("a", "slip_ratio", "longitudinal", "slip_angle_deg", "{:g}°"),
    ("b", "slip_angle_deg", "lateral", "slip_ratio", "{:g}"),
)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")


def slip_figures(
    name: str, title: str, caption: str, curves: pd.DataFrame, points: pd.DataFrame | None = None
) -> list[Figure]:
    """Panel a: longitudinal force over slip ratio by slip angle; b: lateral force over slip angle by slip ratio.

    curves: `simulator.slip.curves.slip_curves`; points: measured forces of a bench with their sigmas, or None.
    """
    figures = []
    for panel, x, y, by, label in PANELS:
        chosen = curves[curves["panel"] == panel]
        with drawing(f"{name}{panel}", width=4.9, height=3.4) as canvas:
            axes = canvas.axes[0]
            _curves(axes, chosen, x, y, by, label)
            if points is not None:
                _bench_points(axes, points, panel, x, y)
            axes.set_xlabel(x.replace("_", " ").replace(" deg", ", degrees"))
            axes.set_ylabel(f"{y} force / vertical force")
            axes.legend(title=by.split("_deg")[0].replace("_", " "), loc="upper left", bbox_to_anchor=(1.0, 1.02))
            if x == "slip_angle_deg":
                axes.set_xticks(range(0, 91, 15))
        data = chosen if points is None else pd.concat([chosen, points.assign(panel="bench")], ignore_index=True)
        figures.append(Figure(f"{name}{panel}", f"{title}, {y}", caption, (canvas.svg,), data))
    return figures


def _curves(axes: Axes, curves: pd.DataFrame, x: str, y: str, by: str, label: str) -> None:
    for number, (value, curve) in enumerate(curves.groupby(by)):
        look: dict[str, Any] = {"color": COLORS[number % 8], "ls": LINES[number % 8]}
        axes.plot(curve[x], curve[y], **look, label=label.format(value))


def _bench_points(axes: Axes, points: pd.DataFrame, panel: str, x: str, y: str) -> None:
    """Measured forces with two sigmas, in the colour of the nearest curve; unknown forces are left out."""
    if panel == "a":
        key = points["slip_angle_deg"].rank(method="dense").astype(int) - 1
    else:
        distance = np.abs(points["slip_ratio"].abs().to_numpy()[:, None] - np.array(CURVE_RATIOS))
        key = pd.Series(distance.argmin(axis=1), index=points.index)
    for number, group in points[points[y].notna()].groupby(key):
        look: dict[str, Any] = {"color": COLORS[int(str(number)) % 8], "marker": MARKERS[int(str(number)) % 8]}
        axes.errorbar(group[x], group[y], 2 * group[f"{y}_sigma"], ms=3.0, ls="none", elinewidth=0.8, **look)
