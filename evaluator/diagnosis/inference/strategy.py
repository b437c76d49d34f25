"""Search over sets of effects: a linear screening of all candidates, then nonlinear fits of the promising ones.

One linearization with the derivatives of every candidate serves all singles, pairs and triples. A large misfit of the
null inflates the scatter and makes screening there inaccurate, so every promising fit is linearized again to screen
further effects.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from evaluator.diagnosis.inference.fit import LAGGING, fit_model
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.screening import Screen, screen
from evaluator.diagnosis.inference.search import LARGEST_SET, Search, fit_set
from evaluator.diagnosis.likelihood.point import Point
from evaluator.progress import Progress
from simulator.effects.coordinates import Candidate

# How many of the best by screening are fitted in full: single effects, additions to a set, pairs. Screening is linear,
# so that its best need not be the best of the fits; these fits are most of the time of a search.
SINGLES_REFITTED, ADDITIONS_REFITTED, PAIRS_FROM_NULL = 7, 3, 2
STARTS = 2  # initial values of a set
WHOLE_CHANGES_REFITTED = 2  # of a threshold between two neighbouring gaps of the commands, where the noise decides
PAIRED = 14  # offers whose pairs are screened at the null
BEAM = (2, 1)  # sets of one and of two effects that are extended
HOPELESS = 25.0  # log evidence below the best screened set, beyond which a set is not fitted
# Gain in log evidence by screening from which an addition is fitted: less than half of what it needs to be kept.
PROMISING = 2.0


def run_search(search: Search, start: Point, nominal: Point, progress: Progress, seeds: Sequence[Fit] = ()) -> None:
    """Fill search.fits with the null, the promising singles, pairs and triples.

    start: initial value of the null. nominal: the model with the values of its file, start poses aligned. seeds: fits
    of this experiment that serve as initial values instead of the null.
    """
    search.fits[frozenset()] = fit_model(search.problem, start, [], search.tolerance, search.runs)
    progress("screening", 0.1)
    for seed in seeds:
        if seed.terms:
            fit_set(search, seed.terms, seed.point.terms, seed)
    if not _is_beaten(search):
        _fit_whole_changes(search, nominal)
        if search.null.converged or not _is_beaten(search):  # otherwise screening at the null is misleading
            _from_the_null(search)
        if search.problem.horizon_s == np.inf:  # over short horizons every single effect is fitted already
            _from_the_nominal(search, nominal)
    for size in range(1, LARGEST_SET):
        if search.problem.horizon_s < np.inf and search.explained > -np.inf:
            break  # what else acts shows over a longer horizon
        sizes = [ids for ids in (*search.fits, *search.failed) if len(ids) == size and search.reached(ids)]
        beam = sorted(sizes, key=lambda ids: -search.evidence(ids))[: BEAM[size - 1]]
        beam = [
            ids
            for ids in beam
            if search.evidence(ids) > search.explained - LAGGING and _is_worth_extending(search, ids)
        ]
        for number, ids in enumerate(beam):
            extend(search, ids)
            progress(f"{size + 1} effects", 0.3 + 0.7 * (size - 1 + (number + 1) / len(beam)) / (LARGEST_SET - 1))


def _is_beaten(search: Search) -> bool:
    """Whether some set is more probable than the null, whose evidence is a lower bound if it has not converged.

    A dead band beyond all commands explains nothing and yet converges, because nothing depends on anything there.
    """
    return any(search.evidence(ids) > search.evidence(frozenset()) for ids in search.fits if ids)


def _is_worth_extending(search: Search, ids: frozenset[str]) -> bool:
    """Whether no effect of a set, alone, has a higher evidence: what is added to a useless addition is useless, too."""
    if ids not in search.fits:
        return True  # not known
    return all(search.evidence(ids) >= search.evidence(frozenset([effect])) for effect in ids)


def _fit_whole_changes(search: Search, nominal: Point) -> None:
    """Fit the single effects without a derivative, from the nominal model.

    The friction, gains and poses of the null are distorted by motion that it cannot produce, such as a robot that
    stands still though commanded to move; from there no finite change improves the fit.
    """
    stepwise = [term for term in search.terms.values() if term.stepwise]
    view = screen(search, nominal, (), stepwise)
    for effect, extra in _ordered(view, view.offers)[:WHOLE_CHANGES_REFITTED]:
        fit_set(
            search, frozenset([effect]), {effect: view.start_of((effect, extra))}, replace(search.null, point=nominal)
        )


def _from_the_null(search: Search) -> None:
    """Fit the best singles by screening at the null, and the pairs that gain more than each of their effects alone."""
    view = screen(search, search.null.point, (), search.terms.values())
    ordered = _ordered(view, view.offers)
    # over a short horizon the misfit is large and screening inaccurate, so that every single effect is fitted
    most = SINGLES_REFITTED if search.problem.horizon_s == np.inf else len(search.terms)
    _fit_asked(search, view, ordered, search.null)
    _refit(search, view, [(offer,) for offer in ordered if offer[0] not in search.asked], most, search.null)
    pairs = [pair for pair in itertools.combinations(ordered[:PAIRED], 2) if pair[0][0] != pair[1][0]]
    gain = {pair: view.evidence(*pair) - max(view.evidence(pair[0]), view.evidence(pair[1])) for pair in pairs}
    pairs = sorted((pair for pair in pairs if gain[pair] > PROMISING), key=lambda pair: -view.evidence(*pair))
    _refit(search, view, pairs, PAIRS_FROM_NULL, search.null)


def _from_the_nominal(search: Search, nominal: Point) -> None:
    """Fit the best singles by screening at the nominal model that screening at the null missed.

    The friction and gains of the null absorb part of a missing effect. If they absorb most of it, the effect hardly
    shows there, and a fit from there takes too many steps: a scrub with a log evidence 47 above the best fitted set
    gained only 1 by screening at the null.
    """
    smooth = [term for term in search.terms.values() if not term.stepwise]
    view = screen(search, nominal, (), smooth)
    ordered = _ordered(view, view.offers)
    first = list(dict.fromkeys(effect for effect, _ in ordered))[:ADDITIONS_REFITTED]
    missed = [(offer,) for offer in ordered if offer[0] in first and frozenset([offer[0]]) not in search.fits]
    _refit(search, view, missed, ADDITIONS_REFITTED, replace(search.null, point=nominal))


def extend(
    search: Search,
    ids: frozenset[str],
    among: Collection[str] | None = None,
    most: int = ADDITIONS_REFITTED,
    *,
    regardless: bool = False,
) -> None:
    """Screen additions to a fitted set, and fit at most `most` promising ones; among: candidates, by default all.

    regardless: of what they promise, each from one initial value.
    """
    fit = search.reached(ids)
    assert fit is not None
    smooth = [effect for effect in sorted(ids) if not search.terms[effect].stepwise]
    others = [term for effect, term in search.terms.items() if effect not in ids and (among is None or effect in among)]
    view = screen(search, fit.point, smooth, others)
    ordered = _ordered(view, view.offers)
    least = -np.inf if regardless else view.evidence() + PROMISING
    unasked = [offer for offer in ordered if offer[0] not in search.asked]
    worthwhile = [(offer,) for offer in unasked if view.evidence(offer) > least]
    _fit_asked(search, view, ordered, fit)
    _refit(search, view, worthwhile, most, fit, starts=1 if regardless else STARTS)
    if search.problem.horizon_s == np.inf and not search.problem.open_ground:
        _extend_without_scatter(search, fit, smooth, others)


def _extend_without_scatter(search: Search, fit: Fit, inside: Sequence[str], others: Sequence[Candidate]) -> None:
    """Fit the additions that gain by screening with nominal friction and gains of all runs, and are not fitted yet.

    The friction and gains of the fit absorb part of an effect that it lacks. If they absorb most of it, the effect
    hardly shows there: beside a toe of the wheels, a scrub gained nothing by screening at the fit, 21 without its
    friction and gains, and 38 when fitted from there. An addition that promises less than the fit itself has is not
    fitted: of 39 in 18 sessions, these were 33, and none was the best of its session; one of the other six was.
    """
    begin = replace(fit, point=fit.point.without_scatter())
    unasked = [term for term in others if not term.stepwise and term.id not in search.asked]
    try:
        view = screen(search, begin.point, inside, unasked)
    except FloatingPointError:  # runs that only their own friction lets through
        return
    base = max(view.evidence(), fit.posterior.log_evidence)
    gaining = [offer for offer in _ordered(view, view.offers) if view.evidence(offer) > base + PROMISING]
    missed = [(offer,) for offer in gaining if fit.terms | {offer[0]} not in search.fits]
    _refit(search, view, missed, ADDITIONS_REFITTED, begin)


def _fit_asked(search: Search, view: Screen, ordered: Sequence[tuple[str, tuple[int, ...]]], fit: Fit) -> None:
    """Fit user-defined effects regardless of screening, which underestimates effects with many parameters.

    They are fitted from the values of their file as well: an effect that a diagnosis proposes was found together with
    other effects, and without these a fit of its many parameters from zero may not converge.
    """
    for effect in sorted(search.asked - fit.terms):
        begin = search.terms[effect].begin
        if begin and len(fit.terms) < search.largest and not search.exhausted:
            fit_set(search, fit.terms | {effect}, {effect: begin}, fit, search.explained)
    _refit(search, view, [(offer,) for offer in ordered if offer[0] in search.asked], len(search.asked), fit)


def _ordered(view: Screen, offers: Sequence[tuple[str, tuple[int, ...]]]) -> list[tuple[str, tuple[int, ...]]]:
    return sorted(offers, key=lambda offer: -view.evidence(offer))


def _refit(
    search: Search,
    view: Screen,
    sets: Sequence[tuple[tuple[str, tuple[int, ...]], ...]],
    most: int,
    origin: Fit,
    starts: int = STARTS,
) -> None:
    """Fit the first `most` different sets, each from its `starts` best initial values.

    Once a set explains the runs, at most SINGLES_REFITTED are fitted, and those far below it end early. On open ground
    and over a short horizon the misfit of the null is large: no set is hopeless there.
    """
    tries: dict[frozenset[str], int] = {}
    top = -np.inf
    for offers in sets:
        ids = frozenset(effect for effect, _ in offers) | origin.terms
        explained = search.explained
        enough = min(most, SINGLES_REFITTED) if explained > -np.inf else most
        if search.exhausted or (len(tries) >= enough and ids not in tries):
            break
        if tries.get(ids, 0) >= starts or len(ids) > search.largest:
            continue
        evidence = view.evidence(*offers)
        top = max(top, evidence)
        accurate = not search.problem.open_ground and most < len(search.terms)
        if accurate and evidence < top - HOPELESS and len(tries) >= 3:
            break
        tries[ids] = tries.get(ids, 0) + 1
        begun = {effect: view.start_of((effect, extra)) for effect, extra in offers}
        fit_set(search, ids, begun, origin, explained)


def fit_alike(search: Search) -> None:
    """Fit the best set again from coordinates far away that act nearly alike: see Candidate.alike."""
    best = search.ranked()[0]
    for effect in sorted(best):
        alike = search.terms[effect].alike
        for start in alike(search.fits[best].point.terms[effect]) if alike else ():
            begin = search.terms[effect].clipped(start)
            fit_set(search, best, {effect: begin}, search.fits[best])
