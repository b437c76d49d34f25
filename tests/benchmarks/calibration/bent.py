"""A gauge that is not flat: error of the plane at mark height and what the intervals say, with and without its face."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import click
import cv2
import numpy as np
from scipy.optimize import linprog

from calibration.camera import Camera
from calibration.estimation import gauge_as_printed as solve
from calibration.estimation.calibrate import calibrate
from calibration.estimation.flatness import TERMS, face_terms
from calibration.gauge.geometry import Gauge
from tests.benchmarks.calibration.rig import Array, errors, random_camera
from tests.calibration.drawing import draw_gauge, posed, random_poses


@click.command()
@click.option("--cameras", default=40)
@click.option("--bend", default=0.005, help="Peak to valley over the width of the field.")
@click.option("--images", default=7)
@click.option("--stated", is_flag=True, help="The gauge file states the flatness.")
@click.option("--verbose", is_flag=True)
def bent(cameras: int, bend: float, images: int, stated: bool, verbose: bool) -> None:
    """Random cameras and a rigid gauge bent at random.

    In the image on the plate it rests on its lowest points, which the solver cannot know: the intervals must hold the
    truth in the frame of that plate. The error in the frame of the gauge's mean plane shows what the face does.
    """
    rows: dict[str, list[tuple[float, float, float, bool]]] = {"flat": [], "face": []}
    peaks, heights = [], []
    for seed in range(cameras):
        rng = np.random.default_rng(seed)
        camera, gauge, field = random_camera(rng)
        face = np.tensordot(face_terms(gauge), rng.standard_normal(TERMS) * _STRENGTH, axes=1)
        face *= bend * field / np.ptp(face)
        if stated:
            gauge = gauge.model_copy(
                update={"tolerance": gauge.tolerance.model_copy(update={"flatness_mm": bend * field})}
            )
        views = random_poses(camera, images, rng, tilt_deg=20, shift_mm=0.12 * field)
        drawn = [draw_gauge(view, gauge, rng=rng, snr=30, face_mm=face) for view in views]
        truth = on_its_rest(camera, gauge, face)
        height = 0.04 * camera.value("translation_z_mm")
        for name, of in rows.items():
            with _flat_only(name == "flat"):
                found = calibrate(drawn, gauge)
            result = errors(truth, found.camera, height)
            of.append(
                (
                    errors(camera, found.camera, height).rms_um,
                    result.rms_um,
                    float((np.abs(result.z) < 1.96).mean()),
                    abs(result.scale_z) < 1.96,
                )
            )
        shape = found.flatness
        if shape is not None:
            true = float(np.ptp(face))
            peaks.append(shape.low_mm <= true <= shape.high_mm)
            heights.append(shape.peak_to_valley_mm / true - 1)
        if verbose:
            print(seed, rows["flat"][-1], rows["face"][-1], shape and (shape.used, shape.peak_to_valley_mm / true))
    for name, of in rows.items():
        mean, rest, inside, scale = (np.array(column, dtype=float) for column in zip(*of, strict=True))
        print(
            f"solved with a {name:4s}: plane {np.nanmedian(mean):.2f} µm RMS (median) about the mean plane, "
            f"{np.nanmedian(rest):.1f} on the plate; there {100 * inside.mean():.0f} % of the coordinates and "
            f"{100 * scale.mean():.0f} % of the scales lie within 95 %"
        )
    if peaks:
        print(
            f"peak to valley to {100 * np.median(np.abs(heights)):.1f} % (median), {100 * np.mean(peaks):.0f} % within "
            "95 %"
        )


_STRENGTH = np.array([1, 1, 1, 0.3, 0.3, 0.3, 0.3])


@contextmanager
def _flat_only(flat: bool) -> Iterator[None]:
    """Solve as if every gauge were flat."""
    faces = solve._faces
    try:
        if flat:
            solve._faces = lambda *_: (0,)
        yield
    finally:
        solve._faces = faces


def on_its_rest(camera: Camera, gauge: Gauge, face_mm: Array) -> Camera:
    """The camera in the frame of the plate on which a rigid face stands.

    That is the plane below all of it that is highest under its middle.
    """
    place = gauge.positions_mm().reshape(-1, 2)
    below = np.column_stack([np.ones(len(place)), place])
    middle = below.mean(axis=0)
    offset, by_x, by_y = linprog(-middle, below, face_mm.ravel(), bounds=[(None, None)] * 3).x
    normal = np.array([-by_x, -by_y, 1.0]) / np.sqrt(1 + by_x**2 + by_y**2)
    axis = np.cross([0, 0, 1], normal)
    turn = cv2.Rodrigues(axis)[0]  # small: the sine is the angle to 1e-6
    return posed(camera, turn, np.array([0.0, 0.0, offset]))
