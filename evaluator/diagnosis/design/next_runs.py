"""The runs that would distinguish the remaining models, and models that no runs of this rig would distinguish.

Candidate runs are simulated with the chosen model. The information of a run is the part of the prediction, relative to
the tracking noise, that a rival cannot imitate by parameters within their present uncertainty, start pose and
run-to-run scatter. Runs are added one by one, repeats allowed, until they suffice together with the existing runs.
Greedy choice is close to optimal: Krause, Singh & Guestrin (2008), J. Mach. Learn. Res. 9, 235.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.model_comparison import SAME_SIGMAS, Set, Standing, is_free
from evaluator.diagnosis.design.candidate_runs import (
    CORNERS,
    HEADINGS_DEG,
    MIDDLE,
    REST_S,
    CandidateRun,
    Room,
    commands_at,
    placed,
)
from evaluator.diagnosis.inference.fitted_model import Fit, model_columns, prior_precision
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.features import channels_of, compression
from evaluator.diagnosis.likelihood.known_to import Quantity, predicted_sigmas
from evaluator.diagnosis.likelihood.linear.mixed_model import at_scatter, reduce_runs
from evaluator.diagnosis.likelihood.noise.tracking import Noise
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.likelihood.run_data import PER_RUN, Forward, RunData
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.likelihood.variants import depends_on_place
from simulator.effects.coordinates import Candidate
from simulator.robot import Robot

Floats = NDArray[np.float64]

RATE_HZ = 20.0  # of hypothetical frames: three times what the fastest modes need (features.FASTEST_HZ)
RIVAL_PROBABILITY = 0.02  # frequency with which the wrong one of two effects SAME_SIGMAS apart is the more probable one
MOST_RIVALS = 3  # the runs that separate these are an afternoon's work already (MOST_RUNS)
RIDGE = 1e-10  # regularization of a matrix with unit diagonal, for parameters that are equivalent
MOST_RUNS = 8  # an afternoon's work; rivals that they cannot exclude count as inseparable
# One sigma more than counts as separated, because sizes and scatter are known to some ten per cent only.
ENOUGH_SIGMAS = SAME_SIGMAS + 1.0


def hypothetical(
    robot: Robot,
    terms: dict[str, Candidate],
    noise: tuple[Noise, ...],
    runs: Sequence[CandidateRun],
    orders: Sequence[int],
    point: Point,
    like: Forward | None = None,
    known: Sequence[Quantity] = (),
    start_sigma_s: float = 0.0,
    *,
    from_poses: bool = False,
) -> tuple[Problem, Point]:
    """A problem of hypothetical runs, whose measured marks are the prediction at a point.

    orders: number of each run in its session. known, start_sigma_s: quantities that the laboratory knows to a
    tolerance, and uncertainty of the start of each run. like: a session of the same laboratory, instead of
    start_sigma_s. from_poses: as of RunData; the runs of a robot on open ground are.
    """
    times = [np.arange(0.0, item.duration_s + REST_S, 1 / RATE_HZ) for item in runs]
    data = tuple(
        RunData(f"c{number}", *item.command, REST_S, None, time, np.zeros((len(time), 4)), order, from_poses=from_poses)
        for number, (item, time, order) in enumerate(zip(runs, times, orders, strict=True))
    )
    same = (like.known, like.start_sigma_s) if isinstance(like, Simulated) else (predicted_sigmas(known), start_sigma_s)
    forward = Simulated((robot,) * len(data), data, terms, *same)
    per_run = np.zeros((len(data), PER_RUN))
    per_run[:, :3] = [(item.x_mm, item.y_mm, np.radians(item.heading_deg)) for item in runs]
    placed_at = replace(point, per_run=per_run)
    marks = forward.marks([placed_at.task(run) for run in range(len(data))])
    data = tuple(replace(run, marks_mm=item) for run, item in zip(data, marks, strict=True))
    channels = tuple(channels_of(item) for item in marks)
    distances = np.concatenate([item[:, 3] for item in channels])
    seen = distances[np.isfinite(distances)]  # of runs that can be simulated
    half = float(np.median(seen)) / 2 if len(seen) else np.nan
    distinct = {len(time): time for time in times}
    by_length = {size: compression(time, np.ones(size, dtype=np.bool_), noise) for size, time in distinct.items()}
    compressions = tuple(by_length[len(time)] for time in times)
    return Problem(data, forward, channels, compressions, (noise,) * len(data), half), placed_at


@dataclass(frozen=True)
class Rival:
    """A fitted model that the data do not exclude, and its separation from the chosen one by existing runs, sigmas."""

    fit: Fit
    at_hand_sigmas: float = 0.0


@dataclass(frozen=True)
class Information:
    """Information of candidate and existing runs about p parameters with which a rival imitates the chosen model.

    Misfit (n,), slope (n, p) and curvature (n, p, p) of -2 log density for every candidate; the same for all existing
    runs together: known_misfit, known_slope (p,), known (p, p).
    """

    misfit: Floats
    slope: Floats
    curvature: Floats
    known_misfit: float
    known_slope: Floats
    known: Floats

    def squares(self, made: Sequence[int]) -> Floats:
        """Squared separation, (n,), after the candidates `made` and each candidate in addition."""
        taken = list(made)
        misfit = self.misfit + self.misfit[taken].sum() + self.known_misfit
        slope = self.slope + self.slope[taken].sum(axis=0) + self.known_slope
        known = self.curvature + self.curvature[taken].sum(axis=0) + self.known
        scale = np.sqrt(np.maximum(np.einsum("npp->np", known), 1e-300))
        scaled = known / (scale[:, :, None] * scale[:, None, :]) + RIDGE * np.eye(known.shape[1])
        shift = np.linalg.solve(scaled, (slope / scale)[..., None])[..., 0]
        explained = np.einsum("np,np->n", slope / scale, shift)
        return np.asarray(np.maximum(misfit - explained, 0.0))


def from_rival(problem: Problem, placed: Point, rival: Rival) -> Information:
    """Information of the runs of a problem about a rival, linearized at the rival's fit.

    Runs that cannot be simulated have no information.
    """
    fit = rival.fit
    at = np.array([fit.point.value(column) for column in fit.columns])
    s, g, G = _inner(problem, replace(fit.point, per_run=placed.per_run), fit.columns, fit.posterior.scatter)
    # the response is relative to absent values: shift it to the parameters of the rival
    misfit = s - 2 * g @ at + np.einsum("p,npq,q->n", at, G, at)
    known = np.asarray(np.linalg.pinv(fit.posterior.covariance))
    return Information(misfit, g - G @ at, G, rival.at_hand_sigmas**2, np.zeros(len(at)), known)


def from_chosen(search: Search, chosen: Fit, problem: Problem, placed: Point, rival: Rival) -> Information:
    """Information about a rival, linearized at the chosen model: the response that the rival cannot imitate.

    If a rival predicts a jump to another steady state, linearization at its fit alone is too optimistic.
    """
    terms = [
        search.terms[effect] for effect in sorted(chosen.terms | rival.fit.terms) if not search.terms[effect].stepwise
    ]
    columns = model_columns(terms, search.tolerance, search.problem.given)
    own = np.array([column.key in chosen.terms - rival.fit.terms for column in columns])
    size = np.array([chosen.point.value(column) for column in columns])[own]
    tau = chosen.posterior.scatter
    _, _, at_hand = _inner(search.problem, chosen.point, columns, tau)
    _, _, G = _inner(problem, replace(chosen.point, per_run=placed.per_run), columns, tau)
    K = at_hand.sum(axis=0)
    return Information(
        np.einsum("p,npq,q->n", size, G[:, own][:, :, own], size),
        G[:, ~own][:, :, own] @ size,
        G[:, ~own][:, :, ~own],
        float(size @ K[np.ix_(own, own)] @ size),
        K[np.ix_(~own, own)] @ size,
        K[np.ix_(~own, ~own)] + np.diag(prior_precision(columns, search.tolerance)[~own]),
    )


def _inner(problem: Problem, point: Point, columns: Sequence[Column], scatter: Floats) -> tuple[Floats, Floats, Floats]:
    """Inner products (n,), (n, p), (n, p, p) of the runs of a problem; 0 for those that cannot be simulated."""
    views = problem.attempted(point, columns, range(len(problem.data)))
    sound = [run for run, view in enumerate(views) if view is not None]
    count, size = len(views), len(columns)
    s, g, G = np.zeros(count), np.zeros((count, size)), np.zeros((count, size, size))
    if sound:
        s[sound], g[sound], G[sound] = at_scatter(reduce_runs([view for view in views if view is not None]), scatter)
    return s, g, G


@dataclass(frozen=True)
class NextRuns:
    """Proposed runs, and the separation of every rival by them and the existing runs, sigmas.

    inseparable: rivals that even MOST_RUNS runs would not exclude, with the separation reached.
    """

    runs: tuple[CandidateRun, ...]
    sigmas: dict[str, float]
    inseparable: dict[str, float]


def best_next_runs(
    search: Search,
    chosen: Set,
    table: Standing,
    apart: Mapping[str, Mapping[str, float]],
    known: Sequence[Quantity] = (),
) -> NextRuns | None:
    """The runs to record next; None if no rival remains.

    known: quantities that the laboratory knows to a tolerance, which holds for further runs as well.
    """
    rivals = _rivals(search, chosen, table, apart)
    data, robot = search.problem.data, search.problem.forward.robots[0]
    room = Room.of_marks([run.marks_mm for run in data])
    both_ways = all(min(side) < 0 < max(side) for side in zip(*(run.command for run in data), strict=True))
    driven = sorted({max(map(abs, run.command)) for run in data} - {0.0})
    if not rivals or not driven:
        return None
    levels = sorted({driven[0], driven[len(driven) // 2], driven[-1]})  # levels in between add little information

    def of(options: Sequence[CandidateRun]) -> dict[str, list[Information]]:
        orders = [len(data)] * len(options)
        fit, noise = search.fits[chosen], search.problem.noise[0]
        forward = search.problem.forward
        given = robot, dict(search.terms), noise, options, orders, fit.point, forward, known
        problem, at = hypothetical(*given, from_poses=search.problem.open_ground)
        views = {name: [from_rival(problem, at, rival)] for name, rival in rivals.items()}
        for name, rival in rivals.items():
            if not any(search.terms[effect].starts for effect in chosen ^ rival.fit.terms):
                views[name].append(from_chosen(search, fit, problem, at, rival))
        return views

    commands = commands_at(levels, pivots=both_ways)
    # No ground has the grain of a plate: four headings distinguish a slope or a force there, in half of the time.
    headings = HEADINGS_DEG[::2] if search.problem.open_ground else HEADINGS_DEG
    options = [run for each in commands for run in placed(robot, each, headings, room, (MIDDLE,))]
    if not options:
        return None
    information = of(options)
    groups = [*information.values(), list(chain(*information.values()))]
    worth = sorted({options[run].command for group in groups for run in runs_until_enough(group)[0]})
    involved = {effect for rival in rivals.values() for effect in rival.fit.terms} | chosen
    if depends_on_place(robot, [search.terms[effect] for effect in sorted(involved)]):
        options = [run for each in worth for run in placed(robot, each, headings, room, (MIDDLE, *CORNERS))]
        information = of(options)
    return _until_separated(options, information, chosen)


def _until_separated(
    options: Sequence[CandidateRun], information: Mapping[str, Sequence[Information]], chosen: Set
) -> NextRuns | None:
    """Choose options until every rival that can be excluded is, by their information about each."""
    reached = {name: runs_until_enough(views)[1] for name, views in information.items()}
    inseparable = {name: sigmas for name, sigmas in reached.items() if sigmas < ENOUGH_SIGMAS}
    able = {name: views for name, views in information.items() if name not in inseparable}
    if not chosen:
        inseparable = {}  # runs cannot distinguish no effect from an effect whose size may be zero
    if not able and not inseparable:
        return None
    if not able:
        return NextRuns((), {}, inseparable)
    made, _ = runs_until_enough(list(chain(*able.values())))
    sigmas = {name: _least(views, made[:-1], made[-1]) for name, views in able.items()}
    return NextRuns(tuple(options[run] for run in sorted(made)), sigmas, inseparable)


def _least(views: Sequence[Information], made: Sequence[int], last: int) -> float:
    """Separation, sigmas, after the candidates `made` and a last one, in the most pessimistic linearization."""
    return float(np.sqrt(min(view.squares(made)[last] for view in views)))


def runs_until_enough(information: Sequence[Information]) -> tuple[list[int], float]:
    """Greedy choice of runs until all rivals are excluded; returns the runs and the smallest separation, sigmas."""
    made: list[int] = []
    least = 0.0
    while len(made) < MOST_RUNS and least < ENOUGH_SIGMAS:
        squares = np.array([item.squares(made) for item in information])
        made.append(int(np.argmax(np.minimum(squares, ENOUGH_SIGMAS**2).sum(axis=0))))
        least = _least(information, made[:-1], made[-1])
    return made, least


def _rivals(search: Search, chosen: Set, table: Standing, apart: Mapping[str, Mapping[str, float]]) -> dict[str, Rival]:
    """Fitted models that the data do not exclude: probable ones, and effects too similar to a chosen one.

    A set with one effect in addition to the chosen ones is not a rival, since no run distinguishes it from the same set
    with size 0; but if no effect is chosen, more probable named effects with insufficient odds are.
    """
    best = table.of(chosen)
    found = {
        " + ".join(sorted(ids)) or "no effect": Rival(search.fits[ids], float(np.sqrt(2 * max(best - score, 0.0))))
        for ids, score, probability in zip(table.sets, table.scores, table.probability, strict=True)
        if ids != chosen
        and probability > RIVAL_PROBABILITY
        and (not ids > chosen or (not chosen and score > best and not any(map(is_free, ids))))
    }
    for effect, others in apart.items():
        near = sorted((sigmas, other) for other, sigmas in others.items() if other and sigmas < SAME_SIGMAS)
        for sigmas, other in near[:MOST_RIVALS]:
            ids = chosen - {effect} | {other}
            if ids in search.fits:
                found[" + ".join(sorted(ids))] = Rival(search.fits[ids], sigmas)
    return dict(list(found.items())[:MOST_RIVALS])
