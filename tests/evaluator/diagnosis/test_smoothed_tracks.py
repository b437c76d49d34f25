"""Smoothed tracks: recognised by the frequencies that their noise lacks, and not used near changes of the motion."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, filtfilt, lfilter, savgol_filter

import simulator
from evaluator.diagnosis.experiment import _read
from evaluator.diagnosis.likelihood.noise.smoothing import (
    AROUND_WINDOW,
    PREDICTED_FRAMES,
    averaged_frames,
    smoothed_over,
)
from evaluator.diagnosis.likelihood.noise.spectrum import Spectrum, spectrum
from evaluator.diagnosis.likelihood.preparation import build_problem
from evaluator.diagnosis.likelihood.run_data import PER_RUN, RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.settings import load_experiment
from evaluator.workflow.runs.mistakes import given_marks
from simulator.robot import load_robot

RATE, FRAMES = 60.0, 480
AVERAGED = 5 // 2 + AROUND_WINDOW  # frames on either side of a change that a mean of five averages
BARREL = Path(simulator.__file__).parent / "robots" / "barrel.toml"
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


def gaussian(frames: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda values: gaussian_filter1d(values, frames)


def butterworth(cutoff_hz: float) -> Callable[[np.ndarray], np.ndarray]:
    """The filter that gait laboratories apply to all tracks, forward and backward."""
    return lambda values: filtfilt(*butter(2, cutoff_hz, fs=RATE), values)


def interpolated(values: np.ndarray) -> np.ndarray:
    """From 60 to 100 frames/s."""
    return np.interp(np.arange(FRAMES) * 0.6, np.arange(FRAMES), values)


@pytest.mark.parametrize(
    ("tracked", "least", "most"),
    [
        *((mean_of(frames), frames, frames + 4) for frames in (3, 4, 5, 9, 15, 25)),
        *((parabola_of(frames), frames, frames + 4) for frames in (5, 7, 9, 15, 31)),
        (gaussian(1.0), 5, 9),
        (gaussian(2.0), 9, 14),
        (butterworth(6.0), 9, 14),
        (butterworth(10.0), 6, 10),
        (interpolated, 3, 12),
        (raw, 0, 0),
        (flickering, 0, 0),
        *((alike(decay), 0, 0) for decay in (0.5, 0.9, 0.99)),
    ],
)
def test_tracks_are_smoothed_over_the_window_whose_frequencies_their_noise_lacks(
    tracked: Callable[[np.ndarray], np.ndarray], least: int, most: int
) -> None:
    for seed, runs in enumerate((12, 6)):
        noise = np.random.default_rng(seed).normal(0.0, 0.01, (runs, FRAMES))
        spectra = [spectrum(TIME, tracked(row) + 0.5 * np.sin(TIME)) for row in noise]
        assert least <= smoothed_over(spectra) <= most
    assert not smoothed_over(spectra[:2])  # too few modes to tell
    assert not smoothed_over([])


@pytest.mark.parametrize("window", [5, 9, 15])
def test_a_window_is_found_though_frames_were_lost_and_coordinates_rounded_after_it(window: int) -> None:
    """With three frames in a hundred lost, a mean of nine frames was not seen, and named command-lag."""
    rng = np.random.default_rng(window)
    spectra = []
    for _ in range(16):
        smooth = np.round(mean_of(window)(rng.normal(0.0, 0.01, FRAMES)), 4)
        kept = np.sort(rng.choice(FRAMES, round(0.97 * FRAMES), replace=False))
        spectra.append(spectrum(TIME[kept], smooth[kept]))
    assert smoothed_over(spectra) == window


def test_a_filter_that_also_lacks_the_slowest_noise_is_found() -> None:
    frequency = np.linspace(0.1, 30.0, 4000)
    power = np.where(frequency < 5.0, 1e-4, np.where(frequency < 14.0, 1.0, 1e-3))
    assert smoothed_over([Spectrum(frequency, power, 1 / RATE)]) >= round(2 * 3 * 0.187 / (14.5 / RATE))


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_tracks_without_noise_are_not_smoothed(value: float) -> None:
    still = Spectrum(np.linspace(0.1, 30.0, 4000), np.full(4000, value), 1 / RATE)
    assert smoothed_over([still]) == 0


def test_frames_that_average_over_a_change_are_those_next_to_it() -> None:
    near = averaged_frames(TIME, [1.0, 100.0], AVERAGED)
    assert np.flatnonzero(near).tolist() == list(range(60 - AVERAGED, 61 + AVERAGED))
    assert not averaged_frames(TIME, np.arange(0.0, 8.0, 0.4).tolist(), 6).any()  # a log of a controller
    assert averaged_frames(TIME, np.arange(0.0, 8.0, 0.5).tolist(), 6).sum() < FRAMES / 2
    assert not averaged_frames(TIME[:1], [0.0], AVERAGED).any()


@pytest.mark.parametrize(
    ("smoothed", "filmed", "left"), [(True, False, AVERAGED), (True, True, AVERAGED),
                                     (False, True, PREDICTED_FRAMES), (False, False, 0)],
)  # fmt: skip
def test_a_problem_of_smoothed_or_filmed_tracks_does_not_use_frames_near_start_and_stop(
    *, smoothed: bool, filmed: bool, left: int
) -> None:
    robot, rng = load_robot("barrel"), np.random.default_rng(1)
    filtered = mean_of(5) if smoothed else raw
    runs = []
    for number in range(4):
        run = RunData(f"r{number}", 33.3, 14.4, 1.0, 6.0, TIME, np.zeros((FRAMES, 4)), number, filmed=filmed)
        task = Task(0, tuple(np.zeros(PER_RUN)), {}, {})
        marks = Simulated([robot], [run], {}).marks([task])[0]
        noisy = marks + rng.normal(0.0, 0.005, marks.shape)
        noisy[10:-10] = np.apply_along_axis(filtered, 0, noisy)[10:-10]
        runs.append(replace(run, marks_mm=noisy))
    problem, _ = build_problem(runs, Simulated([robot] * 4, runs, {}))
    assert problem.smoothed_over == (5 if smoothed else 0)
    for run in range(4):
        used = problem.counting_frames(run)
        for change in (60, 360):
            assert used[change - left : change + left + 1].any() == (left == 0)
            assert used[[change - left - 1, change + left + 1]].all()
        assert used[:AVERAGED].any() == used[-AVERAGED:].any() == (not smoothed)
        assert used[[AVERAGED + 1, -AVERAGED - 2]].all()
        assert used.sum() >= FRAMES - 6 * (AVERAGED + 1) - 5


@pytest.mark.parametrize("robot", ["barrel", "of three marks"])
def test_marks_with_the_status_of_a_tracker_are_from_a_film(robot: str, tmp_path: Path) -> None:
    marks = {"green": (-1.55, 1.83), "yellow": (-1.55, -1.83)}
    if robot != "barrel":
        marks["red"] = (2.0, 0.0)
        placed = "".join(f'[[mark]]\nname = "{name}"\nx_mm = {x}\ny_mm = {y}\n' for name, (x, y) in marks.items())
        table = re.compile(r"^\[marks\]\n(?:[^\[\n].*\n|\n)*", re.MULTILINE)
        (tmp_path / "robot.toml").write_text(table.sub("", BARREL.read_text("utf-8")) + placed, "utf-8")
    columns = {
        f"{name}_{axis}_mm": at + 0.001 * TIME for name, p in marks.items() for axis, at in zip("xy", p, strict=True)
    }
    table = pd.DataFrame({"time_s": TIME} | columns)
    table.to_csv(tmp_path / "other.csv", index=False)
    table.assign(green_status="ok").to_csv(tmp_path / "own.csv", index=False)
    runs = "".join(
        f'[[run]]\nid = "{name}"\nleft_rpm = 20\nright_rpm = 20\nmarks = "{name}.csv"\n' for name in ("own", "other")
    )
    chosen = "barrel" if robot == "barrel" else "robot.toml"
    (tmp_path / "e.toml").write_text(f'format = 1\nname = "x"\nrobot = "{chosen}"\n{runs}')
    experiment = load_experiment(tmp_path / "e.toml")
    session, _ = _read(experiment, given_marks(experiment), {})
    assert {run.id: run.filmed for run in session.data} == {"own": True, "other": False}
