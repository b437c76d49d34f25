"""tracking.toml: what a user may say about the marks; everything has a default that is learnt from the recording."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Finite = Annotated[float, Field(allow_inf_nan=False)]
Box = tuple[Finite, Finite, Finite, Finite]  # left, top, right, bottom in px

# Hue ranges (degrees, HSV) of fluorescent marks once the plate is taken as neutral: yellow lies at 60, green at 120,
# cyan at 180 and orange at 30; the ranges meet halfway.
HUE_RANGES = {"yellow": (42.0, 82.0), "green": (82.0, 172.0)}


class Table(BaseModel):
    """A table of tracking.toml: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class MarkSettings(Table):
    """One mark. hue_deg: [from, to] in HSV degrees, going up; may pass 360. diameter_px: about, to 30 %."""

    hue_deg: tuple[Finite, Finite] | None = None
    color: str | None = Field(default=None, pattern=r"^(green|yellow|#[0-9a-fA-F]{6})$")
    diameter_px: Finite | None = Field(default=None, gt=1.0)
    region_px: Box | None = None

    @model_validator(mode="after")
    def _one_color(self) -> Self:
        if self.hue_deg is not None and self.color is not None:
            raise ValueError("say color or hue_deg, not both")
        _check_box("region_px", self.region_px)
        return self

    @property
    def said(self) -> bool:
        """Whether the settings say its colour by numbers, rather than by a name."""
        return self.hue_deg is not None or (self.color or "").startswith("#")

    def hue_range(self, name: str) -> tuple[float, float]:
        """Hues this mark may have; name: of the mark, whose colour is the default."""
        if self.hue_deg is not None:
            return self.hue_deg
        color = self.color or name.split("_", maxsplit=1)[0]
        if color.startswith("#"):
            import colorsys

            red, green, blue = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
            hue = 360 * colorsys.rgb_to_hsv(red, green, blue)[0]
            return hue - 25.0, hue + 25.0  # half the distance between neighbouring named hues
        return HUE_RANGES[color]


class TrackingSettings(Table):
    """All of tracking.toml. Marks not named are not sought; none named: green and yellow.

    mark: by name; a name begins with its colour (green, yellow, yellow_left …) unless color or hue_deg says it.
    region_px: search here only. mask_px: boxes never to look at. distance_diameters: distance of green and yellow over
    their diameter, used to choose between candidates in the first frame (3.66 on the paper's robot). exposure: share
    of the frame interval that the shutter is open; learnt from fast marks where it is not said.
    """

    format: Literal[1] = 1
    mark: dict[str, MarkSettings] = Field(default_factory=lambda: {"green": MarkSettings(), "yellow": MarkSettings()})
    region_px: Box | None = None
    mask_px: tuple[Box, ...] = ()
    distance_diameters: Finite | None = Field(default=3.66, gt=0)
    exposure: Annotated[float, Field(ge=0, le=1)] | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        _check_box("region_px", self.region_px)
        for box in self.mask_px:
            _check_box("mask_px", box)
        if not self.mark:
            raise ValueError("mark is empty: name at least one mark, for example [mark.green]")
        for name, mark in self.mark.items():
            if not name.isidentifier():
                raise ValueError(f"mark name {name!r} must be letters, digits and underscores")
            if mark.hue_deg is None and mark.color is None and name.split("_")[0] not in HUE_RANGES:
                raise ValueError(f'mark {name}: say its color, for example color = "#3050ff"')
        return self


def load_settings(path: Path) -> TrackingSettings:
    """Read tracking.toml. Raises OSError, tomllib.TOMLDecodeError, pydantic.ValidationError."""
    return TrackingSettings.model_validate(tomllib.loads(Path(path).read_text(encoding="utf-8")))


def _check_box(name: str, box: Box | None) -> None:
    if box is not None and not (box[0] < box[2] and box[1] < box[3]):
        raise ValueError(f"{name} = {list(box)} is not [left, top, right, bottom] with left < right and top < bottom")
