"""Geometry of the dot gauge: gauge.toml and the positions of its dots."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidatorFunctionWrapHandler,
    field_validator,
    model_validator,
)

from calibration.gauge.layouts import LAYOUTS, named_layout

Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
MOST_DOTS = 100_000  # 30 px a dot in an image of 100 megapixels, with nothing between them


class Table(BaseModel):
    """A table of gauge.toml: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Dots(Table):
    """The array: columns run along x, rows along y.

    Layouts of OpenCV and BoofCV are accepted by their names and counts and converted (see layouts.py).
    """

    columns: int = Field(ge=2)  # along x
    rows: int = Field(ge=2)  # along y
    pitch_mm: Positive | tuple[Positive, Positive]  # distance of neighbouring dots, or along columns and along rows
    diameter_mm: Positive
    layout: Literal["square", "staggered"] = "square"
    shifted_rows: Literal["odd", "even"] = "odd"  # of a staggered array, counted from 0 at the top of the sheet
    shifted_rows_shorter: bool = False  # by one dot
    color: str = "black"  # name or "#rrggbb"
    background: str = "white"  # name or "#rrggbb"
    height_mm: Annotated[float, Field(strict=True, allow_inf_nan=False)] = 0.0  # of the dots above the plate
    pitch_tolerance_percent: NotNegative = 0.1  # 1 sigma, common to the whole plate

    @model_validator(mode="after")
    def _bounded(self) -> Self:
        if self.columns * self.rows > MOST_DOTS:
            raise ValueError(
                f"{self.columns} × {self.rows} dots are more than the {MOST_DOTS} that an image can resolve"
            )
        return self

    @field_validator("pitch_mm", mode="wrap")
    @classmethod
    def _one_or_two_lengths(cls, pitch: object, validate: ValidatorFunctionWrapHandler) -> object:
        try:
            return validate(pitch)
        except ValidationError:  # it has a fault for each kind of value, none of which is the whole answer
            raise ValueError("should be a length above 0, or two in a list: along columns, along rows") from None

    @field_validator("layout", mode="before")
    @classmethod
    def _known_layout(cls, layout: object) -> object:
        if layout not in LAYOUTS:
            raise ValueError("should be one of " + ", ".join(f"'{name}'" for name in LAYOUTS))
        return layout

    @model_validator(mode="before")
    @classmethod
    def _named_layout(cls, table: object) -> object:
        return named_layout(table) if isinstance(table, dict) else table


class Fiducial(Table):
    """A dot that differs from the others, to define origin and direction."""

    column: int = Field(ge=0)  # counted from 0
    row: int = Field(ge=0)  # counted from 0
    diameter_mm: Positive | None = None  # if it differs from the other dots
    color: str | None = None  # if it differs from the other dots


class Tolerance(Table):
    """Manufacturing tolerances of the plate."""

    dot_mm: NotNegative = 0.0  # of each dot, along each axis
    scale: NotNegative | None = None  # of the pitch, relative; default: dots.pitch_tolerance_percent
    flatness_mm: Positive | None = None  # peak to valley that 95 of 100 such plates keep


class Gauge(Table):
    """A dot gauge."""

    format: Literal[1]
    name: str
    dots: Dots
    fiducial: tuple[Fiducial, ...] = ()  # dots that define origin (the first) and direction of x
    tolerance: Tolerance = Tolerance()  # manufacturing tolerances

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        dots, pitch = self.dots, self.pitch_mm
        reach = min(pitch) if dots.layout == "square" else min(pitch[0], float(np.hypot(pitch[0] / 2, pitch[1])))
        if dots.diameter_mm >= reach:
            raise ValueError(f"dots of {dots.diameter_mm} mm touch each other: the nearest are {reach:g} mm apart")
        outside = [f"({f.column}, {f.row})" for f in self.fiducial if f.column >= dots.columns or f.row >= dots.rows]
        if outside:
            raise ValueError(
                f"fiducial {', '.join(outside)} lies outside the array of {dots.columns} columns and {dots.rows} rows"
            )
        return self

    @property
    def scale_sigma(self) -> float:
        """Relative standard uncertainty of the pitch as a whole, and so of every length."""
        stated = self.tolerance.scale
        return self.dots.pitch_tolerance_percent / 100 if stated is None else stated

    @property
    def pitch_mm(self) -> tuple[float, float]:
        """Distance of dots along columns and rows, mm."""
        pitch = self.dots.pitch_mm
        return pitch if isinstance(pitch, tuple) else (pitch, pitch)

    def shifted(self) -> NDArray[np.bool_]:
        """Which rows lie half a pitch to the right: (rows,)."""
        odd = np.arange(self.dots.rows) % 2 == 1
        return np.asarray((odd if self.dots.shifted_rows == "odd" else ~odd) & (self.dots.layout == "staggered"))

    def present(self) -> NDArray[np.bool_]:
        """Which places of the array hold a dot: (rows, columns)."""
        there = np.ones((self.dots.rows, self.dots.columns), dtype=bool)
        if self.dots.shifted_rows_shorter:
            there[self.shifted(), -1] = False
        return there

    def positions_mm(self) -> NDArray[np.float64]:
        """Dot centres in the gauge frame: (rows, columns, 2), mm.

        The column index runs along +x and the row index along -y (as read on a sheet: row 0 is the top row), with the
        origin at the first fiducial. Without fiducials the origin is the middle of the array, and x runs along its
        longer side: an array with longer columns than rows lies on its side.
        """
        sheet = self.sheet_mm()
        if self.fiducial:
            return np.asarray(sheet - sheet[self.fiducial[0].row, self.fiducial[0].column])
        span = np.ptp(sheet.reshape(-1, 2), axis=0)
        # Sides that differ by less than half a pitch are equal: a stretch of the sheet does not turn the frame.
        longer = span[1] > span[0] + min(self.pitch_mm) / 2
        return np.stack([-sheet[..., 1], sheet[..., 0]], axis=-1) if longer else sheet

    def sheet_mm(self) -> NDArray[np.float64]:
        """Dot centres as printed: (rows, columns, 2), mm, x right, y up, origin in the middle of the array."""
        column, row = np.meshgrid(np.arange(self.dots.columns, dtype=float), np.arange(self.dots.rows, dtype=float))
        x, y = (column + 0.5 * self.shifted()[:, None]) * self.pitch_mm[0], -row * self.pitch_mm[1]
        there = x[self.present()]
        return np.stack([x - (there.max() + there.min()) / 2, y - (y.max() + y.min()) / 2], axis=-1)

    def diameters_mm(self) -> NDArray[np.float64]:
        """Diameter of every dot: (rows, columns), mm."""
        diameters = np.full((self.dots.rows, self.dots.columns), self.dots.diameter_mm)
        for fiducial in self.fiducial:
            diameters[fiducial.row, fiducial.column] = fiducial.diameter_mm or self.dots.diameter_mm
        return diameters


def load_gauge(path: Path) -> Gauge:
    """Read gauge.toml. Raises OSError, tomllib.TOMLDecodeError, pydantic.ValidationError."""
    return gauge_of(Path(path).read_text(encoding="utf-8"))


def gauge_of(text: str) -> Gauge:
    """The gauge that the text of a gauge.toml describes. Raises tomllib.TOMLDecodeError, pydantic.ValidationError."""
    return Gauge.model_validate(tomllib.loads(text))
