"""The dot gauge as the camera sees it, on the plate, on a spacer or held at any tilt, with exact truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from matplotlib.colors import to_rgb
from numpy.typing import ArrayLike, NDArray

from calibration.camera import Camera
from calibration.gauge.geometry import Gauge, load_gauge
from simulator.errors import SimulationError
from simulator.rendering.backdrop import brushed_plate, overlay
from simulator.rendering.coverage import Kernel, add_polygon, blur_kernel
from simulator.rendering.painter import Disc, box_about, clockwise_hull, paint_disc
from simulator.rendering.plane import camera_from, plane_map
from simulator.rendering.scene import GaugeScene
from simulator.rendering.sensor import digitised

Array = NDArray[np.float64]
Numbers = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True)
class GaugePose:
    """Where the gauge is: takes gauge coordinates (z out of its face) to the plate frame."""

    rotation_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    translation_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)


def pose_of(scene: GaugeScene, gauge: Gauge) -> GaugePose:
    """Pose of a scene's gauge; the height of its dots adds to that of the scene."""
    turn, tilt, azimuth = np.radians([scene.turn_deg, scene.tilt_deg, scene.tilt_azimuth_deg])
    turning = cv2.Rodrigues(np.array([0.0, 0.0, turn]))[0]
    tilting = cv2.Rodrigues(np.array([-np.sin(azimuth), np.cos(azimuth), 0.0]) * tilt)[0]
    rotation = cv2.Rodrigues(tilting @ turning)[0][:, 0]
    height = scene.height_mm + gauge.dots.height_mm
    return GaugePose((float(rotation[0]), float(rotation[1]), float(rotation[2])), (scene.x_mm, scene.y_mm, height))


def render_gauge(scene: GaugeScene) -> tuple[Numbers, pd.DataFrame]:
    """Draw a gauge scene; returns the image and its truth (see `gauge_truth`).

    Raises SimulationError, or what reading the gauge file raises.
    """
    gauge, camera = load_gauge(scene.gauge), scene.camera.camera()
    pose = pose_of(scene, gauge)
    truth = gauge_truth(camera, gauge, pose, _absent(scene, gauge), printed_mm(scene, gauge))
    return _draw(scene, gauge, camera, pose), truth


def render_gauge_image(
    camera: Camera,
    gauge: Gauge,
    *,
    rotation_rad: ArrayLike = (0.0, 0.0, 0.0),
    translation_mm: ArrayLike | None = None,
    **scene: object,
) -> Numbers:
    """Draw a gauge from Python: (h, w, 3) numbers; fields of scene.toml go by keyword (seed, optics, sensor, …).

    rotation_rad, translation_mm: (3,) take gauge to plate coordinates; by default the gauge lies flat in the middle
    of the plate, its dots at gauge.dots.height_mm. Truth is in `gauge_truth` or `camera.image_from_plate`.
    """
    whole = GaugeScene.model_validate({"format": 1, "kind": "gauge", "gauge": Path("given"), **scene})
    rotation = tuple(np.asarray(rotation_rad, dtype=float).tolist())
    place = (0.0, 0.0, gauge.dots.height_mm) if translation_mm is None else translation_mm
    pose = GaugePose(rotation, tuple(np.asarray(place, dtype=float).tolist()))
    return _draw(whole, gauge, camera, pose)


def printed_mm(scene: GaugeScene, gauge: Gauge) -> Array:
    """True positions of the dots, (rows, columns, 2), mm in the gauge frame: nominal plus print errors."""
    nominal = gauge.positions_mm()
    rng = np.random.default_rng([scene.print_seed, 3])
    return np.asarray(nominal + scene.print_error_mm * rng.standard_normal(nominal.shape))


def gauge_truth(
    camera: Camera,
    gauge: Gauge,
    pose: GaugePose,
    absent: frozenset[tuple[int, int]] = frozenset(),
    positions_mm: Array | None = None,
) -> pd.DataFrame:
    """Exact truth, a row per dot.

    positions_mm: true positions of the dots on the gauge, if they are not the nominal ones. Columns: column, row; x_mm,
    y_mm in the gauge frame; plate_x_mm, plate_y_mm, plate_z_mm; x_px, y_px of the image of the dot's centre; visible,
    whether the dot exists and its centre is in the image.
    """
    positions = gauge.positions_mm() if positions_mm is None else positions_mm
    rows, columns = positions.shape[:2]
    row, column = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    flat = positions.reshape(-1, 2)
    on_gauge = np.column_stack([flat, np.zeros(len(flat))])
    on_plate = on_gauge @ cv2.Rodrigues(np.array(pose.rotation_rad))[0].T + np.array(pose.translation_mm)
    at_px = camera.image_from_plate(on_plate)
    size = np.array(camera.size_px)
    there = np.array([(int(c), int(r)) not in absent for c, r in zip(column.flat, row.flat, strict=True)])
    visible = ((at_px > -0.5) & (at_px < size - 0.5)).all(axis=1) & there
    return pd.DataFrame(
        {"column": column.ravel(), "row": row.ravel(), "x_mm": flat[:, 0], "y_mm": flat[:, 1]}
        | {f"plate_{axis}_mm": on_plate[:, k] for k, axis in enumerate("xyz")}
        | {"x_px": at_px[:, 0], "y_px": at_px[:, 1], "visible": visible}
    )


def _draw(scene: GaugeScene, gauge: Gauge, camera: Camera, pose: GaugePose) -> Numbers:
    kernel = blur_kernel(scene.optics.blur_px)
    rng = np.random.default_rng([scene.seed, 2])
    light = brushed_plate(scene.plate, scene.optics, plane_map(camera, 0.0, kernel.margin + 2), rng)
    seen_from_gauge = camera_from(camera, pose.rotation_rad, pose.translation_mm)
    _sheet(scene, gauge, seen_from_gauge, kernel, light)
    plane = plane_map(seen_from_gauge, 0.0, kernel.margin + 2)
    fiducials = {(fiducial.column, fiducial.row): fiducial for fiducial in gauge.fiducial}
    absent = _absent(scene, gauge)
    positions = printed_mm(scene, gauge)
    for row, column in np.ndindex(positions.shape[:2]):
        if (column, row) in absent:
            continue
        x, y = positions[row, column]
        fiducial = fiducials.get((column, row))
        color = (fiducial.color if fiducial else None) or gauge.dots.color
        diameter = (fiducial.diameter_mm if fiducial else None) or gauge.dots.diameter_mm
        paint_disc([Disc(plane, (x, y), diameter, 0.0, ink(color) * scene.paper)], kernel, light)
    for _ in range(scene.dirt_spots):
        place = rng.uniform(-0.5, 0.5, 2) * np.ptp(positions, axis=(0, 1))
        size = gauge.dots.diameter_mm * rng.uniform(0.1, 0.6)
        paint_disc([Disc(plane, tuple(place), size, 0.0, rng.uniform(0.05, 0.5) * np.ones(3))], kernel, light)
    light *= np.float32(scene.exposure.gain)
    light = overlay(scene, camera.size_px).applied(light)
    return digitised(np.ascontiguousarray(light), scene.sensor, key=scene.seed << 24)


def _sheet(scene: GaugeScene, gauge: Gauge, camera: Camera, kernel: Kernel, light: NDArray[np.float32]) -> None:
    """Draw the gauge's sheet: its dots' outline and a margin about it."""
    reach = np.abs(gauge.positions_mm()).max(axis=(0, 1)) + gauge.dots.diameter_mm / 2 + scene.margin_mm
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * reach
    edge = np.concatenate([corners + k / 16 * (np.roll(corners, -1, axis=0) - corners) for k in range(16)])
    edge_px = camera.image_from_plate(np.column_stack([edge, np.zeros(len(edge))]))
    box = box_about(edge_px, kernel.margin + 2, camera.size_px)
    if box is None:
        raise SimulationError("the gauge is outside the image; move it, or the camera")
    left, top, right, bottom = box
    cover = np.zeros((bottom - top, right - left))
    add_polygon(clockwise_hull(edge_px), kernel.blur_px, box, 1.0, cover)
    region = light[top:bottom, left:right]
    region += (cover[..., None] * (ink(gauge.dots.background) * scene.paper - region)).astype(np.float32)


def _absent(scene: GaugeScene, gauge: Gauge) -> frozenset[tuple[int, int]]:
    dots = gauge.dots
    for dot in scene.missing:
        if dot.column >= dots.columns or dot.row >= dots.rows:
            raise SimulationError(
                f"missing dot ({dot.column}, {dot.row}) is not on a gauge of {dots.columns} × {dots.rows} dots"
            )
    return frozenset((dot.column, dot.row) for dot in scene.missing)


def ink(color: str) -> Array:
    """Light of an ink on white paper, (3,), from a name or "#rrggbb"; black reflects 4 %. Raises SimulationError."""
    try:
        written = np.array(to_rgb(color))
    except ValueError as error:
        raise SimulationError(f'color = "{color}": give a name such as "black" or "#rrggbb"') from error
    return np.asarray(0.04 + 0.96 * written**2.2)  # screen values follow a power of about 2.2
