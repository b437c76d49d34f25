"""Experiments whose truth is known in closed form: marks on circles and lines, written as a user would have them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd

from calibration.frames import plate_from_body

GREEN_MM, YELLOW_MM = (-1.55, 1.83), (-1.55, -1.83)


def circling_marks(
    radius_mm: float, *, speed_mm_s: float = 2.0, seconds: float = 6.0, sigma_mm: float = 0.005, seed: int = 1
) -> pd.DataFrame:
    """Marks of a robot whose centre runs counter-clockwise on a circle (a line for an infinite radius), with noise."""
    time = np.arange(round(60 * seconds)) / 60
    path = speed_mm_s * time
    if np.isinf(radius_mm):
        x, y, heading = path, 0 * path, 0 * path
    else:
        heading = path / radius_mm
        x, y = radius_mm * np.sin(heading), radius_mm * (1 - np.cos(heading))
    noise = np.random.default_rng(seed)
    table = pd.DataFrame({"time_s": time})
    for name, place in (("green", GREEN_MM), ("yellow", YELLOW_MM)):
        points = plate_from_body(np.broadcast_to(place, (len(time), 2)), x, y, heading)
        table[[f"{name}_x_mm", f"{name}_y_mm"]] = points + noise.normal(0, sigma_mm, points.shape)
    return table


def write_experiment(folder: Path, runs: Iterable[tuple[str, float, float, pd.DataFrame]]) -> Path:
    """An experiment.toml over runs (id, left_rpm, right_rpm, marks)."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["format = 1", 'name = "circles"', 'robot = "barrel"']
    for run, left, right, marks in runs:
        marks.to_csv(folder / f"{run}.csv", index=False)
        lines += ["", "[[run]]", f'id = "{run}"', f"left_rpm = {left}", f"right_rpm = {right}", f'marks = "{run}.csv"']
    path = folder / "experiment.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def three_runs(folder: Path) -> Path:
    """Two turns and a straight run."""
    return write_experiment(
        folder,
        [
            ("r01", 14.4, 33.3, circling_marks(6.0, seed=1)),
            ("r02", 5.0, 33.0, circling_marks(3.5, seed=2)),
            ("r03", 30.0, 30.0, circling_marks(np.inf, seed=3)),
        ],
    )
