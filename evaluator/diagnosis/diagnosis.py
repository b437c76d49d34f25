"""From runs to a verdict: noise, mistakes, search, confirmation on held-out runs, and abstention."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.diagnosis.answer import answer, too_few_runs
from evaluator.diagnosis.assessment.adequacy import Adequacy
from evaluator.diagnosis.assessment.cross_validation import Constancy
from evaluator.diagnosis.assessment.disagreement import (
    Dependence,
    dependences,
    every_dependence,
    most_telling,
    pieces,
)
from evaluator.diagnosis.assessment.gap import (
    Gap,
    counting_data,
    farthest_followed,
    grown_gap,
    noise_floor,
    not_shrunk,
    predicted_gaps,
    run_gaps,
)
from evaluator.diagnosis.assessment.knowledge import Knowledge, Together, as_taken
from evaluator.diagnosis.assessment.model_comparison import (
    Set,
    Standing,
    confirmation,
    is_free,
    separations,
)
from evaluator.diagnosis.assessment.relevance import Changes
from evaluator.diagnosis.assessment.session_as_found import later_started, with_session
from evaluator.diagnosis.assessment.sole_run import is_followed, sole_gains, sole_misfit, sole_run
from evaluator.diagnosis.assessment.sufficiency import most_odd
from evaluator.diagnosis.assessment.unexplained import unexplained
from evaluator.diagnosis.assessment.verdict import Verdict
from evaluator.diagnosis.design.next_runs import NextRuns, best_next_runs
from evaluator.diagnosis.experiment import Session, shortcomings
from evaluator.diagnosis.inference.fit import Fit
from evaluator.diagnosis.inference.fit_cache import FitCache
from evaluator.diagnosis.inference.profile_likelihood import Profile, profiles_of
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.inference.watch import Cores, SearchStoppedError, Watch
from evaluator.diagnosis.likelihood.linear.random_effects import place_runs, place_starts
from evaluator.diagnosis.likelihood.problem import Point, Problem
from evaluator.diagnosis.likelihood.run_data import is_shared
from evaluator.diagnosis.likelihood.variants import varied_robot
from evaluator.diagnosis.mistakes.outlying import has_similar_runs, outlying_run
from evaluator.diagnosis.output.effect_tables import corrected_robot
from evaluator.diagnosis.search_ground import searched_on_ground
from evaluator.diagnosis.search_runs import (
    challenge_with_free_terms,
    fit_on_all_runs,
    prepared,
    refit_without_held_out,
    search_named,
)
from evaluator.progress import Progress
from simulator.effects.coordinates import Candidate

Floats = NDArray[np.float64]

RUNS_TO_AN_OUTLYING_ONE = 10  # runs of a session for each run that may be excluded; one in twenty goes wrong


@dataclass(frozen=True)
class Diagnosis:
    """Result of a diagnosis; fields that do not apply are None or empty."""

    verdict: Verdict
    reason: str
    session: Session
    held_out: tuple[int, ...] = ()
    problem: Problem | None = None
    search: Search | None = None  # over all runs
    fit_search: Search | None = None  # without the runs held out
    standing: Standing | None = None
    chosen: Set = frozenset()
    named: Set = frozenset()  # the best set of named effects
    profiles: Mapping[str, Profile] = field(default_factory=dict)  # of effects whose posterior is not normal
    separation: Mapping[str, Mapping[str, float]] | None = None
    leftover: Adequacy | None = None
    gap: Gap | None = None
    confirmation: float = float("nan")  # gain in log density of the runs held out
    terms: Mapping[str, Candidate] | None = None
    pieces: pd.DataFrame | None = None
    where: tuple[Dependence, ...] = ()
    pieces_after: pd.DataFrame | None = None  # with the residuals of the chosen model, fitted to all runs
    left: tuple[Dependence, ...] = ()  # all tested dependences of pieces_after, significant or not
    next_runs: NextRuns | None = None
    outlying: tuple[int, ...] = ()  # runs that the chosen model does not explain
    follows: bool = True  # whether the chosen model explains nearly all runs
    constancy: tuple[Constancy, ...] = ()  # of the best named effects
    changes: Mapping[str, Changes] = field(default_factory=dict)  # largest changes by each detected effect
    negligible: Set = frozenset()  # detected effects that are not relevant
    known: tuple[Knowledge, ...] = ()  # fitted values of quantities known to a tolerance
    known_together: Together | None = None  # joint test of these
    stopped: bool = False  # whether it was stopped by the time limit

    @property
    def fit(self) -> Fit:
        """The fit of the chosen set on all runs."""
        assert self.search is not None
        return self.search.fits[self.chosen]

    @property
    def summary(self) -> str:
        """The verdict in a few words."""
        return f"{self.verdict} ({', '.join(sorted(self.chosen))})" if self.chosen else self.verdict


def diagnose(
    session: Session, progress: Progress, fits: FitCache | None = None, *, seconds: float = math.inf, cores: int = 1
) -> Diagnosis:
    """Find the effect that the model of these runs lacks.

    fits: cache of fits from before an interruption. seconds: processor time after which a search is stopped with the
    verdict "insufficient". cores: for simulations; the result does not depend on them.

    If a finding depends on a single run, this run is excluded and reported as outlying, and the others are diagnosed
    again.
    """
    with Cores(cores) as each:
        return _on_all_but_sole_runs(session, Watch(progress, seconds, each), fits)


def _on_all_but_sole_runs(session: Session, watch: Watch, fits: FitCache | None) -> Diagnosis:
    """The diagnosis after exclusion of single runs on which a finding depends."""
    found = _diagnosed(session, watch, fits)
    for _ in range(max(len(session.data) // RUNS_TO_AN_OUTLYING_ONE, 1)):
        suspect = _sole_run_of(found)
        if suspect is None:
            break
        run, others = found.session.data[suspect], found.session.data[:suspect] + found.session.data[suspect + 1 :]
        alone = not has_similar_runs(run, others)  # it may be the only run in which an effect acts
        rests = f"the evidence rests on {run.id} alone, and no other run has a similar command: repeat that run"
        again = None if alone and found.verdict == "effect" else _without(found, suspect, watch, fits)
        if again is None:
            return replace(found, reason=f"{found.reason}; {rests}") if alone else found
        if alone and again.verdict == "none":
            return replace(again, verdict="insufficient", reason=f"the model is contradicted, but {rests}")
        found = again
    return found


def _without(found: Diagnosis, suspect: int, watch: Watch, fits: FitCache | None) -> Diagnosis | None:
    """The diagnosis of all runs except one; None if these do not need fewer effects.

    If the time limit is reached before, the verdict is "insufficient".
    """
    data, robots = found.session.data, found.session.robots
    others = [number for number in range(len(data)) if number != suspect]
    rest = replace(found.session, data=tuple(data[k] for k in others), robots=tuple(robots[k] for k in others))
    if shortcomings(rest.data):
        return None
    again = _diagnosed(rest, watch, fits)
    if again.stopped:
        tail = f"the finding with {data[suspect].id}, {found.summary}, rests on this run alone"
        return Diagnosis("insufficient", f"{again.reason}; {tail}", found.session, stopped=True)
    simpler = again.chosen < found.chosen or (again.chosen == found.chosen and suspect in found.outlying)
    if again.verdict not in ("none", "effect") or not (found.verdict == "unknown" or simpler):
        return None
    if _is_followed(found, again, suspect):
        more = ", ".join(sorted(found.chosen - again.chosen)) or "more than noise"
        why = f"{more} rests on this run alone; repeat it"
        return replace(again, session=replace(rest, left_out={**rest.left_out, data[suspect].id: why}))
    nominal = {key: value for key, value in again.fit.point.nominal.items() if not is_shared(key)}
    gains = None
    if found.leftover is not None and _sole_gains_of(found, found.leftover) == suspect:
        left, right = found.leftover.random_effects[found.fit.runs.index(suspect), 1:3]
        gains = float(left), float(right)
    odd = outlying_run(data[suspect], rest.data, varied_robot(robots[suspect], nominal), gains)
    return replace(again, session=replace(rest, mistakes=(*rest.mistakes, odd)))


def _is_followed(found: Diagnosis, again: Diagnosis, run: int) -> bool:
    """Whether the model fitted to the other runs also explains a run, which is then not outlying."""
    search = found.search
    assert search is not None
    return is_followed(search.problem, again.fit, found.fit.point.per_run, run, search.tolerance)


def _sole_run_of(found: Diagnosis) -> int | None:
    """The single run on which an effect depends, or without which the residuals are noise; None if there is none.

    On open ground there is none: an effect must improve the prediction of several commands, and residuals are noise.
    """
    if found.search is None or found.terms is None or found.verdict not in ("effect", "unknown"):
        return None
    if found.search.problem.open_ground:
        return None
    sole = sole_run(found.search, found.chosen, sum(map(is_free, found.terms)))
    if sole is not None:
        return sole.run
    if len(found.outlying) == 1:
        return found.outlying[0]
    if found.verdict != "unknown" or found.leftover is None:
        return None
    misfit = sole_misfit(found.leftover, found.fit.runs)
    return _sole_gains_of(found, found.leftover) if misfit is None else misfit


def _sole_gains_of(found: Diagnosis, left: Adequacy) -> int | None:
    """The only run whose wheel speeds differ significantly and relevantly from the others; None if there is none.

    Also None if the model does not explain the marks, since its wheel speeds are then meaningless.
    """
    return None if not found.follows else sole_gains(left, found.fit.runs, found.session.relevant.speed_percent)


def _diagnosed(session: Session, progress: Watch, fits: FitCache | None) -> Diagnosis:
    """The diagnosis of all runs of a session, without exclusions."""
    reasons = shortcomings(session.data, session.skipped)
    if reasons:
        reasons = [item.sentence for item in session.mistakes if item.everywhere] + reasons
        return Diagnosis("insufficient", "; ".join(reasons), session)
    try:
        return _searched(session, progress, fits)
    except SearchStoppedError as stopped:
        return Diagnosis("insufficient", str(stopped), session, stopped=True)


def _searched(session: Session, progress: Watch, fits: FitCache | None) -> Diagnosis:
    """The diagnosis of runs that are sufficient for a search."""
    ready = prepared(session, progress, fits)
    free = ready.free
    if ready.problem.open_ground:
        part, everything = searched_on_ground(ready, progress)
    else:
        part = search_named(ready, progress)
        everything = fit_on_all_runs(part, ready.terms)
        challenge_with_free_terms(everything, free, progress)
    said = answer(everything, session, free)
    progress("where and what next", 0.95)
    apart = separations(everything, said.named) if said.verdict == "effect" else {}
    found = Diagnosis(
        verdict=said.verdict,
        reason=said.reason,
        session=session,
        held_out=tuple(run for run in range(len(session.data)) if run not in part.runs),
        problem=part.problem,
        search=everything,
        fit_search=part,
        standing=said.standing,
        chosen=said.chosen,
        named=said.named,
        profiles=profiles_of(everything, said.chosen) if said.verdict == "effect" else {},
        separation=apart,
        leftover=said.leftover,
        terms=ready.terms,
        next_runs=best_next_runs(everything, said.chosen, said.standing, apart, session.known),
        constancy=said.constancy,
        changes=said.changes,
        negligible=said.negligible,
        known=said.known,
        known_together=said.known_together,
    )
    return _looked_at_again(found, ready.start)


def _looked_at_again(found: Diagnosis, nominal: Point) -> Diagnosis:
    """The diagnosis with the gap before and after, on fitted and on held-out runs, and its dependences."""
    part, everything, chosen, fit = found.fit_search, found.search, found.chosen, found.fit
    assert part is not None
    assert everything is not None
    problem, runs = part.problem, range(len(found.session.data))
    by_marks = problem.of_tracking
    gap_fit = part.fits.get(chosen) or refit_without_held_out(part, everything, chosen)
    after = place_runs(by_marks, replace(gap_fit.point, per_run=fit.point.per_run), runs, fit.posterior.scatter)
    after_mm, floor_mm = run_gaps(problem, after, runs), noise_floor(problem, runs)
    # by the model of all runs, because fitted runs without a command determine its gap less well
    placed = place_runs(by_marks, fit.point, runs, fit.posterior.scatter)
    outlying = tuple(np.flatnonzero(run_gaps(problem, placed, runs) > farthest_followed(problem, runs)).tolist())
    follows = len(outlying) <= most_odd(len(runs))
    # friction and gains of each run are meaningless if the model does not explain the marks
    before = place_starts(by_marks, Point(after.per_run) if follows else nominal, runs)
    seen = pieces(problem, before)
    seen_after = pieces(problem, placed)
    assert found.terms is not None
    terms, session = found.terms, found.session
    (before_mm, lost_before), (predicted_mm, lost_after) = (
        predicted_gaps(
            later_started(counting_data(problem), session.known, gap_fit.point),
            [with_session(robot, session.known, gap_fit.point) for robot in robots],
            session.robots,
        )
        for robots in (session.robots, [corrected_robot(robot, terms, gap_fit.point) for robot in session.robots])
    )
    lost = lost_before | lost_after
    gap = Gap(run_gaps(problem, before, runs), after_mm, floor_mm, before_mm, predicted_mm, lost)
    found = replace(
        found,
        gap=gap.answered(added=bool(chosen)),
        confirmation=confirmation(part, gap_fit, found.held_out) if found.held_out and chosen else float("nan"),
        pieces=seen,
        where=tuple((most_telling if found.verdict in ("effect", "unknown") else dependences)(seen)),
        pieces_after=seen_after,
        left=tuple(every_dependence(seen_after)),
        outlying=outlying,
        follows=follows,
        # quantities of the laboratory are meaningless, too, if the model does not explain the marks
        known=found.known if follows else tuple(map(as_taken, session.known)),
        known_together=found.known_together if follows else None,
    )
    return _doubted(found, nominal)


def _doubted(found: Diagnosis, nominal: Point) -> Diagnosis:
    """The diagnosis, with verdict "unknown" or "insufficient" if residuals, gap or unexplained runs contradict it."""
    assert found.gap is not None
    assert found.search is not None
    if found.verdict == "unknown" and found.chosen and (reason := not_shrunk(found.gap, found.held_out)):
        # a free-form term that does not predict held-out runs does not describe the missing physics
        return _looked_at_again(replace(found, chosen=frozenset(), reason=f"{found.reason}; {reason} with it"), nominal)
    if found.verdict in ("unknown", "insufficient"):
        return found
    reason = "" if found.follows else "neither the nominal model nor any effect could be fitted to the marks"
    if not found.follows:
        return replace(found, verdict="unknown", reason=reason)
    if found.verdict == "none" and not found.negligible:
        missed = unexplained(found.left, found.search.problem, found.session.relevant.path_noise_floors)
        reason = (
            f"significant residuals remain with all values adjusted within their tolerances: {missed.sentence}"
            if missed
            else ""
        )
    elif found.verdict == "effect":
        reason = grown_gap(found.gap, found.held_out)
    if reason and (few := too_few_runs(found.search, frozenset(), found.session)):
        plain = replace(found, verdict="insufficient", reason=f"{reason}; {few}", chosen=frozenset(), profiles={})
        return _looked_at_again(plain, nominal)
    return replace(found, verdict="unknown", reason=reason) if reason else found
