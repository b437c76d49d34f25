"""The page of a calibration: verdict, next steps, figures and tables."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.assessment.next_image import Advice, image_notes
from calibration.assessment.verdict import Verdict
from calibration.assignment.lattice import Lattice
from calibration.camera import Camera
from calibration.detection.dots import Dots
from calibration.estimation.calibrate import Calibration
from calibration.estimation.flatness import QUADRATIC, TERMS
from evaluator.files import write_text, written_whole
from evaluator.report.figures.calibration import (
    coverage_map,
    distortion_map,
    gauge_face,
    plate_axes_px,
    residual_vectors,
)
from evaluator.report.figures.quality import camera_uncertainty
from evaluator.report.numbers import number
from evaluator.report.pages.html import Page, Section, Table, page_html
from evaluator.report.style import Figure
from evaluator.wording import counted

FACES = {0: "flat", QUADRATIC: "bent, second order", TERMS: "bent, third order"}


def write_calibration_page(
    calibration: Calibration, verdict: Verdict, advice: Advice, path: Path, tolerance_um: float
) -> None:
    """Write the page as one HTML file. tolerance_um: required 95 % half width of a coordinate at mark height."""
    camera = calibration.camera
    good = measurement_range(camera, verdict.mark_height_mm, tolerance_um)
    range_sentence = (
        f"Coordinates {verdict.mark_height_mm:g} mm above the plate are good to {tolerance_um:g} µm (95 %) in "
        f"{100 * good:.0f} % of the image."
    )
    notes = (*verdict.notes, *image_notes(advice, [view.name for view in calibration.views]))
    page = Page(
        kind="Calibration",
        title=calibration.gauge.name,
        facts=(
            counted(len(calibration.views), "image"),
            counted(sum(len(view) for view in calibration.views), "dot"),
            f"residual {calibration.rms_px:.3g} px RMS",
            f"{camera.lens} lens",
        ),
        summary=(
            _sentence(verdict.summary),
            range_sentence,
            *(f"Next: {step}." for step in verdict.next_steps),
            *([f"Another image would help: {advice.sentence}."] if advice.sentence else []),
        ),
        sections=(
            Section(
                "trust",
                "Uncertainty over the image",
                (),
                (
                    camera_uncertainty(camera, verdict.mark_height_mm),
                    coverage_map(calibration, advice.next if advice.sentence else None),
                ),
            ),
            Section("fit", "Fit of the camera model", (), _fit_figures(calibration)),
            Section("numbers", "Numbers", tuple(map(_sentence, notes)), (), _tables(calibration)),
        ),
        footer="Written by turnscope calibrate. Uncertainties are standard uncertainties unless 95 % is stated.",
    )
    write_text(path, page_html(page))


def _fit_figures(calibration: Calibration) -> tuple[Figure, ...]:
    face = gauge_face(calibration)
    always = residual_vectors(calibration), distortion_map(calibration.camera)
    return always if face is None else (*always, face)


def measurement_range(camera: Camera, height_mm: float, tolerance_um: float) -> float:
    """Share of the image in which both coordinates are within the tolerance (95 %), from the calibration alone."""
    width, height = camera.size_px
    points = np.stack(np.meshgrid(np.linspace(0, width - 1, 33), np.linspace(0, height - 1, 25)), axis=-1)
    sigma = np.sqrt(np.einsum("...ii->...i", camera.plate_covariance(points, height_mm)))
    with np.errstate(invalid="ignore"):
        return float(np.mean(1.96e3 * sigma.max(axis=-1) < tolerance_um))


def _tables(calibration: Calibration) -> tuple[Table, ...]:
    camera = calibration.camera
    named = [name for name in calibration.fit.state.free if camera.sigma(name) > 0]
    parameters = Table(
        "Fitted lens parameters.",
        ("parameter", "value", "standard uncertainty"),
        tuple((name, *_with_uncertainty(camera.value(name), camera.sigma(name))) for name in named),
    )
    images = Table(
        "Images; the first one defines the plate frame.",
        ("image", "dots used", "left out", "residual, px RMS"),
        tuple(
            (Path(view.name).name, str(len(view)), str(left_out), f"{np.sqrt(np.mean(residual**2)):.4f}")
            for view, left_out, residual in zip(
                calibration.views, calibration.rejected, calibration.fit.residual_px, strict=True
            )
        ),
    )
    models = Table(
        "Lens models compared by cross-validation; the first is the simplest that is not significantly worse than "
        "the best.",
        ("lens", "free parameters", "gauge", "held-out error, sigmas"),
        tuple(
            (trial.model, ", ".join(trial.free), FACES[trial.face], f"{np.sqrt(trial.held_out / 2):.4g}")
            for trial in calibration.trials
        ),
    )
    return parameters, images, models


def _with_uncertainty(value: float, sigma: float) -> tuple[str, str]:
    """A value and its uncertainty to the same decimals, two digits of the uncertainty."""
    decimals = max(0, 1 - int(np.floor(np.log10(sigma))))
    return number(value, decimals), number(sigma, decimals)


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:].rstrip(".") + "."


def write_plate_axes(image: NDArray[np.generic], camera: Camera, path: Path) -> None:
    """Write the image with x (red) and y (green) of the plate frame of camera.json."""
    shown, unit = _shown(image)
    ends = plate_axes_px(camera)
    if np.isfinite(ends).all():
        for (start, end), name, color in zip(ends, ("x", "y"), ((60, 60, 230), (90, 180, 40)), strict=True):
            a, b = (tuple(int(v) for v in np.rint(point)) for point in (start, end))
            cv2.arrowedLine(shown, a, b, color, 2 * unit, cv2.LINE_AA, tipLength=0.2)
            cv2.putText(shown, name, b, cv2.FONT_HERSHEY_SIMPLEX, 0.8 * unit, color, 2 * unit, cv2.LINE_AA)
    with written_whole(path) as temporary:
        temporary.write_bytes(cv2.imencode(".png", shown)[1].tobytes())


def _shown(image: NDArray[np.generic]) -> tuple[NDArray[np.uint8], int]:
    """An image of any type as 8-bit colour, and the width of a line on it, px."""
    low, high = float(image.min()), float(image.max())
    shown = ((image.astype(np.float32) - low) * (255 / max(high - low, 1e-9))).astype(np.uint8)
    shown = np.repeat(shown[:, :, None], 3, axis=2) if shown.ndim == 2 else shown
    return shown, max(1, round(max(shown.shape[:2]) / 1000))


def write_annotated(image: NDArray[np.generic], dots: Dots, lattice: Lattice, path: Path) -> None:
    """Write the image with assigned dots ringed in two colours (like a chessboard) and others crossed in red."""
    shown, unit = _shown(image)
    assigned = set(lattice.dot.tolist())
    for k, center in enumerate(dots.centers_px):
        if k not in assigned:
            place = tuple(int(v) for v in np.rint(center))
            cv2.drawMarker(shown, place, (60, 60, 230), cv2.MARKER_TILTED_CROSS, 8 * unit, unit)
    for k, index in zip(lattice.dot, lattice.index, strict=True):
        color = ((90, 180, 40), (220, 130, 30))[int(index.sum()) % 2]
        radius = max(2.0 * unit, 0.5 * float(dots.diameter_px[k]) + 1.5 * unit)
        # four fractional bits keep the ring centred on the sub-pixel centre
        place = tuple(int(v) for v in np.rint(16 * dots.centers_px[k]))
        cv2.circle(shown, place, int(16 * radius), color, unit, cv2.LINE_AA, 4)
    with written_whole(path) as temporary:
        temporary.write_bytes(cv2.imencode(".png", shown)[1].tobytes())
