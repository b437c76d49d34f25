"""The nominal robot: body, wheels, attraction, slip law and marks, in the words and units of robot.toml.

Body frame: x forward, y left (ISO 8855); its origin is the robot's centre, the point whose path is measured. [wheels]
is short for four wheels around it, of which the front pair drives and the rear pair rolls; [[wheel]] lists any others.
"""

from __future__ import annotations

import difflib
from functools import lru_cache
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from simulator.mark_layout import Mark, Marks, checked_layout, with_default_places
from simulator.units import in_standard_units

GRAVITY_MM_S2 = 9800.0  # the paper's 9.8 m/s²
WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
TOLERATED = ("body", "wheels", "magnetic_attraction", "slip", "marks")  # tables that [tolerance] may name numbers of
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]
Shape = Annotated[float, Field(strict=True, gt=0, le=2)]  # beyond 2, friction at large slip would act along the sliding
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]


class Table(BaseModel):
    """A table of robot.toml: unknown keys are errors, values are immutable; units of keys may vary."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _in_standard_units(cls, content: Any) -> Any:
        return in_standard_units(content, cls.model_fields) if isinstance(content, dict) else content


class Body(Table):
    """Mass and outer dimensions."""

    mass_g: Positive
    length_mm: Positive
    width_mm: Positive
    height_mm: Positive
    yaw_inertia_g_mm2: Positive | None = None  # about the centre of gravity; default: uniform box
    center_of_gravity_mm: tuple[Finite, Finite] = (0.0, 0.0)  # in the body frame


class Wheels(Table):
    """Four wheels with their centres at (±wheelbase/2, ±track/2)."""

    wheelbase_mm: Positive  # front to rear axle
    track_mm: Positive  # left to right wheel centres
    radius_mm: Positive


class MagneticAttraction(Table):
    """Force of each wheel toward the plate, added to its weight share."""

    driving_wheel_mN: NotNegative = 0.0  # of each front wheel
    driven_wheel_mN: NotNegative = 0.0  # of each rear wheel


class Slip(Table):
    """The slip law of Eqs. (4) to (8); symbols: see simulator/README.md."""

    longitudinal_friction: Positive  # μ0_x
    lateral_friction: Positive  # μ0_y
    friction_decrease: NotNegative  # K_μ
    longitudinal_shape: Shape  # a_x
    lateral_shape: Shape  # a_y
    longitudinal_stiffness: Positive  # K_x divided by its basis
    lateral_stiffness: Positive  # K_y divided by its basis
    stiffness_basis: Literal["load", "weight"] = "load"  # vertical force with attraction, or weight share alone


class Wheel(Table):
    """One support: a wheel, driven by the left or the right command or rolling freely, or a caster or ball.

    Casters and balls carry load and roll in any direction without friction.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")]  # prefix of its columns in a simulated run
    x_mm: Finite  # forward
    y_mm: Finite  # to the left
    radius_mm: Positive
    driven_by: Literal["left", "right", "none"] = "none"  # command of that side; "none" rolls freely
    attraction_mN: NotNegative = 0.0  # toward the plate, added to the weight share
    support: Literal["wheel", "caster", "ball"] = "wheel"
    slip: Slip | None = None  # its own slip law; default: [slip]

    @model_validator(mode="after")
    def _casters_are_not_driven(self) -> Self:
        if not self.grips and self.driven_by != "none":
            raise ValueError(f'{self.name}: a {self.support} is driven by "none"; a driven support is a "wheel"')
        if not self.grips and self.slip is not None:
            raise ValueError(f"{self.name}: a {self.support} rolls in any direction and has no slip law")
        return self

    @property
    def grips(self) -> bool:
        """Whether friction acts on it: not on casters and balls."""
        return self.support == "wheel"


class KnownTo(Table):
    """Standard uncertainties of the geometry, absolute; 0 is exact."""

    wheel_radius_mm: NotNegative | None = None  # of each wheel; default 0.5 %
    wheelbase_mm: NotNegative | None = None  # default 0.02 mm
    track_mm: NotNegative | None = None  # default 0.02 mm
    mass_g: NotNegative | None = None  # default 2 %
    mark_position_mm: NotNegative = 0.05  # of each mark, along each axis
    mark_height_mm: NotNegative = 0.1  # of all marks
    center_of_gravity_mm: NotNegative = 0.1  # along each axis
    plate_level_deg: NotNegative = 0.3  # along each axis of the plate

    def states(self, key: str) -> bool:
        """Whether the file states a value, in place of the default."""
        return key in self.model_fields_set


class NominalRobot(Table):
    """A robot as it is meant to be; attribute paths are the dotted keys of robot.toml."""

    format: Literal[1]
    name: str
    body: Body
    wheels: Wheels | None = None  # four wheels; or [[wheel]]
    magnetic_attraction: MagneticAttraction = MagneticAttraction()  # for [wheels]
    wheel: tuple[Wheel, ...] = ()  # any layout of supports
    slip: Slip
    marks: Marks = Marks()  # coloured marks; or [[mark]]
    mark: tuple[Mark, ...] = ()  # marks of any kind
    tolerance: dict[str, NotNegative] = Field(default_factory=dict)  # relative, 1 sigma, by dotted key
    known_to: KnownTo = KnownTo()  # absolute, 1 sigma

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

    @model_validator(mode="after")
    def _has_wheels(self) -> Self:
        if self.wheels is None and not self.wheel:
            raise ValueError("there is neither [wheels] nor [[wheel]]; give the positions of the wheels")
        if self.wheel:
            _check_list(self)
        return self

    @model_validator(mode="after")
    def _tolerances_are_of_numbers(self) -> Self:
        tables = {name: getattr(self, name) for name in TOLERATED if name != "magnetic_attraction" or self.wheels}
        known = [key for name, table in tables.items() if table for key in _numbers_in(name, table)]
        for key in self.tolerance:
            if key not in known:
                near = difflib.get_close_matches(key, known, n=1)
                hint = f"did you mean {near[0]}?" if near else f"it may name {', '.join(known)}"
                raise ValueError(f"[tolerance] names {key}, which is not a number of this robot; {hint}")
        return self

    @property
    def weight_uN(self) -> float:
        """Weight in µN = g·mm/s²."""
        return self.body.mass_g * GRAVITY_MM_S2

    @property
    def yaw_inertia_g_mm2(self) -> float:
        """Moment of inertia about the vertical through the centre, g·mm²."""
        body = self.body
        return body.yaw_inertia_g_mm2 or body.mass_g * (body.length_mm**2 + body.width_mm**2) / 12

    @property
    def all_wheels(self) -> tuple[Wheel, ...]:
        """Every support: the [[wheel]] list, or the four wheels of [wheels] in the order of WHEELS."""
        if self.wheels is None:
            return self.wheel
        return four_wheels(
            *(self.wheels.wheelbase_mm, self.wheels.track_mm, self.wheels.radius_mm),
            *(self.magnetic_attraction.driving_wheel_mN, self.magnetic_attraction.driven_wheel_mN),
        )

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """Names of all wheels, in their order."""
        return WHEELS if self.wheels else tuple(wheel.name for wheel in self.wheel)

    @property
    def driving_radius_mm(self) -> float:
        """Radius of the driving wheels; the mean where they differ."""
        if self.wheels:
            return self.wheels.radius_mm
        return float(np.mean([wheel.radius_mm for wheel in self.wheel if wheel.driven_by != "none"]))

    @property
    def track_mm(self) -> float:
        """Lateral distance between the wheels of the left and the right command; means if they differ."""
        if self.wheels:
            return self.wheels.track_mm
        left, right = (
            np.mean([wheel.y_mm for wheel in self.wheel if wheel.driven_by == side]) for side in ("left", "right")
        )
        return float(left - right)

    @property
    def extent_mm(self) -> tuple[float, float]:
        """Distance from the rearmost to the foremost and from the rightmost to the leftmost wheel centre."""
        x, y = np.ptp(self.wheel_positions_mm(), axis=0).tolist()
        return x, y

    def wheel_positions_mm(self) -> NDArray[np.float64]:
        """Wheel centres in the body frame, (n, 2), in the order of all_wheels."""
        return np.array([[wheel.x_mm, wheel.y_mm] for wheel in self.all_wheels])


def _numbers_in(table: str, part: BaseModel) -> list[str]:
    """Dotted keys of the numbers of a table."""
    return [f"{table}.{name}" for name, value in part if isinstance(value, float)]


@lru_cache(maxsize=64)  # sessions ask for the wheels of one robot a thousand times; they are immutable
def four_wheels(
    wheelbase_mm: float, track_mm: float, radius_mm: float, driving_mN: float, driven_mN: float
) -> tuple[Wheel, ...]:
    """The four [[wheel]] entries that [wheels] and [magnetic_attraction] abbreviate."""
    x, y = wheelbase_mm / 2, track_mm / 2
    rows = zip(
        *(WHEELS, (x, x, -x, -x), (y, -y, y, -y), ("left", "right", "none", "none")),
        (driving_mN, driving_mN, driven_mN, driven_mN),
        strict=True,
    )
    return tuple(
        Wheel.model_construct(
            name=name, x_mm=at_x, y_mm=at_y, radius_mm=radius_mm, driven_by=side, attraction_mN=attraction
        )
        for name, at_x, at_y, side, attraction in rows
    )


def _check_list(robot: NominalRobot) -> None:
    """Raise ValueError if a [[wheel]] list contradicts itself or the rest of the file."""
    if robot.wheels is not None:
        raise ValueError("there are both [wheels] and [[wheel]]; keep one of them")
    if robot.magnetic_attraction != MagneticAttraction():
        raise ValueError("[magnetic_attraction] belongs to [wheels]; give each [[wheel]] its attraction_mN")
    names = [wheel.name for wheel in robot.wheel]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"the name {twice[0]} is used for two [[wheel]] tables")
    for side in ("left", "right"):
        if not any(wheel.driven_by == side for wheel in robot.wheel):
            raise ValueError(f'no [[wheel]] has driven_by = "{side}"; the {side} command needs at least one')
