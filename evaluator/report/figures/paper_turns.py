"""Simulated turns and speeds: the paper's Figures 9 to 14, 18 and 22."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from evaluator.report.pages.colors import BLUE, INK, PAPER, VERMILLION
from evaluator.report.style import GROUPS, SIMULATED, THEORY, Figure, Series, drawing, plain_numbers


def trajectory_figure(number: str, table: pd.DataFrame, published_mm: dict[str, float]) -> Figure:
    """Figures 9, 10: one circle per case; published_mm: the paper's radius of each case."""
    with drawing(f"figure-{number}", width=4.9, height=4.6) as canvas:
        (axes,) = canvas.axes
        for (case, run), look in zip(table.groupby("case"), GROUPS, strict=False):
            ours = (run["y_mm"].max() - run["y_mm"].min()) / 2
            label = f"{str(case)[-1]}: {ours:.2f} mm (paper {published_mm[str(case)]:g})"
            axes.plot(run["x_mm"], run["y_mm"], color=look.color, ls=look.line, label=label)
        axes.plot(0, 0, marker="o", color=INK, ls="none", label="start, heading right")
        axes.set_aspect("equal")
        axes.set_xlabel("x, mm")
        axes.set_ylabel("y, mm")
        axes.legend(loc="center")
    what = "shared between driving and driven wheels" if number == "9" else "of growing strength on the driving wheels"
    return Figure(
        f"figure-{number}",
        f"Figure {number}: attraction {what}",
        "Tire wheels at 70 and 100 rpm, friction 0.3; a full circle of the robot's centre from rest.",
        (canvas.svg,),
        table,
    )


def tire_figure(table: pd.DataFrame) -> Figure:
    """Figure 11: radius over the right wheel's rotational frequency, tire and magnetic wheels."""
    with drawing("figure-11") as canvas:
        (axes,) = canvas.axes
        for (wheel, rows), look in zip(table.groupby("wheel", sort=False), GROUPS, strict=False):
            axes.plot(
                rows["right_rpm"], rows["radius_mm"], color=look.color, ls=look.line, marker=look.marker, label=wheel
            )
        axes.set_xlabel("right wheel, rpm (left wheel: 100 rpm)")
        axes.set_ylabel("minimum turning radius, mm")
        axes.set_ylim(bottom=0)
        axes.set_xticks([60, 70, 80])
        axes.legend()
    caption = (
        "Attraction 22.05 mN on each driving and 2.45 mN on each driven wheel. The paper does not say which friction "
        "its tire had here: 0.3 as in Figures 9 and 10, or 0.84, whose curves peak at the 0.8 of Figure 3. Both turn "
        "wider."
    )
    return Figure("figure-11", "Figure 11: tire against magnetic wheel", caption, (canvas.svg,), table)


def speed_figure(table: pd.DataFrame, slope: float, intercept: float) -> Figure:
    """Figure 12: speed over rotational frequency with the line of Eq. (10)."""
    line = np.array([0.0, 105.0])
    with drawing("figure-12") as canvas:
        (axes,) = canvas.axes
        axes.plot(line, slope * line + intercept, color=THEORY.color, lw=1.0, label="equation (10)")
        axes.plot(table["rpm"], table["speed_mm_s"], **SIMULATED.markers(), label="simulation")
        axes.set_xlabel("rotational frequency, rpm")
        axes.set_ylabel("speed, mm/s")
        axes.legend()
    caption = "Barrel wheels, both driving wheels at one rotational frequency: they roll without slip."
    return Figure("figure-12", "Figure 12: straight-line speed", caption, (canvas.svg,), table)


def difference_figure(table: pd.DataFrame) -> Figure:
    """Figure 13: radius over the difference of rotational frequency, one curve per left speed."""
    looks = (*GROUPS, Series(INK, "X", "-."))
    with drawing("figure-13") as canvas:
        (axes,) = canvas.axes
        for (left, rows), look in zip(table.groupby("left_rpm"), looks, strict=True):
            style: dict[str, Any] = {"color": look.color, "ls": look.line, "marker": look.marker, "ms": 4}
            axes.plot(rows["difference_rpm"], rows["radius_mm"], **style, label=f"{left:g} rpm")
        _radius_axis(axes)
        axes.set_xlabel("difference of rotational frequency, rpm")
        axes.legend(title="left wheel")
    caption = "Barrel wheels. The paper does not list its differences; here every 2.5 rpm within ratios of 0.1 to 0.7."
    return Figure("figure-13", "Figure 13: radius against difference", caption, (canvas.svg,), table)


def ratio_figure(table: pd.DataFrame, published: tuple[float, float], ours: tuple[float, float]) -> Figure:
    """Figure 14: the same radii over the ratio, Eq. (11) and our regression as (factor, exponent)."""
    ratio = np.linspace(0.1, 0.7, 121)
    with drawing("figure-14") as canvas:
        (axes,) = canvas.axes
        axes.plot(table["ratio"], table["radius_mm"], **SIMULATED.markers(), label="simulation, 20 to 50 rpm")
        for (factor, exponent), color, line, name in (
            (published, INK, "-", "paper"),
            (ours, VERMILLION, "--", "ours"),
        ):
            label = f"{name}: {factor:.4f} $r^{{{exponent:.4f}}}$"
            axes.plot(ratio, factor * ratio**exponent, color=color, ls=line, lw=1.1, label=label)
        _radius_axis(axes)
        axes.set_xscale("log")
        plain_numbers(axes.xaxis)
        axes.set_xticks([0.1, 0.2, 0.3, 0.5, 0.7])
        axes.set_xlabel("ratio r of the difference to the left wheel")
        axes.legend()
    caption = "All speeds fall on one curve: the radius depends on the ratio alone, as the paper finds. Equation (11)."
    return Figure("figure-14", "Figure 14: radius against ratio", caption, (canvas.svg,), table)


def prototype_figure(table: pd.DataFrame) -> Figure:
    """Figures 18 and 22, simulation: radius of the prototype over the difference, both wheel types."""
    with drawing("figure-18") as canvas:
        (axes,) = canvas.axes
        looks = {"barrel": Series(VERMILLION, "s", "-"), "column": Series(BLUE, "o", "--", filled=False)}
        for (figure, wheel), rows in table.groupby(["figure", "wheel"]):
            look = looks[str(wheel)]
            line = look.line if figure == "18" else "none"
            label = f"{wheel}, {'33' if figure == '18' else '33.3'} rpm left"
            shape = look.marker if figure == "18" else "D"
            fill = look.color if look.filled else PAPER
            style: dict[str, Any] = {"color": look.color, "ls": line, "marker": shape, "mfc": fill}
            axes.plot(rows["difference_rpm"], rows["radius_mm"], **style, label=label)
        _radius_axis(axes)
        axes.set_xlabel("difference of rotational frequency, rpm")
        axes.legend()
    caption = (
        "Squares and circles: 33 rpm left against 29, 14 and 5 rpm right (Figure 18); diamonds: the differences of "
        "Figure 22, 33.3 rpm left. Forward and backward radii are equal in the model; the measured ones are not."
    )
    return Figure("figure-18", "Figures 18 and 22: the prototype, simulated", caption, (canvas.svg,), table)


def _radius_axis(axes: Axes) -> None:
    axes.set_ylabel("minimum turning radius, mm")
    axes.set_yscale("log")
    plain_numbers(axes.yaxis)
    axes.set_yticks([2, 5, 10, 20, 50, 100])
