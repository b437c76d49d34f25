"""Findings that depend on a single run, and are therefore a property of that run instead of the robot.

Physics of the robot shows in every run that it acts on. One run that was mixed up, pushed or driven on another plate
can contribute more evidence than all others together, and a set of effects may imitate it. Therefore the evidence of
each effect is computed again without each run, with common parameters and scatter from the others, in the existing
linearizations of the fits.

A run is valid if a model fitted to the other runs explains it. The errors of that model may move the marks by more than
noise, in particular for a command that no other run has: a run counts as explained if a model within these errors
explains it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import special

from evaluator.diagnosis.assessment.adequacy import LEAST_SHARE, Adequacy
from evaluator.diagnosis.assessment.gap import farthest_followed, run_gaps
from evaluator.diagnosis.assessment.knowledge import DETERMINED
from evaluator.diagnosis.assessment.model_comparison import Set, evidence_of_runs, is_free, score
from evaluator.diagnosis.assessment.verdict import KEEP, NOT_CHANCE, least_gain
from evaluator.diagnosis.inference.bounds import bounds
from evaluator.diagnosis.inference.fit import EXCESS
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.linear.mixed_model import USUAL_SCATTER, at_scatter, reduce_runs
from evaluator.diagnosis.likelihood.linear.random_effects import place_runs
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.problem import Problem

Floats = NDArray[np.float64]

# Number of runs that are left out in turn: those in which the residuals of the two models differ most. The decisive run
# is usually the first of them.
TRIED = 3
FEWEST_RUNS = 4  # three that agree are needed to show that one does not
# Factor by which one run widens the scatter of the wheel speeds of all, from which it hides effects: an effect must
# then be three times as large to be found. The farthest of eight runs with normal scatter widens it by 1.3, of 24 runs
# by 1.1. Its difference must also be this many times what matters, 1 % by default, as motors differ by some tenths.
HIDES, PLAIN = 3.0, 10.0
# Number of values with the usual scatter that what is known of wheel speeds is worth. Beside five runs that agree, a
# speed that is 7 % off, 16 times their scatter, may be chance with a probability of one in a thousand without it.
AS_USUAL = 4
MEAN_SPREAD = (np.mean, partial(np.std, ddof=1))


@dataclass(frozen=True)
class SoleRun:
    """A run (index in the session) without which effects would not have been found."""

    run: int
    effects: Set
    gain: float  # log odds of the effects from all runs
    without: float  # and from all but this


def sole_run(search: Search, ids: Set, families: int) -> SoleRun | None:
    """The single run on which a set of effects, or one of them, depends; None if there is none.

    Without this run the odds are below the threshold of an effect, and the run itself contributes as much: a weak
    effect that needs all its runs does not count as depending on the run that shows it best.
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
                found.append(SoleRun(full.runs[int(k)], ids - rest, gain, gain - brought))
    return min(found, key=lambda item: item.without - item.gain, default=None)


def is_needed_without(search: Search, ids: Set, run: int, families: int) -> bool:
    """Whether a set with free-form terms gains over every named set what it must, also without a run.

    Then the diagnosis of the others, which takes as long as the first, ends with a free-form term as well.
    """
    if not any(map(is_free, ids)) or ids not in search.fits or run not in search.fits[ids].runs:
        return False
    runs = search.fits[ids].runs
    named = [other for other, fit in search.fits.items() if not any(map(is_free, other)) and fit.runs == runs]
    k = runs.index(run)

    def without(other: Set) -> float:
        fit = search.fits[other]
        return score(search, other, families) - _evidence(search, fit) + _evidence(search, fit, k)

    return all(without(ids) - without(other) > least_gain(ids) for other in named)


def sole_misfit(left: Adequacy, runs: tuple[int, ...]) -> int | None:
    """The only run whose residuals exceed noise; None if there are none or several."""
    worst = int(np.argmax(left.by_run))
    others = np.delete(left.by_run, worst)
    return runs[worst] if left.excess > EXCESS >= float(others.mean()) else None


def sole_gains(left: Adequacy, runs: tuple[int, ...], least_percent: float, widening: float = 1.0) -> int | None:
    """The run whose wheel speeds differ significantly from those of all others; None if there is none.

    One run with a wrong command increases the scatter of all runs, which may hide effects. least_percent: least
    difference of the wheel speeds; a smaller one is irrelevant, and excluding a valid run may change the verdict.
    widening: least factor by which the run widens the scatter.

    The estimate of a gain is shrunk by the share of its variance that the run determines, and scatters by the square
    root of this share; it is therefore divided by this root, or the most informative runs would appear outlying.
    Source: Grubbs (1950), Ann. Math. Stat. 21, 27: each run against the others, Bonferroni over runs and sides; their
    scatter by itself, or with what is known of such speeds (a scaled inverse chi-square, Gelman et al., Bayesian Data
    Analysis, 2.6).
    """
    gains, shares = left.random_effects[:, 1:3], left.shares[:, 1:3]
    if len(gains) < FEWEST_RUNS or not gains.any(axis=0).all():
        return None
    count = len(gains)
    alike = np.where(shares > LEAST_SHARE, gains / np.sqrt(np.maximum(shares, LEAST_SHARE)), 0.0)
    means, spreads = (np.array([of(np.delete(alike, k, axis=0), axis=0) for k in range(count)]) for of in MEAN_SPREAD)
    apart = np.abs(alike - means) / np.maximum(spreads, 1e-300) / np.sqrt(1 + 1 / (count - 1))
    worst, side = np.unravel_index(int(np.argmax(apart)), apart.shape)
    own, both = float(spreads[worst, side]), float(np.sqrt(np.mean(spreads[worst] ** 2)))
    far = float(apart[worst, side]) * own
    by_itself, as_usual = _by_chance(far, own, count - 2, 0), _by_chance(far, max(own, both), count - 2, AS_USUAL)
    p = gains.size * min(by_itself, as_usual)
    off_percent = 100 * abs(gains[worst, side] - np.delete(gains[:, side], worst).mean())
    wider = float(alike[:, side].std(ddof=1)) >= widening * spreads[worst, side]
    return runs[int(worst)] if p < NOT_CHANCE and off_percent > least_percent and wider else None


def _by_chance(far: float, spread: float, freedom: int, usual: int) -> float:
    """Probability that a value is so far from others by chance, either way, by Student's t.

    spread: of the others, with this freedom; usual: number of values with the usual scatter that are counted with them.
    """
    known = freedom + usual
    spread = np.sqrt((freedom * spread**2 + usual * USUAL_SCATTER[1] ** 2) / known)
    return 2 * float(special.stdtr(known, -far / max(spread, 1e-300)))


def hiding_run(left: Adequacy, runs: tuple[int, ...], least_percent: float) -> int | None:
    """The run whose wheel speeds differ so much from those of all others that it hides effects; None if there is none.

    least_percent: of the difference that matters. An example is a speed of 60 rpm in a run whose file says 50: the
    model follows the run with wheels that turn 20 % faster, and all others count as if their wheels might, too.
    """
    return sole_gains(left, runs, PLAIN * least_percent, HIDES)


def _evidence(search: Search, fit: Fit, but: int | None = None) -> float:
    """Log evidence of a fitted model by linearization, from all its runs or all except one."""
    return evidence_of_runs(search, fit, [k for k in range(len(fit.runs)) if k != but])


def _misfits(fit: Fit) -> Floats:
    """Misfit of each run (-2 log density), with its random effects within the scatter, (n,)."""
    reduced, tau = fit.reduced, fit.posterior.scatter
    theta = np.array([fit.point.value(column) for column in fit.columns])
    square = reduced.s - 2 * reduced.g @ theta + np.einsum("p,npq,q->n", theta, reduced.G, theta)
    slope = reduced.c - reduced.C @ theta
    per_run = np.linalg.inv(reduced.A + np.diag(tau**-2.0))
    return np.asarray(square - np.einsum("ni,nij,nj->n", slope, per_run, slope))


def is_followed(problem: Problem, fit: Fit, per_run: Floats, run: int, tolerance: Mapping[str, float]) -> bool:
    """Whether a fit to other runs explains a run within noise, varying friction and the errors of that fit.

    per_run: (n, 7), start pose and random effects of all runs of the problem, as initial values.
    """
    try:
        placed = place_runs(problem.of_tracking, replace(fit.point, per_run=per_run), [run], fit.posterior.scatter)
        if is_near(problem, placed, run):
            return True
        moved = _updated(problem, fit, placed, run, tolerance)
        if moved is None:
            return False
        return is_near(problem, place_runs(problem.of_tracking, moved, [run], fit.posterior.scatter), run)
    except FloatingPointError:
        return False


def is_near(problem: Problem, placed: Point, run: int) -> bool:
    """Whether a model follows a run within noise and varying friction; placed: with its start and random effects."""
    return bool((run_gaps(problem, placed, [run]) <= farthest_followed(problem, [run])).all())


def _updated(problem: Problem, fit: Fit, placed: Point, run: int, tolerance: Mapping[str, float]) -> Point | None:
    """The point with the most probable common parameters given a run and a fit to others, by linearization.

    None if they differ significantly from those of the fit.
    """
    theta = np.array([placed.value(column) for column in fit.columns])
    _, g, G = at_scatter(reduce_runs(problem.linearized(placed, fit.columns, [run])), fit.posterior.scatter)
    variances, vectors = np.linalg.eigh(fit.posterior.covariance)
    root = vectors * np.sqrt(np.maximum(variances, 0.0))
    information, axes = np.linalg.eigh(root.T @ G[0] @ root)
    ways = root @ axes  # independent of one another in the fit, where each is known to 1, and in the run
    step = ways.T @ (g[0] - G[0] @ theta) / (1 + information)
    share = information / (1 + information)
    counts = share > DETERMINED
    if special.chdtrc(int(counts.sum()), float(np.sum(step[counts] ** 2 / share[counts]))) < NOT_CHANCE:
        return None
    return placed.at(fit.columns, np.clip(theta + ways @ step, *bounds(fit.columns, tolerance)))
