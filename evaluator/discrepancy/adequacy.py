"""Is what a model leaves over noise? Absolute tests that no comparison between models can replace.

Left-overs of every run, freed of start pose and the run's own friction and gains, are compared with the tracking
noise mode by mode: slow modes hold motion, fast ones noise, so their ratio does not depend on the level of the noise.
The scatter that a model needs between runs is compared with the scatter between repeats of one command.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from evaluator.discrepancy.experiment import repeats
from evaluator.discrepancy.fit import Fit
from evaluator.discrepancy.forward import RunData
from evaluator.discrepancy.mixed import run_effects

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Adequacy:
    """What is left over under a fit.

    excess: mean square of whitened left-overs, 1 for pure noise; excess_sigma: its distance from 1 in standard errors.
    by_run: the same per run. repeat_p: probability that run-to-run scatter within repeats is as small as it is, were
    all scatter chance; NaN without repeats. own: each run's friction and gains (n, 3).
    """

    excess: float
    excess_sigma: float
    by_run: Floats
    repeat_p: float
    own: Floats


def adequacy(fit: Fit, data: Sequence[RunData]) -> Adequacy:
    """Test the left-overs of a fit."""
    columns = fit.columns
    theta = np.array([fit.point.value(column) for column in columns])
    total, freedom, by_run = 0.0, 0.0, []
    for item in fit.linearized:
        left = item.response - item.common @ theta
        basis = np.linalg.qr(np.column_stack([item.start, item.scatter, item.common]))[0]
        left = left - basis @ (basis.T @ left)
        square, count = float(left @ left), float(len(left) - basis.shape[1])
        by_run.append(square / max(count, 1.0))
        total, freedom = total + square, freedom + count
    own, _ = run_effects(fit.reduced, theta, fit.posterior.scatter)
    excess = total / max(freedom, 1.0)
    return Adequacy(
        excess,
        (excess - 1) / np.sqrt(2 / max(freedom, 1.0)),
        np.array(by_run),
        _repeat_probability(own, [data[run] for run in fit.runs]),
        own,
    )


def _repeat_probability(own: Floats, data: Sequence[RunData]) -> float:
    """F test of each run effect between commands against within repeats; the smallest of three, Bonferroni."""
    groups = list(repeats(data).values())
    within_freedom = sum(len(group) - 1 for group in groups)
    between_freedom = len(own) - 1 - within_freedom
    if within_freedom < 4 or between_freedom < 1:
        return float("nan")
    probabilities = []
    for column in own.T:
        within = sum(float(np.sum((column[group] - column[group].mean()) ** 2)) for group in groups)
        total = float(np.sum((column - column.mean()) ** 2))
        ratio = (total - within) / between_freedom / max(within / within_freedom, 1e-30)
        probabilities.append(float(stats.f.sf(ratio, between_freedom, within_freedom)))
    return min(1.0, 3 * min(probabilities))
