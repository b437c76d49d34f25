"""Gauge images to camera.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration.assessment.next_image import Advice, advise
from calibration.assessment.quality import assess
from calibration.assessment.verdict import Verdict
from calibration.camera import Camera
from calibration.detection.image import read_image
from calibration.errors import CalibrationError
from calibration.estimation.calibrate import Calibration
from calibration.estimation.calibrate import calibrate as solve
from calibration.gauge.geometry import Gauge, load_gauge
from calibration.store import camera_to_json
from evaluator.errors import InputError
from evaluator.files import read_with, write_text
from evaluator.progress import Progress, no_progress

Image = np.ndarray[Any, Any]


@dataclass(frozen=True, repr=False)
class Calibrated:
    """A solved camera with its verdict, and advice on its images."""

    calibration: Calibration
    verdict: Verdict
    advice: Advice

    @property
    def camera(self) -> Camera:
        """The camera."""
        return self.calibration.camera

    def save(self, path: Path | str) -> None:
        """Write camera.json."""
        write_text(Path(path), camera_to_json(self.calibration, self.verdict, self.advice))

    def __repr__(self) -> str:
        """One line: the images, the residual and the verdict."""
        found = self.calibration
        return f"Calibrated({len(found.views)} images, residual {found.rms_px:.3f} px RMS; {self.verdict.summary})"


def calibrate(
    images: Sequence[Path | str | Image],
    gauge: Gauge | Path | str,
    *,
    plate: int = 0,
    distance_mm: tuple[float, float] | None = None,
    mark_height_mm: float = 6.5,
    strict: bool = False,
    progress: Progress = no_progress,
) -> Calibrated:
    """Solve the camera from images of the gauge.

    images: paths or arrays; plate: index of the image with the gauge on the plate; distance_mm: measured height of the
    lens above the plate and its sigma; mark_height_mm: height of the marks, for the verdict. strict: whether an image
    that cannot be used is an error; otherwise it is excluded and listed, if enough images remain.
    Raises InputError, CalibrationError.
    """
    if distance_mm is not None and not (distance_mm[0] > 0 and distance_mm[1] > 0):
        raise InputError(
            f"distance {distance_mm[0]} mm, sigma {distance_mm[1]} mm (--distance-mm): both must be positive"
        )
    described = gauge if isinstance(gauge, Gauge) else read_with(load_gauge, Path(gauge))
    progress("reading images", 0.0)
    read, unreadable = _read(images, plate, strict=strict)
    progress("calibrating", 0.1)
    found = solve(
        list(read.values()),
        described,
        list(read).index(_name(images[plate], plate)),
        names=list(read),
        distance_mm=distance_mm,
        strict=strict,
        left_out=unreadable,
    )
    progress("assessing", 0.9)
    return Calibrated(found, assess(found, mark_height_mm), advise(found, mark_height_mm))


def _name(image: Path | str | Image, k: int) -> str:
    return f"image {k + 1}" if isinstance(image, np.ndarray) else str(image)


def _read(
    images: Sequence[Path | str | Image], plate: int, *, strict: bool
) -> tuple[dict[str, Image], list[tuple[str, str]]]:
    """Images by their names, and those that cannot be read with the reason; that of the plate must be readable."""
    read: dict[str, Image] = {}
    unreadable = []
    for k, image in enumerate(images):
        name = _name(image, k)
        try:
            read[name] = image if isinstance(image, np.ndarray) else read_image(Path(image))
        except CalibrationError as error:
            if strict or k == plate or len(images) == 1:
                raise
            unreadable.append((name, str(error).removeprefix(f"{name}: ")))
    return read, unreadable
