"""Optimum of a linearized model: the most probable parameters, and the predicted gain in density."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized, Reduced, run_effects, solve_within

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Optimum:
    """Most probable parameters of a linearized model.

    theta: (p,) current common parameters. goal: (p,) their optimum. per_run: (n, 4) random effects of the runs there.
    prior: (p,) precision of the parameters. scatter: (4,) of the random effects. now: (n + 1,) -2 log density of each
    run at theta, then of the prior. promised: (n + 1,) its decreases at the goal.
    """

    theta: Floats
    goal: Floats
    per_run: Floats
    prior: Floats
    scatter: Floats
    now: Floats
    promised: Floats

    @property
    def predicted(self) -> float:
        """Decrease of -2 log density at the goal."""
        return float(self.promised.sum())


def optimum_of(
    linear: Sequence[Linearized],
    reduced: Reduced,
    theta: Floats,
    per_run: Floats,
    prior: Floats,
    scatter: Floats,
    bounds: tuple[Floats, Floats],
) -> Optimum:
    """The most probable parameters within bounds; theta: (p,) and per_run: (n, 4), current parameters."""
    now = _objective(linear, theta, per_run, prior, scatter)
    goal = solve_within(reduced, prior, scatter, *bounds)
    there = run_effects(reduced, goal, scatter)[0]
    promised = now - _objective(linear, goal, there, prior, scatter)
    return Optimum(theta, goal, there, prior, scatter, now, promised)


def _objective(linear: Sequence[Linearized], theta: Floats, per_run: Floats, prior: Floats, scatter: Floats) -> Floats:
    """-2 log density of each run by linearization, with its best start pose, then that of the prior, (n + 1,)."""
    values = []
    for number, item in enumerate(linear):
        left = item.response - item.common @ theta - item.scatter @ per_run[number]
        basis = np.linalg.qr(item.start)[0]
        left = left - basis @ (basis.T @ left)
        values.append(float(left @ left) + float(np.sum((per_run[number] / scatter) ** 2)))
    return np.array([*values, float(prior @ theta**2)])
