"""The mixed model against dense Gaussians and against its integral by quadrature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.linear.mixed_model import (
    FRICTION_SCATTER,
    GAIN_SCATTER,
    MixedModel,
    Reduced,
    at_scatter,
    reduce_runs,
    run_effects,
    solve_at,
    solve_within,
)
from tests.evaluator.diagnosis.synthetic import FEATURES, free_of_start, linear_runs, minus_two_log

TAU = np.array([0.05, 0.02, 0.02, 1.0])
PRIOR = np.array([0.7**-2.0, 0.0])  # a nominal value known to 0.7, and an effect


def few_scatters(model: MixedModel) -> np.ndarray:
    """Grid points at which a test looks: corners and the middle."""
    return np.array([0, 7, 120, len(model.tau) - 1])


def test_grid_of_scatters_holds_every_friction_with_every_gain_and_both_gains_alike() -> None:
    tau = MixedModel(reduce_runs(linear_runs()), PRIOR).tau
    assert len(tau) == len(FRICTION_SCATTER) * len(GAIN_SCATTER)
    assert {(f, g) for f, g in tau[:, :2]} == {(f, g) for f in FRICTION_SCATTER for g in GAIN_SCATTER}
    np.testing.assert_array_equal(tau[:, 1], tau[:, 2])
    assert (tau[:, 3] == 1.0).all()
    assert (FRICTION_SCATTER[0], FRICTION_SCATTER[-1]) == pytest.approx((5e-4, 0.3))
    assert (GAIN_SCATTER[0], GAIN_SCATTER[-1]) == pytest.approx((1e-4, 0.1))


def test_inner_products_at_every_scatter_are_the_dense_likelihood() -> None:
    runs = linear_runs()
    model = MixedModel(reduce_runs(runs), PRIOR)
    for at in few_scatters(model):
        for theta in (np.zeros(2), np.array([0.3, -1.2])):
            dense = sum(minus_two_log(run, theta, model.tau[at]) for run in runs)
            found = model.s[at] - 2 * model.g[at] @ theta + theta @ model.inner(at=[at])[0] @ theta + model.logdet[at]
            assert found == pytest.approx(dense, rel=1e-8)


def test_evidence_of_a_nominal_value_is_its_integral_by_quadrature_over_value_and_scatter() -> None:
    """Simpson's rule over the value, mean over the grid of scatters; also the mean and the variance of the value."""
    runs = linear_runs(parameters=1)
    model = MixedModel(reduce_runs(runs), PRIOR[:1])
    found = model.posterior([0])
    value = np.linspace(-6, 6, 4001)
    weight = np.ones(4001) * (value[1] - value[0])
    weight[[0, -1]] /= 2
    prior = np.exp(-0.5 * (value / 0.7) ** 2) / (0.7 * np.sqrt(2 * np.pi))
    square = model.s[:, None] - 2 * model.g * value + model.inner()[:, 0] * value**2 + model.logdet[:, None]
    joint = np.exp(-0.5 * (square - square.min())) * prior * weight
    total = joint.sum() / len(model.tau)
    assert found.log_evidence == pytest.approx(np.log(total) - 0.5 * square.min(), abs=1e-6)
    share = joint / joint.sum()
    mean = (share * value).sum()
    assert found.mean[0] == pytest.approx(mean, abs=1e-6)
    assert found.covariance[0, 0] == pytest.approx((share * (value - mean) ** 2).sum(), rel=1e-5)
    np.testing.assert_allclose(found.scatter, share.sum(axis=1) @ model.tau, rtol=1e-6)


def test_evidence_of_an_effect_is_its_best_likelihood_less_half_the_logarithm_of_the_runs() -> None:
    runs = linear_runs(count=7, parameters=1)
    model = MixedModel(reduce_runs(runs), np.zeros(1))
    best = model.s - model.g[:, 0] ** 2 / model.inner()[:, 0, 0] + model.logdet
    expected = np.log(np.mean(np.exp(-0.5 * (best - best.min())))) - 0.5 * best.min() - 0.5 * np.log(7)
    found = model.posterior([0])
    assert found.log_evidence == pytest.approx(expected, abs=1e-6)
    assert found.misfit == pytest.approx(best.min())
    assert found.best == np.argmin(best)
    empty = model.posterior([])
    dense = model.s + model.logdet
    assert empty.log_evidence == pytest.approx(np.log(np.mean(np.exp(-0.5 * (dense - dense.min())))) - dense.min() / 2)


def test_evidence_at_some_scatters_is_the_mean_over_these() -> None:
    model = MixedModel(reduce_runs(linear_runs()), PRIOR)
    parts = [model.posterior([0, 1], np.array([at])).log_evidence for at in (3, 100)]
    both = model.posterior([0, 1], np.array([3, 100]))
    assert both.log_evidence == pytest.approx(np.logaddexp(*parts) - np.log(2))
    assert both.best in (3, 100)


def test_model_given_its_base_has_the_evidence_and_the_parameters_of_the_whole() -> None:
    prior = np.array([0.7**-2.0, 0.4**-2.0, 0.0, 0.0])
    model = MixedModel(reduce_runs(linear_runs(parameters=4)), prior)
    beyond = model.given([0, 1])
    for extra in ([], [2], [2, 3]):
        whole, part = model.posterior([0, 1, *extra]), beyond.posterior(extra)
        assert part.log_evidence == pytest.approx(whole.log_evidence, abs=1e-6)
        np.testing.assert_allclose(part.mean, whole.mean[2:], rtol=1e-6)
        np.testing.assert_allclose(part.covariance, whole.covariance[2:, 2:], rtol=1e-5)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_column_that_the_base_says_already_brings_nothing_more(sign: int) -> None:
    """What is left of it is rounding, of either sign: its evidence was no number, and no order of candidates held."""
    runs = [replace(run, common=run.common[:, [0, 1, 1]]) for run in linear_runs()]
    model = MixedModel(reduce_runs(runs), np.zeros(3))
    model.whole[2, 2] *= 1 + sign * 5e-12
    given = model.given([0, 1])
    nothing = given.posterior([]).log_evidence - 0.5 * np.log(len(runs))
    assert given.posterior([2]).log_evidence == pytest.approx(nothing)


def test_runs_with_some_parameters_fixed_are_those_of_the_response_less_what_these_make() -> None:
    runs = linear_runs()
    fixed = np.array([0.0, 0.8])
    found = reduce_runs(runs).of_columns(np.array([True, False]), fixed)
    for at, run in enumerate(runs):
        response, common, scatter = free_of_start(run)
        left = response - common @ fixed
        assert found.s[at] == pytest.approx(left @ left)
        np.testing.assert_allclose(found.g[at], common[:, :1].T @ left)
        np.testing.assert_allclose(found.G[at], common[:, :1].T @ common[:, :1])
        np.testing.assert_allclose(found.c[at], scatter.T @ left)
        np.testing.assert_allclose(found.C[at], scatter.T @ common[:, :1])
        np.testing.assert_allclose(found.A[at], scatter.T @ scatter)
    assert (found.size == FEATURES - 3).all()


def test_most_probable_parameters_at_a_scatter_solve_the_dense_normal_equations() -> None:
    runs = linear_runs()
    normal, right = np.diag(PRIOR), np.zeros(2)
    for run in runs:
        response, common, scatter = free_of_start(run)
        inverse = np.linalg.inv(np.eye(len(response)) + scatter @ np.diag(TAU**2) @ scatter.T)
        normal, right = normal + common.T @ inverse @ common, right + common.T @ inverse @ response
    reduced = reduce_runs(runs)
    np.testing.assert_allclose(solve_at(reduced, PRIOR, TAU), np.linalg.solve(normal, right), rtol=1e-8)
    s, g, G = at_scatter(reduced, TAU)
    np.testing.assert_allclose(G.sum(axis=0) + np.diag(PRIOR), normal, rtol=1e-8)
    np.testing.assert_allclose(g.sum(axis=0), right, rtol=1e-8)
    zero = [minus_two_log(run, np.zeros(2), TAU) - minus_two_log_width(run) for run in runs]
    np.testing.assert_allclose(s, zero, rtol=1e-8)


def minus_two_log_width(run: object) -> float:
    """Log determinant of the dense covariance."""
    _, _, scatter = free_of_start(run)  # type: ignore[arg-type]
    return float(np.linalg.slogdet(np.eye(len(scatter)) + scatter @ np.diag(TAU**2) @ scatter.T)[1])


def test_bounded_parameters_are_the_best_on_the_bounds() -> None:
    reduced = reduce_runs(linear_runs())
    free = solve_at(reduced, PRIOR, TAU)
    wide = solve_within(reduced, PRIOR, TAU, free - 1, free + 1)
    np.testing.assert_array_equal(wide, free)
    _, g, G = at_scatter(reduced, TAU)
    whole = G.sum(axis=0) + np.diag(PRIOR)
    for side in (-1, 1):
        end = free[0] - 0.5 * side
        low, high = (np.array([end if way == side else free[0] + 9 * way, free[1] + 5 * way]) for way in (-1, 1))
        bound = solve_within(reduced, PRIOR, TAU, low, high)
        assert bound[0] == pytest.approx(end)
        assert bound[1] == pytest.approx((g.sum(axis=0)[1] - whole[1, 0] * end) / whole[1, 1], rel=1e-6)


def test_parameters_that_no_run_responds_to_stay_absent_beside_others_at_their_bounds() -> None:
    """A limit of speed above all commands: rounding sought it at 1e140, where the robot stands still."""
    every, shown = reduce_runs(linear_runs(count=9, parameters=6)), np.array([1.0, 0, 1, 1, 0, 1])
    silent = replace(every, g=every.g * shown, G=every.G * np.outer(shown, shown), C=every.C * shown)
    low = np.where(shown, solve_at(silent, np.zeros(6), TAU) + 0.1, 0.0)
    found = solve_within(silent, np.zeros(6), TAU, low, np.full(6, np.inf))
    assert (found >= low).all()
    assert (found[shown == 0] == 0).all()
    assert np.abs(found).max() < 10


def test_own_numbers_of_a_run_are_those_of_the_dense_conditional() -> None:
    runs, theta = linear_runs(), np.array([0.3, -0.4])
    means, covariances = run_effects(reduce_runs(runs), theta, TAU)
    for run, mean, covariance in zip(runs, means, covariances, strict=True):
        response, common, scatter = free_of_start(run)
        whole = np.eye(len(response)) + scatter @ np.diag(TAU**2) @ scatter.T
        gain = np.diag(TAU**2) @ scatter.T @ np.linalg.inv(whole)
        np.testing.assert_allclose(mean, gain @ (response - common @ theta), rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(covariance, np.diag(TAU**2) - gain @ scatter @ np.diag(TAU**2), atol=1e-9)


def test_start_poses_say_nothing_about_the_parameters() -> None:
    runs = linear_runs()
    moved = [type(run)(run.response + run.start @ [5.0, -3.0, 2.0], run.common, run.start, run.scatter) for run in runs]
    first, second = reduce_runs(runs), reduce_runs(moved)
    for name in Reduced.__dataclass_fields__:
        np.testing.assert_allclose(getattr(first, name), getattr(second, name), rtol=1e-9, atol=1e-9)


def test_evidence_and_interval_of_a_parameter_do_not_depend_on_its_unit() -> None:
    runs = linear_runs()
    unit = np.array([1.0, 1e-11])  # of a moment in µN·mm, which a robot of a metre feels from 10¹⁰ on
    small = [replace(run, common=run.common * unit) for run in runs]
    usual, tiny = (MixedModel(reduce_runs(item), PRIOR) for item in (runs, small))
    for columns in ([1], [0, 1]):
        one, other = (model.posterior(columns) for model in (usual, tiny))
        assert other.log_evidence == pytest.approx(one.log_evidence, abs=1e-6)
        assert other.mean * unit[columns] == pytest.approx(one.mean, rel=1e-6)
        told = other.covariance * np.outer(unit[columns], unit[columns])
        assert told == pytest.approx(one.covariance, rel=1e-6)
    beyond = [model.given([0]).posterior([1]).log_evidence for model in (usual, tiny)]
    assert beyond[1] == pytest.approx(beyond[0], abs=1e-6)


def test_a_parameter_that_is_taken_as_one_is_subtracted_from_the_response() -> None:
    runs = linear_runs()
    taken = MixedModel(reduce_runs(runs), PRIOR).taken([1])
    less = [replace(run, response=run.response - run.common[:, 1]) for run in runs]
    wanted = MixedModel(reduce_runs(less), PRIOR).posterior([0])
    found = taken.posterior([0])
    assert found.log_evidence == pytest.approx(wanted.log_evidence)
    assert found.mean == pytest.approx(wanted.mean)
    assert found.covariance == pytest.approx(wanted.covariance)
