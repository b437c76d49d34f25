"""Linear screening: what every candidate promises, alone and together, from one linearization of all runs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from evaluator.diagnosis.inference.fit import prior_precision
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.mixed_model import MixedModel, reduce_runs
from evaluator.diagnosis.likelihood.problem import Column, Point
from simulator.effects.coordinates import Candidate


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
