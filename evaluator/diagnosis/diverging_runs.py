"""Runs whose motion diverges: a tiny change of a value that is known to some per cent turns it into another one.

Such a run follows a path that friction along and across its wheels nearly balances, and a neighbouring path leaves it
exponentially. Within the tolerances of the values its motion cannot be predicted, however right the model is, so that
no linear view of it holds: its residuals would be explained by any effect that bends its path.
"""

from __future__ import annotations

import numpy as np

from evaluator.diagnosis.experiment import shortcomings
from evaluator.diagnosis.inference.fit import EXPLAINED
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.jumps import BENT

# Share by which the slopes of a run change within one step of all values; a step of a friction is a hundredth of its
# usual tolerance. Of the runs of five experiments two turns reached 0.9 and 1.3, on a plate with a grain; the others
# were below 0.3.
DIVERGES = 0.5
DIVERGING = (
    "its motion diverges: a change of friction far below its tolerance leads to another path, so that the run shows "
    "nothing about the model"
)


def diverging_runs(search: Search) -> list[int]:
    """Indices of the runs of an experiment that diverge at the best fit of a search.

    None on open ground, whose noise contains what such runs scatter; none if the best model does not explain the runs,
    or if the other runs would not suffice.
    """
    problem, best = search.problem, search.fits[search.ranked()[0]]
    if problem.open_ground or not best.converged or best.excess >= EXPLAINED:
        return []
    point, columns = best.point, best.columns
    both = [
        column
        for column in columns
        if column.has_two_sides
        and all(point.moved(column, way * column.step).is_within_bounds(column) for way in (-1, 1))
    ]
    places = point.beside(both, 1), point, point.beside(both, -1)
    found = []
    runs = range(len(problem.data))
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
    others = [data for run, data in enumerate(problem.data) if run not in found]
    return [] if shortcomings(others) else found
