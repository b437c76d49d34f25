"""Search over sets of effects: a linear screening of everything, then full fits of what is promising.

One linearization with every candidate's derivatives serves all singles, pairs and triples. A misfit that is large
inflates the scatter and blurs the view from the null, so every promising fit is linearized again and asked what to add.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from evaluator.diagnosis.inference.fit import LAGGING, Fit, fit_model, prior_precision
from evaluator.diagnosis.likelihood.mixed_model import MixedModel, reduce_runs
from evaluator.diagnosis.likelihood.problem import Column, Point, Problem
from evaluator.diagnosis.likelihood.run_data import Values
from evaluator.progress import Progress
from simulator.effects.coordinates import Candidate

# Prior of no, one, two, three effects. A lab that asks is as likely as not to have one; each further one is rarer.
SIZE_PRIOR = (0.5, 0.35, 0.12, 0.03)
LARGEST_SET = 3
SINGLES_REFITTED = 7
ADDITIONS_REFITTED = 3
PAIRS_FROM_NULL = 2
WHOLE_CHANGES_REFITTED = 2  # two neighbouring gaps between commands: the noise decides
PAIRED = 14  # offers whose pairs are screened at the null
BEAM = (2, 1)  # sets of one, of two effects from which the search goes on
HOPELESS = 25.0  # a screened set this far (log evidence) below the best is not refitted
POSE = 3  # of a run's own numbers, those of its start pose come first
# Friction and gains: what wet or dusty plates and DC motors show; starts as they are stated.
USUAL_SCATTER = (0.03, 0.006, 0.006, 1.0)
# Left-overs, mean square over that of the noise, below which a model counts as explaining the runs: the noise of slow
# modes is carried over from fast ones, good to some ten per cent, while a wrong model leaves several times as much.
EXPLAINED = 1.5
# Steps of fits, each a linear view of all runs (a quarter of a second for 24 runs of 10 s), after which a search fits
# no further sets: where nothing explains the runs every fit is long, and further ones only tell the same.
MOST_STEPS = 100
# An addition must promise this much evidence to be fitted: less than half of what it must bring to be kept.
PROMISING = 2.0


@dataclass
class Search:
    """Everything a search knows: the problem, the candidates, and all fits made so far."""

    problem: Problem
    terms: Mapping[str, Candidate]
    tolerance: Mapping[str, float]
    runs: tuple[int, ...]
    fits: dict[frozenset[str], Fit] = field(default_factory=dict)
    # sets whose fit did not converge: where it stopped, or None where runs cannot be simulated
    failed: dict[frozenset[str], Fit | None] = field(default_factory=dict)
    steps: int = 0  # that all its fits took together
    most_steps: int = MOST_STEPS

    @property
    def exhausted(self) -> bool:
        """Whether it has made as many steps as a search may."""
        return self.steps >= self.most_steps

    @property
    def explained(self) -> float:
        """Log evidence of the best fit where that explains the runs, else minus infinity."""
        best = max(self.fits.values(), key=lambda fit: fit.posterior.log_evidence, default=None)
        explains = best is not None and best.converged and best.excess < EXPLAINED
        return best.posterior.log_evidence if best is not None and explains else -np.inf

    @property
    def null(self) -> Fit:
        """The recalibrated model without effects."""
        return self.fits[frozenset()]

    def evidence(self, ids: frozenset[str]) -> float:
        """Log evidence where the fit of a set came to: the least that it can be where it has not converged."""
        fit = self.reached(ids)
        return -np.inf if fit is None else fit.posterior.log_evidence

    def score(self, ids: frozenset[str]) -> float:
        """Log evidence plus log prior of a fitted set."""
        return self.fits[ids].posterior.log_evidence + log_prior(len(ids), len(self.terms))

    def reached(self, ids: frozenset[str]) -> Fit | None:
        """Where the fit of a set came to, converged or not: a place to go on from, evidence only where it converged."""
        return self.fits.get(ids) or self.failed.get(ids)

    def ranked(self) -> list[frozenset[str]]:
        """Fitted sets, the most probable first."""
        return sorted(self.fits, key=self.score, reverse=True)


def log_prior(size: int, candidates: int) -> float:
    """Log prior of one set of this size."""
    return math.log(SIZE_PRIOR[size]) - math.log(math.comb(candidates, size))


@dataclass(frozen=True)
class Screen:
    """Linear view from a point: a mixed model over all columns, and which columns belong to which candidate."""

    columns: tuple[Column, ...]
    model: MixedModel
    beyond: MixedModel  # the same given base
    base: tuple[int, ...]  # nominal values and the terms already in
    offers: tuple[tuple[str, tuple[int, ...]], ...]  # candidate id (several starting places: several offers), columns

    def evidence(self, *offers: tuple[str, tuple[int, ...]]) -> float:
        """Log evidence with some offers taken; all parameters of a candidate count, also those not yet varied."""
        columns: list[int] = []
        hidden = 0
        for _, extra in offers:
            columns += extra
            term = self.columns[extra[0]].term
            assert term is not None
            hidden += term.size - len(extra)
        return self.beyond.posterior(columns).log_evidence - 0.5 * hidden * math.log(self.model.runs)

    def start_of(self, offer: tuple[str, tuple[int, ...]]) -> tuple[float, ...]:
        """Coordinates at which a full fit of an offer should begin."""
        _, extra = offer
        term = self.columns[extra[0]].term
        assert term is not None
        place, whole_change = self.columns[extra[0]].start, self.columns[extra[0]].whole_change
        if whole_change is not None:
            return (term.absent[0] + whole_change,)
        if place is None:
            return term.absent
        mean = self.beyond.posterior(extra).mean[0]
        values = list(place)
        values[0] += float(mean)
        return term.clipped(tuple(values))


def screen(search: Search, point: Point, inside: Sequence[str], candidates: Iterable[Candidate]) -> Screen:
    """Linearize at a point with the terms inside and every candidate not inside."""
    columns = [Column(key) for key, value in search.tolerance.items() if value > 0]
    columns += [Column(effect, i, search.terms[effect]) for effect in inside for i in range(search.terms[effect].size)]
    base = tuple(range(len(columns)))
    offers = []
    for term in candidates:
        if term.id in inside:
            continue
        new: list[tuple[Column, ...]]
        if term.stepwise:
            new = [(Column(term.id, 0, term, whole_change=start[0] - term.absent[0]),) for start in term.starts]
        elif term.starts:
            new = [(Column(term.id, 0, term, start),) for start in term.starts]
        else:
            new = [tuple(Column(term.id, i, term) for i in range(term.size))]
        for group in new:
            offers.append((term.id, tuple(range(len(columns), len(columns) + len(group)))))
            columns += group
    linear = search.problem.linearized(point, columns, search.runs)
    model = MixedModel(reduce_runs(linear), prior_precision(columns, search.tolerance))
    beyond = model.given(base)
    able = [
        (effect, extra)
        for effect, extra in offers
        if columns[extra[0]].whole_change is None or _wants_whole_change(beyond, columns, extra)
    ]
    return Screen(tuple(columns), model, beyond, base, tuple(able))


def _wants_whole_change(beyond: MixedModel, columns: Sequence[Column], extra: tuple[int, ...]) -> bool:
    """Whether the data want about the whole of the change: half of a stopped motor does not exist."""
    whole_change = columns[extra[0]].whole_change
    assert whole_change is not None
    return bool(0.5 < beyond.posterior(extra).mean[-1] / whole_change < 1.5)


def fit_set(search: Search, ids: frozenset[str], starts: Values, origin: Fit, rival: float = -np.inf) -> Fit | None:
    """Fit a set once from these starting values; keep it where it is the best fit of the set so far.

    rival: log evidence of a set that explains the runs, near which this one must come.
    """
    values = {**origin.point.terms, **starts}
    smooth = [search.terms[effect] for effect in sorted(ids) if not search.terms[effect].stepwise]
    fixed = {effect: values[effect] for effect in ids if search.terms[effect].stepwise}
    values = {effect: values.get(effect, search.terms[effect].absent) for effect in ids}
    fit = _fit_from(search, Point(origin.point.own, origin.point.nominal, values), smooth, fixed, rival=rival)
    lags = fit is not None and fit.posterior.log_evidence < rival - LAGGING
    if fit is None or not (fit.converged or lags):
        # friction and gains with which a wrong model helped itself may be a place from which no step leads on
        without_scatter = origin.point.own.copy()
        without_scatter[:, POSE:] = 0.0
        usual = _fit_from(search, Point(without_scatter, {}, values), smooth, fixed, USUAL_SCATTER, rival)
        if usual is not None and usual.converged and not usual.overreaches:
            again = _fit_from(search, usual.point, smooth, fixed, rival=rival)
            usual = again if again is not None and again.converged else usual
        fit = usual or fit
    if fit is None or not fit.converged:
        if ids not in search.fits:
            search.failed[ids] = fit
        return None
    fit = fit.counting(len(fixed))
    old = search.fits.get(ids)
    if old is None or fit.posterior.log_evidence > old.posterior.log_evidence:
        search.fits[ids] = fit
    search.failed.pop(ids, None)
    return search.fits[ids]


def _fit_from(
    search: Search,
    begin: Point,
    smooth: Sequence[Candidate],
    fixed: Values,
    most_scatter: tuple[float, ...] | None = None,
    rival: float = -np.inf,
) -> Fit | None:
    """One fit; None where runs cannot be simulated."""
    problem, tolerance, runs = search.problem, search.tolerance, search.runs
    try:
        fit = fit_model(problem, begin, smooth, tolerance, runs, fixed, most_scatter, rival=rival)
    except FloatingPointError:
        search.steps += 1
        return None
    search.steps += fit.steps
    return fit


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
    leaping = [term for term in search.terms.values() if term.stepwise]
    view = screen(search, nominal, (), leaping)
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
    _refit(search, view, [(offer,) for offer in ordered], most, search.null)
    pairs = [pair for pair in itertools.combinations(ordered[:PAIRED], 2) if pair[0][0] != pair[1][0]]
    gain = {pair: view.evidence(*pair) - max(view.evidence(pair[0]), view.evidence(pair[1])) for pair in pairs}
    pairs = sorted((pair for pair in pairs if gain[pair] > PROMISING), key=lambda pair: -view.evidence(*pair))
    _refit(search, view, pairs, PAIRS_FROM_NULL, search.null)


def extend(search: Search, ids: frozenset[str]) -> None:
    """Linearize at a fitted set, and fit it with each of the most promising additions."""
    fit = search.reached(ids)
    assert fit is not None
    smooth = [effect for effect in sorted(ids) if not search.terms[effect].stepwise]
    view = screen(search, fit.point, smooth, [term for effect, term in search.terms.items() if effect not in ids])
    ordered = _ordered(view, view.offers)
    base = view.evidence()
    worthwhile = [(offer,) for offer in ordered if view.evidence(offer) > base + PROMISING]
    _refit(search, view, worthwhile, ADDITIONS_REFITTED, fit)


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
        if tries.get(ids, 0) >= 2 or len(ids) > LARGEST_SET:
            continue
        evidence = view.evidence(*offers)
        top = max(top, evidence)
        if evidence < top - HOPELESS and len(tries) >= 3 and most < len(search.terms):
            break
        tries[ids] = tries.get(ids, 0) + 1
        starts = {effect: view.start_of((effect, extra)) for effect, extra in offers}
        fit_set(search, ids, starts, origin, explained)
