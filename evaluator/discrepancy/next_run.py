"""The run that would best separate what remains, and good experiments before there are any data.

A candidate run is simulated under the chosen model; what no parameter of the rival within its present uncertainty, no
start pose and no run-to-run scatter can imitate, over the tracking noise, is the separation to expect in sigmas.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.discrepancy.features import channels_of, compression
from evaluator.discrepancy.fit import Fit
from evaluator.discrepancy.forward import RunData
from evaluator.discrepancy.mixed import at_scatter, reduce_runs
from evaluator.discrepancy.noise import Noise
from evaluator.discrepancy.problem import Column, Point, Problem
from evaluator.discrepancy.rivals import SAME_SIGMAS, Set, Standing
from evaluator.discrepancy.search import Search, fit_set
from evaluator.discrepancy.simulated import Simulated
from evaluator.discrepancy.terms import Term
from simulator.robot import Robot

Floats = NDArray[np.float64]

DURATION_S = 8.0
RATE_HZ = 20.0
REST_S = 0.5
HEADINGS_DEG = tuple(range(0, 360, 45))
RIVAL_PROBABILITY = 0.02
MOST_RIVALS = 3


@dataclass(frozen=True)
class Candidate:
    """A run that could be made: command and start heading, from the middle of the plate."""

    left_rpm: float
    right_rpm: float
    heading_deg: float


def candidates(levels_rpm: Sequence[float]) -> list[Candidate]:
    """Straight runs and turns to both sides at the given levels, both directions, eight headings."""
    top = max(levels_rpm)
    commands = set()
    for level in sorted({round(level, 3) for level in levels_rpm} | {round(top, 3), round(top / 2, 3)}):
        if level <= 0:
            continue
        for share in (1.0, 0.7, 0.4):
            commands |= {(level, level * share), (level * share, level)}
    both = sorted(commands | {(-left, -right) for left, right in commands})
    return [Candidate(*command, heading) for command, heading in itertools.product(both, HEADINGS_DEG)]


def hypothetical(
    robot: Robot, terms: dict[str, Term], noise: tuple[Noise, ...], runs: Sequence[Candidate], point: Point
) -> tuple[Problem, Point]:
    """A problem of runs that were not made; their measured marks are what the point predicts."""
    time = np.arange(0.0, DURATION_S + REST_S, 1 / RATE_HZ)
    blank = np.zeros((len(time), 4))
    data = tuple(
        RunData(f"c{number}", item.left_rpm, item.right_rpm, REST_S, None, time, blank, 0)
        for number, item in enumerate(runs)
    )
    forward = Simulated((robot,) * len(data), data, terms)
    own = np.zeros((len(data), 6))
    own[:, 2] = np.radians([item.heading_deg for item in runs])
    placed = replace(point, own=own)
    marks = forward.marks([placed.task(run) for run in range(len(data))])
    channels = tuple(channels_of(item) for item in marks)
    used = np.ones(len(time), dtype=np.bool_)
    half = float(np.nanmedian([np.nanmedian(item[:, 3]) for item in channels])) / 2
    one = compression(time, used, noise)
    return Problem(data, forward, channels, (one,) * len(data), (noise,) * len(data), half), placed


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
    fit = search.fits[chosen]
    options = candidates(levels_rpm)
    problem, placed = hypothetical(
        search.problem.forward.robots[0], dict(search.terms), search.problem.noise[0], options, fit.point
    )
    sigmas = {name: expected_separations(problem, placed, rival) for name, rival in rivals.items()}
    weakest = np.min(np.array(list(sigmas.values())), axis=0)
    best = int(np.argmax(weakest))
    return NextRun(options[best], {name: float(values[best]) for name, values in sigmas.items()})


def _rivals(search: Search, chosen: Set, table: Standing, apart: Mapping[str, Mapping[str, float]]) -> dict[str, Fit]:
    """Fitted models that the data leave possible: probable ones, and effects too near to one that was chosen."""
    found = {
        " + ".join(sorted(ids)) or "no effect": search.fits[ids]
        for ids, probability in zip(table.sets, table.probability, strict=True)
        if ids != chosen and probability > RIVAL_PROBABILITY
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


# What a planned experiment should be able to stand: a usual friction and gain scatter of a magnetic robot on steel.
USUAL_SCATTER = np.array([0.02, 0.005, 0.005])
USUAL_NOISE = (Noise(0.001, 0.003, 0.08),) * 4


def plan_runs(robot: Robot, terms: dict[str, Term], levels_rpm: Sequence[float], count: int) -> list[Candidate]:
    """A good experiment before any data: greedily the runs that tell most about all effects at once (D-optimal).

    Effects are counted in visible steps; a run that repeats an earlier one still counts, because scatter averages out.
    """
    options = candidates(levels_rpm)
    problem, placed = hypothetical(robot, terms, USUAL_NOISE, options, Point(np.zeros((len(options), 6))))
    columns = [
        Column(term.id, i, term, term.starts[0] if term.starts else None)
        for term in terms.values()
        if not term.leaps
        for i in range(1 if term.starts else term.size)
    ]
    scale = np.array([column.term.coordinates[column.coordinate].step for column in columns if column.term])
    _, _, G = at_scatter(reduce_runs(problem.linearized(placed, columns)), USUAL_SCATTER)
    information = G * np.outer(scale, scale)
    total = np.eye(len(columns))
    chosen: list[int] = []
    for _ in range(count):
        gains = np.linalg.slogdet(total[None] + information)[1]
        used = np.array([0.3 * chosen.count(i) for i in range(len(options))])
        best = int(np.argmax(gains - used))
        chosen.append(best)
        total = total + information[best]
    return [options[i] for i in chosen]
