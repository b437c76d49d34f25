"""Steps of a fit: the line search, and the few runs without which a full step would improve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.inference.descent.linearized_optimum import Optimum
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.likelihood.linear.random_effects import settled_by_run
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.problem import Problem

Floats = NDArray[np.float64]

# Predicted decrease of -2 log density below which a fit has converged: a hundredth of the 23 that an effect needs (odds
# of eight over its prior). Parameters and evidence are those of the linearized optimum, whose errors are smaller.
SETTLED = 0.2
DAMPINGS = (1.0, 0.4, 0.12, 0.03)
# Runs of a fit for each one that it may hold back, at least one: one in twenty is odd, and few runs are sensitive.
RUNS_TO_ONE_HELD_BACK = 10
KEPT = (
    0.5  # share of the promised decrease that the others must reach: their linearization holds, so that they converge
)


def line_search(
    problem: Problem,
    fit: Fit,
    optimum: Optimum,
    dampings: Sequence[float] = DAMPINGS,
    full: tuple[Point, Floats] | None = None,
) -> tuple[Point, bool]:
    """The first point toward the goal that improves, and True; otherwise the farthest point, and False.

    full: the full step, if it was tried already.
    """
    farthest = None
    for damping in dampings:
        problem.watch.look()
        tried = full if full and damping == DAMPINGS[0] else _tried(problem, fit, optimum, damping)
        if tried is None:
            continue
        if _improves(tried[1]):
            return tried[0], True
        farthest = farthest or tried[0]
    return farthest or fit.point, False


def _tried(problem: Problem, fit: Fit, optimum: Optimum, damping: float) -> tuple[Point, Floats] | None:
    """The point at a share of the step to the goal, and changes (n + 1,) of -2 log density: of each run, of the prior.

    Start pose and random effects of every run are fitted there, starting with the slopes of the fit. None if a run
    cannot be simulated.
    """
    trial = optimum.theta + damping * (optimum.goal - optimum.theta)
    try:
        there = fit.point.at(fit.columns, trial)
        moved, values = settled_by_run(problem, there, fit.runs, optimum.scatter, fit.linearized)
    except FloatingPointError:
        return None
    return moved, np.array([*values, optimum.prior @ trial**2]) - optimum.now


def _improves(change: Floats) -> bool:
    return float(change.sum()) < -0.1 * SETTLED


def full_step(problem: Problem, fit: Fit, optimum: Optimum) -> tuple[Point, Floats] | None:
    """The point at the goal and the changes of -2 log density: see _tried."""
    return _tried(problem, fit, optimum, DAMPINGS[0])


def obstructing_runs(fit: Fit, optimum: Optimum, full: tuple[Point, Floats] | None) -> tuple[int, ...]:
    """The few runs without which a full step would improve, although it does not with them; empty if there are none.

    A run on the verge of another path follows a step of the parameters so nonlinearly that the fit of all runs creeps
    in steps of a few per cent, until it ends: with one such run of 21 no model had converged, not even the true one
    from its true values. The others lead to parameters at which this run is nearly explained, too.
    """
    if full is None or _improves(full[1]):
        return ()
    change = full[1]
    most = max(len(fit.runs) // RUNS_TO_ONE_HELD_BACK, 1)
    worst = [int(run) for run in np.argsort(-change[:-1])[:most] if change[run] > 0]
    kept = -float(np.delete(change, worst).sum())
    return tuple(fit.runs[run] for run in worst) if kept > KEPT * np.delete(optimum.promised, worst).sum() else ()


def settled_at(problem: Problem, fit: Fit, optimum: Optimum, ahead: Point) -> Point | None:
    """The point that a fit without some runs has reached, with these fitted to it; None if it is no better for all."""
    theta = np.array([ahead.value(column) for column in fit.columns])
    try:
        point, values = settled_by_run(problem, ahead, fit.runs, optimum.scatter)
    except FloatingPointError:
        return None
    return point if _improves(np.array([*values, optimum.prior @ theta**2]) - optimum.now) else None
