"""Changes over a session: a speed that changes once, friction that changes once or from run to run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.adequacy import LEAST_SHARE, UNLIKE, Adequacy, dependence, tells_friction
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.likelihood.linear.mixed_model import SCATTER
from evaluator.diagnosis.likelihood.run_data import RunData

Floats = NDArray[np.float64]

DRIFT = "speed-drift"
FEWEST_BESIDE_STEP = 2  # runs on either side of a step, because a single one may be outlying
STEP_ODDS = math.log(20.0)  # of a step relative to a drift, from which it is reported


@dataclass(frozen=True)
class FrictionChange:
    """A friction that changes over the session: runs (indices in the session) with the changed one, and the change.

    once: whether it clearly changes before the first of these runs, and not from run to run. change: relative, of these
    runs over those before; if not once, from the first run to the last.
    """

    runs: tuple[int, ...]
    change: float
    once: bool


def friction_change(left: Adequacy, runs: Sequence[int], data: Sequence[RunData]) -> FrictionChange | None:
    """The change of the friction of a fit over its runs; None if chance explains it.

    left: adequacy of the fit. runs: its runs. data: all runs of the session. It is a circumstance, not an effect: a
    plate that is wiped between two runs, or gathers dust. Runs unlike all others do not count.
    """
    number = SCATTER.index("friction")
    effects, share = left.random_effects[:, number], left.shares[:, number]
    order = np.array([data[run].order for run in runs], dtype=np.float64)
    seen = tells_friction(left, order)
    share = np.where(seen, share, 0.0)
    steps = (order >= begin for begin in order[seen][FEWEST_BESIDE_STEP : 1 - FEWEST_BESIDE_STEP])
    asked = [dependence(effects, share, course[:, None])[0] for course in (order, *steps)]
    if not len(asked) * np.nanmin([1.0, *asked]) < UNLIKE:  # Bonferroni; NaN for too few runs
        return None
    order, values, which = order[seen], effects[seen] / share[seen], np.asarray(runs)[seen]
    weights = np.sqrt(share[seen])
    found = step_over_line(order, values, weights)
    if found is not None and found[2] >= STEP_ODDS:
        return FrictionChange(tuple(which[found[0] + 1 :].tolist()), found[1], once=True)
    slope = float(np.polyfit(order, values, 1, w=weights)[0])
    return FrictionChange(tuple(which.tolist()), slope * float(np.ptp(order)), once=False)


def without_change(left: Adequacy, runs: Sequence[int], changed: FrictionChange, data: Sequence[RunData]) -> Adequacy:
    """The adequacy of a fit without a change of friction, so that runs before it are not unlike those after it.

    left, runs, data: see friction_change. An estimate is shrunk by the share that its run determines, and so is the
    change.
    """
    if changed.once:
        way = np.isin(runs, changed.runs).astype(np.float64)
    else:
        order = np.array([data[run].order for run in runs], dtype=np.float64)
        first, last = data[changed.runs[0]].order, data[changed.runs[-1]].order
        way = (order - first) / (last - first)
    effects = left.random_effects.copy()
    number = SCATTER.index("friction")
    effects[:, number] -= left.shares[:, number] * changed.change * way
    return replace(left, random_effects=effects)


def step_in_speed(fit: Fit, left: Adequacy, data: Sequence[RunData]) -> str:
    """The runs between which the speed changes once, in words; empty if it drifts or the runs do not determine it.

    A drift also approximates a single step (another day, another battery), because the scatter between runs includes
    the difference. Therefore a step and a line are compared for the speeds of the runs. fit: with or without a drift.
    left: adequacy of the fit. data: all runs of the session.
    """
    share = left.shares[:, 1:3].sum(axis=1)
    seen = share > 2 * LEAST_SHARE
    order = np.array([data[run].order for run in fit.runs], dtype=np.float64)
    # estimated gains of a run are shrunk by the share that the run determines
    gain = left.random_effects[:, 1:3].sum(axis=1) / np.maximum(share, LEAST_SHARE)
    speed = gain + (fit.point.terms[DRIFT][0] * order if DRIFT in fit.terms else 0.0)
    runs = [data[run] for run, is_seen in zip(fit.runs, seen, strict=True) if is_seen]
    found = step_over_line(order[seen], speed[seen], np.sqrt(share[seen]))
    if found is None or found[2] < STEP_ODDS:
        return ""
    last, size, _ = found
    between = f"{runs[last].id} and {runs[last + 1].id}"
    return (
        f"the speed changes by {100 * size:.2g} % between {between}, once, and does not drift from run to run: "
        f"what was changed there (battery, day)? Diagnose the runs before and after apart"
    )


def step_over_line(order: Floats, values: Floats, weights: Floats) -> tuple[int, float, float] | None:
    """Best step in values (n,) of runs in ascending order (n,): number of the last run before it, size, log odds.

    The odds are relative to a line, with Laplacian errors of sizes 1/weights (n,) and a common scale, so that single
    outlying runs have no influence. None for too few runs.
    """
    breaks = range(FEWEST_BESIDE_STEP, len(values) - FEWEST_BESIDE_STEP + 1)
    if len(breaks) < FEWEST_BESIDE_STEP:
        return None
    steps = [_level(values[:k], weights[:k])[1] + _level(values[k:], weights[k:])[1] for k in breaks]
    best = int(np.argmin(steps))
    k = breaks[best]
    line = _least_line(order, values, weights)
    odds = len(values) * math.log(max(line, 1e-300) / max(steps[best], 1e-300)) - math.log(len(breaks))
    return k - 1, _level(values[k:], weights[k:])[0] - _level(values[:k], weights[:k])[0], odds


def _level(values: Floats, weights: Floats) -> tuple[float, float]:
    """The level of least absolute deviations (a weighted median), and the sum of these deviations."""
    loss = np.abs(values[:, None] - values) @ weights
    return float(values[np.argmin(loss)]), float(loss.min())


def _least_line(order: Floats, values: Floats, weights: Floats) -> float:
    """Least sum of absolute deviations over all lines through two points (Bloomfield & Steiger 1983)."""
    first, second = np.triu_indices(len(values), 1)
    apart = order[second] - order[first]
    first, second, apart = first[apart > 0], second[apart > 0], apart[apart > 0]
    slope = (values[second] - values[first]) / apart
    off = values - values[first][:, None] - slope[:, None] * (order - order[first][:, None])
    return float((np.abs(off) @ weights).min())
