"""Coordinates that no run informs at the fitted values, such as a speed limit that no command exceeds.

Their slopes are nought there, so that a linear view gives them any value. What the runs do say is how far such a
coordinate may go before they are worse followed than chance allows, all else as it is.
"""

from __future__ import annotations

import math

from evaluator.diagnosis.inference.fit import Fit
from evaluator.diagnosis.likelihood.problem import Column, Point, Problem
from evaluator.turning.motion.curvature import Z_975

HALVINGS = 6  # of the last doubled step: a reach is good to about a hundredth
WORSE = Z_975**2  # of -2 log density, at the end of a 95 % interval
MOST_DOUBLINGS = 40  # from a fifth of a visible step: beyond, no robot has such a value


def silent_reaches(problem: Problem, fit: Fit) -> dict[int, float]:
    """How far above its value each silent coordinate of a fit may go within 95 %, by number of column.

    Infinity where no run ever shows it.
    """
    silent = [i for i in range(len(fit.columns)) if not any(view.common[:, i].any() for view in fit.linearized)]
    return {i: _reach(problem, fit, fit.columns[i]) for i in silent if fit.columns[i].term is not None}


def _reach(problem: Problem, fit: Fit, column: Column) -> float:
    def square(point: Point) -> float:
        return float(sum(part @ part for part in problem.features([point.task(run) for run in fit.runs])))

    here = square(fit.point)

    def shown(amount: float) -> bool:
        there = square(fit.point.moved(column, amount))
        return not there <= here + WORSE  # a run that cannot be simulated shows it, too

    amount = column.step
    for _ in range(MOST_DOUBLINGS):
        if shown(amount):
            break
        amount *= 2
    else:
        return math.inf
    low, high = amount / 2, amount
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if shown(middle) else (middle, high)
    return low
