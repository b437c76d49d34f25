"""Gauge images to camera.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibration.assessment.quality import assess
from calibration.assessment.verdict import Verdict
from calibration.camera import Camera
from calibration.detection.image import read_image
from calibration.estimation.calibrate import Calibration
from calibration.estimation.calibrate import calibrate as solve
from calibration.gauge.geometry import Gauge, load_gauge
from calibration.store import camera_to_json
from evaluator.errors import InputError
from evaluator.files import read_with, write_text
from evaluator.progress import Progress, no_progress


@dataclass(frozen=True, repr=False)
class Calibrated:
    """A solved camera with its verdict."""

    calibration: Calibration
    verdict: Verdict

    @property
    def camera(self) -> Camera:
        """The camera."""
        return self.calibration.camera

    def save(self, path: Path | str) -> None:
        """Write camera.json."""
        write_text(Path(path), camera_to_json(self.calibration, self.verdict))

    def __repr__(self) -> str:
        """One line: the images, the residual and the verdict."""
        found = self.calibration
        return f"Calibrated({len(found.views)} images, residual {found.rms_px:.3f} px RMS; {self.verdict.summary})"


def calibrate(
    images: Sequence[Path | str | np.ndarray[Any, Any]],
    gauge: Gauge | Path | str,
    *,
    plate: int = 0,
    distance_mm: tuple[float, float] | None = None,
    mark_height_mm: float = 6.5,
    progress: Progress = no_progress,
) -> Calibrated:
    """Solve the camera from images of the gauge.

    images: paths or arrays; plate: number of the one that shows the gauge lying on the plate; distance_mm: measured
    height of the lens above the plate and its sigma; mark_height_mm: where the marks ride, for the verdict.
    Raises InputError, CalibrationError.
    """
    if distance_mm is not None and not (distance_mm[0] > 0 and distance_mm[1] > 0):
        raise InputError(
            f"distance {distance_mm[0]} mm, sigma {distance_mm[1]} mm (--distance-mm): both must be positive"
        )
    described = gauge if isinstance(gauge, Gauge) else read_with(load_gauge, Path(gauge))
    progress("reading images", 0.0)
    read = [image if isinstance(image, np.ndarray) else read_image(Path(image)) for image in images]
    names = [
        f"image {number}" if isinstance(image, np.ndarray) else str(image) for number, image in enumerate(images, 1)
    ]
    progress("calibrating", 0.1)
    found = solve(read, described, plate, names=names, distance_mm=distance_mm)
    progress("assessing", 0.9)
    return Calibrated(found, assess(found, mark_height_mm))
