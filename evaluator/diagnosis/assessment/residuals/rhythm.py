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
from evaluator.diagnosis.assessment.residuals.ways import Ways, residual_ways

if TYPE_CHECKING:
    from evaluator.diagnosis.likelihood.point import Point
    from evaluator.diagnosis.likelihood.problem import Problem

Floats = NDArray[np.float64]

# Share of the squares of all runs that a sine of one frequency must explain. Of 240 sets of ten drawn runs (random
# walks, integrated ones, noise with and without memory) the largest was 0.33; a controller that hunts had 0.99.
EXPLAINS = 0.5
FEWEST_RUNS = 5
LEAST_PERIODS, FRAMES_PER_PERIOD = 3.0, 6.0  # of a run; fewer are as slow as the course beside it
PER_RUN = 4  # frequencies over one more period in a run
SLOW = 3  # degree of the slow course of a run
BY = "rhythm"
# A camera or a plate that shakes moves the marks across the paths of the runs as much as along them, and before the
# motors start. A speed that oscillated by 6 % moved them 1.8 times as much along, as the marks are beside the centre;
# that of one side by 4 % moved them less along than across, because it turned the robot.
ALONG, AT_REST = 1.4, 0.5


def rhythm(problem: Problem, point: Point) -> Dependence | None:
    """The oscillation of speed or yaw rate that all runs share at a point of a model; None without one.

    Its size is the amplitude of the velocity, RMS over the runs: of speed or yaw rate, which is explained better. Its
    sigmas count every frame as independent, and are the most that they can be.
    """
    times, ways, _ = _driven(residual_ways(problem, point))
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


def is_of_robot(problem: Problem, point: Point, beat: Dependence) -> bool:
    """Whether an oscillation at a point of a model is the robot's, and not that of a camera or a plate that shakes."""
    times, ways, across = _driven(residual_ways(problem, point))
    frequency, along = beat.sizes[0][0], ways["along_mm_s"]
    beats = np.array([frequency])
    moved, aside = (_squares(times, part, beats)[0][0] for part in (along, across))
    turned, whole = _squares(times, ways["yaw_deg_s"], beats)
    turns = turned[0] >= EXPLAINS * whole  # a camera that shakes shifts marks, and turns nothing
    if beat.quantity == "along_mm_s" and not turns and moved < ALONG**2 * aside:
        return False
    rest_times, rest = _at_rest(problem, LEAST_PERIODS / frequency)
    if not rest_times:
        return True
    driven, resting = (
        sum(_squares(when, part, beats)[0][0] for part in parts) / sum(map(len, when))
        for when, parts in ((times, (along, across)), (rest_times, rest))
    )
    return bool(resting < AT_REST**2 * driven)


def _at_rest(problem: Problem, lasts_s: float) -> tuple[list[Floats], tuple[list[Floats], list[Floats]]]:
    """Times, s, and x and y, mm, of the marks' midpoint before the start, of runs that are seen at rest so long."""
    times, x, y = list[Floats](), list[Floats](), list[Floats]()
    for run, channels in zip(problem.data, problem.channels, strict=True):
        used = np.isfinite(channels[:, :2]).all(axis=1) & (run.time_s < run.start_s)
        if used.any() and np.ptp(run.time_s[used]) > lasts_s:
            times.append(run.time_s[used])
            x.append(channels[used, 0])
            y.append(channels[used, 1])
    return times, (x, y)


def _driven(ways: Sequence[Ways]) -> tuple[list[Floats], dict[str, list[Floats]], list[Floats]]:
    """Times since the start, s, and residual ways of each run: mm along the robot and deg; mm across it."""
    along, turned = [item.along_mm for item in ways], [item.turned_deg for item in ways]
    times = [item.time_s - item.run.start_s for item in ways]
    return times, {"along_mm_s": along, "yaw_deg_s": turned}, [item.across_mm for item in ways]


def _strongest(times: Sequence[Floats], ways: Sequence[Floats]) -> tuple[float, float, float]:
    """Frequency, Hz, of the sine that explains most, its share of the squares, and the amplitude of its velocity."""
    lasts = float(np.median([time[-1] - time[0] for time in times]))
    fastest = 1 / (FRAMES_PER_PERIOD * float(np.median(np.concatenate([np.diff(time) for time in times]))))
    frequencies = np.arange(LEAST_PERIODS / lasts, fastest, 1 / (PER_RUN * lasts))
    if not len(frequencies):
        return np.nan, 0.0, np.nan
    explained, whole = _squares(times, ways, frequencies)
    best, count = int(explained.argmax()), sum(map(len, times))
    frequency = float(frequencies[best])
    # a sine of amplitude a has the squares n a²/2, and its velocity the amplitude 2 pi f a
    amplitude = 2 * np.pi * frequency * float(np.sqrt(2 * explained[best] / count))
    return frequency, float(explained[best]) / max(whole, 1e-300), amplitude


def _squares(times: Sequence[Floats], ways: Sequence[Floats], frequencies: Floats) -> tuple[Floats, float]:
    """Squares that a sine of each frequency, Hz, explains in ways beside a slow course, and all squares beside that.

    frequencies: evenly spaced, so that each wave is the one before times another.
    """
    spacing = frequencies[1] - frequencies[0] if len(frequencies) > 1 else 0.0
    explained, whole = np.zeros(len(frequencies)), 0.0
    for time, way in zip(times, ways, strict=True):
        slow = np.linalg.qr(np.vander(2 * (time - time[0]) / (time[-1] - time[0]) - 1, SLOW + 1))[0]
        rest = way - slow @ (slow.T @ way)
        whole += float(rest @ rest)
        wave, turn = (np.exp(2j * np.pi * frequency * time) for frequency in (frequencies[0], spacing))
        course = slow.astype(np.complex128)
        for k in range(len(frequencies)):
            explained[k] += _explained(wave - course @ (course.T @ wave), rest)
            wave *= turn
    return explained, whole


def _explained(wave: NDArray[np.complex128], rest: Floats) -> float:
    """Squares of a rest (n,) that its least squares by the real and the imaginary part of a wave (n,) explain."""
    size, square, along = float(np.vdot(wave, wave).real), complex(wave @ wave), complex(rest @ wave)
    cosine, sine, both = (size + square.real) / 2, (size - square.real) / 2, square.imag / 2
    told = sine * along.real**2 - 2 * both * along.real * along.imag + cosine * along.imag**2
    return told / (cosine * sine - both**2)
