"""Search over sets of effects: a linear screening of everything, then full fits of what is promising.

One linearization with every candidate's derivatives serves all singles, pairs and triples. A misfit that is large
inflates the scatter and blurs the view from the null, so every promising fit is linearized again and asked what to add.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from evaluator.diagnosis.inference.fit import LAGGING, Fit, fit_model
from evaluator.diagnosis.inference.screening import Screen, screen
from evaluator.diagnosis.inference.search import LARGEST_SET, Search, fit_set
from evaluator.diagnosis.likelihood.problem import Point
from evaluator.progress import Progress

SINGLES_REFITTED = 7
ADDITIONS_REFITTED = 3
PAIRS_FROM_NULL = 2
WHOLE_CHANGES_REFITTED = 2  # two neighbouring gaps between commands: the noise decides
PAIRED = 14  # offers whose pairs are screened at the null
BEAM = (2, 1)  # sets of one, of two effects from which the search goes on
HOPELESS = 25.0  # a screened set this far (log evidence) below the best is not refitted
# An addition must promise this much evidence to be fitted: less than half of what it must bring to be kept.
PROMISING = 2.0


def run_search(search: Search, start: Point, nominal: Point, progress: Progress, seeds: Sequence[Fit] = ()) -> None:
    """Fill search.fits with the null, the promising singles, pairs and triples.

    start: of the null. nominal: the model as its file says, start poses aligned. seeds: fits of this experiment that
    are near already; the search then goes on from them, not from the null.
    """
    search.fits[frozenset()] = fit_model(search.problem, start, [], search.tolerance, search.runs)
    progress("screening", 0.1)
    for seed in seeds:
        if seed.terms:
            fit_set(search, seed.terms, seed.point.terms, seed)
    if len(search.fits) == 1:
        _fit_whole_changes(search, nominal)
        if len(search.fits) == 1 or search.null.converged:  # else it is no view: it did not settle
            _from_the_null(search)
        if search.problem.horizon_s == np.inf:  # else every single effect was fitted
            _from_the_nominal(search, nominal)
    for size in range(1, LARGEST_SET):
        sizes = [ids for ids in (*search.fits, *search.failed) if len(ids) == size and search.reached(ids)]
        beam = sorted(sizes, key=lambda ids: -search.evidence(ids))[: BEAM[size - 1]]
        beam = [ids for ids in beam if search.evidence(ids) > search.explained - LAGGING]
        for number, ids in enumerate(beam):
            extend(search, ids)
            progress(f"{size + 1} effects", 0.3 + 0.7 * (size - 1 + (number + 1) / len(beam)) / (LARGEST_SET - 1))


def _fit_whole_changes(search: Search, nominal: Point) -> None:
    """Fit the single effects without a derivative from the nominal model.

    There the data want the whole change or none. The null has bent friction, gains and poses to what it cannot
    do, a robot that stands still where it should move, and from there no whole change looks right.
    """
    stepwise = [term for term in search.terms.values() if term.stepwise]
    view = screen(search, nominal, (), stepwise)
    for effect, extra in _ordered(view, view.offers)[:WHOLE_CHANGES_REFITTED]:
        fit_set(
            search, frozenset([effect]), {effect: view.start_of((effect, extra))}, replace(search.null, point=nominal)
        )


def _from_the_null(search: Search) -> None:
    """Fit the singles that the linear view from the null promises, and the pairs that gain by being together."""
    view = screen(search, search.null.point, (), search.terms.values())
    ordered = _ordered(view, view.offers)
    # over a short horizon the misfit is large and the linear view a poor guide: there every single effect is fitted
    most = SINGLES_REFITTED if search.problem.horizon_s == np.inf else len(search.terms)
    _fit_asked(search, view, ordered, search.null)
    _refit(search, view, [(offer,) for offer in ordered if offer[0] not in search.asked], most, search.null)
    pairs = [pair for pair in itertools.combinations(ordered[:PAIRED], 2) if pair[0][0] != pair[1][0]]
    gain = {pair: view.evidence(*pair) - max(view.evidence(pair[0]), view.evidence(pair[1])) for pair in pairs}
    pairs = sorted((pair for pair in pairs if gain[pair] > PROMISING), key=lambda pair: -view.evidence(*pair))
    _refit(search, view, pairs, PAIRS_FROM_NULL, search.null)


def _from_the_nominal(search: Search, nominal: Point) -> None:
    """Fit the singles that the model as its file says wants most, where the view from the null passed them over.

    The null has bent friction and gains of the runs to what it cannot do. Where that nearly explains them, what bends
    them hardly shows in its view, and steps from there are too many: a scrub that explained the runs without any
    scatter, by 47 of log evidence more than the best that was fitted, promised 1 from the null.
    """
    smooth = [term for term in search.terms.values() if not term.stepwise]
    view = screen(search, nominal, (), smooth)
    ordered = _ordered(view, view.offers)
    first = list(dict.fromkeys(effect for effect, _ in ordered))[:ADDITIONS_REFITTED]
    missed = [(offer,) for offer in ordered if offer[0] in first and frozenset([offer[0]]) not in search.fits]
    _refit(search, view, missed, ADDITIONS_REFITTED, replace(search.null, point=nominal))


def extend(
    search: Search, ids: frozenset[str], among: Collection[str] | None = None, most: int = ADDITIONS_REFITTED
) -> None:
    """Linearize at a fitted set, and fit it with the most promising additions, so many; among: all, or these."""
    fit = search.reached(ids)
    assert fit is not None
    smooth = [effect for effect in sorted(ids) if not search.terms[effect].stepwise]
    others = [term for effect, term in search.terms.items() if effect not in ids and (among is None or effect in among)]
    view = screen(search, fit.point, smooth, others)
    ordered = _ordered(view, view.offers)
    base = view.evidence()
    unasked = [offer for offer in ordered if offer[0] not in search.asked]
    worthwhile = [(offer,) for offer in unasked if view.evidence(offer) > base + PROMISING]
    _fit_asked(search, view, ordered, fit)
    _refit(search, view, worthwhile, most, fit)


def _fit_asked(search: Search, view: Screen, ordered: Sequence[tuple[str, tuple[int, ...]]], fit: Fit) -> None:
    """Fit what the user asks for, whatever the linear view promises of it: of many numbers it promises little.

    It is fitted from where its file says as well. What a diagnosis offers as an own effect was found beside other
    effects, and from nought, without these, a fit of its many numbers may not find its way.
    """
    for effect in sorted(search.asked - fit.terms):
        begin = search.terms[effect].begin
        if begin and len(fit.terms) < search.largest and not search.exhausted:
            fit_set(search, fit.terms | {effect}, {effect: begin}, fit, search.explained)
    _refit(search, view, [(offer,) for offer in ordered if offer[0] in search.asked], len(search.asked), fit)


def _ordered(view: Screen, offers: Sequence[tuple[str, tuple[int, ...]]]) -> list[tuple[str, tuple[int, ...]]]:
    return sorted(offers, key=lambda offer: -view.evidence(offer))


def _refit(
    search: Search, view: Screen, sets: Sequence[tuple[tuple[str, tuple[int, ...]], ...]], most: int, origin: Fit
) -> None:
    """Fit the first so many different sets, each from its two best starting places.

    Once one explains the runs, no more than usual are fitted, and only as far as they come near it.
    """
    tries: dict[frozenset[str], int] = {}
    top = -np.inf
    for offers in sets:
        ids = frozenset(effect for effect, _ in offers) | origin.terms
        explained = search.explained
        enough = min(most, SINGLES_REFITTED) if explained > -np.inf else most
        if search.exhausted or (len(tries) >= enough and ids not in tries):
            break
        if tries.get(ids, 0) >= 2 or len(ids) > search.largest:
            continue
        evidence = view.evidence(*offers)
        top = max(top, evidence)
        if evidence < top - HOPELESS and len(tries) >= 3 and most < len(search.terms):
            break
        tries[ids] = tries.get(ids, 0) + 1
        starts = {effect: view.start_of((effect, extra)) for effect, extra in offers}
        fit_set(search, ids, starts, origin, explained)
