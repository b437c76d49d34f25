"""Gauge images → camera model with uncertainty: pixels become millimetres on a plane above the plate.

The public names below are imported when they are first used, so that `import calibration` costs nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibration.assessment.quality import assess
    from calibration.assessment.verdict import Verdict
    from calibration.camera import Camera, camera_above
    from calibration.detection.dots import Dots
    from calibration.detection.image import read_image
    from calibration.errors import CalibrationError
    from calibration.estimation.calibrate import Calibration, calibrate
    from calibration.gauge.geometry import Gauge, load_gauge
    from calibration.store import camera_to_json, load_camera

__all__ = [
    "Calibration",
    "CalibrationError",
    "Camera",
    "Dots",
    "Gauge",
    "Verdict",
    "assess",
    "calibrate",
    "camera_above",
    "camera_to_json",
    "load_camera",
    "load_gauge",
    "read_image",
]

_HOMES = {
    "calibration.camera": ("Camera", "camera_above"),
    "calibration.detection.dots": ("Dots",),
    "calibration.errors": ("CalibrationError",),
    "calibration.gauge.geometry": ("Gauge", "load_gauge"),
    "calibration.detection.image": ("read_image",),
    "calibration.assessment.quality": ("assess",),
    "calibration.estimation.calibrate": ("Calibration", "calibrate"),
    "calibration.store": ("camera_to_json", "load_camera"),
    "calibration.assessment.verdict": ("Verdict",),
}


def __getattr__(name: str) -> object:
    """Import a public name from its home (PEP 562)."""
    from importlib import import_module

    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(home), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """Public names, also those that are not imported yet."""
    return sorted(__all__)
