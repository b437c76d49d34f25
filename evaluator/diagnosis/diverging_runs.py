"""Runs whose motion diverges: a tiny change of a value that is known to some per cent turns it into another one.

Such a run follows a path that friction along and across its wheels nearly balances, and a neighbouring path leaves it
exponentially. Within the tolerances of the values its motion cannot be predicted, however right the model is, so that
no linear view of it holds: its residuals would be explained by any effect that bends its path.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.model_comparison import is_free
from evaluator.diagnosis.assessment.sufficiency import most_odd
from evaluator.diagnosis.experiment import shortcomings
from evaluator.diagnosis.inference.fit import EXPLAINED, way_of_the_others
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.jumps import BENT
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.mistakes.outlying import has_similar_runs

Floats = NDArray[np.float64]

# Share by which the slopes of a run change within one step of all values that any model has; a step of a friction is a
# hundredth of its usual tolerance. Of the runs of five experiments two turns reached 0.9 and 1.3, on a plate with a
# grain; the others were below 0.3.
DIVERGES = 0.5
# Misfit of a run over the median of all from which it stands out where no model explains the runs: a robot that a
# magnet had captured in one run, and not in the model, had 85 times the median, the others at most 1.4 times.
STANDS_OUT = 10.0
# Fits at which runs are suspected: where none converges, a run is on its other path at some of them, but not at all.
TRIED = 3
# Halvings of the way between two points of the parameters, and the share of the change of a run's motion over the whole
# way from which it changes by so much within the last part. Where a robot of a log has two turns to choose from, the
# shares were 0.9 to 1.0, and 0.01 to 0.33 of ten other parts, five of which obstructed a fit as well.
HALVINGS, JUMPS = 6, 0.5
DIVERGING = (
    "its motion diverges: a change of friction, or of another value of the model, far below what is known of it leads "
    "to another path, so that the run shows nothing about the model"
)


def diverging_runs(search: Search) -> list[int]:
    """Indices of the runs of an experiment that diverge at the best fit of a search.

    If that does not explain the runs, they diverge only if they obstruct it: their misfit stands out, and they are no
    more than go wrong by themselves. So it is on open ground, where no fit explains more than its noise. None if the
    other runs would not suffice.
    """
    problem, best = search.problem, search.fits[search.ranked()[0]]
    count = most = len(problem.data)
    runs: Sequence[int] = range(count)
    if problem.open_ground or not best.converged or best.excess >= EXPLAINED:
        best = search.initial(1)[0]
        squares, freedom = best.misfits
        misfit = squares / freedom
        runs, most = [best.runs[k] for k in np.flatnonzero(misfit > STANDS_OUT * np.median(misfit))], most_odd(count)
    found = _diverging_at(problem, best.point, best.columns, runs)
    return [] if len(found) > most or not _suffice_without(problem, found) else found


def diverging_beyond(search: Search, seeds: Sequence[Fit]) -> list[int]:
    """Indices of the runs that diverge after the first seconds, at a fit that explains these.

    seeds: fits of the first seconds. No fit of the whole runs may converge beside such a run: in a turn on the spot of
    16 s on a plate with a grain, a hundredth of a step raised the misfit a thousandfold, and the right model, which
    had been found, was not fitted until the time was over. None on open ground, or if more than half of the runs
    diverge, or too few are left.
    """
    problem = search.problem
    every = range(len(problem.data))
    explaining = [fit for fit in seeds if fit.converged and fit.excess < EXPLAINED and not problem.open_ground]
    found = sorted({run for fit in explaining for run in _diverging_at(problem, fit.point, fit.columns, every)})
    return found if 2 * len(found) <= len(every) and _suffice_without(problem, found) else []


def suspected_runs(search: Search) -> list[int]:
    """Indices of the runs that may diverge and keep every model of a search from explaining the others.

    They diverge at one of the most probable fits, or there with the nominal friction of each run; so do all runs of a
    similar command, as two of the same pivot. Fits do not converge beside them, so that their misfit tells nothing.
    Whether they are the cause, a search without them shows. None if a fit explains the runs, on open ground, or if more
    than half of the runs are suspected, or too few are left.
    """
    problem = search.problem
    if problem.open_ground or search.explained > -np.inf:
        return []
    data = problem.data
    found: set[int] = set()
    for fit in search.initial(TRIED):
        for point in (fit.point, fit.point.without_scatter()):
            found.update(_diverging_at(problem, point, fit.columns, range(len(data))))
    found |= {k for k in range(len(data)) if any(has_similar_runs(data[k], [data[run]]) for run in found)}
    return sorted(found) if 2 * len(found) <= len(data) and _suffice_without(problem, found) else []


def jumping_runs(search: Search) -> list[int]:
    """Indices of the runs that keep a fit from where the others lead it, because their motion jumps on the way there.

    A robot that has two turns to choose from takes one or the other by a change of a thousandth, and a part of a
    recording that takes the other one outweighs all that the others tell: one of 36 parts kept a drag, which explains
    the others to their noise, at nothing. None if more than half of the runs jump, or too few are left.
    """
    problem = search.problem
    found: set[int] = set()
    fits = search.initial(len(search.fits) + len(search.failed))
    named = [fit for fit in fits[TRIED:] if not any(map(is_free, fit.terms))][:1]  # free-form terms bend with a turn
    for fit in fits[:TRIED] + named:
        smooth = [search.terms[effect] for effect in sorted(fit.terms) if not search.terms[effect].stepwise]
        led = way_of_the_others(problem, fit, smooth, search.tolerance)
        if led is not None:
            found.update(run for run in led[0] if _jumps(problem, fit, led[1], run))
    return sorted(found) if 2 * len(found) <= len(problem.data) and _suffice_without(problem, found) else []


def _jumps(problem: Problem, fit: Fit, there: Point, run: int) -> bool:
    """Whether the motion of a run changes by JUMPS of its whole change within a small part of the way to a point."""
    start = fit.linearized[fit.runs.index(run)].start
    basis = np.linalg.qr(start)[0]
    here, goal = (np.array([point.value(column) for column in fit.columns]) for point in (fit.point, there))

    def seen(share: float) -> Floats:
        (found,) = problem.features([fit.point.at(fit.columns, here + share * (goal - here)).task(run)])
        return np.asarray(found - basis @ (basis.T @ found))

    begin, end = 0.0, 1.0
    before, after = seen(begin), seen(end)
    whole = change = float(np.linalg.norm(after - before))
    for _ in range(HALVINGS):
        share = (begin + end) / 2
        middle = seen(share)
        first, second = (float(np.linalg.norm(middle - side)) for side in (before, after))
        if first > second:
            end, after, change = share, middle, first
        else:
            begin, before, change = share, middle, second
    return whole > BENT and change > JUMPS * whole


def _suffice_without(problem: Problem, runs: Collection[int]) -> bool:
    """Whether the runs of an experiment suffice without some of them."""
    return not shortcomings([data for run, data in enumerate(problem.data) if run not in runs])


def _diverging_at(problem: Problem, point: Point, columns: Sequence[Column], runs: Sequence[int]) -> list[int]:
    """Those of some runs that diverge at a point of a fit with these columns.

    By values that any model has: how a run bends with the size of an effect is a matter of its form, as close to a
    stray magnet that is not there.
    """
    both = [column for column in columns if column.term is None and column.has_two_sides]
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
