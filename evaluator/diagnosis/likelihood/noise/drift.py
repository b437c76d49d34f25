"""Slow tracking errors, estimated from the distance of the marks, which no motion of the robot changes.

Codec errors that repeat, or brush marks of the plate beside a mark, shift the mark by some hundredths of a pixel for
seconds. Fast modes do not show this, and in the path of the robot it cannot be distinguished from motion, but it
changes the distance between the marks. Changes of the distance by scale and keystone of a camera, which are equal in
all runs, are excluded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.noise.tracking import Drift, Noise, correlated

Floats = NDArray[np.float64]

MODES = 8  # as of the distance in a fit (features.DISTANCE_MODES); faster ones hold tracking noise only
# Grid of the fit: from the precision of the model to a drift that anyone sees, by a fifth each, in the field of view of
# the paper's robot; correlation times of a run of ten seconds, which distinguishes no finer ones.
SIZES_MM, LASTING_S = np.geomspace(2e-4, 2e-2, 24), (0.5, 2.0, 8.0)
# Gain in log likelihood from which a drift is accepted: four standard deviations.
BELIEVED = 8.0


@dataclass(frozen=True)
class Distance:
    """Distance of the marks in one run: time_s (n,), residual_mm (n,), marks_mm (n, 4) where both were seen."""

    time_s: Floats
    residual_mm: Floats
    marks_mm: Floats
    noise: Noise


@dataclass(frozen=True)
class _Modes:
    """Slow modes of r runs: values (r, k), derivatives by scale and keystone (r, k, 3), covariances (r, k, k).

    noise: covariance of the noise; kernels: that of a drift of 1 mm, for each of LASTING_S.
    """

    values: Floats
    camera: Floats
    noise: Floats
    kernels: tuple[Floats, ...]


def with_drift(
    noise: Sequence[tuple[Noise, ...]],
    times_s: Sequence[Floats],
    frames: Sequence[NDArray[np.bool_]],
    residuals_mm: Sequence[Floats],
    marks_mm: Sequence[Floats],
    field: float = 1.0,
) -> list[tuple[Noise, ...]]:
    """The noise of every run's channels with the drift estimated from the distance (last channel of (n, 4) residuals).

    field: as of Problem.field_of_view.
    Errors of the two marks are independent, so that midpoint and direction have half the drift of the distance.
    """
    runs = [
        Distance(time[used], residual[used, 3], marks[used], parts[3])
        for parts, time, used, residual, marks in zip(noise, times_s, frames, residuals_mm, marks_mm, strict=True)
        if used.sum() > 3 * MODES
    ]
    size, lasting = drift(runs, field)
    if not size:
        return list(noise)
    shares = (0.5, 0.5, 0.5, 1.0)
    return [
        tuple(replace(part, drift=Drift(share * size, lasting)) for part, share in zip(parts, shares, strict=True))
        for parts in noise
    ]


def drift(runs: Sequence[Distance], field: float = 1.0) -> tuple[float, float]:
    """Standard deviation of the drift of the distance, mm, and its correlation time, s; 0 if there is none."""
    if not runs:
        return 0.0, LASTING_S[0]
    modes = _modes(runs)
    without = _log_likelihood(modes, 0.0, 0)
    found = [
        (_log_likelihood(modes, float(size), index), float(size), lasting)
        for index, lasting in enumerate(LASTING_S)
        for size in field * SIZES_MM
    ]
    best = max(found)
    return best[1:] if best[0] - without > BELIEVED else (0.0, LASTING_S[0])


def _modes(runs: Sequence[Distance]) -> _Modes:
    values, camera, noise, *kernels = (np.array(part) for part in zip(*map(_modes_of, runs), strict=True))
    return _Modes(values, camera, noise, tuple(kernels))


def _modes_of(run: Distance) -> tuple[Floats, ...]:
    """Values (k,), camera (k, 3), covariance of the noise and of each kernel (k, k) of one run."""
    span = max(float(run.time_s[-1] - run.time_s[0]), 1e-9)
    waves = np.cos(np.pi * np.arange(MODES) * ((run.time_s - run.time_s[0]) / span)[:, None])
    normal = waves.T @ waves  # a little ridge keeps modes apart that a long gap confounds
    functional = np.linalg.solve(normal + 1e-6 * np.trace(normal) / MODES * np.eye(MODES), waves.T)
    middle = (run.marks_mm[:, :2] + run.marks_mm[:, 2:]) / 2
    across = run.marks_mm[:, :2] - run.marks_mm[:, 2:]
    across = across / np.hypot(across[:, 0], across[:, 1])[:, None]
    # scale, and the keystone k of (1 + k·p) p: along the line of the marks it stretches by k·p + (k·u)(p·u)
    stretch = middle + across * np.sum(middle * across, axis=1)[:, None]
    return (
        functional @ run.residual_mm,
        functional @ np.column_stack([np.ones(len(stretch)), stretch]),
        functional @ run.noise.times(run.time_s, functional.T),
        *(functional @ correlated(run.time_s, lasting, functional.T) for lasting in LASTING_S),
    )


def _log_likelihood(modes: _Modes, size_mm: float, kernel: int) -> float:
    """Log likelihood of all runs, maximised over the camera's three parameters."""
    root = np.linalg.cholesky(modes.noise + size_mm**2 * modes.kernels[kernel])
    white = np.linalg.solve(root, np.concatenate([modes.values[..., None], modes.camera], axis=2))
    values, camera = white[:, :, 0].ravel(), white[:, :, 1:].reshape(-1, 3)
    normal, right = camera.T @ camera, camera.T @ values
    widths = 2 * float(np.log(np.diagonal(root, axis1=1, axis2=2)).sum())
    square = float(values @ values - right @ np.linalg.lstsq(normal, right, rcond=1e-12)[0])
    return -0.5 * (square + widths)
