"""A simulated run: pose, velocity and wheel states over time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from simulator.nominal_robot import WHEELS

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
CHANCE_AMPLIFICATION = 1e4  # a micrometre at the start becomes a centimetre


@dataclass(frozen=True)
class State:
    """Pose of the robot's centre in the plate frame and its velocity in the body frame."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    heading_rad: float = 0.0
    u_mm_s: float = 0.0
    v_mm_s: float = 0.0
    yaw_rate_rad_s: float = 0.0

    def to_array(self) -> Array:
        """(6,) in the order of the fields."""
        return np.array([self.x_mm, self.y_mm, self.heading_rad, self.u_mm_s, self.v_mm_s, self.yaw_rate_rad_s])


@dataclass(frozen=True)
class WheelStates:
    """Slip and friction of w wheels in the robot's order, arrays (n, w), in the frame of each wheel."""

    slip_ratio: Array
    slip_angle_rad: Array
    longitudinal_force_mN: Array
    lateral_force_mN: Array


@dataclass(frozen=True, repr=False)
class Run:
    """Motion of the robot's centre: plate frame pose, body frame velocity, wheel states; all at time_s (n,).

    heading_rad is unwrapped. Wheel arrays are (n, w), in the order of wheel_names. Arrays are read-only. Wheel states
    are computed by wheels_of on first use; they are NaN without it. amplification: largest factor by which a small
    disturbance of the velocity grows between two breaks of the command, while the robot passes unstable equilibria.
    unsettled_mm: distance between this solution and one with other step errors, or with speeds changed within their
    uncertainty, if it is larger than the accumulation of such errors; 0 if they agree.
    """

    time_s: Array
    x_mm: Array
    y_mm: Array
    heading_rad: Array
    u_mm_s: Array
    v_mm_s: Array
    yaw_rate_rad_s: Array
    wheels_of: Callable[[], WheelStates] | None = None
    amplification: float = 1.0
    wheel_names: tuple[str, ...] = WHEELS
    unsettled_mm: float = 0.0

    def __repr__(self) -> str:
        """One line: samples, time, first and last position, angle turned."""
        if not len(self.time_s):
            return "Run(empty)"
        return "Run(" + ", ".join(f"{name} {value}" for name, value in self._facts().items()) + ")"

    def _repr_html_(self) -> str:
        """Content of __repr__ as a table, for notebooks."""
        if not len(self.time_s):
            return "Run(empty)"
        rows = (f"<tr><th>{name}</th><td>{value}</td></tr>" for name, value in self._facts().items())
        return f"<table>{''.join(rows)}</table>"

    def _facts(self) -> dict[str, str]:
        places = [f"({self.x_mm[at]:.2f}, {self.y_mm[at]:.2f}) mm" for at in (0, -1)]
        return {
            "samples": f"{len(self.time_s)}",
            "time": f"{self.time_s[0]:g} to {self.time_s[-1]:g} s",
            "from": places[0],
            "to": places[1],
            "turned": f"{np.degrees(self.heading_rad[-1] - self.heading_rad[0]):.1f}°",
        }

    @property
    def is_by_chance(self) -> bool:
        """Whether a disturbance of 1 nm/s grows beyond the smoothing of friction at rest (100 rest speeds).

        This happens when wheels that turn against each other start from rest: the model then has two stable turns
        (simulator.steady.steady_turns gives both), of which the run shows one, and a real robot may take either.
        """
        return self.amplification > CHANCE_AMPLIFICATION

    @property
    def is_converged(self) -> bool:
        """Whether smaller step errors and slightly different speeds give the same motion."""
        return self.unsettled_mm == 0.0

    @cached_property
    def wheels(self) -> WheelStates:
        """Slip and friction of every wheel."""
        return self.wheels_of() if self.wheels_of else self._unknown_wheels()

    def _unknown_wheels(self) -> WheelStates:
        return WheelStates(*np.full((4, len(self.time_s), len(self.wheel_names)), np.nan))

    @property
    def slip_ratio(self) -> Array:
        """Slip ratio of each wheel, Eq. (3); 0 for wheels that roll freely."""
        return self.wheels.slip_ratio

    @property
    def slip_angle_rad(self) -> Array:
        """Slip angle of each wheel, Eq. (3), with |u|."""
        return self.wheels.slip_angle_rad

    @property
    def longitudinal_force_mN(self) -> Array:
        """Friction on each wheel along its rolling direction, (n, w)."""
        return self.wheels.longitudinal_force_mN

    @property
    def lateral_force_mN(self) -> Array:
        """Friction on each wheel to its left, (n, w)."""
        return self.wheels.lateral_force_mN

    def to_table(self) -> pd.DataFrame:
        """The columns of a simulated run CSV."""
        import pandas as pd

        columns = {
            "time_s": self.time_s,
            "x_mm": self.x_mm,
            "y_mm": self.y_mm,
            "heading_deg": np.degrees(self.heading_rad),
            "u_mm_s": self.u_mm_s,
            "v_mm_s": self.v_mm_s,
            "yaw_rate_deg_s": np.degrees(self.yaw_rate_rad_s),
        }
        for number, wheel in enumerate(self.wheel_names):
            columns[f"{wheel}_slip_ratio"] = self.slip_ratio[:, number]
            columns[f"{wheel}_slip_angle_deg"] = np.degrees(self.slip_angle_rad[:, number])
            columns[f"{wheel}_longitudinal_force_mN"] = self.longitudinal_force_mN[:, number]
            columns[f"{wheel}_lateral_force_mN"] = self.lateral_force_mN[:, number]
        return pd.DataFrame(columns)
