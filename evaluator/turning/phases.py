"""Phases of a run: rest, start, transient, steady turn, stop; found from the motion itself.

A robot at rest scatters about one pose with the noise of the tracker; a moving one leaves it for good. Command times
are used where they are given, to bound the search and to measure the delay of the start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A turn whose speed and yaw rate stay within this share of their final values counts as steady; a smaller departure
# changes the radius by less than the share itself, and the fit's residuals report it.
STEADY_SHARE = 0.05
# A robot moves when it is faster than this share of its usual speed; half would be the midpoint of a linear ramp.
MOVING_SHARE = 0.2
# Scatter of a displacement at rest stays below this many of its standard deviations (1 frame in 30,000).
REST_SIGMA = 4.0


@dataclass(frozen=True)
class Phases:
    """Times of the phases, s, in the time of the recording; NaN where a phase was not seen.

    The robot moves from start_s to stop_s and turns steadily from steady_start_s to steady_stop_s; before start_s and
    after stop_s it rests. delay_s: start_s minus the commanded start. reason: why there is no motion, else "".
    """

    start_s: float
    steady_start_s: float
    steady_stop_s: float
    stop_s: float
    delay_s: float = float("nan")
    reason: str = ""

    def names(self, time_s: Array) -> NDArray[np.str_]:
        """Phase of every frame: rest, transient, steady or stop."""
        if self.reason:
            return np.full(len(time_s), "rest")
        after = self.stop_s if np.isfinite(self.stop_s) else np.inf
        before = self.start_s if np.isfinite(self.start_s) else -np.inf
        moving = (time_s >= before) & (time_s <= after)
        steady = (time_s >= self.steady_start_s) & (time_s <= self.steady_stop_s)
        late = moving & (time_s > self.steady_stop_s)
        return np.select([steady, late, moving], ["steady", "stop", "transient"], default="rest")


def find_phases(
    time_s: Array, scaled: Array, sigma_mm: float, start_s: float | None = None, stop_s: float | None = None
) -> Phases:
    """Find the phases of a run.

    time_s: (n,). scaled: (n, 3) of x, y, length · heading, mm, without NaN, each of noise sigma_mm. start_s, stop_s:
    times of the commands, where known. Frames outside them are rest and stop.
    """
    missing = float("nan")
    rate_time, rate, rate_sigma = _local_rates(time_s, scaled, sigma_mm)
    speed = np.linalg.norm(rate, axis=1)
    inside = (rate_time >= (-np.inf if start_s is None else start_s)) & (
        rate_time <= (np.inf if stop_s is None else stop_s)
    )
    if inside.sum() < 3:
        return Phases(missing, missing, missing, missing, reason="no frames between the commanded start and stop")
    usual = _usual(speed[inside])
    reach = float(np.linalg.norm(scaled - np.median(scaled, axis=0), axis=1).max())
    if reach < 2 * REST_SIGMA * sigma_mm or usual == 0:
        return Phases(missing, missing, missing, missing, reason=f"at rest: moves less than {reach:.4f} mm")
    first, last = _longest(inside & (speed > MOVING_SHARE * usual))
    begin = _onset(time_s, scaled, sigma_mm, rate_time[first], usual)
    ending = _onset(-time_s[::-1], scaled[::-1], sigma_mm, -rate_time[last], usual)
    stop = -ending if np.isfinite(ending) else missing
    steady_first, steady_last = _steady(rate[first : last + 1], rate_sigma)
    steady_start, steady_stop = rate_time[first + steady_first], rate_time[first + steady_last]
    if not np.isfinite(begin) and steady_first == 0:
        steady_start = max(time_s[0], -np.inf if start_s is None else start_s)
    if not np.isfinite(stop) and steady_last == last - first:
        steady_stop = min(time_s[-1], np.inf if stop_s is None else stop_s)
    delay = begin - start_s if start_s is not None else missing
    return Phases(float(begin), float(steady_start), float(steady_stop), float(stop), float(delay))


def _local_rates(time_s: Array, scaled: Array, sigma_mm: float) -> tuple[Array, Array, float]:
    """Velocity (m, 3) over lags just long enough to stand out of the noise, at most a tenth of the run; its sigma."""
    n = len(time_s)
    path = np.linalg.norm(np.diff(scaled[:: max(n // 100, 1)], axis=0), axis=1)
    per_frame = np.median(path) / max(n // 100, 1)
    needed = int(np.ceil(20 * sigma_mm / max(per_frame, 1e-12)))
    lag = int(np.clip(needed, 2, max(n // 10, 2)))
    step = (time_s[lag:] - time_s[:-lag])[:, None]
    rate = (scaled[lag:] - scaled[:-lag]) / step
    return (time_s[lag:] + time_s[:-lag]) / 2, rate, float(np.sqrt(2) * sigma_mm / np.median(step))


def _usual(speed: Array) -> float:
    top = np.percentile(speed, 95)
    return float(np.median(speed[speed >= top / 2]))


def _longest(flags: NDArray[np.bool_]) -> tuple[int, int]:
    """First and last index of the longest stretch of true flags."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    starts, stops = edges[::2], edges[1::2]
    longest = int(np.argmax(stops - starts))
    return int(starts[longest]), int(stops[longest] - 1)


def _onset(time_s: Array, scaled: Array, sigma_mm: float, coarse_s: float, speed: float) -> float:
    """When the robot left its rest pose, from the rest before coarse_s; NaN where no rest was seen."""
    step = float(np.median(np.diff(time_s)))
    resting = time_s < coarse_s - 2 * REST_SIGMA * sigma_mm / speed - step
    if resting.sum() < 3:
        return float("nan")
    rest = np.median(scaled[resting][-min(int(resting.sum()), 60) :], axis=0)
    distance = np.linalg.norm(scaled - rest, axis=1)
    within = np.flatnonzero((distance < REST_SIGMA * sigma_mm) & (time_s < coarse_s + 1.0))
    return float(time_s[within[-1]]) if len(within) else float("nan")


def _steady(rate: Array, sigma: float) -> tuple[int, int]:
    """Indices between which path speed and yaw rate stay near their usual values."""
    speed, yaw = np.linalg.norm(rate[:, :2], axis=1), rate[:, 2]
    middle = slice(len(speed) // 4, max(3 * len(speed) // 4, len(speed) // 4 + 1))
    level = np.array([np.median(speed[middle]), np.median(yaw[middle])])
    scatter = 1.4826 * np.array([np.median(np.abs(v[middle] - l)) for v, l in zip((speed, yaw), level, strict=True)])
    limit = np.maximum(STEADY_SHARE * np.linalg.norm(level), REST_SIGMA * np.maximum(scatter, sigma) + sigma)
    away = (np.abs(speed - level[0]) > limit[0]) | (np.abs(yaw - level[1]) > limit[1])
    half = len(away) // 2
    early, late = np.flatnonzero(away[:half]), np.flatnonzero(away[half:])
    first = int(early[-1] + 1) if len(early) and early[-1] + 1 < half else 0
    last = int(half + late[0] - 1) if len(late) and late[0] > 0 else len(away) - 1
    return first, last
