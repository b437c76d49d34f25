"""Nonlinear fit of one model: Gauss-Newton on the mixed model, relinearized by simulation until nothing moves.

A fit that does not converge is retried with shorter steps and then reported as not converged; it is never evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.discrepancy.forward import Values
from evaluator.discrepancy.mixed import Linearized, MixedModel, Posterior, Reduced, reduce_runs, run_effects, solve_at
from evaluator.discrepancy.problem import Column, Point, Problem
from evaluator.discrepancy.terms import Term

Floats = NDArray[np.float64]

MOST_STEPS = 12
SETTLED = 0.02  # change of -2 log likelihood below which a fit has converged: a hundredth of what any decision needs


@dataclass(frozen=True)
class Fit:
    """A fitted model: which terms, where, how well."""

    terms: frozenset[str]
    point: Point
    columns: tuple[Column, ...]
    posterior: Posterior
    reduced: Reduced
    linearized: tuple[Linearized, ...]
    converged: bool
    runs: tuple[int, ...]

    def counting(self, parameters: int) -> Fit:
        """The same with so many more parameters counted against it: those that were chosen, not fitted."""
        less = 0.5 * parameters * float(np.log(len(self.runs)))
        return replace(self, posterior=replace(self.posterior, log_evidence=self.posterior.log_evidence - less))


def model_columns(terms: Sequence[Term], tolerance: Mapping[str, float]) -> tuple[Column, ...]:
    """Columns of a model: nominal values that may move, then the coordinates of its terms."""
    nominal = tuple(Column(key) for key, value in tolerance.items() if value > 0)
    return nominal + tuple(Column(term.id, i, term) for term in terms for i in range(term.size))


def prior_precision(columns: Sequence[Column], tolerance: Mapping[str, float]) -> Floats:
    """1/σ² of the nominal values; 0 for effects."""
    return np.array([tolerance[c.key] ** -2.0 if c.term is None else 0.0 for c in columns])


def fit_model(
    problem: Problem,
    start: Point,
    terms: Sequence[Term],
    tolerance: Mapping[str, float],
    runs: Sequence[int] | None = None,
    fixed: Values | None = None,
) -> Fit:
    """Fit terms with nuisances free, from start (whose values of these terms are kept where given).

    fixed: terms that take part at values that stay, as those without a derivative do.
    """
    chosen = tuple(range(len(problem.data))) if runs is None else tuple(runs)
    columns = model_columns(terms, tolerance)
    prior = prior_precision(columns, tolerance)
    values = {term.id: start.terms.get(term.id, term.neutral) for term in terms}
    point = replace(start, terms={**(fixed or {}), **values})
    linear = problem.linearized(point, columns, chosen)
    damping, converged, best = 1.0, False, None
    for _ in range(MOST_STEPS):
        reduced = reduce_runs(linear)
        posterior = MixedModel(reduced, prior).posterior(range(len(columns)))
        scatter = posterior.scatter if best is None else best[4].scatter
        now = _objective(linear, point, columns, prior, scatter, chosen)
        if best is not None and now > best[0] + SETTLED:
            damping /= 3  # the last step overshot: go back and take a third of it
            if damping < 0.01:
                break
            point, linear, reduced, posterior = best[1:]
        else:
            if best is not None and best[0] - now < SETTLED and damping == 1.0:
                best = (now, point, linear, reduced, posterior)
                converged = True
                break
            now = _objective(linear, point, columns, prior, posterior.scatter, chosen)
            best = (now, point, linear, reduced, posterior)
            damping = min(1.0, 2 * damping)
        proposal = _step(point, linear, reduced, columns, prior, posterior.scatter, chosen, damping)
        try:
            linear = problem.linearized(proposal, columns, chosen)
            point = proposal
        except FloatingPointError:
            damping /= 3
            if damping < 0.01:
                break
    assert best is not None  # the first linearization either succeeded or raised
    _, point, linear, reduced, posterior = best
    return Fit(frozenset(point.terms), point, columns, posterior, reduced, tuple(linear), converged, chosen)


def _objective(
    linear: Sequence[Linearized],
    point: Point,
    columns: Sequence[Column],
    prior: Floats,
    scatter: Floats,
    runs: Sequence[int],
) -> float:
    """-2 log of the joint density at a point, its start poses included."""
    theta = np.array([point.value(column) for column in columns])
    total = float(prior @ theta**2)
    for run, item in zip(runs, linear, strict=True):
        own = point.own[run, 3:]
        left = item.response - item.common @ theta - item.scatter @ own
        total += float(left @ left) + float(np.sum((own / scatter) ** 2))
    return total


def _step(
    point: Point,
    linear: Sequence[Linearized],
    reduced: Reduced,
    columns: Sequence[Column],
    prior: Floats,
    scatter: Floats,
    runs: Sequence[int],
    damping: float,
) -> Point:
    """The point toward which the linearized model leads at this scatter, inside the bounds."""
    now = np.array([point.value(column) for column in columns])
    goal = _bounded_goal(reduced, columns, prior, scatter)
    theta = now + damping * (goal - now)
    nominal, values = dict(point.nominal), {effect: list(value) for effect, value in point.terms.items()}
    for column, value in zip(columns, theta, strict=True):
        if column.term is None:
            nominal[column.key] = float(value)
        else:
            values[column.key][column.coordinate] = float(value + column.neutral)
    own_goal, _ = run_effects(reduced, goal, scatter)
    own = point.own.copy()
    for index, (run, item) in enumerate(zip(runs, linear, strict=True)):
        own[run, 3:] += damping * (own_goal[index] - own[run, 3:])
        left = item.response - item.common @ theta - item.scatter @ own[run, 3:]
        own[run, :3] += np.linalg.lstsq(item.start, left, rcond=None)[0]
    return Point(own, nominal, {effect: tuple(value) for effect, value in values.items()})


def _bounded_goal(reduced: Reduced, columns: Sequence[Column], prior: Floats, scatter: Floats) -> Floats:
    """Most probable common parameters inside their bounds: what would leave is held at the bound it meets."""
    low = np.array([-np.inf if c.term is None else c.term.coordinates[c.coordinate].low - c.neutral for c in columns])
    high = np.array([np.inf if c.term is None else c.term.coordinates[c.coordinate].high - c.neutral for c in columns])
    held = np.full(len(columns), np.nan)
    while True:
        free = np.isnan(held)
        fixed = np.where(free, 0.0, held)
        part = reduced.of_columns(free, fixed)
        goal = fixed.copy()
        goal[free] = solve_at(part, prior[free], scatter)
        outside = free & ((goal < low) | (goal > high))
        if not outside.any():
            return goal
        held[outside] = np.clip(goal, low, high)[outside]


def place_runs(problem: Problem, point: Point, runs: Sequence[int], scatter: Floats, passes: int = 3) -> Point:
    """The point with start poses, friction and gains of these runs fitted within a given scatter; all else stays."""
    empty = np.zeros(0)
    for _ in range(passes):
        linear = problem.linearized(point, (), runs)
        goal, _ = run_effects(reduce_runs(linear), empty, scatter)
        own = point.own.copy()
        for index, (run, item) in enumerate(zip(runs, linear, strict=True)):
            own[run, 3:] = goal[index]
            left = item.response - item.scatter @ own[run, 3:]
            own[run, :3] += np.linalg.lstsq(item.start, left, rcond=None)[0]
        point = replace(point, own=own)
    return point
