"""Gap, residuals and held-out runs of an answer, and the revised verdict if they contradict it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from evaluator.diagnosis.answer import too_few_runs
from evaluator.diagnosis.assessment.adequacy import adequacy
from evaluator.diagnosis.assessment.cross_validation import covariance_of
from evaluator.diagnosis.assessment.gap import (
    TOO_SMALL,
    Gap,
    beyond_noise,
    counting_data,
    farthest_followed,
    grown_gap,
    noise_floor,
    not_shrunk,
    other_turns,
    predicted_gaps,
    run_gaps,
)
from evaluator.diagnosis.assessment.knowledge import as_taken, knowledge, together
from evaluator.diagnosis.assessment.model_comparison import confirmation
from evaluator.diagnosis.assessment.residuals.disagreement import (
    Dependence,
    dependences,
    every_dependence,
    most_telling,
    pieces,
)
from evaluator.diagnosis.assessment.residuals.rhythm import is_of_robot, rhythm
from evaluator.diagnosis.assessment.residuals.transient import transient
from evaluator.diagnosis.assessment.residuals.unexplained import unexplained
from evaluator.diagnosis.assessment.session_as_found import as_driven, with_session
from evaluator.diagnosis.assessment.sufficiency import gathered, most_odd
from evaluator.diagnosis.assessment.verdict import undecided
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.likelihood.linear.random_effects import place_runs, place_starts
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.run_data import is_shared
from evaluator.diagnosis.mistakes.misread.judgement import unsigned_speeds
from evaluator.diagnosis.output.effect_tables import corrected_robot
from evaluator.diagnosis.result import Diagnosis
from evaluator.diagnosis.search_runs import refit_without_held_out


def reviewed(found: Diagnosis) -> Diagnosis:
    """The diagnosis with the gap before and after, on fitted and on held-out runs, and its dependences."""
    part, everything, chosen, fit = found.fit_search, found.search, found.chosen, found.fit
    assert part is not None
    assert everything is not None
    assert found.nominal is not None
    problem, runs = part.problem, range(len(found.session.data))
    by_marks = problem.of_tracking
    gap_fit = part.fits.get(chosen) or refit_without_held_out(part, everything, chosen)
    after = place_runs(by_marks, replace(gap_fit.point, per_run=fit.point.per_run), runs, fit.posterior.scatter)
    after_mm, floor_mm = run_gaps(problem, after, runs), noise_floor(problem, runs)
    # by the model of all runs, because fitted runs without a command determine its gap less well
    placed = _placed(found, fit)
    farthest = farthest_followed(problem, runs)
    outlying = tuple(np.flatnonzero(run_gaps(problem, placed, runs) > farthest).tolist())
    follows = len(outlying) <= most_odd(len(runs))
    # friction and gains of each run are meaningless if the model does not explain the marks
    before = place_starts(by_marks, Point(after.per_run) if follows else found.nominal, runs)
    # the gap is that of the robot: values common to all runs are those of the session, as in what is predicted
    of_session = {key: value for key, value in gap_fit.point.nominal.items() if is_shared(key)}
    as_recorded = place_starts(by_marks, Point(after.per_run, of_session), runs) if follows else before
    one_frame = found.session.one_frame
    seen, seen_after = (pieces(problem, point, one_frame=one_frame) for point in (before, placed))
    course = _shared_course(found, placed)
    where = (most_telling if found.verdict in ("effect", "unknown") else dependences)(seen)
    assert found.terms is not None
    terms, session = found.terms, found.session
    (before_mm, lost_before), (predicted_mm, lost_after) = (
        predicted_gaps(
            as_driven(counting_data(problem), session.known, gap_fit.point),
            [
                with_session(robot, run, session.known, gap_fit.point)
                for robot, run in zip(robots, session.data, strict=True)
            ],
            session.robots,
        )
        for robots in (session.robots, [corrected_robot(robot, terms, gap_fit.point) for robot in session.robots])
    )
    lost = lost_before | lost_after
    if problem.open_ground:
        turned = other_turns(before_mm, predicted_mm)
        before_mm[list(turned)] = predicted_mm[list(turned)] = np.nan
        lost = lost | turned
    as_recorded_mm = run_gaps(problem, as_recorded, runs)
    missed = outlying if problem.open_ground and follows else ()
    elsewhere = tuple(run for run in missed if as_recorded_mm[run] > farthest[run])
    gap = Gap(as_recorded_mm, after_mm, floor_mm, before_mm, predicted_mm, lost, elsewhere)
    found = replace(
        found,
        gap=gap.answered(added=bool(chosen)),
        confirmation=confirmation(part, gap_fit, found.held_out) if found.held_out and chosen else float("nan"),
        pieces=seen,
        where=(*filter(None, [course]), *where),
        pieces_after=seen_after,
        left=tuple(every_dependence(seen_after)),
        outlying=outlying,
        follows=follows,
        # quantities of the laboratory are meaningless, too, if the model does not explain the marks
        known=found.known if follows else tuple(as_taken(item.quantity) for item in found.known),
        known_together=found.known_together if follows else None,
    )
    if course is not None and _is_open_by_rival(found):
        return replace(found, verdict="unknown", reason=course.sentence)
    return _doubted(found, course)


def withdrawn(found: Diagnosis, reason: str) -> Diagnosis:
    """The diagnosis without its effects, which are no finding for this reason, and with what the null leaves."""
    assert found.search is not None
    fit, session = found.search.null, found.session
    covariance = covariance_of(fit, found.search.problem, found.search.tolerance)
    return reviewed(
        replace(
            found,
            verdict="insufficient",
            reason=reason,
            chosen=frozenset(),
            profiles={},
            known=knowledge(session.known, fit, covariance),
            known_together=together(fit, found.search.tolerance, covariance),
            leftover=adequacy(fit, session.data, session.relevant.speed_percent / 100),
        )
    )


def _shared_course(found: Diagnosis, placed: Point) -> Dependence | None:
    """What the residuals of all runs share: a rhythm, or a transient after changes of the command.

    placed: a model with its runs placed. A rhythm is that of the robot, unless nothing is known of what is missing.
    """
    assert found.fit_search is not None
    problem = found.fit_search.problem
    beat = rhythm(problem, placed)
    if beat is not None and (found.verdict == "unknown" or is_of_robot(problem, placed, beat)):
        return beat
    return transient(problem, placed)


def _placed(found: Diagnosis, fit: Fit) -> Point:
    """A fit with start, friction and gains of every run fitted to its marks."""
    assert found.fit_search is not None
    runs = range(len(found.session.data))
    return place_runs(found.fit_search.problem.of_tracking, fit.point, runs, fit.posterior.scatter)


def _doubted(found: Diagnosis, course: Dependence | None) -> Diagnosis:
    """The diagnosis, with verdict "unknown" or "insufficient" if residuals, gap or unexplained runs contradict it.

    course: what the residuals of all runs share, which counts as noise in the fits.
    """
    gap, search = found.gap, found.search
    assert gap is not None
    assert search is not None
    if found.verdict == "unknown" and found.chosen and (reason := not_shrunk(gap, found.held_out)):
        # a free-form term that does not predict held-out runs does not describe the missing physics
        tried = f"with {' and '.join(sorted(found.chosen))}, the nearest description, {reason}"
        return reviewed(replace(found, chosen=frozenset(), reason=f"{found.reason}; {tried}"))
    if found.verdict == "unknown" and found.chosen and not found.follows:
        lost = f"{len(found.outlying)} of the {len(found.session.data)} runs"
        return replace(found, reason=f"even the most probable model does not follow {lost} within noise")
    if found.verdict in ("unknown", "insufficient"):
        return found
    if not found.follows:
        reason = "neither the nominal model nor any effect could be fitted to the marks"
        return replace(found, verdict="unknown", reason=reason)
    reason, open_ground = "", search.problem.open_ground
    if found.verdict == "none" and not found.negligible:
        least = found.session.relevant.path_noise_floors
        missed = unexplained(found.left, search.problem, least)
        if missed and beyond_noise(search.problem, found.fit) > least:
            reason = f"significant residuals remain with all values adjusted within their tolerances: {missed.sentence}"
        elif missed:
            found = replace(found, reason=f"{found.reason}; detected, but {TOO_SMALL}: {missed.sentence}")
    elif found.verdict == "effect":
        reason = grown_gap(gap, found.held_out, found.outlying, open_ground=open_ground)
    reason = reason or _missed_command(found) or (course.sentence if course and not open_ground else "")
    few = "runs of more commands are needed" if open_ground else ""  # whose noise is that of the usual run
    if reason and (few := few or too_few_runs(search, frozenset(), found.session)):
        fitted = f"with {' and '.join(sorted(found.chosen))}, " if found.chosen else ""
        reason = f"{fitted}{reason.removeprefix('with it, ')}; {few}"
        return withdrawn(found, reason)
    return replace(found, verdict="unknown", reason=reason) if reason else found


def _is_open_by_rival(found: Diagnosis) -> bool:
    """Whether enough runs leave the verdict open only for a set that is not proven and leaves a common course, too."""
    assert found.search is not None
    assert found.standing is not None
    if found.verdict != "insufficient" or too_few_runs(found.search, frozenset(), found.session):
        return False
    rival, why = undecided(found.search, found.standing)
    return found.reason == why and _shared_course(found, _placed(found, found.search.fits[rival])) is not None


def _missed_command(found: Diagnosis) -> str:
    """Why the runs of one command contradict the chosen model; empty if runs that it does not explain are scattered."""
    runs = found.session.data
    kinds = [unsigned_speeds(run) for run in runs]
    command = gathered(found.outlying, kinds)
    if command is None:
        return ""
    alike = [run for run, kind in enumerate(kinds) if kind == command]
    missed = [runs[run].id for run in alike if run in found.outlying]
    return (
        f"the model does not explain {len(missed)} of the {len(alike)} runs with the command of {missed[0]} "
        f"({', '.join(missed)}; either direction, either side): something acts there that it lacks"
    )
