"""Phases of a run: rest, start, transient, steady turn, stop; found from the motion itself.

The poses of a robot at rest scatter about one pose with the noise of the tracker; a moving robot leaves it for good.
Command times, if given, limit the search and give the delay of the start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d, median_filter

from evaluator.robust import PER_MEDIAN

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
NAN = float("nan")

# A turn is steady while its speed and yaw rate stay within this share of their usual values; the remaining variation of
# the radius is measured.
STEADY_SHARE = 0.05
# A robot moves if it is faster than this share of its usual speed.
MOVING_SHARE = 0.2
# Scatter and slope at rest are below this many standard deviations (exceeded in 1 frame of 16,000).
REST_SIGMA = 4.0
BRIEF_S = 0.5  # a push, or a hand that takes the robot away, with the window of a local speed
# Required relative precision of a local speed: a fifth of the smallest change that matters.
SLOPE_SHARE = STEADY_SHARE / 5


@dataclass(frozen=True)
class Phases:
    """Times of the phases, s, in the time of the recording; NaN if a phase was not observed.

    The robot moves from start_s to stop_s and turns steadily from steady_start_s to steady_stop_s; before start_s and
    after stop_s it rests. delay_s: start_s minus the commanded start. reason: why there is no motion, else "".
    """

    start_s: float = NAN
    steady_start_s: float = NAN
    steady_stop_s: float = NAN
    stop_s: float = NAN
    delay_s: float = NAN
    reason: str = ""

    def names(self, time_s: Array) -> NDArray[np.str_]:
        """Phase of every frame, (n,): rest, transient, steady or stop (slowing down)."""
        if self.reason:
            return np.full(len(time_s), "rest")
        after = self.stop_s if np.isfinite(self.stop_s) else np.inf
        before = self.start_s if np.isfinite(self.start_s) else -np.inf
        moving = (time_s >= before) & (time_s <= after)
        steady = moving & (time_s >= self.steady_start_s) & (time_s <= self.steady_stop_s)
        late = moving & (time_s > self.steady_stop_s)
        return np.select([steady, late, moving], ["steady", "stop", "transient"], default="rest")


@dataclass(frozen=True)
class Rates:
    """Local velocities: (m, 3) in mm/s, of the scaled poses; their sigma and the half-width of the window in frames."""

    value: Array
    sigma: float
    half_width: int


def find_phases(
    time_s: Array, scaled: Array, sigma_mm: float, start_s: float | None = None, stop_s: float | None = None
) -> Phases:
    """Find the phases of a run.

    time_s: (n,). scaled: (n, 3) of x, y, length · heading, mm, without NaN, each with noise sigma_mm. start_s, stop_s:
    times of the commands, if known: motion is searched between them, but may continue after stop_s.
    """
    begin, end = -np.inf if start_s is None else start_s, np.inf if stop_s is None else stop_s
    inside = (time_s >= begin) & (time_s <= end)
    if inside.sum() < 5:
        return Phases(reason="no motion is recorded between the commanded start and stop")
    reach = _reach(scaled[inside])
    if reach < REST_SIGMA * sigma_mm:
        return Phases(reason=f"at rest: moves less than {max(reach, sigma_mm):.2g} mm")
    smooth = median_filter(scaled, size=(5, 1), mode="nearest")  # without single outliers
    rates = local_rates(time_s, smooth, sigma_mm, inside)
    speed = np.linalg.norm(rates.value, axis=1)
    usual = _usual(speed[inside], rates.sigma, float(np.median(np.diff(time_s))))
    moving = (speed > max(MOVING_SHARE * usual, REST_SIGMA * rates.sigma)) & inside
    if usual < 2 * REST_SIGMA * rates.sigma or not moving.any():
        moving = inside  # too slow to distinguish phases from noise: the whole interval is used
    first, last = _longest(moving, rates.half_width)
    onset = _left_rest(time_s, smooth, sigma_mm, first, rates.half_width)
    ending = _left_rest(-time_s[::-1], smooth[::-1], sigma_mm, len(time_s) - 1 - last, rates.half_width)
    steady_first, steady_last = _steady(rates, first, last)
    low, high = np.fmax(onset, time_s[steady_first]), np.fmin(-ending, time_s[steady_last])
    return Phases(onset, float(low), float(high), -ending, onset - begin if start_s is not None else NAN)


def _reach(scaled: Array) -> float:
    """Largest distance between medians of tenths of the run, which is robust against outliers and noise."""
    blocks = np.array([np.median(part, axis=0) for part in np.array_split(scaled, min(10, len(scaled) // 2))])
    return float(np.linalg.norm(blocks[:, None] - blocks[None], axis=2).max())


def local_rates(
    time_s: Array,
    scaled: Array,
    sigma_mm: float,
    inside: Flags,
    share: float = SLOPE_SHARE,
    longest: int | None = None,
) -> Rates:
    """Slopes over windows just long enough for their relative precision `share`.

    longest: largest number of frames of a window on either side; by default a tenth of the run.
    """
    interval = float(np.median(np.diff(time_s)))
    longest = max(int(inside.sum()) // 10, 2) if longest is None else longest
    half = 2
    while True:
        width = 2 * half + 1
        value = _slopes(scaled, half) / _local_interval(time_s, half)
        # Variance of a slope over w equal steps: 12 sigma² / (w³ - w).
        sigma = sigma_mm * np.sqrt(12 / (width**3 - width)) / interval
        usual = _usual(np.linalg.norm(value[inside], axis=1), sigma, interval)
        if sigma <= share * usual or half >= longest:
            return Rates(value, sigma, half)
        half = min(max(int(half * min((sigma / (share * max(usual, sigma))) ** (2 / 3), 3)), half + 1), longest)


def _slopes(values: Array, half: int) -> Array:
    """Slope per frame of the line through the 2·half + 1 frames around every frame, along the first axis; (n, k)."""
    steps = np.arange(-half, half + 1.0)
    slopes = np.asarray(correlate1d(values, steps / (steps @ steps), axis=0))
    slopes[:half], slopes[len(slopes) - half :] = slopes[half], slopes[len(slopes) - half - 1]  # constant at the ends
    return slopes


def _local_interval(time_s: Array, half: int) -> Array:
    """Frame interval around every frame, (n, 1), so that slopes across gaps are slopes in time."""
    return _slopes(time_s[:, None], half)


def _usual(speed: Array, sigma: float, interval_s: float) -> float:
    """Typical speed while the robot moves, independent of the time that it rests, and of a push.

    sigma: of the speeds; interval_s: between two frames.
    """
    fast = speed >= np.percentile(speed, 95) / 2
    slower = ~fast & (speed > REST_SIGMA * sigma)
    pushed = np.count_nonzero(fast) * interval_s <= BRIEF_S and np.count_nonzero(slower) >= 3 * np.count_nonzero(fast)
    return float(np.median(speed[slower if pushed else fast]))


def _longest(flags: Flags, bridge: int) -> tuple[int, int]:
    """First and last index of the longest stretch of true flags, holes up to `bridge` frames filled."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    starts, stops = edges[::2], edges[1::2]
    apart = starts[1:] - stops[:-1] > bridge
    starts, stops = starts[np.r_[True, apart]], stops[np.r_[apart, True]]
    longest = int(np.argmax(stops - starts))
    return int(starts[longest]), int(stops[longest] - 1)


def _left_rest(time_s: Array, scaled: Array, sigma_mm: float, first: int, window: int) -> float:
    """Time at which the robot left its rest pose before frame `first`; NaN if it was not seen at rest.

    window: number of frames by which `first` may be early or late.
    """
    before = scaled[max(first - window - 60, 0) : max(first - window, min(first, 4))]
    if len(before) < 4:
        return NAN
    halves = [np.median(part, axis=0) for part in np.array_split(before, 2)]
    if np.linalg.norm(halves[1] - halves[0]) > REST_SIGMA * sigma_mm:
        return NAN
    rest = np.median(before, axis=0)
    near = np.linalg.norm(scaled[: first + window + 1] - rest, axis=1) < REST_SIGMA * sigma_mm
    return float(time_s[np.flatnonzero(near)[-1]]) if near.any() else NAN


def _steady(rates: Rates, first: int, last: int) -> tuple[int, int]:
    """First and last frame with speed and yaw rate near their usual values; disturbances in between are allowed."""
    speed, yaw = np.linalg.norm(rates.value[:, :2], axis=1), rates.value[:, 2]
    middle = slice(first + (last - first) // 4, last - (last - first) // 4 + 1)
    level = np.array([np.median(speed[middle]), np.median(yaw[middle])])
    spread = PER_MEDIAN * np.array([np.median(np.abs(v[middle] - l)) for v, l in zip((speed, yaw), level, strict=True)])
    # Half of the usual scatter of a ripple, and noise, are parts of a steady turn.
    limit = np.maximum(STEADY_SHARE * np.linalg.norm(level), REST_SIGMA * np.maximum(spread, rates.sigma))
    near = (np.abs(speed - level[0]) <= limit[0]) & (np.abs(yaw - level[1]) <= limit[1])
    return _settled(near, first, last, rates.half_width), len(near) - 1 - _settled(
        near[::-1], len(near) - 1 - last, len(near) - 1 - first, rates.half_width
    )


def _settled(near: Flags, first: int, last: int, hold: int) -> int:
    """First frame from which the rates stay near the usual ones over their window; at most the middle."""
    middle = (first + last) // 2
    for frame in range(first, middle):
        if near[frame : frame + hold + 1].all():
            return frame
    return middle
