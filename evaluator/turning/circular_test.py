"""The steady-state circular test: how radius, yaw rate and sideslip change with speed (ISO 4138, SAE J266).

A skid-steered robot has no steering wheel. Its steering input is the curvature at which wheels without slip would turn
with the commanded rotations, κc = 2·(n_R − n_L)/(B·(n_R + n_L)), B: track. In a steady turn κc = A·κ + K·a_y, with the
curvature κ of the path of the robot's centre and its lateral acceleration a_y = speed · yaw rate. A is the ratio of
commanded and actual curvature at low speed (1: rolling without slip); K is the understeer gradient. At constant command
κ is regressed on a_y, at constant radius κc; K·L is stated in degrees per m/s² as for a car of the robot's wheelbase L.
K > 0: the radius grows with speed (understeer).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from evaluator.errors import InputError

Array = NDArray[np.float64]
NAN = float("nan")
COLUMNS = ("run", "left_rpm", "right_rpm", "speed_mm_s", "yaw_rate_deg_s", "body_slip_angle_deg")
FEWEST_SPEEDS = 3  # for a gradient with an estimate of its scatter
SAME_COMMAND = 1e-3  # ratios of rotations closer than this are one command: rpm are stated to about a tenth
SAME_RADIUS = 0.15  # relative variation of the radius in a constant-radius test, whose commands are chosen in advance
MM_PER_M = 1000.0


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval; NaN if unknown."""

    value: float = NAN
    low: float = NAN
    high: float = NAN


@dataclass(frozen=True)
class Series:
    """Runs of one method, driving direction and side, over speed.

    held: the constant quantity, ratio of slower to faster wheel or radius in mm; steering: A; understeer: K·L in
    deg/(m/s²); sideslip: gradient of the sideslip angle at the centre, positive out of the turn, in the same unit;
    curvature_per_mm: of the path at vanishing lateral acceleration.
    """

    method: str  # "constant command" or "constant radius"
    direction: str  # "forward" or "backward"
    side: str  # "left" or "right": where the centre of the turn is
    held: float
    runs: tuple[str, ...]
    steering: Estimate = Estimate()
    understeer: Estimate = Estimate()
    sideslip: Estimate = Estimate()
    curvature_per_mm: float = NAN


@dataclass(frozen=True)
class CircularTest:
    """points: a row for each turn, with the number of its series; series: in the order of their first runs."""

    points: pd.DataFrame
    series: tuple[Series, ...]


def circular_test(
    turns: pd.DataFrame, wheelbase_mm: float, track_mm: float, like: CircularTest | None = None
) -> CircularTest:
    """Evaluate turns, one row each with COLUMNS of turning.csv; yaw_rate_random_deg_s and speed_random_mm_s are used.

    like: a test whose series are to be evaluated for the same runs; without it, runs are grouped into series. Straight
    runs, turns on the spot and rows without a speed are left out. Raises InputError if columns are missing or no turn
    is left.
    """
    missing = [name for name in COLUMNS if name not in turns]
    if missing:
        raise InputError(f"the table of turns lacks {', '.join(missing)}; give one like turning.csv")
    points = _points(turns, track_mm)
    if points.empty:
        raise InputError("there is no turn among the runs; a circular test needs turns at three speeds or more")
    series: list[Series] = []
    of_series = np.full(len(points), -1)
    for method, rows in _series(points) if like is None else _same_series(points, like):
        of_series[rows] = len(series)
        series.append(_evaluated(method, points.iloc[rows], wheelbase_mm))
    points["series"] = of_series
    return CircularTest(points, tuple(series))


def commanded_curvature_per_mm(left_rpm: Array, right_rpm: Array, track_mm: float) -> Array:
    """Signed curvature (n,) of equal wheels rolling without slip, positive to the left of a forward path."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(2 * (right_rpm - left_rpm) / (track_mm * (right_rpm + left_rpm)))


def _points(turns: pd.DataFrame, track_mm: float) -> pd.DataFrame:
    """Data of plots and regressions: absolute values, and the direction and side of every turn."""
    left, right = turns["left_rpm"].to_numpy(float), turns["right_rpm"].to_numpy(float)
    speed, yaw = np.abs(turns["speed_mm_s"].to_numpy(float)), np.radians(turns["yaw_rate_deg_s"].to_numpy(float))
    commanded = commanded_curvature_per_mm(left, right, track_mm)
    slower, faster = np.minimum(abs(left), abs(right)), np.maximum(abs(left), abs(right))
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature, ratio = np.abs(yaw) / speed, np.sign(left * right) * slower / faster
        noise = np.hypot(
            np.radians(_sigma(turns, "yaw_rate_random_deg_s")) / np.abs(yaw), _sigma(turns, "speed_random_mm_s") / speed
        )
    # sideslip out of the turn is positive for both sides and directions
    outward = -np.sign(commanded) * turns["body_slip_angle_deg"].to_numpy(float)
    table = pd.DataFrame(
        {
            "run": turns["run"].astype(str).to_numpy(),
            "left_rpm": left,
            "right_rpm": right,
            "direction": np.where(left + right > 0, "forward", "backward"),
            "side": np.where(commanded > 0, "left", "right"),
            "ratio": ratio,
            "commanded_curvature_per_mm": np.abs(commanded),
            "speed_mm_s": speed,
            "yaw_rate_deg_s": np.degrees(np.abs(yaw)),
            "radius_mm": 1 / np.where(curvature > 0, curvature, NAN),
            "curvature_per_mm": curvature,
            "curvature_sigma_per_mm": curvature * noise,
            "sideslip_deg": outward,
            "lateral_acceleration_mm_s2": speed * np.abs(yaw),
        }
    )
    turning = np.isfinite(commanded) & (commanded != 0) & np.isfinite(curvature) & (curvature > 0) & (speed > 0)
    kept: pd.DataFrame = table[turning].reset_index(drop=True)
    return kept


def _sigma(turns: pd.DataFrame, name: str) -> Array:
    return np.nan_to_num(turns[name].to_numpy(float)) if name in turns else np.zeros(len(turns))


def _series(points: pd.DataFrame) -> Iterator[tuple[str, list[int]]]:
    """Rows of every series: runs with one command over speed; of the remaining ones, runs with one radius."""
    for _, alike in points.groupby(["direction", "side"], sort=False):
        left = list(alike.index)
        for ratio in sorted(alike["ratio"].unique(), reverse=True):
            rows = [row for row in left if abs(points["ratio"][row] - ratio) <= SAME_COMMAND]
            if _speeds(points.loc[rows]) >= FEWEST_SPEEDS:
                yield "constant command", rows
                left = [row for row in left if row not in rows]
        while left:
            radius = points["radius_mm"][left]
            rows = [row for row in left if abs(radius[row] / radius.median() - 1) <= SAME_RADIUS] or left[:1]
            if _speeds(points.loc[rows]) >= FEWEST_SPEEDS:
                yield "constant radius", rows
            left = [row for row in left if row not in rows]


def _same_series(points: pd.DataFrame, like: CircularTest) -> Iterator[tuple[str, list[int]]]:
    """Rows of every series of another test."""
    for series in like.series:
        yield series.method, list(points.index[points["run"].isin(series.runs)])


def _speeds(rows: pd.DataFrame) -> int:
    """Number of distinct speeds of the faster wheel."""
    return len(set(rows[["left_rpm", "right_rpm"]].abs().max(axis=1).round(6)))


def _evaluated(method: str, rows: pd.DataFrame, wheelbase_mm: float) -> Series:
    """Gradients of one series."""
    acceleration, curvature = rows["lateral_acceleration_mm_s2"].to_numpy(), rows["curvature_per_mm"].to_numpy()
    commanded, sigma = rows["commanded_curvature_per_mm"].to_numpy(), rows["curvature_sigma_per_mm"].to_numpy()
    to_degrees = np.degrees(wheelbase_mm) * MM_PER_M
    if method == "constant command":
        line = _line(acceleration, curvature, float(np.sqrt((sigma**2).mean())))
        command = float(commanded.mean())
        steering = _transformed(line, lambda at, _: command / at)
        understeer = _transformed(line, lambda at, slope: -slope * command / at * to_degrees)
        held, slow = float(rows["ratio"].mean()), line.at_zero
    else:
        mean = float(curvature.mean())
        scale = float((commanded / curvature).mean())
        line = _line(acceleration, commanded * mean / curvature, scale * float(np.sqrt((sigma**2).mean())))
        steering = _transformed(line, lambda at, _: at / mean)
        understeer = _transformed(line, lambda _, slope: slope * to_degrees)
        held, slow = 1 / mean, mean
    sideslip = _line(acceleration, rows["sideslip_deg"].to_numpy(), 0.0)
    first = rows.iloc[0]
    return Series(
        *(method, str(first["direction"]), str(first["side"]), held, tuple(rows["run"])),
        *(steering, understeer, _transformed(sideslip, lambda _, slope: slope * MM_PER_M), slow),
    )


@dataclass(frozen=True)
class _Line:
    """A line fitted to points: its value at 0 and its slope, their covariance, and Student's factor of the interval."""

    at_zero: float
    slope: float
    covariance: Array
    factor: float


def _line(x: Array, y: Array, sigma: float) -> _Line:
    """Least squares; the scatter of the runs about the line is used, but at least sigma, the uncertainty of one run."""
    middle, free = float(x.mean()), len(x) - 2
    off = x - middle
    slope = float(off @ y / (off @ off))
    residual = y - y.mean() - slope * off
    variance = max(float(residual @ residual) / free, sigma**2)
    of_slope = variance / float(off @ off)
    at_zero = float(y.mean()) - slope * middle
    covariance = np.array(
        [[variance / len(x) + middle**2 * of_slope, -middle * of_slope], [-middle * of_slope, of_slope]]
    )
    return _Line(at_zero, slope, covariance, float(special.stdtrit(free, 0.975)))


def _transformed(line: _Line, of: Callable[[float, float], float]) -> Estimate:
    """A function of a line's value at 0 and slope, with its interval by linear propagation."""
    steps = np.sqrt(np.diag(line.covariance)) / 2
    gradient = [
        (of(line.at_zero + a, line.slope + b) - of(line.at_zero - a, line.slope - b)) / (2 * max(a, b))
        if a or b
        else 0.0
        for a, b in ((steps[0], 0.0), (0.0, steps[1]))
    ]
    value = of(line.at_zero, line.slope)
    half = line.factor * float(np.sqrt(gradient @ line.covariance @ np.array(gradient)))
    return Estimate(value, value - half, value + half)
