"""Noise, channels, features and drift in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from evaluator.diagnosis.likelihood.features import (
    MODEL_FLOOR_MM,
    _amplitude,
    _of_one_level,
    channel_noise,
    channel_residual,
    channels_of,
    compression,
    residual_spectra,
    rms_apart,
)
from evaluator.diagnosis.likelihood.noise.drift import BELIEVED, Distance, drift, with_drift
from evaluator.diagnosis.likelihood.noise.spectrum import MEDIAN_OF_POWER, TAPERED, Spectrum, spectrum
from evaluator.diagnosis.likelihood.noise.tracking import Drift, Noise, _banded, _decay, _density, fit_noise

MARKS = np.array([[1.0, 4.0, 3.0, 2.0], [0.0, 2.0, 0.0, -2.0]])


def test_channels_are_midpoint_direction_and_distance_of_the_marks() -> None:
    channels = channels_of(MARKS)
    np.testing.assert_allclose(channels[0], [2.0, 3.0, np.radians(135), np.sqrt(8)])
    np.testing.assert_allclose(channels[1], [0.0, 0.0, np.radians(90), 4.0])


@pytest.mark.parametrize(("turn", "short"), [(0.1, 0.1), (2 * np.pi - 0.1, -0.1), (-3.0, -3.0), (3.5, 3.5 - 2 * np.pi)])
def test_residual_is_measured_less_predicted_and_turns_the_short_way(turn: float, short: float) -> None:
    predicted = np.array([[1.0, 2.0, 0.4, 3.0]])
    residual = channel_residual(predicted + np.array([0.5, -0.25, turn, 0.125]), predicted, 1.8)
    np.testing.assert_allclose(residual, [[0.5, -0.25, 1.8 * short, 0.125]])


def test_paths_apart_by_a_rigid_motion_are_none_and_by_a_stretch_are() -> None:
    first = np.array([0, 1 + 1j, 3, 4 - 2j])
    assert rms_apart(first, np.exp(0.7j) * first + 5 - 3j) == pytest.approx(0.0, abs=1e-12)
    spread = np.sqrt(np.mean(np.abs(first - first.mean()) ** 2))
    assert rms_apart(first, 1.1 * first) == pytest.approx(0.1 * spread)
    assert rms_apart(first, np.conj(first)) > 1.0  # a mirror image is no rotation


def test_covariance_of_noise_is_white_and_two_exponentials() -> None:
    noise = Noise(white_mm=0.003, slow_mm=0.004, correlation_s=0.5, drift=Drift(0.012, 2.0))
    covariance = noise.covariance(np.array([0.0, 1.0]))
    apart = 0.004**2 * np.exp(-2) + 0.012**2 * np.exp(-0.5)
    np.testing.assert_allclose(covariance, [[0.013**2, apart], [apart, 0.013**2]])
    assert noise.sigma_mm == pytest.approx(0.013)
    plain = Noise(0.003, 0.004, 0.5)
    np.testing.assert_allclose(plain.scaled(3.0).covariance(np.arange(3.0)), 9 * plain.covariance(np.arange(3.0)))


def test_modes_hold_the_power_of_the_residual_at_their_frequencies() -> None:
    time = np.arange(200) / 50
    wave = 0.3 * np.cos(np.pi * 40 * (np.arange(200) + 0.5) / 200)  # the fortieth mode: 5 Hz
    found = spectrum(time, wave)
    assert found.step_s == pytest.approx(0.02)
    at = int(np.argmax(found.power_mm2))
    assert found.frequency_hz[at] == pytest.approx(5.0)
    near = slice(at - 2, at + 3)  # the taper shares a line with its neighbours, and nobody else
    assert found.power_mm2[near].sum() == pytest.approx(
        0.3**2 * 100, rel=0.01
    )  # of 200 frames half the squared amplitude
    line = spectrum(time, 3.0 + 2.0 * time)
    assert line.power_mm2.max() < 1e-20


def test_density_of_modes_is_that_of_white_and_autoregressive_noise() -> None:
    """Summed over all frequencies it is the variance: white, and innovations over one less the squared decay."""
    free = np.array([np.log(4e-6), np.log(9e-6), 0.5])
    frequency = (np.arange(4000) + 0.5) / 4000 * 25  # up to the Nyquist frequency of 50/s
    decay = 1 / (1 + np.exp(-0.5))
    assert _decay(0.5) == pytest.approx(decay)
    assert _density(frequency, free, 0.02).mean() == pytest.approx(4e-6 + 9e-6 / (1 - decay**2), rel=1e-4)
    slowest, fastest = _density(np.array([0.0, 25.0]), free, 0.02)
    assert slowest - 4e-6 == pytest.approx(9e-6 / (1 - decay) ** 2, rel=1e-4)
    assert fastest - 4e-6 == pytest.approx(9e-6 / (1 + decay) ** 2, rel=1e-4)


def test_bands_have_the_mean_power_from_the_median_and_a_line_does_not_lift_them() -> None:
    rng = np.random.default_rng(0)
    power = rng.chisquare(1, 4800)
    power[::80] = 1e6
    frequency, level = _banded(np.arange(4800.0), power)
    assert len(level) == 60
    assert level.mean() == pytest.approx(1.0, rel=0.1)
    assert frequency[0] == pytest.approx(39.5)
    assert len(_banded(np.arange(80.0), power[:80])[0]) == 10  # eight modes a band at least


def test_few_modes_give_white_noise_of_their_power() -> None:
    noise = fit_noise([Spectrum(np.linspace(0, 3, 20), np.full(20, 4e-6), 0.02)])
    assert (noise.white_mm, noise.slow_mm) == pytest.approx((2e-3, 0.0))


def test_features_of_noise_are_white_with_the_models_floor() -> None:
    """Covariance of the features under noise plus the floor, mode by mode, is the identity."""
    time = np.arange(120) / 30
    noise = Noise(0.002, 0.003, 0.2)
    used = np.ones(120, dtype=bool)
    used[30:36] = False
    found = compression(time, used, (noise,) * 4)
    for channel, part in enumerate(found.functional):
        covariance = part.T @ noise.covariance(time[used]) @ part
        values = np.linalg.eigvalsh(covariance)
        assert part.shape[1] == (8 if channel == 3 else 23)  # twice 3 Hz over 4 s less a frame
        assert values.max() < 1.0 + 1e-9
        assert values.min() > 0.8  # the floor of 0.3 µm takes a little of the finest modes
    quiet = compression(time, used, (Noise(1e-9, 0.0, 0.1),) * 4)
    spread = quiet.functional[0].T @ (1e-12 * np.eye(used.sum())) @ quiet.functional[0]
    assert np.trace(spread) < 1.0  # of exact marks the floor is the noise
    residual = np.random.default_rng(0).normal(size=(3, used.sum(), 4))
    np.testing.assert_allclose(found.features(residual)[1], found.features(residual[1]))


def test_first_mode_of_the_floor_is_that_of_two_programs() -> None:
    time = np.arange(60) / 30
    found = compression(time, np.ones(60, dtype=bool), (Noise(1e-12, 0.0, 0.1),) * 4)
    constant = found.features(np.full((60, 4), MODEL_FLOOR_MM))
    # A shift of 0.3 µm is one standard deviation of the first mode of each of the four channels.
    assert np.linalg.norm(constant) == pytest.approx(2.0, rel=1e-3)


def white_spectra(sizes: list[float], seed: int = 0) -> list[tuple[Spectrum, ...]]:
    rng = np.random.default_rng(seed)
    time = np.arange(600) / 60
    return [residual_spectra(time, size * rng.normal(size=(600, 4)), 0.0) for size in sizes]


def test_each_channel_has_its_noise_and_each_run_its_own_amplitude() -> None:
    spectra = [
        tuple(
            replace(item, power_mm2=item.power_mm2 * factor**2) for item, factor in zip(run, (1, 1, 2, 3), strict=True)
        )
        for run in white_spectra([0.004] * 5 + [0.012])
    ]
    noise = channel_noise(spectra)
    assert [part.sigma_mm for part in noise[0]] == pytest.approx([0.004, 0.004, 0.008, 0.012], rel=0.2)
    assert [part.sigma_mm for part in noise[5]] == pytest.approx([0.012, 0.012, 0.024, 0.036], rel=0.2)
    assert noise[0][0] == noise[0][1]


def test_direction_has_the_correlation_that_distance_shows() -> None:
    """Both are coordinates of the difference of the marks; 0.0023 mm lasting 0.25 s, in 0.0077 mm of white noise."""
    rng, time, decay = np.random.default_rng(8), np.arange(420) / 60, np.exp(-1 / 15)

    def error() -> np.ndarray:
        slow = lfilter([1], [1, -decay], np.sqrt(1 - decay**2) * rng.normal(size=720))[300:]
        return 0.0077 * rng.normal(size=420) + 0.0023 * slow

    spectra = [
        residual_spectra(time, np.column_stack([size * error() for size in (1, 1, 1, 2)]), 0.0) for _ in range(12)
    ]
    assert fit_noise([run[2] for run in spectra]).slow_mm == 0.0  # by itself it leaves that undecided
    _, _, direction, distance = channel_noise(spectra)[0]
    assert direction.slow_mm / direction.white_mm == pytest.approx(distance.slow_mm / distance.white_mm, rel=0.5)
    assert direction.sigma_mm == pytest.approx(np.hypot(0.0077, 0.0023), rel=0.1)


def test_a_distance_that_nobody_measured_says_nothing_of_the_direction() -> None:
    for factor in (1.0, 1e-6):  # of poses that somebody simulated the direction has no noise either
        spectra = [
            tuple(
                replace(item, power_mm2=item.power_mm2 * size**2)
                for item, size in zip(run, (1, 1, factor, 1e-9), strict=True)
            )
            for run in white_spectra([0.004] * 5)
        ]
        assert channel_noise(spectra)[0][2].sigma_mm == pytest.approx(0.004 * factor, rel=0.2, abs=2e-5)


def test_amplitude_of_a_run_is_one_within_what_chance_allows() -> None:
    noise = Noise(0.004, 0.0, 0.02)
    (run,) = white_spectra([0.004], seed=1)
    assert _amplitude(run[:2], noise) == 1.0
    (loud,) = white_spectra([0.008], seed=1)
    assert _amplitude(loud[:2], noise) == pytest.approx(2.0, rel=0.1)
    few = Spectrum(np.full(49, 10.0), np.full(49, 1.0), 0.02)
    assert _amplitude((few,), noise) == 1.0
    slow = Noise(0.0, 0.004, 0.1)
    decay = np.exp(-0.2)
    frequency = np.linspace(3.1, 24, 400)
    model = 0.004**2 * (1 - decay**2) / (1 - 2 * decay * np.cos(2 * np.pi * frequency * 0.02) + decay**2)
    exact = Spectrum(frequency, 0.4549 * 4 * model, 0.02)
    assert _amplitude((exact,), slow) == pytest.approx(2.0)


def test_spectra_of_one_level_are_those_whose_fast_modes_have_a_median_of_one() -> None:
    """A slow misfit of a model tells no noise; what nobody measured has none."""
    frequency = np.array([0.5, 1.0, 2.0, 3.0, 3.1, 5.0, 9.0])
    power = np.array([900.0, 800.0, 700.0, 600.0, 3.0, 4.0, 5.0])
    loud, silent = Spectrum(frequency, power, 0.02), Spectrum(frequency, 1e-30 * power, 0.02)
    (found,) = _of_one_level([loud])
    np.testing.assert_allclose(found.power_mm2, power / 4.0)
    assert _of_one_level([silent]) == []


@pytest.mark.parametrize(("errors", "own"), [(3.1, False), (3.3, True), (-3.1, False), (-3.3, True)])
def test_a_run_has_its_own_amplitude_beyond_so_many_standard_errors_of_its_median_power(
    errors: float, *, own: bool
) -> None:
    """A median of powers scatters by 2.0 over the root of the independent modes, of which a taper leaves a share."""
    modes, noise = 400, Noise(0.004, 0.0, 0.02)
    power = 1 + errors * 2.0 / np.sqrt(TAPERED * modes)
    run = Spectrum(np.linspace(3.1, 24, modes), np.full(modes, MEDIAN_OF_POWER * power * 0.004**2), 0.02)
    assert _amplitude((run,), noise) == pytest.approx(np.sqrt(power) if own else 1.0)


def test_modes_of_a_run_do_not_depend_on_when_its_clock_began() -> None:
    time, noise = np.arange(90) / 30, (Noise(0.004, 0.0, 0.02),) * 4
    early, late = (compression(time + zero, np.arange(90) > 2, noise) for zero in (0.0, 100.0))
    assert early.functional[0].shape == late.functional[0].shape
    np.testing.assert_allclose(late.functional[0], early.functional[0], atol=1e-6 * np.abs(early.functional[0]).max())


def test_spectra_leave_out_the_start_where_enough_frames_remain() -> None:
    time = np.arange(200) / 50
    residual = 1e-3 * np.random.default_rng(0).normal(size=(200, 4))
    residual[:50] += 5.0
    late = residual_spectra(time, residual, 1.0)
    assert len(late[0].power_mm2) == 149  # the mean is none of them
    assert late[0].power_mm2.max() < 1e-3
    assert len(residual_spectra(time, residual, 3.6)[0].power_mm2) == 199  # twenty frames would be too few


def distances(size_mm: float, lasting_s: float, runs: int = 8, seed: int = 0) -> list[Distance]:
    rng = np.random.default_rng(seed)
    time = np.arange(150) / 25
    noise = Noise(0.002, 0.0, 0.04)
    root = np.linalg.cholesky(
        replace(noise, drift=Drift(size_mm, lasting_s)).covariance(time) if size_mm else noise.covariance(time)
    )
    angle = 0.3 * time
    arm = 2 * np.column_stack([np.cos(angle), np.sin(angle)])
    place = np.array([5.0, 3.0])
    marks = np.concatenate([place + arm, place - arm], axis=1)
    return [Distance(time, root @ rng.normal(size=150), marks, noise) for _ in range(runs)]


def test_drift_of_the_distance_is_found_with_its_size_and_its_time_and_noise_has_none() -> None:
    size, lasting = drift(distances(0.004, 2.0))
    assert size == pytest.approx(0.004, rel=0.35)
    assert lasting == 2.0
    assert drift(distances(0.0, 1.0)) == (0.0, 0.5)
    assert drift([]) == (0.0, 0.5)
    assert pytest.approx(4.0**2 / 2) == BELIEVED  # four standard deviations


def test_what_a_camera_does_to_the_distance_in_all_runs_is_no_drift() -> None:
    runs = distances(0.0, 1.0)
    keystone = []
    for run in runs:
        middle = (run.marks_mm[:, :2] + run.marks_mm[:, 2:]) / 2
        along = (run.marks_mm[:, :2] - run.marks_mm[:, 2:]) / 4
        bent = 0.004 * (middle[:, 0] + along[:, 0] * (middle * along).sum(axis=1))
        keystone.append(replace(run, residual_mm=run.residual_mm + 0.02 + bent))
    assert drift(keystone)[0] == 0.0
    assert drift([replace(run, residual_mm=run.residual_mm + 0.03 * np.sin(run.time_s)) for run in runs])[0] > 0.005


def test_midpoint_and_direction_drift_half_as_much_as_the_distance() -> None:
    runs = distances(0.004, 2.0)
    noise = [(Noise(0.001, 0.0, 0.1),) * 3 + (run.noise,) for run in runs]
    frames = [np.ones(150, dtype=bool)] * len(runs)
    residuals = [np.column_stack([np.zeros((150, 3)), run.residual_mm]) for run in runs]
    found = with_drift(noise, [run.time_s for run in runs], frames, residuals, [run.marks_mm for run in runs])
    size = drift(runs)[0]
    assert [part.drift.size_mm for part in found[3]] == pytest.approx([size / 2, size / 2, size / 2, size])
    assert {part.drift.lasting_s for part in found[0]} == {2.0}
    assert [part.white_mm for part in found[0]] == [0.001, 0.001, 0.001, 0.002]


def test_chi_square_median_is_the_one_that_the_bands_divide_by() -> None:
    assert stats.chi2.median(1) == pytest.approx(0.4549, abs=1e-4)
