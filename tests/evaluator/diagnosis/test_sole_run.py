"""Evidence that one run brings alone is a matter of that run; evidence that many share is one of the robot."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from evaluator.diagnosis.assessment import sole_run as module
from evaluator.diagnosis.assessment.adequacy import Adequacy
from evaluator.diagnosis.assessment.sole_run import (
    SoleRun,
    _misfits,
    hiding_run,
    is_needed_without,
    sole_gains,
    sole_misfit,
    sole_run,
)
from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.inference.fitted_model import Fit, prior_precision
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized, MixedModel, reduce_runs
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.run_data import PER_RUN
from tests.evaluator.diagnosis.synthetic import column, fit_of, linear_runs, minus_two_log

Floats = NDArray[np.float64]

RUNS, FEATURES = 10, 60
TERM = named_terms(50.0, (30.0,))["drive-speed-scale"]
NOMINAL, EFFECT = Column("body.mass_g"), Column(TERM.id, 0, TERM)
TOLERANCE = {"body.mass_g": 0.02}


def search(sizes: list[float]) -> Any:
    """Fits of no effect and of one, to runs in which it shows by so many sigmas each; every run has noise of 1."""
    rng = np.random.default_rng(8)
    linear = []
    for size in sizes:
        common = rng.normal(size=(FEATURES, 2)) / np.sqrt(FEATURES)
        response = rng.normal(size=FEATURES) + size * common[:, 1]
        own = rng.normal(size=(FEATURES, 7)) / np.sqrt(FEATURES)
        linear.append(Linearized(response, common, own[:, :3], own[:, 3:]))
    fits = {}
    for columns in ((NOMINAL,), (NOMINAL, EFFECT)):
        parts = [Linearized(r.response, r.common[:, : len(columns)], r.start, r.scatter) for r in linear]
        reduced = reduce_runs(parts)
        posterior = MixedModel(reduced, prior_precision(columns, TOLERANCE)).posterior(range(len(columns)))
        terms = {c.key: (c.absent + m,) for c, m in zip(columns[1:], posterior.mean[1:], strict=True)}
        point = Point(np.zeros((len(sizes), PER_RUN)), {}, terms)
        runs = tuple(range(len(sizes)))
        fits[frozenset(terms)] = Fit(
            frozenset(terms), point, columns, posterior, reduced, tuple(parts), converged=True, runs=runs
        )
    return SimpleNamespace(
        fits=fits, terms={TERM.id: TERM}, tolerance=TOLERANCE, evidence=lambda ids: fits[ids].posterior.log_evidence
    )


def found(sizes: list[float]) -> SoleRun | None:
    return sole_run(search(sizes), frozenset([TERM.id]), 0)


def test_an_effect_that_shows_in_one_run_alone_rests_on_that_run() -> None:
    one = found([0.0] * 6 + [40.0] + [0.0] * 3)
    assert one is not None
    assert one.run == 6
    assert one.without < 8.0 < one.gain


@pytest.mark.parametrize("sizes", [[10.0] * RUNS, [40.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0, 10.0]])
def test_an_effect_that_shows_in_every_run_rests_on_none_of_them(sizes: list[float]) -> None:
    assert found(sizes) is None


def test_a_weak_effect_that_needs_all_its_runs_is_not_owed_to_the_best_of_them() -> None:
    assert found([2.2] * RUNS) is None


def test_misfit_of_a_run_is_that_of_the_dense_gaussian_but_for_its_width() -> None:
    theta, tau, runs = np.array([0.4, -0.2]), np.array([0.05, 0.02, 0.02, 1.0]), linear_runs(count=4)
    found = _misfits(fit_of(runs, [column("a"), column("b")], theta, tau))
    dense = [
        minus_two_log(run, theta, tau) - minus_two_log(replace(run, response=run.common @ theta), theta, tau)
        for run in runs
    ]
    assert found == pytest.approx(dense, rel=1e-8)


@pytest.mark.parametrize(
    ("sizes", "needed"), [([0.0] * 6 + [40.0] + [0.0] * 3, False), ([10.0] * RUNS, True), ([10.0] * 9 + [0.0], True)]
)
def test_a_free_form_term_is_needed_without_a_run_if_the_others_show_it(sizes: list[float], needed: bool) -> None:
    asked, free = search(sizes), frozenset(["free:x"])
    fits = {frozenset(): asked.fits[frozenset()], free: asked.fits[frozenset([TERM.id])]}
    asked.fits, asked.evidence = fits, lambda ids: fits[ids].posterior.log_evidence
    assert is_needed_without(asked, free, 6, 100) == needed
    assert not is_needed_without(asked, frozenset(), 6, 100)
    assert not is_needed_without(asked, frozenset(["free:y"]), 6, 100)


def test_no_effect_rests_on_no_run() -> None:
    assert sole_run(search([0.0] * RUNS), frozenset(), 0) is None


@pytest.mark.parametrize(
    ("by_run", "suspect"),
    [((1.0, 1.0, 5.0, 1.0), 7), ((1.0, 5.0, 5.0, 1.0), None), ((1.0, 1.05, 1.1, 1.0), None)],
)
def test_left_overs_of_one_run_alone_are_told_from_those_of_many(
    by_run: tuple[float, ...], suspect: int | None
) -> None:
    left = Adequacy(float(np.mean(by_run)), 9.0, np.array(by_run), np.zeros((4, 4)), np.ones((4, 4)), 1.0, "")
    assert sole_misfit(left, (3, 5, 7, 9)) == suspect


def _left_of(effects: Floats, told: Floats | None = None) -> Adequacy:
    """Left-overs of runs with these random effects (n, 4), told to a share of their variance (n, 4), 1 if not given."""
    told = np.ones_like(effects) if told is None else told
    return Adequacy(1.0, 0.0, np.ones(len(effects)), effects, told, 1.0, "")


@pytest.mark.parametrize(
    ("off", "least", "named"), [(-0.33, 0.1, 4), (0.0, 0.1, None), (-0.02, 0.1, 4), (-0.02, 3, None)]
)
@pytest.mark.parametrize("common", [0.0, 0.05])  # the same in all runs
def test_a_run_whose_wheels_turn_unlike_those_of_all_others_is_found(
    off: float, least: float, named: int | None, common: float
) -> None:
    rng = np.random.default_rng(5)
    effects = rng.normal(size=(12, 4)) * [0.05, 2e-4, 2e-4, 1.0]
    effects[:, 1] += common
    effects[4, 1] += off
    assert sole_gains(_left_of(effects), tuple(range(12)), least) == named


@pytest.mark.parametrize(("times", "named"), [(0.999, None), (1.001, 11)])
def test_wheels_are_unlike_from_one_in_a_thousand_by_the_t_test_of_one_run_against_the_others(
    times: float, named: int | None
) -> None:
    """Of 12 runs with two sides each: a new value of 11 is off by √(1 + 1/11) of their scatter."""
    others = np.arange(-5.0, 6.0)
    limit = stats.t.isf(1e-3 / 2 / 24, 10) * others.std(ddof=1) * np.sqrt(1 + 1 / 11)
    effects = np.zeros((12, 4))
    effects[:, 1], effects[:, 2] = 1e-3 * np.append(others, times * limit), 1e-3 * np.append(others, 0.0)
    assert sole_gains(_left_of(effects), tuple(range(12)), 0.1) == named


@pytest.mark.parametrize(("times", "named"), [(0.999, None), (1.001, 5)])
@pytest.mark.parametrize("other_side", [0.2, 1.0, 2.0])
def test_beside_a_few_runs_that_agree_four_that_scatter_as_usual_are_counted(
    times: float, named: int | None, other_side: float
) -> None:
    """Six runs: a speed 7 % off, beside five within 0.4 %, is 1 in 1000 by these alone (a session of 30 November).

    Five happen to agree on one side where motors are bad; the scatter is then that of both sides.
    """
    others = 3e-3 * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    own = others.std(ddof=1)
    spread = own * max(1.0, np.sqrt((1 + other_side**2) / 2))
    usual = np.sqrt((4 * spread**2 + 4 * 0.006**2) / 8)
    limit = stats.t.isf(1e-3 / 2 / 12, 8) * usual * np.sqrt(1 + 1 / 5)
    assert limit < 0.7 * stats.t.isf(1e-3 / 2 / 12, 4) * own * np.sqrt(1 + 1 / 5)
    effects = np.zeros((6, 4))
    effects[:, 1], effects[:, 2] = np.append(others, times * limit), other_side * np.append(others, 0.0)
    assert sole_gains(_left_of(effects), tuple(range(6)), 0.1) == named


def test_wheel_speeds_that_scatter_in_all_runs_are_no_matter_of_one() -> None:
    rng = np.random.default_rng(6)
    effects = np.zeros((20, 4))
    effects[:, 1:3] = rng.normal(size=(20, 2)) * 0.03
    assert sole_gains(_left_of(effects), tuple(range(20)), 0.1) is None
    assert sole_gains(_left_of(0 * effects), tuple(range(20)), 0.1) is None


def test_a_run_that_tells_its_wheel_speeds_better_than_others_is_not_unlike_them() -> None:
    rng = np.random.default_rng(7)
    told = np.full((20, 4), 0.02)
    told[3] = 1.0
    told[4] = 0.0
    effects = rng.normal(size=(20, 4)) * 0.03 * np.sqrt(told)
    effects[3, 1] = 0.05
    assert sole_gains(_left_of(effects), tuple(range(20)), 0.1) == 3
    assert sole_gains(_left_of(effects, told), tuple(range(20)), 0.1) is None


def updated(monkeypatch: pytest.MonkeyPatch, covariance: np.ndarray, G: np.ndarray, g: np.ndarray) -> Any:
    """Parameters, at 0.3 each by a fit of this covariance, with a run of this information (p, p), (p,)."""
    monkeypatch.setattr(module, "reduce_runs", lambda _: None)
    monkeypatch.setattr(module, "at_scatter", lambda *_: (None, g[None], G[None]))
    monkeypatch.setattr(module, "bounds", lambda columns, _: (np.full(len(columns), -9.0), np.full(len(columns), 9.0)))
    problem: Any = SimpleNamespace(linearized=lambda *_: None)
    placed: Any = SimpleNamespace(value=lambda _: 0.3, at=lambda _, theta: theta)
    posterior = SimpleNamespace(covariance=covariance, scatter=None)
    fit: Any = SimpleNamespace(columns=tuple(range(len(g))), posterior=posterior)
    return module._updated(problem, fit, placed, 0, {})


def test_a_run_moves_the_parameters_of_a_fit_as_bayes_theorem_says(monkeypatch: pytest.MonkeyPatch) -> None:
    root, rows = np.random.default_rng(0).normal(size=(2, 3, 3))
    covariance, G = root @ root.T, rows.T @ rows
    g = G @ np.full(3, 0.3) + np.linalg.cholesky(G) @ [0.5, -0.3, 0.2]
    expected = np.linalg.solve(np.linalg.inv(covariance) + G, np.linalg.solve(covariance, np.full(3, 0.3)) + g)
    np.testing.assert_allclose(updated(monkeypatch, covariance, G, g), expected)


@pytest.mark.parametrize(("sigmas", "follows"), [(3.2, True), (-3.2, True), (3.4, False), (-3.4, False)])
def test_a_run_that_wants_parameters_beyond_chance_is_not_followed(
    monkeypatch: pytest.MonkeyPatch, sigmas: float, follows: bool
) -> None:
    """Of what a run tells three times better than the fit the two differ by the variances of both: 3.29 is a 1000th."""
    variance, information = 0.25, 12.0
    off = sigmas * np.sqrt(variance + 1 / information)
    found = updated(
        monkeypatch, np.array([[variance]]), np.array([[information]]), np.array([information * (0.3 + off)])
    )
    assert (found is not None) == follows


@pytest.mark.parametrize(("off", "scatter", "named"), [(0.2, 2e-3, 4), (0.009, 2e-4, None), (0.2, 0.03, None)])
def test_a_run_hides_effects_if_it_triples_the_scatter_by_ten_times_what_matters(
    off: float, scatter: float, named: int | None
) -> None:
    """A wheel 20 % faster among motors of 0.2 %; 0.9 % faster among better ones; 20 % faster among motors of 3 %."""
    effects = np.zeros((16, 4))
    effects[:, 1:3] = np.random.default_rng(8).normal(size=(16, 2)) * scatter
    effects[4, 2] += off
    assert hiding_run(_left_of(effects), tuple(range(16)), 0.1) == named


@pytest.mark.parametrize(("times", "named"), [(0.99, None), (1.01, 11)])
def test_the_scatter_with_a_hiding_run_is_three_times_that_without_it(times: float, named: int | None) -> None:
    others = np.tile([-1.0, 1.0], 6)[:11]
    others -= others.mean()
    # with an outlier at distance d: 11 var' = 10 var + d² 11 / 12, and var' = 9 var
    limit = np.sqrt(89 * 12 / 11) * others.std(ddof=1)
    effects = np.zeros((12, 4))
    effects[:, 1] = 0.01 * np.append(others, times * limit)
    effects[:, 2] = 0.01 * np.append(others, 0.0)
    assert hiding_run(_left_of(effects), tuple(range(12)), 0.1) == named
