"""Fit of the start pose and the random effects of each run (friction, gains, start) at given common parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.likelihood.run_data import NotSimulatedError

Floats = NDArray[np.float64]

PER_RUN_PASSES = 9  # iterations; most runs converge within five
# Iterations in which slopes are updated by secants, with an eighth of the simulations.
SLOPES_LAST = 6
PER_RUN_SETTLED = 0.02  # of one run's -2 log density: a hundredth of a sigma
SHORTER = 0.3  # of a step that did not improve: the third such step is a few per cent of the first
# Largest relative friction and gains of one run, and its start in standard deviations (0.1 s of half frames): larger
# values mean that a linear step diverges, or that start_s is wrong in the experiment file.
MOST_SCATTER = np.array([0.5, 0.5, 0.5, 12.0])


def settled(
    problem: Problem,
    point: Point,
    runs: Sequence[int],
    scatter: Floats | None,
    seen: Sequence[Linearized] | None = None,
) -> tuple[Point, float]:
    """Start pose, friction and gains of every run fitted at a point, and -2 log density there: see settled_by_run."""
    found, values = settled_by_run(problem, point, runs, scatter, seen)
    return found, float(values.sum())


def settled_by_run(
    problem: Problem,
    point: Point,
    runs: Sequence[int],
    scatter: Floats | None,
    seen: Sequence[Linearized] | None = None,
) -> tuple[Point, Floats]:
    """Start pose, friction and gains of every run fitted at a point, and -2 log density (runs,) of each there.

    With scatter None only the start pose is fitted. Runs are independent here: each iterates until its density
    converges, with a shorter step if a step does not improve, and with slopes updated by secants. seen: linearizations
    of these runs at a nearby point, used as initial slopes. NotSimulatedError if a run cannot be simulated at the
    point.
    """
    best = point.per_run.copy()
    value = np.full(len(best), np.inf)
    step = np.zeros_like(best)
    share = np.ones(len(best))
    own = [replace(view, common=view.common[:, :0]) for view in seen or ()]  # common parameters stay at the point
    views = dict(zip(runs, own, strict=True)) if own else {}
    pending = list(runs)
    for number in range(PER_RUN_PASSES):
        trial = replace(point, per_run=best + share[:, None] * step)
        anew = number % SLOPES_LAST == 0 and not (number == 0 and views)
        if anew:
            found = problem.attempted(trial, (), pending)
        else:
            found = problem.seen_again(trial, [views[run] for run in pending], pending)
        going_on = []
        for run, item in zip(pending, found, strict=True):
            now = np.inf if item is None else _per_run_value(item, trial.per_run[run], scatter)
            if share[run] == 1.0 and value[run] < now <= value[run] + PER_RUN_SETTLED:
                continue  # converged: a full step changes the density by less than PER_RUN_SETTLED
            if now > value[run]:
                share[run] *= SHORTER
                going_on.append(run)
                continue
            if item is None:
                raise NotSimulatedError([problem.data[run].id])
            gained = value[run] - now
            as_seen = anew or not np.isfinite(value[run])
            view = item if as_seen else secant(views[run], item, best[run], trial.per_run[run], problem.per_run_steps)
            views[run], best[run], value[run], share[run] = view, trial.per_run[run], now, 1.0
            step[run] = _per_run_goal(view, best[run], scatter) - best[run]
            if gained > PER_RUN_SETTLED:
                going_on.append(run)
        pending = going_on
        if not pending:
            break
    return replace(point, per_run=best), value[list(runs)]


def secant(before: Linearized, after: Linearized, at_before: Floats, at_after: Floats, steps: Floats) -> Linearized:
    """The linearization after a step, with the least change of the slopes that explains the new response.

    before, after: linearizations with the same slopes. at_before, at_after: common parameters (p,), then the parameters
    of the run (7,). steps: scales (p + 7,) of the parameters.
    Source: Broyden (1965), Mathematics of Computation 19, 577.
    """
    moved = at_after - at_before
    square = float(np.sum((moved / steps) ** 2))
    if square == 0.0:
        return after
    slopes = np.column_stack([after.common, after.start, after.scatter])
    begin, end = (count := after.common.shape[1]), count + after.start.shape[1]
    # start poses are relative to the point of a linearization, all other parameters to their absent values
    counted = np.ones(len(moved))
    counted[begin:end] = 0.0
    left = [view.response - slopes @ (counted * at) for view, at in ((before, at_before), (after, at_after))]
    missed = left[1] - left[0] + slopes @ moved
    slopes = slopes - np.outer(missed, moved / steps**2 / square)
    return Linearized(left[1] + slopes @ (counted * at_after), *np.split(slopes, [begin, end], axis=1))


def _per_run_value(item: Linearized, per_run: Floats, scatter: Floats | None) -> float:
    """-2 log density of one run at the point of its linearization."""
    left = item.response - item.scatter @ per_run[3:]
    return float(left @ left) + (0.0 if scatter is None else float(np.sum((per_run[3:] / scatter) ** 2)))


def _per_run_goal(item: Linearized, per_run: Floats, scatter: Floats | None) -> Floats:
    """Most probable start pose, friction, gains and start (7,) of one run by linearization."""
    goal = per_run.copy()
    if scatter is not None:
        basis = np.linalg.qr(item.start)[0]
        slopes = item.scatter - basis @ (basis.T @ item.scatter)
        goal[3:] = np.linalg.solve(slopes.T @ slopes + np.diag(scatter**-2.0), slopes.T @ item.response)
        goal[3:] = np.clip(goal[3:], -MOST_SCATTER, MOST_SCATTER)
    # the response is relative to the start pose of the linearization
    goal[:3] += np.linalg.lstsq(item.start, item.response - item.scatter @ goal[3:], rcond=None)[0]
    return goal


def place_runs(problem: Problem, point: Point, runs: Sequence[int], scatter: Floats) -> Point:
    """The point with start poses, friction and gains of these runs fitted at a scatter (4,); all else is kept."""
    return settled(problem, point, runs, scatter)[0]


def place_starts(problem: Problem, point: Point, runs: Sequence[int]) -> Point:
    """The point with only the start poses of these runs fitted; friction and gains are kept."""
    return settled(problem, point, runs, None)[0]
