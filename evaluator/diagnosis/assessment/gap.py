"""The gap between simulation and measurement in millimetres, on fitted runs and on runs kept aside.

The gap of a run is the RMS distance between the measured and the simulated midpoint of the marks. After: parameters
come from the fitted runs alone; start pose and the run's own friction and gains are fitted within the run-to-run
scatter. Before: the robot file as it is, for the same friction and gains of each run and the start pose that suits it
best. The floor is what tracking noise alone leaves, and never less than two programs of the same model differ by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.features import MODEL_FLOOR_MM
from evaluator.diagnosis.likelihood.problem import Point, Problem

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Gap:
    """RMS gap by run, mm, before and after the effect is added, and the noise floor of each run."""

    before_mm: Floats
    after_mm: Floats
    floor_mm: Floats


def run_gaps(problem: Problem, placed: Point, runs: Sequence[int]) -> Floats:
    """RMS distance of the midpoint by run, mm, at a point in which every run has its own numbers."""
    residuals = problem.residuals([placed.task(run) for run in runs])
    return np.array([np.sqrt(np.nanmean(np.sum(item[:, :2] ** 2, axis=1))) for item in residuals])


def noise_floor(problem: Problem, runs: Sequence[int]) -> Floats:
    """RMS distance of the midpoint that tracking noise and the precision of the model alone make, by run, mm."""
    noise = np.array([[part.sigma_mm for part in problem.noise[run][:2]] for run in runs])
    return np.asarray(np.sqrt(np.sum(noise**2, axis=1) + MODEL_FLOOR_MM**2))


def rms(values: Floats, runs: Sequence[int]) -> float:
    """RMS over some runs; NaN over none."""
    return float(np.sqrt(np.mean(values[list(runs)] ** 2))) if len(runs) else float("nan")
