"""Marks as a camera would observe them, from simulated poses: the view of each robot, and errors that runs share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.known_to import SCALE
from evaluator.diagnosis.likelihood.run_data import SHARED_UNIT, Floats, RunData, Task
from simulator.effects.view import View


def marks_of_poses(poses: Floats, times_s: Floats, views: Sequence[View], frames: NDArray[np.int64]) -> Floats:
    """Marks (n, 4) of stacked poses (n, 3); frames: of each task. Most tasks are seen alike."""

    def of(view: View, part: slice) -> Floats:
        x, y, heading = poses[part].T
        return np.concatenate(view.marks(x, y, heading, times_s[part]), axis=1)

    commonest = views[0]
    marks = of(commonest, slice(None))
    ends = np.cumsum(frames)
    for view, end, count in zip(views, ends, frames, strict=True):
        if view is not commonest and _look(view) != _look(commonest):
            part = slice(end - count, end)
            marks[part] = of(view, part)
    return marks


def _look(view: View) -> tuple[object, ...]:
    return view.places_mm, view.scale, view.keystone_per_mm, view.perspective, view.errors


def with_shared_errors(marks: Floats, task: Task, run: RunData, scale_per_unit: float | None) -> Floats:
    """Marks as seen with the errors that runs share; scale_per_unit: relative scale for a deviation of 1, if known."""
    moved = [
        amount * scale_per_unit * marks
        if key == SCALE and scale_per_unit is not None
        else amount / SHARED_UNIT * run.systematic[key]
        for key, amount in task.nominal.items()
        if amount and key in run.systematic
    ]
    return marks + sum(moved) if moved else marks
