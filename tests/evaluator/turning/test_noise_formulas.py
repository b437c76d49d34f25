"""The noise of a steady motion against dense matrices, and what is averaged over its models."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from evaluator.turning.motion.least_squares import (
    CORRELATIONS,
    Averaged,
    Block,
    NoiseModel,
    averaged_least_squares,
    averaged_over_blocks,
    noise_models,
    responses,
)
from evaluator.turning.motion.whitening import whitened_moments

LENGTH_MM = 1.7
Array = np.ndarray


MODELS = [(0.0, 0.0), (0.7, 0.0), (-0.3, 0.0), (0.9, 0.5), (0.95, 0.85)]


def dense(time: Array, heading: Array, correlation: float, white: float) -> Array:
    """Covariance of the noise: of a process that turns with the image, the component along a body's axis is seen."""
    apart, turned = np.abs(time[:, None] - time), heading[:, None] - heading
    fade = np.where(apart == 0, 1.0, np.sign(correlation) ** apart * abs(correlation) ** apart)
    return np.asarray((1 - white) * fade * np.cos(turned) + white * np.eye(len(time)))


@pytest.mark.parametrize(("correlation", "white", "turning"), [*((*m, False) for m in MODELS), (0.9, 0.5, True)])
def test_whitened_moments_are_those_of_the_dense_covariance(correlation: float, white: float, turning: bool) -> None:
    """Noise fixed to the image: channels are the components of one process in space along the turning axes."""
    rng = np.random.default_rng(1)
    time = np.cumsum([0, 1, 1, 3, 1, 2, 1, 1, 4, 1.0])
    heading = np.cumsum(rng.uniform(-0.5, 0.8, 10)) if turning else np.zeros(10)
    data = rng.normal(size=(10, 2, 3))
    covariance = dense(time, heading, correlation, white)
    inverse = np.linalg.inv(covariance)
    moments, log = whitened_moments(np.diff(time), np.diff(heading), data, correlation, white)
    np.testing.assert_allclose(moments, sum(data[:, c].T @ inverse @ data[:, c] for c in range(2)), rtol=1e-9)
    assert log == pytest.approx(np.linalg.slogdet(covariance)[1])  # half of it, of two channels


def test_average_over_models_is_that_of_dense_restricted_likelihoods() -> None:
    """Harville (1977) with the scale at its estimate, under every model, with flat priors within each kind."""
    rng = np.random.default_rng(2)
    time, heading = np.arange(60.0), np.linspace(0, 3, 60)
    design, value = rng.normal(size=(60, 1, 2)), np.cumsum(rng.normal(size=(60, 1)), axis=0)
    found = averaged_least_squares(Block(time, heading, value, design))
    kinds = [(model.white_share, model.in_image) for model in found.models]
    logs, estimates, scales = [], [], []
    for model, kind in zip(found.models, kinds, strict=True):
        covariance = dense(time, heading if model.in_image else 0 * heading, model.correlation, model.white_share)
        inverse = np.linalg.inv(covariance)
        normal = design[:, 0].T @ inverse @ design[:, 0]
        estimate = np.linalg.solve(normal, design[:, 0].T @ inverse @ value[:, 0])
        rest = value[:, 0] - design[:, 0] @ estimate
        squares = rest @ inverse @ rest
        prior = {0.0: 0.8, 0.5: 0.1, 0.85: 0.1}[kind[0]] / kinds.count(kind)
        halves = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1] + 58 * np.log(squares)
        logs.append(np.log(prior) - halves / 2)
        estimates.append(estimate)
        scales.append(squares / 58 * np.linalg.inv(normal))
    weight = np.exp(np.array(logs) - max(logs))
    np.testing.assert_allclose(found.weight, weight / weight.sum(), rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.estimate, estimates, rtol=1e-6)
    np.testing.assert_allclose(found.covariance, scales, rtol=1e-6)
    assert found.freedom == 58


def test_quantiles_of_a_single_model_are_those_of_student() -> None:
    scale = np.array([[2.0, 0.3], [0.3, 1.0]])
    one = Averaged((NoiseModel(0, 0, in_image=False),), np.ones(1), np.array([[1.0, 2.0]]), scale[None], np.ones(1), 4)
    way = np.array([1.0, -2.0])
    reach = stats.t.ppf(0.975, 4) * np.sqrt(way @ scale @ way)
    assert one.quantiles(way, (0.025, 0.975)) == pytest.approx((-3 - reach, -3 + reach))
    np.testing.assert_allclose(one.spread(), 2 * scale)  # of 4 degrees of freedom: 4 / (4 - 2)


def test_blocks_share_their_noise_and_keep_their_own_parameters() -> None:
    rng = np.random.default_rng(3)
    blocks = tuple(
        Block(np.arange(40.0), np.zeros(40), shift + size * rng.normal(size=(40, 1)), np.ones((40, 1, 1)))
        for shift, size in ((1.0, 0.1), (5.0, 0.3))
    )
    one, other = averaged_over_blocks(blocks)
    assert one.freedom == 78
    np.testing.assert_allclose(one.scale, other.scale)
    assert one.mean()[0] == pytest.approx(1.0, abs=0.15)
    assert other.mean()[0] == pytest.approx(5.0, abs=0.15)
    np.testing.assert_allclose(one.covariance, other.covariance)
    assert one.scale[0] == pytest.approx(np.sqrt((0.01 + 0.09) / 2), rel=0.2)


@pytest.mark.parametrize("correlation", [0.0, 0.6, 0.95])
def test_correlation_of_the_noise_is_found_and_widens_the_error_of_a_mean(correlation: float) -> None:
    rng = np.random.default_rng(4)
    noise = rng.normal(size=(1500, 1))
    for row in range(1, 1500):
        noise[row] = correlation * noise[row - 1] + np.sqrt(1 - correlation**2) * noise[row]
    found = averaged_least_squares(Block(np.arange(1500.0), np.zeros(1500), noise, np.ones((1500, 1, 1))))
    assert found.correlation() == pytest.approx(correlation, abs=0.05)
    widened = np.sqrt((1 + correlation) / (1 - correlation))
    assert np.sqrt(found.spread()[0, 0]) == pytest.approx(widened / np.sqrt(1500), rel=0.3)


def test_more_parameters_than_data_are_refused() -> None:
    block = Block(np.arange(2.0), np.zeros(2), np.zeros((2, 1)), np.ones((2, 1, 2)))
    with pytest.raises(ValueError, match="more parameters"):
        averaged_least_squares(block)


def test_models_of_noise_are_those_that_the_run_is_long_enough_and_turns_enough_to_show() -> None:
    assert noise_models(0.0, 1.0) == (NoiseModel(0.0, 0.0, in_image=False), *noise_models(0.0, 1.0)[1:])
    short, long = (max(m.correlation for m in noise_models(0.0, frames)) for frames in (40, 4000))
    assert short == max(CORRELATIONS[np.exp(-4 / 40) >= CORRELATIONS])  # four correlation times fit into the run
    assert long == CORRELATIONS[-1]
    noisy = [m.correlation for m in noise_models(0.0, 100.0) if m.white_share == 0.5]
    assert max(noisy) == max(CORRELATIONS[np.exp(-10 / 100) >= CORRELATIONS])  # ten, under white noise
    assert min(abs(np.array(noisy))) > 0.2
    assert not any(m.in_image for m in noise_models(1.9, 100.0))
    assert any(m.in_image for m in noise_models(2.1, 100.0))


def test_mixture_of_models_has_the_mean_spread_and_quantiles_of_a_mixture() -> None:
    models = (NoiseModel(0.0, 0.0, in_image=False), NoiseModel(0.8, 0.5, in_image=False))
    mixed = Averaged(
        models, np.array([0.25, 0.75]), np.array([[0.0], [4.0]]), np.array([[[1.0]], [[4.0]]]), np.ones(2), 10.0
    )
    assert mixed.best == 1
    assert mixed.correlation() == pytest.approx(0.75 * 0.8 * 0.5)
    assert mixed.mean()[0] == pytest.approx(3.0)
    assert mixed.spread()[0, 0] == pytest.approx(10 / 8 * (0.25 * 1 + 0.75 * 4) + 0.25 * 9 + 0.75 * 1)
    for level in (0.025, 0.5, 0.975):
        (at,) = mixed.quantiles(np.ones(1), (level,))
        below = 0.25 * stats.t.cdf(at, 10) + 0.75 * stats.t.cdf((at - 4) / 2, 10)
        assert below == pytest.approx(level, abs=1e-6)


def test_response_to_a_shift_along_a_parameter_is_that_parameter() -> None:
    rng = np.random.default_rng(5)
    design = rng.normal(size=(60, 2, 3))
    block = Block(np.arange(60.0), np.zeros(60), rng.normal(size=(60, 2)), design)
    averaged = averaged_least_squares(block)
    shifts = np.array([[1.0, 0.0], [-2.0, 0.5], [0.0, 3.0]])
    np.testing.assert_allclose(responses(averaged, block, design @ shifts), shifts, atol=1e-9)
