"""Profile likelihood of a coordinate whose posterior is not normal: the best density at each of its values.

The interval of a parameter is normally computed by linearization at the best point. If the data depend only weakly on a
size (the strength of all magnets, the distance of a spring's anchor), the density decreases more slowly or faster than
the linearization predicts, and the other parameters do not change along a line. In this case each end of the interval
is determined by fits of all other parameters with the coordinate fixed.
Source: Venzon & Moolgavkar (1988), Applied Statistics 37, 87.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.inference.fitted_model import Fit, prior_precision
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.linear.mixed_model import MixedModel
from evaluator.diagnosis.likelihood.point import Column
from evaluator.turning.motion.curvature import Z_975
from simulator.effects.coordinates import Candidate

Floats = NDArray[np.float64]

# Relative deviation of an end from the linearization above which it is computed by fits: up to it, a nominal 95 %
# interval covers 86 to 98.6 %. The density is rough by 0.8 of the required change of 3.8, which is 0.1 of an end.
NONLINEAR = 0.25
PASSES, ARRIVED, FARTHEST = 4, 0.1, 3.0  # fits per end; relative tolerance of an end; largest factor of one step


@dataclass(frozen=True)
class Profile:
    """The best point at each value of one coordinate of a term.

    column: of the coordinate in the fit. low, high: ends of its 95 % interval. at: values (m,) of the coordinate,
    ascending, including the best one; best: all columns (m, p) fitted there. Values are measured from the absent ones.
    """

    column: int
    low: float
    high: float
    at: Floats
    best: Floats

    def follow(self, values: Floats) -> Floats:
        """The best columns (n, p) at values (n,) of the coordinate; extrapolated beyond its ends."""
        k = np.clip(np.searchsorted(self.at, values) - 1, 0, len(self.at) - 2)
        share = (values - self.at[k]) / (self.at[k + 1] - self.at[k])
        return np.asarray(self.best[k] + share[:, None] * (self.best[k + 1] - self.best[k]))

    def transform(self, draws: Floats, mean: Floats, covariance: Floats) -> Floats:
        """Draws (n, p) of the linearization, changed so that the coordinate has its interval and the others follow."""
        i = self.column
        sigma = np.sqrt(covariance[i, i])
        z = (draws[:, i] - mean[i]) / sigma
        walked = mean[i] + z / Z_975 * np.where(z > 0, self.high - mean[i], mean[i] - self.low)
        beside = draws - mean - np.outer(z, covariance[i] / sigma)
        return np.asarray(self.follow(walked) + beside)


def profiles_of(search: Search, ids: frozenset[str]) -> dict[str, Profile]:
    """Profiles of the effects of a fitted set whose posterior is not normal.

    None on open ground, where the density is rough by tens; intervals are computed over commands there (output/).
    """
    if search.problem.open_ground:
        return {}
    smooth = [effect for effect in sorted(ids) if not search.terms[effect].stepwise]
    found = {effect: profile_of(search, search.fits[ids], search.terms[effect]) for effect in smooth}
    return {effect: profile for effect, profile in found.items() if profile is not None}


def profile_of(search: Search, fit: Fit, term: Candidate) -> Profile | None:
    """The profile of the coordinate of a term with the worst linearization; None if it is adequate for all."""
    worst, found = np.log1p(NONLINEAR), None
    # The scatter of the runs is uncertain, which widens the interval beyond that at the best scatter.
    model = MixedModel(fit.reduced, prior_precision(fit.columns, search.tolerance))
    at_best = model.posterior(range(len(fit.columns)), np.array([fit.posterior.best])).covariance
    for column, item in enumerate(fit.columns):
        if item.key != term.id or not fit.posterior.covariance[column, column] > 0.0:
            continue
        visits = [_Walk(search, fit, column, side, at_best[column, column]) for side in (-1.0, 1.0)]
        off = max(abs(np.log(walk.factor)) for walk in visits)
        if off > worst:
            worst, found = off, visits
    if found is None:
        return None
    for walk in found:
        walk.go()
    below, above = found
    steps = sorted([*below.visited, *above.visited, (below.start, below.mean)], key=lambda step: step[0])
    at, best = np.array([value for value, _ in steps]), np.array([point for _, point in steps])
    return Profile(below.column, below.end, above.end, at, best) if len(at) > 1 else None


class _Walk:
    """Iteration for one end of the interval of a column; factor: its distance over that of the linearization."""

    def __init__(self, search: Search, fit: Fit, column: int, side: float, at_best: float) -> None:
        """at_best: variance of the coordinate at the best scatter, which gives the required drop of the density."""
        self._search, self._fit, self.column = search, fit, column
        self.mean = np.array([fit.point.value(item) for item in fit.columns])
        covariance = fit.posterior.covariance
        self._along = covariance[column] / covariance[column, column]
        self.start, self._way = float(self.mean[column]), side * Z_975 * float(np.sqrt(covariance[column, column]))
        self._drop = self._way**2 / at_best
        self.visited: list[tuple[float, Floats]] = []
        self.factor = 1.0
        self._visit()

    @property
    def end(self) -> float:
        """Present estimate of the end of the interval."""
        return self.start + self.factor * self._way

    @property
    def _known(self) -> list[float]:
        return [value for value, _ in self.visited]

    def go(self) -> None:
        """Iterate the estimate of the end until it converges."""
        for _ in range(PASSES - 1):
            before = self.factor
            if not self._visit() or abs(self.factor - before) < ARRIVED * before:
                break

    def _visit(self) -> bool:
        """Fit all other parameters at the end and update it by the drop of the density; False if that fails."""
        item = self._fit.columns[self.column]
        assert item.term is not None
        bounds = item.term.coordinates[item.coordinate]
        value = float(np.clip(self.end, bounds.low - item.absent, bounds.high - item.absent))
        share = (value - self.start) / self._way
        if share < ARRIVED or any(abs(value - known) < ARRIVED * abs(self._way) for known in self._known):
            return False
        held = self._held(item, value)
        if held is None:  # too far: half the way there
            self.factor = 0.5 * (share + max((known - self.start) / self._way for known in [self.start, *self._known]))
            return True
        self.visited.append((value, np.array([held.point.value(column) for column in self._fit.columns])))
        drop = max(held.posterior.misfit - self._fit.posterior.misfit, 0.0)
        self.factor = share * float(np.clip(np.sqrt(self._drop / max(drop, 1e-9)), 1.0 / FARTHEST, FARTHEST))
        return True

    def _held(self, item: Column, value: float) -> Fit | None:
        """The fit with the column fixed at a value, started from the linearization; None if it fails."""
        point = self._fit.point
        for column, slope in zip(self._fit.columns, self._along, strict=True):
            point = point.moved(column, float(slope) * (value - self.start))
        terms = {effect: self._search.terms[effect].clipped(values) for effect, values in point.terms.items()}
        free = [self._search.terms[effect] for effect in sorted(terms) if not self._search.terms[effect].stepwise]
        fixed = {effect: values for effect, values in terms.items() if self._search.terms[effect].stepwise}
        begin = replace(point, terms=terms)
        try:
            found = fit_model(
                self._search.problem, begin, free, self._search.tolerance, self._fit.runs, fixed, held=item
            )
        except FloatingPointError:
            return None
        return found if found.converged else None
