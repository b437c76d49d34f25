"""tracking.toml: optional settings of the marks; defaults are learnt from the recording."""

from __future__ import annotations

import re
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Box = tuple[Finite, Finite, Finite, Finite]  # left, top, right, bottom in px

_PRESETS = tomllib.loads(files("evaluator.tracking").joinpath("colors.toml").read_text(encoding="utf-8"))
HUE_RANGES = {name: (float(low), float(high)) for name, (low, high) in _PRESETS["hue_deg"].items()}
DEFAULT_MARKS: tuple[str, ...] = tuple(_PRESETS["default_marks"])
HEX = r"#[0-9a-fA-F]{6}"
MARK_NAME = r"\w(?:[\w -]*\w)?"  # as in robot.toml (simulator.mark_layout)
Kind = Literal["color", "light", "aruco", "apriltag"]


def hue_word(name: str) -> str:
    """The first word of the name of a mark, which may be its colour."""
    return re.split(r"[ _-]", name, maxsplit=1)[0]


class Table(BaseModel):
    """A table of tracking.toml: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class MarkSettings(Table):
    """One mark. hue_deg: [from, to] in HSV degrees, going up; may pass 360. diameter_px: about, to 30 %.

    color: a name of colors.toml or "#rrggbb". kind: a coloured sticker, a light, or a tag (ArUco, AprilTag). id: number
    of a tag, by default the number at the end of its name. dictionary: of tags, as OpenCV names it (4x4_50,
    apriltag_36h11).
    """

    kind: Kind = "color"
    id: Annotated[int, Field(ge=0)] | None = None
    dictionary: str | None = None
    hue_deg: tuple[Finite, Finite] | None = None
    color: str | None = None
    diameter_px: Finite | None = Field(default=None, gt=1.0)
    region_px: Box | None = None

    @model_validator(mode="after")
    def _one_color(self) -> Self:
        if self.hue_deg is not None and self.color is not None:
            raise ValueError("say color or hue_deg, not both")
        if self.color is not None and self.color not in HUE_RANGES and not re.fullmatch(HEX, self.color):
            raise ValueError(f'color {self.color} is not known; say {", ".join(HUE_RANGES)} or "#rrggbb"')
        _check_box("region_px", self.region_px)
        return self

    @property
    def said(self) -> bool:
        """Whether its colour is given by numbers instead of a name."""
        return self.hue_deg is not None or (self.color or "").startswith("#")

    def hue_range(self, name: str) -> tuple[float, float]:
        """Hues of this mark, HSV degrees; name: of the mark, whose colour is the default."""
        if self.hue_deg is not None:
            return self.hue_deg
        color = self.color or hue_word(name)
        if color.startswith("#"):
            import colorsys

            red, green, blue = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
            hue = 360 * colorsys.rgb_to_hsv(red, green, blue)[0]
            return hue - 25.0, hue + 25.0  # half the distance between neighbouring named hues
        return HUE_RANGES[color]


class TrackingSettings(Table):
    """All of tracking.toml. Only the named marks are searched; without any, those of the robot.

    mark: by name; a name begins with its colour (red, blue_left …) unless color or hue_deg states it. body: marks on
    one rigid body; by default those of the robot. region_px: search only here. mask_px: boxes to ignore.
    distance_diameters: distance of the two marks of a body over their diameter, used to choose between candidates in
    the first frame (3.66 on the paper's robot). exposure: share of the frame interval for which the shutter is open; by
    default learnt from fast marks. readout_ms: of a rolling shutter, from the exposure of the first row of a frame to
    that of the last; marks are then placed where they were when the middle row was exposed. 0 says that the
    shutter is a global one, which is assumed, with a note for fast marks, where nothing is said.
    """

    format: Literal[1] = 1
    mark: dict[str, MarkSettings] = Field(default_factory=lambda: {name: MarkSettings() for name in DEFAULT_MARKS})
    body: tuple[str, ...] | None = None
    region_px: Box | None = None
    mask_px: tuple[Box, ...] = ()
    distance_diameters: Finite | None = Field(default=3.66, gt=0)
    exposure: Annotated[float, Field(strict=True, ge=0, le=1)] | None = None
    readout_ms: Annotated[float, Field(strict=True, ge=0, lt=1000)] = 0.0

    @field_validator("mark", mode="before")
    @classmethod
    def _tables_by_name(cls, stated: object) -> object:
        if not isinstance(stated, list):
            return stated
        raise ValueError(
            "[[mark]] belongs in robot.toml, with the places of the marks; here every mark is a table "
            f"[mark.NAME], for example [mark.{DEFAULT_MARKS[0]}]"
        )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        _check_box("region_px", self.region_px)
        for box in self.mask_px:
            _check_box("mask_px", box)
        if not self.mark:
            raise ValueError(f"mark is empty: name at least one mark, for example [mark.{DEFAULT_MARKS[0]}]")
        for name, mark in self.mark.items():
            if not re.fullmatch(MARK_NAME, name):
                raise ValueError(f"mark name {name!r} must be letters and digits, with _, - and blanks between them")
            if mark.kind == "color" and not (mark.hue_deg or mark.color) and hue_word(name) not in HUE_RANGES:
                raise ValueError(
                    f'mark {name}: say its color, for example color = "#3050ff", or its kind: light, aruco or apriltag'
                )
        if strange := [name for name in self.body or () if name not in self.mark]:
            raise ValueError(f"body: there is no [mark.{strange[0]}]")
        return self

    @property
    def rigid(self) -> tuple[str, ...]:
        """Marks that are known to sit on one body."""
        said = DEFAULT_MARKS if self.body is None else self.body
        return tuple(name for name in said if name in self.mark) if set(said) <= set(self.mark) else ()

    @property
    def shutter_stated(self) -> bool:
        """Whether readout_ms is given, be it 0 for a global shutter."""
        return "readout_ms" in self.model_fields_set

    @property
    def pair(self) -> tuple[str, ...]:
        """The two coloured marks of one body, if no other marks are searched; else empty."""
        colored = all(mark.kind == "color" for mark in self.mark.values())
        return self.rigid if colored and len(self.rigid) == len(self.mark) == 2 else ()

    @property
    def twins(self) -> tuple[str, ...]:
        """The pair, if both have the same colour; else empty."""
        return self.pair if len({self.mark[name].hue_range(name) for name in self.pair}) == 1 else ()

    @property
    def pair_distance(self) -> float | None:
        """Distance of the pair over the diameter, if known; the default holds for the default marks only."""
        said = "distance_diameters" in self.model_fields_set or set(self.pair) == set(DEFAULT_MARKS)
        return self.distance_diameters if said else None

    def of_kind(self, *kinds: Kind) -> dict[str, MarkSettings]:
        """Marks of some kinds."""
        return {name: mark for name, mark in self.mark.items() if mark.kind in kinds}


def with_marks(settings: TrackingSettings, marks: dict[str, MarkSettings]) -> TrackingSettings:
    """The settings with other marks. Raises pydantic.ValidationError for a mark of unknown colour."""
    content = {name: getattr(settings, name) for name in settings.model_fields_set if name != "mark"}
    return TrackingSettings.model_validate({**content, "mark": marks})


def load_settings(path: Path) -> TrackingSettings:
    """Read tracking.toml. Raises OSError, tomllib.TOMLDecodeError, pydantic.ValidationError."""
    return TrackingSettings.model_validate(tomllib.loads(Path(path).read_text(encoding="utf-8")))


def _check_box(name: str, box: Box | None) -> None:
    if box is not None and not (box[0] < box[2] and box[1] < box[3]):
        raise ValueError(f"{name} = {list(box)} is not [left, top, right, bottom] with left < right and top < bottom")
