"""Significant residuals of a fitted model, which contradict the verdict "none".

The robot file as it stands may differ from the measurement without anything missing: friction of a run, nominal values
and what a laboratory knows are free within their tolerances. What is left after that has to depend on nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

from evaluator.diagnosis.assessment.disagreement import Dependence
from evaluator.diagnosis.assessment.gap import noise_floor
from evaluator.diagnosis.assessment.verdict import NOT_CHANCE
from evaluator.diagnosis.likelihood.problem import Problem

# RMS of t over a run of length 1 about its mean: what a rate leaves of a path that is laid on another.
LAID_ON = 12**-0.5


def unexplained(asked: Sequence[Dependence], problem: Problem, path_noise_floors: float) -> Dependence | None:
    """The most significant thing that a fitted model misses and that matters; None where there is none.

    asked: all that was asked of what it leaves over. It is believed where chance makes one so large among all of them
    with NOT_CHANCE, and matters where it moves the marks of a usual run by so many noise floors.
    """
    believed = [item for item in asked if 2 * float(special.ndtr(-item.sigmas)) * len(asked) < NOT_CHANCE]
    left = [item for item in believed if moved_mm(item, problem) > path_noise_floors * _floor_mm(problem)]
    return max(left, key=lambda item: item.sigmas, default=None)


def moved_mm(item: Dependence, problem: Problem) -> float:
    """By how much a rate that is missed moves the marks of a usual run, RMS, the start pose at its best."""
    lasting_s = float(np.median([run.time_s[-1] - max(run.start_s, run.time_s[0]) for run in problem.data]))
    rate = np.radians(item.rms) * problem.half_distance_mm if item.quantity == "yaw_deg_s" else item.rms
    return float(rate * lasting_s * LAID_ON)


def _floor_mm(problem: Problem) -> float:
    return float(np.median(noise_floor(problem, range(len(problem.data)))))
