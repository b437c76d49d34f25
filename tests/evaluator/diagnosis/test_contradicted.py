"""Tolerances that the runs contradict do not hold values back."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.diagnosis import deciding
from evaluator.diagnosis.inference.watch import SearchStoppedError

TOLERANCE = {"slip.lateral_friction": 0.05, "slip.longitudinal_friction": 0.05, "plane, error 1": 1.0}
NOTHING: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Searched:
    """A search with the fit of its chosen set: the keys of the values far from their stated ones."""

    fits: dict[frozenset[str], Any]
    tolerance: dict[str, float] = field(default_factory=lambda: dict(TOLERANCE))

    def anew(self, tolerance: dict[str, float]) -> Searched:
        return replace(self, tolerance=tolerance, fits={})


@dataclass(frozen=True)
class Said:
    chosen: frozenset[str] = NOTHING
    known: Any = ()


def freed(first: list[str], then: list[list[str] | None], monkeypatch: pytest.MonkeyPatch) -> tuple[Searched, Any]:
    """The search and the answer after fits in which these values are far; None for a fit that does not converge."""
    fits = iter(then)
    session: Any = SimpleNamespace(
        tolerance=TOLERANCE, known="known to", data=[SimpleNamespace(systematic={"plane, error 1": 0.0})]
    )
    monkeypatch.setattr(deciding, "far", lambda fit, tolerance: frozenset(fit) if tolerance else None)
    monkeypatch.setattr(deciding, "fit_set", lambda *_: next(fits))
    monkeypatch.setattr(deciding, "knowledge", lambda *given: given)
    search: Any = Searched({NOTHING: first})
    said: Any = Said()
    found: Any = deciding._without_contradicted(search, said, session)
    return found


def test_a_contradicted_tolerance_is_ten_times_as_wide_and_its_value_fitted_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search, said = freed(["slip.lateral_friction"], [["slip.lateral_friction"]], monkeypatch)
    assert search.tolerance == {**TOLERANCE, "slip.lateral_friction": pytest.approx(0.5)}
    assert said.known == ("known to", ["slip.lateral_friction"])


def test_what_is_contradicted_then_is_freed_too(monkeypatch: pytest.MonkeyPatch) -> None:
    both = ["slip.longitudinal_friction", "slip.lateral_friction"]
    search, _ = freed(both[1:], [both, both], monkeypatch)
    assert search.tolerance == {"plane, error 1": 1.0, **dict.fromkeys(both, pytest.approx(0.5))}


@pytest.mark.parametrize("first", [[], ["plane, error 1"]])
def test_values_within_their_tolerances_and_errors_of_the_calibration_stay(
    first: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    search, _ = freed(first, [], monkeypatch)
    assert search == Searched({NOTHING: first})


def test_a_fit_that_fails_or_is_stopped_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    search, _ = freed(["slip.lateral_friction"], [None], monkeypatch)
    assert search.tolerance == TOLERANCE

    def stopped(*_: Any) -> None:
        raise SearchStoppedError(1.0)

    monkeypatch.setattr(deciding, "fit_set", stopped)
    session: Any = SimpleNamespace(tolerance=TOLERANCE, known=(), data=[])
    given: Any = Searched({NOTHING: ["slip.lateral_friction"]})
    said: Any = Said()
    assert deciding._without_contradicted(given, said, session)[0] == given
