"""Marks of a robot whose motion is known in closed form, for tests of what recordings show."""

from __future__ import annotations

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.motion import onset

RATE = 60
NOISE_MM = 1e-4


def moving(time: np.ndarray, speed: float = 2.0, yaw: float = 0.8, heading: float = 0.4) -> np.ndarray:
    """Marks 2 mm to the left and right of a robot on a circle from (3, -2), (n, 4)."""
    turned = heading + yaw * time
    chord = speed * time * np.sinc(yaw * time / 2 / np.pi)
    way = heading + yaw * time / 2
    middle = np.column_stack([3 + chord * np.cos(way), -2 + chord * np.sin(way)])
    left = 2 * np.column_stack([-np.sin(turned), np.cos(turned)])
    return np.concatenate([middle + left, middle - left], axis=1)


def recorded(marks: np.ndarray, time: np.ndarray | None = None, noise_mm: float = NOISE_MM) -> RunData:
    time = np.arange(len(marks)) / RATE if time is None else time
    noisy = marks + noise_mm * np.random.default_rng(0).normal(size=marks.shape)
    return RunData("r", 30.0, 20.0, 0.0, None, time, noisy, 0)


TIME = np.arange(180) / RATE


def onset_s(run: RunData) -> float | None:
    """When motion begins, s; None where that is not seen."""
    found = onset(run)
    return None if found is None else found.time_s
