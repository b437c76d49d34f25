"""Turning radius against commands: the paper's Figures 18, 14 and 22."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from evaluator.report.numbers import LengthUnit
from evaluator.report.runs import RunView, column, unit_of
from evaluator.report.style import GROUPS, MEASURED, SIMULATED, THEORY, Figure, Series, drawing, plain_numbers

EQUATION_11 = " The dotted line is equation (11), the paper's simulation of its magnetic wheels."


def radius_against_difference(runs: Sequence[RunView]) -> Figure | None:
    """Figure 18: minimum turning radius over the difference of rotational frequency, experiment and simulation."""
    turning = [run for run in runs if run.turns]
    if not turning:
        return None
    with drawing("radius-difference") as canvas:
        (axes,) = canvas.axes
        _points(axes, turning, [run.difference_rpm for run in turning], MEASURED, "experiment, 95 % interval")
        axes.plot(
            [run.difference_rpm for run in turning],
            column(turning, "simulated_radius_mm", "comparison"),
            **SIMULATED.markers(),
            label="simulation",
        )
        _radius_axis(axes, "difference of rotational frequency, rpm", unit_of(turning))
        axes.legend()
    return Figure(
        "radius-difference",
        "Radius against difference of rotational frequency",
        "Circles: runs with 95 % intervals; squares: their simulations. Where a square lies outside the interval, "
        "model and robot disagree, or the marks are not where robot.toml says. (Figure 18 of the paper.)",
        (canvas.svg,),
        _radius_data(turning),
    )


def radius_against_ratio(runs: Sequence[RunView], *, magnetic: bool = True) -> Figure | None:
    """Figure 14: radius over the ratio (outer − inner) / outer; of magnetic wheels, with Eq. (11)."""
    turning = [run for run in runs if run.turns and 0 < _ratio(run) < 1]
    if not turning:
        return None
    ratios = np.array([_ratio(run) for run in turning])
    curve = np.linspace(min(0.1, ratios.min()), max(0.7, ratios.max()), 100)
    with drawing("radius-ratio") as canvas:
        (axes,) = canvas.axes
        _points(axes, turning, ratios, MEASURED, "experiment")
        axes.plot(
            ratios, column(turning, "simulated_radius_mm", "comparison"), **SIMULATED.markers(), label="simulation"
        )
        if magnetic:
            from simulator.paper.numbers import equation_11  # all numbers of the paper: only here

            axes.plot(curve, equation_11(curve), color=THEORY.color, ls=THEORY.line, label="equation (11)")
        _radius_axis(axes, "ratio of difference to the faster wheel", unit_of(turning))
        axes.set_xscale("log")
        plain_numbers(axes.xaxis)
        axes.set_xticks([tick for tick in (0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0) if curve[0] <= tick <= curve[-1]])
        axes.legend()
    data = _radius_data(turning)
    data.insert(3, "ratio", ratios)
    return Figure(
        "radius-ratio",
        "Radius against ratio of the wheel speeds",
        f"If only the ratio of the wheel speeds matters, all runs fall on one line.{EQUATION_11 if magnetic else ''} "
        "(Figure 14 of the paper.)",
        (canvas.svg,),
        data,
    )


def radius_by_group(runs: Sequence[RunView]) -> Figure | None:
    """Figure 22: groups (wheel types, say) compared, forward filled and backward open."""
    turning = [run for run in runs if run.turns]
    groups = list(dict.fromkeys(run.group for run in turning))
    if len({(run.group, run.backward) for run in turning}) < 2:
        return None
    with drawing("radius-groups") as canvas:
        (axes,) = canvas.axes
        for group, look in zip(groups, GROUPS * len(groups), strict=False):
            for backward in (False, True):
                chosen = [run for run in turning if run.group == group and run.backward == backward]
                if chosen:
                    name = ", ".join(filter(None, (group, "backward" if backward else "forward")))
                    series = Series(look.color, "^" if backward else look.marker, look.line, filled=not backward)
                    _points(axes, chosen, [run.difference_rpm for run in chosen], series, name)
        _radius_axis(axes, "difference of rotational frequency, rpm", unit_of(turning))
        axes.legend()
    data = _radius_data(turning)
    data.insert(1, "group", [run.group for run in turning])
    data.insert(2, "direction", ["backward" if run.backward else "forward" for run in turning])
    return Figure(
        "radius-groups",
        "Forward and backward by group",
        "Filled: forward runs; open triangles: backward runs. If the intervals of a pair do not overlap, the robot "
        "turns differently in the two directions. (Figure 22 of the paper.)",
        (canvas.svg,),
        data,
    )


def _ratio(run: RunView) -> float:
    """Ratio r of Eq. (11) for turns to either side, forward or backward, with the faster wheel for n_L."""
    fast, slow = sorted((run.left_rpm, run.right_rpm), key=abs, reverse=True)
    return 1 - slow / fast if fast else float("nan")


def _points(axes: Axes, runs: Sequence[RunView], x: Sequence[float] | np.ndarray, series: Series, name: str) -> None:
    radius, low, high = (column(runs, key) for key in ("radius_mm", "radius_low_mm", "radius_high_mm"))
    high = np.where(np.isfinite(high), high, radius)
    axes.errorbar(
        x,
        radius,
        [radius - low, high - radius],
        **series.markers(),
        ecolor=series.color,
        capsize=2.5,
        lw=1.2,
        label=name,
    )


def _radius_axis(axes: Axes, x_label: str, unit: LengthUnit) -> None:
    axes.set_xlabel(x_label)
    axes.set_ylabel(f"minimum turning radius, {unit.name}")
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    axes.set_ylim(low / 1.15, high * 1.15)
    plain_numbers(axes.yaxis, unit.mm)


def _radius_data(runs: Sequence[RunView]) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "run": [run.id for run in runs],
            "left_rpm": [run.left_rpm for run in runs],
            "right_rpm": [run.right_rpm for run in runs],
            **{name: column(runs, name) for name in ("radius_mm", "radius_low_mm", "radius_high_mm")},
            "simulated_radius_mm": column(runs, "simulated_radius_mm", "comparison"),
        }
    )
