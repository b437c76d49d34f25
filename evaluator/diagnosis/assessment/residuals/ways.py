"""Residual ways of driven runs: how far the robot is ahead of a model along its own axis, across it, and turned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from evaluator.diagnosis.likelihood.point import Point
    from evaluator.diagnosis.likelihood.problem import Problem
    from evaluator.diagnosis.likelihood.run_data import RunData

Floats = NDArray[np.float64]

FEWEST_FRAMES = 30  # of a run


@dataclass(frozen=True)
class Ways:
    """Residuals of the driven frames of a run, (n,) each: mm along and across the robot, and its heading in degrees.

    time_s: of the recording.
    """

    run: RunData
    time_s: Floats
    along_mm: Floats
    across_mm: Floats
    turned_deg: Floats


def residual_ways(problem: Problem, point: Point) -> list[Ways]:
    """Residual ways of every run with enough driven frames at a point of a model."""
    found = []
    for number, run in enumerate(problem.data):
        residual, channels = problem.residuals([point.task(number)])[0], problem.channels[number]
        stop_s = np.inf if run.stop_s is None else run.stop_s
        used = np.isfinite(residual[:, :3]).all(axis=1) & (run.time_s > run.start_s) & (run.time_s < stop_s)
        if used.sum() < FEWEST_FRAMES:
            continue
        x, y, turned = residual[used, :3].T
        heading = channels[used, 2] - np.pi / 2
        along, across = np.cos(heading) * x + np.sin(heading) * y, np.cos(heading) * y - np.sin(heading) * x
        found.append(Ways(run, run.time_s[used], along, across, np.degrees(turned / problem.half_distance_mm)))
    return found
