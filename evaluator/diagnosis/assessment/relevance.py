"""Relevance of an effect: its largest change of path, radius and speed in the experiment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.gap import noise_floor
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.likelihood.features import channels_of, rms_apart
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.settings import Relevant

Floats = NDArray[np.float64]

SETTLED_S = 0.5  # after the start of the motors, when a turn is steady
LEAST_TURN_RAD = np.radians(20.0)  # turn of a run whose change of radius counts


@dataclass(frozen=True)
class Changes:
    """The largest change that an effect makes in any run: of the path over the noise floor, of radius and speed, %."""

    path_noise_floors: float
    radius_percent: float
    speed_percent: float

    def matter(self, relevant: Relevant) -> bool:
        """Whether any of them reaches a limit of relevance."""
        return any(getattr(self, name) >= least for name, least in relevant.model_dump().items())


def changes(problem: Problem, fit: Fit, effect: str) -> Changes:
    """Changes by one effect of a fitted set: the fitted runs simulated with and without it, all else unchanged."""
    runs = list(fit.runs)
    rest: Mapping[str, tuple[float, ...]] = {key: value for key, value in fit.point.terms.items() if key != effect}
    both = [
        problem.forward.marks([point.task(run) for run in runs])
        for point in (fit.point, replace(fit.point, terms=rest))
    ]
    floors = noise_floor(problem, runs)
    found = np.zeros((len(runs), 3))
    for k, (run, present, absent) in enumerate(zip(runs, *both, strict=True)):
        data = problem.data[run]
        if not (np.isfinite(present).all() and np.isfinite(absent).all()):
            continue
        found[k, 0] = _apart(present, absent) / floors[k]
        steady = data.time_s >= data.start_s + SETTLED_S
        steady &= data.time_s <= (np.inf if data.stop_s is None else data.stop_s)
        ways, turns = zip(*(_way_and_turn(part[steady]) for part in (present, absent)), strict=True)
        if min(ways) > 0:
            found[k, 2] = 100 * abs(ways[0] / ways[1] - 1)
            if min(turns) > LEAST_TURN_RAD:
                found[k, 1] = 100 * abs(ways[0] / turns[0] / (ways[1] / turns[1]) - 1)
    return Changes(*map(float, found.max(axis=0)))


def _apart(first: Floats, second: Floats) -> float:
    """RMS distance of the midpoints of marks (n, 4), mm, after the best rotation and shift of the second path."""
    middles = [np.asarray((p[:, 0] + p[:, 2] + 1j * (p[:, 1] + p[:, 3])) / 2, dtype=complex) for p in (first, second)]
    return rms_apart(middles[0], middles[1])


def _way_and_turn(marks: Floats) -> tuple[float, float]:
    """Length of the midpoint's path, mm, and angle turned, rad, of simulated marks (n, 4)."""
    if len(marks) < 3:
        return 0.0, 0.0
    channels = channels_of(marks)
    angle = np.unwrap(channels[:, 2])
    return float(np.hypot(*np.diff(channels[:, :2], axis=0).T).sum()), float(abs(angle[-1] - angle[0]))
