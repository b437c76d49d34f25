"""State of a search over sets of effects, and the fit of one set."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from evaluator.diagnosis.inference.fit import LAGGING, Fit, fit_model
from evaluator.diagnosis.likelihood.problem import Point, Problem
from evaluator.diagnosis.likelihood.run_data import START_POSE, Values
from simulator.effects.coordinates import Candidate

# Prior of no, one, two, three effects. A lab that asks is as likely as not to have one; each further one is rarer.
SIZE_PRIOR = (0.5, 0.35, 0.12, 0.03)
LARGEST_SET = 3
# On open ground. By their encoders the drives of a Husky and a Warthog follow late, limit speed and limit acceleration;
# that of the Husky has other gains than stated as well.
LARGEST_ON_GROUND = 4
RIVALS_KEPT = 4  # sets that go on to a search under another noise, or on all runs
# Friction and gains: what wet or dusty plates and DC motors show; starts as they are stated.
USUAL_SCATTER = (0.03, 0.006, 0.006, 1.0)
# Left-overs, mean square over that of the noise, below which a model counts as explaining the runs: the noise of slow
# modes is carried over from fast ones, good to some ten per cent, while a wrong model leaves several times as much.
EXPLAINED = 1.5
# Steps of fits, each a linear view of all runs (a quarter of a second for 24 runs of 10 s), after which a search fits
# no further sets: where nothing explains the runs every fit is long, and further ones only tell the same.
MOST_STEPS = 100


@dataclass
class Search:
    """Everything a search knows: the problem, the candidates, and all fits made so far."""

    problem: Problem
    terms: Mapping[str, Candidate]
    tolerance: Mapping[str, float]
    runs: tuple[int, ...]
    fits: dict[frozenset[str], Fit] = field(default_factory=dict)
    # sets whose fit did not converge: where it stopped, or None where runs cannot be simulated
    failed: dict[frozenset[str], Fit | None] = field(default_factory=dict)
    asked: frozenset[str] = frozenset()  # effects of the user's own: fitted wherever anything is added to a set
    extended: set[frozenset[str]] = field(default_factory=set)  # sets of which it was asked what to add
    steps: int = 0  # that all its fits took together
    most_steps: int = MOST_STEPS

    def anew(self, **changes: Any) -> Search:
        """The search with these fields changed, and nothing fitted yet."""
        empty: dict[str, Any] = {"fits": {}, "failed": {}, "extended": set(), "steps": 0, "most_steps": MOST_STEPS}
        return replace(self, **(empty | changes))

    @property
    def exhausted(self) -> bool:
        """Whether it has made as many steps as a search may."""
        return self.steps >= self.most_steps

    @property
    def largest(self) -> int:
        """How many effects a set may have."""
        return LARGEST_ON_GROUND if self.problem.open_ground else LARGEST_SET

    @property
    def explained(self) -> float:
        """Log evidence of the best fit where that explains the runs, else minus infinity."""
        if self.problem.open_ground:  # the noise is made of what a model leaves: any one explains the runs
            return -np.inf
        best = max(self.fits.values(), key=lambda fit: fit.posterior.log_evidence, default=None)
        explains = best is not None and best.converged and best.excess < EXPLAINED
        return best.posterior.log_evidence if best is not None and explains else -np.inf

    @property
    def null(self) -> Fit:
        """The recalibrated model without effects."""
        return self.fits[frozenset()]

    def evidence(self, ids: frozenset[str]) -> float:
        """Log evidence where the fit of a set came to: the least that it can be where it has not converged."""
        fit = self.reached(ids)
        return -np.inf if fit is None else fit.posterior.log_evidence

    def score(self, ids: frozenset[str]) -> float:
        """Log evidence plus log prior of a fitted set."""
        return self.fits[ids].posterior.log_evidence + log_prior(len(ids), len(self.terms))

    def reached(self, ids: frozenset[str]) -> Fit | None:
        """Where the fit of a set came to, converged or not: a place to go on from, evidence only where it converged."""
        return self.fits.get(ids) or self.failed.get(ids)

    @property
    def so_far(self) -> str:
        """What has come nearest to the runs, in words, should the search be stopped."""
        best = self.ranked()[0]
        what = " with ".join(sorted(best)) or "the model without an effect"
        explains = "explains" if self.fits[best].excess < EXPLAINED else "does not explain"
        left = f"its residuals are {self.fits[best].excess:.2g} times the mean square of the noise"
        return f"of {len(self.fits)} fitted models the most probable is {what}, which {explains} the runs: {left}"

    def ranked(self) -> list[frozenset[str]]:
        """Fitted sets, the most probable first."""
        return sorted(self.fits, key=self.score, reverse=True)


def log_prior(size: int, candidates: int) -> float:
    """Log prior of a set of this size; larger ones, which hold free-form terms, are as the largest of named effects."""
    size = min(size, len(SIZE_PRIOR) - 1)
    return math.log(SIZE_PRIOR[size]) - math.log(math.comb(candidates, size))


def fit_set(search: Search, ids: frozenset[str], starts: Values, origin: Fit, rival: float = -np.inf) -> Fit | None:
    """Fit a set once from these starting values; keep it where it is the best fit of the set so far.

    rival: log evidence of a set that explains the runs, near which this one must come.
    """
    values = {**origin.point.terms, **starts}
    smooth = [search.terms[effect] for effect in sorted(ids) if not search.terms[effect].stepwise]
    fixed = {effect: values[effect] for effect in ids if search.terms[effect].stepwise}
    values = {effect: values.get(effect, search.terms[effect].absent) for effect in ids}
    fit = _fit_from(search, Point(origin.point.per_run, origin.point.nominal, values), smooth, fixed, rival=rival)
    lags = fit is not None and fit.posterior.log_evidence < rival - LAGGING
    if fit is None or not (fit.converged or lags):
        # friction and gains with which a wrong model helped itself may be a place from which no step leads on
        without_scatter = origin.point.per_run.copy()
        without_scatter[:, START_POSE:] = 0.0
        usual = _fit_from(search, Point(without_scatter, {}, values), smooth, fixed, USUAL_SCATTER, rival)
        if usual is not None and usual.converged and not usual.overreaches:
            again = _fit_from(search, usual.point, smooth, fixed, rival=rival)
            usual = again if again is not None and again.converged else usual
        fit = usual or fit
    if fit is None or not fit.converged:
        if ids not in search.fits:
            search.failed[ids] = fit
        return None
    fit = fit.counting(len(fixed))
    old = search.fits.get(ids)
    if old is None or fit.posterior.log_evidence > old.posterior.log_evidence:
        search.fits[ids] = fit
    search.failed.pop(ids, None)
    if search.problem.horizon_s == np.inf:
        search.problem.watch.so_far = search.so_far
    return search.fits[ids]


def _fit_from(
    search: Search,
    begin: Point,
    smooth: Sequence[Candidate],
    fixed: Values,
    most_scatter: tuple[float, ...] | None = None,
    rival: float = -np.inf,
) -> Fit | None:
    """One fit; None where runs cannot be simulated."""
    problem, tolerance, runs = search.problem, search.tolerance, search.runs
    try:
        fit = fit_model(problem, begin, smooth, tolerance, runs, fixed, most_scatter, rival=rival)
    except FloatingPointError:
        search.steps += 1
        return None
    search.steps += fit.steps
    return fit
