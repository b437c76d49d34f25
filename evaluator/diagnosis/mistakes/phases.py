"""Phases of a run: intervals of constant command."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData

FEWEST_FRAMES = 4  # of a phase; fewer do not determine a motion


def phases_of(run: RunData) -> list[RunData]:
    """The run itself, or for a run with a command log one part for each constant command with a motor on."""
    if run.log is None:
        return [run]
    seen = np.isfinite(run.marks_mm).all(axis=1)
    found = []
    for item in run.log.driven:
        inside = (run.time_s >= item.begin_s) & (run.time_s <= item.end_s)
        if np.count_nonzero(inside & seen) < FEWEST_FRAMES:
            continue
        found.append(
            replace(
                run,
                left_rpm=item.left_rpm,
                right_rpm=item.right_rpm,
                start_s=max(item.begin_s, float(run.time_s[0])),
                stop_s=item.end_s if np.isfinite(item.end_s) else None,
                time_s=run.time_s[inside],
                marks_mm=run.marks_mm[inside],
                systematic={},
                log=None,
            )
        )
    return found
