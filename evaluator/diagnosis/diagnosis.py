"""From runs to a verdict: noise, recalibration, search, confirmation on runs held out, and the right to abstain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.adequacy import Adequacy, adequacy
from evaluator.diagnosis.assessment.cross_validation import Constancy, constancy
from evaluator.diagnosis.assessment.disagreement import Dependence, dependences, pieces
from evaluator.diagnosis.assessment.gap import Gap, noise_floor, predicted_gaps, run_gaps
from evaluator.diagnosis.assessment.knowledge import Knowledge, knowledge
from evaluator.diagnosis.assessment.model_comparison import (
    Set,
    Standing,
    is_free,
    predictive_score,
    separations,
    standing,
)
from evaluator.diagnosis.assessment.relevance import Changes, changes
from evaluator.diagnosis.assessment.verdict import Verdict, best_named, decide, doubts
from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.candidates.free_form import free_terms
from evaluator.diagnosis.design.next_runs import NextRuns, best_next_runs
from evaluator.diagnosis.experiment import Session, held_out_runs, shortcomings
from evaluator.diagnosis.inference.fit import Fit, fit_model
from evaluator.diagnosis.inference.fit_cache import Ends
from evaluator.diagnosis.inference.profile_likelihood import Ridge, ridge_of
from evaluator.diagnosis.inference.search import HOPELESS, LARGEST_SET, Search, fit_set, run_search, screen
from evaluator.diagnosis.inference.short_horizon import is_large, recalibrated, short_horizon_fits
from evaluator.diagnosis.likelihood.known_to import simulated_sigmas
from evaluator.diagnosis.likelihood.problem import Column, Point, Problem, build_problem, with_noise_of
from evaluator.diagnosis.likelihood.random_effects import place_runs, place_starts
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.output.effect_tables import corrected_robot
from evaluator.progress import Progress
from simulator.effects.coordinates import Candidate

Floats = NDArray[np.float64]

# Whatever the evidences say, a model that misses the marks of a run by so many times the noise floor does not follow
# it. Where the verdict was right the gap lay between 0.9 and 1.12 floors; fits that had not settled left 50 and more.
# One run in eight may be astray (dust, a snagged tether, the edge between two steady states) and is named.
MISSED = 2.5
ASTRAY_SHARE = 0.125
SETTLED_NOISE = 0.9  # a search is repeated where its best model lowers the noise below this share
RIVALS_KEPT = 4
UNSEEN_SIGMAS = 0.5  # a standard deviation of a nominal value that shows by less, in all runs together, is left out
SWAP_SIGMAS, SWAPS = 10.0, 4
FREE_REFITTED, FREE_HOPELESS = 8, 3  # free-form terms to be fitted, at most; so many far from the best in a row end it
PROMISING_FREE = 6.0  # gain in log evidence at which a free-form term is fitted; its prior takes eight


@dataclass(frozen=True)
class Diagnosis:
    """Everything that a diagnosis found out; what is not applicable is None or empty."""

    verdict: Verdict
    reason: str
    session: Session
    held_out: tuple[int, ...] = ()
    problem: Problem | None = None
    search: Search | None = None  # over all runs
    fit_search: Search | None = None  # without the runs held out
    standing: Standing | None = None
    chosen: Set = frozenset()
    named: Set = frozenset()  # the best set of named effects
    ridges: Mapping[str, Ridge] = field(default_factory=dict)  # of chosen effects, where the linear view is not enough
    separation: Mapping[str, Mapping[str, float]] | None = None
    leftover: Adequacy | None = None
    gap: Gap | None = None
    confirmation: float = float("nan")  # gain in log density of the runs held out
    terms: Mapping[str, Candidate] | None = None
    pieces: pd.DataFrame | None = None
    where: tuple[Dependence, ...] = ()
    next_runs: NextRuns | None = None
    astray: tuple[int, ...] = ()  # runs that the chosen model does not follow
    follows: bool = True  # whether the chosen model follows nearly all runs
    constancy: tuple[Constancy, ...] = ()  # of the best named effects
    changes: Mapping[str, Changes] = field(default_factory=dict)  # what each detected effect does
    negligible: Set = frozenset()  # detected effects that do less than matters
    known: tuple[Knowledge, ...] = ()  # where the data want what is known to a tolerance

    @property
    def fit(self) -> Fit:
        """The fit of the chosen set on all runs."""
        assert self.search is not None
        return self.search.fits[self.chosen]


def diagnose(session: Session, progress: Progress, ends: Ends | None = None) -> Diagnosis:
    """Find out what is missing in the model of these runs; ends: of the fits made before an interruption."""
    reasons = shortcomings(session.data)
    if reasons:
        reasons = [item.sentence for item in session.mistakes if item.everywhere] + reasons
        return Diagnosis("insufficient", "; ".join(reasons), session)
    part, start, terms = _searched(session, progress, ends)
    everything = _on_all_runs(part, terms)
    free = {effect: term for effect, term in terms.items() if is_free(effect)}
    _challenge(everything, free, progress)
    table, best_named = _best_named(everything, len(free))
    chosen, verdict, reason = decide(everything, table, len(free), best_named)
    done = {effect: changes(everything.problem, everything.fits[chosen], effect) for effect in chosen}
    negligible: Set = frozenset()
    if verdict == "effect" and not any(item.matter(session.relevant) for item in done.values()):
        negligible, verdict = chosen, "none"
        reason = f"what is missing ({', '.join(sorted(chosen))}) does less than is stated as relevant"
    left = adequacy(everything.fits[chosen], session.data)
    constant = constancy(everything.fits[best_named], session.data, everything.tolerance)
    if verdict != "unknown" and (reserve := doubts(left, constant)):
        verdict, reason = "unknown", reserve
        chosen = next((ids for ids in table.sets if any(is_free(effect) for effect in ids)), chosen)
    progress("where and what next", 0.95)
    apart = separations(everything, best_named) if verdict == "effect" else {}
    found = Diagnosis(
        verdict=verdict,
        reason=reason,
        session=session,
        held_out=held_out_runs(session.data),
        problem=part.problem,
        search=everything,
        fit_search=part,
        standing=table,
        chosen=chosen,
        named=best_named,
        ridges=_ridges(everything, chosen) if verdict == "effect" else {},
        separation=apart,
        leftover=left,
        terms=terms,
        next_runs=best_next_runs(everything, chosen, table, apart),
        constancy=tuple(constant),
        changes=done,
        negligible=negligible,
        known=knowledge(session.known, everything.fits[chosen]),
    )
    return _looked_at_again(found, start)


def _ridges(search: Search, ids: Set) -> dict[str, Ridge]:
    """Ridges of the effects of a fitted set, where they are bent."""
    smooth = [effect for effect in sorted(ids) if not search.terms[effect].stepwise]
    found = {effect: ridge_of(search, search.fits[ids], search.terms[effect]) for effect in smooth}
    return {effect: ridge for effect, ridge in found.items() if ridge is not None}


def _best_named(search: Search, families: int) -> tuple[Standing, Set]:
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


def _searched(session: Session, progress: Progress, ends: Ends | None) -> tuple[Search, Point, dict[str, Candidate]]:
    """The search over named effects without the runs held out, the nominal point, and all terms by id."""
    data = session.data
    given = {entry.id for entry in session.robots[0].effect}
    every = named_terms(_reach(session), _levels(session), session.own)
    named = {effect: term for effect, term in every.items() if effect not in given}
    terms: dict[str, Candidate] = {**named, **free_terms()}
    progress("noise", 0.0)
    forward = Simulated(session.robots, data, terms, simulated_sigmas(session.known), session.start_sigma_s)
    problem, start = build_problem(data, forward, ends)
    tolerance = told_of(problem, start, session.tolerance)
    aside = held_out_runs(data)
    part = Search(problem, named, tolerance, tuple(run for run in range(len(data)) if run not in aside))
    begin, large = start, is_large(problem, start)
    if large:
        begin = recalibrated(problem, start, tolerance)
        problem = with_noise_of(problem, begin)
        part = replace(part, problem=problem)
        large = is_large(problem, begin)
    run_search(part, begin, start, progress, short_horizon_fits(part, start, progress) if large else ())
    part = _with_settled_noise(part, start, progress)
    _swap(part)
    return part, start, terms


def _looked_at_again(found: Diagnosis, nominal: Point) -> Diagnosis:
    """The diagnosis with the gap before and after, on fitted runs and on those held out, and where it shows."""
    part, everything, chosen, fit = found.fit_search, found.search, found.chosen, found.fit
    assert part is not None
    assert everything is not None
    problem, runs = part.problem, range(len(found.session.data))
    gap_fit = part.fits.get(chosen) or _refit_on(part, everything, chosen)
    after = place_runs(problem, replace(gap_fit.point, own=fit.point.own), runs, fit.posterior.scatter)
    after_mm, floor_mm = run_gaps(problem, after, runs), noise_floor(problem, runs)
    astray = tuple(int(run) for run in np.flatnonzero(after_mm > MISSED * floor_mm))
    follows = len(astray) <= ASTRAY_SHARE * len(runs)
    # what a model that does not follow the marks says of each run's friction and gains is worth nothing
    before = place_starts(problem, Point(after.own) if follows else nominal, runs)
    seen = pieces(problem, before)
    assert found.terms is not None
    corrected = tuple(corrected_robot(robot, found.terms, gap_fit.point) for robot in found.session.robots)
    predicted = [
        predicted_gaps(found.session.data, robots, found.session.robots) for robots in (found.session.robots, corrected)
    ]
    found = replace(
        found,
        gap=Gap(run_gaps(problem, before, runs), after_mm, floor_mm, predicted[0], predicted[1]),
        confirmation=_confirmation(part, gap_fit, found.held_out) if found.held_out and chosen else float("nan"),
        pieces=seen,
        where=tuple(dependences(seen)),
        astray=astray,
        follows=follows,
    )
    if found.verdict == "unknown" or follows:
        return found
    reason = "neither the nominal model nor any effect that could be fitted follows the marks"
    return replace(found, verdict="unknown", reason=reason)


def _confirmation(part: Search, fit: Fit, held_out: Sequence[int]) -> float:
    """Gain in log density of the runs held out over the null; NaN where the null cannot even be simulated there."""
    try:
        return predictive_score(part, fit, held_out) - predictive_score(part, part.null, held_out)
    except FloatingPointError:
        return float("nan")


def told_of(problem: Problem, point: Point, tolerance: Mapping[str, float]) -> dict[str, float]:
    """The tolerances of what these runs can tell: a standard deviation of the rest does not show in all of them.

    It could only lend noise of the differences to a fit.
    """
    columns = [Column(key) for key, value in tolerance.items() if value > 0]
    square = np.zeros(len(columns))
    for item in problem.attempted(point, columns, range(len(problem.data))):
        if item is not None:
            basis = np.linalg.qr(item.start)[0]
            left = item.common - basis @ (basis.T @ item.common)
            square += np.sum(left**2, axis=0)
    return {
        column.key: tolerance[column.key]
        for column, size in zip(columns, square, strict=True)
        if size * tolerance[column.key] ** 2 > UNSEEN_SIGMAS**2
    }


def _reach(session: Session) -> float:
    return float(np.nanmax([np.nanmax(np.abs(run.marks_mm)) for run in session.data]))


def _levels(session: Session) -> tuple[float, ...]:
    return tuple(sorted({abs(rpm) for run in session.data for rpm in run.command}))


def _with_settled_noise(part: Search, nominal: Point, progress: Progress) -> Search:
    """The search with the noise that its best model leaves; repeated where a misfit had been taken for noise.

    It goes on from its best fits. Under less noise the same misfit is more sigmas, and from the null, or from friction
    and gains that suited another model, a fit that had converged before may not find its way again.
    """
    for _ in range(2):
        best = part.fits[part.ranked()[0]]
        point = place_runs(part.problem, best.point, range(len(part.problem.data)), best.posterior.scatter)
        problem = with_noise_of(part.problem, point)
        pairs = zip(problem.noise, part.problem.noise, strict=True)
        if np.median([new[0].sigma_mm / old[0].sigma_mm for new, old in pairs]) > SETTLED_NOISE:
            break
        seeds, null = [part.fits[ids] for ids in part.ranked()[:RIVALS_KEPT]], part.null.point
        part = Search(problem, part.terms, part.tolerance, part.runs)
        run_search(part, null, nominal, progress, seeds)
    return part


def _swap(part: Search) -> None:
    """Fit what could stand for an effect of the best set: a linear view overlooks what sticks."""
    best = part.ranked()[0]
    for effect, others in (separations(part, best, 0) if best else {}).items():
        near = sorted((sigmas, other) for other, sigmas in others.items() if other and sigmas < SWAP_SIGMAS)
        for _, other in near[:SWAPS]:
            ids = best - {effect} | {other}
            if ids not in part.fits and ids not in part.failed and not part.exhausted:
                fit_set(part, ids, {}, part.null if len(ids) == 1 else part.fits[best], part.explained)


def _on_all_runs(part: Search, terms: Mapping[str, Candidate]) -> Search:
    """The best sets of a search fitted again, on all runs."""
    whole = Search(part.problem, terms, part.tolerance, tuple(range(len(part.problem.data))))
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
        return Search(part.problem, terms, part.tolerance, part.runs, dict(part.fits))
    return whole


def _refit_on(part: Search, whole: Search, ids: Set) -> Fit:
    """A set fitted on the runs of part, from its fit on all runs."""
    source = whole.fits[ids]
    wider = Search(part.problem, whole.terms, part.tolerance, part.runs)
    return fit_set(wider, ids, dict(source.point.terms), source) or source


def _challenge(search: Search, free: Mapping[str, Candidate], progress: Progress) -> None:
    """Let free-form terms compete: instead of the named effects, and beside them."""
    progress("free-form terms", 0.85)
    ranked = sorted(search.fits, key=lambda ids: -search.fits[ids].posterior.log_evidence)
    top = search.fits[ranked[0]].posterior.log_evidence
    for ids in dict.fromkeys([frozenset[str](), ranked[0]]):
        fit = search.fits[ids]
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
