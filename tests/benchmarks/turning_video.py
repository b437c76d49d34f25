"""Coverage of turning radii measured from video: rigs drawn at random, each calibrated on its own rendered gauges.

python -m tests.benchmarks.turning_video --rigs 100
Every rig has its own camera, lens, light and gauge pictures; a circle of known radius is rendered, encoded, tracked
with the camera that calibration gave, and measured. Some 5 s a rig.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from calibration.camera import Camera
from calibration.gauge import Gauge, load_gauge
from calibration.solve import calibrate
from evaluator.pose import MarkGeometry, poses_from_marks
from evaluator.recording import open_recording
from evaluator.tracking import place_on_plate, track
from evaluator.turning import Turning, measure_turning
from simulator.rendering import Scene, render_clip, render_gauge_picture
from simulator.rendering.tables import CameraTable
from simulator.robot import load_robot

GAUGE = Path(__file__).parents[2] / "sample_videos" / "gauge.toml"
FRAMES_PER_S = 60


def random_rig(rng: np.random.Generator) -> CameraTable:
    """Camera 100 to 200 mm above the plate, 10 to 16 px/mm, a little tilted, with some distortion."""
    distance = rng.uniform(100, 200)
    return CameraTable(
        focal_px=float(rng.uniform(10, 16) * distance),
        distance_mm=float(distance),
        tilt_deg=float(rng.uniform(0, 5)),
        tilt_azimuth_deg=float(rng.uniform(0, 360)),
        turn_deg=float(rng.uniform(-10, 10)),
        k1=float(rng.uniform(-0.3, 0.1)),
        principal_offset_px=tuple(rng.uniform(-8, 8, 2).tolist()),
    )


def calibrated(rig: CameraTable, gauge: Gauge, rng: np.random.Generator, noise: dict[str, float]) -> Camera:
    """Camera from one gauge picture on the plate and four at a tilt."""
    pictures = []
    for number in range(5):
        tilt = 0.0 if number == 0 else np.radians(rng.uniform(8, 20))
        azimuth = np.pi / 2 * number + rng.uniform(-0.3, 0.3)
        rotation = tilt * np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        height = 0.0 if number == 0 else 7.0
        seed = int(rng.integers(2**31))
        picture = render_gauge_picture(
            rig.camera(), gauge, rotation_rad=rotation, translation_mm=(0.0, 0.0, height), seed=seed, sensor=noise
        )
        pictures.append(np.asarray(picture, dtype=np.uint8))
    return calibrate(pictures, gauge).camera


def measured(rig: CameraTable, camera: Camera, circle: dict[str, float], duration_s: float, seed: int) -> Turning:
    """Turning of one rendered circle."""
    motion = {"kind": "circle", "start_s": 0.2, **circle}
    content = {"format": 1, "seed": seed, "duration_s": duration_s, "motion": motion, "camera": rig.model_dump()}
    scene = Scene.model_validate(content)
    robot = load_robot("barrel")
    geometry = MarkGeometry(robot.marks.green_mm, robot.marks.yellow_mm, robot.marks.height_mm)
    with tempfile.TemporaryDirectory() as folder:
        video = Path(folder) / "clip.mp4"
        render_clip(scene, video)
        table = place_on_plate(track(open_recording(video)), camera, robot.marks.height_mm)
    return measure_turning(poses_from_marks(table, geometry, camera))


def main() -> None:
    """Print each rig, then coverage and error."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    gauge = load_gauge(GAUGE)
    held, full, pulls = [], [], []
    print(f"{'px/mm':>6} {'R mm':>6} {'arc °':>6} | {'error %':>8} {'random %':>9} {'systematic %':>12} holds")
    for number in range(options.rigs):
        rng = np.random.default_rng([options.seed, number])
        rig = random_rig(rng)
        camera = calibrated(rig, gauge, rng, {"read_noise_e": float(rng.uniform(20, 200))})
        radius, turned = float(rng.uniform(3, 8)), float(np.radians(rng.choice([60, 150, 360, 360])))
        seconds = 2.5
        x, y = rng.uniform(-1, 1, 2)
        circle = {"radius_mm": radius, "speed_mm_s": radius * turned / (seconds - 0.2), "x_mm": x, "y_mm": y - radius}
        turning = measured(rig, camera, circle, seconds, int(rng.integers(2**31)))
        scale, error = rig.focal_px / rig.distance_mm, turning.radius_mm / radius - 1
        holds = turning.radius_low_mm <= radius <= turning.radius_high_mm
        held.append(holds)
        pulls.append(
            error * radius / max(float(np.hypot(turning.radius_random_mm, turning.radius_systematic_mm)), 1e-12)
        )
        if turned > 6:
            full.append(abs(error))
        print(
            f"{scale:6.1f} {radius:6.2f} {np.degrees(turned):6.0f} | {100 * error:+8.4f}"
            f" {100 * turning.radius_random_mm / radius:9.4f} {100 * turning.radius_systematic_mm / radius:12.5f}"
            f" {'yes' if holds else 'NO'} {turning.radius_status if turning.radius_status != 'ok' else ''}",
            flush=True,
        )
    print(f"held {sum(held)} of {len(held)}; normalised error has standard deviation {np.std(pulls):.2f}")
    if full:
        print(f"full circles: worst error {100 * max(full):.3f} %, median {100 * float(np.median(full)):.4f} %")


if __name__ == "__main__":
    main()
