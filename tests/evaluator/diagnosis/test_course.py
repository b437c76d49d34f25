"""When a fit ends: what is left to gain, how far it is behind, and whether it goes round."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.inference.ahead import Course


def ends(promises: list[float], lags: list[float] | None = None, friction: float = 0.0) -> list[bool | None]:
    """What is said of each view of a fit, by the decrease that it promises and how far behind its rival it is."""
    course = Course()
    lagging = lags or [0.0] * len(promises)
    views: list[Any] = [SimpleNamespace(predicted=value, per_run=np.array([[friction, 0, 0, 0]])) for value in promises]
    return [course.end(view, lag) for view, lag in zip(views, lagging, strict=True)]


@pytest.mark.parametrize(
    ("promised", "lag", "end"), [(0.04, 0, True), (0.06, 0, None), (4.9, 59, None), (4.9, 61, True), (5.1, 61, None)]
)
def test_a_fit_ends_where_little_is_left_to_gain_or_all_too_little_to_matter(
    promised: float, lag: float, end: bool | None
) -> None:
    assert ends([promised], [lag]) == [end]


@pytest.mark.parametrize(
    ("promises", "end"),
    [
        ([8.0, 5.0, 6.0, 7.0], False),  # three views without half of the least before
        ([8.0, 5.0, 6.0, 4.9], True),  # where a failed step would have left it as well
        ([8.0, 5.0, 3.9, 3.0], None),  # the third view has halved it
        ([80.0, 41.0, 39.0, 20.0, 19.0], None),
    ],
)
def test_a_fit_that_goes_round_ends(promises: list[float], end: bool | None) -> None:
    assert ends(promises) == [None] * (len(promises) - 1) + [end]


@pytest.mark.parametrize(("lags", "end"), [([200, 101], False), ([200, 99], None), ([90, 59], None), ([90, 61], False)])
def test_a_fit_far_behind_its_rival_has_to_halve_what_it_lags_at_each_step(lags: list[float], end: bool | None) -> None:
    assert ends([1000.0, 100.0], lags) == [None, end]


@pytest.mark.parametrize(("promised", "friction", "end"), [(51, 0.6, False), (49, 0.6, None), (51, 0.4, None)])
def test_a_decrease_that_rests_on_friction_that_no_run_can_have_must_come(
    promised: float, friction: float, end: bool | None
) -> None:
    assert ends([100.0, promised], friction=friction) == [None, end]
