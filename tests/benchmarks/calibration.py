"""How good is the calibration? Pictures drawn exactly by random cameras; the truth is known.

python -m tests.benchmarks.calibration centers     dot centres against the Cramér-Rao bound, and their bias
python -m tests.benchmarks.calibration plane       plane at mark height from 7 pictures of a 17 × 13 gauge
python -m tests.benchmarks.calibration coverage    do 95 % intervals cover 95 % of the truth? (--cameras 300)
python -m tests.benchmarks.calibration opencv      side by side with findCirclesGrid + calibrateCamera
python -m tests.benchmarks.calibration speed       time of detection and assignment
python -m tests.benchmarks.calibration straight    straightness of a real picture's lines after correction (PICTURE)
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

import click
import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.assign_grid import assign_grid
from calibration.camera import Camera, camera_above
from calibration.detect_dots import detect_dots
from calibration.disc import fitted_centers
from calibration.errors import CalibrationError
from calibration.gauge import Gauge
from calibration.neighbours import nearest
from calibration.picture import read_picture
from calibration.solve import calibrate
from tests.calibration.drawing import draw_gauge, random_poses

Array = NDArray[np.float64]
SIZE_PX = (640, 480)
MARK_HEIGHT_MM = 6.5


def gauge_of(pitch_mm: float, diameter_mm: float, columns: int = 17, rows: int = 13) -> Gauge:
    dots = {"columns": columns, "rows": rows, "pitch_mm": pitch_mm, "diameter_mm": diameter_mm}
    return Gauge.model_validate({"format": 1, "name": "benchmark", "dots": dots})


def field_points(size_px: tuple[int, int] = SIZE_PX) -> Array:
    """A grid of picture points that fills the field to its rim."""
    return np.stack(
        np.meshgrid(np.linspace(0, size_px[0] - 1, 13), np.linspace(0, size_px[1] - 1, 10)), axis=-1
    ).reshape(-1, 2)


@dataclass(frozen=True)
class Errors:
    """Of one calibrated camera on the plane at mark height: per point and as a scale."""

    rms_um: float
    scale: float
    z: Array
    scale_z: float


def errors(truth: Camera, found: Camera, height_mm: float = MARK_HEIGHT_MM) -> Errors:
    points = field_points(truth.size_px)
    true = truth.plate_from_picture(points, height_mm)
    seen = np.isfinite(true).all(axis=1)
    points, true = points[seen], true[seen]
    error = found.plate_from_picture(points, height_mm) - true
    sensitivity = found.plate_sensitivity(points, height_mm)
    sigma = np.sqrt(np.einsum("nij,jk,nik->ni", sensitivity, found.covariance, sensitivity))
    # least-squares scale of the found points against the true ones
    centered, moved = true - true.mean(axis=0), error - error.mean(axis=0)
    weight = centered / (centered**2).sum()
    scale = float((weight * moved).sum())
    slope = np.einsum("ni,nij->j", weight, sensitivity)
    scale_sigma = float(np.sqrt(slope @ found.covariance @ slope))
    return Errors(1e3 * float(np.sqrt((error**2).sum(axis=1).mean())), scale, error / sigma, scale / scale_sigma)


@click.group()
def main() -> None:
    """Benchmarks of the calibration."""


@main.command()
@click.option("--pictures", default=4)
def centers(pictures: int) -> None:
    """Dot centres: error at 20 px diameter, SNR 30, blur 0.8 px, against the Cramér-Rao bound; bias without noise."""
    print("    tilt     k1   RMS px   CRB px  ratio  stated/RMS | noise-free: bias px  uncorrected px")
    for tilt, k1 in ((0, 0.0), (20, 0.0), (40, 0.0), (0, -0.3), (20, -0.3), (40, -0.3)):
        noisy = [_center_errors(tilt, k1, seed, snr=30.0) for seed in range(pictures)]
        clean = [_center_errors(tilt, k1, seed, snr=np.inf) for seed in range(pictures)]
        error, bound, stated = (np.concatenate([row[k] for row in noisy]) for k in (0, 1, 2))
        bias, raw = (np.concatenate([row[k] for row in clean]) for k in (0, 3))
        rms, crb, said = (float(np.sqrt((x**2).mean())) for x in (error, bound, stated))
        print(
            f"{tilt:8d} {k1:6.1f} {rms:8.4f} {crb:8.4f} {rms / crb:6.2f} {said / rms:11.2f} |"
            f" {np.sqrt((bias**2).mean()):19.4f} {np.sqrt((raw**2).mean()):15.4f}"
        )


def _center_errors(tilt: float, k1: float, seed: int, snr: float) -> tuple[Array, Array, Array, Array]:
    """Errors (n, 2), their bound (n, 2), stated sigmas (n, 2), and errors with discs uncorrected."""
    rng = np.random.default_rng(seed)
    gauge = gauge_of(2.4, 1.0, 13, 9)
    camera = camera_above(
        size_px=SIZE_PX,
        focal_px=900,
        distance_mm=45,
        tilt_deg=tilt,
        tilt_azimuth_deg=rng.uniform(0, 360),
        turn_deg=rng.uniform(0, 30),
        center_mm=tuple(rng.uniform(-0.5, 0.5, 2)),
        k1=k1,
    )
    blur = 0.8
    picture = draw_gauge(camera, gauge, rng=rng, snr=snr, blur_px=blur, quantise=False)
    dots = detect_dots(picture, "black", "white")
    points = np.column_stack([gauge.positions_mm().reshape(-1, 2), np.zeros(13 * 9)])
    predicted = fitted_centers(points, np.full(len(points), 0.5), camera.parameters, camera.lens)
    distance = np.hypot(*(dots.centers_px[:, None] - predicted[None]).transpose(2, 0, 1))
    own = distance.argmin(axis=1)
    near = distance[np.arange(len(own)), own] < 3
    own, center = own[near], dots.centers_px[near]
    stated = np.sqrt(np.einsum("nii->ni", dots.covariance_px2[near]))
    bound = _bound(dots.shape[near], blur, 30.0)
    return center - predicted[own], bound, stated, center - camera.picture_from_plate(points)[own]


def _bound(shape: Array, blur_px: float, snr: float) -> Array:
    """Cramér-Rao bound of both coordinates of a blurred ellipse whose other parameters are even and so do not matter.

    The Fisher information is snr² ∮ n nᵀ dl / (2 √π s), s² = blur² + 1/12 for the pixel.
    """
    angle = np.arange(64) * (2 * np.pi / 64)
    s = np.sqrt(blur_px**2 + 1 / 12)
    bounds = []
    for a11, a12, a22 in shape:
        half = np.linalg.inv(np.linalg.cholesky(np.array([[a11, a12], [a12, a22]]))).T
        rim = half @ np.stack([np.cos(angle), np.sin(angle)])
        step = np.roll(rim, -1, axis=1) - np.roll(rim, 1, axis=1)
        length = np.hypot(*step)
        normal = np.stack([step[1], -step[0]]) / length
        information = snr**2 * (normal * length / 2) @ normal.T / (2 * np.sqrt(np.pi) * s)
        bounds.append(np.sqrt(np.diag(np.linalg.inv(information))))
    return np.array(bounds)


@main.command()
@click.option("--sets", default=10)
@click.option("--snr", default=30.0)
def plane(sets: int, snr: float) -> None:
    """Plane at mark height: 10 px/mm, 7 pictures of a 17 × 13 gauge, tilt to 20 degrees, plate partly out of view."""
    gauge = gauge_of(3.5, 1.4)
    results = []
    for seed in range(sets):
        rng = np.random.default_rng(seed)
        truth = camera_above(
            size_px=SIZE_PX, focal_px=1500, distance_mm=150, tilt_deg=3, tilt_azimuth_deg=rng.uniform(0, 360), k1=-0.2
        )
        pictures = [
            draw_gauge(view, gauge, rng=rng, snr=snr) for view in random_poses(truth, 7, rng, tilt_deg=20, shift_mm=8)
        ]
        results.append(errors(truth, calibrate(pictures, gauge).camera))
    rms, scale = np.array([r.rms_um for r in results]), np.array([r.scale for r in results])
    print(
        f"{sets} sets, SNR {snr:g}: plane {np.sqrt((rms**2).mean()):.2f} µm RMS (worst set {rms.max():.2f}), "
        f"scale {100 * np.sqrt((scale**2).mean()):.4f} % RMS (worst {100 * np.abs(scale).max():.4f} %)"
    )


def random_camera(rng: np.random.Generator) -> tuple[Camera, Gauge, float]:
    """A camera with a field of 20 to 120 mm, mild distortion to fisheye, its gauge and field's width."""
    field = float(np.exp(rng.uniform(np.log(20), np.log(120))))
    fisheye = rng.random() < 0.3
    focal = SIZE_PX[0] * (rng.uniform(0.5, 1.2) if fisheye else rng.uniform(0.9, 3.0))
    camera = camera_above(
        size_px=SIZE_PX,
        focal_px=focal,
        distance_mm=focal * field / SIZE_PX[0],
        tilt_deg=rng.uniform(0, 8),
        tilt_azimuth_deg=rng.uniform(0, 360),
        turn_deg=rng.uniform(-10, 10),
        lens="fisheye" if fisheye else "brown",
        k1=rng.uniform(-0.05, 0.05) if fisheye else rng.uniform(-0.3, 0.05),
        k2=0.0 if fisheye else rng.uniform(0, 0.1),
        principal_offset_px=tuple(rng.normal(0, 8, 2)),
    )
    return camera, gauge_of(field / 18, field / 54), field


@main.command()
@click.option("--cameras", default=300)
@click.option("--first", default=0, help="First seed.")
@click.option("--verbose", is_flag=True)
def coverage(cameras: int, first: int, verbose: bool) -> None:
    """Stated 95 % intervals at mark height against the truth of random cameras."""
    inside, scales, failed, spread = [], [], 0, []
    for seed in range(first, first + cameras):
        rng = np.random.default_rng(seed)
        truth, gauge, field = random_camera(rng)
        views = random_poses(truth, 7, rng, tilt_deg=20, shift_mm=0.12 * field)
        pictures = [draw_gauge(view, gauge, rng=rng, snr=30) for view in views]
        height = 0.04 * truth.value("translation_z_mm")  # the share that marks have at 150 mm
        try:
            found = calibrate(pictures, gauge)
        except CalibrationError as error:
            failed += 1
            print(f"camera {seed}: {error}")
            continue
        result = errors(truth, found.camera, height)
        inside.append(float((np.abs(result.z) < 1.96).mean()))
        scales.append(abs(result.scale_z) < 1.96)
        spread.append(float(np.sqrt((result.z**2).mean())))
        if verbose:
            print(
                f"{seed:4d} {truth.lens:8s} f {truth.value('focal_px'):6.0f} k1 {truth.value('k1'):6.3f} "
                f"field {field:5.0f} -> {found.camera.lens:8s} {'+'.join(found.fit.state.free):60s} "
                f"z {spread[-1]:6.2f} scale {result.scale_z:6.2f} rms {result.rms_um:7.2f} um "
                f"var {found.fit.variance:.3f} out {sum(found.rejected)}"
            )
    print(
        f"{cameras} cameras, {failed} not solved: {100 * np.mean(inside):.1f} % of the coordinates and "
        f"{100 * np.mean(scales):.1f} % of the scales lie within their 95 % interval; "
        f"median RMS z {np.median(spread):.2f}"
    )


@main.command()
@click.option("--sets", default=4)
def opencv(sets: int) -> None:
    """The same pictures through findCirclesGrid + calibrateCamera, and through ours."""
    print("  set                    |  OpenCV solved  plane um   time s |  ours solved  plane um   time s")
    for label, snr, shift in (
        ("clean, all in view", np.inf, 0.0),
        ("clean, partly out of view", np.inf, 8.0),
        ("SNR 30, partly out", 30.0, 8.0),
    ):
        totals: dict[str, list[float]] = {"cv": [], "ours": [], "cv_um": [], "um": [], "cv_s": [], "s": []}
        gauge = gauge_of(3.0 if shift == 0 else 3.5, 1.2)
        for seed in range(sets):
            rng = np.random.default_rng(seed)
            truth = camera_above(
                size_px=SIZE_PX, focal_px=1500, distance_mm=150, tilt_deg=3, tilt_azimuth_deg=40.0 * seed, k1=-0.2
            )
            views = random_poses(truth, 7, rng, tilt_deg=20, shift_mm=shift)
            pictures = [draw_gauge(view, gauge, rng=rng, snr=snr).astype(np.uint8) for view in views]
            start = time.perf_counter()
            share, found = _opencv(pictures, gauge)
            totals["cv_s"].append(time.perf_counter() - start)
            totals["cv"].append(share)
            totals["cv_um"].append(np.nan if found is None else errors(truth, found).rms_um)
            start = time.perf_counter()
            ours = calibrate(pictures, gauge)
            totals["s"].append(time.perf_counter() - start)
            totals["ours"].append(len(ours.views))
            totals["um"].append(errors(truth, ours.camera).rms_um)
        mean = {
            key: float(np.nanmedian(value)) if not np.all(np.isnan(value)) else np.nan for key, value in totals.items()
        }
        print(
            f"{label:24s} | {sum(totals['cv']):8.0f} of {7 * sets:2d} {mean['cv_um']:9.2f} {mean['cv_s']:8.2f} |"
            f" {sum(totals['ours']):5.0f} of {7 * sets:2d} {mean['um']:9.2f} {mean['s']:8.2f}"
        )


def _opencv(pictures: list[NDArray[np.uint8]], gauge: Gauge) -> tuple[int, Camera | None]:
    """Pictures solved, and the camera in the frame of the first picture, None where that one is not solved."""
    places = gauge.positions_mm()
    shape = (gauge.dots.columns, gauge.dots.rows)
    plate = np.column_stack([places.reshape(-1, 2), np.zeros(places[..., 0].size)]).astype(np.float32)
    found = []
    for k, picture in enumerate(pictures):
        good, centers = cv2.findCirclesGrid(picture, shape, flags=cv2.CALIB_CB_SYMMETRIC_GRID)
        if good:
            # the grid may come back turned by half a turn; the plate's first dot is at the top left
            row_major = centers.reshape(-1, 2)
            ordered = row_major[::-1] if row_major[0].sum() > row_major[-1].sum() else row_major
            found.append((k, np.ascontiguousarray(ordered[:, None], dtype=np.float32)))
    if not found or found[0][0] != 0:
        return len(found), None
    _, matrix, bent, turns, shifts = cv2.calibrateCamera(
        [plate] * len(found), [c for _, c in found], SIZE_PX, None, None
    )
    parameters = np.zeros(16)
    parameters[:3], parameters[3:6] = turns[0][:, 0], shifts[0][:, 0]
    parameters[6:10] = matrix[0, 0], matrix[1, 1] / matrix[0, 0], matrix[0, 2], matrix[1, 2]
    parameters[10:15] = bent.ravel()[:5]
    return len(found), replace(
        camera_above(size_px=SIZE_PX, focal_px=1, distance_mm=1), parameters=parameters, covariance=np.eye(16)
    )


@main.command()
def speed() -> None:
    """Best of several runs, first call (compilation) left out."""
    for size, columns, rows, limit in (((640, 480), 30, 20, 0.030), ((2560, 2160), 90, 70, 1.0)):
        field = 60.0
        gauge = gauge_of(field / (columns + 1), 0.45 * field / (columns + 1), columns, rows)
        camera = camera_above(size_px=size, focal_px=2.5 * size[0], distance_mm=2.5 * field, k1=-0.2)
        picture = draw_gauge(camera, gauge, rng=np.random.default_rng(0), snr=30)
        times, work = [], []
        for _ in range(8):
            start, busy = time.perf_counter(), time.process_time()
            dots = detect_dots(picture, "black", "white")
            lattice = assign_grid(dots)
            times.append(time.perf_counter() - start)
            work.append(time.process_time() - busy)
        spacing = float(np.median(nearest(dots.centers_px, 1)[0]))
        peer = _findcircles_time(picture, columns, rows) if size == SIZE_PX else "minutes, not run"
        print(
            f"{size[0]}×{size[1]}, {len(lattice)} of {columns * rows} dots {spacing:.0f} px apart: "
            f"{1e3 * min(times):.0f} ms, {1e3 * min(work):.0f} ms of processor time "
            f"(asked {1e3 * limit:.0f} ms); OpenCV findCirclesGrid: {peer}"
        )


def _findcircles_time(picture: NDArray[np.generic], columns: int, rows: int) -> str:
    start = time.perf_counter()
    good, _ = cv2.findCirclesGrid(picture, (columns, rows), flags=cv2.CALIB_CB_SYMMETRIC_GRID)
    return f"{1e3 * (time.perf_counter() - start):.0f} ms, {'found' if good else 'not found'}"


@main.command()
@click.argument("picture", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--columns", default=102, help="Any size that holds the array will do.")
@click.option("--rows", default=80)
def straight(picture: Path, columns: int, rows: int) -> None:
    """Distance of dots from straight lines through their rows and columns, before and after correction.

    After correction a pixel is the pitch in the middle of the picture divided by its pixels. "All" are the dots that
    were given a place of the gauge, "kept" those that the solver did not leave out as outliers.
    """
    found = calibrate([read_picture(picture)], gauge_of(1.0, 0.48, columns, rows))
    match, view = found.sightings[0].match, found.views[0]
    centers = found.sightings[0].dots.centers_px[match.dot]
    site = match.row * columns + match.column
    pitch_px = 1 / float(np.median(nearest(found.camera.plate_from_picture(centers, 0.0), 1)[0]))
    pitch_px *= float(np.median(nearest(centers, 1)[0]))
    corrected = found.camera.plate_from_picture(centers, 0.0) * pitch_px
    kept = np.isin(site, view.site)
    print(
        f"{len(centers)} dots, {int(kept.sum())} kept; lens {found.camera.lens} with {', '.join(found.fit.state.free)}"
    )
    for label, points, own in (
        ("as seen, all", centers, np.ones(len(site), dtype=bool)),
        ("corrected, all", corrected, np.ones(len(site), dtype=bool)),
        ("corrected, kept", corrected, kept),
    ):
        off = np.concatenate([_off_lines(points[own], line[own]) for line in (match.row, match.column)])
        print(
            f"{label:16s} {np.sqrt((off**2).mean()):7.3f} px RMS, {np.median(np.abs(off)):6.3f} median, "
            f"{np.quantile(np.abs(off), 0.99):7.3f} 99 %, {np.abs(off).max():7.3f} largest"
        )


def _off_lines(points: Array, line: NDArray[np.int64]) -> Array:
    """Distances (signed) of points from the least-squares straight line of each line of at least three."""
    found = []
    for k in np.unique(line):
        own = points[line == k] - points[line == k].mean(axis=0)
        if len(own) >= 3:
            found.append(own @ np.linalg.svd(own, full_matrices=False)[2][1])
    return np.concatenate(found)


if __name__ == "__main__":
    main()
