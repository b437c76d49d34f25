"""Are the intervals that turnscope prints honest? Ranks of the truth over random experiments, uniform where they are.

python -m tests.benchmarks.interval_ranks --experiments 400 --cameras 100 --seed 1

Each experiment draws its truth from continuous ranges, measures it, and notes where in the stated distribution the
truth lies: rank = Φ((truth - estimate)/sigma). Ranks of honest intervals are uniform (simulation-based calibration,
Talts et al. 2018, arXiv:1804.06788); of intervals that are too narrow they crowd at both ends, of biased estimates at
one. Each row is tested by itself (Kolmogorov-Smirnov), and the smallest p is held against the number of rows
(Bonferroni). Ranks of effects are those of `python -m tests.benchmarks.laboratory`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator

import click
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats
from scipy.signal import lfilter

from calibration.errors import CalibrationError
from calibration.estimation.calibrate import calibrate
from calibration.frames import plate_from_body
from evaluator.capture.light import light_on
from evaluator.pose import Poses, poses_from_marks
from evaluator.turning import measure_turning
from evaluator.turning.clock import command_delay
from evaluator.turning.motion.curvature import Z_975
from evaluator.turning.path import measure_path
from evaluator.turning.quantities import RobotShape
from tests.benchmarks.calibration.rig import errors, random_camera
from tests.calibration.drawing import draw_gauge, random_poses
from tests.evaluator.turning.synthetic import FRAME_S, GEOMETRY, arc_poses, straight_poses

Array = NDArray[np.float64]
Ranked = Iterator[tuple[str, float]]  # name of a quantity, (truth - estimate)/sigma
WHEEL_RADIUS_MM = 0.5
SHAPE = RobotShape(((2.0, 2.0), (2.0, -2.0), (-2.0, 2.0), (-2.0, -2.0)), WHEEL_RADIUS_MM, 5.0, 9.0)


def noisy_marks(poses: Array, rng: np.random.Generator) -> pd.DataFrame:
    """Marks of poses with noise of 1 to 30 µm, white or alike from frame to frame, and frames that are missing."""
    table = {"time_s": np.arange(len(poses)) * FRAME_S}
    correlation = rng.choice([0.0, rng.uniform(0, 0.9)])
    sigma_mm = 1e-3 * np.exp(rng.uniform(0, np.log(30)))
    for name, place in (("green", GEOMETRY.green_mm), ("yellow", GEOMETRY.yellow_mm)):
        noise = rng.normal(size=(len(poses), 2))
        noise[1:] *= np.sqrt(1 - correlation**2)
        noise = lfilter([1.0], [1.0, -correlation], noise, axis=0)
        points = plate_from_body(np.broadcast_to(place, (len(poses), 2)), *poses.T) + sigma_mm * noise
        table[f"{name}_x_mm"], table[f"{name}_y_mm"] = points.T
    marks = pd.DataFrame(table)
    marks.loc[rng.random(len(poses)) < rng.choice([0.0, 0.05]), ["green_x_mm", "green_y_mm"]] = np.nan
    return marks


def turns(rng: np.random.Generator) -> Ranked:
    """A turn of 15 to 1080 degrees on a radius of 2.5 to 100 mm: radius, speeds, slips, poses, path of a mark."""
    radius = float(np.exp(rng.uniform(np.log(2.5), np.log(100))))
    turned_deg = float(np.exp(rng.uniform(np.log(15), np.log(1080))))
    frames, slip = int(rng.integers(100, 600)), float(rng.uniform(-0.2, 0.2))
    poses = arc_poses(radius, turned_deg, frames, slip)
    yaw = np.radians(turned_deg) / ((frames - 1) * FRAME_S)
    velocity = radius * yaw * np.array([np.cos(slip), np.sin(slip)])
    left, right = rng.uniform(0.7, 1.3, 2) * velocity[0] / (2 * np.pi * WHEEL_RADIUS_MM) * 60
    marks = noisy_marks(poses, rng)
    found = poses_from_marks(marks, GEOMETRY)
    turn = measure_turning(found, shape=SHAPE, left_rpm=float(left), right_rpm=float(right))
    stated = (turn.curvature_high_per_mm - turn.curvature_low_per_mm) / (2 * Z_975)
    yield "curvature of a turn", (1 / radius - turn.curvature_per_mm) / stated
    if np.isfinite(turn.radius_mm):
        yield (
            "smallest sustained radius",
            _by_curvature(radius, turn.radius_mm, turn.radius_low_mm, turn.radius_high_mm),
        )
    yield "speed", (radius * yaw - turn.speed_mm_s) / turn.speed_sigma_mm_s
    yield "yaw rate", (np.degrees(yaw) - turn.yaw_rate_deg_s) / turn.yaw_rate_sigma_deg_s
    yield "body slip angle", (np.degrees(slip) - turn.body_slip_angle_deg) / turn.body_slip_angle_sigma_deg
    at_wheel = velocity[0] - yaw * 2.0
    surface = left * 2 * np.pi / 60 * WHEEL_RADIUS_MM
    ratio = (at_wheel - surface) / max(abs(at_wheel), abs(surface))
    yield "slip ratio of a wheel", (ratio - turn.front_left_slip_ratio) / turn.front_left_slip_ratio_sigma
    yield from _pose_of_a_frame(found, poses, rng)
    green = np.column_stack([marks["green_x_mm"], marks["green_y_mm"]])
    path = measure_path(marks["time_s"].to_numpy(), green)
    true = float(np.hypot(GEOMETRY.green_mm[0] + radius * np.sin(slip), GEOMETRY.green_mm[1] - radius * np.cos(slip)))
    if np.isfinite(path.radius):
        yield "path radius of one mark", _by_curvature(true, path.radius, path.low, path.high)


def _by_curvature(true: float, radius: float, low: float, high: float) -> float:
    """Intervals of a radius are symmetric in its reciprocal."""
    return (1 / true - 1 / radius) / ((1 / low - 1 / high) / (2 * Z_975))


def _pose_of_a_frame(found: Poses, poses: Array, rng: np.random.Generator) -> Ranked:
    frame = int(rng.choice(np.flatnonzero(found.measured)))
    there = np.array([found.x_mm[frame], found.y_mm[frame], found.heading_rad[frame]])
    off, sigma = poses[frame] - there, np.sqrt(np.diag(found.covariance[frame]))
    off[2] = np.angle(np.exp(1j * off[2]))
    yield from zip(("x of a frame", "y of a frame", "heading of a frame"), off / sigma, strict=True)


def straights(rng: np.random.Generator) -> Ranked:
    """A straight run: its curvature, which is nought, and its speed."""
    frames, length = int(rng.integers(100, 600)), float(rng.uniform(10, 100))
    turn = measure_turning(poses_from_marks(noisy_marks(straight_poses(length, frames), rng), GEOMETRY))
    stated = (turn.curvature_high_per_mm - turn.curvature_low_per_mm) / (2 * Z_975)
    yield "curvature of a straight run", -turn.curvature_per_mm / stated
    yield "speed of a straight run", (length / ((frames - 1) * FRAME_S) - turn.speed_mm_s) / turn.speed_sigma_mm_s


def clocks(rng: np.random.Generator) -> Ranked:
    """A robot that changes its speed at logged times, seen by a clock that is off by up to 0.3 s."""
    late, changes = float(rng.uniform(-0.3, 0.3)), np.array([2.0, 4.0, 6.0])
    time_s = np.arange(0, 8, FRAME_S)
    pose = _driven(time_s, changes + late, rng.uniform(-20, 20, 4), rng.uniform(-1, 1, 4))
    noise = np.exp(rng.uniform(np.log(1e-3), np.log(3e-2)))
    pose += rng.normal(size=pose.shape) * noise * np.array([1, 1, 0.3])
    found = command_delay(time_s, pose, changes.tolist())
    if found.is_known:
        yield "delay of a command log", (late - found.value_s) / ((found.high_s - found.low_s) / (2 * Z_975))


def _driven(time_s: Array, changes_s: Array, speeds_mm_s: Array, yaws_rad_s: Array) -> Array:
    """Poses (n, 3) of a robot whose speed and yaw rate change at certain times: exact, arc after arc."""
    every = np.union1d(time_s, changes_s)
    part, step = np.searchsorted(changes_s, every[:-1], side="right"), np.diff(every)
    turned = yaws_rad_s[part] * step
    heading = np.concatenate([[0.0], np.cumsum(turned)])
    chord, middle = speeds_mm_s[part] * step * np.sinc(turned / 2 / np.pi), heading[:-1] + turned / 2
    moved = np.cumsum(chord[:, None] * np.column_stack([np.cos(middle), np.sin(middle)]), axis=0)
    poses = np.column_stack([np.concatenate([[[0.0, 0.0]], moved]), heading])
    return poses[np.isin(every, time_s)]


def lights(rng: np.random.Generator) -> Ranked:
    """A light that goes on at any moment of a frame, of a camera whose exposure is known."""
    exposure, moment = float(rng.uniform(0.2, 1.0)) * FRAME_S, float(rng.uniform(0.4, 0.6))
    time_s = np.arange(60) * FRAME_S
    share = np.clip((time_s + exposure / 2 - moment) / exposure, 0, 1)
    level = 40 + rng.uniform(60, 150) * share + rng.normal(size=60) * rng.uniform(0.3, 3)
    found, sigma = light_on(time_s, level, exposure)
    yield "a light that goes on", (moment - found) / sigma


def cameras(rng: np.random.Generator) -> Ranked:
    """A random camera, calibrated with seven images: a place on the plane of the marks, and its scale."""
    truth, gauge, field = random_camera(rng)
    views = random_poses(truth, 7, rng, tilt_deg=20, shift_mm=0.12 * field)
    drawn = [draw_gauge(view, gauge, rng=rng, snr=30) for view in views]
    try:
        found = calibrate(drawn, gauge).camera
    except CalibrationError:
        return
    result = errors(truth, found, 0.04 * truth.value("translation_z_mm"))
    point = int(rng.integers(len(result.z)))
    yield "x on the plane of the marks", float(result.z[point, 0])
    yield "y on the plane of the marks", float(result.z[point, 1])
    yield "scale of the plane", float(result.scale_z)


def report(found: dict[str, list[float]]) -> str:
    """A row for each quantity: how many, share within 95 %, p of uniform ranks; then the smallest p of all."""
    lines = [f"{'quantity':32} {'n':>5} {'in 95 %':>8} {'RMS z':>6} {'p':>8}"]
    smallest = 1.0
    for name, scores in found.items():
        z = np.array([score for score in scores if np.isfinite(score)])
        p = float(stats.kstest(stats.norm.cdf(z), "uniform").pvalue)
        smallest = min(smallest, p)
        inside = 100 * float((np.abs(z) < Z_975).mean())
        lines.append(f"{name:32} {len(z):5d} {inside:8.1f} {np.sqrt(np.mean(z**2)):6.2f} {p:8.3g}")
    lines.append(f"smallest p times {len(found)} quantities: {min(1.0, smallest * len(found)):.3g}  [above 0.05]")
    return "\n".join(lines)


@click.command()
@click.option("--experiments", default=400, help="Of each kind without images.")
@click.option("--cameras", "views", default=100, help="To calibrate; each takes about a second.")
@click.option("--seed", default=1)
def main(experiments: int, views: int, seed: int) -> None:
    """Ranks of the truth in the stated distributions."""
    kinds: tuple[tuple[Callable[[np.random.Generator], Ranked], int], ...] = (
        (turns, experiments),
        (straights, experiments),
        (clocks, experiments),
        (lights, experiments),
        (cameras, views),
    )
    found: dict[str, list[float]] = defaultdict(list)
    for kind, (draw, count) in enumerate(kinds):
        for number in range(count):
            for name, score in draw(np.random.default_rng([seed, kind, number])):
                found[name].append(float(score))
    print(report(found))


if __name__ == "__main__":
    main()
