"""Where an interval ends that the linear view does not describe, worked out on paper, without a simulation."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.inference import profile_likelihood
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.output import silence
from evaluator.turning.motion.curvature import Z_975
from simulator.effects.coordinates import Candidate, Coordinate

LINE = Candidate("line", (Coordinate("size", 0.0, 1.0),), lambda values: {"size": values[0]})


def profiled(monkeypatch: pytest.MonkeyPatch, misfit: Callable[[float], float | None], at_best: float = 1.0) -> Any:
    """Profile of a coordinate of variance 4, of which the scatter of the runs makes all but at_best times."""
    term = Candidate("line", (Coordinate("size", 0.0, 1.0, -1e3, 1e3),), LINE.physical)
    column = Column("line", 0, term)
    covariance = np.array([[4.0]])
    best = SimpleNamespace(posterior=SimpleNamespace(covariance=at_best * covariance))
    model = SimpleNamespace(posterior=lambda *_: best.posterior)
    monkeypatch.setattr(profile_likelihood, "MixedModel", lambda *_: model)
    started: Any = SimpleNamespace(
        columns=(column,),
        point=Point(np.zeros((1, 7)), terms={"line": (0.0,)}),
        posterior=SimpleNamespace(covariance=covariance, misfit=7.0, best=0),
        reduced=None,
        runs=(0,),
    )

    def held(_: Any, begin: Point, *__: Any, **___: Any) -> Any:
        value = misfit(begin.terms["line"][0])
        return SimpleNamespace(
            converged=value is not None, point=begin, posterior=SimpleNamespace(misfit=7.0 + (value or 0.0))
        )

    monkeypatch.setattr(profile_likelihood, "fit_model", held)
    search: Any = SimpleNamespace(terms={"line": term}, tolerance={}, problem=None)
    return profile_likelihood.profile_of(search, started, term)


@pytest.mark.parametrize(("above", "below"), [(1.3, 1.0), (6.0, 0.7), (1.0, 0.5)])
def test_an_end_lies_where_the_misfit_has_risen_as_much_as_for_95_percent(
    above: float, below: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A parabola that is wider or narrower than the linear view on either side; six times takes two steps."""
    half = 2 * Z_975
    found = profiled(monkeypatch, lambda v: Z_975**2 * (v / (half * (above if v > 0 else below))) ** 2)
    assert (found.low, found.high) == pytest.approx((-below * half, above * half))


def test_an_end_is_looked_for_in_four_steps_of_three_times_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    half = 2 * Z_975
    ends = [
        profiled(monkeypatch, lambda v, wide=wide: Z_975**2 * (v / (wide * half)) ** 2).high for wide in (30.0, 100.0)
    ]
    assert ends == pytest.approx([30 * half, 81 * half])


def test_a_linear_view_that_is_right_to_a_quarter_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    half = 2 * Z_975
    assert profiled(monkeypatch, lambda v: Z_975**2 * (v / (1.24 * half)) ** 2) is None
    assert profiled(monkeypatch, lambda v: 2 * Z_975**2 * (v / half) ** 2, at_best=0.5) is None  # scatter widens it


def test_an_end_that_cannot_be_fitted_is_looked_for_half_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    half = 2 * Z_975
    found = profiled(monkeypatch, lambda v: None if v > 0.61 * half else Z_975**2 * (v / (0.6 * half)) ** 2)
    assert found.high == pytest.approx(0.6 * half)


@pytest.mark.parametrize("stiffness", [1e-4, 1.0, 300.0])
def test_a_coordinate_that_no_slope_tells_reaches_as_far_as_the_misfit_allows(stiffness: float) -> None:
    column = Column("line", 0, LINE)
    runs: Any = SimpleNamespace(features=lambda tasks: [np.array([3.0, np.sqrt(stiffness) * tasks[0]])])
    point = SimpleNamespace(task=lambda _: 0.0, moved=lambda _, amount: SimpleNamespace(task=lambda _: amount))
    silent: Any = SimpleNamespace(
        columns=(column, column), point=point, runs=(0,), linearized=[SimpleNamespace(common=np.array([[0.0, 1.0]]))]
    )
    reach = Z_975 / np.sqrt(stiffness)
    assert silence.silent_reaches(runs, silent) == {0: pytest.approx(reach, rel=0.02)}
    nothing: Any = SimpleNamespace(features=lambda _: [np.zeros(2)])
    assert silence.silent_reaches(nothing, silent) == {0: np.inf}


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize(("slope", "silent"), [(1e-3, True), (0.3, False)])
def test_a_slope_by_rounding_says_nothing_of_a_value_at_its_bound(slope: float, closed: bool, silent: bool) -> None:
    """Beside a limit of each wheel, the lower end of a limit ahead that does not act was a ramp of 20 s."""
    term = Candidate("line", (Coordinate("size", 0.0, 1.0, 0.0, 1e3, closed=closed),), LINE.physical)
    point = Point(np.zeros((1, 7)), terms={"line": (0.0,)})
    views = [SimpleNamespace(common=np.full((1, 1), slope))]
    fit: Any = SimpleNamespace(columns=(Column("line", 0, term),), point=point, runs=(0,), linearized=views)
    runs: Any = SimpleNamespace(features=lambda tasks: [np.array([np.maximum(tasks[0].terms["line"][0] - 2.0, 0.0)])])
    expected = {0: pytest.approx(2.0 + Z_975, rel=0.02)} if silent and closed else {}
    assert silence.silent_reaches(runs, fit) == expected
