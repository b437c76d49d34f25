"""camera.json: the camera with its covariance and verdict.

Parameters are named as in camera.py; `covariance` is their full matrix in that order. If `verdict.level` is not
"sound", `verdict.reasons` are attached to the camera as its `doubt`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import AliasChoices, BaseModel, ConfigDict, Field, PositiveInt, ValidationError

from calibration.assessment.verdict import Verdict
from calibration.camera import PARAMETERS, Camera
from calibration.errors import CalibrationError
from calibration.gauge.geometry import Gauge
from calibration.lens import LensModel

if TYPE_CHECKING:  # a camera is read far more often than solved: reading one must not wait for the solver's libraries
    from calibration.assessment.next_image import Advice
    from calibration.estimation.calibrate import Calibration
    from calibration.estimation.flatness import Flatness


class Table(BaseModel):
    """A table of camera.json."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class StoredImage(Table):
    """One image of the set: dots used, residual, and factor on the uncertainty of positions without it."""

    name: str
    dots: int  # used
    left_out: int  # rejected dots
    rms_px: float  # residual
    gain: float | None = None  # factor on the uncertainty without this image
    adds_nothing: bool = False


class StoredNextImage(Table):
    """The most useful further image: sentence, outline of the gauge, and uncertainty of positions, mm."""

    sentence: str
    outline_px: tuple[tuple[float, float], ...]
    before_mm: float
    after_mm: float


class StoredFlatness(Table):
    """Shape of the gauge's face over its array: peak to valley with its 95 % interval, mm; see flatness.py.

    used: whether the camera was solved with it; otherwise the face was assumed to be flat, and high_mm bounds its bend.
    """

    peak_to_valley_mm: float
    low_mm: float
    high_mm: float
    used: bool
    coefficients_mm: tuple[float, ...]


class CameraFile(Table):
    """camera.json."""

    format: Literal[1]
    kind: Literal["camera"] = "camera"
    size_px: tuple[PositiveInt, PositiveInt] = Field(description="width, height")
    lens: LensModel
    parameters: dict[str, float]  # value by name, see camera.py
    sigma: dict[str, float]  # standard uncertainty by name
    free: tuple[str, ...]  # fitted lens parameters
    covariance: tuple[tuple[float, ...], ...]  # of all parameters, in their order
    gauge: Gauge
    variance: float = Field(description="of unit weight: scatter of the residuals over the stated uncertainty, squared")
    # Files written before November 2026 call them "pictures".
    images: tuple[StoredImage, ...] = Field(validation_alias=AliasChoices("images", "pictures"))
    rms_px: float  # residual per axis
    verdict: Verdict  # quality of the calibration
    flatness: StoredFlatness | None = None  # of the gauge
    pitch_error: tuple[float, ...] | None = Field(
        default=None,
        description="what one standard deviation of the gauge's pitch does to the parameters; part of the covariance",
    )
    left_out: dict[str, str] = Field(default={}, description="images that were not used, with the reason")
    next_image: StoredNextImage | None = None  # most useful further image

    def camera(self) -> Camera:
        """The camera; if its verdict is not sound, the reasons are its doubt."""
        return Camera(
            size_px=self.size_px,
            parameters=np.array([self.parameters[name] for name in PARAMETERS]),
            lens=self.lens,
            covariance=np.array(self.covariance),
            pitch_error=np.zeros(len(PARAMETERS)) if self.pitch_error is None else np.array(self.pitch_error),
            doubt="" if self.verdict.level == "sound" else self.verdict.summary,
        )


def camera_to_json(calibration: Calibration, verdict: Verdict | None = None, advice: Advice | None = None) -> str:
    """Text of camera.json."""
    from calibration.assessment.next_image import advise
    from calibration.assessment.quality import assess

    camera = calibration.camera
    verdict = verdict or assess(calibration)
    advice = advice or advise(calibration, verdict.mark_height_mm)
    stored = CameraFile(
        format=1,
        size_px=camera.size_px,
        lens=camera.lens,
        parameters={name: camera.value(name) for name in PARAMETERS},
        sigma={name: camera.sigma(name) for name in PARAMETERS},
        free=calibration.fit.state.free,
        covariance=tuple(tuple(row) for row in camera.covariance.tolist()),
        gauge=calibration.gauge,
        variance=calibration.fit.variance,
        images=tuple(
            StoredImage(
                name=sighting.name,
                dots=len(view),
                left_out=left_out,
                rms_px=float(np.sqrt(np.mean(residual**2))),
                gain=None if np.isnan(advice.gains[k]) else advice.gains[k],
                adds_nothing=advice.adds_nothing(k),
            )
            for k, (sighting, view, left_out, residual) in enumerate(
                zip(
                    calibration.sightings,
                    calibration.views,
                    calibration.rejected,
                    calibration.fit.residual_px,
                    strict=True,
                )
            )
        ),
        rms_px=calibration.rms_px,
        verdict=verdict,
        pitch_error=tuple(camera.pitch_error.tolist()),
        left_out=dict(calibration.left_out),
        flatness=None if calibration.flatness is None else _stored_flatness(calibration.flatness),
        next_image=None
        if (best := advice.next) is None
        else StoredNextImage(
            sentence=best.sentence, outline_px=best.outline_px, before_mm=best.before_mm, after_mm=best.after_mm
        ),
    )
    return json.dumps(stored.model_dump(mode="json"), indent=1) + "\n"


def _stored_flatness(found: Flatness) -> StoredFlatness:
    return StoredFlatness(
        peak_to_valley_mm=found.peak_to_valley_mm,
        low_mm=found.low_mm,
        high_mm=found.high_mm,
        used=found.used,
        coefficients_mm=tuple(found.coefficients_mm.tolist()),
    )


def load_camera_file(path: Path) -> CameraFile:
    """Read the whole camera.json. Raises OSError and CalibrationError."""
    path = Path(path)
    try:
        stored = CameraFile.model_validate_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise CalibrationError(
            f"{path}: does not exist; create it with turnscope calibrate from images of the gauge"
        ) from error
    except UnicodeDecodeError as error:
        raise CalibrationError(f"{path}: not a text file; expected a camera.json from turnscope calibrate") from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "the file"
        raise CalibrationError(
            f"{path}: not a camera.json from turnscope calibrate ({place}: {first['msg'].lower()})"
        ) from error
    count = len(PARAMETERS)
    whole = [len(row) for row in stored.covariance] == [count] * count and len(
        stored.pitch_error or PARAMETERS
    ) == count
    if set(stored.parameters) != set(PARAMETERS) or not whole:
        raise CalibrationError(f"{path}: parameters or covariance are incomplete; run turnscope calibrate again")
    return stored


def load_camera(path: Path) -> Camera:
    """Read the camera of camera.json. Raises OSError and CalibrationError."""
    return load_camera_file(path).camera()
