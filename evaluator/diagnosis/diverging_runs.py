"""Runs whose motion diverges: a tiny change of a value that is known to some per cent turns it into another one.

Such a run follows a path that friction along and across its wheels nearly balances, and a neighbouring path leaves it
exponentially. Within the tolerances of the values its motion cannot be predicted, however right the model is, so that
no linear view of it holds: its residuals would be explained by any effect that bends its path.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from evaluator.diagnosis.assessment.sufficiency import most_odd
from evaluator.diagnosis.experiment import shortcomings
from evaluator.diagnosis.inference.fit import EXPLAINED
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.jumps import BENT
from evaluator.diagnosis.likelihood.problem import Problem

# Share by which the slopes of a run change within one step of all values; a step of a friction is a hundredth of its
# usual tolerance. Of the runs of five experiments two turns reached 0.9 and 1.3, on a plate with a grain; the others
# were below 0.3.
DIVERGES = 0.5
# Misfit of a run over the median of all from which it stands out where no model explains the runs: a robot that a
# magnet had captured in one run, and not in the model, had 85 times the median, the others at most 1.4 times.
STANDS_OUT = 10.0
DIVERGING = (
    "its motion diverges: a change of friction far below its tolerance leads to another path, so that the run shows "
    "nothing about the model"
)


def diverging_runs(search: Search) -> list[int]:
    """Indices of the runs of an experiment that diverge at the best fit of a search.

    If that does not explain the runs, they diverge only if they obstruct it: their misfit stands out, and they are no
    more than go wrong by themselves. None on open ground, whose noise contains what such runs scatter, or if the other
    runs would not suffice.
    """
    problem, best = search.problem, search.fits[search.ranked()[0]]
    if problem.open_ground:
        return []
    count = most = len(problem.data)
    runs: Sequence[int] = range(count)
    if not best.converged or best.excess >= EXPLAINED:
        best = search.initial(1)[0]
        squares, freedom = best.misfits
        misfit = squares / freedom
        runs, most = [best.runs[k] for k in np.flatnonzero(misfit > STANDS_OUT * np.median(misfit))], most_odd(count)
    found = _diverging_at(problem, best, runs)
    others = [data for run, data in enumerate(problem.data) if run not in found]
    return [] if len(found) > most or shortcomings(others) else found


def _diverging_at(problem: Problem, fit: Fit, runs: Sequence[int]) -> list[int]:
    """Those of some runs that diverge at the point of a fit."""
    point, columns = fit.point, fit.columns
    both = [
        column
        for column in columns
        if column.has_two_sides
        and all(point.moved(column, way * column.step).is_within_bounds(column) for way in (-1, 1))
    ]
    places = point.beside(both, 1), point, point.beside(both, -1)
    found = []
    for run, view in zip(runs, problem.attempted(point, (), runs), strict=True):
        ahead, here, behind = problem.features([place.task(run) for place in places])
        if view is None or not np.isfinite([*ahead, *behind]).all():
            continue
        basis = np.linalg.qr(view.start)[0]
        first, second = (
            float(np.linalg.norm(part - basis @ (basis.T @ part)))
            for part in ((ahead - behind) / 2, ahead + behind - 2 * here)
        )
        if second > max(BENT, DIVERGES * first):
            found.append(run)
    return found
