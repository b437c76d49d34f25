"""Nonlinear fit of one model: Gauss-Newton on the mixed model, relinearized by simulation until convergence.

A fit that does not converge is retried with shorter steps and then reported as not converged; it is never evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.inference.bounds import bounds
from evaluator.diagnosis.inference.descent.linearized_optimum import Optimum, optimum_of
from evaluator.diagnosis.inference.descent.steps import (
    DAMPINGS,
    SETTLED,
    full_step,
    line_search,
    obstructing_runs,
    settled_at,
)
from evaluator.diagnosis.inference.fit_cache import End, question_of
from evaluator.diagnosis.inference.fitted_model import Fit, model_columns, prior_precision
from evaluator.diagnosis.likelihood.linear.mixed_model import (
    MixedModel,
    Posterior,
    Reduced,
    reduce_runs,
    solve_within,
)
from evaluator.diagnosis.likelihood.linear.random_effects import MOST_SCATTER, secant
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.likelihood.run_data import Values
from simulator.effects.coordinates import Candidate

Floats = NDArray[np.float64]

MOST_STEPS = 10  # each a linearization of all runs; a fit ends when little is predicted of the next one (SETTLED)
# If a step fails below this predicted decrease, the cause is roughness or curvature of the density, not a wrong
# direction: over 26 runs, some of them turns on the spot, the density varied by 0.8 between nearly identical points;
# with two dozen quantities known to a tolerance, some determined to hundreds of sigmas together, 3.6 were predicted at
# the optimum. Decisions need seven and more.
STALLED = 5.0
# Mean square of whitened residuals below which a model explains the runs: the noise of slow modes is extrapolated from
# fast ones to some ten per cent, while the residuals of a wrong model are several times as large.
EXPLAINED = 1.5
# Excess of the mean square over noise, whose slow modes are extrapolated from fast ones to some ten per cent; a larger
# one is motion.
EXCESS = 1.12
# A predicted decrease is not attainable if it exceeds this share of the one before and requires implausible friction
# or gains of a run. In four experiments without any adequate model, 164 of 169 fits that stalled required such values,
# and one of 63 that converged.
NO_PROGRESS = 0.5
# Consecutive steps on open ground without improvement before a fit ends. There a robot that hardly overcomes the
# friction of its own turning follows one of two paths, and a per cent of a parameter decides which: the density jumps
# by tens everywhere, and a monotone search ends in a local minimum (of twelve fits of three models, four ended 50 to
# 100 above the others of their model; without monotonicity, none). Therefore a fit continues without improvement and
# returns the best point met. The decrease that the linearization there predicts is subtracted from the evidence, which
# is then the evidence of that point.
# Source: the watchdog technique, Chamberlain, Powell, Lemarechal & Pedersen (1982), Math. Program. Study 16, 1.
WATCHED = 3
# Log evidence below that of a model that explains the runs, beyond which a fit ends if a step does not halve the
# difference. Sets that matter for a verdict end within ten of one another.
LAGGING = 60.0
CLOSING = 0.5
# Share of the decrease that was predicted a step before. If corrected slopes predict more than this, the next step
# seldom improves: of 45 such steps of one diagnosis, 15 of 18 below it improved, and 8 of 27 above it.
CARRIES = 0.1


def fit_model(
    problem: Problem,
    start: Point,
    terms: Sequence[Candidate],
    tolerance: Mapping[str, float],
    runs: Sequence[int] | None = None,
    fixed: Values | None = None,
    most_scatter: tuple[float, ...] | None = None,
    held: Column | None = None,
    rival: float = -np.inf,
) -> Fit:
    """Fit terms together with all nuisance parameters, from a start that may contain values of these terms.

    fixed: values of terms that are not fitted, because they have no derivative. most_scatter: limit of the scatter of
    friction and gains during the steps, so that they do not absorb a misfit; the posterior has no such limit. held: a
    coordinate of a term that keeps its value at the start. rival: log evidence of a model that explains the runs; the
    fit ends early if it stays far below. A fit in the cache is linearized at its end without further steps.
    FloatingPointError if a run cannot be simulated; SearchStoppedError, or an error of the progress, if it is stopped.
    """
    chosen = tuple(range(len(problem.data))) if runs is None else tuple(runs)
    columns = tuple(column for column in model_columns(terms, tolerance, problem.given) if column != held)
    values = {term.id: start.terms.get(term.id, term.absent) for term in terms}
    begin = replace(start, terms={**(fixed or {}), **values})
    question = question_of(
        *(begin.per_run, begin.nominal, begin.terms, sorted(values), chosen, dict(tolerance), most_scatter),
        *(problem.horizon_s, [[astuple(noise) for noise in parts] for parts in problem.noise], problem.fingerprint),
        problem.friction_wander,
        held and (held.key, held.coordinate),
        round(rival) if np.isfinite(rival) else None,
    )
    if question not in problem.fits:
        try:
            fit = _fitted(problem, begin, columns, tolerance, chosen, np.array(most_scatter or np.inf), rival)
        except FloatingPointError:
            if terms:  # a run without which there is no model at all is left out; the cache does not know which
                problem.fits[question] = None
            raise
        problem.fits[question] = End(
            fit.point.per_run, fit.point.nominal, fit.point.terms, fit.converged, fit.steps, fit.shortfall
        )
        return fit
    end = problem.fits[question]
    if end is None:
        raise FloatingPointError("a run cannot be simulated on the way of this fit")
    point = Point(end.per_run, end.nominal, end.terms)
    seen = _viewed(problem, point, columns, tolerance, chosen)
    seen = replace(seen, converged=end.converged, steps=end.steps)
    return _with_shortfall(seen, end.shortfall)


def way_of_the_others(
    problem: Problem, fit: Fit, terms: Sequence[Candidate], tolerance: Mapping[str, float]
) -> tuple[tuple[int, ...], Point] | None:
    """The few runs that obstruct the steps of a fit that stalled, and the point to which the others lead.

    terms: those of the fit that have a derivative. None if it promises little or more than a few runs obstruct it.
    """
    if fit.shortfall < STALLED:
        return None
    optimum = _optimum(fit, tolerance, np.array(np.inf))
    obstructing = obstructing_runs(fit, optimum, full_step(problem, fit, optimum))
    if not obstructing:
        return None
    others = [run for run in fit.runs if run not in obstructing]
    fixed = {effect: fit.point.terms[effect] for effect in fit.terms - {term.id for term in terms}}
    try:
        return obstructing, fit_model(problem, fit.point, terms, tolerance, others, fixed).point
    except FloatingPointError:
        return None


def _viewed(
    problem: Problem,
    point: Point,
    columns: tuple[Column, ...],
    tolerance: Mapping[str, float],
    runs: tuple[int, ...],
) -> Fit:
    """The linearization of a model at a point, as a fit that has not converged."""
    linear = problem.linearized(point, columns, runs)
    reduced = reduce_runs(linear)
    prior = prior_precision(columns, tolerance)
    posterior = MixedModel(reduced, prior).posterior(range(len(columns)))
    posterior = _within_bounds(posterior, reduced, columns, tolerance)
    return Fit(
        *(frozenset(point.terms), point, columns, posterior, reduced, tuple(linear)),
        converged=False,
        runs=runs,
    )


def _within_bounds(
    posterior: Posterior, reduced: Reduced, columns: Sequence[Column], tolerance: Mapping[str, float]
) -> Posterior:
    """The posterior with evidence, scatter and misfit of the parameters within their bounds.

    A gain by values beyond them, such as a negative moment of scrub, is not evidence. Mean and covariance are kept.
    """
    prior = prior_precision(columns, tolerance)
    low, high = bounds(columns, tolerance)
    goal = solve_within(reduced, prior, posterior.scatter, low, high)
    held = (goal <= low) | (goal >= high)
    if not held.any():
        return posterior
    fixed = np.where(held, goal, 0.0)
    inside = MixedModel(reduced.of_columns(~held, fixed), prior[~held]).posterior(range(int((~held).sum())))
    effects = np.array([column.term is not None for column in columns])
    cost = np.sum(held & effects) * np.log(len(reduced.s)) + prior @ fixed**2
    evidence = inside.log_evidence - 0.5 * float(cost)
    return replace(posterior, log_evidence=evidence, scatter=inside.scatter, misfit=inside.misfit)


def _fitted(
    problem: Problem,
    point: Point,
    columns: tuple[Column, ...],
    tolerance: Mapping[str, float],
    runs: tuple[int, ...],
    most_scatter: Floats,
    rival: float,
    *,
    may_hold_back: bool = True,
) -> Fit:
    """Take steps from a point until the fit converges, does not improve, or lags too far behind a rival.

    may_hold_back: whether runs that obstruct it may be held back once.
    """
    before, lagged, of_others = np.inf, np.inf, 0
    ends: list[tuple[float, Fit]] = []  # on open ground: -2 log density at each point, and the fit if it ended there
    for step in range(MOST_STEPS):
        problem.watch.look()
        fit = replace(_viewed(problem, point, columns, tolerance, runs), steps=step + 1 + of_others)
        optimum = _optimum(fit, tolerance, most_scatter)
        if problem.open_ground:
            ends.append((float(optimum.now.sum()), _with_shortfall(replace(fit, converged=True), optimum.predicted)))
            least = int(np.argmin([value for value, _ in ends]))
            if optimum.predicted < SETTLED or step - least == WATCHED or step == MOST_STEPS - 1:
                return replace(ends[least][1], steps=step + 1)
            point, _ = line_search(problem, fit, optimum)
            continue
        if optimum.predicted < SETTLED:
            return replace(fit, converged=True)
        if optimum.predicted > NO_PROGRESS * before and np.any(np.abs(optimum.per_run) > MOST_SCATTER):
            return fit
        lag = rival - fit.posterior.log_evidence
        if lag > max(LAGGING, CLOSING * lagged):
            return fit
        before, lagged = optimum.predicted, lag
        full = None
        if may_hold_back and optimum.predicted > STALLED:
            full = full_step(problem, fit, optimum)
            obstructing = obstructing_runs(fit, optimum, full)
            moved, more = _led_by_others(problem, fit, optimum, tolerance, most_scatter, rival, obstructing)
            of_others, may_hold_back = more, not more
            if moved is not None:
                point, before, lagged = moved, np.inf, np.inf
                continue
        point, better = line_search(problem, fit, optimum, DAMPINGS, full)
        if not better:
            return _stalled(fit, optimum.predicted)
        point = _carried_on(problem, fit, optimum, point, tolerance, most_scatter)
    return _stalled(fit, optimum.predicted)


def _led_by_others(
    problem: Problem,
    fit: Fit,
    optimum: Optimum,
    tolerance: Mapping[str, float],
    most_scatter: Floats,
    rival: float,
    obstructing: Sequence[int],
) -> tuple[Point | None, int]:
    """A point that is better for all runs, found by a fit of those that do not obstruct a full step, and its steps.

    None and 0 if no runs obstruct it; None if the point is no better or a run cannot be simulated on the way.
    """
    if not obstructing:
        return None, 0
    others = tuple(run for run in fit.runs if run not in obstructing)
    try:
        ahead = _fitted(problem, fit.point, fit.columns, tolerance, others, most_scatter, rival, may_hold_back=False)
    except FloatingPointError:
        return None, 1
    return settled_at(problem, fit, optimum, ahead.point), ahead.steps


def _stalled(fit: Fit, predicted: float) -> Fit:
    """The end of a fit that no step improves: converged if little was predicted, or if the model explains the runs.

    Such a model is as good as its point, not as good as its linearization predicts: the rest counts against it. Without
    this, friction with a grain of 0.16 ended as not converged for a predicted decrease of 5.3, while its residuals were
    noise and those of all other models a hundred times as large; and so did a stray magnet that one run of 22 passes
    at 0.4 mm, of which a linearization promises more than any step brings. If as much is promised as separates sets
    that matter, the residuals must be noise, with friction and gains that runs may have.
    """
    if predicted < STALLED:
        return replace(fit, converged=True)
    explains = fit.excess < EXPLAINED if predicted < LAGGING else fit.excess < EXCESS and not fit.overreaches
    if explains:
        return _with_shortfall(replace(fit, converged=True), predicted)
    return fit


def _carried_on(
    problem: Problem, fit: Fit, optimum: Optimum, point: Point, tolerance: Mapping[str, float], most_scatter: Floats
) -> Point:
    """Further steps from the point of a line search, with slopes that are corrected by secants instead of recomputed.

    New slopes cost as much as a dozen such steps, and are computed afterwards in any case to test convergence.
    """
    sizes = np.concatenate([[column.step for column in fit.columns], problem.per_run_steps])
    while True:
        found = problem.seen_again(point, fit.linearized, fit.runs, fit.columns)
        theta = [np.array([at.value(column) for column in fit.columns]) for at in (fit.point, point)]
        views = tuple(
            secant(
                before,
                after,
                np.concatenate([theta[0], fit.point.per_run[run]]),
                np.concatenate([theta[1], point.per_run[run]]),
                sizes,
            )
            for run, before, after in zip(fit.runs, fit.linearized, found, strict=True)
            if after is not None
        )
        if len(views) < len(fit.runs):
            return point
        fit = replace(fit, point=point, linearized=views, reduced=reduce_runs(views))
        promised, optimum = optimum.predicted, _optimum(fit, tolerance, most_scatter)
        if not SETTLED < optimum.predicted < CARRIES * promised:
            return point
        moved, better = line_search(problem, fit, optimum, DAMPINGS[:1])
        if not better:
            return point
        point = moved


def _optimum(fit: Fit, tolerance: Mapping[str, float], most_scatter: Floats) -> Optimum:
    theta = np.array([fit.point.value(column) for column in fit.columns])
    per_run, scatter = fit.point.per_run[list(fit.runs), 3:], np.minimum(fit.posterior.scatter, most_scatter)
    prior, within = prior_precision(fit.columns, tolerance), bounds(fit.columns, tolerance)
    return optimum_of(fit.linearized, fit.reduced, theta, per_run, prior, scatter, within)


def _with_shortfall(fit: Fit, predicted: float) -> Fit:
    predicted = max(predicted, 0.0)  # near a bound of a law, rounding errors may be large and negative
    less = replace(fit.posterior, log_evidence=fit.posterior.log_evidence - predicted / 2)
    return replace(fit, posterior=less, shortfall=predicted)
