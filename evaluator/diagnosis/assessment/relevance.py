"""Relevance of an effect: its largest change of path, radius and speed in the experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.gap import noise_floor
from evaluator.diagnosis.assessment.model_comparison import is_free
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.features import channels_of, rms_apart
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.settings import Relevant

Floats = NDArray[np.float64]

SETTLED_S = 0.5  # after the start of the motors, when a turn is steady
OPPOSED = 0.5  # change by both of two effects over that by the smaller, below which they cancel each other
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


@dataclass(frozen=True)
class Cancelling:
    """Two effects of a fitted set that cancel each other: RMS change of all paths by both together, and by each, mm."""

    effects: tuple[str, str]
    together_mm: float
    alone_mm: tuple[float, float]

    @property
    def sentence(self) -> str:
        """Why the two are no finding."""
        both, first, second = (f"{1000 * mm:.2g}" for mm in (self.together_mm, *self.alone_mm))
        return (
            f"{' and '.join(self.effects)} fit only by cancelling each other: they move the marks by {first} and "
            f"{second} µm, both together by {both} µm (RMS)"
        )


def cancelling(problem: Problem, fit: Fit) -> Cancelling | None:
    """The first two named effects of a fitted set that together change the paths by far less than each of them does.

    Paths are compared after the best rotation and shift. Of 1,198 pairs drawn as in tests/bank (ten commands), 5 oppose
    each other so closely by chance; in a fit, two effects do so to imitate a third.
    """
    runs, terms = list(fit.runs), fit.point.terms

    def marks_without(*effects: str) -> list[Floats]:
        rest = {key: value for key, value in terms.items() if key not in effects}
        return problem.forward.marks([replace(fit.point, terms=rest).task(run) for run in runs])

    named = sorted(key for key in terms if not is_free(key))
    if len(named) < 2:
        return None
    whole, each = marks_without(), {key: marks_without(key) for key in named}
    for pair in combinations(named, 2):
        first, second, both = (_rms_apart(whole, part) for part in (each[pair[0]], each[pair[1]], marks_without(*pair)))
        if both < OPPOSED * min(first, second):
            return Cancelling(pair, both, (first, second))
    return None


def without_cancelling(search: Search) -> tuple[Search, str]:
    """A search without sets in which two effects cancel each other, while one is the most probable; why, or empty."""
    reason = ""
    while len(best := search.ranked()[0]) > 1 and (found := cancelling(search.problem, search.fits[best])) is not None:
        reason = reason or found.sentence
        kept = {ids: fit for ids, fit in search.fits.items() if not ids.issuperset(found.effects)}
        search = replace(search, fits=kept)
    return search, reason


def _rms_apart(first: Sequence[Floats], second: Sequence[Floats]) -> float:
    """RMS distance of the paths of all runs that can be simulated, mm."""
    pairs = [(a, b) for a, b in zip(first, second, strict=True) if np.isfinite(a).all() and np.isfinite(b).all()]
    return float(np.sqrt(np.mean([_apart(a, b) ** 2 for a, b in pairs]))) if pairs else 0.0


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
