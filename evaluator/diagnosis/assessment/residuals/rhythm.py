"""A rhythm that all runs share: an oscillation of the residuals, as by a controller that hunts or a plate that shakes.

Each run has its own phase and amplitude, so that no law with common parameters describes it. In each run a sine of one
frequency is fitted beside a slow course; of random residuals, a walk or noise, no frequency explains half.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.assessment.residuals.disagreement import QUANTITIES, UNITS, Dependence

if TYPE_CHECKING:
    from evaluator.diagnosis.likelihood.point import Point
    from evaluator.diagnosis.likelihood.problem import Problem

Floats = NDArray[np.float64]

# Share of the squares of all runs that a sine of one frequency must explain. Of 240 sets of ten drawn runs (random
# walks, integrated ones, noise with and without memory) the largest was 0.33; a controller that hunts had 0.99.
EXPLAINS = 0.5
FEWEST_RUNS, FEWEST_FRAMES = 5, 30
LEAST_PERIODS, FRAMES_PER_PERIOD = 3.0, 6.0  # of a run; fewer are as slow as the course beside it
PER_RUN = 4  # frequencies over one more period in a run
SLOW = 3  # degree of the slow course of a run
BY = "rhythm"


def rhythm(problem: Problem, point: Point) -> Dependence | None:
    """The oscillation of speed or yaw rate that all runs share at a point of a model; None without one.

    Its size is the amplitude of the velocity, RMS over the runs: of speed or yaw rate, which is explained better. Its
    sigmas count every frame as independent, and are the most that they can be.
    """
    times, ways = _ways(problem, point)
    if len(times) < FEWEST_RUNS:
        return None
    found = []
    for quantity, of_quantity in ways.items():
        frequency, share, amplitude = _strongest(times, of_quantity)
        if share >= EXPLAINS:
            found.append((share, quantity, frequency, amplitude))
    if not found:
        return None
    share, quantity, frequency, amplitude = max(found)
    sentence = (
        f"measured {QUANTITIES[quantity]} oscillates at {frequency:.2g} Hz in all runs, by {amplitude:.2g} "
        f"{UNITS[quantity]} (that explains {100 * share:.0f} % of what is left)"
    )
    sigmas = float(np.sqrt(sum(map(len, times)) * share))
    return Dependence(quantity, BY, "", sigmas, sentence, ((frequency, frequency, frequency),), amplitude / np.sqrt(2))


def _ways(problem: Problem, point: Point) -> tuple[list[Floats], dict[str, list[Floats]]]:
    """Times, s, and residual ways, mm along the robot and deg, of the driven frames of each run."""
    times: list[Floats] = []
    along, turned = list[Floats](), list[Floats]()
    for number, run in enumerate(problem.data):
        residual, channels = problem.residuals([point.task(number)])[0], problem.channels[number]
        stop_s = np.inf if run.stop_s is None else run.stop_s
        used = np.isfinite(residual[:, :3]).all(axis=1) & (run.time_s > run.start_s) & (run.time_s < stop_s)
        if used.sum() < FEWEST_FRAMES:
            continue
        heading = channels[used, 2] - np.pi / 2
        times.append(run.time_s[used] - run.start_s)
        along.append(np.cos(heading) * residual[used, 0] + np.sin(heading) * residual[used, 1])
        turned.append(np.degrees(residual[used, 2] / problem.half_distance_mm))
    return times, {"along_mm_s": along, "yaw_deg_s": turned}


def _strongest(times: Sequence[Floats], ways: Sequence[Floats]) -> tuple[float, float, float]:
    """Frequency, Hz, of the sine that explains most, its share of the squares, and the amplitude of its velocity."""
    lasts = float(np.median([time[-1] - time[0] for time in times]))
    fastest = 1 / (FRAMES_PER_PERIOD * float(np.median(np.concatenate([np.diff(time) for time in times]))))
    frequencies = np.arange(LEAST_PERIODS / lasts, fastest, 1 / (PER_RUN * lasts))
    if not len(frequencies):
        return np.nan, 0.0, np.nan
    explained, whole = np.zeros(len(frequencies)), 0.0
    for time, way in zip(times, ways, strict=True):
        slow = np.linalg.qr(np.vander(2 * (time - time[0]) / (time[-1] - time[0]) - 1, SLOW + 1))[0]
        rest = way - slow @ (slow.T @ way)
        whole += float(rest @ rest)
        for k, frequency in enumerate(frequencies):
            angle = 2 * np.pi * frequency * time
            waves = np.column_stack([np.cos(angle), np.sin(angle)])
            basis = np.linalg.qr(waves - slow @ (slow.T @ waves))[0]
            explained[k] += float(np.square(basis.T @ rest).sum())
    best, count = int(explained.argmax()), sum(map(len, times))
    frequency = float(frequencies[best])
    # a sine of amplitude a has the squares n a²/2, and its velocity the amplitude 2 pi f a
    amplitude = 2 * np.pi * frequency * float(np.sqrt(2 * explained[best] / count))
    return frequency, float(explained[best]) / max(whole, 1e-300), amplitude
