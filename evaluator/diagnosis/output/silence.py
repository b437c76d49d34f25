"""Coordinates that no run informs at the fitted values, such as a speed limit that no command exceeds.

Their derivatives are 0, or only rounding beside a limit that acts, so that linearization leaves them undetermined. But
the runs limit such a coordinate: at some value, with all else unchanged, the misfit becomes significantly larger.
"""

from __future__ import annotations

import math

from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.turning.motion.curvature import Z_975

HALVINGS = 6  # bisections of the last doubled step, which determine a limit to about 1 %
WORSE = Z_975**2  # increase of -2 log density at the end of a 95 % interval
# Share of that increase which the derivative predicts there, up to which it says nothing of the coordinate.
HARDLY = 0.01
MOST_DOUBLINGS = 40  # from a fifth of a visible step, up to impossible values


def silent_reaches(problem: Problem, fit: Fit) -> dict[int, float]:
    """Distance from its value to its upper 95 % limit for each undetermined coordinate of a fit, by column.

    Infinite if no run limits it.
    """
    found = {}
    for i, column in enumerate(fit.columns):
        square = sum(float(view.common[:, i] @ view.common[:, i]) for view in fit.linearized)
        if column.term is None or (square and not column.term.coordinates[column.coordinate].closed):
            continue
        reach = _reach(problem, fit, column)
        if not square or square * reach**2 < HARDLY * WORSE:
            found[i] = reach
    return found


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
