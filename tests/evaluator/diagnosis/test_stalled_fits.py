"""A fit of a search that stalls is tried again from elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.inference import search as search_module
from evaluator.diagnosis.inference.search import fit_set
from evaluator.diagnosis.likelihood.point import Column, Point
from tests.evaluator.diagnosis.searches import NONE, of, searching

A = frozenset({"a"})


@pytest.mark.parametrize(
    ("first", "usual", "kept"),
    [
        (of(5.0, shortfall=17.0), of(9.0), 9.0),
        (of(5.0, shortfall=17.0), of(4.0), 5.0),
        (of(5.0, shortfall=17.0), of(9.0, converged=False), 5.0),
        (of(5.0, shortfall=17.0), None, 5.0),
        (of(5.0, shortfall=15.0), of(9.0), 5.0),  # near enough: not tried again
        (of(5.0, converged=False), of(4.0), 4.0),
    ],
)
def test_a_fit_far_from_what_it_promises_is_tried_again_from_the_usual_scatter(
    first: Any, usual: Any, kept: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fit_from(_: Any, __: Any, ___: Any, ____: Any, most_scatter: Any = None, rival: float = -np.inf) -> Any:
        assert rival == -np.inf
        return usual if most_scatter or tried else tried.append(1) or first

    tried: list[int] = []
    monkeypatch.setattr(search_module, "_fit_from", fit_from)
    found = fit_set(searching(fits={NONE: of(0.0)}), A, {}, of(0.0))
    assert found is not None
    assert found.posterior.log_evidence == kept


@pytest.mark.parametrize(("deviation", "led_to"), [(3.1, 9.0), (2.9, 5.0)])
def test_values_far_beyond_their_tolerances_are_led_back_where_a_fit_stalls(
    deviation: float, led_to: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """First with a tenth of their tolerances, then from there with the stated ones; the others keep theirs."""
    columns = (Column("far"), Column("near"))
    stalled, led, best = (of(evidence, shortfall=short) for evidence, short in ((5.0, 17.0), (-9.0, 0.0), (9.0, 0.0)))
    stalled.columns, stalled.point = columns, Point(np.zeros((2, 7)), {"far": deviation * 0.2, "near": 0.1})
    asked: list[tuple[Any, Any]] = []

    def fit_from(_: Any, begin: Any, *rest: Any, rival: float = -np.inf, tolerance: Any = None) -> Any:
        assert rival == -np.inf
        asked.append((begin, tolerance))
        if tolerance:
            return led
        return best if begin is led.point else None if len(rest) > 2 else stalled

    led.point = Point(np.zeros((2, 7)), {"far": 0.0})
    monkeypatch.setattr(search_module, "_fit_from", fit_from)
    search = searching(fits={NONE: of(0.0)})
    search.tolerance = {"far": 0.2, "near": 0.1, "other": 1.0}
    found = fit_set(search, A, {}, of(0.0))
    assert found is not None
    assert found.posterior.log_evidence == led_to
    firm = [tolerance for _, tolerance in asked if tolerance]
    assert firm == ([{"far": pytest.approx(0.02), "near": 0.1, "other": 1.0}] if led_to == 9.0 else [])
    assert not firm or next(begin for begin, tolerance in asked if tolerance) is stalled.point


def test_on_open_ground_a_fit_is_tried_again_only_where_it_lags(monkeypatch: pytest.MonkeyPatch) -> None:
    """There every fit ends where its linearization promises more."""
    for shortfall, tries in ((59.0, 1), (61.0, 2)):
        tried: list[Any] = []

        def fit_from(*_: Any, short: float = shortfall, told: list[Any] = tried, **__: Any) -> Any:
            return told.append(short) or (of(5.0, shortfall=short) if len(told) == 1 else None)

        monkeypatch.setattr(search_module, "_fit_from", fit_from)
        ground = searching(fits={NONE: of(0.0)})
        ground.problem.open_ground = True
        assert fit_set(ground, A, {}, of(0.0)) is not None
        assert len(tried) == tries


@pytest.mark.parametrize(("excess", "tries"), [(6.3, 1), (6.1, 2)])
@pytest.mark.parametrize("open_ground", [True, False])
def test_on_open_ground_what_leaves_ten_times_as_much_as_another_set_is_not_tried_again(
    excess: float, tries: int, open_ground: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It took half of a search whose noise a good set had set: four fits of each set that is far off."""
    tried: list[Any] = []
    first = of(5.0, shortfall=1e3)
    first.excess = excess

    def fit_from(*_: Any, **__: Any) -> Any:
        return tried.append(1) or (first if len(tried) == 1 else None)

    monkeypatch.setattr(search_module, "_fit_from", fit_from)
    good, bad = of(9.0), of(0.0)
    good.excess, bad.excess = 0.62, 80.0
    search = searching(fits={NONE: bad, frozenset("b"): good})
    search.problem.open_ground = open_ground
    assert fit_set(search, A, {}, bad) is first
    assert len(tried) == (tries if open_ground else 2)
