"""Pooled repetitions, with run-to-run scatter separated from measurement uncertainty.

Random-effects model: every run has its own value around the mean of all, measured with its own uncertainty. The scatter
between runs is estimated as by Paule and Mandel (1982, doi:10.6028/jres.087.022), the interval of the mean as by
Hartung and Knapp (2001, doi:10.1002/sim.791), which is valid for few runs. Errors of the camera are common to all runs
and are not averaged out: they widen the interval of the mean and are not part of the scatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from evaluator.turning.motion.curvature import Z_975

Array = NDArray[np.float64]
NAN = float("nan")


@dataclass(frozen=True)
class Pooled:
    """Mean of repetitions with its 95 % interval.

    error: standard error of the mean, of `freedom` degrees of freedom. between: standard deviation from run to run,
    measurement uncertainty subtracted; NaN for a single run. within: typical standard uncertainty of a single
    measurement (root mean square). p_same: probability of such differences if all runs are equal.
    """

    mean: float = NAN
    low: float = NAN
    high: float = NAN
    between: float = NAN
    within: float = NAN
    p_same: float = NAN
    runs: int = 0
    error: float = NAN
    freedom: float = NAN

    def with_systematic(self, systematic: float) -> Pooled:
        """Interval widened by a standard uncertainty common to all runs; not widened by NaN or infinity."""
        reach = Z_975 * systematic if np.isfinite(systematic) else 0.0
        low, high = np.hypot(self.mean - self.low, reach), np.hypot(self.high - self.mean, reach)
        return replace(self, low=self.mean - float(low), high=self.mean + float(high))


def pooled(values: Array, sigmas: Array) -> Pooled:
    """Pool values (n,) with their standard uncertainties (n,); those that are not finite are left out, none gives NaN.

    Values with unknown uncertainty (sigma zero) are pooled by their scatter alone, which a single value does not have.
    """
    values, sigmas = np.asarray(values, float), np.asarray(sigmas, float)
    good = np.isfinite(values) & np.isfinite(sigmas)
    values, sigmas = values[good], sigmas[good]
    n = len(values)
    if n == 0:
        return Pooled()
    within = float(np.sqrt(np.mean(sigmas**2)))
    if n == 1:
        value, error = float(values[0]), within or NAN
        reach = Z_975 * error
        return Pooled(value, value - reach, value + reach, within=within, runs=1, error=error, freedom=np.inf)
    between = paule_mandel(values, sigmas)
    least = 1e-12 * max(float(np.abs(values).max()), 1e-100)  # finite weights for equal values without uncertainty
    variance = sigmas**2 + between**2 + least**2
    weight = 1 / variance
    mean = float(weight @ values / weight.sum())
    # Hartung and Knapp's factor is one with the scatter of Paule and Mandel. If this scatter is zero the factor would
    # be smaller, but chance agreement of the runs must not narrow the interval.
    error = float(np.sqrt(1 / weight.sum()))
    reach = float(special.stdtrit(n - 1, 0.975)) * error
    measured = bool((sigmas > 0).all())
    same = float(special.chdtrc(n - 1, cochran(values, sigmas, 0.0))) if measured else NAN
    return Pooled(mean, mean - reach, mean + reach, between, within, same, n, error, float(n - 1))


def difference(first: Pooled, second: Pooled) -> tuple[float, float, float]:
    """Second mean minus the first with its 95 % bounds (Welch 1947, doi:10.1093/biomet/34.1-2.28)."""
    value, error, freedom = _welch(first, second)
    reach = float(special.stdtrit(freedom, 0.975) * error)
    return value, value - reach, value + reach


def p_of_difference(first: Pooled, second: Pooled) -> float:
    """Two-sided p-value of the difference of two means; NaN if unknown."""
    value, error, freedom = _welch(first, second)
    if error == 0:
        return 1.0 if value == 0 else 0.0
    return float(2 * special.stdtr(freedom, -abs(value) / error))


def _welch(first: Pooled, second: Pooled) -> tuple[float, float, float]:
    """Difference of two means, its standard error and its degrees of freedom; an unknown error is NaN."""
    value, squares = second.mean - first.mean, np.array([first.error**2, second.error**2])
    if not np.isfinite(value) or not np.isfinite(squares).all():
        return value, NAN, NAN
    shares = float((squares**2 / np.array([first.freedom, second.freedom])).sum())
    freedom = squares.sum() ** 2 / shares if shares else 1e9  # the uncertainty of a single run counts as known
    return value, float(np.sqrt(squares.sum())), float(freedom)


def cochran(values: Array, sigmas: Array, between: float) -> float:
    """Weighted sum of squares about the weighted mean (Cochran 1954, doi:10.2307/3001666)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = 1 / (sigmas**2 + between**2)
        squares = float(weight @ (values - weight @ values / weight.sum()) ** 2)
    return squares if np.isfinite(squares) else np.inf


def paule_mandel(values: Array, sigmas: Array) -> float:
    """Standard deviation between the values at which Cochran's sum equals its expectation; zero if it is smaller."""
    return common_scatter([(values, sigmas)])


def common_scatter(groups: Sequence[tuple[Array, Array]]) -> float:
    """Standard deviation between the values of groups (values, sigmas) that have a mean each, by Paule and Mandel."""
    freedom = sum(len(values) - 1 for values, _ in groups)
    widest = max(float(np.ptp(values)) for values, _ in groups)

    def squares(between: float) -> float:
        return sum(cochran(values, sigmas, between) for values, sigmas in groups if len(values) > 1)

    if widest == 0 or squares(0.0) <= freedom:
        return 0.0
    low, high = 0.0, widest * np.sqrt(sum(len(values) for values, _ in groups)) + 1e-300
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if squares(middle) > freedom else (low, middle)
    return float((low + high) / 2)
