"""From all runs of a session to a verdict: search, answer, review, and values that changed within the session."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from evaluator.diagnosis.assessment.model_comparison import separations
from evaluator.diagnosis.assessment.relevance import without_cancelling
from evaluator.diagnosis.changes.parted_session import parted
from evaluator.diagnosis.changes.stepped_values import with_changed_values
from evaluator.diagnosis.deciding import decided
from evaluator.diagnosis.diverging_runs import DIVERGING, diverging_runs, jumping_runs, suspected_runs
from evaluator.diagnosis.experiment import Session, shortcomings
from evaluator.diagnosis.inference.fit_cache import FitCache
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.inference.watch import SearchStoppedError, Watch
from evaluator.diagnosis.likelihood.run_data import NotSimulatedError
from evaluator.diagnosis.result import Diagnosis
from evaluator.diagnosis.review import reviewed
from evaluator.diagnosis.search_ground import null_on_ground, on_runs_except, searched_on_ground, singles_on_ground
from evaluator.diagnosis.search_input import Prepared, prepared
from evaluator.diagnosis.search_runs import (
    challenge_with_free_terms,
    fit_on_all_runs,
    refined,
    search_named,
    seeds_without,
)

NOT_DECIDED = ("unknown", "insufficient")
UNSIMULATED = (
    "the model of the robot file cannot be simulated at its command, as where a robot balances on a motion that the "
    "least disturbance ends: are both right? Then change the command a little"
)


def diagnosed(session: Session, progress: Watch, fits: FitCache | None) -> Diagnosis:
    """The diagnosis of all runs of a session, without exclusions."""
    reasons = shortcomings(session.data, session.skipped)
    if reasons:
        mistaken = ["a mistake concerns all runs"] * any(item.everywhere for item in session.mistakes)
        return Diagnosis("insufficient", "; ".join([*mistaken, *reasons]), session)
    try:
        return _with_changed_values(_searched(session, progress, fits), progress, fits)
    except SearchStoppedError as stopped:
        return Diagnosis("insufficient", str(stopped), session, stopped=True)
    except NotSimulatedError as failed:
        rest = session.leaving_out([k for k, run in enumerate(session.data) if run.id in failed.runs], UNSIMULATED)
        if shortcomings(rest.data):
            raise
        return diagnosed(rest, progress, fits)


def _with_changed_values(found: Diagnosis, progress: Watch, fits: FitCache | None) -> Diagnosis:
    """The diagnosis again, if values of the laboratory changed within the session, with them free after the change.

    The first one stays if the second is as undecided, or is about to be: what no model follows may look like a change
    of anything.
    """
    if found.search is None or found.search.problem.open_ground:
        return found
    changed = with_changed_values(found.search, found.fit, found.session, progress)
    if changed is None:
        return found
    progress("values that changed within the session", 0.1)
    if found.verdict not in NOT_DECIDED:
        return _searched(changed, progress, fits)
    try:
        again = _searched(changed, progress, fits, only_if_explained=True)
    except SearchStoppedError:
        return found
    return found if again.verdict in NOT_DECIDED else again


def _searched(
    session: Session,
    progress: Watch,
    fits: FitCache | None,
    seeds: Sequence[Fit] = (),
    *,
    only_if_explained: bool = False,
) -> Diagnosis:
    """The diagnosis of runs that are sufficient for a search; seeds: initial values from a search of more runs.

    only_if_explained: it ends as insufficient where no set of named effects explains the fitted runs.
    """
    ready = prepared(session, progress, fits)
    if ready.problem.open_ground:
        return _searched_on_ground(ready, session, progress, fits)
    part = unrefined = search_named(ready, progress, seeds)
    if diverging := part.diverging or diverging_runs(part):
        rest = session.leaving_out(diverging, DIVERGING)
        return _searched(rest, progress, fits, seeds_without(part, diverging))
    if only_if_explained and part.explained == -np.inf:
        return Diagnosis("insufficient", "no known effect explains the runs", session)
    part = refined(part, ready, progress)
    whole, imitating = without_cancelling(fit_on_all_runs(part, ready.terms))
    challenge_with_free_terms(whole, ready.free, progress)
    found = _concluded(part, whole, ready, session, progress)
    if imitating and found.verdict in NOT_DECIDED:
        found = replace(found, reason=f"{found.reason}; {imitating}")
    if found.verdict != "unknown":
        return found
    try:
        again = _without_suspected(unrefined, session, progress, fits)
    except SearchStoppedError:  # the verdict stands
        return found
    return again or _in_parts(found, progress)


def _searched_on_ground(ready: Prepared, session: Session, progress: Watch, fits: FitCache | None) -> Diagnosis:
    """The diagnosis of sufficient runs on open ground; ready: their session, prepared."""
    begun = _begun_on_ground(ready, progress, again=DIVERGING in session.left_out.values())
    if isinstance(begun, list):
        return _searched(session.leaving_out(begun, DIVERGING), progress, fits)
    found = _concluded(*searched_on_ground(begun, ready, progress), ready, session, progress)
    return _of_followed_runs(found, ready, session, progress)


def _concluded(
    part: Search, whole: Search, ready: Prepared, session: Session, progress: Watch, aside: Collection[int] = ()
) -> Diagnosis:
    """The reviewed answer of a search; part: on the fitted runs, whole: on all that decide.

    aside: runs that are neither fitted nor held out for a test.
    """
    everything, said, profiles = decided(whole, ready, session, progress)
    progress("where they disagree", 0.95)
    apart = separations(everything, said.named) if said.verdict == "effect" else {}
    return reviewed(
        Diagnosis(
            verdict=said.verdict,
            reason=said.reason,
            session=session,
            held_out=tuple(run for run in range(len(session.data)) if run not in {*part.runs, *aside}),
            problem=part.problem,
            search=everything,
            fit_search=part,
            standing=said.standing,
            chosen=said.chosen,
            named=said.named,
            profiles=profiles,
            separation=apart,
            leftover=said.leftover,
            terms={**ready.terms, **ready.last},
            constancy=said.constancy,
            changes=said.changes,
            negligible=said.negligible,
            known=said.known,
            known_together=said.known_together,
            nominal=ready.start,
        )
    )


def _of_followed_runs(found: Diagnosis, ready: Prepared, session: Session, progress: Watch) -> Diagnosis:
    """The diagnosis on open ground with its effects fitted to the runs that the model follows, if it names the same.

    A robot of a log may take another of two turns than its model. One of 36 such parts raised the noise of all to three
    times its size, and the others then said nothing against a common start 60 ms late in place of a dead time of 63.
    """
    part, whole = found.fit_search, found.search
    assert part is not None
    assert whole is not None
    if found.verdict != "effect" or not found.outlying or not found.follows:
        return found
    if shortcomings([run for number, run in enumerate(session.data) if number not in found.outlying]):
        return found
    progress("the runs that the model follows", 0.96)
    try:
        rest = on_runs_except(whole, len(ready.free), found.outlying)
        fitted = rest if part.runs == whole.runs else on_runs_except(part, len(ready.free), found.outlying)
        again = _concluded(fitted, rest, ready, session, progress, found.outlying)
    except SearchStoppedError:
        return found
    return again if again.chosen == found.chosen else found


def _begun_on_ground(ready: Prepared, progress: Watch, *, again: bool) -> list[int] | Search:
    """A search over single effects on open ground, or the runs that have to be left out before.

    again: whether runs that diverge have been left out; then only those that jump are sought.
    """
    null = null_on_ground(ready)
    odd = [] if again else diverging_runs(null)
    if odd := odd or jumping_runs(null):
        return odd
    singles = singles_on_ground(ready, progress)
    return jumping_runs(singles) or singles


def _without_suspected(part: Search, session: Session, watch: Watch, fits: FitCache | None) -> Diagnosis | None:
    """The diagnosis without runs that may diverge, of a session that no model explains; None if they are not the cause.

    part: the search over named effects.
    """
    suspected = suspected_runs(part)
    if not suspected:
        return None
    again = _searched(session.leaving_out(suspected, DIVERGING), watch, fits)
    return again if again.verdict in ("none", "effect") else None


def _in_parts(found: Diagnosis, watch: Watch) -> Diagnosis:
    """The diagnosis of an unknown disagreement, whose reason says so if it is that of two parts of the session."""
    assert found.search is not None
    try:
        watch("two parts of the session", 0.97)
        parts = parted(found.search, found.session, watch, [found.named, found.chosen, found.search.ranked()[0]])
    except SearchStoppedError:
        return found
    if parts is None:
        return found
    return replace(found, reason=parts.sentence([run.id for run in found.session.data], found.session.known))
