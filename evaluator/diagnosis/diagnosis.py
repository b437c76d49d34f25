"""From runs to a verdict: the diagnosis of all runs, and exclusion of single runs on which a finding depends."""

from __future__ import annotations

import math
from dataclasses import replace

from evaluator.diagnosis.assessment.model_comparison import is_free
from evaluator.diagnosis.assessment.sole_run import (
    hiding_run,
    is_followed,
    is_needed_without,
    sole_gains,
    sole_misfit,
    sole_run,
)
from evaluator.diagnosis.design.next_runs import best_next_runs
from evaluator.diagnosis.experiment import Session, shortcomings
from evaluator.diagnosis.inference.fit import EXCESS
from evaluator.diagnosis.inference.fit_cache import FitCache
from evaluator.diagnosis.inference.limits import limits
from evaluator.diagnosis.inference.watch import Cores, Watch
from evaluator.diagnosis.likelihood.run_data import RunData, is_shared
from evaluator.diagnosis.likelihood.variants import varied_robot
from evaluator.diagnosis.mistakes.explained import without_explained_mistakes
from evaluator.diagnosis.mistakes.outlying import has_similar_runs, outlying_run, turns_like_others
from evaluator.diagnosis.result import Diagnosis
from evaluator.diagnosis.review import withdrawn
from evaluator.diagnosis.session_diagnosis import diagnosed
from evaluator.progress import Progress

ONLY_THERE = "no other run has a similar command, so that an effect may act there alone: repeat it"
RUNS_TO_AN_OUTLYING_ONE = 10  # runs of a session for each run that may be excluded; one in twenty goes wrong


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
        found = _on_all_but_sole_runs(session, Watch(progress, seconds, each), fits)
        return _completed(without_explained_mistakes(found), progress)


def _completed(found: Diagnosis, progress: Progress) -> Diagnosis:
    """The final diagnosis with what the runs exclude, and with the runs to record next.

    These take as long as a dozen fits. They are no part of the search and are not stopped by its time limit.
    """
    if found.search is None or found.standing is None:
        return found
    progress("what the runs exclude", 0.97)
    excluded = limits(found.search, found.chosen) if found.verdict in ("none", "effect") else ()
    progress("what to record next", 0.98)
    apart = found.separation or {}
    runs = best_next_runs(found.search, found.chosen, found.standing, apart, found.session.known)
    return replace(found, limits=excluded, next_runs=runs)


def _on_all_but_sole_runs(session: Session, watch: Watch, fits: FitCache | None) -> Diagnosis:
    """The diagnosis after exclusion of single runs on which a finding depends, or that hide one."""
    found = diagnosed(session, watch, fits)
    for _ in range(max(len(session.data) // RUNS_TO_AN_OUTLYING_ONE, 1)):
        suspect = _sole_run_of(found)
        hides = suspect is None
        suspect = _hiding_run_of(found) if suspect is None else suspect
        if suspect is None:
            break
        run, others = found.session.data[suspect], found.session.data[:suspect] + found.session.data[suspect + 1 :]
        only = not has_similar_runs(run, others)  # it may be the only run in which an effect acts
        alone = only and not hides
        rests = f"rests on {run.id} alone, and no other run has a similar command: repeat that run"
        named = found.verdict == "effect"
        if alone and named and _denied_elsewhere(found) is None:
            return replace(found, reason=f"{found.reason}; the evidence {rests}")
        again = _without(found, suspect, watch, fits, hides=hides, only=only)
        if again is None:  # the others do not need fewer effects; named ones that they deny are no finding, either
            return withdrawn(found, _contradicted(found, rests)) if alone and named else found
        if alone and again.verdict == "none" and not _is_of_other_run(run, again):
            return replace(again, verdict="insufficient", reason=_contradicted(found, rests))
        if again.verdict == "effect" and not again.chosen <= found.chosen and not turns_like_others(run, others):
            rests = f"explains all runs but {run.id}, the only one that turns this way: repeat that run"
            return replace(found, reason=f"{found.reason}; {', '.join(sorted(again.chosen))} {rests}")
        found = again
    else:  # as many runs are excluded as may go wrong
        denied = _denied_elsewhere(found) if found.verdict == "effect" else None
        if denied is not None:
            rests = f"rests on {denied} alone, and others are left out already: repeat these runs"
            return withdrawn(found, _contradicted(found, rests))
    return found


def _is_of_other_run(run: RunData, found: Diagnosis) -> bool:
    """Whether a run that is left out moves exactly as by another command of the session, which no effect does."""
    said = (item for item in found.session.mistakes if item.runs == (run.id,))
    return any(item.kind == "wrong-command" and item.corrections for item in said)


def _contradicted(found: Diagnosis, rests: str) -> str:
    """Why a finding is none; rests: a clause about the run on which its evidence rests."""
    named = f" for {', '.join(sorted(found.chosen))}" if found.verdict == "effect" else ""
    return f"the model is contradicted, but the evidence{named} {rests}"


def _without(
    found: Diagnosis,
    suspect: int,
    watch: Watch,
    fits: FitCache | None,
    *,
    hides: bool,
    only: bool,
) -> Diagnosis | None:
    """The diagnosis of all runs except one; None if these do not need fewer effects, unless it hides effects.

    only: whether no other run drives similarly; it is said of a run that hides effects.
    If the time limit is reached before, the verdict is "insufficient".
    """
    data, robots = found.session.data, found.session.robots
    rest = found.session.of_runs([number for number in range(len(data)) if number != suspect])
    assert found.search is not None
    forms = _free_forms(found)
    if shortcomings(rest.data) or (not hides and is_needed_without(found.search, found.chosen, suspect, forms)):
        return None
    again = diagnosed(rest, watch, fits)
    rest = again.session  # runs that diverge are left out as well
    if again.stopped:
        tail = f"the finding with {data[suspect].id}, {found.summary}, rests on this run alone"
        return Diagnosis("insufficient", f"{again.reason}; {tail}", found.session, stopped=True)
    simpler = again.chosen < found.chosen or (again.chosen == found.chosen and suspect in found.outlying)
    decided = again.verdict in ("none", "effect") and (found.verdict == "unknown" or simpler)
    if not (hides or decided or (found.verdict == "unknown" and _is_only_undecided(again))):
        return None
    if _is_followed(found, again, suspect):
        more = ", ".join(sorted(found.chosen - again.chosen))
        needs = f"it alone needs {more}, because it was disturbed or shows the effect best" if more else ""
        why = f"{needs or 'more than noise in it alone'}; repeat it"
        return replace(again, session=replace(rest, left_out={**rest.left_out, data[suspect].id: why}))
    nominal = {key: value for key, value in again.fit.point.nominal.items() if not is_shared(key)}
    gains = None
    if found.leftover is not None and (hides or _sole_gains_of(found) == suspect):
        left, right = found.leftover.random_effects[found.fit.runs.index(suspect), 1:3]
        gains = float(left), float(right)
    odd = outlying_run(data[suspect], rest.data, varied_robot(robots[suspect], nominal), gains)
    if only and (hides or again.verdict == "effect"):
        odd = replace(odd, sentence=f"{odd.sentence}; {ONLY_THERE}")
    return replace(again, session=replace(rest, mistakes=(*rest.mistakes, odd)))


def _is_only_undecided(found: Diagnosis) -> bool:
    """Whether runs that decide nothing leave noise without an effect: what contradicts them is no missing physics."""
    no_more = found.verdict == "insufficient" and not found.chosen and not found.outlying
    return no_more and found.leftover is not None and found.leftover.excess <= EXCESS


def _is_followed(found: Diagnosis, again: Diagnosis, run: int) -> bool:
    """Whether the model fitted to the other runs also explains a run, which is then not outlying.

    The tolerances are those of that fit: the others may show a nominal value that they do not show with the run.
    """
    assert found.search is not None
    assert again.search is not None
    tolerance = again.search.tolerance
    return is_followed(found.search.problem, again.fit, found.fit.point.per_run, run, tolerance)


def _sole_run_of(found: Diagnosis) -> int | None:
    """The single run on which an effect depends, or without which the residuals are noise; None if there is none.

    On open ground there is none: an effect must improve the prediction of several commands, and residuals are noise.
    """
    if found.search is None or found.terms is None or found.verdict not in ("effect", "unknown"):
        return None
    if found.search.problem.open_ground:
        return None
    sole = sole_run(found.search, found.chosen, _free_forms(found))
    if sole is not None:
        return sole.run
    if len(found.outlying) == 1:
        return found.outlying[0]
    if found.verdict != "unknown" or found.leftover is None:
        return None
    misfit = sole_misfit(found.leftover, found.fit.runs)
    return _sole_gains_of(found) if misfit is None else misfit


def _free_forms(found: Diagnosis) -> int:
    """Number of free-form terms that a diagnosis tried."""
    return sum(map(is_free, found.terms or {}))


def _denied_elsewhere(found: Diagnosis) -> str | None:
    """The id of the single run on which effects depend, if the others make them less probable than their absence.

    Then no other run shows a trace of them: a law that fits one disturbed run by chance, or acts there alone.
    """
    assert found.search is not None
    sole = sole_run(found.search, found.chosen, _free_forms(found))
    return found.session.data[sole.run].id if sole is not None and sole.without <= 0.0 else None


def _sole_gains_of(found: Diagnosis) -> int | None:
    """The only run whose wheel speeds differ significantly and relevantly from the others; None if there is none.

    Also None if the model does not explain the marks, since its wheel speeds are then meaningless.
    """
    if found.leftover is None or not found.follows:
        return None
    return sole_gains(found.leftover, found.fit.runs, found.session.relevant.speed_percent)


def _hiding_run_of(found: Diagnosis) -> int | None:
    """The run whose wheel speeds hide effects of all others; None if there is none or the model does not explain it."""
    if found.search is None or found.leftover is None or not found.follows or found.search.problem.open_ground:
        return None
    return hiding_run(found.leftover, found.fit.runs, found.session.relevant.speed_percent)
