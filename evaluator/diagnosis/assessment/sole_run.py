"""Whether a finding rests on a single run, and is therefore a property of that run and not of the robot.

Physics of a robot shows in every run that it acts on, more or less. One run that was mixed up, pushed or driven on
another plate can bring more evidence than all others together, and a set of effects may imitate it. So the evidence of
each effect is counted again with each run left out: common parameters and scatter from the others, in the linear views
of the fits, which are there already.

Nothing is wrong with a run that what the others say of the robot follows as well. They say it to within their errors,
which may move the marks by more than noise does in a drive that none of them has: a run is followed where a robot
within what they leave open follows it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import special

from evaluator.diagnosis.assessment.adequacy import LEAST_TOLD, Adequacy
from evaluator.diagnosis.assessment.gap import farthest_followed, run_gaps
from evaluator.diagnosis.assessment.knowledge import TOLD
from evaluator.diagnosis.assessment.model_comparison import Set, score
from evaluator.diagnosis.assessment.verdict import EXCESS, KEEP, NOT_CHANCE, least_gain
from evaluator.diagnosis.inference.bounds import bounds
from evaluator.diagnosis.inference.fit import Fit, prior_precision
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.linear.mixed_model import MixedModel, Reduced, at_scatter, reduce_runs
from evaluator.diagnosis.likelihood.linear.random_effects import place_runs
from evaluator.diagnosis.likelihood.problem import Point, Problem

Floats = NDArray[np.float64]

# Runs that are left out in turn: those in which the two models differ most in what they leave over. The one on which
# all rests is the first of them, but for what common parameters make of it.
TRIED = 3
FEWEST_RUNS = 4  # three that agree, to say that one does not
MEAN_SPREAD = (np.mean, partial(np.std, ddof=1))


@dataclass(frozen=True)
class SoleRun:
    """A run (its number in the session) without which effects would not have been named."""

    run: int
    gain: float  # log odds of the effects from all runs
    without: float  # and from all but this


def sole_run(search: Search, ids: Set, families: int) -> SoleRun | None:
    """The run on which a set of effects, or one of them, rests alone; None where there is no such run.

    Without the run the odds are less than an effect must earn, and the run by itself brings as much: a weak effect,
    which needs all its runs, is not owed to the one that shows it best.
    """
    full = search.fits[ids]
    least = least_gain(ids)
    found: list[SoleRun] = []
    for rest in dict.fromkeys([frozenset[str](), *(ids - {effect} for effect in sorted(ids))]):
        less = search.fits.get(rest)
        if rest == ids or less is None or less.runs != full.runs:
            continue
        gain = score(search, ids, families) - score(search, rest, families)
        whole = _evidence(search, full) - _evidence(search, less)
        for k in np.argsort(_misfits(full) - _misfits(less))[:TRIED]:
            brought = whole - (_evidence(search, full, int(k)) - _evidence(search, less, int(k)))
            if gain - brought < least and brought > KEEP[1]:
                found.append(SoleRun(full.runs[int(k)], gain, gain - brought))
    return min(found, key=lambda item: item.without - item.gain, default=None)


def sole_misfit(left: Adequacy, runs: tuple[int, ...]) -> int | None:
    """The run but for which a model leaves no more than noise; None where no run is left over, or more than one."""
    worst = int(np.argmax(left.by_run))
    others = np.delete(left.by_run, worst)
    return runs[worst] if left.excess > EXCESS >= float(others.mean()) else None


def sole_gains(left: Adequacy, runs: tuple[int, ...], least_percent: float) -> int | None:
    """The run whose wheel speeds differ from those of all others by more than chance; None where there is no such run.

    One run that drove another command gives all runs a scatter in which anything may hide. least_percent: of what its
    wheel speeds differ by; less explains nothing, and the verdict without an innocent run is another one.

    A gain is drawn towards nought by what its run does not tell, and spreads by the root of the share that it tells: by
    these roots all are divided, or the runs that tell most would look unlike the others.
    Source: Grubbs (1950), Ann. Math. Stat. 21, 27: each run against the others, Bonferroni over runs and sides.
    """
    from scipy import stats

    gains, told = left.random_effects[:, 1:3], left.told[:, 1:3]
    if len(gains) < FEWEST_RUNS or not gains.any(axis=0).all():
        return None
    count = len(gains)
    alike = np.where(told > LEAST_TOLD, gains / np.sqrt(np.maximum(told, LEAST_TOLD)), 0.0)
    means, spreads = (np.array([of(np.delete(alike, k, axis=0), axis=0) for k in range(count)]) for of in MEAN_SPREAD)
    apart = np.abs(alike - means) / np.maximum(spreads, 1e-300) / np.sqrt(1 + 1 / (count - 1))
    worst, side = np.unravel_index(int(np.argmax(apart)), apart.shape)
    p = 2 * gains.size * stats.t.sf(apart[worst, side], count - 2)
    off_percent = 100 * abs(gains[worst, side] - np.delete(gains[:, side], worst).mean())
    return runs[int(worst)] if p < NOT_CHANCE and off_percent > least_percent else None


def _evidence(search: Search, fit: Fit, but: int | None = None) -> float:
    """Log evidence of a fitted model in its linear view, from all its runs but one."""
    reduced = fit.reduced if but is None else _without(fit.reduced, but)
    model = MixedModel(reduced, prior_precision(fit.columns, search.tolerance))
    return model.log_evidence(range(len(fit.columns)))


def _without(reduced: Reduced, k: int) -> Reduced:
    """The inner products of all runs but one."""
    return Reduced(*(np.delete(getattr(reduced, item.name), k, axis=0) for item in fields(reduced)))


def _misfits(fit: Fit) -> Floats:
    """What a fit leaves over of each run, -2 log, with its random effects within the scatter, (n,)."""
    reduced, tau = fit.reduced, fit.posterior.scatter
    theta = np.array([fit.point.value(column) for column in fit.columns])
    square = reduced.s - 2 * reduced.g @ theta + np.einsum("p,npq,q->n", theta, reduced.G, theta)
    slope = reduced.c - reduced.C @ theta
    per_run = np.linalg.inv(reduced.A + np.diag(tau**-2.0))
    return np.asarray(square - np.einsum("ni,nij,nj->n", slope, per_run, slope))


def is_followed(problem: Problem, fit: Fit, per_run: Floats, run: int, tolerance: Mapping[str, float]) -> bool:
    """Whether a fit of other runs follows a run to within noise, wandering friction and the errors of that fit.

    per_run: numbers per run (n, 7) of all runs of the problem, near which the run is placed.
    """
    try:
        placed = place_runs(problem.of_tracking, replace(fit.point, per_run=per_run), [run], fit.posterior.scatter)
        if _is_near(problem, placed, run):
            return True
        moved = _updated(problem, fit, placed, run, tolerance)
        if moved is None:
            return False
        return _is_near(problem, place_runs(problem.of_tracking, moved, [run], fit.posterior.scatter), run)
    except FloatingPointError:
        return False


def _is_near(problem: Problem, placed: Point, run: int) -> bool:
    return bool((run_gaps(problem, placed, [run]) <= farthest_followed(problem, [run])).all())


def _updated(problem: Problem, fit: Fit, placed: Point, run: int, tolerance: Mapping[str, float]) -> Point | None:
    """The point with the common parameters that a run and those of a fit make most probable together, linearly.

    None where the run wants them farther from those of the fit than chance allows.
    """
    theta = np.array([placed.value(column) for column in fit.columns])
    _, g, G = at_scatter(reduce_runs(problem.linearized(placed, fit.columns, [run])), fit.posterior.scatter)
    variances, vectors = np.linalg.eigh(fit.posterior.covariance)
    root = vectors * np.sqrt(np.maximum(variances, 0.0))
    told, axes = np.linalg.eigh(root.T @ G[0] @ root)
    ways = root @ axes  # independent of one another in the fit, where each is known to 1, and in the run
    step = ways.T @ (g[0] - G[0] @ theta) / (1 + told)
    share = told / (1 + told)
    counts = share > TOLD
    if special.chdtrc(int(counts.sum()), float(np.sum(step[counts] ** 2 / share[counts]))) < NOT_CHANCE:
        return None
    return placed.at(fit.columns, np.clip(theta + ways @ step, *bounds(fit.columns, tolerance)))
