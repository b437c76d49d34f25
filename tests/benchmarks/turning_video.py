"""Coverage of turning radii measured from video: rigs drawn at random, each calibrated on its own rendered gauges.

python -m tests.benchmarks.turning_video --rigs 100 --keep rigs.csv
Every rig has its own camera, lens, light, gauge images and recorder; a circle of known radius is rendered, encoded,
tracked with the camera that calibration gave, and measured. Some 6 s a rig. With --keep a study that was interrupted
goes on where it was, and every rig's numbers stay for a closer look; `--summary` only sums them up.

Beside the radius it keeps what of each mark's centre error all frames share, seen from the body (`common_px`, from
truth): the error that COMMON_SHARE and COMMON_PX of evaluator.pose_systematic stand for.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.estimation.calibrate import calibrate
from calibration.gauge.geometry import Gauge, load_gauge
from evaluator.pose import MarkGeometry, poses_from_marks
from evaluator.recording import open_recording
from evaluator.tracking import place_on_plate, track
from evaluator.turning import measure_turning
from simulator.rendering import Scene, render_clip, render_gauge_image
from simulator.rendering.tables import CameraTable
from simulator.robot import load_robot

GAUGE = Path(__file__).parents[2] / "sample_videos" / "gauge.toml"
FRAMES_PER_S = 60
SECONDS, START_S = 2.5, 0.2


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


def random_recorder(rng: np.random.Generator) -> dict[str, dict[str, Any]]:
    """Lens blur, sensor noise and how the video is stored: H.264 three times of four, else without loss."""
    encoding = {"codec": "lossless"} if rng.random() < 0.25 else {"codec": "h264", "crf": float(rng.uniform(15, 25))}
    return {
        "optics": {"blur_px": float(rng.uniform(0.6, 1.2))},
        "sensor": {"read_noise_e": float(rng.uniform(20, 100))},
        "encoding": encoding,
    }


def gauge_images(
    rig: CameraTable, gauge: Gauge, rng: np.random.Generator, noise: dict[str, float]
) -> list[NDArray[np.uint8]]:
    """One image of the gauge on the plate and four at a tilt."""
    images = []
    for number in range(5):
        tilt = 0.0 if number == 0 else np.radians(rng.uniform(8, 20))
        azimuth = np.pi / 2 * number + rng.uniform(-0.3, 0.3)
        rotation = tilt * np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        height = 0.0 if number == 0 else 7.0
        seed = int(rng.integers(2**31))
        image = render_gauge_image(
            rig.camera(), gauge, rotation_rad=rotation, translation_mm=(0.0, 0.0, height), seed=seed, sensor=noise
        )
        images.append(np.asarray(image, dtype=np.uint8))
    return images


def measured(gauge: Gauge, seed: int, number: int) -> dict[str, Any]:
    """One rig: draw it, calibrate it, render and measure one circle."""
    rng = np.random.default_rng([seed, number])
    rig, recorder = random_rig(rng), random_recorder(rng)
    camera = calibrate(gauge_images(rig, gauge, rng, {"read_noise_e": float(rng.uniform(20, 200))}), gauge).camera
    radius, turned = float(rng.uniform(3, 8)), float(np.radians(rng.choice([60, 150, 360, 360])))
    x, y = rng.uniform(-1, 1, 2)
    motion = {
        "kind": "circle", "start_s": START_S, "radius_mm": radius, "speed_mm_s": radius * turned / (SECONDS - START_S),
        "x_mm": float(x), "y_mm": float(y - radius), "side": str(rng.choice(["left", "right"])),
    }  # fmt: skip
    if motion["side"] == "right":
        motion["y_mm"] = float(y + radius)
    content = {"format": 1, "seed": int(rng.integers(2**31)), "duration_s": SECONDS, "motion": motion, **recorder}
    scene = Scene.model_validate({**content, "camera": rig.model_dump()})
    robot = load_robot("barrel")
    geometry = MarkGeometry(robot.marks.green_mm, robot.marks.yellow_mm, robot.marks.height_mm)
    with tempfile.TemporaryDirectory() as folder:
        video = Path(folder) / "clip.mkv"
        truth = render_clip(scene, video)
        table = place_on_plate(track(open_recording(video)), camera, robot.marks.height_mm)
    turning = measure_turning(poses_from_marks(table, geometry, camera))
    error = turning.radius_mm - radius
    return {
        "rig": number,
        "codec": recorder["encoding"]["codec"],
        "crf": recorder["encoding"].get("crf", 0.0),
        "px_per_mm": rig.focal_px / rig.distance_mm,
        "true_radius_mm": radius,
        "turned_deg": round(np.degrees(turned)),
        "error_percent": 100 * error / radius,
        "random_percent": 100 * turning.radius_random_mm / radius,
        "systematic_percent": 100 * turning.radius_systematic_mm / radius,
        "low_percent": 100 * (turning.radius_low_mm / radius - 1),
        "high_percent": 100 * (turning.radius_high_mm / radius - 1),
        "status": turning.radius_status,
        **common_errors_px(table, truth),
    }


def common_errors_px(table: pd.DataFrame, truth: pd.DataFrame) -> dict[str, float]:
    """Mean error of each mark in px along the axes of the body, its scatter and what the tracker states for a frame."""
    found: dict[str, float] = {}
    heading = np.radians(truth["heading_deg"].to_numpy())
    cos, sin = np.cos(heading), -np.sin(heading)  # image rows run down
    moving = truth["time_s"].to_numpy() > START_S
    for mark in ("green", "yellow"):
        dx, dy = (table[f"{mark}_{axis}_px"].to_numpy() - truth[f"{mark}_{axis}_px"].to_numpy() for axis in "xy")
        along: NDArray[np.float64] = np.stack([cos * dx + sin * dy, -sin * dx + cos * dy])[:, moving]
        stated = table.loc[moving, [f"{mark}_x_sigma_px", f"{mark}_y_sigma_px"]].to_numpy()
        found |= {
            f"{mark}_ahead_px": float(np.nanmean(along[0])),
            f"{mark}_aside_px": float(np.nanmean(along[1])),
            f"{mark}_scatter_px": float(np.nanstd(along)),
            f"{mark}_stated_px": float(np.sqrt(np.nanmedian(stated**2))),
        }
    return found


def line_of(row: dict[str, Any]) -> str:
    """A rig's numbers, for people."""
    rig = f"{row['rig']:4} {row['codec']:>8} {row['px_per_mm']:6.1f} {row['true_radius_mm']:6.2f}"
    error = f"{row['error_percent']:+8.4f} {row['random_percent']:9.4f} {row['systematic_percent']:8.4f}"
    missed = "" if row["low_percent"] <= 0 <= row["high_percent"] else "MISSED"
    return (
        f"{rig} {row['turned_deg']:6.0f} | {error} {missed} {row['status'] if row['status'] != 'ok' else ''}".rstrip()
    )


def print_summary(rigs: pd.DataFrame) -> None:
    """Coverage, normalised errors, errors of full circles, and the errors all frames share."""
    held = (rigs["low_percent"] <= 0) & (rigs["high_percent"] >= 0)
    pulls: pd.Series[float] = rigs["error_percent"] / np.hypot(rigs["random_percent"], rigs["systematic_percent"])
    part = (rigs["systematic_percent"] ** 2 / (rigs["systematic_percent"] ** 2 + rigs["random_percent"] ** 2)).median()
    print(f"held {held.sum()} of {len(held)}; normalised error: standard deviation {pulls.std():.2f}, ", end="")
    print(f"mean {pulls.mean():+.2f}; systematic share of the variance: median {100 * part:.0f} %")
    for codec, chosen in rigs.groupby("codec"):
        axes = [f"{mark}_{axis}_px" for mark in ("green", "yellow") for axis in ("ahead", "aside")]
        common = np.sqrt(np.mean(chosen[axes].to_numpy() ** 2))
        stated = np.sqrt(np.mean(chosen[["green_stated_px", "yellow_stated_px"]].to_numpy() ** 2))
        scatter = np.sqrt(np.mean(chosen[["green_scatter_px", "yellow_scatter_px"]].to_numpy() ** 2))
        holds = held[chosen.index]
        print(
            f"  {codec}: held {holds.sum()} of {len(holds)}; common error of a mark {common:.4f} px RMS, "
            f"scatter {scatter:.4f} px, stated {stated:.4f} px"
        )
    full = rigs.loc[rigs["turned_deg"] == 360, "error_percent"].abs()
    if len(full):
        print(f"full circles, 10 to 16 px/mm: worst error {full.max():.3f} %, median {full.median():.4f} %")


def main() -> None:
    """Measure the rigs that are not kept yet, then sum up."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="CSV of the rigs' numbers, a row each, to go on from")
    parser.add_argument("--summary", action="store_true", help="measure nothing, sum up what is kept")
    options = parser.parse_args()
    gauge = load_gauge(GAUGE)
    rows: list[Any] = pd.read_csv(options.keep).to_dict("records") if options.keep and options.keep.is_file() else []
    known = {row["rig"] for row in rows}
    todo = [] if options.summary else [number for number in range(options.rigs) if number not in known]
    print(
        f"{'rig':>4} {'codec':>8} {'px/mm':>6} {'R mm':>6} {'arc °':>6} | {'error %':>8} {'random %':>9} {'syst. %':>8}"
    )
    for number in todo:
        row = measured(gauge, options.seed, number)
        rows.append(row)
        print(line_of(row), flush=True)
        if options.keep:
            pd.DataFrame(rows).to_csv(options.keep, index=False)
    print_summary(pd.DataFrame(rows))


if __name__ == "__main__":
    main()
