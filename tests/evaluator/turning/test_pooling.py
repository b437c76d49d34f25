from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from evaluator.turning.pooling import Pooled, cochran, difference, p_of_difference, paule_mandel, pooled


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


def test_two_values_far_apart_scatter_by_what_their_uncertainty_leaves() -> None:
    """Squares about the mean of 0 and 10 are 50 = 1 + between²; Student's t of one degree of freedom is 12.706."""
    pool = pooled(np.array([0.0, 10.0, np.nan, 3.0]), np.array([1.0, 1.0, 1.0, np.inf]))
    assert (pool.runs, pool.freedom) == (2, 1.0)
    assert (pool.mean, pool.between, pool.within) == pytest.approx((5.0, 7.0, 1.0))
    assert pool.error == pytest.approx(5.0)
    assert (pool.low, pool.high) == pytest.approx((5 - 12.7062 * 5, 5 + 12.7062 * 5), rel=1e-5)
    assert pool.p_same == pytest.approx(1.5375e-12, rel=1e-3)  # chi-squared of 50, one degree of freedom


def test_values_that_agree_are_weighted_by_their_uncertainty_and_agreement_narrows_nothing() -> None:
    pool = pooled([5.0, 5.1, 5.0], [1, 2, 2])  # type: ignore[arg-type]
    assert pool.between == 0.0
    assert pool.mean == pytest.approx((5.0 + 5.1 / 4 + 5.0 / 4) / 1.5)
    assert pool.error == pytest.approx(np.sqrt(1 / 1.5))
    assert pool.high - pool.mean == pytest.approx(4.30265 * pool.error, rel=1e-5)
    assert pool.mean - pool.low == pytest.approx(4.30265 * pool.error, rel=1e-5)
    assert pool.p_same == pytest.approx(1.0, abs=0.01)


def test_scatter_of_unequal_uncertainties_solves_cochrans_equation() -> None:
    values, sigmas = np.array([0.0, 1.0, 5.0, 7.0]), np.array([0.5, 1.0, 0.5, 2.0])
    between = paule_mandel(values, sigmas)
    assert cochran(values, sigmas, between) == pytest.approx(3.0)
    weight = 1 / (sigmas**2 + between**2)
    assert cochran(values, sigmas, between) == pytest.approx(
        (weight * (values - np.average(values, weights=weight)) ** 2).sum()
    )


def test_values_of_unknown_uncertainty_scatter_by_their_standard_deviation() -> None:
    values = np.array([0.0, 0.0, 1.0, 1.0])
    pool = pooled(values, np.zeros(4))
    assert pool.between == pytest.approx(values.std(ddof=1))
    assert pool.error == pytest.approx(values.std(ddof=1) / 2)
    assert pool.within == 0.0
    assert np.isnan(pool.p_same)
    assert np.isnan(pooled(values, np.array([0.0, 1.0, 1.0, 1.0])).p_same)


def test_equal_values_of_no_uncertainty_keep_a_finite_interval() -> None:
    pool = pooled(np.array([2.0, 2.0, 2.0, 2.0]), np.zeros(4))
    assert (pool.mean, pool.between) == (2.0, 0.0)
    assert pool.error == pytest.approx(1e-12, rel=1e-6, abs=0)  # of 2e-12, the least that counts, and four values
    nought = pooled(np.zeros(4), np.zeros(4))  # a heading that no sample changes
    assert (nought.mean, nought.between) == (0.0, 0.0)


@pytest.mark.parametrize(("apart", "scatter"), [(0.999, False), (1.001, True)])
def test_scatter_begins_where_cochrans_sum_exceeds_its_expectation(apart: float, scatter: bool) -> None:
    values = np.array([0.0, np.sqrt(2) * apart])
    assert (paule_mandel(values, np.ones(2)) > 0) == scatter


def test_what_is_shared_widens_either_side_in_quadrature_and_what_is_not_known_nothing() -> None:
    pool = Pooled(mean=5.0, low=4.0, high=7.0)
    wide = pool.with_systematic(1.0)
    assert (wide.low, wide.high) == pytest.approx((5 - np.hypot(1, 1.96), 5 + np.hypot(2, 1.96)))
    for unknown in (np.nan, np.inf):
        assert (pool.with_systematic(unknown).low, pool.with_systematic(unknown).high) == pytest.approx((4.0, 7.0))


def test_difference_is_the_second_less_the_first_with_welchs_degrees_of_freedom() -> None:
    value, low, high = difference(Pooled(mean=5.0, error=0.3, freedom=4.0), Pooled(mean=7.0, error=0.4, freedom=9.0))
    freedom = 0.25**2 / (0.09**2 / 4 + 0.16**2 / 9)
    reach = stats.t.ppf(0.975, freedom) * 0.5
    assert (value, low, high) == pytest.approx((2.0, 2.0 - reach, 2.0 + reach))


def test_difference_of_single_runs_takes_their_uncertainty_as_known() -> None:
    one = pooled(np.array([5.0]), np.array([0.3]))
    assert (one.runs, one.within, one.error, one.freedom) == (1, 0.3, 0.3, np.inf)
    value, low, high = difference(one, pooled(np.array([7.0]), np.array([0.4])))
    assert (value, low, high) == pytest.approx((2.0, 2 - 1.959964 * 0.5, 2 + 1.959964 * 0.5))


@pytest.mark.parametrize("lacking", [Pooled(), Pooled(mean=5.0)])
def test_difference_of_what_is_not_known_has_no_bounds(lacking: Pooled) -> None:
    known = Pooled(mean=7.0, error=0.4, freedom=9.0)
    for pair in ((lacking, known), (known, lacking)):
        value, low, high = difference(*pair)
        assert value == pytest.approx(pair[1].mean - pair[0].mean, nan_ok=True)
        assert np.isnan([low, high]).all()


def test_probability_of_a_difference_is_that_of_welchs_test() -> None:
    first, second = np.array([7.8, 7.9, 8.1]), np.array([8.0, 8.3, 8.4, 8.9])
    means = [pooled(values, np.zeros(len(values))) for values in (first, second)]
    expected = stats.ttest_ind(first, second, equal_var=False).pvalue
    assert p_of_difference(*means) == pytest.approx(expected)
    assert p_of_difference(*means[::-1]) == pytest.approx(expected)
    exact = [Pooled(value, value, value, runs=1, error=0.0, freedom=np.inf) for value in (1.0, 1.0, 2.0)]
    assert (p_of_difference(*exact[:2]), p_of_difference(*exact[1:])) == (1.0, 0.0)
