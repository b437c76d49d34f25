"""Large misfits: the first seconds of every run are fitted before the whole of it.

An error θ of the heading rotates every later step, so that over a whole run the response to a large effect is
nonlinear, and a fit from the nominal model fails or ends in a wrong minimum. Over a short horizon the response is
nearly linear. Its fit is the initial value for a longer horizon, up to the whole run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.inference.strategy import run_search
from evaluator.diagnosis.likelihood.linear.mixed_model import USUAL_SCATTER
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.preparation import within_horizon
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.likelihood.run_data import START_POSE
from evaluator.progress import Progress

# Beginnings of the runs that are fitted before the whole of them. Errors of the heading grow with time at most in
# proportion: what the fit of the first second leaves has grown by the factor of 2.5 at the end of the next.
HORIZONS_S = (1.0, 2.5)
RECALIBRATION_S = (1.0, 2.0, 4.0)  # doubled, so that the error of the heading grows little from one to the next
# Factor from the last horizon to the longest run, beyond which horizons follow in between. From 2.5 s to runs of 8 s
# fits converged; to 18 s, the fit of a friction grain, right so far, ended with friction and gains of runs at a bound.
LARGEST_LEAP = 4.0
# Misfit of the nominal model in one run, RMS, from which on the whole run is no place to begin: a linear view errs by
# about the square of the angle, and of the misplacement over the ten to twenty millimetres that a run covers, which
# is then many times the tracking noise (of the paper's robot; in proportion of others). Below it the fits of
# development experiments converged from the nominal model.
LARGE_TURN_RAD, LARGE_SHIFT_MM = 0.1, 1.0
MOST_STEPS = 70  # of the fits of one horizon, as in a search: every single effect once, the promising ones in full
# Friction or gains of one run, in the usual scatter: friction 30 %, a wheel 6 %, a start by ten half frames. Runs that
# scatter three times as much as usual have such a one in a thousand; a model that is wrong has them in most.
BEYOND_CHANCE = 10.0
# Sets that are continued to the next horizon. Fits that did not converge are among them: where a run needs implausible
# friction, that of the true set is often one, and sets that converged because they explain less displaced it.
CARRIED_ON = 4


def is_large(problem: Problem, point: Point) -> bool:
    """Whether the misfit of some run is so large that a search should begin with short horizons."""
    residuals = problem.residuals([point.task(run) for run in range(len(problem.data))])
    misfit = np.array([np.sqrt(np.nanmean(item**2, axis=0)) for item in residuals])
    turn, shift = misfit[:, 2] / problem.half_distance_mm, np.hypot(misfit[:, 0], misfit[:, 1])
    return bool(np.any(turn > LARGE_TURN_RAD) or np.any(shift > problem.length * LARGE_SHIFT_MM))


def is_implausible(point: Point) -> bool:
    """Whether some run has implausible friction or gains, which conceal the misfit of the model."""
    return bool(np.any(np.abs(point.per_run[:, START_POSE:]) > BEYOND_CHANCE * np.array(USUAL_SCATTER)))


def within(problem: Problem, horizons_s: Sequence[float]) -> list[float]:
    """The horizons shorter than the longest run, continued by their last factor where that is much longer."""
    longest_s = max(run.time_s[-1] - max(run.start_s, run.time_s[0]) for run in problem.data)
    found = list(horizons_s)
    while longest_s > LARGEST_LEAP * found[-1]:
        found.append(found[-1] * found[-1] / found[-2])
    return [horizon_s for horizon_s in found if horizon_s < longest_s]


def recalibrated(problem: Problem, start: Point, tolerance: Mapping[str, float]) -> Point:
    """Fit the model without effects to increasing horizons, from a start too far for a fit to whole runs.

    If the fit of a horizon does not converge, its last point is still better than the start.
    """
    point = start
    for horizon_s in within(problem, RECALIBRATION_S):
        short = within_horizon(problem, point, horizon_s)
        try:
            point = fit_model(short, point, [], tolerance, most_scatter=USUAL_SCATTER).point
        except FloatingPointError:
            break
    return point


def short_horizon_fits(whole: Search, start: Point, progress: Progress) -> list[Fit]:
    """Fits of the sets that explain the first seconds of the runs best, best first; start: nominal point."""
    best: list[Fit] = []
    for horizon_s in within(whole.problem, HORIZONS_S):
        short = _extended(whole.problem, [fit.point for fit in best] or [start], horizon_s)
        if short is None:
            break
        search = whole.anew(problem=short, most_steps=MOST_STEPS)
        run_search(search, start, start, progress, best)
        best = search.initial(CARRIED_ON)
    return best


def _extended(problem: Problem, points: Sequence[Point], horizon_s: float) -> Problem | None:
    """The problem within a horizon, with the noise at the first point from which all runs can be simulated that far.

    A model that was fitted to the first second may lead a run into a motion that cannot be simulated in the next.
    """
    for point in points:
        try:
            return within_horizon(problem, point, horizon_s)
        except FloatingPointError:
            continue
    return None
