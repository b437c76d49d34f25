"""Optimum of a linearized model: the most probable parameters, and the predicted density there.

A fit follows such views until one promises nothing more, or they lead nowhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized, Reduced, run_effects, solve_within
from evaluator.diagnosis.likelihood.linear.random_effects import MOST_SCATTER

Floats = NDArray[np.float64]

# Predicted decrease of -2 log density below which a fit has converged: a hundredth of what any decision needs.
SETTLED = 0.05
# A step that fails below this predicted decrease met the roughness of the density, or its curvature, not a wrong
# direction: over 26 runs, some of them turns on the spot, it varied by 0.8 between points that are all but the same;
# with two dozen quantities known to a tolerance, some worth hundreds of sigmas together, 3.6 were predicted where
# nothing was left to gain. Decisions take seven and more.
STALLED = 5.0
# A decrease that stays above this share of the one predicted before, and rests on friction or gains that no run can
# have, does not come. In four experiments that nothing explains, 164 of 169 fits that stalled wanted such, and one of
# 63 that converged.
NO_PROGRESS = 0.5
# Views in a row of which none promises half as little as the least before: then scatter and friction of runs take turns
# in explaining a misfit, and the fit goes round.
ROUNDS = 3
# Of log evidence below that of the best model so far: a fit that lags by more is given up where a step does
# not close half of it. Sets that come in for a verdict end within ten of one another.
LAGGING = 60.0
CLOSING = 0.5


@dataclass(frozen=True)
class Ahead:
    """Common parameters (p,) theta now and at the goal, and the random effects (n, 4) of the runs there.

    now: -2 log density of each run, the last of the priors (n + 1,). predicted: its decrease.
    """

    theta: Floats
    goal: Floats
    per_run: Floats
    prior: Floats
    scatter: Floats
    now: Floats
    predicted: float


def ahead_of(
    linear: Sequence[Linearized],
    reduced: Reduced,
    theta: Floats,
    per_run: Floats,
    prior: Floats,
    scatter: Floats,
    bounds: tuple[Floats, Floats],
) -> Ahead:
    """The most probable parameters within bounds, seen from theta (p,) and random effects (n, 4) of the runs there."""
    now = _objective(linear, theta, per_run, prior, scatter)
    goal = solve_within(reduced, prior, scatter, *bounds)
    there = run_effects(reduced, goal, scatter)[0]
    predicted = float(np.sum(now - _objective(linear, goal, there, prior, scatter)))
    return Ahead(theta, goal, there, prior, scatter, now, predicted)


def _objective(linear: Sequence[Linearized], theta: Floats, per_run: Floats, prior: Floats, scatter: Floats) -> Floats:
    """-2 log density of each run in the linear view, with its best start pose, and last of the priors, (n + 1,)."""
    values = []
    for number, item in enumerate(linear):
        left = item.response - item.common @ theta - item.scatter @ per_run[number]
        basis = np.linalg.qr(item.start)[0]
        left = left - basis @ (basis.T @ left)
        values.append(float(left @ left) + float(np.sum((per_run[number] / scatter) ** 2)))
    return np.array([*values, float(prior @ theta**2)])


class Course:
    """How the views of a fit follow one another."""

    def __init__(self) -> None:
        """Nothing has been seen yet."""
        self._promised, self._least, self._lagged = np.inf, np.inf, np.inf
        self._rounds = 0  # views since the least promise was halved

    def end(self, ahead: Ahead, lag: float) -> bool | None:
        """Whether a fit that ends with this view has converged; None where it goes on.

        lag: of log evidence, behind its rival.
        """
        promised = ahead.predicted
        nearer = promised < CLOSING * self._least
        self._least, self._rounds = (promised, 0) if nearer else (self._least, self._rounds + 1)
        # far behind its rival, or going round, it gains nothing that matters by what a failed step would leave, too
        little = STALLED if lag > LAGGING or self._rounds >= ROUNDS else SETTLED
        if promised < little:
            return True
        impossible = bool(np.any(np.abs(ahead.per_run) > MOST_SCATTER))
        stalls = promised > NO_PROGRESS * self._promised and impossible
        lags = lag > max(LAGGING, CLOSING * self._lagged)
        self._promised, self._lagged = promised, lag
        return False if stalls or lags or self._rounds >= ROUNDS else None
