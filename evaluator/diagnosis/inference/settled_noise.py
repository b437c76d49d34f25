"""Noise that the best model of a search leaves, where a misfit had been taken for noise before."""

from __future__ import annotations

import numpy as np

from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.preparation import with_noise_of
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.likelihood.random_effects import place_runs

SETTLED_NOISE = 0.9  # a search is repeated where its best model lowers the noise below this share


def settled_noise(search: Search, best: frozenset[str]) -> Problem | None:
    """The problem with the noise that a fitted set leaves; None where that is no quieter."""
    fit, runs = search.fits[best], range(len(search.problem.data))
    problem = with_noise_of(search.problem, place_runs(search.problem, fit.point, runs, fit.posterior.scatter))
    pairs = zip(problem.noise, search.problem.noise, strict=True)
    ratio = np.median([new[0].sigma_mm / old[0].sigma_mm for new, old in pairs])
    return problem if ratio <= SETTLED_NOISE else None
