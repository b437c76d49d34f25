"""Cross-validation of a fitted model: on held-out commands, and between halves of the runs.

Each command in turn is held out with all its repeats, or each recording with all its parts; common parameters are
estimated from the other runs. A real effect has the same size forward and backward, slow and fast, to the left and to
the right. Both tests use the linearizations of the fits, without further simulations.
Source: Stone (1974), J. R. Stat. Soc. B 36, 111.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from evaluator.diagnosis.held_out import left_out_together
from evaluator.diagnosis.inference.fitted_model import Fit, prior_precision
from evaluator.diagnosis.likelihood.linear.mixed_model import at_scatter
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.likelihood.run_data import RunData

Floats = NDArray[np.float64]

FEWEST_IN_HALF = 4  # runs: in three, a single outlying one decides the size
# Tolerated relative difference of an effect between halves (one standard deviation): for effects known to 0.1 %, errors
# of linearization cause differences of some per cent; effects that only imitate others differ by half.
SAME_SIZE = 0.05
BY_CHANCE = 0.05  # probability that a model which is not better passes as predicting left-out commands better
# Mean log ratio of squared residuals below which chance may find a gain among all candidates. On uneven ground without
# an effect the best of some twenty gained 0.03, with 2.1 standard errors; the limits of a Husky's drive, which its
# encoders confirm, gain 0.4 and 1.1 with 2.8 and 4.2.
LARGE_GAIN = 0.1


def advantage(first: Fit, second: Fit, data: Sequence[RunData], tolerance: Mapping[str, float]) -> tuple[float, float]:
    """Gain in log density of left-out commands of the first fit over the second, and its standard error over commands.

    Both fits use the same runs of data. With few commands the standard error is uncertain: it is increased by the ratio
    of Student's t to the normal distribution, so that two standard errors have the same meaning for any number.
    """
    aside = left_out_together([data[run] for run in first.runs])
    gains = _densities(first, aside, tolerance) - _densities(second, aside, tolerance)
    if len(gains) < 2:
        return float(gains.sum()), np.inf
    wider = float(special.stdtrit(len(gains) - 1, special.ndtr(2.0))) / 2.0
    return float(gains.sum()), float(gains.std(ddof=1) * np.sqrt(len(gains)) * wider)


def predicts_better(
    first: Fit, second: Fit, data: Sequence[RunData], tolerance: Mapping[str, float], candidates: int = 1
) -> bool:
    """Whether the first fit predicts left-out commands significantly better than the second.

    candidates: how many effects were tried: a small gain must be significant as the best of all (Bonferroni).

    On open ground the noise is estimated from the residuals of the best model, and the log density is dominated by
    single commands with large residuals. Therefore the ratio of the residuals of both fits is tested for each command:
    it must exceed one on average (one-sided t test of the logarithms). One command alone shows no effect.
    """
    ratios = _log_ratios(first, second, data, tolerance)
    if len(ratios) < 2:
        return False
    error = ratios.std(ddof=1) / np.sqrt(len(ratios))
    chance = BY_CHANCE if ratios.mean() > LARGE_GAIN else BY_CHANCE / max(candidates, 1)
    return bool(ratios.mean() > special.stdtrit(len(ratios) - 1, 1 - chance) * error)


def mean_gain(first: Fit, second: Fit, data: Sequence[RunData], tolerance: Mapping[str, float]) -> float:
    """Mean log ratio of the residuals of two fits on left-out commands; positive if those of the first are smaller."""
    return float(_log_ratios(first, second, data, tolerance).mean())


def _log_ratios(first: Fit, second: Fit, data: Sequence[RunData], tolerance: Mapping[str, float]) -> Floats:
    """Logarithm (groups,) of residuals of the second fit over those of the first, for each left-out command."""
    aside = left_out_together([data[run] for run in first.runs])
    # the density of whitened features is a unit normal: its negative logarithm is half the sum of squares with noise
    less, more = (np.maximum(-_densities(fit, aside, tolerance), 0.5) for fit in (first, second))
    return np.asarray(np.log(more / less))


def _densities(fit: Fit, aside: Sequence[NDArray[np.int64]], tolerance: Mapping[str, float]) -> Floats:
    """Log density of each group of runs, with parameters estimated from the other runs, (groups,)."""
    tau = fit.posterior.scatter
    s, g, G = at_scatter(fit.reduced, tau)
    without = _estimates_without(g, G, aside, fit, tolerance)
    widths = np.linalg.slogdet(fit.reduced.A + np.diag(tau**-2.0))[1] + 2 * np.log(tau).sum()
    found = []
    for group, (mean, covariance) in zip(aside, without, strict=True):
        inside, slope = G[group].sum(axis=0), g[group].sum(axis=0)
        spread = np.eye(len(mean)) + covariance @ inside
        excess = slope - inside @ mean
        misfit = s[group].sum() - 2 * slope @ mean + mean @ inside @ mean
        misfit -= excess @ np.linalg.solve(spread, covariance) @ excess
        found.append(-0.5 * (misfit + np.linalg.slogdet(spread)[1] + widths[group].sum()))
    return np.array(found)


def covariance_over_commands(fit: Fit, data: Sequence[RunData], tolerance: Mapping[str, float]) -> Floats:
    """Covariance (p, p) of the parameters of a fit, at least that of the jackknife over commands.

    On open ground, residuals of a model are not independent between runs, since runs of one command deviate alike. The
    covariance of the fit neglects this; the result here is never smaller than the jackknife over commands, with
    Student's t for their number. Source: Tukey (1958), Ann. Math. Stat. 29, 614.
    """
    aside = left_out_together([data[run] for run in fit.runs])
    if len(aside) < 2:
        return fit.posterior.covariance
    _, g, G = at_scatter(fit.reduced, fit.posterior.scatter)
    means = np.array([mean for mean, _ in _estimates_without(g, G, aside, fit, tolerance)])
    freedom = len(aside) - 1
    wider = float(special.stdtrit(freedom, 0.975) / special.ndtri(0.975))
    jackknife = wider * np.sqrt(freedom / len(aside) * np.sum((means - means.mean(axis=0)) ** 2, axis=0))
    sigmas = np.sqrt(np.diag(fit.posterior.covariance))
    factor = np.maximum(jackknife / np.maximum(sigmas, 1e-300), 1.0)
    return np.asarray(fit.posterior.covariance * np.outer(factor, factor))


def covariance_of(fit: Fit, problem: Problem, tolerance: Mapping[str, float]) -> Floats:
    """Covariance (p, p) of the parameters of a fit; on open ground it includes the scatter between commands."""
    if not problem.open_ground:
        return fit.posterior.covariance
    return covariance_over_commands(fit, problem.data, tolerance)


def _estimates_without(
    g: Floats, G: Floats, aside: Sequence[NDArray[np.int64]], fit: Fit, tolerance: Mapping[str, float]
) -> list[tuple[Floats, Floats]]:
    """Parameters (p,) and their covariance (p, p) from the other runs, for each group of left-out runs."""
    prior, found = np.diag(prior_precision(fit.columns, tolerance)), []
    own = np.diag(G.sum(axis=0) + prior)
    scale = np.sqrt(np.where(own > 0, own, 1.0))  # unknowns of any units
    for group in aside:
        rest = np.setdiff1d(np.arange(len(g)), group)
        normal = (G[rest].sum(axis=0) + prior) / np.outer(scale, scale)
        covariance = np.linalg.pinv(normal, rcond=1e-13, hermitian=True) / np.outer(scale, scale)
        found.append((covariance @ g[rest].sum(axis=0), covariance))
    return found


@dataclass(frozen=True)
class Constancy:
    """Equality of the effects in two halves of the runs: probability of so large a difference by chance."""

    halves: str
    probability: float


def constancy(fit: Fit, data: Sequence[RunData], tolerance: Mapping[str, float]) -> list[Constancy]:
    """Compare the sizes of the effects of a fit between halves of its runs; splits with too few runs are omitted."""
    effects = np.array([column.term is not None for column in fit.columns], dtype=np.bool_)
    if not effects.any():
        return []
    runs = [data[run] for run in fit.runs]
    speed = np.array([run.left_rpm + run.right_rpm for run in runs])
    forward, slow = speed > 0, np.abs(speed) <= np.median(np.abs(speed))
    turning = np.array([run.right_rpm - run.left_rpm for run in runs])
    splits = {
        "forward and backward": (forward, ~forward),
        "slow and fast": (slow, ~slow),
        "left and right": (turning > 0, turning < 0),
    }
    _, g, G = at_scatter(fit.reduced, fit.posterior.scatter)
    prior = np.diag(prior_precision(fit.columns, tolerance))
    slack = np.diag(SAME_SIZE**2 * _squares(fit)[effects])
    found = []
    for halves, masks in splits.items():
        sides = [np.flatnonzero(mask) for mask in masks]
        if min(map(len, sides)) < FEWEST_IN_HALF:
            continue
        sizes, covariances = [], []
        for side in sides:
            covariance = np.linalg.inv(G[side].sum(axis=0) + prior + np.diag(_loose(G, effects)))
            sizes.append((covariance @ g[side].sum(axis=0))[effects])
            covariances.append(covariance[np.ix_(effects, effects)])
        difference = sizes[0] - sizes[1]
        square = float(difference @ np.linalg.solve(covariances[0] + covariances[1] + slack, difference))
        found.append(Constancy(halves, float(special.chdtrc(int(effects.sum()), square))))
    return found


def _squares(fit: Fit) -> Floats:
    """Squared size of the effect that each column (p,) belongs to: of all its coordinates in their visible steps."""
    steps = np.array([1.0 if c.term is None else c.term.coordinates[c.coordinate].step for c in fit.columns])
    sizes = np.array([fit.point.value(column) for column in fit.columns]) / steps
    keys = np.array([column.key for column in fit.columns])
    return np.asarray(np.array([np.sum(sizes[keys == key] ** 2) for key in keys]) * steps**2)


def _loose(G: Floats, effects: NDArray[np.bool_]) -> Floats:
    """Weak prior that keeps sizes finite which one half of the runs does not determine."""
    return np.where(effects, 1e-9 * np.diag(G.sum(axis=0)) + 1e-30, 0.0)
