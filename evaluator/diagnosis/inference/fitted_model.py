"""A fitted model: its columns, its prior, its point with posterior and linearization, and its residuals."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.inference.bounds import is_at_bound
from evaluator.diagnosis.likelihood.known_to import acting
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized, Posterior, Reduced, run_effects
from evaluator.diagnosis.likelihood.linear.random_effects import MOST_SCATTER
from evaluator.diagnosis.likelihood.point import Column, Point
from simulator.effects.coordinates import Candidate

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Fit:
    """A fitted model: its terms, point, posterior and linearization."""

    terms: frozenset[str]
    point: Point
    columns: tuple[Column, ...]
    posterior: Posterior
    reduced: Reduced
    linearized: tuple[Linearized, ...]
    converged: bool
    runs: tuple[int, ...]
    steps: int = 1  # number of linearizations of all its runs
    # predicted decrease of -2 log density that no step reached; half of it is subtracted from the evidence
    shortfall: float = 0.0

    @cached_property
    def misfits(self) -> tuple[Floats, Floats]:
        """Residual sums of squares of its runs and their degrees of freedom, (n,), (n,); see left_overs."""
        theta = np.array([self.point.value(column) for column in self.columns])
        return left_overs(self.linearized, self.columns, theta)

    @property
    def excess(self) -> float:
        """Mean square of the whitened residuals: 1 for noise."""
        squares, freedom = self.misfits
        return float(squares.sum() / freedom.sum())

    @property
    def at_bounds(self) -> frozenset[str]:
        """Effects with an estimate at a bound of its physical range."""
        return frozenset(column.key for column in self.columns if is_at_bound(column, self.point.value(column)))

    @property
    def unbelieved(self) -> frozenset[str]:
        """Effects of a size that is plausible only together with another effect, which the model lacks."""
        sizes = [(c.term, self.point.value(c)) for c in self.columns if c.term is not None and c.coordinate == 0]
        return frozenset(term.id for term, size in sizes if not term.believed(size, self.terms))

    @property
    def overreaches(self) -> bool:
        """Whether some run has implausible friction or gains, which conceal the misfit of the model."""
        per_run = run_effects(self.reduced, self.posterior.mean, self.posterior.scatter)[0]
        return bool(np.any(np.abs(per_run) > MOST_SCATTER))

    def counting(self, parameters: int) -> Fit:
        """The fit with its evidence reduced by the BIC for parameters chosen among alternatives and not fitted."""
        less = 0.5 * parameters * float(np.log(len(self.runs)))
        return replace(self, posterior=replace(self.posterior, log_evidence=self.posterior.log_evidence - less))


def model_columns(
    terms: Sequence[Candidate], tolerance: Mapping[str, float], given: Collection[str]
) -> tuple[Column, ...]:
    """Columns of a model: nominal values with a tolerance, then the coordinates of its terms.

    given: ids of effects of the robot file.
    """
    shown = acting(tolerance, {*given, *(term.id for term in terms)})
    nominal = tuple(Column(key) for key, value in shown.items() if value > 0)
    return nominal + tuple(Column(term.id, i, term) for term in terms for i in range(term.size))


def prior_precision(columns: Sequence[Column], tolerance: Mapping[str, float]) -> Floats:
    """1/σ² of the nominal values, and of the coordinates of effects that have a prior; 0 for the others."""
    return np.array([(tolerance[c.key] if c.term is None else c.prior_sigma) ** -2.0 for c in columns])


def left_overs(views: Sequence[Linearized], columns: Sequence[Column], theta: Floats) -> tuple[Floats, Floats]:
    """Residual sums of squares of runs and their degrees of freedom, (n,), (n,), at common parameters theta (p,).

    Start pose, random effects and effects are free in every run, so that residuals they could explain do not count.
    Quantities known to a tolerance are common to the session and keep their fitted values.
    """
    effects = np.array([column.term is not None for column in columns], dtype=np.bool_)
    squares, freedom = np.zeros(len(views)), np.zeros(len(views))
    for number, view in enumerate(views):
        left = view.response - view.common @ theta
        taken = np.column_stack([view.start, view.scatter, view.common[:, effects]])
        basis = np.linalg.qr(taken[:, taken.any(axis=0)])[0]
        squares[number] = float(left @ left) - float(np.sum((basis.T @ left) ** 2))
        freedom[number] = max(len(left) - basis.shape[1], 1)
    return squares, freedom
