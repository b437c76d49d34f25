"""Tracks that a program has smoothed or that are from a film: their frames that average over a change of the motion.

A moving average of some frames, or a polynomial through them, leaves a steady turn as it is to a part in 10,000, but
begins to move before the motors start and is late after it. Motors that follow their command with a lag of a frame and
a half do the same: a mean of five frames at 60 Hz was named command-lag with a probability above 0.999. Codecs predict
frames from those before and after, so that films begin to move too early as well, by less and over fewer frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.noise.spectrum import Spectrum

Floats = NDArray[np.float64]

# Frequencies, as shares of the frame rate, between which noise is examined, and the number of bands there. Means of up
# to 25 frames let nothing through at frequencies 0.04 apart, which half of the bands resolve as well.
SLOWEST, FASTEST, MOST_BANDS, FEWEST_BANDS = 0.06, 0.5, 96, 48
FEWEST_MODES = 20  # in each band: the logarithms of medians of their powers scatter by a half
# Windows of smoothing: means, and parabolas (Savitzky & Golay 1964, Anal. Chem. 36, 1627), which let through as much as
# means of half as many frames.
MEANS, PARABOLAS = range(3, 26), range(5, 32, 2)
FLOORS = (0.001, 0.003, 0.01, 0.03, 0.1)  # of the power, as rounding and frames that were lost later add it
SHAPES = 4  # of noise that is not smoothed: a cubic in the frequency follows it within a tenth
# Share of the variance of log power, beside a cubic, that a window explains. In four sessions with means of 5, 9 and 15
# frames and parabolas of 15, and with frames lost, it was 0.82 to 0.89, and the window the right one; in 140 others of
# four banks it was 0.20 at most.
EXPLAINS = 0.5
# A filter without such frequencies (Butterworth, Gauss) shows by how much less power the fastest noise has than the
# slowest: noise that is alike in neighbouring frames has ten times less, as a random walk does. Tracks that were
# interpolated from 60 to 100 frames/s had 60 times less, those 140 four times at most.
FALLS = 30.0
# Frames on either side of a change, beside half of the window: a start is known to a frame and a half.
AROUND_WINDOW = 2
# The same where noise is examined, before the window is known.
UNSETTLED_FRAMES = 6
# The same of films. In 9 clips by x264 with B frames, the last three frames at rest were ahead by up to 0.07, 0.2 and
# 0.3 of a frame's motion, and the first two in motion off by up to 0.17 of it; one frame for the start.
PREDICTED_FRAMES = 4


def smoothed_over(spectra: Sequence[Spectrum]) -> int:
    """Frames over which the tracks of all runs are smoothed, by frequencies that their noise lacks; 0 of raw ones."""
    if not spectra:
        return 0
    frequency = np.concatenate([item.frequency_hz * item.step_s for item in spectra])
    power = np.concatenate([item.power_mm2 for item in spectra])
    inside = (frequency > SLOWEST) & (frequency <= FASTEST)
    bands = min(int(inside.sum()) // FEWEST_MODES, MOST_BANDS)
    if bands < FEWEST_BANDS:
        return 0
    edges = np.linspace(SLOWEST, FASTEST, bands + 1)
    levels = np.array([np.median(power[(low < frequency) & (frequency <= high)]) for low, high in pairwise(edges)])
    if not (levels > 0).all():
        return 0
    windows, transferred = _log_powers(edges)
    shape = np.vander((edges[1:] + edges[:-1]) / 2, SHAPES)
    basis = np.linalg.qr(shape)[0]
    seen, expected = (part - basis @ (basis.T @ part) for part in (np.log(levels), transferred))
    along = seen @ expected
    explained = np.where(along > 0, along**2, 0.0) / np.maximum(np.sum(expected**2, axis=0) * np.sum(seen**2), 1e-300)
    best = int(np.argmax(explained))
    # a filter without zeros may look like a mean of three frames
    return max(int(windows[best]) if explained[best] > EXPLAINS else 0, _low_passed(edges, levels))


def _low_passed(edges: Floats, levels: Floats) -> int:
    """Frames over which a filter without zeros averages; 0 without one. levels: power (m,) of the bands.

    It is told by where the power falls to a quarter. That of a Gaussian of one standard deviation s falls so at a
    frequency of 0.187/s; three of these on either side.
    """
    quarter = len(levels) // 4
    slow, fast = np.median(levels[:quarter]), np.median(levels[-quarter:])
    if slow < FALLS * fast:
        return 0
    beyond = np.flatnonzero(levels < max(levels[:3].mean(), slow) / 4)
    return round(2 * 3 * 0.187 / float(edges[beyond[0] + 1]))


def _log_powers(edges: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Windows (k,), one for each floor, and logarithms (m, k) of the power that they let through; edges: m + 1."""
    inside = np.linspace(edges[:-1], edges[1:], 7)[1:-1]
    waves = np.exp(2j * np.pi * np.multiply.outer(inside, np.arange(max(PARABOLAS))))
    kernels = [np.full(size, 1 / size) for size in MEANS] + [_parabola(size) for size in PARABOLAS]
    powers = [np.mean(np.abs(waves[..., : len(kernel)] @ kernel) ** 2, axis=0) for kernel in kernels]
    logs = [np.log(power + floor) for power in powers for floor in FLOORS]
    return np.repeat([*MEANS, *PARABOLAS], len(FLOORS)), np.column_stack(logs)


def _parabola(size: int) -> Floats:
    """Weights (size,) by which frames give the middle of the parabola of least squares through them."""
    powers = np.vander(np.linspace(-1.0, 1.0, size), 3)
    return np.asarray(powers @ np.linalg.inv(powers.T @ powers)[:, 2])


def averaged_frames(time_s: Floats, changes_s: Sequence[float], frames: int) -> NDArray[np.bool_]:
    """Frames (n,) within some frames of a change of the motion; none if that were more than half of them.

    Half of the frames are left by a dozen changes in ten seconds; a log of a controller has hundreds of small ones.
    """
    reach_s = (frames + 0.5) * float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    near = np.zeros(len(time_s), dtype=np.bool_)
    for at in changes_s:
        near |= np.abs(time_s - at) < reach_s
    return near if near.sum() <= len(near) / 2 else np.zeros_like(near)
