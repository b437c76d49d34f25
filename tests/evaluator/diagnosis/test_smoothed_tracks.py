"""Smoothed tracks: recognised by the frequencies that their noise lacks, and not used near changes of the motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter, savgol_filter

from evaluator.diagnosis.likelihood.noise.smoothing import AVERAGED_FRAMES, averaged_frames, is_smoothed
from evaluator.diagnosis.likelihood.noise.spectrum import spectrum
from evaluator.diagnosis.likelihood.preparation import build_problem
from evaluator.diagnosis.likelihood.run_data import PER_RUN, RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from simulator.robot import load_robot

RATE, FRAMES = 60.0, 480
TIME = np.arange(FRAMES) / RATE


def mean_of(frames: int) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: np.convolve(values, np.ones(frames) / frames, mode="same")


def parabola_of(frames: int) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: savgol_filter(values, frames, 2)


def alike(decay: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: lfilter([1.0], [1.0, -decay], values)


def flickering(values: np.ndarray) -> np.ndarray:
    """Noise that is largest about 20 Hz."""
    return values + 0.25 * lfilter([1.0], [1.0, -2 * 0.96 * np.cos(2 * np.pi * 0.3375), 0.96**2], values[::-1])


def raw(values: np.ndarray) -> np.ndarray:
    return values


@pytest.mark.parametrize(
    ("tracked", "smoothed"),
    [
        *((mean_of(frames), True) for frames in (3, 5, 9)),
        *((parabola_of(frames), True) for frames in (5, 7, 9)),
        (raw, False),
        (flickering, False),
        *((alike(decay), False) for decay in (0.5, 0.9, 0.99)),
    ],
)
def test_tracks_are_smoothed_if_their_noise_lacks_frequencies_below_others_that_it_has(
    tracked: Callable[[np.ndarray], np.ndarray], *, smoothed: bool
) -> None:
    for seed in range(5):
        noise = np.random.default_rng(seed).normal(0.0, 0.01, (12, FRAMES))
        spectra = [spectrum(TIME, tracked(row) + 0.5 * np.sin(TIME)) for row in noise]
        assert is_smoothed(spectra) == smoothed
    assert not is_smoothed(spectra[:1])  # too few modes to tell
    assert not is_smoothed([])


def test_frames_that_average_over_a_change_are_those_next_to_it() -> None:
    near = averaged_frames(TIME, [1.0, 100.0])
    assert np.flatnonzero(near).tolist() == list(range(60 - AVERAGED_FRAMES, 61 + AVERAGED_FRAMES))
    assert not averaged_frames(TIME, np.arange(0.0, 8.0, 0.4).tolist()).any()  # a log of a controller
    assert averaged_frames(TIME, np.arange(0.0, 8.0, 0.5).tolist()).sum() < FRAMES / 2
    assert not averaged_frames(TIME[:1], [0.0]).any()


@pytest.mark.parametrize("smoothed", [True, False])
def test_a_problem_of_smoothed_tracks_does_not_use_frames_near_start_and_stop(*, smoothed: bool) -> None:
    robot, rng = load_robot("barrel"), np.random.default_rng(1)
    filtered = mean_of(5) if smoothed else raw
    runs = []
    for number in range(4):
        run = RunData(f"r{number}", 33.3, 14.4, 1.0, 6.0, TIME, np.zeros((FRAMES, 4)), number)
        task = Task(0, tuple(np.zeros(PER_RUN)), {}, {})
        marks = Simulated([robot], [run], {}).marks([task])[0]
        noisy = marks + rng.normal(0.0, 0.005, marks.shape)
        noisy[10:-10] = np.apply_along_axis(filtered, 0, noisy)[10:-10]
        runs.append(replace(run, marks_mm=noisy))
    problem, _ = build_problem(runs, Simulated([robot] * 4, runs, {}))
    assert problem.smoothed == smoothed
    for run in range(4):
        used = problem.counting_frames(run)
        for change in (60, 360):
            near = used[change - AVERAGED_FRAMES : change + AVERAGED_FRAMES + 1]
            assert near.any() != smoothed
        assert used.sum() >= FRAMES - 2 * (2 * AVERAGED_FRAMES + 1) - 5
