"""Features of a run: slow cosine modes of the marks' midpoint, direction and distance, whitened by the noise.

Channels, all in mm on the plane of the marks: midpoint x, midpoint y, direction (the angle of the line through the
marks times half their distance, so that its noise is comparable with that of a coordinate) and distance of the marks. A
residual of 600 frames × 4 becomes about 200 numbers of unit variance, so that all further linear algebra is small.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from calibration.compilation import compiled
from evaluator.diagnosis.likelihood.noise.friction_wander import Whitening
from evaluator.diagnosis.likelihood.noise.spectrum import MEDIAN_OF_POWER, TAPERED, Spectrum, spectrum
from evaluator.diagnosis.likelihood.noise.tracking import (
    FEWEST_MODES,
    QUANTIZATION_MM,
    Noise,
    expected_power,
    fit_noise,
    with_vibration,
)
from evaluator.diagnosis.likelihood.noise.wheel_bands import Bands, within

Floats = NDArray[np.float64]

CHANNELS = ("midpoint_x", "midpoint_y", "direction", "distance")
FASTEST_HZ = 3.0  # includes two wheel revolutions a second at 90 rpm, and a motor's lag of 50 ms
FASTEST_OF_FRAMES = 0.8  # of half the frame rate: modes of wheels that turn as fast
MOST_MODES = 72  # of a run of 12 s at FASTEST_HZ; in longer runs the fastest mode is slower, to limit the cost
AT_ONCE = 16  # frames
DISTANCE_MODES = 8  # few, because the distance of the marks is constant except for errors of the camera
# Deviation of a run's median power from the common one, over the root of its independent modes, from which a run has an
# amplitude of its own: 3.2 standard errors of 2.0, which noise alone exceeds in one of 700 runs.
UNLIKE = 6.4
# Difference of two correct implementations of the same model: steps, start transients, regularization.
MODEL_FLOOR_MM = 3e-4


def channels_of(marks_mm: Floats) -> Floats:
    """Channels (n, 4) of marks (n, 4: x, y of two); NaN where a mark is missing. Direction in rad."""
    first, second = marks_mm[:, :2], marks_mm[:, 2:]
    middle = (first + second) / 2
    across = first - second
    angle = np.arctan2(across[:, 1], across[:, 0])
    return np.column_stack([middle, angle, np.hypot(across[:, 0], across[:, 1])])


def channel_residual(measured: Floats, predicted: Floats, half_distance_mm: float) -> Floats:
    """Measured minus predicted channels, (n, 4) in mm; angles taken the short way round."""
    difference = measured - predicted
    difference[:, 2] = ((difference[:, 2] + np.pi) % (2 * np.pi) - np.pi) * half_distance_mm
    return difference


def residual_of_marks(measured: Floats, marks_mm: Floats, half_distance_mm: float) -> Floats:
    """Residual (n, 4) in mm of measured channels (n, 4) over marks (n, 4) that a model predicts."""
    residual = np.empty((len(marks_mm), len(CHANNELS)))
    _residual_into(np.ascontiguousarray(measured), marks_mm, half_distance_mm, residual)
    return residual


@compiled(nogil=True)
def _residual_into(measured: Floats, marks_mm: Floats, half_distance_mm: float, residual: Floats) -> None:
    """channel_residual of channels_of in one pass, because it took half of the time of a fit."""
    for row in range(len(marks_mm)):
        _residual_of_frame(measured, marks_mm, row, half_distance_mm, residual[row])


@compiled(nogil=True)
def _residual_of_frame(measured: Floats, marks_mm: Floats, row: int, half_distance_mm: float, residual: Floats) -> None:
    x, y, other_x, other_y = marks_mm[row, 0], marks_mm[row, 1], marks_mm[row, 2], marks_mm[row, 3]
    residual[0] = measured[row, 0] - (x + other_x) / 2
    residual[1] = measured[row, 1] - (y + other_y) / 2
    angle = measured[row, 2] - math.atan2(y - other_y, x - other_x)
    turns = math.floor((angle + math.pi) / (2 * math.pi)) if math.isfinite(angle) else 0
    residual[2] = (angle - 2 * math.pi * turns) * half_distance_mm
    residual[3] = measured[row, 3] - math.hypot(x - other_x, y - other_y)


@compiled(nogil=True)
def _features_into(
    measured: Floats,
    marks_mm: Floats,
    frames: NDArray[np.int64],
    half_distance_mm: float,
    by_x: Floats,
    by_y: Floats,
    by_direction: Floats,
    by_distance: Floats,
    found: Floats,
) -> None:
    """Features (m, k) of these frames of marks (m, n, 4), few frames at a time for the processor's cache."""
    count = by_x.shape[1]
    residual = np.empty((AT_ONCE, 4))
    for first in range(0, len(frames), AT_ONCE):
        rows = min(AT_ONCE, len(frames) - first)
        for item in range(len(marks_mm)):
            for row in range(rows):
                _residual_of_frame(measured, marks_mm[item], frames[first + row], half_distance_mm, residual[row])
            own = found[item]
            _add(residual[:rows, 0], by_x[first : first + rows], own[:count])
            _add(residual[:rows, 1], by_y[first : first + rows], own[count : 2 * count])
            _add(residual[:rows, 2], by_direction[first : first + rows], own[2 * count : 3 * count])
            _add(residual[:rows, 3], by_distance[first : first + rows], own[3 * count :])


@compiled(nogil=True)
def _add(residual: Floats, functional: Floats, found: Floats) -> None:
    """Add residuals (n,) times functionals (n, k) to found (k,)."""
    whole = len(residual) // 4 * 4
    for row in range(0, whole, 4):
        a, b, c, d = residual[row], residual[row + 1], residual[row + 2], residual[row + 3]
        for k in range(len(found)):
            found[k] += (a * functional[row, k] + b * functional[row + 1, k]) + (
                c * functional[row + 2, k] + d * functional[row + 3, k]
            )
    for row in range(whole, len(residual)):
        for k in range(len(found)):
            found[k] += residual[row] * functional[row, k]


@compiled(nogil=True)
def _whiten(shares: Floats, turned: Floats, found: Floats) -> None:
    """Whitening.of in place."""
    size, parts = turned.shape
    along = np.empty(parts)
    for item in range(len(found)):
        along[:] = 0.0
        for k in range(size):
            for j in range(parts):
                along[j] += found[item, k] * turned[k, j]
        for j in range(parts):
            along[j] *= shares[j]
        for k in range(size):
            more = 0.0
            for j in range(parts):
                more += along[j] * turned[k, j]
            found[item, k] += more


def rms_apart(first: NDArray[np.complex128], second: NDArray[np.complex128]) -> float:
    """RMS distance of points x + iy (n,) after the best rotation and shift of the second onto the first.

    Source: Schönemann (1966), Psychometrika 31, 1, in the plane.
    """
    a, b = first - first.mean(), second - second.mean()
    turn = np.angle(np.sum(a * np.conj(b)))
    return float(np.sqrt(np.mean(np.abs(a - np.exp(1j * turn) * b) ** 2)))


@dataclass(frozen=True)
class Compression:
    """Linear map from channel residuals of one run to whitened features."""

    used: NDArray[np.bool_]  # frames in which both marks were found
    functional: tuple[Floats, ...]  # per channel (frames used, k): slow modes by least squares, whitened
    # of all features, for varying friction and late changes of commands, which affect several channels
    ground: Whitening | None = None
    random_mm: float = (
        0.0  # RMS effect of these on the midpoint, after the best start pose and random effects of the run
    )

    def features(self, residual_mm: Floats) -> Floats:
        """Whitened features of residual channels at the used frames, (n, 4) or (m, n, 4): (k,) or (m, k)."""
        found = self.of_tracking(residual_mm)
        return found if self.ground is None else self.ground.of(found)

    def features_of_marks(self, measured: Floats, marks_mm: Floats, half_distance_mm: float) -> Floats:
        """Whitened features (m, k) of measured channels (n, 4) over marks (m, n, 4) that a model predicts.

        The result for each prediction does not depend on the others, whereas a product by BLAS would round differently.
        """
        modes = [part.shape[1] for part in self.functional]
        found = np.zeros((len(marks_mm), sum(modes)))
        ground = self.ground or Whitening(np.zeros((sum(modes), 0)), np.zeros(0))
        frames = np.flatnonzero(self.used)
        by_x, by_y, by_direction, by_distance = self.functional
        measured = np.ascontiguousarray(measured)
        _features_into(measured, marks_mm, frames, half_distance_mm, by_x, by_y, by_direction, by_distance, found)
        _whiten(ground.shares, np.ascontiguousarray(ground.turned), found)
        return found

    def of_tracking(self, residual_mm: Floats) -> Floats:
        """Features (k,) of residuals (n, 4), whitened by the noise of each channel alone."""
        parts = [np.ascontiguousarray(residual_mm[..., c]) @ part for c, part in enumerate(self.functional)]
        return np.concatenate(parts, axis=-1)


def compression(
    time_s: Floats,
    used: NDArray[np.bool_],
    noise: tuple[Noise, ...],
    floor_mm: float = MODEL_FLOOR_MM,
    bands_hz: Bands = (),
) -> Compression:
    """Modes and whitening of one run. time_s, used: (n,). noise: one per channel.

    floor_mm: precision of the model. bands_hz: of faster modes, in which wheels turn.
    """
    seen = time_s[used]
    span = max(float(seen[-1] - seen[0]), 1e-9)
    count = int(np.clip(2 * span * FASTEST_HZ, 8, MOST_MODES))
    count = min(count, max(len(seen) // 3, 1))
    faster = np.arange(max(count, int(2 * span * FASTEST_HZ)), int(FASTEST_OF_FRAMES * len(seen)))
    numbers = np.concatenate([np.arange(count), faster[within(faster / (2 * span), bands_hz)]])
    modes = np.cos(numbers[None, :] * (np.pi * (seen - seen[0]) / span)[:, None])
    parts: list[Floats] = []
    for channel, part in enumerate(noise):
        if channel == 1 and part == noise[0]:
            parts.append(parts[0])
            continue
        slow = modes[:, :DISTANCE_MODES] if channel == 3 else modes
        # a small ridge regularizes modes that a long gap confounds; any linear functional of the data is valid
        normal = slow.T @ slow
        functional = np.linalg.solve(normal + 1e-6 * np.trace(normal) / len(normal) * np.eye(len(normal)), slow.T)
        covariance = functional @ part.times(seen, functional.T)
        covariance[np.diag_indices(len(covariance))] += floor_mm**2 / (1.0 + numbers[: len(covariance)])
        parts.append(np.ascontiguousarray(solve_triangular(np.linalg.cholesky(covariance), functional, lower=True).T))
    return Compression(used, tuple(parts))


def channel_noise(spectra_by_run: list[tuple[Spectrum, ...]]) -> list[tuple[Noise, ...]]:
    """Noise of every channel of every run: one correlation for all runs, an amplitude for each run.

    Both midpoint coordinates have the same noise. The amplitude of each run is estimated from hundreds of fast modes,
    so that a recording in bad light has less weight. Direction and distance have the same correlation, because both are
    coordinates of the difference of the marks; slow errors of the heading would otherwise look like motion.
    """
    midpoint = fit_noise([item for run in spectra_by_run for item in run[:2]])
    across, along = ([run[channel] for run in spectra_by_run] for channel in (2, 3))
    both = [*_of_one_level(across), *_of_one_level(along)]
    difference = fit_noise(both) if both else None
    direction, distance = fit_noise(across, difference), fit_noise(along, difference)
    return [
        (*(_of_run(run[:2], midpoint),) * 2, _of_run(run[2:3], direction), _of_run(run[3:], distance))
        for run in spectra_by_run
    ]


def _of_one_level(spectra: list[Spectrum]) -> list[Spectrum]:
    """Spectra divided by the median power of their fast modes; those without power are omitted."""
    fast = [item.power_mm2[item.frequency_hz > FASTEST_HZ] for item in spectra]
    level = float(np.median(np.concatenate(fast))) if sum(map(len, fast)) else 0.0
    if level <= QUANTIZATION_MM**2:
        return []
    return [replace(item, power_mm2=item.power_mm2 / level) for item in spectra]


def _of_run(spectra: tuple[Spectrum, ...], noise: Noise) -> Noise:
    """The common noise with the amplitude of a run and with the vibration of its camera."""
    return with_vibration(noise.scaled(_amplitude(spectra, noise)), spectra, FASTEST_HZ)


def _amplitude(spectra: tuple[Spectrum, ...], noise: Noise) -> float:
    """Amplitude of a run relative to the common noise, from its fast modes; 1 if not significantly different."""
    ratios = []
    for item in spectra:
        fast = item.frequency_hz > FASTEST_HZ
        ratios.append(item.power_mm2[fast] / expected_power(noise, item.frequency_hz[fast], item.step_s))
    every = np.concatenate(ratios)
    if len(every) < 50:
        return 1.0
    level = float(np.median(every) / MEDIAN_OF_POWER)
    return float(np.sqrt(level)) if abs(level - 1) > UNLIKE / np.sqrt(TAPERED * len(every)) else 1.0


def residual_spectra(time_s: Floats, residual_mm: Floats, since_s: float, bands_hz: Bands = ()) -> tuple[Spectrum, ...]:
    """Spectrum of every channel of one run's residual (n, 4), from since_s on, which excludes the start of motion.

    bands_hz: in which wheels turn; what is faster than FASTEST_HZ there is omitted.
    """
    moving = time_s >= since_s
    if np.isfinite(residual_mm[moving]).all(axis=1).sum() >= FEWEST_MODES:
        time_s, residual_mm = time_s[moving], residual_mm[moving]
    found = (spectrum(time_s, residual_mm[:, channel]) for channel in range(4))
    return tuple(_outside(item, bands_hz) for item in found)


def _outside(item: Spectrum, bands_hz: Bands) -> Spectrum:
    """A spectrum without the modes above FASTEST_HZ in these bands."""
    kept = (item.frequency_hz <= FASTEST_HZ) | ~within(item.frequency_hz, bands_hz)
    return replace(item, frequency_hz=item.frequency_hz[kept], power_mm2=item.power_mm2[kept])
