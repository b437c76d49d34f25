"""What each run has of its own, start pose, friction, gains and start, fitted at given common parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.mixed_model import Linearized
from evaluator.diagnosis.likelihood.problem import Point, Problem

Floats = NDArray[np.float64]

OWN_PASSES = 9
SLOPES_LAST = 3  # passes with the same slopes: a seventh of the simulations, nearly the same step
OWN_SETTLED = 0.02  # of one run's -2 log density: a hundredth of a sigma
SHORTER = 0.3
# Relative friction and gains of one run, and its start in standard deviations (0.1 s of half frames): beyond, a linear
# step has lost its way, and a start is a mistake of the experiment file.
MOST_SCATTER = np.array([0.5, 0.5, 0.5, 12.0])


def settled(problem: Problem, point: Point, runs: Sequence[int], scatter: Floats | None) -> tuple[Point, float]:
    """Start pose, friction and gains of every run fitted at a point, and -2 log density there.

    With scatter None the start pose alone is fitted. Runs do not depend on one another here: each goes on until its own
    density settles, with shorter steps where a step made it worse. FloatingPointError where a run cannot be simulated
    at the point.
    """
    best = point.own.copy()
    value = np.full(len(best), np.inf)
    step = np.zeros_like(best)
    share = np.ones(len(best))
    views: dict[int, Linearized] = {}
    pending = list(runs)
    for number in range(OWN_PASSES):
        trial = replace(point, own=best + share[:, None] * step)
        if number % SLOPES_LAST == 0:
            found = problem.attempted(trial, (), pending)
        else:
            found = problem.seen_again(trial, [views[run] for run in pending], pending)
        going_on = []
        for run, item in zip(pending, found, strict=True):
            now = np.inf if item is None else _own_value(item, trial.own[run], scatter)
            if now > value[run]:
                share[run] *= SHORTER
                going_on.append(run)
                continue
            if item is None:
                raise FloatingPointError(f"run {problem.data[run].id} cannot be simulated at this point")
            gained = value[run] - now
            views[run] = item
            best[run], value[run], share[run] = trial.own[run], now, 1.0
            step[run] = _own_goal(item, best[run], scatter) - best[run]
            if gained > OWN_SETTLED:
                going_on.append(run)
        pending = going_on
        if not pending:
            break
    return replace(point, own=best), float(value[list(runs)].sum())


def _own_value(item: Linearized, own: Floats, scatter: Floats | None) -> float:
    """-2 log density of one run where it was linearized."""
    left = item.response - item.scatter @ own[3:]
    return float(left @ left) + (0.0 if scatter is None else float(np.sum((own[3:] / scatter) ** 2)))


def _own_goal(item: Linearized, own: Floats, scatter: Floats | None) -> Floats:
    """Most probable start pose, friction, gains and start (7,) of one run in its linear view."""
    goal = own.copy()
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
