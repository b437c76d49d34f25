"""Slow tracking errors are seen in the distance of the marks, and nothing else is taken for them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from evaluator.diagnosis.likelihood.noise.drift import Distance, drift
from evaluator.diagnosis.likelihood.noise.tracking import Noise

SIGMA_MM, STEP_S, COUNT, APART_MM = 0.004, 1 / 30, 165, 3.66


def _correlated(rng: np.random.Generator, sigma_mm: float, lasting_s: float) -> NDArray[np.float64]:
    decay = np.exp(-STEP_S / lasting_s)
    white = rng.normal(size=COUNT + 2000) * np.sqrt(1 - decay**2)
    return sigma_mm * np.asarray(lfilter([1], [1, -decay], white))[2000:]


def _runs(seed: int, drift_mm: float, keystone_per_mm: float = 0.0) -> list[Distance]:
    rng = np.random.default_rng(seed)
    time, noise, runs = np.arange(COUNT) * STEP_S, Noise(0.0, SIGMA_MM, 0.06), []
    for _ in range(18):
        heading, start = rng.uniform(-np.pi, np.pi), rng.uniform(-10, 10, 2)
        along = np.array([np.cos(heading), np.sin(heading)])
        middle = start + 3.0 * time[:, None] * along
        across = APART_MM * np.array([-along[1], along[0]])
        marks = np.concatenate([middle + across / 2, middle - across / 2], axis=1)
        green, yellow = ((1 + keystone_per_mm * part[:, :1]) * part for part in (marks[:, :2], marks[:, 2:]))
        distance = np.hypot(*(green - yellow).T) - APART_MM
        distance += _correlated(rng, SIGMA_MM, 0.06) + _correlated(rng, drift_mm, 2.0)
        runs.append(Distance(time, distance, marks, noise))
    return runs


def test_a_drift_is_found_with_its_size() -> None:
    sizes = [drift(_runs(seed, 0.002))[0] for seed in range(3)]
    assert sizes == pytest.approx([0.002] * 3, rel=0.4)


def test_noise_that_is_known_makes_no_drift() -> None:
    assert [drift(_runs(seed, 0.0))[0] for seed in range(3)] == [0.0] * 3


def test_what_a_camera_does_to_the_distance_is_no_drift() -> None:
    assert drift(_runs(5, 0.0, keystone_per_mm=1e-3))[0] == 0.0
