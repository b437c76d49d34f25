"""From all runs of a session to a verdict: search, answer, review, and values that changed within the session."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from evaluator.diagnosis.answer import Answer, answer
from evaluator.diagnosis.assessment.knowledge import far, knowledge
from evaluator.diagnosis.assessment.model_comparison import separations
from evaluator.diagnosis.assessment.relevance import without_cancelling
from evaluator.diagnosis.assessment.sole_run import (
    sole_run,
)
from evaluator.diagnosis.changes.parted_session import parted
from evaluator.diagnosis.changes.stepped_values import with_changed_values
from evaluator.diagnosis.diverging_runs import DIVERGING, diverging_runs, suspected_runs
from evaluator.diagnosis.experiment import Session, shortcomings
from evaluator.diagnosis.inference.fit_cache import FitCache
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.profile_likelihood import profiles_of
from evaluator.diagnosis.inference.search import Search, fit_set
from evaluator.diagnosis.inference.watch import SearchStoppedError, Watch
from evaluator.diagnosis.likelihood.run_data import NotSimulatedError
from evaluator.diagnosis.mistakes.outlying import has_similar_runs
from evaluator.diagnosis.result import Diagnosis
from evaluator.diagnosis.review import reviewed
from evaluator.diagnosis.search_ground import searched_on_ground
from evaluator.diagnosis.search_input import prepared
from evaluator.diagnosis.search_runs import (
    challenge_with_free_terms,
    fit_on_all_runs,
    fitted_where_absent,
    refined,
    search_named,
    seeds_without,
)
from simulator.effects.coordinates import Candidate

UNSIMULATED = (
    "the model of the robot file cannot be simulated at its command, as where a robot balances on a motion that the "
    "least disturbance ends: are both right? Then change the command a little"
)
UNBELIEVED = 10.0  # times a tolerance that the runs contradict: its weight is then a hundredth
MOST_CONTRADICTED = 3  # fits without such tolerances: without one, the runs may contradict another one
MOST_RESTING = 4  # sets, one beside the other, that are found to rest on the same run


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

    The first one stays if the second is as undecided: what no model follows may look like a change of anything.
    """
    if found.search is None or found.search.problem.open_ground:
        return found
    changed = with_changed_values(found.search, found.fit, found.session, progress)
    if changed is None:
        return found
    progress("values that changed within the session", 0.1)
    again = _searched(changed, progress, fits)
    undecided = ("unknown", "insufficient")
    return found if found.verdict in undecided and again.verdict in undecided else again


def _searched(session: Session, progress: Watch, fits: FitCache | None, seeds: Sequence[Fit] = ()) -> Diagnosis:
    """The diagnosis of runs that are sufficient for a search; seeds: initial values from a search of more runs."""
    ready = prepared(session, progress, fits)
    free, imitating = ready.free, ""
    if ready.problem.open_ground:
        part, whole = searched_on_ground(ready, progress)
        unrefined = part
    else:
        part = search_named(ready, progress, seeds)
        if diverging := part.diverging or diverging_runs(part):
            rest = session.leaving_out(diverging, DIVERGING)
            return _searched(rest, progress, fits, seeds_without(part, diverging))
        unrefined = part
        part = refined(part, ready.start, progress)
        whole, imitating = without_cancelling(fit_on_all_runs(part, ready.terms))
        challenge_with_free_terms(whole, free, progress)
    everything, said = _answered(whole, session, free)
    profiles = profiles_of(everything, said.chosen) if said.verdict == "effect" else {}
    if profiles and fitted_where_absent(whole, said.chosen, profiles):
        everything, said = _answered(whole, session, free)
        profiles = profiles_of(everything, said.chosen) if said.verdict == "effect" else {}
    if said.verdict in ("none", "effect") and not ready.problem.open_ground:
        freed, said = _without_contradicted(everything, said, session)
        if said.verdict == "effect" and freed is not everything:
            profiles = profiles_of(freed, said.chosen)
        everything = freed
    progress("where they disagree", 0.95)
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
        profiles=profiles,
        separation=apart,
        leftover=said.leftover,
        terms=ready.terms,
        constancy=said.constancy,
        changes=said.changes,
        negligible=said.negligible,
        known=said.known,
        known_together=said.known_together,
        nominal=ready.start,
    )
    found = reviewed(found)
    if imitating and found.verdict in ("unknown", "insufficient"):
        found = replace(found, reason=f"{found.reason}; {imitating}")
    if found.verdict != "unknown" or ready.problem.open_ground:
        return found
    try:
        again = _without_suspected(unrefined, session, progress, fits)
    except SearchStoppedError:  # the verdict stands
        return found
    return again or _in_parts(found, progress)


def _answered(search: Search, session: Session, free: Mapping[str, Candidate]) -> tuple[Search, Answer]:
    """The answer of a search, without effects that rest on one of several similar runs if the others explain all runs.

    A search without that run, which takes as long as the first, would end with the other effects as well. Returns the
    search without the fits of those effects, too, and of further effects and free-form terms that rest on the same run.
    """
    first = said = answer(search, session, free)
    if said.verdict != "effect" or len(said.chosen) == 1 or search.problem.open_ground:
        return search, first
    rest, sole = search, sole_run(search, said.chosen, len(free))
    suspect = None if sole is None else sole.run
    run = None if suspect is None else session.data[suspect]
    if run is None or not has_similar_runs(run, [other for other in session.data if other is not run]):
        return search, first
    for _ in range(MOST_RESTING):
        if sole is None or sole.run != suspect:
            break
        rest = replace(rest, fits={ids: fit for ids, fit in rest.fits.items() if not ids & sole.effects})
        said = answer(rest, session, free)
        sole = sole_run(rest, said.chosen, len(free)) if said.chosen else None
    if said.verdict != "effect" or not said.chosen < first.chosen:
        return search, first
    needs = " and ".join(sorted(first.chosen - said.chosen))
    why = f"{run.id} alone needs {needs} as well, because it was disturbed or shows it best: repeat it"
    return rest, replace(said, reason=f"{said.reason}; {why}")


def _without_contradicted(search: Search, said: Answer, session: Session) -> tuple[Search, Answer]:
    """The chosen set fitted without the tolerances that it contradicts, which say nothing about their values.

    With them, these values end too near to the stated ones, and others make up for it: lateral friction 34 % off, of
    two that were stated to 5 %, was told as +21 % [16, 27], with a longitudinal friction of -10 % [-16, -4].
    """
    errors = {key for run in session.data for key in run.systematic}  # of the calibration, which nobody states
    for _ in range(MOST_CONTRADICTED):
        contradicted = far(search.fits[said.chosen], session.tolerance) - errors
        wider = {key: UNBELIEVED * session.tolerance[key] for key in contradicted}
        if wider.items() <= search.tolerance.items():
            break
        looser = search.anew(tolerance={**search.tolerance, **wider})
        try:
            fit = fit_set(looser, said.chosen, {}, search.fits[said.chosen])
        except SearchStoppedError:
            break
        if fit is None:
            break
        search = replace(search, tolerance=looser.tolerance, fits={**search.fits, said.chosen: fit})
    return search, replace(said, known=knowledge(session.known, search.fits[said.chosen]))


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
