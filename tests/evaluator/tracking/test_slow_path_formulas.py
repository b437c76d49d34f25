"""When a mark that looks wrong is fitted beside an edge or without what covers it, and for how long that goes on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.refinement import kernels, slow_path
from evaluator.tracking.refinement.disc import Edge
from evaluator.tracking.refinement.occluded_pixels import CORE, CORE_EXPECTED
from tests.evaluator.tracking.test_fit_kernels import path

EDGE = Edge(0.0, 9.0, 40.0, 90.0)


def frame(index: int = 1) -> Any:
    return SimpleNamespace(luma=None, row_origin=0, row_step=1, index=index)


@pytest.mark.parametrize(
    ("suspicious", "lately", "index", "residual", "sought"),
    [
        (False, 0, 1, 1.4, False),
        (True, 0, 1, 1.4, True),
        (False, 1, 1, 0.9, True),
        (False, 0, 4, 1.01, True),  # in every fourth frame, where more is left than usual
        (False, 0, 4, 0.99, False),
        (False, 0, 5, 1.01, False),
    ],
)
def test_what_covers_a_mark_is_sought_where_it_is_expected_and_now_and_then(
    suspicious: bool, lately: int, index: int, residual: float, sought: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, asked = path(residual=residual, sloped=residual), list[Any]()
    one.occluded_lately = lately
    monkeypatch.setattr(one, "_fit", lambda *_, **__: None)
    monkeypatch.setattr(one, "_fit_unoccluded", lambda *said: asked.append(said[2]) or (0.0, 0.0))  # type: ignore[func-returns-value]
    monkeypatch.setattr(one, "_glares", lambda _: False)
    assert not one.refit(frame(index), suspicious=suspicious)
    assert asked == [0.03] * sought
    assert one.occluded_lately == lately - 1


def test_what_was_seen_lately_is_expected_at_a_lower_contrast(monkeypatch: pytest.MonkeyPatch) -> None:
    one, cores = path(), list[Any]()
    monkeypatch.setattr(slow_path, "fit_uncovered", lambda *said: cores.append(said[-2:]) or (0.0, 0.0))  # type: ignore[func-returns-value]
    for one.occluded_lately in (0, 1):
        one._fit_unoccluded(frame(), one.result, 0.5)
    assert cores == [(CORE, 0.5), (CORE_EXPECTED, 0.5)]


def beside(found: Any, monkeypatch: pytest.MonkeyPatch, **said: Any) -> Any:
    """A slow path that finds an edge, or none, beside a mark; it notes how often it looks."""
    one: Any = path(residual=1.4, sloped=1.4)
    one.looked = 0

    def find_edge(*_: object) -> Any:
        one.looked += 1
        return found

    monkeypatch.setattr(one, "_fit", lambda *_, **__: None)
    monkeypatch.setattr(one, "_fit_unoccluded", lambda *_: (0.0, 0.0))
    monkeypatch.setattr(one, "_glares", lambda _: False)
    monkeypatch.setattr(one, "_sloping", lambda: said.get("sloping", True))
    monkeypatch.setattr(slow_path, "matters", lambda *_: said.get("matters", True))
    monkeypatch.setattr(slow_path, "cut_patch", lambda *_: None)
    monkeypatch.setattr(slow_path, "find_edge", find_edge)
    return one


def test_where_no_edge_is_found_none_is_sought_for_eight_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    one = beside(None, monkeypatch)
    for looked in [1] * 8 + [2]:
        one.refit(frame(), suspicious=False)
        assert one.looked == looked
    one = beside(None, monkeypatch)
    one.edge = EDGE  # it was there: it is looked for in each frame
    for looked in (1, 2):
        one.refit(frame(), suspicious=False)
        assert one.looked == looked
    for nothing in ({"sloping": False}, {"matters": False}):
        one = beside(None, monkeypatch, **nothing)
        one.refit(frame(), suspicious=False)
        assert one.looked == 0


def test_an_edge_is_sought_with_the_smear_and_the_noise_of_the_mark(monkeypatch: pytest.MonkeyPatch) -> None:
    views, one = list[Any](), beside(None, monkeypatch)
    one.disc[5:7], one.noise[:] = (3.0, -4.0), (9.0, 0.5)
    monkeypatch.setattr(slow_path, "find_edge", lambda view, *_: views.append(view))
    one.refit(frame(), suspicious=False)
    assert [(view.path_px, view.noise) for view in views] == [((3.0, -4.0), (9.0, 0.5))]


def test_an_edge_that_was_found_is_fitted_in_the_next_eight_frames_even_without_a_slope(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fitted = np.zeros(kernels.RESULTS)
    fitted[[kernels.X, kernels.VAR_X, kernels.VAR_Y, kernels.RESIDUAL]] = 0.5, 1e-4, 1e-4, 1.2
    one = beside((fitted, EDGE), monkeypatch)
    one.sloped[kernels.PIXELS], one.watch, one.occluded, one.occluded_lately = 200.0, 0, True, 5
    assert one.refit(frame(), suspicious=False)
    assert (one.edge, one.edge_lately, one.watch, one.occluded, one.occluded_lately) == (EDGE, 8, 8, False, 4)
    assert one.shift == pytest.approx((0.6 * 0.5, 0.0))
    assert one.result[kernels.X] == 0.5
    assert one.begin(frame())
    monkeypatch.setattr(one, "_sloping", lambda: False)
    monkeypatch.setattr(slow_path, "find_edge", lambda *_: None)
    for left in range(7, -1, -1):
        assert not one.refit(frame(), suspicious=False)
        assert (one.edge_lately, one.watch) == (left, left)
    assert not one.begin(frame())


def test_a_mark_that_was_not_fitted_stays_so() -> None:
    one = path()
    one.result[kernels.X] = np.nan
    assert not one.refit(frame(), suspicious=True)
