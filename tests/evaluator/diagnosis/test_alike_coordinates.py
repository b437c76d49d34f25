"""Fits begin also far from where one ended, at coordinates that act nearly alike there: other magnets, farther away."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.inference import strategy
from evaluator.diagnosis.inference.strategy import fit_alike
from simulator.effects.coordinates import Candidate

FOUND = (6.4, 21.6, 14.1, 4.45)


def offered(effect: str) -> Candidate:
    return named_terms(20.0, (30.0, 60.0))[effect]


def alike_to(values: tuple[float, ...]) -> tuple[tuple[float, ...], ...]:
    alike = offered("stray-magnet").alike
    assert alike is not None
    return alike(values)


def pull(values: tuple[float, ...], at_mm: float) -> float:
    """Force, mN, toward the magnet of a robot so far from the middle on the way to it, without the softening nearby."""
    force, x, y, exponent = values
    return force * (10.0 / (math.hypot(x, y) - at_mm)) ** exponent


def test_magnets_alike_pull_as_strongly_in_the_middle_of_the_plate_and_change_as_fast_there() -> None:
    found = alike_to(FOUND)
    assert [values[3] for values in found] == [1.0, 2.0, 3.0]  # 4 is near
    for values in found:
        assert values[2] / values[1] == pytest.approx(14.1 / 21.6)
        assert pull(values, 0.0) == pytest.approx(pull(FOUND, 0.0))
        assert pull(values, 0.1) / pull(values, -0.1) == pytest.approx(pull(FOUND, 0.1) / pull(FOUND, -0.1), rel=1e-4)
    assert [values[3] for values in alike_to((0.4, 10.0, 0.0, 2.0))] == [1.0, 3.0, 4.0]


@pytest.mark.parametrize("values", [(0.0, 5.0, 5.0, 2.0), (1.0, 0.0, 0.0, 2.0), (1.0, 5.0, 5.0, 0.0)])
def test_what_does_not_act_or_has_no_direction_or_no_fall_off_has_none_alike(values: tuple[float, ...]) -> None:
    assert alike_to(values) == ()


def test_the_best_set_is_fitted_again_from_there_with_everything_else_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With an exponent of 4.5, a fit ended 40 below that of 2, and all four intervals missed the truth."""
    asked: list[Any] = []
    monkeypatch.setattr(strategy, "fit_set", lambda *given: asked.append(given))
    best = frozenset({"stray-magnet", "plate-tilt"})
    fit = SimpleNamespace(point=SimpleNamespace(terms={"stray-magnet": FOUND, "plate-tilt": (0.1, 0.2)}))
    terms = {effect: offered(effect) for effect in best}
    search: Any = SimpleNamespace(ranked=lambda: [best, frozenset()], fits={best: fit}, terms=terms)
    fit_alike(search)
    assert [(given[0], given[1], given[3]) for given in asked] == [(search, best, fit)] * 3
    assert [given[2] for given in asked] == [{"stray-magnet": start} for start in alike_to(FOUND)]
    far = offered("stray-magnet").clipped((1.0, 1e6, 0.0, 2.0))
    fit.point.terms["stray-magnet"] = (1e-3, 0.9 * far[1], 0.0, 1.0)
    asked.clear()
    fit_alike(search)
    assert {given[2]["stray-magnet"][1] for given in asked} == {far[1]}  # within the bounds
