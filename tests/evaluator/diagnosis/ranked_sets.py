"""Searches that fitted sets of effects with given scores: real searches and rankings over fits that are made up."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.assessment import verdict
from evaluator.diagnosis.assessment.model_comparison import Standing, is_free, score, standing
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.point import Column
from simulator.effects.coordinates import Candidate, Coordinate

Set = frozenset[str]
NONE: Set = frozenset()
FAMILIES = 95
TOLERANCE = 0.02  # of every value known to one


def ranked(
    scores: Mapping[Set, float],
    *,
    on_ground: bool = False,
    at_bound: Iterable[Set] = (),
    sigmas: Mapping[Set, Mapping[str, float]] | None = None,
    sizes: Mapping[str, int] | None = None,
) -> tuple[Search, Standing]:
    """A search whose fits have these scores, and its ranking.

    at_bound: sets with an effect at a bound. sigmas: by set, values known to a tolerance that its fit moves, in
    tolerances. sizes: number of parameters of effects with several. Every free-form term has one coefficient of size 1.
    """
    moved = sigmas or {}
    fits: Any = {ids: _fit(ids, moved.get(ids, {}), at_bound=ids in set(at_bound)) for ids in scores}
    keys = dict.fromkeys(key for values in moved.values() for key in values)
    effects = sorted({effect for ids in scores for effect in ids})
    terms: Any = {effect: SimpleNamespace(size=(sizes or {}).get(effect, 1)) for effect in effects}
    problem: Any = SimpleNamespace(open_ground=on_ground, data=())
    search = Search(problem, terms, dict.fromkeys(keys, TOLERANCE), (), fits)
    for ids, wanted in scores.items():
        fits[ids].posterior.log_evidence = wanted - score(search, ids, FAMILIES)  # what the priors leave of it
    return search, standing(search, FAMILIES)


def _fit(ids: Set, sigmas: Mapping[str, float], *, at_bound: bool) -> SimpleNamespace:
    free = [Column(effect, 0, Candidate(effect, (Coordinate("size", 0.0, 0.1),), lambda _: {})) for effect in ids]
    columns = [*map(Column, sigmas), *(column for column in free if is_free(column.key))]
    values = {key: TOLERANCE * value for key, value in sigmas.items()}
    return SimpleNamespace(
        terms=ids,
        columns=columns,
        point=SimpleNamespace(value=lambda column: values.get(column.key, 1.0)),
        posterior=SimpleNamespace(log_evidence=0.0, covariance=1e-4 * TOLERANCE**2 * np.eye(len(columns))),
        at_bounds=ids if at_bound else NONE,
        unbelieved=NONE,
    )


def predicting(monkeypatch: pytest.MonkeyPatch, rule: Callable[[Set, Set], bool]) -> None:
    """Left-out commands are predicted better by a fitted set than by another one where the rule says so."""
    monkeypatch.setattr(
        verdict, "advantage", lambda one, other, *_: (9.0 if rule(one.terms, other.terms) else 0.0, 1.0)
    )
    monkeypatch.setattr(verdict, "predicts_better", lambda one, other, *_: rule(one.terms, other.terms))


def with_sigma(monkeypatch: pytest.MonkeyPatch, sigma: float) -> None:
    """Every column of a fit is known to this standard deviation over commands."""
    monkeypatch.setattr(verdict, "covariance_over_commands", lambda fit, *_: sigma**2 * np.eye(len(fit.columns)))
