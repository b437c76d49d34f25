"""Tracking noise of marks: size and correlation in time, from modes that no motion of the robot contains.

The residual of a run is decomposed into cosine modes. Slow modes contain the misfit of the model, fast ones only noise.
White noise plus a first-order autoregressive process is fitted to the fast modes and extrapolated to the slow ones, so
that the misfit of a wrong model is not attributed to noise. Source: Whittle (1953), Ark. Mat. 2, 423.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.ndimage import median_filter
from scipy.optimize import minimize

from evaluator.diagnosis.likelihood.noise.spectrum import MEDIAN_OF_POWER, SLOWEST_HZ, TAPERED, Spectrum

Floats = NDArray[np.float64]

FEWEST_MODES = 24  # below this a spectrum of three parameters is not worth fitting; the noise is taken as white
# Prior of the correlation time: errors of trackers are correlated over a few frames up to half a second. Fast modes
# alone do not determine longer times.
USUAL_CORRELATION_S = 0.1
CORRELATION_SPREAD = 1.0  # of its logarithm
# Information in the median of a band relative to that in the mean of its modes. For a single band it is 0.49: the
# median scatters by 2.0 over the root of the number of independent modes, the mean by 1.41. Neighbouring bands
# (LINE_BANDS) add information: with this value, white noise is taken for correlated in one of ten sessions (simulated:
# 100 sessions of 12 runs of 300 frames).
OF_MEDIAN = 0.78
LINE_BANDS = 5  # of 60, some 2.5 Hz at 60 frames a second: their median suppresses lines as wide as two bands
# -2 log likelihood that a correlated part must gain for its two parameters, power and time (Akaike 1974, IEEE TAC 19,
# 716). Without this limit, correlations by chance gave the slow modes, which are extrapolated, 40 % more power than
# white noise has.
CORRELATED_AT = 2 * 2.0
MEMORY = (-20.0, 6.0)  # of the logit of the correlation of neighbouring samples: none, to one that lasts 400 samples
POWER_REACH = 40.0  # bound of the logarithm of a power over that of the fast modes: 0 or everything, for all purposes
QUANTIZATION_MM = 1e-5  # marks files carry six decimals at most: noise below this is not noise of a camera


@dataclass(frozen=True)
class Drift:
    """Slow errors: exponentially correlated drift, and creep; standard deviations, mm, s and mm/s.

    size_mm, lasting_s: of the drift, and its correlation time. creep_mm_s: of a velocity that is constant in a run.
    """

    size_mm: float = 0.0
    lasting_s: float = 1.0
    creep_mm_s: float = 0.0

    def covariance(self, time_s: Floats) -> Floats:
        """Covariance between samples at time_s, (n, n), mm²; creep starts at 0 at the first of them."""
        lag, since = np.abs(time_s[:, None] - time_s[None, :]), time_s - time_s[0]
        return np.asarray(
            self.size_mm**2 * np.exp(-lag / self.lasting_s) + self.creep_mm_s**2 * since[:, None] * since[None, :]
        )

    def times(self, time_s: Floats, columns: Floats) -> Floats:
        """The covariance at increasing time_s (n,) times columns (n, k), without the matrix, mm²."""
        product = np.zeros_like(columns)
        if self.size_mm:
            product += self.size_mm**2 * correlated(time_s, self.lasting_s, columns)
        if self.creep_mm_s:
            since = time_s - time_s[0]
            product += self.creep_mm_s**2 * since[:, None] * (since @ columns)
        return product

    def scaled(self, factor: float) -> Drift:
        """The drift with both sizes multiplied by a factor."""
        return Drift(factor * self.size_mm, self.lasting_s, factor * self.creep_mm_s)

    def about_mean_mm(self, over_s: float) -> float:
        """RMS deviation from its mean over a time, mm: less than size_mm for long correlation times.

        The variance of the mean is the mean of exp(-|lag| / lasting) over all pairs of times.
        """
        share = over_s / self.lasting_s
        wanders = self.size_mm**2 * max(1 - 2 * (share - 1 + np.exp(-share)) / share**2, 0.0)
        return float(np.sqrt(wanders + (self.creep_mm_s * over_s) ** 2 / 12))


NO_DRIFT = Drift()


@dataclass(frozen=True)
class Noise:
    """White noise plus exponentially correlated noise of one channel, mm and s, with slow errors.

    drift: independent for each mark, or unmodelled motion. common_drift: equal for both marks. vibration_mm: power in
    narrow frequency bands, from a vibrating stand or a flickering lamp; it is part of the noise of a sample, but not of
    the covariance, because slow modes do not contain it.
    """

    white_mm: float
    slow_mm: float
    correlation_s: float
    drift: Drift = NO_DRIFT
    common_drift: Drift = NO_DRIFT
    vibration_mm: float = 0.0

    def covariance(self, time_s: Floats) -> Floats:
        """Covariance between samples at time_s, (n, n), mm²."""
        lag = np.abs(time_s[:, None] - time_s[None, :])
        kernel: Floats = self.slow_mm**2 * np.exp(-lag / self.correlation_s)
        for drift in self._drifts:
            kernel += drift.covariance(time_s)
        kernel[np.diag_indices(len(time_s))] += self.white_mm**2
        return kernel

    def times(self, time_s: Floats, columns: Floats) -> Floats:
        """The covariance between samples at increasing time_s (n,) times columns (n, k), without the matrix, mm²."""
        product = self.white_mm**2 * columns + self.slow_mm**2 * correlated(time_s, self.correlation_s, columns)
        for drift in self._drifts:
            product += drift.times(time_s, columns)
        return np.asarray(product)

    @property
    def sigma_mm(self) -> float:
        """Standard deviation of one sample, mm."""
        parts = (self.white_mm, self.slow_mm, self.vibration_mm, *(drift.size_mm for drift in self._drifts))
        return float(np.sqrt(np.sum(np.square(parts))))

    def about_mean_mm(self, over_s: float) -> float:
        """RMS deviation from the mean over a time, mm: the fitted start pose absorbs the mean of a drift."""
        drifts = (drift.about_mean_mm(over_s) for drift in self._drifts)
        return float(np.sqrt(np.sum(np.square((self.white_mm, self.slow_mm, self.vibration_mm, *drifts)))))

    @property
    def _drifts(self) -> tuple[Drift, ...]:
        return tuple(drift for drift in (self.drift, self.common_drift) if drift != NO_DRIFT)

    def scaled(self, factor: float) -> Noise:
        """Noise with all amplitudes multiplied by factor, its correlation times unchanged."""
        return Noise(self.white_mm * factor, self.slow_mm * factor, self.correlation_s)


def correlated(time_s: Floats, correlation_s: float, columns: Floats) -> Floats:
    """The matrix exp(-|lag| / correlation_s) of samples at increasing time_s (n,) times columns (n, k).

    The process is Markov, so that the inverse of the matrix is tridiagonal and a product takes time in proportion to n.
    Source: Rybicki & Press (1995), Phys. Rev. Lett. 74, 1060.
    """
    if len(time_s) < 2:
        return columns
    step = np.diff(time_s) / correlation_s
    kept = np.exp(-step)
    lost = -np.expm1(-2 * step)  # 1 - kept², to all digits also where hardly anything is lost
    diagonals = np.zeros((2, len(time_s)))
    diagonals[1] = 1.0
    diagonals[1, :-1] += kept**2 / lost
    diagonals[1, 1:] += kept**2 / lost
    diagonals[0, 1:] = -kept / lost
    return np.asarray(solveh_banded(diagonals, columns, check_finite=False))


def fit_noise(spectra: list[Spectrum], shared: Noise | None = None) -> Noise:
    """Fit one noise model to the fast modes of all spectra (Whittle likelihood, narrow-band lines suppressed).

    shared: the noise of these and similar recordings, up to its size; its correlated part is used if these spectra
    alone do not show one.
    """
    frequency = np.concatenate([item.frequency_hz for item in spectra])
    power = np.concatenate([item.power_mm2 for item in spectra])
    step_s = float(np.median([item.step_s for item in spectra]))
    fast = frequency >= SLOWEST_HZ
    if fast.sum() < FEWEST_MODES:
        sigma = float(np.sqrt(np.mean(power))) if len(power) else QUANTIZATION_MM
        return Noise(max(sigma, QUANTIZATION_MM), 0.0, step_s)
    frequency, power = _banded(frequency[fast], power[fast])
    level = np.log(np.median(power) + QUANTIZATION_MM**2)
    starts = [np.array([level, level - 2.0 + lift, shape]) for lift in (0.0, 2.0) for shape in (0.4, 2.0)]
    known = (frequency, power, step_s, TAPERED * OF_MEDIAN * int(fast.sum()) / len(power))
    reach = (float(level - POWER_REACH), float(level + POWER_REACH))
    bounds = [reach, reach, MEMORY]
    fits = [
        minimize(_whittle, start, known, method="L-BFGS-B", jac=True, bounds=bounds, options={"ftol": 1e-12})
        for start in starts
    ]
    chosen = min(fits, key=lambda fit: float(fit.fun))
    best, mean_mm2 = chosen.x, float(np.mean(power))
    white_mm2 = max(mean_mm2, QUANTIZATION_MM**2)
    white_alone = known[3] * len(power) * (np.log(white_mm2) + mean_mm2 / white_mm2)
    if white_alone - float(chosen.fun) < CORRELATED_AT:
        if shared is not None and shared.slow_mm:
            size = float(np.sqrt(np.mean(power / expected_power(shared, frequency, step_s))))
            return shared.scaled(max(size, QUANTIZATION_MM / shared.sigma_mm))
        return Noise(float(np.sqrt(white_mm2)), 0.0, step_s)
    decay = _decay(best[2])
    return Noise(
        float(np.exp(best[0] / 2)),
        float(np.exp(best[1] / 2) / np.sqrt(1 - decay**2)),
        _correlation_s(best[2], step_s),
    )


def _whittle(
    free: Floats, frequency_hz: Floats, power_mm2: Floats, step_s: float, per_band: float
) -> tuple[float, Floats]:
    """-2 log of likelihood and prior at the logarithms of both powers and the logit, (3,), and its slopes (3,)."""
    decay, white, innovations = _decay(free[2]), np.exp(free[0]), np.exp(free[1])
    cosine = np.cos(2 * np.pi * frequency_hz * step_s)
    model = _density(frequency_hz, free, step_s)
    shape = 1 / (1 - 2 * decay * cosine + decay**2)
    unusual = np.log(_correlation_s(free[2], step_s) / USUAL_CORRELATION_S) / CORRELATION_SPREAD
    value = per_band * np.sum(np.log(model) + power_mm2 / model) + unusual**2
    weight = per_band * (model - power_mm2) / model**2
    by_decay = np.sum(weight * innovations * 2 * (cosine - decay) * shape**2)
    by_decay -= 2 * unusual / CORRELATION_SPREAD / (decay * np.log(decay))
    slopes = np.array([np.sum(weight) * white, np.sum(weight * shape) * innovations, by_decay * decay * (1 - decay)])
    return float(value), slopes


def _decay(logit: float) -> float:
    """Correlation of neighbouring samples."""
    return float(1.0 / (1.0 + np.exp(-np.clip(logit, *MEMORY))))


def _correlation_s(logit: float, step_s: float) -> float:
    return float(-step_s / np.log(_decay(logit)))


def _density(frequency_hz: Floats, free: Floats, step_s: float) -> Floats:
    """Expected mode power: white + innovations / |1 - decay·exp(-iω)|²."""
    decay = _decay(free[2])
    angle = 2 * np.pi * frequency_hz * step_s
    colored = np.exp(free[1]) / (1 - 2 * decay * np.cos(angle) + decay**2)
    density: Floats = np.exp(free[0]) + colored + QUANTIZATION_MM**2
    return density


def expected_power(noise: Noise, frequency_hz: Floats, step_s: float) -> Floats:
    """Power of cosine modes at frequencies (n,), mm², that the white and the correlated part of a noise make."""
    decay = np.exp(-step_s / noise.correlation_s)
    angle = 2 * np.pi * frequency_hz * step_s
    shape = (1 - decay**2) / (1 - 2 * decay * np.cos(angle) + decay**2)
    return np.asarray(noise.white_mm**2 + noise.slow_mm**2 * shape)


def with_vibration(noise: Noise, spectra: Sequence[Spectrum], above_hz: float) -> Noise:
    """The noise with vibration: the power of its spectra above a frequency beyond the smooth part."""
    beyond = []
    for item in spectra:
        fast = item.frequency_hz > above_hz
        left = item.power_mm2[fast] - expected_power(noise, item.frequency_hz[fast], item.step_s)
        beyond.append(float(np.sum(left)) / len(item.power_mm2))
    return replace(noise, vibration_mm=float(np.sqrt(max(float(np.mean(beyond)), 0.0))))


def _banded(frequency_hz: Floats, power: Floats, bands: int = 60) -> tuple[Floats, Floats]:
    """Mean power per frequency band, from the median, which a line (run-out of a wheel, vibration) hardly changes.

    A line that fills a band is replaced by the median of the band and its neighbours, which does not change a smooth
    spectrum.
    """
    order = np.argsort(frequency_hz)
    groups = np.array_split(order, min(bands, max(len(order) // 8, 1)))
    centers = np.array([np.mean(frequency_hz[group]) for group in groups])
    levels = np.array([np.median(power[group]) / MEDIAN_OF_POWER for group in groups])
    return centers, np.asarray(median_filter(levels, LINE_BANDS, mode="nearest"))
