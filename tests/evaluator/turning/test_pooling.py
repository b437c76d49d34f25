from __future__ import annotations

import numpy as np
import pytest

from evaluator.turning.pooling import difference, pooled


def test_scatter_between_runs_is_told_from_measurement_uncertainty() -> None:
    rng = np.random.default_rng(0)
    sigmas = rng.uniform(0.01, 0.03, 400)
    values = 5.0 + 0.05 * rng.normal(size=400) + sigmas * rng.normal(size=400)
    pool = pooled(values, sigmas)
    assert pool.between == pytest.approx(0.05, rel=0.1)
    assert pool.within == pytest.approx(np.sqrt(np.mean(sigmas**2)))
    assert pool.p_same < 1e-6


def test_runs_that_agree_have_no_scatter_between_them() -> None:
    pool = pooled(np.array([5.0, 5.001, 4.999]), np.array([0.01, 0.01, 0.01]))
    assert pool.between == 0.0
    assert pool.p_same > 0.9


@pytest.mark.parametrize("runs", [3, 6])
def test_interval_of_few_repetitions_holds(runs: int) -> None:
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(300):
        sigmas = rng.uniform(0.01, 0.05, runs)
        pool = pooled(5.0 + 0.05 * rng.normal(size=runs) + sigmas * rng.normal(size=runs), sigmas)
        held += pool.low <= 5.0 <= pool.high
    assert 0.91 <= held / 300 <= 0.99  # three standard errors of 300 runs


@pytest.mark.parametrize("known", [True, False])
def test_interval_of_a_difference_holds_for_unequal_scatter(known: bool) -> None:
    rng = np.random.default_rng(2)
    held = 0
    for _ in range(300):
        parts = []
        for mean, between, runs in ((5.0, 0.02, 3), (4.9, 0.08, 5)):
            sigmas = np.full(runs, 0.01)
            values = mean + between * rng.normal(size=runs) + sigmas * rng.normal(size=runs)
            parts.append(pooled(values, sigmas if known else np.zeros(runs)))
        value, low, high = difference(*parts)
        assert low < value < high
        held += low <= -0.1 <= high
    assert 0.91 <= held / 300 <= 0.99


def test_nothing_to_pool_gives_nothing_and_one_value_its_own_interval() -> None:
    assert pooled(np.array([np.nan]), np.array([0.1])).runs == 0
    one = pooled(np.array([5.0]), np.array([0.1]))
    assert (one.low, one.high) == pytest.approx((4.804, 5.196))
    assert np.isnan(one.between)
    assert np.isnan(pooled(np.array([5.0]), np.array([0.0])).low)


def test_what_all_runs_share_widens_the_mean_and_is_no_scatter() -> None:
    pool = pooled(np.array([5.0, 5.001, 4.999]), np.array([0.001, 0.001, 0.001]))
    wide = pool.with_systematic(0.05)
    assert wide.between == pool.between
    assert wide.high - wide.mean == pytest.approx(1.96 * 0.05, rel=0.01)
