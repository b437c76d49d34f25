"""The searches of a diagnosis: effects without the held-out runs, the best sets on all runs, free-form terms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.knowledge import knowledge
from evaluator.diagnosis.assessment.model_comparison import (
    Set,
    Standing,
    is_free,
    score,
    separations,
    standing,
)
from evaluator.diagnosis.assessment.verdict import RELIEVING, best_named
from evaluator.diagnosis.candidates.coordinates import named_terms, size_of
from evaluator.diagnosis.candidates.equivalent_terms import included_named_effects, is_included_in
from evaluator.diagnosis.candidates.free_form import free_terms
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.held_out import held_out_runs
from evaluator.diagnosis.inference.fit import Fit, fit_model
from evaluator.diagnosis.inference.fit_cache import FitCache
from evaluator.diagnosis.inference.screening import screen
from evaluator.diagnosis.inference.search import LARGEST_SET, RIVALS_KEPT, Search, fit_set
from evaluator.diagnosis.inference.settled_noise import settled_noise, with_common_drift
from evaluator.diagnosis.inference.short_horizon import is_implausible, is_large, recalibrated, short_horizon_fits
from evaluator.diagnosis.inference.strategy import HOPELESS, run_search
from evaluator.diagnosis.inference.watch import Watch
from evaluator.diagnosis.likelihood.known_to import Quantity, predicted_sigmas
from evaluator.diagnosis.likelihood.noise.common_drift import USUAL_DRIFT
from evaluator.diagnosis.likelihood.noise.friction_wander import USUAL_WANDER
from evaluator.diagnosis.likelihood.preparation import build_problem, with_noise_of
from evaluator.diagnosis.likelihood.problem import Column, Point, Problem
from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.progress import Progress
from simulator.effects.catalogue import EFFECTS
from simulator.effects.coordinates import Candidate

Floats = NDArray[np.float64]

UNSEEN_SIGMAS = 0.5  # response of all runs to one tolerance of a nominal value, below which the value is not fitted
SWAP_SIGMAS, SWAPS = 10.0, 4
FREE_REFITTED, FREE_HOPELESS = 8, 3  # most free-form terms to fit; consecutive ones far below the best that end it
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


@dataclass(frozen=True)
class Prepared:
    """Runs ready for a search: problem, nominal point, visible tolerances, terms by id, ids of user-defined effects."""

    problem: Problem
    start: Point
    tolerance: Mapping[str, float]
    terms: Mapping[str, Candidate]
    own: frozenset[str] = frozenset()

    @property
    def free(self) -> dict[str, Candidate]:
        """Free-form terms."""
        return {effect: term for effect, term in self.terms.items() if is_free(effect)}

    @property
    def named(self) -> dict[str, Candidate]:
        """Terms of the catalogue and of the user."""
        return {effect: term for effect, term in self.terms.items() if not is_free(effect)}


def prepared(session: Session, progress: Watch, fits: FitCache | None) -> Prepared:
    """The runs of a session with their noise and all candidate terms."""
    data = session.data
    given = {entry.id for entry in session.robots[0].effect}
    size = size_of(session.robots[0])
    frame = session.one_frame
    every = named_terms(_reach(session), _levels(session), session.own, size, one_frame=frame)
    named = {effect: term for effect, term in every.items() if effect not in given}
    own = [EFFECTS[effect] for effect in session.own]
    said = {effect for item in own for effect in included_named_effects(item)}
    named = {effect: term for effect, term in named.items() if effect not in said}
    forms = free_terms(size, one_frame=frame)
    new = {form: term for form, term in forms.items() if not any(is_included_in(term, effect) for effect in own)}
    terms: dict[str, Candidate] = {**named, **new}
    progress("noise", 0.0)
    forward = Simulated(session.robots, data, terms, predicted_sigmas(session.known), session.start_sigma_s)
    problem, start = build_problem(data, forward, fits, progress)
    tolerance = visible_tolerances(problem, start, session.tolerance)
    problem = replace(problem, starts_show=show_starts(problem, start))
    return Prepared(problem, start, tolerance, terms, frozenset(terms).intersection(session.own))


def search_named(ready: Prepared, progress: Progress) -> Search:
    """The search over named effects on all runs that are not held out."""
    problem, start = ready.problem, ready.start
    part = Search(problem, ready.named, ready.tolerance, fitted_runs(problem.data), asked=ready.own)
    begin, large = start, is_large(problem, start)
    if large:
        begin = recalibrated(problem, start, ready.tolerance)
        problem = with_noise_of(problem, begin)
        part = replace(part, problem=problem)
        large = is_large(problem, begin) or is_implausible(begin)
    if large:
        usual = replace(part.problem, common_drift=USUAL_DRIFT, friction_wander=USUAL_WANDER)
        part = replace(part, problem=with_noise_of(usual, begin))
    else:
        part, begin = _with_drift(part, begin)
    run_search(part, begin, start, progress, short_horizon_fits(part, start, progress) if large else ())
    part = _with_settled_noise(part, start, progress)
    _swap(part)
    return part


def fitted_runs(data: Sequence[RunData]) -> tuple[int, ...]:
    """Indices of the runs that are not held out."""
    aside = held_out_runs(data)
    return tuple(run for run in range(len(data)) if run not in aside)


def visible_tolerances(problem: Problem, point: Point, tolerance: Mapping[str, float]) -> dict[str, float]:
    """Tolerances of the nominal values to which these runs respond visibly: by more than UNSEEN_SIGMAS in all of them.

    The others would only add numerical noise of the derivatives to a fit.
    """
    columns = [Column(key) for key, value in tolerance.items() if value > 0]
    square, _ = _squares_shown(problem, point, columns)
    return {
        column.key: tolerance[column.key]
        for column, size in zip(columns, square, strict=True)
        if size * tolerance[column.key] ** 2 > UNSEEN_SIGMAS**2
    }


def show_starts(problem: Problem, point: Point) -> bool:
    """Whether the runs respond visibly to the standard deviation of their start of motion; otherwise it is not fitted.

    Clocks of computers that agree to 0.01 s have no visible influence on runs that scatter by decimetres.
    """
    return bool(_squares_shown(problem, point, ())[1] > UNSEEN_SIGMAS**2)


def _squares_shown(problem: Problem, point: Point, columns: Sequence[Column]) -> tuple[Floats, float]:
    """Squared responses to common parameters (p,) per unit, and to the starts of motion per standard deviation."""
    square, of_starts = np.zeros(len(columns)), 0.0
    for item in problem.attempted(point, columns, range(len(problem.data))):
        if item is not None:
            basis = np.linalg.qr(item.start)[0]
            both = np.column_stack([item.common, item.scatter[:, -1]])
            left = np.sum((both - basis @ (basis.T @ both)) ** 2, axis=0)
            square += left[:-1]
            of_starts += float(left[-1])
    return square, of_starts


def _reach(session: Session) -> float:
    return float(np.nanmax([np.nanmax(np.abs(run.marks_mm)) for run in session.data]))


def _levels(session: Session) -> tuple[float, ...]:
    return tuple(sorted({abs(rpm) for run in session.data for rpm in run.command}))


def _with_drift(part: Search, begin: Point) -> tuple[Search, Point]:
    """The search with the common drift of both marks from the residuals of the null, and its initial point.

    Drift is estimated before any effect is added, because effects would otherwise explain it. If the misfit of the null
    is large, a typical drift is assumed, and it is estimated once a model explains the runs.
    """
    usual = replace(part, problem=with_noise_of(replace(part.problem, common_drift=USUAL_DRIFT), begin))
    null = fit_model(usual.problem, begin, [], usual.tolerance, usual.runs)
    problem = with_common_drift(usual, null)
    return replace(part, problem=with_noise_of(problem, null.point)), null.point


def _with_settled_noise(part: Search, nominal: Point, progress: Progress) -> Search:
    """The search with the noise from the residuals of its best model, repeated if a misfit had inflated the noise.

    Its initial values are the best fits so far: with less noise a misfit amounts to more sigmas, and a fit from the
    null, or from the friction and gains of another model, may not converge again.
    """
    for _ in range(2):
        problem = settled_noise(part, part.ranked()[0])
        if problem is None:
            break
        seeds, null = [part.fits[ids] for ids in part.ranked()[:RIVALS_KEPT]], part.null.point
        part = part.anew(problem=problem)
        run_search(part, null, nominal, progress, seeds)
    return part


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
    for ids in [ids for ids in leading if len(ids) > 1]:  # for the drop-one tests
        for rest in [ids - {effect} for effect in sorted(ids)]:
            if rest not in whole.fits:
                origin = part.fits.get(rest) or whole.fits.get(ids) or part.fits[ids]
                fit_set(whole, rest, {effect: origin.point.terms[effect] for effect in rest}, origin, explained)
    if leading[0] in whole.failed:  # the best set does not explain a held-out run: keep the fits without it
        return part.anew(terms=terms, fits=dict(part.fits))
    return whole


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


def name_what_is_off(search: Search, ids: Set, known: Sequence[Quantity], families: int) -> Set:
    """A fitted set, plus effects equivalent to known quantities that it moves beyond three of their tolerances.

    A wheel that is fitted 3 % smaller than its pair, though callipers measure to half a per cent, indicates a mismatch
    of the drive, not a wrong measurement. Such an effect must gain RELIEVING. If it gains less, the deviation of the
    quantity is only reported: a laboratory that measured a mark less accurately than stated is no missing physics. Not
    on open ground, where residuals are not noise and move such quantities.
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
    return found is not None and score(search, more, families) > score(search, ids, families) + RELIEVING
