"""Before and after: the gap between model and data without and with the effect that was found."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from evaluator.report.style import BLUE, SOFT, VERMILLION, Figure, drawing, plain_numbers

MOST_ROWS = 40


def gap_before_after(gap: dict[str, Any]) -> Figure | None:
    """Distance between simulated and measured marks, run by run, before and after; the noise floor between."""
    by_run: dict[str, dict[str, float]] = gap.get("by_run") or {}
    if not by_run:
        return None
    held = set(gap.get("held_out_runs", []))
    chosen = sorted(by_run, key=lambda run: -by_run[run]["before"])[:MOST_ROWS]
    before, after, floor = (
        np.array([by_run[run][name] for run in chosen]) for name in ("before", "after", "noise_floor")
    )
    rows = np.arange(len(chosen))[::-1]
    with drawing("gap", height=1.1 + 0.2 * len(chosen)) as canvas:
        (axes,) = canvas.axes
        axes.hlines(rows, after, before, color=SOFT, lw=0.8)
        axes.plot(before, rows, color=VERMILLION, marker="s", mfc="none", ls="none", label="before")
        axes.plot(after, rows, color=BLUE, marker="o", ls="none", label="after")
        axes.plot(floor, rows, color=SOFT, marker="|", ms=9, ls="none", label="noise")
        axes.set_yticks(rows, [f"{run} (kept aside)" if run in held else run for run in chosen])
        axes.set_ylim(-0.7, len(chosen) - 0.3)
        axes.grid(visible=False, axis="y")
        axes.set_xscale("log")
        plain_numbers(axes.xaxis)
        axes.set_xlabel("distance between model and data, mm RMS")
        canvas.canvas.legend(loc="outside upper right", ncols=3)
    return Figure(
        "gap",
        "The gap, before and after",
        "Squares: the model as robot.toml has it, within its tolerances; dots: with what was found. Dots at the "
        "strokes mean that nothing is left but noise. The runs kept aside took no part in finding it.",
        (canvas.svg,),
        pd.DataFrame(
            {
                "run": chosen,
                "kept_aside": [run in held for run in chosen],
                "before_mm": before,
                "after_mm": after,
                "noise_floor_mm": floor,
            }
        ),
    )
