"""Values of a term without a derivative: its response changes in steps, where a command passes the value."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from evaluator.diagnosis.inference.descent.steps import SETTLED
from evaluator.diagnosis.inference.fitted_model import Fit, prior_precision
from evaluator.diagnosis.likelihood.linear.mixed_model import MixedModel, reduce_runs
from evaluator.diagnosis.likelihood.problem import Problem
from simulator.effects.coordinates import Candidate

BESIDE = 4  # values on either side that a fit may move to at once
NEAR = 16  # values on either side of the fitted one that are compared with it
NOT_CONTRADICTED = 1.92  # log density below the best: half of the 95 % quantile of chi-squared with one degree


def index_of(fit: Fit, term: Candidate) -> int:
    """Number of the step in which the value of a fitted term lies."""
    value = fit.point.terms[term.id][0]
    return next(k for k, (low, high) in enumerate(term.between) if low <= value <= high)


def evidences(
    problem: Problem, fit: Fit, term: Candidate, tolerance: Mapping[str, float], steps: Iterable[int]
) -> dict[int, float]:
    """Log evidence with the term at other steps, all else adjusted by the slopes of the fit; -inf if not simulated."""
    found = {}
    for k in steps:
        there = replace(fit.point, terms={**fit.point.terms, term.id: term.starts[k]})
        views = [item for item in problem.seen_again(there, fit.linearized, fit.runs, fit.columns) if item is not None]
        whole = len(views) == len(fit.runs)
        model = MixedModel(reduce_runs(views), prior_precision(fit.columns, tolerance)) if whole else None
        found[k] = -np.inf if model is None else model.log_evidence(range(len(fit.columns)))
    return found


def _about(step: int, most: int, term: Candidate) -> range:
    """The steps up to so many to either side of one."""
    return range(max(step - most, 0), min(step + most + 1, len(term.starts)))


def likely_interval(problem: Problem, fit: Fit, term: Candidate, tolerance: Mapping[str, float]) -> tuple[float, float]:
    """Least and largest value of a term that the runs hardly contradict (95 %), beside the fitted one."""
    now = index_of(fit, term)
    known = evidences(problem, fit, term, tolerance, _about(now, NEAR, term))
    first = last = now
    while known.get(first - 1, -np.inf) > known[now] - NOT_CONTRADICTED:
        first -= 1
    while known.get(last + 1, -np.inf) > known[now] - NOT_CONTRADICTED:
        last += 1
    return term.between[first][0], term.between[last][1]


def better_step(problem: Problem, fit: Fit, term: Candidate, tolerance: Mapping[str, float]) -> int | None:
    """A step near that of a fit with a higher evidence beside its other values; None if there is none."""
    now = index_of(fit, term)
    known = evidences(problem, fit, term, tolerance, _about(now, BESIDE, term))
    best = max(known, key=lambda k: known[k])
    return best if known[best] > known[now] + SETTLED else None
