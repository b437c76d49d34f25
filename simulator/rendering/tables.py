"""The tables of scene.toml: camera, optics, sensor, plate, light, motion, faults of the recording, encoding."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from calibration.camera import Camera, camera_above
from calibration.lens import LensModel
from calibration.store import load_camera
from simulator.errors import SimulationError
from simulator.mark_layout import Mark

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(strict=True, ge=0, le=1)]
Point = tuple[Finite, Finite]
Light = tuple[NotNegative, NotNegative, NotNegative]


def _fraction(value: Any) -> Any:
    """Frame rates are exact: 60, "60000/1001"; a decimal is taken as it is written."""
    try:
        return Fraction(str(value))
    except (ValueError, ZeroDivisionError) as error:
        raise ValueError('a frame rate is a number or a fraction such as "60000/1001"') from error


Rate = Annotated[Fraction, BeforeValidator(_fraction), Field(gt=0, le=100_000)]


class Table(BaseModel):
    """A table of scene.toml: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)


class CameraTable(Table):
    """Camera: a camera.json, or a pose and lens (see calibration.camera.camera_above)."""

    file: Path | None = None  # camera.json, instead of the following keys
    size_px: tuple[Annotated[int, Field(ge=16, le=16384)], Annotated[int, Field(ge=16, le=16384)]] = (640, 480)
    focal_px: Positive = 2250.0
    distance_mm: Positive = 150.0  # of the lens above the plate
    tilt_deg: Annotated[float, Field(strict=True, gt=-80, lt=80)] = 0.0  # of the optical axis from the vertical
    tilt_azimuth_deg: Finite = 0.0  # direction of the tilt in the plate frame
    turn_deg: Finite = 0.0  # rotation about the optical axis
    center_mm: Point = (0.0, 0.0)  # point of the plate on the optical axis
    k1: Finite = 0.0  # radial distortion
    k2: Finite = 0.0  # radial distortion
    lens: LensModel = "brown"
    principal_offset_px: Point = (0.0, 0.0)

    def camera(self) -> Camera:
        """Build the camera."""
        if self.file is not None:
            return load_camera(self.file)
        return camera_above(**self.model_dump(exclude={"file"}))


class Optics(Table):
    """Gaussian lens blur and vignetting."""

    blur_px: Annotated[float, Field(strict=True, ge=0, le=30)] = 0.8  # standard deviation
    vignetting: Share = 0.15  # share of the light lost in the corners


class Exposure(Table):
    """Exposure of each frame."""

    time_s: NotNegative = 0.004
    gain: Positive = 1.0  # 1: white paper just below full scale


class Sensor(Table):
    """Noise and quantisation of the sensor."""

    full_well_e: NotNegative = 12000.0  # electrons at full scale; 0: no photon noise
    read_noise_e: NotNegative = 20.0  # standard deviation
    black_level: Share = 0.02  # share of full scale
    bits: Literal[8, 10, 12, 16] = 8
    color: bool = True


class Plate(Table):
    """Plate of brushed metal."""

    brightness: Share = 0.34  # mean reflectance
    contrast: Share = 0.14  # of the brush marks
    brush_direction_deg: Finite = 12.0
    grain_mm: Positive = 0.09  # width of the brush marks
    sheen: Share = 0.25  # even reflection


class MarksLook(Table):
    """Appearance of the marks.

    NAME = [red, green, blue] of any mark; 1 is full scale. Others have the colour that their name begins with.
    """

    model_config = ConfigDict(extra="allow", frozen=True)
    __pydantic_extra__: dict[str, Light] = Field(init=False)

    rim_loss: Share = 0.08  # share of the light lost at the rim
    swap_colors: bool = False  # reverse the order of the colours

    def lights(self, layout: Sequence[Mark]) -> list[Light]:
        """Light of every mark. Raises SimulationError for a name without one."""
        known, said = _mark_colors(), self.__pydantic_extra__ or {}
        words = [mark.name.split("_", maxsplit=1)[0] if mark.kind == "color" else mark.kind for mark in layout]
        found = [said.get(mark.name) or known.get(word) for mark, word in zip(layout, words, strict=True)]
        if dark := [mark.name for mark, light in zip(layout, found, strict=True) if light is None]:
            raise SimulationError(
                f"the light of mark {dark[0]} is unknown; set {dark[0]} = [red, green, blue] in [marks]"
            )
        lights = [light for light in found if light is not None]
        return lights[::-1] if self.swap_colors else lights


@cache
def _mark_colors() -> dict[str, Light]:
    text = files("simulator.rendering").joinpath("mark_colors.toml").read_text(encoding="utf-8")
    return {name: tuple(light) for name, light in tomllib.loads(text).items()}


class Lighting(Table):
    """Uneven light: a linear gradient across the image, and a step in time."""

    gradient: Annotated[float, Field(strict=True, ge=0, lt=1)] = 0.0  # relative change across the image
    gradient_direction_deg: Finite = 0.0
    switched_at_s: Finite | None = None  # time before which the light has level_before
    level_before: NotNegative = 0.25


class Simulated(Table):
    """Motion by the simulator: the robot's physics under a command."""

    kind: Literal["simulate"]
    left_rpm: Finite
    right_rpm: Finite
    start_s: Finite = 0.0  # motors on
    stop_s: Finite | None = None  # motors off
    x_mm: Finite = 0.0  # start position
    y_mm: Finite = 0.0  # start position
    heading_deg: Finite = 0.0
    run_index: Annotated[int, Field(ge=0)] = 0  # number of the run in its session, for effects that drift
    steps: tuple[tuple[Finite, Finite, Finite], ...] = ()  # further (time_s, left_rpm, right_rpm), each until the next


class Given(Table):
    """Motion from a CSV with time_s, x_mm, y_mm, heading_deg, interpolated by a monotone cubic."""

    kind: Literal["poses"]
    file: Path  # CSV


class Circle(Table):
    """Steady turn from a pose at time 0 with a signed speed; at rest before start_s and after stop_s."""

    kind: Literal["circle"]
    radius_mm: Positive
    speed_mm_s: Finite
    side: Literal["left", "right"] = "left"
    x_mm: Finite = 0.0
    y_mm: Finite = 0.0
    heading_deg: Finite = 0.0
    start_s: Finite = 0.0
    stop_s: Finite | None = None


class Line(Table):
    """Straight run at a signed speed; at rest before start_s and after stop_s."""

    kind: Literal["line"]
    speed_mm_s: Finite
    x_mm: Finite = 0.0
    y_mm: Finite = 0.0
    heading_deg: Finite = 0.0
    start_s: Finite = 0.0
    stop_s: Finite | None = None


Motion = Annotated[Simulated | Given | Circle | Line, Field(discriminator="kind")]


Preset = Literal["ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower"]


class Encoding(Table):
    """Encoding of the video. "lossless" is H.264 in RGB at quantiser 0; ffv1 also stores 10 and 16 bits."""

    codec: Literal["h264", "lossless", "ffv1", "mjpeg"] = "h264"
    crf: Annotated[float, Field(strict=True, ge=0, le=51)] = 18.0  # of H.264
    preset: Preset | None = None  # of H.264; default fast, for lossless ultrafast
    quality: Annotated[int, Field(ge=1, le=31)] = 3  # of Motion JPEG; 1 is best
    chroma: Literal["420", "422", "444"] = "420"  # subsampling


class Timing(Table):
    """Faults of the recording: lost and repeated frames, jitter of the exposure times, interlaced fields."""

    dropped: tuple[Annotated[int, Field(ge=0)], ...] = ()  # frame numbers
    repeated: tuple[Annotated[int, Field(ge=1)], ...] = ()  # frame numbers
    jitter_s: NotNegative = 0.0  # standard deviation of the exposure times
    interlaced: Literal["no", "top_first", "bottom_first"] = "no"


class Glare(Table):
    """A Gaussian reflection at an image point."""

    x_px: Finite
    y_px: Finite
    radius_px: Positive  # standard deviation
    strength: Positive = 0.6  # share of full scale


class Wire(Table):
    """A wire in front of everything, straight between image points."""

    points_px: Annotated[tuple[Point, ...], Field(min_length=2)]
    width_px: Positive = 3.0
    color: Light = (0.05, 0.05, 0.05)  # red, green, blue; 1 is full scale


class Distractor(Table):
    """A coloured disc that is not a mark, at rest or moving over the plate."""

    x_mm: Finite
    y_mm: Finite
    diameter_mm: Positive = 1.0
    height_mm: NotNegative = 0.0
    color: Light = (0.2, 0.85, 0.3)  # red, green, blue; 1 is full scale
    velocity_mm_s: Point = (0.0, 0.0)
