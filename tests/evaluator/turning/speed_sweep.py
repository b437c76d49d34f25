"""Radius against speed in one run whose speed changes slowly, and the speed at which kinematic turning stops holding.

The run is cut into windows of equal turn; each has a radius and a speed of its own (ISO 4138, constant steering-wheel
angle with slowly increasing speed).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from evaluator.errors import InputError
from evaluator.pose import Poses
from evaluator.turning.motion.fit import FEWEST_FRAMES, fit_turns, scaled_poses

Array = NDArray[np.float64]
BOOTSTRAPS = 400


@dataclass(frozen=True)
class KinematicLimit:
    """Speed at which the radius first exceeds the kinematic one by a given share, with its 95 % interval, mm/s.

    reason says why speed_mm_s is NaN: the radius exceeds it at every speed, or at none.
    """

    speed_mm_s: float
    low_mm_s: float
    high_mm_s: float
    reason: str = ""


def radius_against_speed(poses: Poses, window_deg: float = 180.0, slowest_deg_s: float = 5.0) -> pd.DataFrame:
    """Fit a steady motion to every window of window_deg of heading.

    Returns a row per window: time_s, speed_mm_s (of the centre along its path), yaw_rate_deg_s, radius_mm,
    radius_low_mm, radius_high_mm (95 %), radius_sigma_mm. Stretches that turn slower than slowest_deg_s are left out.
    """
    there = poses.measured
    time = poses.time_s[there]
    pose = np.column_stack([poses.x_mm, poses.y_mm, poses.heading_rad])[there]
    scaled = scaled_poses(pose, poses.covariance[there])
    windows = _windows(time, pose[:, 2], np.radians(window_deg), np.radians(slowest_deg_s))
    if not windows:
        raise InputError(f"no stretch of {window_deg:g} degrees turns faster than {slowest_deg_s:g} degrees a second")
    rows = []
    for window, fit in zip(windows, fit_turns(time, scaled, windows), strict=True):
        curvature, twist = fit.curvature(), fit.body_twist(np.zeros(2))
        duration, along = np.ptp(time[window][fit.used]), np.ptp(fit.motion.along_mm[fit.used])
        radius = curvature.radius_mm()
        rows.append(
            {
                "time_s": float(time[window].mean()),
                "speed_mm_s": float(np.hypot(twist[0], twist[1]) * along / duration),
                "yaw_rate_deg_s": float(np.degrees(twist[2] * along / duration)),
                "radius_mm": radius[0],
                "radius_low_mm": radius[1],
                "radius_high_mm": radius[2],
                "radius_sigma_mm": radius[0] ** 2 * curvature.sigma,
            }
        )
    return pd.DataFrame(rows)


def kinematic_limit(
    speed_mm_s: Array, radius_mm: Array, kinematic_radius_mm: float, rng: np.random.Generator, share: float = 0.05
) -> KinematicLimit:
    """Speed at which a radius that does not fall with speed first exceeds the kinematic radius by `share`.

    The radius is fitted by the rising function nearest to the data (isotonic regression); the interval is that of
    resampled windows (bootstrap), so run-to-run scatter is in it. share: what counts as holding.
    """
    good = np.isfinite(speed_mm_s) & np.isfinite(radius_mm)
    speed, radius = np.asarray(speed_mm_s)[good], np.asarray(radius_mm)[good]
    limit = kinematic_radius_mm * (1 + share)
    found = _crossing(speed, radius, limit)
    draws = [rng.integers(0, len(speed), len(speed)) for _ in range(BOOTSTRAPS)]
    crossings = np.array([_crossing(speed[draw], radius[draw], limit) for draw in draws])
    nan = float("nan")
    if found == -np.inf:
        return KinematicLimit(nan, nan, nan, f"the radius exceeds {limit:.4g} mm from {speed.min():.4g} mm/s up")
    if found == np.inf:
        return KinematicLimit(nan, nan, nan, f"the radius stays below {limit:.4g} mm up to {speed.max():.4g} mm/s")
    low, high = np.quantile(np.clip(crossings, speed.min(), speed.max()), [0.025, 0.975])
    return KinematicLimit(found, float(low), float(high))


def _windows(time: Array, heading: Array, width: float, slowest: float) -> list[NDArray[np.bool_]]:
    turned = np.abs(np.concatenate([[0.0], np.cumsum(np.diff(heading))]))
    number = np.floor(turned / width).astype(int)
    windows = []
    for index in range(int(number.max())):
        window = number == index
        if window.sum() < 2 * FEWEST_FRAMES:
            continue
        first, last = time[window][[0, -1]]
        halfway = np.interp((first + last) / 2, time[window], turned[window]) / width - index
        # A window that holds a rest turns much less in one half of its time than in the other.
        if width / (last - first) >= slowest and 0.25 < halfway < 0.75:
            windows.append(window)
    return windows


def _crossing(speed: Array, radius: Array, limit: float) -> float:
    """Where the rising fit passes the limit; minus or plus infinity where it is above or below throughout."""
    order = np.argsort(speed, kind="stable")
    speed, level = speed[order], isotonic_regression(radius[order]).x
    above = np.flatnonzero(level > limit)
    if len(above) == 0:
        return float("inf")
    if above[0] == 0:
        return float("-inf")
    before, after = above[0] - 1, above[0]
    part = (limit - level[before]) / (level[after] - level[before])
    return float(speed[before] + part * (speed[after] - speed[before]))
