"""Figures of the disagreement between measurement and model: dependences in sigmas, and residuals by second."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from evaluator.diagnosis.assessment.residuals.disagreement import (
    QUANTITIES,
    SHOWN_SIGMAS,
    UNITS,
    Dependence,
    every_dependence,
)
from evaluator.report.pages.colors import BLUE, INK, PAPER, SOFT, VERMILLION
from evaluator.report.style import Figure, Line, drawing

MOST_PANELS = 6  # two rows; the map has all dependences
MOST_POINTS = 250  # of a panel: more points overlap, and increase the size of the page
SHORT = {"along_mm_s": "along", "across_mm_s": "sideways", "yaw_deg_s": "yaw rate"}
FULL_SIGMAS = 12.0  # the darkest shade
ON_PLATE_WORDS = " On the plate, before: triangles up, measured more than simulated; down, less."
# Words on an axis with the sign of values reversed, by the column whose sign they are multiplied by.
REVERSED = {"direction": "sign reversed backward", "side": "sign reversed in right turns"}
BEFORE: dict[str, Any] = {"color": VERMILLION, "marker": "s", "mfc": "none", "mew": 0.8, "ms": 4.0, "ls": "none"}
AFTER: dict[str, Any] = {"color": BLUE, "marker": "o", "ms": 2.6, "ls": "none"}


def after_pieces(pieces: pd.DataFrame) -> pd.DataFrame:
    """The table of pieces with the residuals after the diagnosis in place of those before."""
    return pieces.drop(columns=list(QUANTITIES)).rename(columns={f"after_{name}": name for name in QUANTITIES})


def disagreement_map(pieces: pd.DataFrame, *, after: bool = True) -> Figure:
    """Significance of every tested dependence, before and, if there is a model, after the diagnosis."""
    tables = {"before": pieces} | ({"after": after_pieces(pieces)} if after else {})
    sigmas = {
        (name, item.quantity, _label(item)): item.sigmas
        for name, table in tables.items()
        for item in every_dependence(table)
    }
    labels = list(dict.fromkeys(label for _, _, label in sigmas))
    columns = [(quantity, name) for quantity in QUANTITIES for name in tables]
    with drawing("disagreement-map", height=1.1 + 0.2 * len(labels)) as canvas:
        (axes,) = canvas.axes
        for row, label in enumerate(labels):
            for column, (quantity, name) in enumerate(columns):
                value = sigmas.get((name, quantity, label))
                if value is not None:
                    _cell(axes, column + 0.25 * (column // len(tables)), -row, value)
        at = [column + 0.25 * (column // len(tables)) for column in range(len(columns))]
        axes.set_xlim(-0.55, at[-1] + 0.55)
        axes.set_ylim(-len(labels) + 0.4, 0.6)
        axes.set_yticks(-np.arange(len(labels)), labels)
        axes.set_xticks(at, [name for _, name in columns])
        axes.tick_params(length=0, labelsize=8)
        axes.xaxis.tick_top()
        top = axes.secondary_xaxis(1.08)
        top.set_xticks(np.add(at[:: len(tables)], (len(tables) - 1) / 2), list(SHORT.values()))
        top.tick_params(length=0)
        for spine in (*axes.spines.values(), *top.spines.values()):
            spine.set_visible(False)
        axes.grid(visible=False)
    rows = [(SHORT[quantity], label, name, value) for (name, quantity, label), value in sigmas.items()]
    return Figure(
        "disagreement-map",
        "What the disagreement depends on",
        f"Significance in sigmas, with run-to-run scatter; bold from {SHOWN_SIGMAS:g} on. Even: same sign forward and "
        "backward; odd: opposite sign backward. Empty cell: not determined by these runs.",
        (canvas.svg,),
        pd.DataFrame(rows, columns=["quantity", "by", "model", "sigmas"]),
    )


def _label(item: Dependence) -> str:
    both_ways = item.by in ("heading", "twice the heading", "place")
    return f"{item.by}, {item.parity}" if both_ways else item.by


def _cell(axes: Axes, x: float, y: float, sigmas: float) -> None:
    """A shaded number; its text has the background colour on a dark shade."""
    shade = min(sigmas / FULL_SIGMAS, 1.0) if sigmas >= SHOWN_SIGMAS else 0.0
    if shade:
        axes.add_patch(Rectangle((x - 0.47, y - 0.44), 0.94, 0.88, fc=VERMILLION, ec="none", alpha=0.25 + 0.75 * shade))
    strong = shade > 0.5
    axes.text(
        *(x, y, f"{sigmas:.1f}" if sigmas < 9.95 else f"{sigmas:.0f}"),
        ha="center",
        va="center",
        fontsize=8,
        color=PAPER if strong else INK if shade else SOFT,
        fontweight="bold" if shade else "normal",
    )


def disagreement_panels(pieces: pd.DataFrame, *, after: str) -> Figure | None:
    """The pieces against the quantities on which they depend most, before and after; None if nothing is significant.

    after: what the model has after the diagnosis, in words; empty if no model explains the runs.
    """
    found = sorted(every_dependence(pieces), key=lambda item: -item.sigmas)
    chosen: dict[tuple[str, str, str], Dependence] = {}
    for item in found:
        if item.sigmas >= SHOWN_SIGMAS:
            chosen.setdefault((item.quantity, _axis(item), item.parity if _axis(item) == "heading_deg" else ""), item)
    shown = list(chosen.values())[:MOST_PANELS]
    if not shown:
        return None
    panels = []
    for number, item in enumerate(shown):
        with drawing(f"disagreement-{number}", width=4.4 if len(shown) == 1 else 3.0, height=2.9) as canvas:
            (axes,) = canvas.axes
            axes.set_title(f"{QUANTITIES[item.quantity]}, {item.sigmas:.0f} sigmas")
            if _axis(item) == "place":
                _on_plate(axes, pieces, item)
            else:
                _against(axes, pieces, item, after=bool(after))
        panels.append(canvas.svg)
    return Figure(
        "disagreement",
        "Disagreement, second by second",
        "Measured minus simulated; each point is about one second of a run. Open squares: before, the model of "
        f"robot.toml{f'; dots: after, {after}' if after else ''}."
        f"{ON_PLATE_WORDS if any(_axis(item) == 'place' for item in shown) else ''}",
        tuple(panels),
        pieces,
        (Line("vermillion", "before", marker="square"), Line("blue", "after", marker="dot")) if after else (),
    )


def _axis(item: Dependence) -> str:
    """The abscissa of a dependence."""
    if "heading" in item.by:
        return "heading_deg"
    if item.by == "place":
        return "place"
    if item.by in ("the first second", "time since the command"):
        return "time_s"
    if item.by == "order of the runs":
        return "order"
    if item.by == "direction times side":
        return "both"
    return "speed" if item.by in ("everywhere", "forward and backward", "speed") else "difference"


def _against(axes: Axes, pieces: pd.DataFrame, item: Dependence, *, after: bool) -> None:
    kind, motion = _axis(item), "side" if item.quantity == "yaw_deg_s" else "direction"
    some = _thinned(pieces)
    reversing = "direction" if kind == "heading_deg" else motion
    sign = some[reversing] if _turned_over(item) else 1.0
    signed = {
        "speed": ("direction", "speed_rpm"),
        "difference": ("side", "difference_rpm"),
        "both": ("direction", "side", "difference_rpm"),
    }
    across = some[list(signed.get(kind, (kind,)))].prod(axis=1)
    axes.axhline(0, color=INK, lw=0.8)
    axes.plot(across, sign * some[item.quantity], **BEFORE)
    if after:
        axes.plot(across, sign * some[f"after_{item.quantity}"], **AFTER)
    if kind == "heading_deg":
        axes.set_xlim(0, 360)
        axes.set_xticks(range(0, 361, 90))
    names = {
        "speed": "speed, rpm (backward negative)",
        "difference": "right minus left, rpm",
        "both": "right minus left, rpm, sign reversed backward",
        "heading_deg": "heading on the plate, °",
        "time_s": "time since the command, s",
        "order": "run of the session",
    }
    axes.set_xlabel(names[kind])
    unit = UNITS[item.quantity].replace("deg", "°")
    axes.set_ylabel(f"{unit}, {REVERSED[reversing]}" if _turned_over(item) else unit)


def _turned_over(item: Dependence) -> bool:
    return item.parity == "odd" and _axis(item) in ("heading_deg", "time_s", "order")


def _on_plate(axes: Axes, pieces: pd.DataFrame, item: Dependence) -> None:
    some = _thinned(pieces)
    sign = some["direction"].to_numpy() if item.parity == "odd" else 1.0
    value = np.asarray(sign * some[item.quantity].to_numpy(), dtype=float)
    size = 55 * np.abs(value) / max(float(np.quantile(np.abs(value), 0.95)), 1e-12)
    for chosen, marker, look in (
        (value >= 0, "^", {"fc": VERMILLION, "ec": "none"}),
        (value < 0, "v", {"fc": "none", "ec": BLUE, "lw": 0.9}),
    ):
        axes.scatter(some["x_mm"][chosen], some["y_mm"][chosen], s=np.minimum(size[chosen], 90), marker=marker, **look)
    axes.set_aspect("equal", "datalim")
    axes.set_xlabel("x on the plate, mm" + (f", {REVERSED['direction']}" if item.parity == "odd" else ""))
    axes.set_ylabel("y, mm")


def _thinned(pieces: pd.DataFrame) -> pd.DataFrame:
    step = -(-len(pieces) // MOST_POINTS)
    return pieces.iloc[::step]
