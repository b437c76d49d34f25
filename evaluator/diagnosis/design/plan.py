"""Plan of an experiment before there are data, and the effects that it can detect.

Runs follow a fixed cycle of straight runs and turns, forward and backward, left and right, so that the first few are
always balanced; speeds alternate, and commands repeat after all have been driven. Start heading and position of each
run maximise the information about all effects, given the previous runs (D_s-optimal: quantities known to a tolerance
are free). Source: Atkinson & Donev (1992), Optimum Experimental Designs, chapter 10.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.design.candidate_runs import CORNERS, HEADINGS_DEG, MIDDLE, CandidateRun, Room, placed
from evaluator.diagnosis.design.next_runs import hypothetical
from evaluator.diagnosis.inference.fitted_model import prior_precision
from evaluator.diagnosis.likelihood.known_to import FRAMES_COMMON, FRAMES_PER_RUN, Quantity, quantities
from evaluator.diagnosis.likelihood.linear.mixed_model import USUAL_SCATTER, at_scatter, reduce_runs
from evaluator.diagnosis.likelihood.noise.tracking import Noise
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.run_data import PER_RUN
from evaluator.errors import InputError
from evaluator.settings import KnownTo
from simulator.effects.coordinates import Candidate
from simulator.robot import Robot

Floats = NDArray[np.float64]

# Noise that a plan assumes: usual values of a magnetic robot on steel.
USUAL_NOISE = (Noise(0.001, 0.003, 0.08),) * 4
# Cycle of runs: straight runs determine the wheels' gains and forces on the body, turns in all directions the rest.
ROUND = ((1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))  # direction, side
TURN_SHARES = (0.43, 0.7)  # speed of the inner wheel, tight and wide, alternating with the speed
SIZE_STEPS = 10.0  # a modest size of an effect, in its visible steps
FRAME_S = 1 / 60  # of the camera, by which the start of motion is known
HIDDEN = 1.1  # least gain of visibility for which the measurement of a quantity is proposed
PLACES_OF_ATTRACTION = slice(0, 8, 2)


@dataclass(frozen=True)
class Expected:
    """Visibility in sigmas of one parameter of an effect of a given size, and relative to the most similar effect.

    measure: the quantity known to a tolerance that hides most of it; measured_sigmas: its visibility in the same runs
    if this quantity were known exactly. Empty if no such quantity hides a tenth.
    """

    effect: str
    parameter: str
    size: float
    sigmas: float
    nearest: str
    apart_sigmas: float
    measure: str = ""
    measured_sigmas: float | None = None


def plan_runs(
    robot: Robot, terms: Mapping[str, Candidate], levels_rpm: Sequence[float], room: Room, count: int
) -> list[CandidateRun]:
    """The runs of a good experiment, in the order in which to record them; room: available to the marks.

    Raises InputError if no run fits.
    """
    cells = [_commands(levels_rpm, *cell) for cell in ROUND]
    options: list[CandidateRun] = []
    for command in sorted({command for cell in cells for command in cell}):
        options += placed(robot, command, HEADINGS_DEG, room, (MIDDLE, *CORNERS))
    if not options:
        raise InputError(
            f"a plate of {2 * room.half_mm[0]:g} by {2 * room.half_mm[1]:g} mm has no room for a run that can be "
            "simulated; give the size of the plate, or slower wheels"
        )
    known, tolerance = _laboratory(robot)
    hidden = [Column(key) for key, value in tolerance.items() if value > 0]
    information, columns = _information(robot, terms, options, [0] * len(options), hidden, known)
    # relative to stated sizes; the prior only limits effects to this order of magnitude
    scale = np.array([tolerance[c.key] if c.term is None else _size(c) for c in columns])
    information = information * np.outer(scale, scale)
    total, chosen, driven = np.eye(len(scale)), list[int](), Counter[tuple[float, float]]()
    for number in range(count):
        able = [command for command in cells[number % len(cells)] if any(o.command == command for o in options)]
        fewest = min((driven[command] for command in able), default=0)
        fresh = {command for command in able if driven[command] == fewest}
        inside = [i for i, option in enumerate(options) if option.command in fresh] or list(range(len(options)))
        posterior = total[None] + information[inside]
        # information about effects, after elimination of the quantities known to a tolerance
        gains = np.linalg.slogdet(posterior)[1] - np.linalg.slogdet(posterior[:, : len(hidden), : len(hidden)])[1]
        best = inside[int(np.argmax(gains))]
        chosen.append(best)
        driven[options[best].command] += 1
        total = total + information[best]
    return [options[i] for i in chosen]


def _commands(levels_rpm: Sequence[float], direction: int, side: int) -> list[tuple[float, float]]:
    """Commands of one direction and side (1: left, 0: straight), one for each speed, or both turns at one speed."""
    levels = sorted(set(levels_rpm))
    if side == 0:
        return [(direction * level, direction * level) for level in levels]
    shares = [TURN_SHARES[index % 2] for index in range(len(levels))]
    pairs = list(zip(levels, shares, strict=True)) if len(levels) > 1 else [(levels[0], share) for share in TURN_SHARES]
    found = []
    for level, share in pairs:
        slower, faster = direction * round(level * share, 1), direction * level
        # the body turns left where the right wheel's speed is the greater of the two, signs counted
        found.append((slower, faster) if side * direction > 0 else (faster, slower))
    return found


def expected(robot: Robot, terms: Mapping[str, Candidate], runs: Sequence[CandidateRun]) -> list[Expected]:
    """Visibility of every effect at a modest size in these runs, by its least visible parameter."""
    known, tolerance = _laboratory(robot)
    names = {key: key for key in robot.tolerance} | {item.key: item.name for item in known}
    nominal_columns = [Column(key) for key, value in tolerance.items() if value > 0]
    information, columns = _information(robot, terms, runs, range(len(runs)), nominal_columns, known)
    total = information.sum(axis=0) + np.diag(prior_precision(columns, tolerance))
    nominal = [i for i, column in enumerate(columns) if column.term is None]
    groups: dict[str, list[list[int]]] = {}
    for i, column in enumerate(columns):
        if column.term is not None:  # places of an attraction are separate rivals, parameters of an effect one
            together = groups.setdefault(column.key, [])
            if column.start is not None or not together:
                together.append([])
            together[-1].append(i)
    found = []
    for effect, own in groups.items():
        shown = []
        for i in (i for group in own for i in group):
            size = _size(columns[i])
            apart = [
                (size * _left_over(total, i, [*nominal, *group]), other)
                for other, others in groups.items()
                if other != effect
                for group in others
            ]
            nearest = min(apart)
            seen = size * _left_over(total, i, nominal)
            name, value = _stated(columns[i], size)
            freed = [
                (size * _left_over(total, i, [other for other in nominal if other != hider]), names[columns[hider].key])
                for hider in nominal
            ]
            gained, what = max(freed, default=(0.0, ""))
            hides = (what, gained) if gained > HIDDEN * seen else ("", None)
            if columns[i].prior_sigma == math.inf:  # runs hardly show a level of magnets that needs a prior
                shown.append(Expected(effect, name, value, seen, nearest[1], nearest[0], *hides))
        # parameters without influence on their own, such as the fall-off of an attraction at its absent value, do not
        # count
        visible = [item for item in shown if item.sigmas > 0] or shown
        found.append(min(visible, key=lambda item: item.sigmas))
    return found


def _laboratory(robot: Robot) -> tuple[tuple[Quantity, ...], dict[str, float]]:
    """Quantities that an ordinary laboratory knows to a tolerance, and all tolerances of a fit by key."""
    usual = KnownTo(start_common_s=FRAMES_COMMON * FRAME_S, start_per_run_s=FRAMES_PER_RUN * FRAME_S)
    known = quantities(usual, robot, [])
    return known, {**robot.tolerance, **{item.key: item.tolerance for item in known}}


def _size(column: Column) -> float:
    """A modest deviation of a coordinate from its absent value."""
    assert column.term is not None
    return SIZE_STEPS * column.term.coordinates[column.coordinate].step


def _stated(column: Column, size: float) -> tuple[str, float]:
    """The parameter of an effect that corresponds to a coordinate, and its value at a deviation."""
    term = column.term
    assert term is not None
    coordinate = term.coordinates[column.coordinate]
    if coordinate.name in ("along", "across"):  # components of a size that has a direction
        return next(iter(term.physical(term.absent))), size
    return coordinate.name, coordinate.absent + size


def _left_over(total: Floats, own: int, others: Sequence[int]) -> float:
    """Sigmas per unit of one column that no combination of the others can imitate."""
    H, cross = total[np.ix_(others, others)], total[others, own]
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    solved = np.linalg.lstsq(H / np.outer(scale, scale), cross / scale, rcond=1e-10)[0] / scale if others else cross
    return float(np.sqrt(max(total[own, own] - cross @ solved, 0.0)))


def _columns(terms: Mapping[str, Candidate]) -> list[Column]:
    """A column for every coordinate of every effect; for an attraction one for each of some places."""
    return [column for term in terms.values() if not term.stepwise for column in _columns_of(term)]


def _columns_of(term: Candidate) -> Iterator[Column]:
    if term.starts:
        yield from (Column(term.id, 0, term, start) for start in term.starts[PLACES_OF_ATTRACTION])
    else:
        yield from (Column(term.id, i, term) for i in range(term.size))


def _information(
    robot: Robot,
    terms: Mapping[str, Candidate],
    runs: Sequence[CandidateRun],
    orders: Sequence[int],
    nominal: Sequence[Column] = (),
    known: Sequence[Quantity] = (),
) -> tuple[Floats, list[Column]]:
    """Information (n, p, p) of each run about all columns, start poses and run-to-run scatter free."""
    columns = [*nominal, *_columns(terms)]
    point = Point(np.zeros((len(runs), PER_RUN)))
    per_run_s = FRAMES_PER_RUN * FRAME_S
    problem, at = hypothetical(robot, dict(terms), USUAL_NOISE, runs, orders, point, None, known, per_run_s)
    found = problem.attempted(at, columns, range(len(runs)))
    able = [number for number, item in enumerate(found) if item is not None]
    information = np.zeros((len(runs), len(columns), len(columns)))  # runs that cannot be simulated have no information
    if able:
        reduced = reduce_runs([item for item in found if item is not None])
        _, _, information[able] = at_scatter(reduced, np.array(USUAL_SCATTER))
    return information, columns
