"""The search on open ground: named effects and forms without a name together, under the noise that the best one leaves.

There what has no name may be most of the misfit, as where a drive mixes its sides. Until it is in the model, an effect
beside it, such as motors that follow late, is lost in what is left over; what stood in for it before it was there stays
beside it though it explains nothing any more; and the noise, which is made of left-overs, is that of a poor model. So
sets grow from the model without effects by whatever promises most, the noise is estimated anew after every size, and
the best set is challenged from within: every effect of it is taken out and everything is tried in its place.
Source: floating search, which takes back what it has added: Pudil, Novovičová & Kittler (1994), Pattern Recognition
Letters 15, 1119.
"""

from __future__ import annotations

from collections.abc import Sequence

from evaluator.diagnosis.assessment.model_comparison import Set, score
from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.inference.search import LARGEST_SET, MOST_STEPS, RIVALS_KEPT, Search, fit_set
from evaluator.diagnosis.inference.settled_noise import settled_noise
from evaluator.diagnosis.inference.strategy import ADDITIONS_REFITTED, BEAM, SINGLES_REFITTED, extend
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.search_runs import Prepared, fitted_runs
from evaluator.progress import Progress

ROUNDS = 3  # of noise after the sets have grown; in eight subsets of two robots' recordings it settled after one or two
EXCHANGES = 3  # sets in a row that gave way to a better one
# Sets of none, of one, of two effects that grow, and additions to each that are fitted.
GROWN = ((1, SINGLES_REFITTED), *((count, ADDITIONS_REFITTED) for count in BEAM))


def searched_on_ground(ready: Prepared, progress: Progress) -> tuple[Search, Search]:
    """Searches without the runs held out and of all: of the first only the model without effects is fitted."""
    families = len(ready.free)
    every = tuple(range(len(ready.problem.data)))
    whole = Search(ready.problem, ready.terms, ready.tolerance, every, asked=ready.own)
    whole.fits[frozenset()] = fit_model(whole.problem, ready.start, [], whole.tolerance, whole.runs)
    for size, (count, additions) in enumerate(GROWN):
        progress(f"{size + 1} effects", 0.1 + 0.2 * size)
        grow(whole, families, size, count, additions)
        whole = _quieter(whole, families) or whole
    for number in range(ROUNDS):
        progress("other effects in place of each", 0.7 + 0.08 * number)
        exchange(whole, families)
        quieter = _quieter(whole, families)
        if quieter is None:
            break
        whole = quieter
    part = whole.anew(runs=fitted_runs(whole.problem.data))
    part.fits[frozenset()] = fit_model(part.problem, whole.null.point, [], part.tolerance, part.runs)
    return part, whole


def grow(search: Search, families: int, size: int, count: int, additions: int) -> None:
    """Fit the leading sets of a size, so many, with so many further effects each, with a name or without."""
    _afford(search)
    leading = [ids for ids in _ranked(search, families) if len(ids) == size][:count]
    for ids in leading:
        _extend_once(search, ids, additions)


def exchange(search: Search, families: int) -> None:
    """Fit everything in place of each effect of the best set, until no exchange is better; and what it stands against.

    These sets, with one effect left out, are those of the drop-one tests.
    """
    for _ in range(EXCHANGES):
        best = _ranked(search, families)[0]
        _afford(search)
        for rest in [best - {effect} for effect in sorted(best)]:
            if fit_set(search, rest, {}, search.fits[best]) or search.reached(rest):
                _extend_once(search, rest)
        if len(best) < LARGEST_SET:
            _extend_once(search, best)
        if _ranked(search, families)[0] == best:
            break


def _extend_once(search: Search, ids: Set, additions: int = ADDITIONS_REFITTED) -> None:
    """Fit a set with what promises most beside it; a view of all candidates costs as much as several fits."""
    if ids not in search.extended:
        search.extended.add(ids)
        extend(search, ids, {effect for effect in search.terms if ids | {effect} not in search.fits}, additions)


def _ranked(search: Search, families: int) -> list[Set]:
    """Fitted sets, the most probable first; those with an effect at a bound, which is no answer, last."""
    return sorted(search.fits, key=lambda ids: (bool(search.fits[ids].at_bounds), -score(search, ids, families)))


def _afford(search: Search) -> None:
    """Let a search make as many steps more as a search may."""
    search.most_steps = search.steps + MOST_STEPS


def _quieter(search: Search, families: int) -> Search | None:
    """The search under the noise that its best set leaves, with what leads in it; None where that is no quieter."""
    leading = _ranked(search, families)
    problem = settled_noise(search, leading[0])
    return None if problem is None else _under(problem, search, leading[:RIVALS_KEPT])


def _under(problem: Problem, search: Search, leading: Sequence[Set]) -> Search:
    """The leading sets of a search, and the model without effects, fitted again under another noise."""
    found = search.anew(problem=problem)
    found.fits[frozenset()] = fit_model(problem, search.null.point, [], search.tolerance, search.runs)
    for ids in leading:
        if ids:
            fit_set(found, ids, {}, search.fits[ids])
    return found
