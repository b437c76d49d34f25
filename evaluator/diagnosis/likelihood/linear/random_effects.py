"""The start pose and the random effects of each run, friction, gains and start, fitted at given common parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.problem import Point, Problem

Floats = NDArray[np.float64]

PER_RUN_PASSES = 9
# Passes in which slopes are only corrected by what each step changed, for an eighth of the simulations; in most fits
# runs settle within five.
SLOPES_LAST = 6
PER_RUN_SETTLED = 0.02  # of one run's -2 log density: a hundredth of a sigma
SHORTER = 0.3
# Relative friction and gains of one run, and its start in standard deviations (0.1 s of half frames): beyond, a linear
# step has lost its way, and a start is a mistake of the experiment file.
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

    With scatter None the start pose alone is fitted. Runs do not depend on one another here: each goes on until its own
    density settles, with shorter steps where a step made it worse, and with slopes that each step corrects. seen: views
    of these runs nearby, whose slopes serve to begin with. FloatingPointError where a run cannot be simulated at the
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
                continue  # settled: where a whole step leads is as good
            if now > value[run]:
                share[run] *= SHORTER
                going_on.append(run)
                continue
            if item is None:
                raise FloatingPointError(f"run {problem.data[run].id} cannot be simulated at this point")
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
    """The view after a step with slopes that explain what the step changed, and no more: Broyden's update.

    before, after: views with the same slopes. at_before, at_after: common parameters (p,), then the numbers of the run
    (7,). steps: sizes (p + 7,) in which numbers are compared.
    Source: Broyden (1965), Mathematics of Computation 19, 577.
    """
    moved = at_after - at_before
    square = float(np.sum((moved / steps) ** 2))
    if square == 0.0:
        return after
    slopes = np.column_stack([after.common, after.start, after.scatter])
    begin, end = (count := after.common.shape[1]), count + after.start.shape[1]
    # start poses are measured from where a view was taken, all else from where it changes nothing
    counted = np.ones(len(moved))
    counted[begin:end] = 0.0
    left = [view.response - slopes @ (counted * at) for view, at in ((before, at_before), (after, at_after))]
    missed = left[1] - left[0] + slopes @ moved
    slopes = slopes - np.outer(missed, moved / steps**2 / square)
    return Linearized(left[1] + slopes @ (counted * at_after), *np.split(slopes, [begin, end], axis=1))


def _per_run_value(item: Linearized, per_run: Floats, scatter: Floats | None) -> float:
    """-2 log density of one run where it was linearized."""
    left = item.response - item.scatter @ per_run[3:]
    return float(left @ left) + (0.0 if scatter is None else float(np.sum((per_run[3:] / scatter) ** 2)))


def _per_run_goal(item: Linearized, per_run: Floats, scatter: Floats | None) -> Floats:
    """Most probable start pose, friction, gains and start (7,) of one run in its linear view."""
    goal = per_run.copy()
    if scatter is not None:
        basis = np.linalg.qr(item.start)[0]
        slopes = item.scatter - basis @ (basis.T @ item.scatter)
        goal[3:] = np.linalg.solve(slopes.T @ slopes + np.diag(scatter**-2.0), slopes.T @ item.response)
        goal[3:] = np.clip(goal[3:], -MOST_SCATTER, MOST_SCATTER)
    # the response is measured from the start pose at which it was linearized
    goal[:3] += np.linalg.lstsq(item.start, item.response - item.scatter @ goal[3:], rcond=None)[0]
    return goal


def place_runs(problem: Problem, point: Point, runs: Sequence[int], scatter: Floats) -> Point:
    """The point with start poses, friction and gains of these runs fitted within a given scatter; all else stays."""
    return settled(problem, point, runs, scatter)[0]


def place_starts(problem: Problem, point: Point, runs: Sequence[int]) -> Point:
    """The point with only the start poses of these runs fitted: each run keeps its friction and gains."""
    return settled(problem, point, runs, None)[0]
