"""What the benchmarks of the calibration share: gauges, random cameras, and errors against the true camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.camera import Camera, camera_above
from calibration.gauge.geometry import Gauge

Array = NDArray[np.float64]
SIZE_PX = (640, 480)
MARK_HEIGHT_MM = 6.5


def gauge_of(pitch_mm: float, diameter_mm: float, columns: int = 17, rows: int = 13) -> Gauge:
    dots = {
        "columns": columns,
        "rows": rows,
        "pitch_mm": pitch_mm,
        "diameter_mm": diameter_mm,
        "pitch_tolerance_percent": 0.0,
    }
    return Gauge.model_validate({"format": 1, "name": "benchmark", "dots": dots})


def field_points(size_px: tuple[int, int] = SIZE_PX) -> Array:
    """A grid of image points that fills the field to its rim."""
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
    true = truth.plate_from_image(points, height_mm)
    seen = np.isfinite(true).all(axis=1)
    points, true = points[seen], true[seen]
    error = found.plate_from_image(points, height_mm) - true
    sensitivity = found.plate_sensitivity(points, height_mm)
    sigma = np.sqrt(np.einsum("nij,jk,nik->ni", sensitivity, found.covariance, sensitivity))
    # least-squares scale of the found points against the true ones
    centered, moved = true - true.mean(axis=0), error - error.mean(axis=0)
    weight = centered / (centered**2).sum()
    scale = float((weight * moved).sum())
    slope = np.einsum("ni,nij->j", weight, sensitivity)
    scale_sigma = float(np.sqrt(slope @ found.covariance @ slope))
    return Errors(1e3 * float(np.sqrt((error**2).sum(axis=1).mean())), scale, error / sigma, scale / scale_sigma)


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
