"""Offset of any size between the clocks of a command log and a recording, from commanded and measured velocities.

Measured speed and yaw rate are correlated with the commanded ones at every offset at which log and recording overlap.
The gains are free, so that slip does not matter. The offset contains the whole delay of the motion: of the clocks, dead
time and lag of the motors. It serves logs whose clock differs by more than the time between two changes of command,
and logs that change all the time, such as those of a joystick; elsewhere evaluator.turning.clock is more accurate.
Source: generalized cross-correlation, Knapp & Carter (1976), IEEE Trans. ASSP 24, 320.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import special

Array = NDArray[np.float64]
Sides = Callable[[Array], tuple[Array, Array]]

AVERAGED_S = 0.2  # of motion, for a velocity: several frames of a camera, one of a slow lidar
LEAST_STEP_S = 0.01  # of offsets: logs hold ten to a hundred commands a second
FEWEST_SAMPLES = 20  # velocities: fewer than three in each of BLOCKS give no interval
# An offset far from the stated one is believed where it leaves less than half of the residuals of velocity that the
# nearest ones leave: a log that repeats its commands fits nearly as well one repetition later.
HALF = float(np.log(2))
# Chance that a log and a motion that do not belong together are taken to: see _is_chance.
CHANCE = 1e-3
BLOCKS = 8  # of the recording, for the jackknife of the interval
# Squares of a log over their largest, below which it commands nothing: products by Fourier transforms are wrong by
# 1e-15 of the whole, which would explain all of a motion at the offsets at which the log rests.
SMALL = 1e-9
MIDPOINTS = 8  # in either half of what is averaged
AROUND_S = 1.0  # of the best offset, in which it is refined


@dataclass(frozen=True)
class LogOffset:
    """Offset that is added to the times of a log, s, with its 95 % interval."""

    value_s: float
    low_s: float
    high_s: float


def log_offset(
    time_s: Array, pose: Array, sides: Sides, span_s: tuple[float, float], near_s: float
) -> LogOffset | None:
    """The offset at which the motion follows a log best; None if nothing moves as commanded, or too little is recorded.

    time_s: (n,). pose: (n, 3) x, y in mm and heading in rad, unwrapped, without NaN. sides: commands of the left and
    the right side, rpm, at any times of the log. span_s: first and last time of the log. near_s: offsets up to this one
    are preferred, see HALF.
    """
    step = max(float(np.median(np.diff(time_s))), LEAST_STEP_S)
    half = max(AVERAGED_S, 2 * step) / 2
    times = np.arange(time_s[0] + half, time_s[-1] - half, step)
    first, last = span_s
    if len(times) < FEWEST_SAMPLES:
        return None
    measured = _measured(time_s, pose, times, half)
    low, high = round((times[0] - last) / step), round((times[-1] - first) / step)  # offsets, in steps
    wide = times[0] + step * np.arange(-high, len(times) - low)
    commanded = _commanded(sides, wide, half)
    shifts = step * np.arange(high, low - 1, -1)
    cost = _cost(measured, commanded)
    if _is_chance(cost, independent=len(times) * step / (2 * half), tried=len(shifts) * step / (2 * half)):
        return None
    near = (np.abs(shifts) <= near_s) & np.isfinite(cost)
    best = int(np.nanargmin(cost))
    if not near[best] and near.any() and np.nanmin(cost[near]) < cost[best] + HALF:
        best = int(np.nanargmin(np.where(near, cost, np.nan)))
    window = np.arange(max(best - round(AROUND_S / step), 0), min(best + round(AROUND_S / step) + 1, len(shifts)))
    sums = _sums(measured, commanded, window)
    value = _least(shifts[window], _of_sums(sums.sum(axis=0)))
    costs = [_of_sums(np.delete(sums, number, axis=0).sum(axis=0)) for number in range(BLOCKS)]
    if not all(np.isfinite(each).any() for each in costs):  # one eighth holds all that was commanded: no interval
        return None
    without = np.array([_least(shifts[window], each) for each in costs])
    spread = np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((without - without.mean()) ** 2))
    reach = float(special.stdtrit(BLOCKS - 1, 0.975)) * spread
    return LogOffset(value, float(value - reach), float(value + reach))


def averaging_times(time_s: Array) -> tuple[Array, float]:
    """Times (m,) at which a velocity is averaged over half a window before and after, and that half, s."""
    half = max(AVERAGED_S, 2 * float(np.median(np.diff(time_s)))) / 2
    return np.arange(time_s[0] + half, time_s[-1] - half, half), half


def correlations(time_s: Array, pose: Array, sides: Sides, delays_s: Array) -> tuple[Array, Array]:
    """Correlations (2, k) of speed and yaw rate, about zero, with what a log commands so much earlier; 0 if either is.

    time_s, pose, sides: as of log_offset. Returns also the gains (2, k): mm/s per rpm of both sides, rad/s per rpm of
    their difference.
    """
    times, half = averaging_times(time_s)
    measured = _measured(time_s, pose, times, half)
    commanded = np.stack([_commanded(sides, times - delay, half) for delay in delays_s], axis=-1)
    products = np.einsum("cm,cmk->ck", measured, commanded)
    squares = (commanded**2).sum(axis=1)
    sizes = np.sqrt((measured**2).sum(axis=1)[:, None] * squares)
    return np.asarray(products / np.maximum(sizes, 1e-300)), np.asarray(products / np.maximum(squares, 1e-300))


def _is_chance(cost: Array, independent: float, tried: float) -> bool:
    """Whether a motion that has nothing to do with the log would reach the least of the costs (k,), or none is finite.

    independent, tried: numbers of velocities and of offsets that do not share what is averaged. -independent * cost is
    the likelihood ratio of two gains, chi-squared with two degrees of freedom: exp(-x / 2) lies beyond x.
    """
    if not np.isfinite(cost).any():
        return True
    return bool(-independent * np.nanmin(cost) < 2 * np.log(max(tried, 1.0) / CHANCE))


def _measured(time_s: Array, pose: Array, times: Array, half: float) -> Array:
    """Mean speed, mm/s, and yaw rate, rad/s, (2, m) within half of each time."""
    after, before = ([np.interp(times + way * half, time_s, part) for part in pose.T] for way in (1, -1))
    heading = (after[2] + before[2]) / 2
    along = (after[0] - before[0]) * np.cos(heading) + (after[1] - before[1]) * np.sin(heading)
    return np.stack([along, after[2] - before[2]]) / (2 * half)


def _commanded(sides: Sides, times: Array, half: float) -> Array:
    """Mean of common part and difference of the commands, rpm, (2, m) within half of each time."""
    fine = half * (np.arange(-MIDPOINTS, MIDPOINTS) + 0.5) / MIDPOINTS
    left, right = (side.mean(axis=1) for side in sides(times[:, None] + fine))
    return np.stack([(left + right) / 2, right - left])


def _cost(measured: Array, commanded: Array) -> Array:
    """Logarithm of the share of the velocity that the commands do not explain, summed over both, at each shift (k,)."""
    from scipy.signal import correlate

    size = measured.shape[1]
    products = [correlate(b, a, mode="valid") for a, b in zip(measured, commanded, strict=True)]
    totals = np.pad(np.cumsum(commanded**2, axis=1), ((0, 0), (1, 0)))
    squares = totals[:, size:] - totals[:, :-size]
    own = [np.full(len(products[0]), a @ a) for a in measured]
    return _of_sums(np.stack([products, squares, own]))


def _sums(measured: Array, commanded: Array, window: NDArray[np.int64]) -> Array:
    """Products, squares of the log and of the motion (blocks, 3, 2, k) over each block at the shifts of a window."""
    size = measured.shape[1]
    at = np.stack([commanded[:, k : k + size] for k in window], axis=-1)  # (2, m, k)
    parts = np.stack([measured[..., None] * at, at**2, np.broadcast_to(measured[..., None] ** 2, at.shape)])
    edges = np.linspace(0, size, BLOCKS + 1).astype(int)
    return np.stack([parts[:, :, a:b].sum(axis=2) for a, b in pairwise(edges)])


def _of_sums(sums: Array) -> Array:
    """The cost (k,) from products and squares (3, 2, k); NaN at shifts at which the log commands rest alone."""
    products, squares, own = sums
    commands = squares > SMALL * squares.max(axis=-1, keepdims=True)
    explained = products**2 / np.maximum(squares * own, 1e-300)
    left = np.log(np.maximum(1 - np.where((products > 0) & commands, explained, 0.0), 1e-12))
    return np.where((squares > 0).any(axis=0), left.sum(axis=0), np.nan)


def _least(shifts: Array, cost: Array) -> float:
    """Where a cost is least, by the parabola through its least value and the two beside it."""
    at = int(np.clip(np.nanargmin(cost), 1, len(cost) - 2))
    before, here, after = cost[at - 1 : at + 2]
    bend = before - 2 * here + after
    return float(shifts[at] + (shifts[at + 1] - shifts[at]) * (0.5 * (before - after) / bend if bend > 0 else 0.0))
