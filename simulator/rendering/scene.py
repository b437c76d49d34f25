"""scene.toml: what stands under which camera, how it moves, and how it is recorded.

A scene is a run of the robot (kind "run", the default: a video) or a gauge (kind "gauge": a picture).
"""

from __future__ import annotations

import tomllib
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from calibration.camera import Camera, camera_above
from calibration.lens import LensModel
from calibration.store import load_camera
from simulator.errors import SimulationError

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
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
    """Where the camera stands: the arguments of calibration.camera.camera_above, or a camera.json."""

    file: Path | None = None
    size_px: tuple[Annotated[int, Field(ge=16, le=16384)], Annotated[int, Field(ge=16, le=16384)]] = (640, 480)
    focal_px: Positive = 2250.0
    distance_mm: Positive = 150.0
    tilt_deg: Annotated[float, Field(gt=-80, lt=80)] = 0.0
    tilt_azimuth_deg: Finite = 0.0
    turn_deg: Finite = 0.0
    center_mm: Point = (0.0, 0.0)
    k1: Finite = 0.0
    k2: Finite = 0.0
    lens: LensModel = "brown"
    principal_offset_px: Point = (0.0, 0.0)

    def camera(self) -> Camera:
        """Build the camera."""
        if self.file is not None:
            return load_camera(self.file)
        return camera_above(**self.model_dump(exclude={"file"}))


class Optics(Table):
    """Lens blur as the standard deviation of a Gaussian; vignetting: share of the light lost in the corners."""

    blur_px: Annotated[float, Field(ge=0, le=30)] = 0.8
    vignetting: Share = 0.15


class Exposure(Table):
    """How long each frame collects light, and the gain on it (1: white paper just below full scale)."""

    time_s: NotNegative = 0.004
    gain: Positive = 1.0


class Sensor(Table):
    """Photon noise by the electrons of a full pixel (0: none), read noise, pedestal and bits of a number."""

    full_well_e: NotNegative = 12000.0
    read_noise_e: NotNegative = 20.0
    black_level: Share = 0.02
    bits: Literal[8, 10, 12, 16] = 8
    color: bool = True


class Plate(Table):
    """Brushed metal: mean reflectance, contrast of the brush marks, their direction and width; an even sheen."""

    brightness: Share = 0.34
    contrast: Share = 0.14
    brush_direction_deg: Finite = 12.0
    grain_mm: Positive = 0.09
    sheen: Share = 0.25


class MarksLook(Table):
    """Light of the marks (red, green, blue; 1 is full scale), loss of light at their rim, and whether colours swap."""

    green: Light = (0.16, 0.86, 0.26)
    yellow: Light = (0.92, 0.82, 0.12)
    rim_loss: Share = 0.08
    swap_colors: bool = False


class Lighting(Table):
    """Uneven light: a linear change across the picture, and a moment before which the light is at another level."""

    gradient: Annotated[float, Field(ge=0, lt=1)] = 0.0
    gradient_direction_deg: Finite = 0.0
    switched_at_s: Finite | None = None
    level_before: NotNegative = 0.25


class Simulated(Table):
    """Motion by the simulator: the robot's physics under a command."""

    kind: Literal["simulate"]
    left_rpm: Finite
    right_rpm: Finite
    start_s: Finite = 0.0
    stop_s: Finite | None = None
    x_mm: Finite = 0.0
    y_mm: Finite = 0.0
    heading_deg: Finite = 0.0


class Given(Table):
    """Motion from a CSV of time_s, x_mm, y_mm, heading_deg; between its rows a monotone cubic."""

    kind: Literal["poses"]
    file: Path


class Circle(Table):
    """Steady turn: the pose at time 0, a signed speed and a radius, left or right; at rest outside start and stop."""

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
    """Straight run at a signed speed; at rest outside start and stop."""

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
    """How the video is stored. "lossless" is H.264 in RGB at quantiser 0; ffv1 keeps 10 and 16 bits too."""

    codec: Literal["h264", "lossless", "ffv1", "mjpeg"] = "h264"
    crf: Annotated[float, Field(ge=0, le=51)] = 18.0
    preset: Preset | None = None  # of H.264; veryfast if not told, ultrafast where lossless
    quality: Annotated[int, Field(ge=1, le=31)] = 3
    chroma: Literal["420", "422", "444"] = "420"


class Timing(Table):
    """Faults of a recorder: frames lost, frames written twice, jitter of the exposure times, interlaced fields."""

    dropped: tuple[Annotated[int, Field(ge=0)], ...] = ()
    repeated: tuple[Annotated[int, Field(ge=1)], ...] = ()
    jitter_s: NotNegative = 0.0
    interlaced: Literal["no", "top_first", "bottom_first"] = "no"


class Glare(Table):
    """A reflection that adds light: Gaussian about a picture point, radius as its standard deviation."""

    x_px: Finite
    y_px: Finite
    radius_px: Positive
    strength: Positive = 0.6


class Wire(Table):
    """A wire in front of everything, straight between picture points."""

    points_px: Annotated[tuple[Point, ...], Field(min_length=2)]
    width_px: Positive = 3.0
    color: Light = (0.05, 0.05, 0.05)


class Distractor(Table):
    """A coloured disc that is no mark, at rest or moving over the plate."""

    x_mm: Finite
    y_mm: Finite
    diameter_mm: Positive = 1.0
    height_mm: NotNegative = 0.0
    color: Light = (0.2, 0.85, 0.3)
    velocity_mm_s: Point = (0.0, 0.0)


class Picture(Table):
    """What every scene has."""

    format: Literal[1]
    name: str = ""
    rig: str | None = None  # a TOML with tables that scenes share; what stands in the scene itself counts more
    output: Path | None = None  # where `turnscope render` writes when not told otherwise
    truth: Path | None = None
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    camera: CameraTable = CameraTable()
    optics: Optics = Optics()
    exposure: Exposure = Exposure()
    sensor: Sensor = Sensor()
    plate: Plate = Plate()
    lighting: Lighting = Lighting()
    glare: tuple[Glare, ...] = ()
    wire: tuple[Wire, ...] = ()


class Scene(Picture):
    """A run of the robot under the camera."""

    kind: Literal["run"] = "run"
    robot: str = "barrel"
    duration_s: Annotated[float, Field(gt=0, le=36_000)]
    frame_rate: Rate = Fraction(60)
    motion: Motion
    marks: MarksLook = MarksLook()
    timing: Timing = Timing()
    encoding: Encoding = Encoding()
    distractor: tuple[Distractor, ...] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.exposure.time_s * self.frame_rate > 1:
            raise ValueError(
                f"exposure.time_s = {self.exposure.time_s} is longer than a frame at {self.frame_rate} frames/s"
            )
        if self.timing.interlaced != "no" and 2 * self.exposure.time_s * self.frame_rate > 1:
            raise ValueError(f"exposure.time_s = {self.exposure.time_s} is longer than a field")
        return self


class Missing(Table):
    """A dot that is not there."""

    column: int = Field(ge=0)
    row: int = Field(ge=0)


class GaugeScene(Picture):
    """A dot gauge under the camera: its middle at x, y and height_mm above the plate, turned, then tilted.

    Tilt leans the gauge's normal toward tilt_azimuth_deg of the plate frame; the gauge's own dots.height_mm is added
    when the gauge lies flat.
    """

    kind: Literal["gauge"]
    gauge: Path
    x_mm: Finite = 0.0
    y_mm: Finite = 0.0
    height_mm: Finite = 0.0
    turn_deg: Finite = 0.0
    tilt_deg: Annotated[float, Field(gt=-85, lt=85)] = 0.0
    tilt_azimuth_deg: Finite = 0.0
    margin_mm: NotNegative = 3.0
    paper: Share = 0.82
    missing: tuple[Missing, ...] = ()
    dirt_spots: Annotated[int, Field(ge=0, le=10_000)] = 0


def scene_kind(path: Path) -> str:
    """Read the kind of a scene: "run" or "gauge"; SimulationError for any other."""
    kind = _content(path).get("kind", "run")
    if kind not in {"run", "gauge"}:
        raise SimulationError(f'{path}: kind = {kind!r}: a scene is of kind "run" or "gauge"')
    return str(kind)


def load_scene(path: Path) -> Scene | GaugeScene:
    """Read scene.toml; paths in it are taken relative to it.

    Raises OSError, tomllib.TOMLDecodeError, pydantic.ValidationError; SimulationError for an unknown kind.
    """
    return load_gauge_scene(path) if scene_kind(path) == "gauge" else load_run_scene(path)


def load_run_scene(path: Path) -> Scene:
    """Read a scene of kind "run"."""
    scene = Scene.model_validate(_content(path))
    changes = _absolute(path, scene)
    if scene.robot.endswith(".toml"):
        changes["robot"] = str(Path(path).resolve().parent / scene.robot)
    if isinstance(scene.motion, Given):
        changes["motion"] = scene.motion.model_copy(update={"file": Path(path).resolve().parent / scene.motion.file})
    return scene.model_copy(update=changes)


def load_gauge_scene(path: Path) -> GaugeScene:
    """Read a scene of kind "gauge"."""
    scene = GaugeScene.model_validate(_content(path))
    return scene.model_copy(update={**_absolute(path, scene), "gauge": Path(path).resolve().parent / scene.gauge})


def _content(path: Path) -> dict[str, Any]:
    """Tables of a scene over those of the rig that it names."""
    content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    rig = content.get("rig")
    if not isinstance(rig, str):
        return content
    below = tomllib.loads((Path(path).parent / rig).read_text(encoding="utf-8"))
    for key, value in content.items():
        old = below.get(key)
        below[key] = {**old, **value} if isinstance(old, dict) and isinstance(value, dict) else value
    return below


def _absolute(path: Path, scene: Picture) -> dict[str, Any]:
    """Paths that every scene may name, made absolute."""
    folder = Path(path).resolve().parent
    changes: dict[str, Any] = {
        name: folder / value for name in ("output", "truth") if (value := getattr(scene, name)) is not None
    }
    if scene.camera.file is not None:
        changes["camera"] = scene.camera.model_copy(update={"file": folder / scene.camera.file})
    return changes
