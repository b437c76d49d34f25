"""The searches of a diagnosis: effects without the held-out runs, the best sets on all runs, free-form terms."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from evaluator.diagnosis.assessment.knowledge import knowledge
from evaluator.diagnosis.assessment.model_comparison import Set, Standing, is_free, score, separations, standing
from evaluator.diagnosis.assessment.verdict import UNDECIDED, best_named, least_gain
from evaluator.diagnosis.diverging_runs import diverging_beyond
from evaluator.diagnosis.inference.fit import LAGGING, fit_model
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.profile_likelihood import Profile
from evaluator.diagnosis.inference.screening import screen
from evaluator.diagnosis.inference.search import LARGEST_SET, RIVALS_KEPT, Search, fit_set, log_prior
from evaluator.diagnosis.inference.settled_noise import common_noise, settled_noise, with_common_drift
from evaluator.diagnosis.inference.short_horizon import is_implausible, is_large, recalibrated, short_horizon_fits
from evaluator.diagnosis.inference.strategy import HOPELESS, extend, fit_alike, run_search
from evaluator.diagnosis.likelihood.known_to import Quantity
from evaluator.diagnosis.likelihood.noise.common_drift import MIDDLE, CommonNoise, usual_drift
from evaluator.diagnosis.likelihood.noise.friction_wander import USUAL_WANDER
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.preparation import with_noise_of
from evaluator.diagnosis.search_input import Prepared, fitted_runs, visible_tolerances
from evaluator.progress import Progress
from simulator.effects.coordinates import Candidate

SWAP_SIGMAS = 10.0  # an effect within so many sigmas of one of the best set may replace it where it is nonlinear
SWAPS = 4  # most such replacements to fit, nearest first; each costs a fit
FREE_REFITTED, FREE_HOPELESS = 8, 3  # most free-form terms to fit; consecutive ones far below the best that end it
NEARER = 0.5  # of the size of an effect: a profile on which it is smaller leads to where it may be absent
PROMISING_FREE = 6.0  # gain in log evidence from which a free-form term is fitted; its prior costs eight


def rank_named(search: Search, families: int) -> tuple[Standing, Set]:
    """Scores of all sets, and the best named set in which every effect is significant.

    The set without an effect, with which it is compared, is fitted from the parameters of the whole set as well:
    otherwise a different start pose of a single run may appear as evidence for an effect of size zero.
    """
    table = standing(search, families)
    best = best_named(search, table, families)
    for _ in range(LARGEST_SET):
        before = best
        for effect in sorted(best):
            fit_set(search, best - {effect}, {}, search.fits[best], search.explained)
        table = standing(search, families)
        best = best_named(search, table, families)
        if best == before:
            break
    return table, best


def search_named(ready: Prepared, progress: Progress, seeds: Sequence[Fit] = ()) -> Search:
    """The search over named effects on all runs that are not held out; seeds: of `seeds_without`.

    It ends after the first seconds of the runs if some of them diverge later.
    """
    part, begin, large = _begun(ready, fitted_runs(ready.problem.data))
    if large or seeds:
        drift = usual_drift(part.problem.field_of_view)
        usual = replace(part.problem, common_drift=drift, friction_wander=USUAL_WANDER)
        part = replace(part, problem=with_noise_of(usual, begin))
    else:
        part, begin = _with_drift(part, begin)
    if large and not seeds:
        seeds = short_horizon_fits(part, ready.start, progress)
        if diverging := diverging_beyond(part, seeds):
            return replace(part, fits={seed.terms: seed for seed in seeds}, diverging=tuple(diverging))
    run_search(part, begin, ready.start, progress, seeds)
    return part


def seeds_without(part: Search, runs: Collection[int]) -> list[Fit]:
    """The best fits of a search that explains its runs, as initial values of a search without some of the runs.

    Empty if it does not explain them: what the runs did to it is then unknown, and the others are searched anew.
    """
    if part.explained == -np.inf:
        return []
    keep = [run for run in range(len(part.problem.data)) if run not in runs]
    points = [(fit, replace(fit.point, per_run=fit.point.per_run[keep])) for fit in part.initial(RIVALS_KEPT)]
    return [replace(fit, point=point) for fit, point in points if fit.terms]


def null_alone(ready: Prepared) -> tuple[Search, Fit | None]:
    """A search of all runs with their noise, and the model without effects; None if its misfit is large.

    Raises FloatingPointError if a run cannot be simulated.
    """
    part, begin, large = _begun(ready, range(len(ready.problem.data)))
    if large:
        return part, None
    part, begin = _with_drift(part, begin)
    return part, fit_model(part.problem, begin, [], part.tolerance, part.runs)


def _begun(ready: Prepared, runs: Sequence[int]) -> tuple[Search, Point, bool]:
    """A search of some runs, its initial point, and whether the misfit there is too large for fits of whole runs."""
    part = Search(ready.problem, ready.named, ready.tolerance, tuple(runs), asked=ready.own)
    if not is_large(part.problem, ready.start):
        return part, ready.start, False
    begin = recalibrated(part.problem, ready.start, ready.tolerance)
    part = replace(part, problem=with_noise_of(part.problem, begin))
    return part, begin, is_large(part.problem, begin) or is_implausible(begin)


def refined(part: Search, ready: Prepared, progress: Progress) -> Search:
    """The search with the noise of its best model, and with fits of effects that may replace one of it."""
    fit_alike(part)
    part = _with_settled_noise(part, ready, progress)
    fit_alike(part)
    _swap(part)
    return part


def _with_drift(part: Search, begin: Point) -> tuple[Search, Point]:
    """The search with the common drift of both marks from the residuals of the null, and its initial point.

    Drift is estimated before any effect is added, because effects would otherwise explain it. If the misfit of the null
    is large, a typical drift is assumed, and it is estimated once a model explains the runs.
    """
    drifting = replace(part.problem, common_drift=usual_drift(part.problem.field_of_view))
    usual = replace(part, problem=with_noise_of(drifting, begin))
    null = fit_model(usual.problem, begin, [], usual.tolerance, usual.runs)
    problem = with_common_drift(usual, null)
    return replace(part, problem=with_noise_of(problem, null.point)), null.point


def _with_settled_noise(part: Search, ready: Prepared, progress: Progress) -> Search:
    """The search with the noise from the residuals of its best model, repeated if a misfit had inflated the noise.

    Its initial values are the best fits so far: with less noise a misfit amounts to more sigmas, and a fit from the
    null, or from the friction and gains of another model, may not converge again. The best single effects are among
    them. Where one run kept all fits from their minimum, the best four sets were additions to a drag, and the true
    scrub was not fitted again.
    """
    for _ in range(2):
        best, common = well_founded(part)
        problem = settled_noise(part, best, common)
        if problem is None:
            break
        ranked, null = part.ranked(), part.null.point
        singles = [ids for ids in ranked if len(ids) == 1]
        seeds = [part.fits[ids] for ids in dict.fromkeys([*singles[:RIVALS_KEPT], *ranked[:RIVALS_KEPT]])]
        # noise that a misfit had inflated hid values that the runs do respond to, and an effect took their place
        part = part.anew(problem=problem, tolerance=visible_tolerances(problem, null, ready.stated))
        run_search(part, null, ready.start, progress, seeds)
    return part


def well_founded(part: Search) -> tuple[Set, CommonNoise | None]:
    """The best set in which each effect is significant even if the noise is that of the set without it, and its noise.

    Noise may not be taken from a set with an effect that is not significant: such an effect imitates drift or varying
    friction of this session, noise estimated beside it lacks them, and with that noise it would seem significant. In an
    experiment on an unevenly clean plate, a stray magnet gained 6 by the first noise and 33 by that of its own set.
    """
    best = part.ranked()[0]
    noise: dict[Set, CommonNoise] = {}

    def score_of(ids: Set) -> float:
        if ids not in noise:
            begin = noise[best].place if best in noise else MIDDLE
            noise[ids] = common_noise(part, part.fits[ids], begin)
        return noise[ids].log_evidence + log_prior(len(ids), len(part.terms))

    while best:
        for effect in sorted(best):
            fit_set(part, best - {effect}, {}, part.fits[best], part.explained)
        fitted = [ids for effect in sorted(best) if (ids := best - {effect}) in part.fits]
        rest = [ids for ids in fitted if part.score(best) - part.score(ids) < LAGGING]
        if not rest or score_of(best) - max(map(score_of, rest)) >= least_gain(best):
            break
        best = max(rest, key=score_of)
    return best, noise.get(best)


def _swap(part: Search) -> None:
    """Fit effects that may replace one of the best set, because screening misses nonlinear effects such as sticking.

    Effects without a derivative are omitted: there are no initial values for them, and the search tries them anyway.
    """
    best = part.ranked()[0]
    for effect, others in (separations(part, best, 0) if best else {}).items():
        smooth = {other: sigmas for other, sigmas in others.items() if other and not part.terms[other].stepwise}
        near = sorted((sigmas, other) for other, sigmas in smooth.items() if sigmas < SWAP_SIGMAS)
        for _, other in near[:SWAPS]:
            ids = best - {effect} | {other}
            if ids not in part.fits and ids not in part.failed and not part.exhausted:
                fit_set(part, ids, {}, part.null if len(ids) == 1 else part.fits[best], part.explained)


def fit_on_all_runs(part: Search, terms: Mapping[str, Candidate]) -> Search:
    """The best sets of a search, fitted again to all runs."""
    whole = part.anew(terms=terms, runs=tuple(range(len(part.problem.data))))
    leading = part.ranked()[:RIVALS_KEPT]
    # the null is kept even if its misfit is too large to converge, because all sets are compared with it
    whole.fits[frozenset()] = fit_model(part.problem, part.null.point, [], part.tolerance, whole.runs)
    for ids in leading:
        if ids:
            fit_set(whole, ids, part.fits[ids].point.terms, part.fits[ids])
    explained = whole.explained
    for ids in [ids for ids in leading if len(ids) > 1 and explained > -np.inf]:  # for the drop-one tests
        for rest in [ids - {effect} for effect in sorted(ids)]:
            if rest not in whole.fits:
                origin = part.fits.get(rest) or whole.fits.get(ids) or part.fits[ids]
                fit_set(whole, rest, {effect: origin.point.terms[effect] for effect in rest}, origin, explained)
    if leading[0] in whole.failed:  # the best set does not explain a held-out run: keep the fits without it
        return part.anew(terms=terms, fits=dict(part.fits))
    return whole


def fitted_where_absent(search: Search, ids: Set, profiles: Mapping[str, Profile]) -> bool:
    """Fit a set without an effect that profiles bring near its absence, from there; whether such a fit is better.

    Where one effect replaces another along a bend, as a level of friction that of magnets, the fit without it may have
    ended elsewhere, so that it seemed needed although its interval contains no effect at all.
    """
    fit, better = search.fits[ids], False
    for column, item in enumerate(fit.columns):
        if item.key not in ids or len(search.terms[item.key].coordinates) > 1:
            continue
        size, rest = abs(fit.point.value(item)), ids - {item.key}
        for profile in profiles.values():
            nearest = profile.best[int(np.argmin(np.abs(profile.best[:, column])))]
            if abs(nearest[column]) > NEARER * size:
                continue
            there, before = fit.point.at(fit.columns, nearest), search.fits.get(rest)
            fit_set(search, rest, {effect: there.terms[effect] for effect in rest}, replace(fit, point=there))
            better |= search.fits.get(rest) is not before
    return better


def refit_without_held_out(part: Search, whole: Search, ids: Set) -> Fit:
    """A set fitted to the runs of part, from its fit to all runs."""
    source = whole.fits[ids]
    wider = whole.anew(tolerance=part.tolerance, runs=part.runs)
    return fit_set(wider, ids, dict(source.point.terms), source) or source


def challenge_with_free_terms(search: Search, free: Mapping[str, Candidate], progress: Progress) -> None:
    """Fit free-form terms in place of named effects, and together with them.

    They are added to the most probable set and to the answer. These differ if the most probable set ends at a bound; a
    free-form term may then explain what that set explains better than the answer.
    """
    progress("free-form terms", 0.85)
    ranked = sorted(search.fits, key=lambda ids: -search.fits[ids].posterior.log_evidence)
    top = search.fits[ranked[0]].posterior.log_evidence
    answer = rank_named(search, len(free))[1]
    for ids in dict.fromkeys([frozenset[str](), ranked[0], answer]):
        fit = search.fits.get(ids) or fit_set(search, ids, {}, search.null) or search.reached(ids)
        if fit is None:
            continue
        inside = [effect for effect in sorted(ids) if not search.terms[effect].stepwise]
        view = screen(search, fit.point, inside, free.values())
        base = view.evidence()
        gains = sorted(((view.evidence(offer) - base, offer) for offer in view.offers), reverse=True)
        hopeless = 0
        for gain, (effect, extra) in gains[:FREE_REFITTED]:
            if gain < PROMISING_FREE or hopeless == FREE_HOPELESS or search.exhausted:
                break
            found = fit_set(search, ids | {effect}, {effect: view.start_of((effect, extra))}, fit, search.explained)
            near = found is not None and found.posterior.log_evidence > top - HOPELESS
            hopeless = 0 if near else hopeless + 1
    _ask_for_names(search, len(free))
    _fit_without_named(search, len(free))
    fit_null_from_rivals(search)


def _fit_without_named(search: Search, families: int) -> None:
    """Fit the most probable set with a free-form term without each of its named effects, which may not be needed.

    A right motor that is slower backward was imitated by a mismatch with a pulling wire. The free-form term of it was
    added to both, and beside it the wire was told as well, as a set that is not fitted is no rival.
    """
    for _ in range(LARGEST_SET):
        best = standing(search, families).sets[0]
        named = [effect for effect in sorted(best) if not is_free(effect)]
        lesser = [best - {effect} for effect in named if search.reached(best - {effect}) is None]
        if len(named) == len(best) or not lesser:
            break
        for ids in lesser:
            fit_set(search, ids, {}, search.fits[best], search.explained)


def _ask_for_names(search: Search, families: int) -> None:
    """Fit effects of the catalogue in place of the free-form terms of the most probable set, if it has any.

    They were sought in the fitted runs alone, free-form terms in all: an axle compliance, which the only two runs that
    drove backward show, was unknown physics because these were held out.
    """
    best = standing(search, families).sets[0]
    ids: Set = frozenset(effect for effect in best if not is_free(effect))
    if ids == best or search.reached(ids) is None:
        return
    others = {effect for effect in search.terms if not is_free(effect) and ids | {effect} not in search.fits}
    extend(search, ids, others)


def fit_null_from_rivals(search: Search) -> None:
    """Fit the model without effects from the parameters of sets that are little more probable, and keep the best fit.

    Friction, gains and attractions that the runs hardly determine make a narrow bent valley, in which a fit may end far
    below its optimum; an effect then seems to be needed because the null was fitted worse. In twelve short turns of an
    ordinary session a free-form term had log odds of 21, of which 15 were such an error. A fit that does not converge
    counts as well: its evidence is a lower bound.
    """
    rivals = sorted(search.fits, key=lambda ids: -search.evidence(ids))[:RIVALS_KEPT]
    for ids in rivals:
        if not 0 < search.evidence(ids) - search.evidence(frozenset()) < LAGGING:
            continue
        point = search.fits[ids].point
        try:
            fit = fit_model(search.problem, replace(point, terms={}), [], search.tolerance, search.runs)
        except FloatingPointError:
            continue
        if fit.posterior.log_evidence > search.null.posterior.log_evidence:
            search.fits[frozenset()] = fit


def name_what_is_off(search: Search, ids: Set, known: Sequence[Quantity], families: int) -> Set:
    """A fitted set, plus effects equivalent to known quantities that it moves beyond three of their tolerances.

    A wheel that is fitted 3 % smaller than its pair, though callipers measure to half a per cent, indicates a mismatch
    of the drive, not a wrong measurement. Such an effect must gain the odds that no session without an effect reached
    (UNDECIDED): a mismatch of 3 %, 4.7 tolerances off, had 40 to 1. If it gains less, the deviation of the quantity is
    only reported: a laboratory that measured a mark less accurately than stated is no missing physics. Not on open
    ground, where residuals are not noise and move such quantities.
    """
    if search.problem.open_ground:
        return ids
    while len(ids) < LARGEST_SET:
        off = [item for item in knowledge(known, search.fits[ids]) if item.is_finding]
        names = [item.alike for item in sorted(off, key=lambda item: -abs(item.found) / item.quantity.sigma)]
        larger = [ids | {name} for name in names if name is not None and name in search.terms and name not in ids]
        better = (more for more in larger if _pays_for_itself(search, more, ids, families))
        more = next(better, None)
        if more is None:
            break
        ids = more
    return ids


def _pays_for_itself(search: Search, more: Set, ids: Set, families: int) -> bool:
    """Whether a set can be fitted from the fit of a subset and gains enough over it."""
    found = search.fits.get(more) or fit_set(search, more, {}, search.fits[ids], search.explained)
    return found is not None and score(search, more, families) > score(search, ids, families) + UNDECIDED
