"""Where measurement and model disagree: by direction, side, speed, heading, place, time and order, with significance.

Every run is cut into pieces of about a second; in each the measured minus the predicted velocity is taken along and
across the robot and in yaw. Each of the three is regressed on what it may depend on. Standard errors count runs, not
pieces (sandwich over runs: Liang & Zeger (1986), Biometrika 73, 13).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from evaluator.discrepancy.problem import Point, Problem

Floats = NDArray[np.float64]

PIECE_S = 1.0
SHOWN_SIGMAS = 4.0  # thirty tests: chance reaches this once in five hundred experiments

QUANTITIES = {"along_mm_s": "speed along the robot", "across_mm_s": "sideways speed", "yaw_deg_s": "yaw rate"}
UNITS = {"along_mm_s": "mm/s", "across_mm_s": "mm/s", "yaw_deg_s": "deg/s"}


@dataclass(frozen=True)
class Dependence:
    """A disagreement and what it depends on: effect sizes with their significance and a plain sentence."""

    quantity: str
    by: str
    parity: str  # "even" or "odd" under the reversal of what it depends on; "" where that means nothing
    sigmas: float
    sentence: str


def pieces(problem: Problem, point: Point) -> pd.DataFrame:
    """A row per piece of a run: disagreement along, across (mm/s) and in yaw (deg/s), and what it may depend on."""
    rows = []
    for number, run in enumerate(problem.data):
        residual = problem.residuals([point.task(number)])[0]
        channels = problem.channels[number]
        end = run.time_s[-1] if run.stop_s is None else min(run.stop_s, run.time_s[-1])
        begin = max(run.start_s, run.time_s[0])
        count = max(int((end - begin) / PIECE_S), 1)
        for low, high in pairwise(np.linspace(begin, end, count + 1)):
            inside = (run.time_s >= low) & (run.time_s <= high) & np.isfinite(residual).all(axis=1)
            if inside.sum() < 5:
                continue
            time = run.time_s[inside] - run.time_s[inside].mean()
            slope = time @ residual[inside][:, :3] / (time @ time)
            heading = float(channels[inside][inside.sum() // 2, 2]) - np.pi / 2
            cos, sin = np.cos(heading), np.sin(heading)
            speed = (run.left_rpm + run.right_rpm) / 2
            rows.append(
                {
                    "run": run.id,
                    "time_s": (low + high) / 2 - begin,
                    "along_mm_s": cos * slope[0] + sin * slope[1],
                    "across_mm_s": -sin * slope[0] + cos * slope[1],
                    "yaw_deg_s": np.degrees(slope[2] / problem.half_distance_mm),
                    "direction": float(np.sign(speed)),
                    "side": float(np.sign(run.right_rpm - run.left_rpm)),
                    "speed_rpm": abs(speed),
                    "difference_rpm": abs(run.right_rpm - run.left_rpm),
                    "heading_deg": np.degrees(heading) % 360,
                    "x_mm": float(np.mean(channels[inside][:, 0])),
                    "y_mm": float(np.mean(channels[inside][:, 1])),
                    "order": run.order,
                }
            )
    return pd.DataFrame(rows)


def dependences(table: pd.DataFrame) -> list[Dependence]:
    """Everything that stands out, the most significant first."""
    found = []
    for quantity in QUANTITIES:
        values = table[quantity].to_numpy()
        runs = table["run"].to_numpy()
        for by, columns in _designs(table).items():
            if np.linalg.matrix_rank(columns) < columns.shape[1]:
                continue
            tested = columns.shape[1] - 1 if by != "everywhere" else 1
            size, sigmas = _clustered(values, columns, runs, tested)
            if sigmas >= SHOWN_SIGMAS:
                found.append(Dependence(quantity, by, _parity(by), sigmas, _sentence(quantity, by, size, sigmas)))
    return sorted(found, key=lambda item: -item.sigmas)


def _designs(table: pd.DataFrame) -> dict[str, Floats]:
    """Regressors by what is asked; those tested come last."""
    one = np.ones(len(table))
    angle = np.radians(table["heading_deg"].to_numpy())
    column = {name: table[name].to_numpy(dtype=float) for name in table if name != "run"}
    direction, side = column["direction"], column["side"]
    return {
        "everywhere": one[:, None],
        "forward and backward": np.column_stack([one, direction]),
        "left and right": np.column_stack([one, side]),
        "direction times side": np.column_stack([one, direction, side, direction * side]),
        "speed": np.column_stack([one, direction, direction * column["speed_rpm"]]),
        "difference of the wheels": np.column_stack([one, side, side * column["difference_rpm"]]),
        "heading": np.column_stack([one, np.cos(angle), np.sin(angle)]),
        "twice the heading": np.column_stack([one, np.cos(2 * angle), np.sin(2 * angle)]),
        "place": np.column_stack([one, column["x_mm"], column["y_mm"]]),
        "time since the command": np.column_stack([one, column["time_s"]]),
        "order of the runs": np.column_stack([one, direction, direction * column["order"]]),
    }


def _clustered(values: Floats, columns: Floats, runs: NDArray[np.object_], tested: int) -> tuple[Floats, float]:
    """Least squares, errors over runs: the tested last coefficients and their joint significance in sigmas."""
    inverse = np.linalg.pinv(columns.T @ columns)
    size = inverse @ columns.T @ values
    left = values - columns @ size
    names = np.unique(runs)
    scores = np.array([columns[runs == name].T @ left[runs == name] for name in names])
    freedom = len(names) - columns.shape[1]
    if freedom < 2:
        return size[-tested:], 0.0
    covariance = inverse @ (scores.T @ scores) @ inverse * len(names) / freedom
    part = covariance[-tested:, -tested:]
    ratio = float(size[-tested:] @ np.linalg.pinv(part) @ size[-tested:]) / tested
    probability = float(stats.f.sf(ratio, tested, freedom))
    return size[-tested:], float(stats.norm.isf(max(probability, 1e-300) / 2))


def _parity(by: str) -> str:
    return {"everywhere": "even", "forward and backward": "odd", "left and right": "odd", "speed": "odd"}.get(by, "")


def _sentence(quantity: str, by: str, size: Sequence[float] | Floats, sigmas: float) -> str:
    what, unit = QUANTITIES[quantity], UNITS[quantity]
    tail = f" ({sigmas:.0f} sigmas)"
    value = float(size[-1])
    if by == "everywhere":
        return f"measured {what} is off by {value:+.3g} {unit} in all runs together{tail}"
    if by == "forward and backward":
        return f"measured {what} differs by {value:+.3g} {unit} forward and {-value:+.3g} {unit} backward{tail}"
    if by == "left and right":
        return f"measured {what} differs by {value:+.3g} {unit} in left and {-value:+.3g} {unit} in right turns{tail}"
    if by in ("heading", "twice the heading"):
        fold = 1 if by == "heading" else 2
        peak = float(np.degrees(np.arctan2(size[1], size[0])) / fold % (360 / fold))
        amount = float(np.hypot(size[0], size[1]))
        return f"measured {what} varies with {by}: {amount:.3g} {unit} more at heading {peak:.0f} degrees{tail}"
    if by == "place":
        return f"measured {what} changes across the plate: {size[0]:+.2g} {unit} per mm in x, {size[1]:+.2g} in y{tail}"
    per = {
        "speed": "per rpm, with the sign of the motion",
        "difference of the wheels": "per rpm of difference, with the side of the turn",
        "time since the command": "per second of a run",
        "order of the runs": "per run of the session, with the sign of the motion",
        "direction times side": "for forward left and backward right turns, the opposite for the others",
    }[by]
    return f"measured {what} changes with {by}: {value:+.3g} {unit} {per}{tail}"
