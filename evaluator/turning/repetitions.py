"""Tables of repetitions: a row per command, and backward compared with forward.

ISO 4138 requires turns to both sides and at least three of each; missing ones are stated in words.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pandas as pd

from evaluator.turning.motion.curvature import Z_975
from evaluator.turning.pooling import Pooled, difference, pooled

ISO_4138_REPETITIONS = 3  # of each turn, at least
# Ratio of radii above which runs are not repetitions. Repetitions of a command scatter by a few percent (friction,
# grain, dirt); with a ratio of 1.5 a run was disturbed, or its command is not the stated one.
DISAGREEMENT = 1.5
COMMAND = ["group", "left_rpm", "right_rpm"]
Key = tuple[str, float, float]


def pool_runs(turning: pd.DataFrame) -> pd.DataFrame:
    """Pool the rows of turning.csv that share group and command.

    Returns a row for each command, in the order of their first runs: group, left_rpm, right_rpm, side ("left", "right",
    or "" for straight), direction, runs that have a radius, radius_mm with its 95 % bounds, radius_between_mm (scatter
    from run to run), radius_within_mm (of a single measurement by noise), radius_systematic_mm (common to all), p_same;
    then curvature, speed, path efficiency and smoothness, each with its scatter from run to run; note: what is missing
    for ISO 4138, and why inconsistent runs have no common radius.
    """
    groups = _commands(turning)
    sides = {key: _side(rows) if key[1] != key[2] else "" for key, rows in groups.items()}
    table = [_row(key, rows, sides[key], _missing(key, rows, sides)) for key, rows in groups.items()]
    return pd.DataFrame(table, columns=list(table[0]) if table else COMMAND)


def compare_directions(turning: pd.DataFrame) -> pd.DataFrame:
    """Compare backward runs with forward runs at the same speeds: a row for each command driven in both directions.

    radius_change_percent: backward relative to forward, with 95 % bounds from the scatter of the repetitions; equal
    errors of the camera cancel. smoothness_change: backward minus forward; negative is less smooth. With a single run
    in each direction the bounds include the measurement alone, and smoothness has none.
    """
    groups = _commands(turning)
    table = []
    for (group, left, right), forward in groups.items():
        backward = groups.get((group, -left, -right))
        if backward is None or left + right <= 0:
            continue
        radii = [_pool(rows, "radius_mm", "radius_random_mm") for rows in (forward, backward)]
        if left == right:  # a straight run has no radius
            radii = [Pooled(), Pooled()]
        change = difference(_relative(radii[0], radii[0].mean), _relative(radii[1], radii[0].mean))
        smooth = [_pool(rows, "smoothness") for rows in (forward, backward)]
        table.append(
            {"group": group, "left_rpm": left, "right_rpm": right}
            | {"forward_runs": len(forward), "backward_runs": len(backward)}
            | {"forward_radius_mm": radii[0].mean, "backward_radius_mm": radii[1].mean}
            | _bounded("radius_change_percent", change)
            | {"forward_smoothness": smooth[0].mean, "backward_smoothness": smooth[1].mean}
            | _bounded("smoothness_change", difference(*smooth))
        )
    return pd.DataFrame(table)


def disagreement(rows: pd.DataFrame, factor: float = DISAGREEMENT) -> str:
    """Reason why the results of runs contradict that they are repetitions; "" if they do not.

    factor: ratio of the largest to the smallest radius from which they are different runs.
    """
    turns = rows[rows["radius_mm"].notna()]
    if len(turns) < 2:
        return ""
    forward, left = turns["speed_mm_s"] > 0, turns["yaw_rate_deg_s"] * turns["speed_mm_s"] > 0
    if forward.any() and not forward.all():
        return "they drive forward and backward"
    if left.any() and not left.all():
        return "they turn to both sides"
    least, most = float(turns["radius_mm"].min()), float(turns["radius_mm"].max())
    return "" if most <= factor * least else f"radii from {least:.4g} to {most:.4g} mm"


def _commands(turning: pd.DataFrame) -> dict[Key, pd.DataFrame]:
    """Rows of every command, in the order of their first runs; runs without results are omitted."""
    there = turning[turning["speed_mm_s"].notna()]
    there = there.assign(group=there["group"].fillna("") if "group" in there else "")
    found: dict[Key, pd.DataFrame] = {}
    for key, rows in there.groupby(COMMAND, sort=False):
        group, left, right = cast("tuple[Any, ...]", key)
        found[str(group), float(left), float(right)] = rows
    return found


def _row(key: Key, rows: pd.DataFrame, side: str, note: str) -> dict[str, Any]:
    radius = _pool(rows, "radius_mm", "radius_random_mm")
    systematic = float(rows["radius_systematic_mm"].mean()) if "radius_systematic_mm" in rows else float("nan")
    radius = radius.with_systematic(systematic)
    if radius.runs == 1 and "radius_low_mm" in rows:  # no other run makes it more or less certain
        alone = rows[rows["radius_mm"].notna()].iloc[0]
        radius = replace(radius, low=float(alone["radius_low_mm"]), high=float(alone["radius_high_mm"]))
    result: dict[str, Any] = dict(zip(COMMAND, key, strict=True))
    result |= {"side": side, "direction": "backward" if key[1] + key[2] < 0 else "forward", "runs": len(rows)}
    if fault := disagreement(rows):
        radius, note = Pooled(runs=radius.runs), "; ".join(filter(None, [f"runs disagree: {fault}", note]))
    result |= {"radius_mm": radius.mean, "radius_low_mm": radius.low, "radius_high_mm": radius.high}
    result |= {"radius_between_mm": radius.between, "radius_within_mm": radius.within}
    result |= {"radius_systematic_mm": systematic, "p_same": radius.p_same}
    curvature = _pool(rows.assign(sigma=_curvature_sigma(rows)), "curvature_per_mm", "sigma")
    result |= {"curvature_per_mm": curvature.mean}
    result |= {"curvature_low_per_mm": curvature.low, "curvature_high_per_mm": curvature.high}
    for stem, unit, sigma in (
        ("speed", "_mm_s", "speed_random_mm_s"),
        ("path_efficiency", "", ""),
        ("smoothness", "", ""),
    ):
        pool = _pool(rows, f"{stem}{unit}", sigma)
        result |= {f"{stem}{unit}": pool.mean, f"{stem}_between{unit}": pool.between}
    return result | {"note": note}


def _curvature_sigma(rows: pd.DataFrame) -> pd.Series[float]:
    """Standard uncertainty from the 95 % bounds, including noise and camera."""
    return (rows["curvature_high_per_mm"] - rows["curvature_low_per_mm"]) / (2 * Z_975)


def _pool(rows: pd.DataFrame, name: str, sigma: str = "") -> Pooled:
    """Pool a column; if it has no column of uncertainties, by its scatter alone."""
    if name not in rows:
        return Pooled()
    known = rows[sigma].to_numpy(float) if sigma and sigma in rows else np.zeros(len(rows))
    return pooled(rows[name].to_numpy(float), known)


def _relative(pool: Pooled, base: float) -> Pooled:
    """The mean and its error in percent of a base."""
    return Pooled(100 * pool.mean / base, error=100 * pool.error / base, freedom=pool.freedom)


def _bounded(name: str, values: tuple[float, float, float]) -> dict[str, float]:
    stem, unit = (name.removesuffix("_percent"), "_percent") if name.endswith("_percent") else (name, "")
    return {name: values[0], f"{stem}_low{unit}": values[1], f"{stem}_high{unit}": values[2]}


def _side(rows: pd.DataFrame) -> str:
    """Side of the robot on which the centre of rotation lies; for a forward run, the side to which it turns."""
    turning = rows[rows["radius_mm"].notna()]
    if turning.empty:
        return ""
    return "left" if float(np.sign(turning["yaw_rate_deg_s"] * turning["speed_mm_s"]).mean()) > 0 else "right"


def _missing(key: Key, rows: pd.DataFrame, sides: Mapping[Key, str]) -> str:
    if not sides[key]:
        return ""
    group, left, right = key
    lacking = []
    if len(rows) < ISO_4138_REPETITIONS:
        lacking.append(f"{len(rows)} of at least {ISO_4138_REPETITIONS} repetitions")
    if (group, right, left) not in sides:
        lacking.append("no turn to the other side")
    return "ISO 4138: " + ", ".join(lacking) if lacking else ""
