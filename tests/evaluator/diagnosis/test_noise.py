"""Tracking noise is found whatever the model misses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from evaluator.diagnosis.likelihood.noise.spectrum import Spectrum, _slow_part, spectrum
from evaluator.diagnosis.likelihood.noise.tracking import (
    QUANTIZATION_MM,
    Drift,
    Noise,
    _whittle,
    expected_power,
    fit_noise,
    with_vibration,
)


def _correlated(rng: np.random.Generator, count: int, sigma_mm: float, decay: float) -> np.ndarray:
    white = rng.normal(size=count + 300) * np.sqrt(1 - decay**2)
    return sigma_mm * np.asarray(lfilter([1], [1, -decay], white))[300:]


@pytest.mark.parametrize("decay", [0.0, 0.5, 0.85])
def test_size_and_correlation_of_tracking_noise_are_recovered(decay: float) -> None:
    rng = np.random.default_rng(3)
    time = np.arange(600) / 60
    noise = fit_noise([spectrum(time, _correlated(rng, 600, 0.004, decay)) for _ in range(20)])
    assert noise.sigma_mm == pytest.approx(0.004, rel=0.08)
    plateau = noise.white_mm**2 / 60 + 2 * noise.slow_mm**2 * noise.correlation_s
    assert plateau == pytest.approx(0.004**2 / 60 * (1 + decay) / (1 - decay), rel=0.25)


def test_a_smooth_misfit_a_thousand_times_larger_is_not_taken_for_noise() -> None:
    rng = np.random.default_rng(4)
    time = np.arange(600) / 60
    misfit = 4.0 * np.sin(0.3 * time + 0.4) + 0.02 * time**2
    noise = fit_noise([spectrum(time, misfit + _correlated(rng, 600, 0.004, 0.7)) for _ in range(10)])
    assert noise.sigma_mm == pytest.approx(0.004, rel=0.1)


def test_missing_frames_do_not_change_the_noise() -> None:
    rng = np.random.default_rng(5)
    time = np.arange(600) / 60
    spectra = []
    for _ in range(10):
        values = _correlated(rng, 600, 0.004, 0.7)
        values[200:260] = np.nan
        spectra.append(spectrum(time, values))
    assert fit_noise(spectra).sigma_mm == pytest.approx(0.004, rel=0.12)


def _slow_power(noise: Noise) -> float:
    """Power of the slow modes, on which a fit looks, of frames 1/60 s apart."""
    return float(expected_power(noise, np.array([0.3]), 1 / 60)[0])


@pytest.mark.parametrize(("rounded_to_s", "missing", "gap_s"), [(1e-6, 0.0, 0.0), (1e-3, 0.0, 0.0), (1e-3, 0.13, 0.5)])
def test_white_noise_stays_white_whatever_the_clock_rounds_and_the_tracker_loses(
    rounded_to_s: float, missing: float, gap_s: float
) -> None:
    """Resampled and bridged by straight lines it looked correlated, and slow modes were given 70 % too much power."""
    rng = np.random.default_rng(1)
    spectra = []
    for _ in range(10):
        time, values = np.arange(480) / 60, rng.normal(0, 0.003, 480)
        values[rng.random(480) < missing / 2] = np.nan
        values[(time > 3) & (time < 3 + gap_s)] = np.nan
        kept = rng.random(480) >= missing / 2
        spectra.append(spectrum(np.round(time[kept] / rounded_to_s) * rounded_to_s, values[kept]))
    noise = fit_noise(spectra)
    assert _slow_power(noise) == pytest.approx(0.003**2, rel=0.1)
    assert noise.sigma_mm == pytest.approx(0.003, rel=0.05)


def test_a_shaking_stand_is_noise_of_a_sample_and_none_of_the_slow_modes() -> None:
    """A vibration of 12 µm at 17 Hz lifted all modes, and its runs passed for not followed by any model."""
    rng, time = np.random.default_rng(7), np.arange(480) / 60
    shaken = []
    for _ in range(8):
        swelling = 1 + 0.4 * np.sin(2 * np.pi * 0.3 * time + rng.uniform(0, 6))
        vibration = 0.012 * swelling * np.sin(2 * np.pi * 17 * time + rng.uniform(0, 6))
        shaken.append((time, vibration + rng.normal(0, 0.003, 480)))
    spectra = [spectrum(*run) for run in shaken]
    noise = fit_noise(spectra)
    assert _slow_power(noise) == pytest.approx(0.003**2, rel=0.15)
    seen = with_vibration(noise, spectra, 3.0)
    assert seen.sigma_mm == pytest.approx(np.sqrt(np.mean([values**2 for _, values in shaken])), rel=0.05)
    np.testing.assert_array_equal(seen.covariance(time[:9]), noise.covariance(time[:9]))


def test_of_a_vibration_with_holes_the_share_that_is_missing_is_white() -> None:
    rng, time = np.random.default_rng(8), np.arange(480) / 60
    spectra, slow = [], []
    for _ in range(12):
        values = 0.012 * np.sin(2 * np.pi * 17 * time + rng.uniform(0, 6)) + rng.normal(0, 0.003, 480)
        values[rng.random(480) < 0.1] = np.nan
        spectra.append(spectrum(time, values))
        seen = np.isfinite(values)  # as features take slow modes: by least squares over the samples there are
        modes = np.cos(np.pi * np.arange(40) * ((np.arange(480) + 0.5) / 480)[:, None])[seen]
        slow.append(np.linalg.solve(modes.T @ modes, modes.T @ values[seen])[20:] ** 2 * seen.sum() / 2)
    assert _slow_power(fit_noise(spectra)) == pytest.approx(np.mean(slow), rel=0.2)


def test_covariance_is_positive_and_has_the_variance_on_its_diagonal() -> None:
    noise = Noise(0.001, 0.003, 0.1)
    covariance = noise.covariance(np.sort(np.random.default_rng(1).uniform(0, 3, 80)))
    assert np.linalg.eigvalsh(covariance).min() > 0
    assert np.allclose(np.diag(covariance), noise.sigma_mm**2)


def test_products_with_the_covariance_are_those_of_its_matrix() -> None:
    rng = np.random.default_rng(4)
    time = np.sort(rng.uniform(0, 10, 200))
    columns = rng.normal(size=(200, 5))
    for noise in (Noise(0.001, 0.003, 0.1), Noise(0.002, 0.001, 0.02, drift=Drift(0.004, 8.0))):
        np.testing.assert_allclose(noise.times(time, columns), noise.covariance(time) @ columns, rtol=1e-9, atol=1e-16)


def test_the_slopes_of_the_likelihood_of_a_noise_are_its_derivatives() -> None:
    rng = np.random.default_rng(5)
    frequency = np.linspace(0.7, 28.0, 40)
    known = (frequency, rng.gamma(2.0, 2e-6, 40), 1 / 60, 11.0)
    for free in (np.array([-12.0, -13.0, 0.4]), np.array([-11.0, -9.0, 2.5])):
        steps = 1e-5 * np.eye(3)
        differences = [(_whittle(free + h, *known)[0] - _whittle(free - h, *known)[0]) / 2e-5 for h in steps]
        np.testing.assert_allclose(_whittle(free, *known)[1], differences, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(("power_mm2", "sigma_mm"), [(4e-6, np.sqrt(4e-6 / 0.4549)), (0.0, QUANTIZATION_MM)])
def test_noise_that_shows_no_correlation_of_its_own_has_that_of_what_is_made_alike(
    power_mm2: float, sigma_mm: float
) -> None:
    """Even power, the median of what chance makes of its mean; never less than the rounding of a file."""
    shared = Noise(3.0, 4.0, 1e-3)  # 5 mm in all, forgotten from frame to frame
    even = Spectrum(np.linspace(0.1, 30, 300), np.full(300, power_mm2), 1 / 60)
    found = fit_noise([even], shared)
    assert found.sigma_mm == pytest.approx(sigma_mm, rel=1e-6)
    assert (found.white_mm / found.slow_mm, found.correlation_s) == pytest.approx((0.75, 1e-3))
    alone = fit_noise([even])
    assert (alone.white_mm, alone.slow_mm) == pytest.approx((sigma_mm, 0.0))


@pytest.mark.parametrize("mode", [0, 3, 4])
def test_a_slow_wave_goes_on_in_frames_that_are_missing(mode: int) -> None:
    """A half wave of the whole series has its ends half a frame beyond the first and the last one."""
    slots = np.arange(24)
    wave = np.cos(np.pi * mode * (slots + 0.5) / 24)
    for missing in (np.array([7, 8, 15]), np.array([23]), np.array([0])):
        seen = np.setdiff1d(slots, missing)
        assert _slow_part(wave[seen], seen, missing, 5) == pytest.approx(wave[missing], abs=0.05)


@pytest.mark.parametrize("hz", [0.4, 0.55])
def test_gaps_in_a_misfit_below_the_slowest_noise_make_no_fast_noise(hz: float) -> None:
    """Of a power of 300 less than a hundredth lies above 2 Hz; filled with a mean, it would be 2 and more."""
    time = np.arange(600) / 60
    residual = np.cos(2 * np.pi * hz * time)
    residual[200:212] = residual[400:404] = np.nan
    found = spectrum(time, residual)
    assert found.power_mm2[found.frequency_hz > 2].sum() < 0.01
    assert found.power_mm2.sum() == pytest.approx(300, rel=0.1)
