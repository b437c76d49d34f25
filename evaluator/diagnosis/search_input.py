"""What a search starts from: problem, nominal point, visible tolerances, candidate terms, runs to be fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.model_comparison import is_free
from evaluator.diagnosis.candidates.coordinates import attraction_of, named_terms, size_of
from evaluator.diagnosis.candidates.equivalent_terms import included_named_effects, is_included_in
from evaluator.diagnosis.candidates.free_form import free_terms
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.held_out import held_out_runs
from evaluator.diagnosis.inference.fit_cache import FitCache
from evaluator.diagnosis.inference.watch import Watch
from evaluator.diagnosis.likelihood.known_to import acting, predicted_sigmas
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.preparation import build_problem
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.likelihood.simulation import Simulated
from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Candidate

Floats = NDArray[np.float64]

UNSEEN_SIGMAS = 0.5  # response of all runs to one tolerance of a nominal value, below which the value is not fitted

# Of a ramp of 20 rpm/s, steps of 1 rpm, each of which changes the begin of a motion by three frames.
PASSED_S, PASSED_DIGITS = 0.05, 2


@dataclass(frozen=True)
class Prepared:
    """Runs ready for a search: problem, nominal point, visible tolerances, terms by id, ids of user-defined effects.

    last: effects of large robots, which for a small one are sought after all others. stated: all tolerances, also of
    values to which the runs do not respond visibly at the noise of the robot file.
    """

    problem: Problem
    start: Point
    tolerance: Mapping[str, float]
    terms: Mapping[str, Candidate]
    own: frozenset[str] = frozenset()
    last: Mapping[str, Candidate] = field(default_factory=dict)
    stated: Mapping[str, float] = field(default_factory=dict)

    @property
    def free(self) -> dict[str, Candidate]:
        """Free-form terms."""
        return {effect: term for effect, term in self.terms.items() if is_free(effect)}

    @property
    def named(self) -> dict[str, Candidate]:
        """Terms of the catalogue and of the user."""
        return {effect: term for effect, term in self.terms.items() if not is_free(effect)}


def prepared(session: Session, progress: Watch, fits: FitCache | None) -> Prepared:
    """The runs of a session with their noise and all candidate terms."""
    data = session.data
    given = {entry.id for entry in session.robots[0].effect}
    size = size_of(session.robots[0], filmed=not any(run.from_poses for run in data))
    frame = session.one_frame
    every = named_terms(
        *(_reach(session), _levels(session), session.own, size),
        one_frame=frame,
        commands_recur=session.commands_recur,
        attraction=attraction_of(session.robots[0]),
        passed_rpm=_passed_rpm(session),
        of_ground=True,
    )
    named = {effect: term for effect, term in every.items() if effect not in given}
    own = [EFFECTS[effect] for effect in session.own]
    said = {effect for item in own for effect in included_named_effects(item)}
    named = {effect: term for effect, term in named.items() if effect not in said}
    last = {} if size.full else {effect: term for effect, term in named.items() if EFFECTS[effect].of_ground}
    named = {effect: term for effect, term in named.items() if effect not in last}
    forms = free_terms(size, one_frame=frame)
    new = {form: term for form, term in forms.items() if not any(is_included_in(term, effect) for effect in own)}
    terms: dict[str, Candidate] = {**named, **new}
    progress("noise", 0.0)
    forward = Simulated(session.robots, data, {**terms, **last}, predicted_sigmas(session.known), session.start_sigma_s)
    problem, start = build_problem(data, forward, fits, progress, session.start_sigma_s)
    tolerance = visible_tolerances(problem, start, session.tolerance)
    problem = replace(problem, starts_show=show_starts(problem, start))
    own_ids = frozenset(terms).intersection(session.own)
    return Prepared(problem, start, tolerance, terms, own_ids, last, session.tolerance)


def fitted_runs(data: Sequence[RunData]) -> tuple[int, ...]:
    """Indices of the runs that are not held out."""
    aside = held_out_runs(data)
    return tuple(run for run in range(len(data)) if run not in aside)


def visible_tolerances(problem: Problem, point: Point, tolerance: Mapping[str, float]) -> dict[str, float]:
    """Tolerances of the nominal values to which these runs respond visibly: by more than UNSEEN_SIGMAS in all of them.

    The others would only add numerical noise of the derivatives to a fit. Those that act beside an effect which the
    robots do not have yet are kept.
    """
    here = acting(tolerance, problem.given)
    columns = [Column(key) for key, value in here.items() if value > 0]
    square, _ = _squares_shown(problem, point, columns)
    unseen = {
        column.key
        for column, size in zip(columns, square, strict=True)
        if not size * here[column.key] ** 2 > UNSEEN_SIGMAS**2
    }
    return {key: value for key, value in tolerance.items() if value > 0 and key not in unseen}


def show_starts(problem: Problem, point: Point) -> bool:
    """Whether the runs respond visibly to the standard deviation of their start of motion; otherwise it is not fitted.

    Clocks of computers that agree to 0.01 s have no visible influence on runs that scatter by decimetres.
    """
    return bool(_squares_shown(problem, point, ())[1] > UNSEEN_SIGMAS**2)


def _squares_shown(problem: Problem, point: Point, columns: Sequence[Column]) -> tuple[Floats, float]:
    """Squared responses to common parameters (p,) per unit, and to the starts of motion per standard deviation."""
    square, of_starts = np.zeros(len(columns)), 0.0
    for item in problem.attempted(point, columns, range(len(problem.data))):
        if item is not None:
            basis = np.linalg.qr(item.start)[0]
            both = np.column_stack([item.common, item.scatter[:, -1]])
            left = np.sum((both - basis @ (basis.T @ both)) ** 2, axis=0)
            square += left[:-1]
            of_starts += float(left[-1])
    return square, of_starts


def _reach(session: Session) -> float:
    return float(np.nanmax([np.nanmax(np.abs(run.marks_mm)) for run in session.data]))


def _levels(session: Session) -> tuple[float, ...]:
    return tuple(sorted({abs(rpm) for run in session.data for rpm in run.command}))


def _passed_rpm(session: Session) -> tuple[float, ...]:
    """Distinct values of commanded |rpm|, those of the logs of all runs included; of ramps every PASSED_S."""
    found = [np.abs([run.command for run in session.data]).ravel()]
    for run in session.data:
        if run.log is not None:
            at = run.run_command.command.at(np.arange(run.start_s, float(run.time_s[-1]), PASSED_S))
            found.append(np.abs([*run.run_command.command.knots[:, 1:].T.ravel(), *np.ravel(at)]))
    return tuple(np.unique(np.concatenate(found).round(PASSED_DIGITS)).tolist())
