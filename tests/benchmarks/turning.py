"""Coverage, bias and width of turning radii over seeded runs, beside other circle fits on the same data.

python -m tests.benchmarks.turning marks --runs 1000     coverage over radii, arcs, noise, correlation and gaps
python -m tests.benchmarks.turning peers --runs 200      the circle-fit package, scikit-image, minimum over windows
python -m tests.benchmarks.turning real FOLDER           radius against speed of the car in FOLDER/rc_car_circles
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.signal import lfilter

from evaluator.pose import poses_from_marks
from evaluator.turning import Turning, measure_turning
from evaluator.turning.motion.fit import Block, fit_turn, scaled_poses
from evaluator.turning.motion.least_squares import NoiseModel
from evaluator.turning.motion.whitening import whitened_moments
from tests.evaluator.turning.synthetic import GEOMETRY, arc_poses, marks_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kind:
    """One kind of run."""

    radius_mm: float
    turned_deg: float
    frames: int
    sigma_um: float
    correlation: float = 0.0
    gaps: bool = False

    def text(self) -> str:
        """Columns of the tables."""
        gaps = "yes" if self.gaps else "no"
        return (
            f"{self.radius_mm:6.1f} {self.turned_deg:6.0f} {self.frames:5d} {self.sigma_um:5.0f}"
            f" {self.correlation:5.2f} {gaps:>4}"
        )


KINDS = (
    Kind(2.5, 15, 100, 1),
    Kind(2.5, 15, 100, 30),
    Kind(2.5, 90, 300, 10, 0.8),
    Kind(2.5, 720, 600, 30),
    Kind(5, 15, 60, 10),
    Kind(5, 60, 150, 10, 0.5, gaps=True),
    Kind(5, 360, 300, 10),
    Kind(5, 360, 300, 10, 0.9),
    Kind(5, 3600, 600, 10, 0.95),
    Kind(16, 15, 200, 1, 0.8),
    Kind(16, 90, 300, 30, gaps=True),
    Kind(16, 360, 600, 10, 0.8, gaps=True),
    Kind(50, 30, 200, 10),
    Kind(50, 30, 200, 30, 0.8),
    Kind(100, 15, 300, 1),
    Kind(100, 15, 300, 10, 0.8),
    Kind(100, 15, 300, 30),
    Kind(100, 90, 600, 30, 0.9),
)
HEAD = f"{'R mm':>6} {'arc °':>6} {'n':>5} {'µm':>5} {'corr':>5} {'gaps':>4}"


def run_of(kind: Kind, seed: int) -> pd.DataFrame:
    """Marks of one run."""
    rng = np.random.default_rng([seed, kind.frames, int(10 * kind.radius_mm), int(kind.turned_deg)])
    truth = arc_poses(kind.radius_mm, kind.turned_deg, kind.frames)
    table = marks_of(truth, 0.0, rng)
    fresh = rng.normal(size=(kind.frames, 4))
    if kind.correlation:
        fresh[1:] *= np.sqrt(1 - kind.correlation**2)
        fresh = lfilter([1.0], [1.0, -kind.correlation], fresh, axis=0)
    table.iloc[:, 1:] += kind.sigma_um / 1000 * fresh
    if kind.gaps:
        lost = rng.random(kind.frames) < 0.05
        start = rng.integers(kind.frames // 4, kind.frames // 2)
        lost[start : start + kind.frames // 10] = True
        table.loc[lost, ["green_x_mm", "green_y_mm"]] = np.nan
    return table


def best_possible(kind: Kind) -> float:
    """Cramér-Rao bound of the relative radius for marks whose noise is known, heading and position together."""
    exact = replace(kind, sigma_um=1e-3, correlation=0.0)
    poses = poses_from_marks(run_of(exact, 0), GEOMETRY)
    there = poses.measured
    pose = np.column_stack([poses.x_mm, poses.y_mm, poses.heading_rad])[there]
    fit = fit_turn(poses.time_s[there], scaled_poses(pose, poses.covariance[there]))
    # At the point between the marks, position and scaled heading carry sigma / sqrt(2) each.
    design = fit.motion.design[fit.used] / (kind.sigma_um / 1000 / np.sqrt(2))
    block = Block(poses.time_s[there][fit.used] * 60, pose[fit.used, 2], np.zeros((int(fit.used.sum()), 2)), design)
    model = NoiseModel(kind.correlation, 0.0, in_image=True)
    moments, _ = whitened_moments(
        np.diff(block.time), np.diff(block.heading_rad), np.ascontiguousarray(design), model.correlation, 0.0
    )
    gradient = fit.bend_gradient()
    length = fit.motion.length_mm
    per_bend = (1 + (length / kind.radius_mm) ** 2) / length
    return float(np.sqrt(gradient @ np.linalg.inv(moments) @ gradient) * per_bend * kind.radius_mm)


def marks_table(runs: int) -> None:
    """Coverage, bias and width of measure_turning."""
    print(f"{HEAD} | {'cover %':>7} {'bias %':>8} {'sd %':>7} {'stated/best':>11} {'circle alone/ours':>17} {'ms':>5}")
    for kind in KINDS:
        tables = [run_of(kind, seed) for seed in range(runs)]
        begin = time.process_time()
        found = [measure_turning(poses_from_marks(table, GEOMETRY)) for table in tables]
        spent = (time.process_time() - begin) / runs
        print(f"{kind.text()} | {_summary(kind, found)} {1000 * spent:5.0f}", flush=True)


def _summary(kind: Kind, found: list[Turning]) -> str:
    low, radius, high = (
        np.array([getattr(run, name) for run in found]) for name in ("radius_low_mm", "radius_mm", "radius_high_mm")
    )
    held = np.mean((low <= kind.radius_mm) & (kind.radius_mm <= high))
    bias, scatter = np.nanmean(radius) / kind.radius_mm - 1, np.nanstd(radius) / kind.radius_mm
    # Half the interval over 1.96, in curvature: symmetric even where the radius is not.
    stated = np.nanmedian(1 / low - 1 / high) / 2 / 1.96 * kind.radius_mm
    best = best_possible(kind)
    arc = np.radians(kind.turned_deg)
    circle = kind.sigma_um / 1000 / np.sqrt(2) / kind.radius_mm * np.sqrt(720 / kind.frames) / arc**2
    alone = f"{circle / best:.2f}" if kind.turned_deg <= 60 and not kind.correlation else "-"
    return f"{100 * held:7.1f} {100 * bias:+8.3f} {100 * scatter:7.3f} {stated / best:11.2f} {alone:>17}"


def peers_table(runs: int) -> None:
    """Bias and scatter of the radius by every method, on the same runs."""
    methods = _methods()
    print(f"{HEAD} | " + " ".join(f"{name:>18}" for name in methods) + "   (bias % ± sd %)")
    for kind in (*KINDS[::2], Kind(5, 720, 720, 10)):
        columns: dict[str, list[float]] = {name: [] for name in methods}
        for seed in range(runs):
            poses = poses_from_marks(run_of(kind, seed), GEOMETRY)
            path = np.column_stack([poses.x_mm, poses.y_mm])[poses.measured]
            for name, method in methods.items():
                columns[name].append(measure_turning(poses).radius_mm if method is None else method(path))
        cells = [f"{100 * (np.nanmean(v) / kind.radius_mm - 1):+8.2f} ± {100 * np.nanstd(v) / kind.radius_mm:7.2f}"
                 for v in columns.values()]  # fmt: skip
        print(f"{kind.text()} | " + " ".join(f"{cell:>18}" for cell in cells), flush=True)


def _methods() -> dict[str, Callable[[Array], float] | None]:
    import circle_fit
    from skimage.measure import CircleModel

    def skimage_radius(path: Array) -> float:
        model = CircleModel()
        return float(model.params[2]) if model.estimate(path) else float("nan")

    def window_minimum(path: Array) -> float:
        """Smallest Taubin radius over windows of a quarter of the path, at most 90 frames."""
        size = min(len(path) // 4, 90)
        starts = range(0, len(path) - size, max(size // 10, 1))
        return min(float(circle_fit.taubinSVD(path[start : start + size])[2]) for start in starts)

    return {
        "turnscope": None,
        "taubinSVD": lambda path: float(circle_fit.taubinSVD(path)[2]),
        "hyperLSQ": lambda path: float(circle_fit.hyperLSQ(path)[2]),
        "least squares": lambda path: float(circle_fit.least_squares_circle(path)[2]),
        "standardLSQ": lambda path: float(circle_fit.standardLSQ(path)[2]),
        "scikit-image": skimage_radius,
        "window minimum": window_minimum,
    }


def real_table(folder: Path) -> None:
    """Radius against speed of a car, and where kinematic turning stops holding."""
    from tests.evaluator.turning.speed_sweep import kinematic_limit, radius_against_speed
    from tests.evaluator.turning.test_speed_sweep import car_poses

    for floor in ("rubber", "tape"):
        table = radius_against_speed(car_poses(folder / "rc_car_circles" / f"{floor}_steer_left.csv.gz"))
        edges = np.arange(0.4, 3.0, 0.2) * 1000
        print(f"{floor}: {len(table)} half turns\n  speed m/s   radius m (95 % of the mean)   scatter of half turns")
        for low, high in pairwise(edges):
            here = table[(table["speed_mm_s"] >= low) & (table["speed_mm_s"] < high)]
            if len(here) > 1:
                mean, scatter = here["radius_mm"].mean() / 1000, here["radius_mm"].std() / 1000
                error = 1.96 * scatter / np.sqrt(len(here))
                print(f"  {low / 1000:.1f}–{high / 1000:.1f}     {mean:.3f} ± {error:.3f}   {scatter:.3f}")
        for share in (0.05, 0.1, 0.2):
            speed, radius = table["speed_mm_s"].to_numpy(), table["radius_mm"].to_numpy()
            limit = kinematic_limit(speed, radius, 540.0, np.random.default_rng(0), share)
            place = f"{limit.speed_mm_s:.0f} mm/s, 95 % from {limit.low_mm_s:.0f} to {limit.high_mm_s:.0f}"
            print(f"  0.54 m + {100 * share:.0f} %: {limit.reason or 'passed at ' + place}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", choices=["marks", "peers", "real"])
    parser.add_argument("folder", nargs="?", type=Path, default=Path("../shared/real"))
    parser.add_argument("--runs", type=int, default=200)
    options = parser.parse_args()
    if options.table == "marks":
        marks_table(options.runs)
    elif options.table == "peers":
        peers_table(options.runs)
    else:
        real_table(options.folder)


if __name__ == "__main__":
    main()
