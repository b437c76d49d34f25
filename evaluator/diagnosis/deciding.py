"""The answer of a search over all runs, and the further fits that may change it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from evaluator.diagnosis.answer import Answer, answer
from evaluator.diagnosis.assessment.knowledge import far, knowledge
from evaluator.diagnosis.assessment.model_comparison import Set
from evaluator.diagnosis.assessment.sole_run import sole_run
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.inference.profile_likelihood import Profile, profiles_of
from evaluator.diagnosis.inference.search import Search, fit_set
from evaluator.diagnosis.inference.strategy import extend, fit_alike
from evaluator.diagnosis.inference.watch import SearchStoppedError, Watch
from evaluator.diagnosis.mistakes.outlying import has_similar_runs
from evaluator.diagnosis.search_input import Prepared
from evaluator.diagnosis.search_runs import challenge_with_free_terms, fitted_where_absent
from simulator.effects.coordinates import Candidate

LAST_STEPS = 80  # of fits of effects that are sought last: of each alone and beside another, with what may replace it
UNBELIEVED = 10.0  # times a tolerance that the runs contradict: its weight is then a hundredth
MOST_CONTRADICTED = 3  # fits without such tolerances: without one, the runs may contradict another one
MOST_RESTING = 4  # sets, one beside the other, that are found to rest on the same run


def decided(
    whole: Search, ready: Prepared, session: Session, progress: Watch
) -> tuple[Search, Answer, Mapping[str, Profile]]:
    """The answer of a search over all runs, after the fits that may change it; with the profiles of its effects."""
    everything, said = _answered(whole, session, ready.free)
    profiles = profiles_of(everything, said.chosen) if said.verdict == "effect" else {}
    if profiles and fitted_where_absent(whole, said.chosen, profiles):
        everything, said = _answered(whole, session, ready.free)
        profiles = profiles_of(everything, said.chosen) if said.verdict == "effect" else {}
    if said.verdict in ("unknown", "effect") and ready.last:
        before = said.chosen
        everything, said = _answered_with_last(everything, said, ready, session, progress)
        if said.verdict == "effect" and said.chosen != before:
            profiles = profiles_of(everything, said.chosen)
    if said.verdict in ("none", "effect") and not ready.problem.open_ground:
        freed, said = _without_contradicted(everything, said, session)
        if said.verdict == "effect" and freed is not everything:
            profiles = profiles_of(freed, said.chosen)
        everything = freed
    return everything, said, profiles


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


def _answered_with_last(
    search: Search, said: Answer, ready: Prepared, session: Session, progress: Watch
) -> tuple[Search, Answer]:
    """The search and its answer with the effects of large robots, too, which small ones have only instead of others.

    If one of them explains more, free-form terms are fitted in place of it as well. The answer stays as it is if they
    explain nothing either, or if there is no time for them.
    """
    try:
        wider = _with_last(search, ready.last, said.named)
        more = _answered(wider, session, ready.free)
        if more[1].verdict == "effect" and more[1].chosen & set(ready.last):
            challenge_with_free_terms(wider, ready.free, progress)
            more = _answered(wider, session, ready.free)
    except SearchStoppedError:
        return search, said
    return more if more[1].verdict == "effect" else (search, said)


def _with_last(search: Search, last: Mapping[str, Candidate], named: Set) -> Search:
    """The search with effects of large robots, instead of each effect of the best named set and beside all of it."""
    terms, fits, failed = {**search.terms, **last}, dict(search.fits), dict(search.failed)
    wider = replace(search, terms=terms, fits=fits, failed=failed, most_steps=search.steps + LAST_STEPS)
    for ids in dict.fromkeys([named, *(named - {effect} for effect in sorted(named)), frozenset[str]()]):
        if wider.reached(ids) is not None:
            extend(wider, ids, last)
    fit_alike(wider)
    return wider


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
