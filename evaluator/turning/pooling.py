"""Repetitions pooled: run-to-run scatter apart from measurement uncertainty.

Random-effects model: every run has a value of its own around the mean of all, measured with an uncertainty of its own.
The scatter between runs is that of Paule and Mandel (1982, doi:10.6028/jres.087.022); the interval of the mean that of
Hartung and Knapp (2001, doi:10.1002/sim.791), which holds for few runs. ISO 4138 asks for turns to both sides and at
least three of each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

Array = NDArray[np.float64]
NAN = float("nan")
ISO_4138_REPETITIONS = 3
Z_975 = 1.96


@dataclass(frozen=True)
class Pooled:
    """Mean of repetitions with its 95 % interval.

    between: standard deviation from run to run, measurement uncertainty taken off; within: typical standard uncertainty
    of a single measurement (root mean square). p_same: how likely such differences are if all runs are the same.
    """

    mean: float
    low: float
    high: float
    between: float
    within: float
    p_same: float
    runs: int


def pooled(values: Array, sigmas: Array) -> Pooled:
    """Pool values with their standard uncertainties; values that are not finite are left out, none left gives NaN."""
    values, sigmas = np.asarray(values, float), np.asarray(sigmas, float)
    good = np.isfinite(values) & np.isfinite(sigmas) & (sigmas > 0)
    values, sigmas = values[good], sigmas[good]
    n = len(values)
    if n == 0:
        return Pooled(NAN, NAN, NAN, NAN, NAN, NAN, 0)
    within = float(np.sqrt(np.mean(sigmas**2)))
    if n == 1:
        reach = Z_975 * sigmas[0]
        return Pooled(float(values[0]), float(values[0] - reach), float(values[0] + reach), NAN, within, NAN, 1)
    between = paule_mandel(values, sigmas)
    weight = 1 / (sigmas**2 + between**2)
    mean = float(weight @ values / weight.sum())
    # The factor is kept at one or more: runs that agree by chance are no reason for a narrower interval.
    factor = max(cochran(values, sigmas, between) / (n - 1), 1.0)
    reach = float(special.stdtrit(n - 1, 0.975) * np.sqrt(factor / weight.sum()))
    same = float(special.chdtrc(n - 1, cochran(values, sigmas, 0.0)))
    return Pooled(mean, mean - reach, mean + reach, between, within, same, n)


def pool_runs(turning: pd.DataFrame, group: str | None = None) -> pd.DataFrame:
    """Pool the rows of turning.csv that share their commanded rpm (and a group column, if named).

    Returns a row per command: the command, side ("left", "right" or "" for straight), runs, radius_mm with its 95 %
    bounds, radius_between_mm, radius_within_mm, p_same, and note: what ISO 4138 still asks for.
    """
    keys = ([group] if group else []) + ["left_rpm", "right_rpm"]
    sides = {tuple(key): _side(rows) for key, rows in turning.groupby(keys)}
    result = []
    for key, rows in turning.groupby(keys):
        pool = pooled(rows["radius_mm"].to_numpy(float), rows["radius_random_mm"].to_numpy(float))
        mirrored = (*tuple(key)[:-2], tuple(key)[-1], tuple(key)[-2])
        result.append(
            dict(zip(keys, tuple(key), strict=True))
            | {
                "side": sides[tuple(key)],
                "runs": pool.runs,
                "radius_mm": pool.mean,
                "radius_low_mm": pool.low,
                "radius_high_mm": pool.high,
                "radius_between_mm": pool.between,
                "radius_within_mm": pool.within,
                "p_same": pool.p_same,
                "note": _missing(pool.runs, sides[tuple(key)], mirrored in sides),
            }
        )
    return pd.DataFrame(result)


def cochran(values: Array, sigmas: Array, between: float) -> float:
    """Weighted sum of squares about the weighted mean (Cochran 1954, doi:10.2307/3001666)."""
    weight = 1 / (sigmas**2 + between**2)
    return float(weight @ (values - weight @ values / weight.sum()) ** 2)


def paule_mandel(values: Array, sigmas: Array) -> float:
    """Spread between the values that brings Cochran's sum to its expectation; zero where it is below already."""
    low, high = 0.0, float(np.ptp(values)) * np.sqrt(len(values)) + 1e-300
    if cochran(values, sigmas, 0.0) <= len(values) - 1:
        return 0.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if cochran(values, sigmas, middle) > len(values) - 1 else (low, middle)
    return float((low + high) / 2)


def _side(rows: pd.DataFrame) -> str:
    rate = rows.loc[rows["radius_mm"].notna(), "yaw_rate_deg_s"].mean()
    return "" if np.isnan(rate) else "left" if rate > 0 else "right"


def _missing(runs: int, side: str, other_side: bool) -> str:
    lacking = []
    if side and runs < ISO_4138_REPETITIONS:
        lacking.append(f"{runs} of at least {ISO_4138_REPETITIONS} repetitions")
    if side and not other_side:
        lacking.append("no turn to the other side")
    return "ISO 4138: " + ", ".join(lacking) if lacking else ""
