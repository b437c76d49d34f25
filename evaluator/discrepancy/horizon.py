"""Large misfits: the first seconds of every run are fitted before the whole of it.

A heading that errs by θ turns every later step, so over a whole run a large effect is far from linear and a fit from the
nominal model fails or ends in a false minimum. Over a short horizon the same effect is nearly linear. What fits there
is a start for a longer horizon, up to the whole run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from evaluator.discrepancy.fit import Fit
from evaluator.discrepancy.problem import Point, Problem, with_noise_of
from evaluator.discrepancy.search import Search, run_search

HORIZONS_S = (1.0, 2.5)
# Misfit of heading, rad, from which on a linear view errs by more than a tenth: the whole run is then not a place to
# begin. Below it the fits of development experiments converged from the nominal model.
LARGE_MISFIT_RAD = 0.2
KEPT = 4  # sets that go on to the next horizon

Progress = Callable[[str, float], None]


def misfit_rad(problem: Problem, point: Point) -> float:
    """Largest misfit of the direction of the marks over all runs, as an RMS over each run, rad."""
    residuals = problem.residuals([point.task(run) for run in range(len(problem.data))])
    return max(float(np.sqrt(np.nanmean(item[:, 2] ** 2))) for item in residuals) / problem.half_distance_mm


def short_horizon_fits(whole: Search, start: Point, progress: Progress) -> list[Fit]:
    """Fits of the sets that explain the first seconds of the runs best, the best first; start: nominal point."""
    kept: list[Fit] = []
    point = start
    for horizon_s in HORIZONS_S:
        short = with_noise_of(replace(whole.problem, horizon_s=horizon_s), point)
        search = Search(short, whole.terms, whole.tolerance, whole.runs)
        run_search(search, start, progress, kept)
        kept = [search.fits[ids] for ids in search.ranked()[:KEPT]]
        point = kept[0].point
    return kept
