"""Terms of effects: coefficient × basis of the state, added to a channel with a pattern over the wheels.

Channel: where it acts. Basis: what it depends on. Pattern over the wheels: common, left-right or front-rear.
Units: mm, s, g, µN, rad. Body channels take the state of the robot's centre, wheel channels that of each wheel, camera
channels the position of each mark.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

UN_PER_MN = 1000.0  # files say mN, terms µN = g·mm/s²

# Channels. Body: force in the body frame, moment, force in the plate frame (µN, µN·mm). Wheel: relative change of
# surface speed, load, stiffness, friction coefficient, and of the latter across the wheel alone; toe angle (rad); force
# along the wheel (µN). Camera: error of the measured position of a mark, mm. Drive: rotational frequency added to the
# commands of the left and the right driving wheels, rpm. Changes of a channel add up, except that friction by the
# direction of sliding is a factor of its own.
FORCE_FORWARD, FORCE_LEFT, MOMENT, FORCE_PLATE_X, FORCE_PLATE_Y = range(5)
SPEED, STEER, LOAD, STIFFNESS, DRAG, FRICTION, FRICTION_ACROSS = range(5, 12)
CAMERA_X, CAMERA_Y = 12, 13
LEFT_DRIVE, RIGHT_DRIVE = 14, 15
CHANNELS = {
    "force_forward": FORCE_FORWARD,
    "force_left": FORCE_LEFT,
    "moment": MOMENT,
    "force_plate_x": FORCE_PLATE_X,
    "force_plate_y": FORCE_PLATE_Y,
    "speed": SPEED,
    "steer": STEER,
    "load": LOAD,
    "stiffness": STIFFNESS,
    "drag": DRAG,
    "friction": FRICTION,
    "friction_across": FRICTION_ACROSS,
    "camera_x": CAMERA_X,
    "camera_y": CAMERA_Y,
    "left_drive": LEFT_DRIVE,
    "right_drive": RIGHT_DRIVE,
}

# Bases. From COS on they change along a steady turn, so that no circle closes the motion.
ONE, U, V, YAW, U_ABS, V_ABS, YAW_ABS, ABS_U, ABS_YAW, SIGN_U, SIGN_V, SIGN_YAW = range(12)
COS, SIN, COS2, SIN2, X, Y, TIME, COS_ANGLE, SIN_ANGLE, TOWARD_X, TOWARD_Y, SLIDE_COS2, SLIDE_SIN2 = range(12, 25)
X_CUBED, Y_CUBED = 25, 26
# For drive channels only: the commands of both sides, rpm, and their absolute values.
LEFT_COMMAND, RIGHT_COMMAND, ABS_LEFT_COMMAND, ABS_RIGHT_COMMAND = range(27, 31)
BASES = {
    "one": ONE,
    "u": U,
    "v": V,
    "yaw_rate": YAW,
    "u_abs_u": U_ABS,
    "v_abs_v": V_ABS,
    "yaw_rate_abs": YAW_ABS,
    "abs_u": ABS_U,
    "abs_yaw_rate": ABS_YAW,
    "sign_u": SIGN_U,
    "sign_v": SIGN_V,
    "sign_yaw_rate": SIGN_YAW,
    "cos_heading": COS,
    "sin_heading": SIN,
    "cos_2_heading": COS2,
    "sin_2_heading": SIN2,
    "x": X,
    "y": Y,
    "time": TIME,
    "cos_wheel_angle": COS_ANGLE,
    "sin_wheel_angle": SIN_ANGLE,
    "toward_x": TOWARD_X,  # components of the unit vector toward a point of the plate, times a fall-off with distance
    "toward_y": TOWARD_Y,
    "cos_2_slide": SLIDE_COS2,  # of the direction in which the contact slides over the plate
    "sin_2_slide": SLIDE_SIN2,
    "x_r_squared": X_CUBED,  # x·(x² + y²): residual radial distortion of a lens
    "y_r_squared": Y_CUBED,
    "left_command": LEFT_COMMAND,
    "right_command": RIGHT_COMMAND,
    "abs_left_command": ABS_LEFT_COMMAND,
    "abs_right_command": ABS_RIGHT_COMMAND,
}

# Channels and bases that depend on the robot's position, heading or sliding direction relative to the plate.
_PLATE_CHANNELS = frozenset({FORCE_PLATE_X, FORCE_PLATE_Y, CAMERA_X, CAMERA_Y})
_PLATE_BASES = frozenset({COS, SIN, COS2, SIN2, X, Y, TOWARD_X, TOWARD_Y, SLIDE_COS2, SLIDE_SIN2, X_CUBED, Y_CUBED})


def is_of_plate(channel: int, basis: int) -> bool:
    """Whether a term depends on the robot's position or direction on the plate."""
    return channel in _PLATE_CHANNELS or basis in _PLATE_BASES


class Place(Protocol):
    """What a pattern needs to know of a wheel: its centre in the body frame, mm, and which command drives it."""

    @property
    def x_mm(self) -> float: ...  # noqa: D102
    @property
    def y_mm(self) -> float: ...  # noqa: D102
    @property
    def driven_by(self) -> str: ...  # noqa: D102


def _sign(value: float) -> float:
    return float(value > 0) - float(value < 0)


def _ahead(wheel: Place, wheels: Sequence[Place]) -> float:
    """1 for a wheel of the foremost axle, -1 for one of the rearmost, 0 between."""
    front, rear = max(other.x_mm for other in wheels), min(other.x_mm for other in wheels)
    return float(wheel.x_mm == front) - float(wheel.x_mm == rear)


def _driving(wheel: Place) -> float:
    return float(wheel.driven_by != "none")


def _corner(ahead: int, side: int) -> Callable[[Place, Sequence[Place]], float]:
    return lambda wheel, wheels: float(_ahead(wheel, wheels) == ahead and _sign(wheel.y_mm) == side)


# Weight of a wheel among all wheels. Left and right refer to its position, for driving wheels to its command.
PATTERNS: dict[str, Callable[[Place, Sequence[Place]], float]] = {
    "common": lambda _wheel, _wheels: 1.0,
    "left-right": lambda wheel, _wheels: _sign(wheel.y_mm),
    "front-rear": _ahead,
    "driving": lambda wheel, _wheels: _driving(wheel),
    "driving-left-right": lambda wheel, _wheels: float(wheel.driven_by == "left") - float(wheel.driven_by == "right"),
    "driven": lambda wheel, _wheels: 1.0 - _driving(wheel),  # wheels that roll freely
    "driven-left-right": lambda wheel, _wheels: (1.0 - _driving(wheel)) * _sign(wheel.y_mm),
    "front-left": _corner(1, 1),
    "front-right": _corner(1, -1),
    "rear-left": _corner(-1, 1),
    "rear-right": _corner(-1, -1),
}


def pattern_weights(pattern: str | tuple[float, ...], wheels: Sequence[Place]) -> tuple[float, ...]:
    """Weight of each wheel, from the name of a pattern or as given."""
    if isinstance(pattern, str):
        weigh = PATTERNS[pattern]
        return tuple(weigh(wheel, wheels) for wheel in wheels)
    return pattern


@dataclass(frozen=True)
class Term:
    """One term: channel and basis of this module, coefficient in the channel's unit per unit of the basis.

    pattern: for wheel channels, the name of one of PATTERNS or the weight of each wheel; point_mm and falloff: for the
    bases toward_x and toward_y, whose magnitude is 1 at 10 mm from the point and proportional to distance^-falloff.
    """

    channel: int
    basis: int
    coefficient: float
    pattern: str | tuple[float, ...] = "common"
    point_mm: tuple[float, float] = (0.0, 0.0)
    falloff: float = 0.0

    @property
    def acts_on_wheels(self) -> bool:
        """Whether the term is evaluated at every wheel."""
        return SPEED <= self.channel < CAMERA_X

    @property
    def is_seen_only(self) -> bool:
        """Whether the term is an error of the measurement, which does not act on the robot."""
        return self.channel in (CAMERA_X, CAMERA_Y)

    @property
    def acts_on_drive(self) -> bool:
        """Whether the term adds to what the driving wheels are commanded."""
        return self.channel in (LEFT_DRIVE, RIGHT_DRIVE)

    @property
    def depends_on_place(self) -> bool:
        """Whether the term changes with the position on the plate at constant heading."""
        return self.basis in (X, Y, TOWARD_X, TOWARD_Y, X_CUBED, Y_CUBED)

    @property
    def depends_on_velocity(self) -> bool:
        """Whether the term changes with the velocity at constant position."""
        return ONE < self.basis < COS or self.basis >= SLIDE_COS2

    @property
    def varies(self) -> bool:
        """Whether the term changes along a steady turn."""
        return self.basis >= COS or self.channel in (FORCE_PLATE_X, FORCE_PLATE_Y)
