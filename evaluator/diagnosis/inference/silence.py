"""Coordinates of which no run says anything where a fit ended: a limit of speed that no command exceeds.

Their slopes are nought there, so that a linear view gives them any value. What the runs do say is how far such a
coordinate may go before one of them moves otherwise.
"""

from __future__ import annotations

import math

import numpy as np

from evaluator.diagnosis.inference.fit import Fit
from evaluator.diagnosis.likelihood.problem import Column, Problem

HALVINGS = 6  # of the last doubled step: a reach is good to about a hundredth
MOST_DOUBLINGS = 40  # from a fifth of a visible step: beyond, no robot has such a value


def silent_reaches(problem: Problem, fit: Fit) -> dict[int, float]:
    """How far above its value each silent coordinate of a fit may go before any run shows it, by number of column.

    Infinity where none ever shows it.
    """
    silent = [i for i in range(len(fit.columns)) if not any(view.common[:, i].any() for view in fit.linearized)]
    return {i: _reach(problem, fit, fit.columns[i]) for i in silent if fit.columns[i].term is not None}


def _reach(problem: Problem, fit: Fit, column: Column) -> float:
    here = problem.features([fit.point.task(run) for run in fit.runs])

    def shown(amount: float) -> bool:
        moved = fit.point.moved(column, amount)
        there = problem.features([moved.task(run) for run in fit.runs])
        return not all(map(np.array_equal, here, there))

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
