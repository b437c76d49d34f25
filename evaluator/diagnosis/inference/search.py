"""State of a search over sets of effects, and the fit of one set."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from evaluator.diagnosis.inference.fit import EXPLAINED, LAGGING, fit_model
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.steps_of_a_term import better_step
from evaluator.diagnosis.likelihood.linear.mixed_model import USUAL_SCATTER
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.likelihood.run_data import Values
from simulator.effects.coordinates import Candidate

# Prior of no, one, two, three effects: half of the laboratories that run a diagnosis have one, fewer have more.
SIZE_PRIOR = (0.5, 0.35, 0.12, 0.03)
# Decrease of -2 log density that a linearization still promises where a fit has stalled, from which it is tried from
# elsewhere: odds that decide about an effect (e⁸ to 1). On open ground every fit ends so: LAGGING.
MATERIAL = 16.0
FAR_BEYOND = 3.0  # tolerances from which a value is a finding (assessment.knowledge)
FIRM = 0.1  # share of its tolerance to which a value far beyond it is led back
# Mean square of the residuals of a fit over the least of all sets, from which other starting values have not helped: of
# a dozen sets of a session with limited wheels, they reduced it from there by a third at most.
MISSES_FAR = 10.0
WIDER = (2.0, 4.0)  # times the usual scatter, by which a fit is continued that ends worse with any at once
LARGEST_SET = 3
# On open ground. Encoders show that the drives of a Husky and a Warthog lag, limit speed and limit acceleration; the
# gains of the Husky also differ from the stated ones.
LARGEST_ON_GROUND = 4
RIVALS_KEPT = 4  # sets that are fitted again under another noise, or to all runs
# Steps of fits, each a linearization of all runs (a quarter of a second for 24 runs of 10 s), after which a search fits
# no further sets: if no model explains the runs, every fit is long, and further fits do not change the verdict.
MOST_STEPS = 100
MOST_MOVES = 4  # of a value without a derivative, each by up to BESIDE steps


@dataclass
class Search:
    """State of a search: the problem, the candidates, and all fits made so far."""

    problem: Problem
    terms: Mapping[str, Candidate]
    tolerance: Mapping[str, float]
    runs: tuple[int, ...]
    fits: dict[frozenset[str], Fit] = field(default_factory=dict)
    # sets whose fit did not converge: the last fit, or None if runs cannot be simulated
    failed: dict[frozenset[str], Fit | None] = field(default_factory=dict)
    asked: frozenset[str] = frozenset()  # user-defined effects: fitted whenever a set is extended
    extended: set[frozenset[str]] = field(default_factory=set)  # sets for which additions were screened
    diverging: tuple[int, ...] = ()  # runs without which it is to begin anew: its fits are of the first seconds
    steps: int = 0  # of all its fits together
    most_steps: int = MOST_STEPS

    def anew(self, **changes: Any) -> Search:
        """A search with these fields changed, and without fits."""
        empty: dict[str, Any] = {"fits": {}, "failed": {}, "extended": set(), "diverging": ()}
        empty |= {"steps": 0, "most_steps": MOST_STEPS}
        return replace(self, **(empty | changes))

    @property
    def exhausted(self) -> bool:
        """Whether the largest number of steps has been made."""
        return self.steps >= self.most_steps

    @property
    def largest(self) -> int:
        """Largest number of effects of a set."""
        return LARGEST_ON_GROUND if self.problem.open_ground else LARGEST_SET

    @property
    def explained(self) -> float:
        """Log evidence of the best fit if it explains the runs, otherwise minus infinity."""
        if self.problem.open_ground:  # the noise is estimated from the residuals, so that every model explains the runs
            return -np.inf
        best = max(self.fits.values(), key=lambda fit: fit.posterior.log_evidence, default=None)
        explains = best is not None and best.converged and best.excess < EXPLAINED
        return best.posterior.log_evidence if best is not None and explains else -np.inf

    @property
    def null(self) -> Fit:
        """The recalibrated model without effects."""
        return self.fits[frozenset()]

    def misses_far(self, fit: Fit) -> bool:
        """Whether a fit on open ground leaves so much more than another one that it is not tried from elsewhere."""
        least = min((other.excess for other in self.fits.values()), default=np.inf)
        return self.problem.open_ground and fit.converged and fit.excess > MISSES_FAR * least

    def evidence(self, ids: frozenset[str]) -> float:
        """Log evidence of a set, a lower bound if its fit has not converged; minus infinity if there is none."""
        fit = self.reached(ids)
        return -np.inf if fit is None else fit.posterior.log_evidence

    def score(self, ids: frozenset[str]) -> float:
        """Log evidence plus log prior of a set; see evidence."""
        return self.evidence(ids) + log_prior(len(ids), len(self.terms))

    def reached(self, ids: frozenset[str]) -> Fit | None:
        """The fit of a set, converged or not: an initial value for others, evidence only if it converged."""
        return self.fits.get(ids) or self.failed.get(ids)

    @property
    def so_far(self) -> str:
        """A sentence about the most probable set so far, for a search that is stopped."""
        best = self.ranked()[0]
        what = " with ".join(sorted(best)) or "the model without an effect"
        excess = self.fits[best].excess
        left = f"its residuals are {excess:.2g} times the mean square of the noise"
        found = f"of {len(self.fits)} fitted models the most probable is {what}"
        if excess * EXPLAINED < 1:  # noise is taken from the residuals of a model, here of a wrong one
            return f"{found}, but {left}, which an earlier misfit inflated, so that this decides nothing"
        if excess < EXPLAINED:
            return f"{found}, which explains the runs ({left}), but is no finding before other models are fitted"
        return f"{found}, which does not explain the runs: {left}"

    def initial(self, most: int) -> list[Fit]:
        """The most probable fits of all sets, best first, as initial values: also fits that have not converged."""
        known = {ids: fit for ids, fit in (*self.fits.items(), *self.failed.items()) if fit is not None}
        return [known[ids] for ids in sorted(known, key=self.score, reverse=True)[:most]]

    def ranked(self) -> list[frozenset[str]]:
        """Fitted sets, most probable first."""
        return sorted(self.fits, key=self.score, reverse=True)


def log_prior(size: int, candidates: int) -> float:
    """Log prior of a set of this size; sets beyond LARGEST_SET have the prior of those of that size."""
    size = min(size, len(SIZE_PRIOR) - 1)
    return math.log(SIZE_PRIOR[size]) - math.log(math.comb(candidates, size))


def fit_set(search: Search, ids: frozenset[str], starts: Values, origin: Fit, rival: float = -np.inf) -> Fit | None:
    """Fit a set once from these starting values; keep the fit if it is the best of the set so far.

    rival: log evidence of a set that explains the runs; the fit ends early if it stays far below.
    """
    values = {**origin.point.terms, **starts}
    smooth = [search.terms[effect] for effect in sorted(ids) if not search.terms[effect].stepwise]
    fixed = {effect: values[effect] for effect in ids if search.terms[effect].stepwise}
    values = {effect: values.get(effect, search.terms[effect].absent) for effect in ids}
    fit = _fit_from(search, Point(origin.point.per_run, origin.point.nominal, values), smooth, fixed, rival=rival)
    lags = fit is not None and (fit.posterior.log_evidence < rival - LAGGING or search.misses_far(fit))
    material = LAGGING if search.problem.open_ground else MATERIAL
    if fit is None or not ((fit.converged and fit.shortfall < material) or lags):
        # from implausible friction and gains, which conceal a misfit, no step may improve
        begin = replace(origin.point.without_scatter(), nominal={}, terms=values)
        usual = _fit_from(search, begin, smooth, fixed, USUAL_SCATTER, rival)
        if usual is not None and usual.converged and not usual.overreaches:
            usual = _freed(search, usual, smooth, fixed, rival)
        fit = _better(fit, usual)
        if fit is not None and fit.converged and fit.shortfall >= material and not lags:
            fit = _better(fit, _led_to_tolerances(search, fit, smooth, fixed, rival))
    if fit is None or not fit.converged:
        if ids not in search.fits:
            search.failed[ids] = fit
        return None
    fit = _at_better_steps(search, fit, smooth, rival).counting(len(fixed))
    old = search.fits.get(ids)
    if old is None or fit.posterior.log_evidence > old.posterior.log_evidence:
        search.fits[ids] = fit
    search.failed.pop(ids, None)
    if search.problem.horizon_s == np.inf:
        search.problem.watch.so_far, search.problem.watch.explained = search.so_far, search.explained > -np.inf
    return search.fits[ids]


def _freed(search: Search, usual: Fit, smooth: Sequence[Candidate], fixed: Values, rival: float) -> Fit:
    """A fit with usual friction and gains, continued with any: at once or, if that ends below it, by widening steps.

    Where friction hardly lets a robot turn, a long step of one run's friction leads to another motion, and no further
    step improves. With friction that varied by 8 %, a scrub of 0.063 mm ended 122 of log evidence below its fit with
    usual scatter, and a level of friction was named in its place; by widening steps, it ends as probable as that.
    """
    found = [_fit_from(search, usual.point, smooth, fixed, rival=rival)]
    if found[0] is None or not found[0].converged or _is_less(found[0], usual):
        at: Fit | None = usual
        for times in WIDER:
            limit = tuple(times * size for size in USUAL_SCATTER)
            at = _fit_from(search, at.point, smooth, fixed, limit, rival) if at else None
        found.append(_fit_from(search, at.point, smooth, fixed, rival=rival) if at else None)
    ended = [fit for fit in found if fit is not None and fit.converged]
    return max(ended, key=lambda fit: fit.posterior.log_evidence, default=usual)


def _is_less(fit: Fit, other: Fit) -> bool:
    return fit.posterior.log_evidence < other.posterior.log_evidence


def _led_to_tolerances(
    search: Search, fit: Fit, smooth: Sequence[Candidate], fixed: Values, rival: float
) -> Fit | None:
    """A fit from where its effects stand for values that lie far beyond their tolerances; None without such values.

    Without the effect these values take up its misfit as far as they can, and from there the way back is a curve that
    no step follows: with driven wheels attracted 2.5 times as strongly as stated, attractions 6 and 5 tolerances off
    kept the strength of magnets at 1.05 times, 40 below its best evidence. A fit in which these values are known more
    firmly leaves them for the effects; it is a place to begin at, and no result.
    """
    beyond = {
        column.key
        for column in fit.columns
        if column.term is None and abs(fit.point.value(column)) > FAR_BEYOND * search.tolerance[column.key]
    }
    if not beyond:
        return None
    firm = {key: value * (FIRM if key in beyond else 1.0) for key, value in search.tolerance.items()}
    led = _fit_from(search, fit.point, smooth, fixed, rival=rival, tolerance=firm)
    return _fit_from(search, led.point, smooth, fixed, rival=rival) if led else None


def _better(fit: Fit | None, usual: Fit | None) -> Fit | None:
    """The second of two fits, unless only the first has converged, or both have and the first is more probable."""
    if fit is None or usual is None or not fit.converged:
        return usual or fit
    return usual if usual.converged and usual.posterior.log_evidence > fit.posterior.log_evidence else fit


def _at_better_steps(search: Search, fit: Fit, smooth: Sequence[Candidate], rival: float) -> Fit:
    """The fit, or that of a better value of a term without a derivative near its own; see MOST_MOVES.

    Screening compares such values where the other parameters are those of another model: a dead band of 11.6 rpm was
    10.9 rpm by screening, and the times of ramps that pass it seemed to be wrong.
    """
    for term in [search.terms[effect] for effect in sorted(fit.terms) if search.terms[effect].stepwise]:
        for _ in range(MOST_MOVES):
            step = better_step(search.problem, fit, term, search.tolerance)
            if step is None:
                break
            begin = replace(fit.point, terms={**fit.point.terms, term.id: term.starts[step]})
            fixed = {effect: value for effect, value in begin.terms.items() if search.terms[effect].stepwise}
            moved = _fit_from(search, begin, smooth, fixed, rival=rival)
            if moved is None or not moved.converged or moved.posterior.log_evidence <= fit.posterior.log_evidence:
                break
            fit = moved
    return fit


def _fit_from(
    search: Search,
    begin: Point,
    smooth: Sequence[Candidate],
    fixed: Values,
    most_scatter: tuple[float, ...] | None = None,
    rival: float = -np.inf,
    tolerance: Mapping[str, float] | None = None,
) -> Fit | None:
    """One fit, with the tolerances of the search unless others are given; None if runs cannot be simulated."""
    problem, runs = search.problem, search.runs
    try:
        fit = fit_model(problem, begin, smooth, tolerance or search.tolerance, runs, fixed, most_scatter, rival=rival)
    except FloatingPointError:
        search.steps += 1
        return None
    search.steps += fit.steps
    return fit
