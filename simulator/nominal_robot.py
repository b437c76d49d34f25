"""The nominal robot: body, wheels, attraction, slip law and marks, in the words and units of robot.toml.

Body frame: x forward, y left, origin midway between the axles (ISO 8855). The front pair drives, the rear pair rolls.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from simulator.mark_layout import Mark, Marks, checked_layout, with_default_places

GRAVITY_MM_S2 = 9800.0  # the paper's 9.8 m/s²
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Shape = Annotated[float, Field(gt=0, le=2)]  # beyond, friction would push a wheel that slides far
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Table(BaseModel):
    """A table of robot.toml: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Body(Table):
    """Mass and outer dimensions; a uniform box where no yaw inertia is given."""

    mass_g: Positive
    length_mm: Positive
    width_mm: Positive
    height_mm: Positive
    yaw_inertia_g_mm2: Positive | None = None


class Wheels(Table):
    """Wheel centres at (±wheelbase/2, ±track/2)."""

    wheelbase_mm: Positive
    track_mm: Positive
    radius_mm: Positive


class MagneticAttraction(Table):
    """Force of each wheel toward the plate, added to its weight share."""

    driving_wheel_mN: NotNegative = 0.0
    driven_wheel_mN: NotNegative = 0.0


class Slip(Table):
    """The slip law of Eqs. (4) to (8), generalised as the model notes say."""

    longitudinal_friction: Positive
    lateral_friction: Positive
    friction_decrease: NotNegative
    longitudinal_shape: Shape
    lateral_shape: Shape
    longitudinal_stiffness: Positive
    lateral_stiffness: Positive
    stiffness_basis: Literal["load", "weight"] = "load"


class KnownTo(Table):
    """How well geometry is known, 1 sigma; 0 where it is exact; None: as well as callipers and scales tell."""

    wheel_radius_mm: NotNegative | None = None  # of each wheel
    wheelbase_mm: NotNegative | None = None
    track_mm: NotNegative | None = None
    mass_g: NotNegative | None = None
    mark_position_mm: NotNegative = 0.05  # of each mark, along each axis
    center_of_gravity_mm: NotNegative = 0.1  # along each axis
    plate_level_deg: NotNegative = 0.3  # along each axis of the plate


class NominalRobot(Table):
    """A robot as it is meant to be; attribute paths are the dotted keys of robot.toml."""

    format: Literal[1]
    name: str
    body: Body
    wheels: Wheels
    magnetic_attraction: MagneticAttraction = MagneticAttraction()
    slip: Slip
    marks: Marks = Marks()
    mark: tuple[Mark, ...] = ()
    tolerance: dict[str, NotNegative] = Field(default_factory=dict)
    known_to: KnownTo = KnownTo()

    @model_validator(mode="before")
    @classmethod
    def _with_marks(cls, content: Any) -> Any:
        return with_default_places(content)

    @model_validator(mode="after")
    def _one_layout(self) -> Self:
        checked_layout(self.marks, self.mark)
        return self

    @property
    def layout(self) -> tuple[Mark, ...]:
        """All marks, in the order of the file."""
        return self.mark or self.marks.each()

    @property
    def points_mm(self) -> dict[str, tuple[float, float]]:
        """Places of all points that a tracker sees, by name: centres of marks, and corners of tags."""
        return {name: place for mark in self.layout for name, place in mark.points_mm().items()}

    @property
    def weight_uN(self) -> float:
        """Weight in µN = g·mm/s²."""
        return self.body.mass_g * GRAVITY_MM_S2

    @property
    def yaw_inertia_g_mm2(self) -> float:
        """Moment of inertia about the vertical through the centre, g·mm²."""
        body = self.body
        return body.yaw_inertia_g_mm2 or body.mass_g * (body.length_mm**2 + body.width_mm**2) / 12

    def wheel_positions_mm(self) -> NDArray[np.float64]:
        """Wheel centres in the body frame, (4, 2), in the order of WHEELS."""
        x, y = self.wheels.wheelbase_mm / 2, self.wheels.track_mm / 2
        return np.array([[x, y], [x, -y], [-x, y], [-x, -y]])
