"""Significant residuals of a fitted model, which contradict the verdict "none".

The robot file may differ from the measurement without a missing effect: friction of a run, nominal values and
quantities known to a tolerance are free within their tolerances. The residuals that remain must not depend on anything.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

from evaluator.diagnosis.assessment.gap import noise_floor
from evaluator.diagnosis.assessment.residuals.disagreement import Dependence
from evaluator.diagnosis.assessment.verdict import NOT_CHANCE
from evaluator.diagnosis.likelihood.problem import Problem

# RMS of t about its mean over a run of length 1: displacement by a constant rate after fitting the start pose.
LAID_ON = 12**-0.5


def unexplained(asked: Sequence[Dependence], problem: Problem, path_noise_floors: float) -> Dependence | None:
    """The most significant relevant dependence of the residuals of a fitted model; None if there is none.

    asked: all tested dependences. A dependence is significant if chance gives so large a value among all of them with
    probability NOT_CHANCE, and relevant if it moves the marks of a typical run by path_noise_floors noise floors.
    """
    believed = [item for item in asked if 2 * float(special.ndtr(-item.sigmas)) * len(asked) < NOT_CHANCE]
    left = [item for item in believed if moved_mm(item, problem) > path_noise_floors * _floor_mm(problem)]
    return max(left, key=lambda item: item.sigmas, default=None)


def moved_mm(item: Dependence, problem: Problem) -> float:
    """RMS displacement of the marks of a typical run by an unexplained rate, mm, with the best start pose."""
    lasting_s = float(np.median([run.time_s[-1] - max(run.start_s, run.time_s[0]) for run in problem.data]))
    rate = np.radians(item.rms) * problem.half_distance_mm if item.quantity == "yaw_deg_s" else item.rms
    return float(rate * lasting_s * LAID_ON)


def _floor_mm(problem: Problem) -> float:
    return float(np.median(noise_floor(problem, range(len(problem.data)))))
