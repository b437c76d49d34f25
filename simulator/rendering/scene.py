"""scene.toml: robot or gauge, camera, motion, and faults of the recording.

A scene is a run of the robot (kind "run", the default: a video) or a gauge (kind "gauge": an image).
"""

from __future__ import annotations

import tomllib
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from simulator.effects.catalogue import faults_of_effects
from simulator.effects.entry import EffectEntry
from simulator.errors import SimulationError
from simulator.files.named import named_in
from simulator.rendering.tables import (
    CameraTable,
    Distractor,
    Encoding,
    Exposure,
    Finite,
    Given,
    Glare,
    Lighting,
    MarksLook,
    Motion,
    NotNegative,
    Optics,
    Plate,
    Rate,
    Sensor,
    Share,
    Table,
    Timing,
    Wire,
)


class SceneBase(Table):
    """Keys common to all scenes."""

    format: Literal[1]
    name: str = ""
    rig: str | None = None  # TOML file with tables shared by scenes; keys of the scene take precedence
    output: Path | None = None  # file to write; relative to the scene
    truth: Path | None = None  # truth CSV to write
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0  # of all random numbers
    camera: CameraTable = CameraTable()
    optics: Optics = Optics()
    exposure: Exposure = Exposure()
    sensor: Sensor = Sensor()
    plate: Plate = Plate()
    lighting: Lighting = Lighting()
    glare: tuple[Glare, ...] = ()
    wire: tuple[Wire, ...] = ()


class Scene(SceneBase):
    """A run of the robot under the camera."""

    kind: Literal["run"] = "run"
    robot: str = "barrel"  # shipped robot or robot.toml
    effect: tuple[EffectEntry, ...] = ()  # effects added to the robot in this scene
    duration_s: Annotated[float, Field(strict=True, gt=0, le=36_000)]
    frame_rate: Rate = Fraction(60)
    motion: Motion
    marks: MarksLook = MarksLook()
    timing: Timing = Timing()
    encoding: Encoding = Encoding()
    distractor: tuple[Distractor, ...] = ()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if faults := faults_of_effects(self.effect):
            raise ValueError("; ".join(faults))
        if self.exposure.time_s * self.frame_rate > 1:
            raise ValueError(
                f"exposure.time_s = {self.exposure.time_s} is longer than a frame at {self.frame_rate} frames/s"
            )
        if self.timing.interlaced != "no" and 2 * self.exposure.time_s * self.frame_rate > 1:
            raise ValueError(f"exposure.time_s = {self.exposure.time_s} is longer than a field")
        return self


class Missing(Table):
    """A missing dot."""

    column: int = Field(ge=0)
    row: int = Field(ge=0)


class GaugeScene(SceneBase):
    """A dot gauge under the camera, turned about the vertical, then tilted.

    Tilt leans the gauge's normal toward tilt_azimuth_deg of the plate frame; the gauge's own dots.height_mm is added
    when the gauge lies flat.
    """

    kind: Literal["gauge"]
    gauge: Path  # gauge.toml
    x_mm: Finite = 0.0  # of the middle of the gauge
    y_mm: Finite = 0.0  # of the middle of the gauge
    height_mm: Finite = 0.0  # above the plate
    turn_deg: Finite = 0.0
    tilt_deg: Annotated[float, Field(strict=True, gt=-85, lt=85)] = 0.0
    tilt_azimuth_deg: Finite = 0.0
    margin_mm: NotNegative = 3.0  # of the sheet around the dots
    paper: Share = 0.82  # reflectance
    missing: tuple[Missing, ...] = ()
    dirt_spots: Annotated[int, Field(ge=0, le=10_000)] = 0  # number
    print_error_mm: NotNegative = 0.0  # standard deviation of each dot, along each axis
    print_seed: Annotated[int, Field(ge=0, lt=2**32)] = 0  # of these errors, common to all images of a gauge


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
        changes["robot"] = str(named_in(path, scene.robot))
    if isinstance(scene.motion, Given):
        changes["motion"] = scene.motion.model_copy(update={"file": named_in(path, scene.motion.file)})
    return scene.model_copy(update=changes)


def load_gauge_scene(path: Path) -> GaugeScene:
    """Read a scene of kind "gauge"."""
    scene = GaugeScene.model_validate(_content(path))
    return scene.model_copy(update={**_absolute(path, scene), "gauge": named_in(path, scene.gauge)})


def _content(path: Path) -> dict[str, Any]:
    """Tables of a scene over those of the rig that it names."""
    content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    rig = content.get("rig")
    if not isinstance(rig, str):
        return content
    below = tomllib.loads(named_in(path, rig).read_text(encoding="utf-8"))
    for key, value in content.items():
        old = below.get(key)
        below[key] = {**old, **value} if isinstance(old, dict) and isinstance(value, dict) else value
    return below


def _absolute(path: Path, scene: SceneBase) -> dict[str, Any]:
    """Paths that every scene may name, made absolute."""
    changes: dict[str, Any] = {
        name: named_in(path, value) for name in ("output", "truth") if (value := getattr(scene, name)) is not None
    }
    if scene.camera.file is not None:
        changes["camera"] = scene.camera.model_copy(update={"file": named_in(path, scene.camera.file)})
    return changes
