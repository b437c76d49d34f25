"""Noise is taken from a set in which each effect is significant by the noise of the set without it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.diagnosis import search_runs
from evaluator.diagnosis.inference.search import log_prior
from evaluator.diagnosis.likelihood.noise.common_drift import CommonNoise
from evaluator.diagnosis.likelihood.noise.tracking import NO_DRIFT

NONE, MAGNET, STRAY = frozenset[str](), frozenset({"magnet"}), frozenset({"stray"})
BOTH = MAGNET | STRAY
SECOND = log_prior(1, 26) - log_prior(2, 26)  # what the prior takes from a second effect


def founded(
    monkeypatch: pytest.MonkeyPatch, own: dict[frozenset[str], float], first: dict[frozenset[str], float]
) -> tuple[frozenset[str], CommonNoise | None]:
    """The set that noise is taken from; own: log evidences with the noise of each set, first: with the first noise."""
    fits = {ids: SimpleNamespace(ids=ids) for ids in first}
    order = sorted(first, key=lambda ids: -first[ids])
    part: Any = SimpleNamespace(fits=fits, terms=range(26), explained=0.0, ranked=lambda: order, score=first.get)
    monkeypatch.setattr(search_runs, "fit_set", lambda *_: None)
    monkeypatch.setattr(search_runs, "common_noise", lambda _, fit, __: CommonNoise(NO_DRIFT, 0.0, own[fit.ids]))
    return search_runs.well_founded(part)


@pytest.mark.parametrize(("gain", "best"), [(8.1, BOTH), (7.9, MAGNET)])
def test_a_second_effect_counts_from_the_odds_that_keep_it(
    gain: float, best: frozenset[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first noise may favour it by far: it is that of a model without any effect."""
    own = {BOTH: 100.0 + SECOND + gain, MAGNET: 100.0, STRAY: 40.0, NONE: 0.0}
    found, noise = founded(monkeypatch, own, {BOTH: 90.0, MAGNET: 40.0, STRAY: 35.0, NONE: 0.0})
    assert found == best
    assert noise is not None
    assert noise.log_evidence == own[best]


def test_a_set_far_above_all_simpler_ones_needs_no_noise_of_theirs(monkeypatch: pytest.MonkeyPatch) -> None:
    assert founded(monkeypatch, {}, {MAGNET: 60.1, NONE: 0.0}) == (MAGNET, None)


def test_without_a_significant_effect_the_noise_is_that_of_the_plain_model(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = founded(monkeypatch, {STRAY: 10.0, NONE: 0.0}, {STRAY: 9.0, NONE: 0.0})
    assert found == NONE


def test_a_set_of_which_no_simpler_one_can_be_fitted_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search_runs, "fit_set", lambda *_: None)
    fit = SimpleNamespace(ids=MAGNET)
    part: Any = SimpleNamespace(fits={MAGNET: fit}, terms=range(26), explained=0.0, ranked=lambda: [MAGNET])
    assert search_runs.well_founded(part) == (MAGNET, None)
