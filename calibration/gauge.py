"""Geometry of the dot gauge: gauge.toml and the positions of its dots."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Table(BaseModel):
    """A table of gauge.toml: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Dots(Table):
    """The array: columns run along x, rows along y."""

    columns: int = Field(ge=2)
    rows: int = Field(ge=2)
    pitch_mm: Positive | tuple[Positive, Positive]
    diameter_mm: Positive
    layout: Literal["square", "staggered"] = "square"
    color: str = "black"
    background: str = "white"
    height_mm: float = 0.0


class Fiducial(Table):
    """A dot that differs from the others, to fix origin and direction."""

    column: int = Field(ge=0)
    row: int = Field(ge=0)
    diameter_mm: Positive | None = None
    color: str | None = None


class Gauge(Table):
    """A dot gauge as gauge.toml describes it."""

    format: Literal[1]
    name: str
    dots: Dots
    fiducial: tuple[Fiducial, ...] = ()

    def positions_mm(self) -> NDArray[np.float64]:
        """Dot centres in the gauge frame: (rows, columns, 2), mm, origin in the middle of the array.

        Column index runs along +x, row index along -y (as read on a sheet: row 0 is the top row).
        """
        dots = self.dots
        pitch_x, pitch_y = dots.pitch_mm if isinstance(dots.pitch_mm, tuple) else (dots.pitch_mm, dots.pitch_mm)
        column, row = np.meshgrid(np.arange(dots.columns, dtype=float), np.arange(dots.rows, dtype=float))
        if dots.layout == "staggered":
            column = column + 0.5 * (row % 2)
        x = (column - (dots.columns - 1) / 2) * pitch_x
        y = ((dots.rows - 1) / 2 - row) * pitch_y
        return np.stack([x, y], axis=-1)


def load_gauge(path: Path) -> Gauge:
    """Read gauge.toml. Raises OSError, tomllib.TOMLDecodeError, pydantic.ValidationError."""
    return Gauge.model_validate(tomllib.loads(Path(path).read_text(encoding="utf-8")))
