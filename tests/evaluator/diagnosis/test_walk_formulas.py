"""Ends of an interval by fits beside the best one, of densities that are known on paper."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.inference import profile_likelihood
from evaluator.diagnosis.inference.profile_likelihood import Profile, profile_of, profiles_of
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.output.silence import silent_reaches
from evaluator.turning.motion.curvature import Z_975
from simulator.effects.coordinates import Candidate, Coordinate

MEAN, SIGMA = 1.0, 0.5
LOW, HIGH = MEAN - Z_975 * SIGMA, MEAN + Z_975 * SIGMA


def walked(
    monkeypatch: pytest.MonkeyPatch,
    drop: Callable[[float], float],
    high: float = np.inf,
    lost: Callable[[float], bool] = lambda _: False,
) -> tuple[Profile | None, list[float]]:
    """The profile of a size of 1 ± 0.5, and where fits were made; drop: of -2 log density, by the size.

    The second coordinate follows the first by half of its change in the linear view, and by its square in the fits.
    """
    term = Candidate("bend", (Coordinate("size", 0.5, 1.0, -9.0, high + 0.5), Coordinate("other", 0.0, 1.0)), dict)
    columns = (Column("key"), Column("bend", 0, term), Column("bend", 1, term))
    covariance = np.diag([1.0, SIGMA**2, 0.0])  # the second coordinate has no interval of its own
    covariance[1, 2] = covariance[2, 1] = SIGMA**2 / 2
    point = Point(np.zeros((2, 7)), {"key": 0.0}, {"bend": (MEAN + 0.5, 0.0)})
    fit: Any = SimpleNamespace(
        columns=columns, point=point, runs=(0, 1), reduced=None,
        posterior=SimpleNamespace(covariance=covariance, best=np.zeros(4), misfit=50.0),
    )  # fmt: skip
    tried: list[float] = []

    def fit_model(_: Any, begin: Point, free: Any, __: Any, runs: Any, fixed: Any, held: Column) -> Any:
        assert (held, free, fixed, runs) == (columns[1], [term], {}, (0, 1))
        value = begin.value(held)
        assert begin.value(columns[2]) == pytest.approx((value - MEAN) / 2)
        tried.append(value)
        if lost(value):
            raise FloatingPointError
        there = point.moved(columns[1], value - MEAN).moved(columns[2], (value - MEAN) ** 2)
        return SimpleNamespace(point=there, converged=True, posterior=SimpleNamespace(misfit=50.0 + drop(value)))

    class Model:
        def __init__(self, *_: Any) -> None:
            pass

        def posterior(self, _: Any, __: Any) -> Any:
            return SimpleNamespace(covariance=covariance)

    monkeypatch.setattr(profile_likelihood, "MixedModel", Model)
    monkeypatch.setattr(profile_likelihood, "fit_model", fit_model)
    search: Any = SimpleNamespace(
        problem=SimpleNamespace(open_ground=False), terms={"bend": term}, tolerance={"key": 1.0}
    )
    found = profile_of(search, fit, term)
    search.fits = {frozenset({"bend"}): fit}
    tried_once = list(tried)
    assert set(profiles_of(search, frozenset({"bend"}))) == ({"bend"} if found else set())
    search.problem.open_ground = True
    assert profiles_of(search, frozenset({"bend"})) == {}
    return found, tried_once


def test_an_interval_of_a_normal_density_needs_no_fits_beyond_its_two_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    found, tried = walked(monkeypatch, lambda size: ((size - MEAN) / SIGMA) ** 2)
    assert found is None
    assert tried == pytest.approx([LOW, HIGH])


@pytest.mark.parametrize(("times", "profiled"), [(1.27, True), (1.23, False), (1 / 1.27, True), (1 / 1.23, False)])
def test_an_end_that_lies_a_quarter_farther_or_nearer_is_fitted(
    times: float, profiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, _ = walked(monkeypatch, lambda size: ((size - MEAN) / SIGMA / (times if size > MEAN else 1.0)) ** 2)
    assert (found is not None) == profiled
    if found is not None:
        assert (found.low, found.high) == pytest.approx((LOW, MEAN + times * (HIGH - MEAN)), rel=1e-6)


def test_each_end_is_where_the_density_has_dropped_by_that_of_95_percent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twice as steep below, and half as steep above; the other coordinate is that of the fits."""
    found, tried = walked(monkeypatch, lambda size: ((size - MEAN) / SIGMA * (2.0 if size < MEAN else 0.5)) ** 2)
    assert found is not None
    low, high = MEAN - Z_975 * SIGMA / 2, MEAN + Z_975 * SIGMA * 2
    assert (found.column, found.low, found.high) == (1, pytest.approx(low), pytest.approx(high))
    assert tried == pytest.approx([LOW, HIGH, low, high])
    assert found.at == pytest.approx([LOW, low, MEAN, HIGH, high])
    np.testing.assert_allclose(found.best[:, 1], found.at)
    np.testing.assert_allclose(found.best[:, 2], (found.at - MEAN) ** 2, atol=1e-12)
    assert found.follow(np.array([(LOW + low) / 2]))[0, 2] == pytest.approx(((LOW - MEAN) ** 2 + (low - MEAN) ** 2) / 2)
    middle = found.follow(np.array([(MEAN + HIGH) / 2, 2 * high - HIGH]))
    assert middle[0, 2] == pytest.approx((HIGH - MEAN) ** 2 / 2)
    assert middle[1, 2] == pytest.approx(2 * (high - MEAN) ** 2 - (HIGH - MEAN) ** 2)


def test_an_end_is_known_to_a_tenth(monkeypatch: pytest.MonkeyPatch) -> None:
    """A density that drops evenly, by twice as much at the end: each estimate is the root of half the one before."""
    found, tried = walked(
        monkeypatch, lambda size: Z_975 * 2 * (size - MEAN) / SIGMA if size > MEAN else ((size - MEAN) / SIGMA) ** 2
    )
    assert found is not None
    above = [(value - MEAN) / (HIGH - MEAN) for value in tried if value > MEAN]
    assert above == pytest.approx([1.0, 0.5**0.5, 0.5**0.75])  # and then 0.545, by 8 % less
    assert (found.high - MEAN) / (HIGH - MEAN) == pytest.approx(0.5**0.875)


def test_an_end_moves_by_three_times_at_most_and_four_fits_are_made_of_each(monkeypatch: pytest.MonkeyPatch) -> None:
    found, tried = walked(monkeypatch, lambda size: 0.0 if size > MEAN else ((size - MEAN) / SIGMA) ** 2)
    assert found is not None
    assert [(value - MEAN) / (HIGH - MEAN) for value in tried if value > MEAN] == pytest.approx([1, 3, 9, 27])
    assert (found.high - MEAN) / (HIGH - MEAN) == pytest.approx(81)


def test_an_end_beyond_a_bound_is_told_by_the_density_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 1.4, two fifths of 0.98 away, the density has dropped by what it would a sixteenth of as far."""
    found, tried = walked(monkeypatch, lambda size: ((size - MEAN) / SIGMA / 4) ** 2 if size > MEAN else 9.0, high=1.4)
    assert found is not None
    assert [value for value in tried if value > MEAN] == pytest.approx([1.4])  # asked once
    assert (found.high - MEAN) / 0.4 == pytest.approx(3.0)  # not by more than three times


def test_where_no_fit_succeeds_an_end_comes_half_of_the_way_back(monkeypatch: pytest.MonkeyPatch) -> None:
    found, tried = walked(
        monkeypatch, lambda size: ((size - MEAN) / SIGMA) ** 2, lost=lambda size: size > MEAN + 0.6 * (HIGH - MEAN)
    )
    assert found is not None
    above = [(value - MEAN) / (HIGH - MEAN) for value in tried if value > MEAN]
    assert above == pytest.approx([1.0, 0.5, 1.0, 0.75])  # half of the way to the start, then to what is known
    assert (found.high - MEAN) / (HIGH - MEAN) == pytest.approx((0.75 + 0.5) / 2)


def test_draws_at_the_ends_of_the_linear_interval_are_at_those_of_the_profile() -> None:
    """What else varies follows the profile, and keeps what it has beside its share of the coordinate."""
    profile = Profile(1, 0.5, 4.0, np.array([0.5, 1.0, 4.0]), np.array([[7.0, 0.5], [3.0, 1.0], [9.0, 4.0]]))
    mean, covariance = np.array([3.0, 1.0]), np.array([[1.0, 0.3], [0.3, 0.25]])
    sigma = 0.5 * Z_975
    draws = np.array([[3.0, 1.0 + sigma], [3.0, 1.0 - sigma], [3.0, 1.0]])
    found = profile.transform(draws, mean, covariance)
    np.testing.assert_allclose(found[:, 1], [4.0, 0.5, 1.0])
    beside = Z_975 * 0.3 / 0.5  # what a linear view expects of the first coordinate there
    np.testing.assert_allclose(found[:, 0], [9.0 - beside, 7.0 + beside, 3.0])


LINE = Candidate("line", (Coordinate("size", 0.0, 1.0),), dict)


def silent(misfit: Callable[[float], float], *, seen: bool = False) -> dict[int, float]:
    """Reaches of a fit of one known value and one size at 1, of two runs that both miss by so much at other sizes."""
    columns = (Column("key"), Column("line", 0, LINE))
    common = np.zeros((3, 2))
    common[1, 1] = seen
    point = Point(np.zeros((2, 7)), {}, {"line": (1.0,)})
    fit: Any = SimpleNamespace(columns=columns, point=point, runs=(0, 1), linearized=[SimpleNamespace(common=common)])

    def features(tasks: Any) -> list[np.ndarray]:
        return [np.array([0.6, 0.8]) * misfit(task.terms["line"][0] - 1.0) for task in tasks]

    problem: Any = SimpleNamespace(features=features)
    return silent_reaches(problem, fit)


def test_what_no_run_informs_reaches_to_where_two_runs_miss_by_that_of_95_percent() -> None:
    """By 5 a unit each beyond 3: together 1.96² at 0.277 more, found to a sixty-fourth of a doubling."""
    found = silent(lambda size: 2.0 + 5 * max(size - 3.0, 0.0))
    exact = 3.0 + (np.sqrt(4 + Z_975**2 / 2) - 2.0) / 5
    assert list(found) == [1]
    assert exact - 3.2 / 64 <= found[1] <= exact
    assert silent(lambda _: 2.0) == {1: np.inf}
    assert silent(lambda size: np.nan if size > 0.7 else 2.0)[1] == pytest.approx(0.7, abs=0.4 / 64)
    assert silent(lambda _: 2.0, seen=True) == {}
