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

UNSEEN_SIGMAS = 0.5  # a standard deviation of a nominal value that shows by less, in all runs together, is left out
SWAP_SIGMAS, SWAPS = 10.0, 4
FREE_REFITTED, FREE_HOPELESS = 8, 3  # free-form terms to be fitted, at most; so many far from the best in a row end it
PROMISING_FREE = 6.0  # gain in log evidence at which a free-form term is fitted; its prior takes eight


def rank_named(search: Search, families: int) -> tuple[Standing, Set]:
    """How all sets stand, and the best one of which every effect pays for itself.

    What an effect is measured against, the set without it, is fitted from where the whole set stands too: a start pose
    that had settled elsewhere, in one run, has passed for an effect of size nought.
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
    """Runs ready for a search: the problem, its nominal point, tolerances that show, terms by id, the user's own."""

    problem: Problem
    start: Point
    tolerance: Mapping[str, float]
    terms: Mapping[str, Candidate]
    own: frozenset[str] = frozenset()

    @property
    def free(self) -> dict[str, Candidate]:
        """Terms without a name."""
        return {effect: term for effect, term in self.terms.items() if is_free(effect)}

    @property
    def named(self) -> dict[str, Candidate]:
        """Terms of the catalogue and of the user."""
        return {effect: term for effect, term in self.terms.items() if not is_free(effect)}


def prepared(session: Session, progress: Watch, fits: FitCache | None) -> Prepared:
    """The runs of a session, their noise, and everything that may be missing in the model of them."""
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
    """The search over named effects without the runs held out."""
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
    """Numbers of the runs that are not held out."""
    aside = held_out_runs(data)
    return tuple(run for run in range(len(data)) if run not in aside)


def visible_tolerances(problem: Problem, point: Point, tolerance: Mapping[str, float]) -> dict[str, float]:
    """The tolerances of what these runs can tell: a standard deviation of the rest does not show in all of them.

    It could only lend noise of the differences to a fit.
    """
    columns = [Column(key) for key, value in tolerance.items() if value > 0]
    square, _ = _squares_shown(problem, point, columns)
    return {
        column.key: tolerance[column.key]
        for column, size in zip(columns, square, strict=True)
        if size * tolerance[column.key] ** 2 > UNSEEN_SIGMAS**2
    }


def show_starts(problem: Problem, point: Point) -> bool:
    """Whether standard deviations of the runs' starts show: otherwise each would be fitted for nothing.

    Clocks of computers that agree to 0.01 s leave nothing to find in runs that scatter by decimetres.
    """
    return bool(_squares_shown(problem, point, ())[1] > UNSEEN_SIGMAS**2)


def _squares_shown(problem: Problem, point: Point, columns: Sequence[Column]) -> tuple[Floats, float]:
    """Squares of what common parameters (p,) do, per unit, and of the runs' starts, each at its standard deviation."""
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
    """The search with the drift of both marks that the model without effects leaves, and where to begin.

    Asked for before anything is added, or effects that are none would explain it. A large misfit is no drift of a
    camera; there a usual one is assumed, and asked for once something explains the runs.
    """
    usual = replace(part, problem=with_noise_of(replace(part.problem, common_drift=USUAL_DRIFT), begin))
    null = fit_model(usual.problem, begin, [], usual.tolerance, usual.runs)
    problem = with_common_drift(usual, null)
    return replace(part, problem=with_noise_of(problem, null.point)), null.point


def _with_settled_noise(part: Search, nominal: Point, progress: Progress) -> Search:
    """The search with the noise that its best model leaves; repeated where a misfit had been taken for noise.

    It goes on from its best fits. Under less noise the same misfit is more sigmas, and from the null, or from friction
    and gains that suited another model, a fit that had converged before may not find its way again.
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
    """Fit what could stand for an effect of the best set: a linear view overlooks what sticks.

    Effects without a derivative are left out: nothing here says where they begin, and the search tries them whole.
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
    """The best sets of a search fitted again, on all runs."""
    whole = part.anew(terms=terms, runs=tuple(range(len(part.problem.data))))
    leading = part.ranked()[:RIVALS_KEPT]
    # the null is kept even where its misfit is too large to converge: everything is measured against it
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
    if leading[0] in whole.failed:  # a run held out is not followed: the verdict stays with those that were fitted
        return part.anew(terms=terms, fits=dict(part.fits))
    return whole


def refit_without_held_out(part: Search, whole: Search, ids: Set) -> Fit:
    """A set fitted on the runs of part, from its fit on all runs."""
    source = whole.fits[ids]
    wider = whole.anew(tolerance=part.tolerance, runs=part.runs)
    return fit_set(wider, ids, dict(source.point.terms), source) or source


def challenge_with_free_terms(search: Search, free: Mapping[str, Candidate], progress: Progress) -> None:
    """Let free-form terms compete: instead of the named effects, and beside them.

    Beside the best set, and beside what would be the answer: a best set that ends at a bound is none, and what it does
    better than the answer a free-form term may say.
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
    """A fitted set with the effects that do what it wants of known quantities beyond three of their tolerances.

    A wheel that is 3 % smaller than its pair, where callipers measure to half a per cent, is a mismatch of the drive,
    not a measurement of the wheel. Such an effect must earn what one that relieves known values must. Short of that,
    what is off stays a finding: a laboratory that measured a mark worse than it said is untidy, and no physics. Not on
    open ground, whose left-overs are no noise and move such quantities.
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
    """Whether a set can be fitted from where one within it stands, and what it adds earns enough."""
    found = search.fits.get(more) or fit_set(search, more, {}, search.fits[ids], search.explained)
    return found is not None and score(search, more, families) > score(search, ids, families) + RELIEVING
