"""What effects may change of a robot before it is compiled for the kernels. Units: mm, s, g, µN and rad."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simulator.dynamics.terms import UN_PER_MN, Term
from simulator.errors import SimulationError
from simulator.nominal_robot import NominalRobot

Array = NDArray[np.float64]


def _ones() -> Array:
    return np.ones(4)


@dataclass
class Draft:
    """What effects may change before a robot is compiled: factors over the wheels, offsets, and added terms.

    Arrays over wheels are in the order of WHEELS. run_index counts the runs of a session from 0.
    """

    robot: NominalRobot
    run_index: int = 0
    attraction_factor: Array = field(default_factory=_ones)
    friction_factor: Array = field(default_factory=_ones)
    speed_factor: Array = field(default_factory=lambda: np.ones(2))
    toe_rad: Array = field(default_factory=lambda: np.zeros(4))
    gravity_mm: tuple[float, float] = (0.0, 0.0)
    dead_band_rpm: float = 0.0
    dead_time_s: float = 0.0
    lag_s: float = 0.0
    droop_rpm_per_uN_mm: float = 0.0
    compliance_rad_per_mN: float = 0.0
    terms: list[Term] = field(default_factory=list)
    last: list[Callable[[Draft], None]] = field(default_factory=list)

    def add(self, *terms: Term) -> None:
        """Add terms; those with coefficient 0 are dropped, so that an absent effect costs nothing."""
        self.terms += [term for term in terms if term.coefficient]

    def finally_do(self, act: Callable[[Draft], None]) -> None:
        """Let an effect act once all others have, where it needs the loads or the centre of gravity they leave."""
        self.last.append(act)

    def finish(self) -> None:
        """Let act what waited for all other effects."""
        for act in self.last:
            act(self)
        self.last.clear()

    def loads_uN(self) -> tuple[Array, Array]:
        """Weight share and load f_z of each wheel; the weight is shared by the levers of the centre of gravity."""
        robot, attraction = self.robot, self.robot.magnetic_attraction
        forward = 2 * self.gravity_mm[0] / robot.wheels.wheelbase_mm
        left = 2 * self.gravity_mm[1] / robot.wheels.track_mm
        if max(abs(forward), abs(left)) >= 1:
            raise SimulationError(f"{robot.name}: a centre of gravity at {self.gravity_mm} mm is outside the wheels")
        share = robot.weight_uN / 4
        weight = np.array(
            [share * front * side for front in (1 + forward, 1 - forward) for side in (1 + left, 1 - left)]
        )
        front, rear = UN_PER_MN * attraction.driving_wheel_mN, UN_PER_MN * attraction.driven_wheel_mN
        return weight, weight + np.array([front, front, rear, rear]) * self.attraction_factor
