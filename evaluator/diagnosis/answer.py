"""The answer of a search: effects, their probabilities, and whether the runs suffice."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from evaluator.diagnosis.assessment.adequacy import Adequacy, adequacy
from evaluator.diagnosis.assessment.cross_validation import Constancy, constancy, covariance_of
from evaluator.diagnosis.assessment.gap import TOO_SMALL, beyond_noise
from evaluator.diagnosis.assessment.knowledge import Knowledge, Together, knowledge, together
from evaluator.diagnosis.assessment.model_comparison import Set, Standing, is_free, standing
from evaluator.diagnosis.assessment.relevance import Changes, changes
from evaluator.diagnosis.assessment.sufficiency import too_few, unusual_friction
from evaluator.diagnosis.assessment.verdict import TIE, UNDECIDED, Verdict, decide, doubts, material_gain, undecided
from evaluator.diagnosis.changes.session_changes import DRIFT, step_in_speed
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.mistakes.misread.judgement import unsigned_speeds
from evaluator.diagnosis.search_runs import name_what_is_off, rank_named
from evaluator.wording import counted
from simulator.effects.coordinates import Candidate


@dataclass(frozen=True)
class Answer:
    """A verdict with its evidence; fields as in Diagnosis."""

    verdict: Verdict
    reason: str
    chosen: Set
    named: Set
    standing: Standing
    leftover: Adequacy
    constancy: tuple[Constancy, ...]
    changes: Mapping[str, Changes]
    negligible: Set
    known: tuple[Knowledge, ...]
    known_together: Together


def answer(search: Search, session: Session, free: Mapping[str, Candidate]) -> Answer:
    """The answer of a search over all runs; free: the free-form terms that were tried."""
    table, named = rank_named(search, len(free))
    least_material = material_gain(len(search.runs)) if search.problem.open_ground else -math.inf
    chosen, verdict, reason = decide(search, table, len(free), named, least_material)
    if verdict in ("none", "effect"):
        wider = name_what_is_off(search, chosen, session.known, len(free))
        if wider != chosen:
            off = [item.quantity.name for item in knowledge(session.known, search.fits[chosen]) if item.is_finding]
            more = " and ".join(sorted(wider - chosen))
            reason = f"without {more}, the runs contradict the tolerance of: {', '.join(off)}"
            chosen, named, verdict, table = wider, wider, "effect", standing(search, len(free))
    done = {effect: changes(search.problem, search.fits[chosen], effect) for effect in chosen}
    negligible: Set = frozenset()
    if verdict == "effect" and not any(item.matter(session.relevant) for item in done.values()):
        negligible, verdict = chosen, "none"
        reason = f"the effects found ({', '.join(sorted(chosen))}) are below the limits of relevance"
    relevant_gain = session.relevant.speed_percent / 100
    left = adequacy(search.fits[chosen], session.data, relevant_gain)
    constant = constancy(search.fits[named], session.data, search.tolerance)
    reserve = ""
    if verdict != "unknown":
        material = beyond_noise(search.problem, search.fits[chosen]) > session.relevant.path_noise_floors
        reserve = doubts(left, constant, material=material, named=verdict == "effect")
        reserve = reserve or step_for_drift(search, chosen, session)
        if not reserve and not material and (small := doubts(left, ())):
            reason = f"{reason}; {small}, but {TOO_SMALL}"
    if reserve and search.problem.open_ground:
        verdict, reason = _on_ground(verdict, reason, reserve)
    elif reserve:
        verdict, (chosen, reason) = "unknown", _nearest(reserve, search, table, chosen, session)
    open_question = _undecided(search, table, session, chosen) if verdict == "effect" else ""
    reason = "; ".join(filter(None, (reason, open_question)))
    if few := _too_few(verdict, reason, search, table, chosen, session):
        verdict, reason, chosen = "insufficient", few, frozenset()
        left = adequacy(search.null, session.data, relevant_gain)
    fit = search.fits[chosen]
    covariance = covariance_of(fit, search.problem, search.tolerance)
    known = knowledge(session.known, fit, covariance)
    at_once = together(fit, search.tolerance, covariance)
    if verdict == "none" and not chosen and (at_once.is_finding or any(item.is_finding for item in known)):
        reason = "with the values that contradict their tolerance corrected, the model explains the data within noise"
    return Answer(verdict, reason, chosen, named, table, left, tuple(constant), done, negligible, known, at_once)


def _on_ground(verdict: Verdict, reason: str, reserve: str) -> tuple[Verdict, str]:
    """Verdict and reason with a reserve on open ground, where residuals always exceed the noise of the tracking.

    The noise is that of the usual run there, so that single ones exceed it, and no physics is known to be missing.
    """
    if verdict == "none":
        return "insufficient", f"{reserve}: runs of more commands are needed"
    return verdict, f"{reason}; {reserve}"


def _undecided(search: Search, table: Standing, session: Session, chosen: Set = frozenset()) -> str:
    """Why the runs do not exclude an effect beside the chosen ones that would matter; empty if they exclude all.

    An effect equivalent to a value that contradicts its tolerance is told as that value.
    """
    possible, why = undecided(search, table, chosen)
    off = [item for item in knowledge(session.known, search.fits[chosen]) if item.is_finding] if possible else []
    if possible <= {effect for item in off for effect in item.equivalent}:
        return ""
    done = (changes(search.problem, search.fits[chosen | possible], effect) for effect in possible)
    return why if any(item.matter(session.relevant) for item in done) else ""


def _hidden_by_friction(search: Search, session: Session) -> str:
    """Why friction that differs from run to run may hide an effect from a model without any; empty if it does not."""
    if search.problem.open_ground:
        return ""
    runs = [session.data[run] for run in search.null.runs]
    order = np.array([run.order for run in runs], dtype=float)
    return unusual_friction(adequacy(search.null, session.data), order, [run.command for run in runs])


def _nearest(reserve: str, search: Search, table: Standing, chosen: Set, session: Session) -> tuple[Set, str]:
    """The best set with a free-form term, and the reason, which says so if it explains too little.

    reserve: why the chosen set is no answer. It stays where no free-form term was fitted. Effects alone that are
    certainly more probable than with any such term are nearer to the truth.
    """
    nearest = next((ids for ids in table.sets if any(map(is_free, ids))), None)
    if nearest is None:
        return chosen, reserve
    best = table.sets[0]
    if best and table.of(best) - table.of(nearest) > UNDECIDED:
        return best, reserve
    still = doubts(adequacy(search.fits[nearest], session.data, session.relevant.speed_percent / 100), ())
    if still and re.sub(r"[\d.]+", "", still) == re.sub(r"[\d.]+", "", reserve):  # the same, with another number
        return nearest, f"{reserve}, with the free-form term as well"
    return nearest, f"{reserve}; with the free-form term, {still}" if still else reserve


def step_for_drift(search: Search, chosen: Set, session: Session) -> str:
    """A single step of the speed that the chosen set approximates by a drift, in words; empty if there is none.

    The fit without the drift is asked, too. With it, values within their tolerances (marks that are off sideways make
    left turns slower and right turns faster) adjust until the speeds of the runs follow a line.
    """
    if DRIFT not in chosen:
        return ""
    fits = [search.fits[ids] for ids in (chosen, chosen - {DRIFT}) if ids in search.fits]
    said = (step_in_speed(fit, adequacy(fit, session.data), session.data) for fit in fits)
    return next(filter(None, said), "")


def _too_few(verdict: Verdict, reason: str, search: Search, table: Standing, ids: Set, session: Session) -> str:
    """Why the runs are insufficient for a verdict and its reason; empty if they suffice."""
    if verdict == "none":
        return "" if ids else _undecided(search, table, session) or _hidden_by_friction(search, session)
    if verdict == "unknown" and (few := too_few_runs(search, ids, session)):
        return f"{reason}; {few}"
    return too_few_commands(search, ids, session) if verdict == "effect" else ""


def too_few_commands(search: Search, ids: Set, session: Session) -> str:
    """Why the commands are too few to test a set of effects; empty if they suffice.

    A law with as many parameters as there are commands passes through any steady motion of these, however often they
    are repeated. It is no answer if a free-form term, by another law, explains the runs as well.
    """
    commands = {unsigned_speeds(run) for run in session.data}
    parameters = sum(search.terms[effect].size for effect in ids)
    if search.problem.open_ground or len(commands) > parameters:
        return ""
    least = search.evidence(ids) - TIE
    forms = [other for other in search.fits if any(map(is_free, other)) and not ids <= other]
    if not any(search.evidence(other) > least for other in forms):
        return ""
    return (
        f"{' and '.join(sorted(ids))} would explain the runs, but those of {counted(len(commands), 'command')} do not "
        f"test a law of {counted(parameters, 'parameter')}, and a free-form term explains them as well: drive other "
        "ratios of the wheel speeds"
    )


def too_few_runs(search: Search, ids: Set, session: Session) -> str:
    """Why the runs are too few for the verdict "unknown"; empty if they suffice.

    ids: the set that would explain the disagreement.
    """
    parameters = sum(search.terms[effect].size for effect in ids if is_free(effect))
    law = adequacy(search.fits[ids], session.data) if parameters and ids in search.fits else None
    return too_few(adequacy(search.null, session.data), max(parameters, 1), law)
