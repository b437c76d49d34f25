"""The run that would best separate what remains.

A candidate run is simulated under the chosen model; what no parameter of the rival within its present uncertainty, no
start pose and no run-to-run scatter can imitate, over the tracking noise, is the separation to expect in sigmas.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.discrepancy.candidates import (
    CORNERS,
    HEADINGS_DEG,
    MIDDLE,
    REST_S,
    Candidate,
    Room,
    commands_at,
    placed,
)
from evaluator.discrepancy.features import channels_of, compression
from evaluator.discrepancy.fit import Fit
from evaluator.discrepancy.forward import RunData
from evaluator.discrepancy.mixed import at_scatter, reduce_runs
from evaluator.discrepancy.noise import Noise
from evaluator.discrepancy.problem import Point, Problem
from evaluator.discrepancy.rivals import SAME_SIGMAS, Set, Standing
from evaluator.discrepancy.search import Search, fit_set
from evaluator.discrepancy.simulated import Simulated
from evaluator.discrepancy.terms import Term
from simulator.robot import Robot

Floats = NDArray[np.float64]

RATE_HZ = 20.0
RIVAL_PROBABILITY = 0.02
MOST_RIVALS = 3


def hypothetical(
    robot: Robot,
    terms: dict[str, Term],
    noise: tuple[Noise, ...],
    runs: Sequence[Candidate],
    orders: Sequence[int],
    point: Point,
) -> tuple[Problem, Point]:
    """A problem of runs that were not made; their measured marks are what the point predicts.

    orders: the place of each run in its session.
    """
    times = [np.arange(0.0, item.duration_s + REST_S, 1 / RATE_HZ) for item in runs]
    data = tuple(
        RunData(f"c{number}", *item.command, REST_S, None, time, np.zeros((len(time), 4)), order)
        for number, (item, time, order) in enumerate(zip(runs, times, orders, strict=True))
    )
    forward = Simulated((robot,) * len(data), data, terms)
    own = np.zeros((len(data), 6))
    own[:, :3] = [(item.x_mm, item.y_mm, np.radians(item.heading_deg)) for item in runs]
    placed_at = replace(point, own=own)
    marks = forward.marks([placed_at.task(run) for run in range(len(data))])
    channels = tuple(channels_of(item) for item in marks)
    half = float(np.nanmedian([np.nanmedian(item[:, 3]) for item in channels])) / 2
    distinct = {len(time): time for time in times}
    by_length = {size: compression(time, np.ones(size, dtype=np.bool_), noise) for size, time in distinct.items()}
    compressions = tuple(by_length[len(time)] for time in times)
    return Problem(data, forward, channels, compressions, (noise,) * len(data), half), placed_at


def expected_separations(problem: Problem, placed: Point, rival: Fit) -> Floats:
    """Sigmas by which each candidate run would separate a rival from the model that made the problem's marks."""
    sound = [run for run in range(len(problem.data)) if np.isfinite(problem.channels[run]).all()]
    result = np.zeros(len(problem.data))
    point = replace(rival.point, own=placed.own)
    columns = rival.columns
    reduced = reduce_runs(problem.linearized(point, columns, sound))
    at_rival = np.array([point.value(column) for column in columns])
    s, g, G = at_scatter(reduced, rival.posterior.scatter)
    known = np.linalg.pinv(rival.posterior.covariance)
    for index, run in enumerate(sound):
        # the response is measured from neutral: shift it to the rival's own parameters
        excess = g[index] - G[index] @ at_rival
        left = s[index] - 2 * g[index] @ at_rival + at_rival @ G[index] @ at_rival
        square = left - excess @ np.linalg.lstsq(known + G[index], excess, rcond=None)[0]
        result[run] = np.sqrt(max(float(square), 0.0))
    return result


@dataclass(frozen=True)
class NextRun:
    """The candidate that best separates the chosen model from its rivals, and by how many sigmas from each."""

    candidate: Candidate
    sigmas: dict[str, float]


def best_next_run(
    search: Search, chosen: Set, table: Standing, apart: Mapping[str, Mapping[str, float]], levels_rpm: Sequence[float]
) -> NextRun | None:
    """What to run next; None where no rival is left that is worth a run."""
    rivals = _rivals(search, chosen, table, apart)
    if not rivals:
        return None
    fit, robot = search.fits[chosen], search.problem.forward.robots[0]
    room = Room.of_marks([run.marks_mm for run in search.problem.data])

    def best(options: Sequence[Candidate]) -> NextRun:
        orders = [len(search.problem.data)] * len(options)
        problem, at = hypothetical(robot, dict(search.terms), search.problem.noise[0], options, orders, fit.point)
        sigmas = {name: expected_separations(problem, at, rival) for name, rival in rivals.items()}
        first = int(np.argmax(np.min(np.array(list(sigmas.values())), axis=0)))
        return NextRun(options[first], {name: float(values[first]) for name, values in sigmas.items()})

    options = [run for each in commands_at(levels_rpm) for run in placed(robot, each, HEADINGS_DEG, room, (MIDDLE,))]
    if not options:
        return None
    command = best(options).candidate.command
    return best(list(placed(robot, command, HEADINGS_DEG, room, (MIDDLE, *CORNERS))))


def _rivals(search: Search, chosen: Set, table: Standing, apart: Mapping[str, Mapping[str, float]]) -> dict[str, Fit]:
    """Fitted models that the data leave possible: probable ones, and effects too near to one that was chosen."""
    found = {
        " + ".join(sorted(ids)) or "no effect": search.fits[ids]
        for ids, probability in zip(table.sets, table.probability, strict=True)
        # one more effect beside those chosen did not pay for itself: no run tells it from one of size nought
        if ids != chosen and not (chosen and ids > chosen) and probability > RIVAL_PROBABILITY
    }
    for effect, others in apart.items():
        near = sorted((sigmas, other) for other, sigmas in others.items() if other and sigmas < SAME_SIGMAS)
        for _, other in near[:MOST_RIVALS]:
            ids = chosen - {effect} | {other}
            fit = search.fits.get(ids)
            if fit is None and not search.terms[other].starts:
                fit = fit_set(search, ids, {}, search.fits[frozenset()])
            if fit is not None:
                found[" + ".join(sorted(ids))] = fit
    return dict(list(found.items())[:MOST_RIVALS])
