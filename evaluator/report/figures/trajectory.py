"""Trajectories of the marks and of the centre, with the circle of the minimum radius: the paper's Figure 19."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from evaluator.report.pages.colors import BLUE, INK
from evaluator.report.runs import RunView
from evaluator.report.style import Figure, Line, drawing, in_units, mark_lines

MOST_POINTS = 240  # of a drawn curve: errors below a tenth of a pixel for a turn that fills its panel
CENTRE = Line("ink", "centre", 1.8)
SIMULATED_CENTRE = Line("vermillion", "simulated centre", 1.3, (4.0, 2.0))
CIRCLE = Line("blue", "circle of minimum radius", 0.8)
MOST_PANELS = 12  # further runs are shown in the player only, because panels would be too small on paper


def legend_of(runs: Sequence[RunView]) -> tuple[Line, ...]:
    """Lines of the drawings: the marks, then centre, simulated centre, circle."""
    names = dict.fromkeys(name for run in runs for name in run.mark_names)
    return (*mark_lines(list(names)), CENTRE, SIMULATED_CENTRE, CIRCLE)


def trajectories(runs: Sequence[RunView]) -> Figure | None:
    """Figure 19: one panel per command, forward and backward beside each other."""
    chosen = representative(runs, MOST_PANELS)
    if not chosen:
        return None
    panels = []
    for run in chosen:
        with drawing(f"trajectory-{run.id}", width=3.3, height=3.3) as canvas:
            _panel(canvas.axes[0], run)
        panels.append(canvas.svg)
    return Figure(
        "trajectories",
        "Trajectories and circles of minimum radius",
        "Thick: measured; dashed: simulated; thin circle: minimum turning radius; dot: start. One run per command, "
        "forward and backward side by side; the player shows all runs. (Figure 19 of the paper.)",
        tuple(panels),
        pd.concat([_data(run) for run in chosen], ignore_index=True),
        legend=legend_of(chosen),
    )


def representative(runs: Sequence[RunView], most: int) -> list[RunView]:
    """One run per command, turning ones first, forward and backward of the same speeds side by side."""
    by_command: dict[tuple[float | str, ...], RunView] = {}
    order: dict[tuple[float | str, ...], int] = {}

    def command(run: RunView, *speeds: float) -> tuple[float | str, ...]:
        """Its wheel speeds; a run whose log holds none for long is a command of its own."""
        return (*speeds, run.group) if np.isfinite(speeds).all() else (run.id,)

    def unsigned(run: RunView) -> tuple[float | str, ...]:
        return command(run, abs(run.left_rpm), abs(run.right_rpm))

    for run in runs:
        by_command.setdefault(command(run, run.left_rpm, run.right_rpm), run)
        order.setdefault(unsigned(run), len(order))

    def rank(run: RunView) -> tuple[bool, int, bool]:
        return not run.turns, order[unsigned(run)], run.backward

    return sorted(by_command.values(), key=rank)[:most]


def thinned(table: pd.DataFrame, most: int) -> pd.DataFrame:
    """Rows at equal steps, including the last one."""
    step = max(1, -(-len(table) // most))
    rows = sorted({*range(0, len(table), step), len(table) - 1})
    return table.iloc[rows]


def _panel(axes: Axes, run: RunView) -> None:
    marks, poses, simulated = (thinned(table, MOST_POINTS) for table in (run.marks, run.poses, run.simulated))
    for name, line in zip(run.mark_names, mark_lines(run.mark_names), strict=True):
        axes.plot(marks[f"{name}_x_mm"], marks[f"{name}_y_mm"], **line.drawn)
    axes.plot(poses["x_mm"], poses["y_mm"], **CENTRE.drawn)
    axes.plot(simulated["x_mm"], simulated["y_mm"], **SIMULATED_CENTRE.drawn)
    first = poses.dropna(subset=["x_mm"]).iloc[:1]
    axes.plot(first["x_mm"], first["y_mm"], color=INK, marker="o", ms=4, ls="none")
    title = f"{run.id}: {run.command}"
    center = run.value("center_x_mm"), run.value("center_y_mm")
    if run.turns and np.isfinite(center).all():
        axes.add_patch(Circle(center, run.value("radius_mm"), fill=False, ec=BLUE, lw=CIRCLE.width))
        axes.plot(*center, color=BLUE, marker="+", ms=5, ls="none")
        title += f"\nradius {run.unit.text(run.value('radius_mm'))}"
    axes.set_title(title)
    _frame(axes, run, marks, poses)
    for axis in (axes.xaxis, axes.yaxis):
        in_units(axis, run.unit.mm)
    axes.set_xlabel(f"x, {run.unit.name}")
    axes.set_ylabel(f"y, {run.unit.name}")


def _frame(axes: Axes, run: RunView, marks: pd.DataFrame, poses: pd.DataFrame) -> None:
    """A square view of the trajectories, and of the whole circle if it is not much larger."""
    drawn = [[*(marks[f"{name}_{axis}_mm"] for name in run.mark_names), poses[f"{axis}_mm"]] for axis in "xy"]
    low = np.array([min(curve.min() for curve in curves) for curves in drawn])
    high = np.array([max(curve.max() for curve in curves) for curves in drawn])
    radius, center = run.value("radius_mm"), np.array([run.value("center_x_mm"), run.value("center_y_mm")])
    if np.isfinite(center).all() and radius < np.max(high - low):
        low, high = np.minimum(low, center - radius), np.maximum(high, center + radius)
    middle, half = (low + high) / 2, 0.54 * np.max(high - low)
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_aspect("equal")
    axes.locator_params(nbins=5)


def _data(run: RunView) -> pd.DataFrame:
    table = run.poses.loc[:, ["time_s", "x_mm", "y_mm", "heading_deg"]].copy()
    table.insert(0, "run", run.id)
    for mark in run.mark_names:
        for axis in "xy":
            table[f"{mark}_{axis}_mm"] = run.marks[f"{mark}_{axis}_mm"]
    for axis in "xy":
        table[f"simulated_{axis}_mm"] = run.simulated[f"{axis}_mm"]
    return thinned(table, MOST_POINTS)
