"""The gap between model and data, before and after the diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from evaluator.report.numbers import METRES, MILLIMETRES
from evaluator.report.pages.colors import BLUE, FAINT, INK, SOFT, VERMILLION
from evaluator.report.style import Figure, drawing, plain_numbers

MOST_ROWS = 40  # more would be unreadable


def gap_before_after(
    gap: dict[str, Any], not_followed: Sequence[str] = (), *, after: str, held_out: str
) -> Figure | None:
    """Distance between simulated and measured marks, run by run, before and after; the noise floor between.

    after: what the model has after the diagnosis, in words; empty if no model explains the runs. held_out: in what the
    held-out runs had no part, in words.
    """
    by_run: dict[str, dict[str, float | None]] = gap.get("by_run") or {}
    if not by_run:
        return None
    table = pd.DataFrame.from_dict(by_run, orient="index").astype(float)
    held = set(gap.get("held_out_runs", []))
    order = table["before"].sort_values(ascending=False, kind="stable").index
    chosen = list(table.loc[order].index[:MOST_ROWS])
    unit = MILLIMETRES if table["before"].max() < 1.0 else METRES  # shown in the smaller one: µm or mm
    before, after_mm, floor = (table.loc[chosen, name].to_numpy() for name in ("before", "after", "noise_floor"))
    aside = np.array([run in held for run in chosen])
    rows = np.arange(len(chosen))[::-1]
    with drawing("gap", height=1.1 + 0.2 * len(chosen)) as canvas:
        (axes,) = canvas.axes
        for row in rows[aside]:
            axes.axhspan(row - 0.5, row + 0.5, color=FAINT, lw=0)
        axes.hlines(rows, after_mm if after else floor, before, color=SOFT, lw=0.8)
        axes.plot(before, rows, color=VERMILLION, marker="s", mfc="none", ls="none", label="before")
        if after:
            axes.plot(after_mm, rows, color=BLUE, marker="o", ls="none", label="after")
        axes.plot(floor, rows, color=INK, marker="|", ms=10, ls="none", label="noise")
        axes.set_yticks(rows, [_label(run, run in held, bool(after) and run in not_followed) for run in chosen])
        axes.set_ylim(-0.7, len(chosen) - 0.3)
        axes.grid(visible=False, axis="y")
        axes.set_xscale("log")
        plain_numbers(axes.xaxis, unit.small_mm)
        axes.set_xlabel(f"RMS distance of simulated and measured marks, {unit.small}")
        canvas.canvas.legend(loc="outside upper right", ncols=3)
    shown = "" if len(chosen) == len(table) else f" The {MOST_ROWS} runs with the largest gap of {len(table)}."
    return Figure(
        "gap",
        "The gap, before and after" if after else "The gap",
        f"Squares: the model of robot.toml{f'; dots: {after}' if after else ''}. Strokes: noise floor. The start pose "
        "and random effects of each run are fitted; start, clock and scale are those of the session. Shaded runs were "
        f"held out: {held_out}.{shown}",
        (canvas.svg,),
        pd.DataFrame(
            {
                "run": chosen,
                "kept_aside": aside,
                "followed": [run not in not_followed for run in chosen],
                "before_um": 1000 * before,
                "after_um": 1000 * after_mm,
                "noise_floor_um": 1000 * floor,
            }
        ),
    )


def _label(run: str, held_out: bool, lost: bool) -> str:
    said = [word for word, true in (("held out", held_out), ("not followed", lost)) if true]
    return f"{run} ({', '.join(said)})" if said else run
