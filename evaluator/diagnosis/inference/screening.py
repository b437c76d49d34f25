"""Linear screening: expected gain of every candidate, alone and together, from one linearization of all runs.

A candidate with initial values at which it acts (a delay of the motors, a limit below some commands) is linearized
there: the model includes the whole change to these values, and the derivatives there. Derivatives alone, applied to the
motion without the effect, would not show the gain.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from evaluator.diagnosis.inference.fitted_model import model_columns, prior_precision
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.linear.mixed_model import MixedModel, reduce_runs
from evaluator.diagnosis.likelihood.point import Column, Point
from simulator.effects.coordinates import Candidate

MOST_STARTS = 32  # of a stepwise term in one linearization; 15 and 22 runs with logs held 27 and 34 levels for long


@dataclass(frozen=True)
class Screen:
    """Linearization at a point: a mixed model over all columns, and the columns of each candidate."""

    columns: tuple[Column, ...]
    model: MixedModel
    beyond: MixedModel  # the same given base
    base: tuple[int, ...]  # nominal values and the terms already in
    offers: tuple[tuple[str, tuple[int, ...]], ...]  # candidate id (several starting places: several offers), columns
    whole: Mapping[int, int]  # by first column of an offer with start values: column of the whole change to these

    def evidence(self, *offers: tuple[str, tuple[int, ...]]) -> float:
        """Log evidence with some offers included; all parameters of a candidate count, also those not yet varied."""
        columns: list[int] = []
        hidden = 0
        model = self._begun(*offers)
        for _, extra in offers:
            columns += extra
            term = self.columns[extra[0]].term
            assert term is not None
            hidden += term.size - len(extra)
        return model.log_evidence(columns) - 0.5 * hidden * math.log(self.model.runs)

    def start_of(self, offer: tuple[str, tuple[int, ...]]) -> tuple[float, ...]:
        """Coordinates at which a full fit of an offer should begin."""
        _, extra = offer
        term = self.columns[extra[0]].term
        assert term is not None
        place, to = self.columns[extra[0]].start, self.columns[extra[0]].to
        if to is not None:
            return to
        if place is None:
            return term.absent
        values = list(place)
        for i, mean in zip(extra, self._begun(offer).posterior(extra).mean, strict=True):
            values[self.columns[i].coordinate] += float(mean)
        begun = term.clipped(tuple(values))
        # Where a linearization leads beyond the bound at which an effect does not act (a magnet that repels), no fit
        # finds its place. The effect may be there: of a magnet that gains 260, two fits ended without force.
        return begun if term.acts_at(begun) else (begun[0] + term.coordinates[0].step, *begun[1:])

    def _begun(self, *offers: tuple[str, tuple[int, ...]]) -> MixedModel:
        """The model given base, with the whole changes to the initial values of some offers."""
        return self.beyond.taken([self.whole[extra[0]] for _, extra in offers if extra[0] in self.whole])


def screen(search: Search, point: Point, inside: Sequence[str], candidates: Iterable[Candidate]) -> Screen:
    """Linearize at a point with the terms inside and every candidate not inside.

    Of many values of a stepwise term, a few are tried, and again between the neighbours of the best of them.
    """
    every = tuple(candidates)
    many = [term for term in every if term.stepwise and term.id not in inside and len(term.starts) > MOST_STARTS]
    tried = {term.id: _spread(0, len(term.starts) - 1) for term in many}
    while True:
        view = _screened(search, point, inside, [_of_starts(term, tried.get(term.id)) for term in every])
        finer = {term.id: _about_best(view, term, tried[term.id]) for term in many}
        if finer == tried:
            return view
        tried = finer


def _spread(first: int, last: int) -> list[int]:
    """At most MOST_STARTS indices from the first to the last one."""
    return [int(k) for k in np.unique(np.linspace(first, last, min(last - first + 1, MOST_STARTS)).round())]


def _of_starts(term: Candidate, tried: Sequence[int] | None) -> Candidate:
    return term if tried is None else replace(term, starts=tuple(term.starts[k] for k in tried))


def _about_best(view: Screen, term: Candidate, tried: list[int]) -> list[int]:
    """Indices of starts between the neighbours of the best one tried; the same, if there are no others."""
    mine = [offer for offer in view.offers if offer[0] == term.id]
    if not mine:
        return tried
    best = term.starts.index(view.start_of(max(mine, key=view.evidence)))
    at = tried.index(best)
    first, last = tried[max(at - 1, 0)], tried[min(at + 1, len(tried) - 1)]
    return tried if last - first <= 2 else _spread(first, last)


def _screened(search: Search, point: Point, inside: Sequence[str], candidates: Iterable[Candidate]) -> Screen:
    """The linearization of screen with all starts of the candidates."""
    columns = [*model_columns([search.terms[effect] for effect in inside], search.tolerance, search.problem.given)]
    base = tuple(range(len(columns)))
    offers, whole = [], {}
    for term in candidates:
        if term.id in inside:
            continue
        new: list[tuple[Column, ...]]
        if term.stepwise:
            new = [(Column(term.id, 0, term, to=start),) for start in term.starts]
        elif term.starts:
            new = [
                tuple(Column(term.id, i, term, start) for i in (range(term.size) if term.acts_at(start) else (0,)))
                for start in term.starts
            ]
        else:
            new = [tuple(Column(term.id, i, term) for i in range(term.size))]
        for group in new:
            offers.append((term.id, tuple(range(len(columns), len(columns) + len(group)))))
            columns += group
            begun = group[0].start
            if begun is not None and term.acts_at(begun):
                whole[offers[-1][1][0]] = len(columns)
                columns.append(Column(term.id, 0, term, to=begun))
    linear = search.problem.linearized(point, columns, search.runs)
    model = MixedModel(reduce_runs(linear), prior_precision(columns, search.tolerance))
    beyond = model.given(base)
    able = [
        (effect, extra)
        for effect, extra in offers
        if columns[extra[0]].to is None or _wants_whole_change(beyond, extra)
    ]
    return Screen(tuple(columns), model, beyond, base, tuple(able), whole)


def _wants_whole_change(beyond: MixedModel, extra: tuple[int, ...]) -> bool:
    """Whether the data support about the whole change; half of a stopped motor is impossible."""
    return bool(0.5 < beyond.posterior(extra).mean[-1] < 1.5)
