"""The search on open ground: named effects and forms without a name together, under the noise that the best one leaves.

There what has no name may be most of the misfit, as where a drive mixes its sides. Until it is in the model, an effect
beside it, such as motors that follow late, is lost in what is left over; what stood in for it before it was there stays
beside it though it explains nothing any more; and the noise, which is made of left-overs, is that of a poor model. So
the best set is challenged from within: every effect of it is taken out and everything is tried in its place.
Source: floating search, which takes back what it has added: Pudil, Novovičová & Kittler (1994), Pattern Recognition
Letters 15, 1119.
"""

from __future__ import annotations

from collections.abc import Sequence

from evaluator.diagnosis.assessment.model_comparison import Set, is_free, score
from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.inference.search import LARGEST_SET, MOST_STEPS, RIVALS_KEPT, Search, fit_set
from evaluator.diagnosis.inference.settled_noise import settled_noise
from evaluator.diagnosis.inference.strategy import BEAM, extend
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.progress import Progress

ROUNDS = 3  # of noise; in eight subsets of two robots' recordings it had settled after one or two
EXCHANGES = 3  # sets in a row that gave way to a better one


def searched_on_ground(part: Search, whole: Search, families: int, progress: Progress) -> tuple[Search, Search]:
    """Both searches, without the runs held out and of all, when neither noise nor best set changes any more.

    whole: with the free-form terms tried instead of the named effects and beside them. families: how many there are.
    """
    for number in range(ROUNDS):
        progress("effects beside terms without a name", 0.86 + 0.03 * number)
        name_beside_free_terms(whole)
        exchange(whole, families)
        quieter = settled_noise(whole, _ranked(whole, families)[0])
        if quieter is None:
            break
        part = _under(quieter, part, [])
        whole = _under(quieter, whole, _ranked(whole, families)[:RIVALS_KEPT])
    exchange(whole, families)
    return part, whole


def name_beside_free_terms(search: Search) -> None:
    """Fit named effects beside the leading free-form terms."""
    _afford(search)
    named = {effect for effect in search.terms if not is_free(effect)}
    for size in range(1, LARGEST_SET):
        leading = [ids for ids in search.ranked() if len(ids) == size and any(map(is_free, ids))][: BEAM[size - 1]]
        for ids in leading:
            extend(search, ids, named)


def exchange(search: Search, families: int) -> None:
    """Fit everything in place of each effect of the best set, until no exchange is better; and what it stands against.

    These sets, with one effect left out, are those of the drop-one tests.
    """
    for _ in range(EXCHANGES):
        best = _ranked(search, families)[0]
        _afford(search)
        for rest in [best - {effect} for effect in sorted(best)]:
            if fit_set(search, rest, {}, search.fits[best]) or search.reached(rest):
                extend(search, rest, _untried(search, rest))
        if len(best) < LARGEST_SET:
            extend(search, best, _untried(search, best))
        if _ranked(search, families)[0] == best:
            break


def _untried(search: Search, ids: Set) -> set[str]:
    """Effects with which a set was not fitted yet."""
    return {effect for effect in search.terms if ids | {effect} not in search.fits}


def _ranked(search: Search, families: int) -> list[Set]:
    """Fitted sets, the most probable first; those with an effect at a bound, which is no answer, last."""
    return sorted(search.fits, key=lambda ids: (bool(search.fits[ids].at_bounds), -score(search, ids, families)))


def _afford(search: Search) -> None:
    """Let a search make as many steps more as a search may."""
    search.most_steps = search.steps + MOST_STEPS


def _under(problem: Problem, search: Search, leading: Sequence[Set]) -> Search:
    """The leading sets of a search, and the model without effects, fitted again under another noise."""
    found = Search(problem, search.terms, search.tolerance, search.runs)
    found.fits[frozenset()] = fit_model(problem, search.null.point, [], search.tolerance, search.runs)
    for ids in leading:
        fit_set(found, ids, {}, search.fits[ids])
    return found
