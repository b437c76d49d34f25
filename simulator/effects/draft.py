"""Robot draft that effects may change before it is compiled for the kernels. Units: mm, s, g, µN and rad."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from simulator.dynamics.layout import Layout
from simulator.dynamics.statics import wheel_loads
from simulator.dynamics.terms import LEFT_COMMAND, LEFT_DRIVE, Term
from simulator.nominal_robot import NominalRobot

Array = NDArray[np.float64]
NO_LIMIT_RPM = 1e6  # a limit that no wheel reaches


@dataclass
class Draft:
    """What effects may change before a robot is compiled: factors, offsets and added terms.

    layout: the wheels, and which of them (left, right, driving, rolling) are driven by what, as masks (n,). Arrays over
    wheels are (n,), in the robot's order. speed_factor: (2,), of the left and the right command.
    across_factor: of the lateral friction of all wheels, besides friction_factor. run_index: number of the run in its
    session, from 0. mix: (2, 4), added to the left and the right command per rpm of left, right, |left| and |right|.
    limits_rpm: (3,), of each wheel, of the mean of both sides, and of half of their difference. ramps_s_per_rpm: (3,),
    least time in which that mean, that half and each wheel change by 1 rpm.
    """

    robot: NominalRobot
    run_index: int = 0
    layout: Layout = field(init=False)
    attraction_factor: Array = field(init=False)
    friction_factor: Array = field(init=False)
    toe_rad: Array = field(init=False)
    gravity_mm: tuple[float, float] = field(init=False)
    speed_factor: Array = field(default_factory=lambda: np.ones(2))
    dead_band_rpm: float = 0.0
    dead_time_s: float = 0.0
    lag_s: float = 0.0
    droop_rpm_per_uN_mm: float = 0.0
    compliance_rad_per_mN: float = 0.0
    sliding_share: float = 0.0
    across_factor: float = 1.0
    terms: list[Term] = field(default_factory=list)
    last: list[Callable[[Draft], None]] = field(default_factory=list)
    mix: Array = field(default_factory=lambda: np.zeros((2, 4)))
    limits_rpm: tuple[float, ...] = (NO_LIMIT_RPM,) * 3
    ramps_s_per_rpm: tuple[float, ...] = (0.0,) * 3

    def __post_init__(self) -> None:
        """Initialise factors for the robot's wheels, and its centre of gravity."""
        self.layout = Layout.of(self.robot)
        count = len(self.layout.wheels)
        self.attraction_factor, self.friction_factor, self.toe_rad = np.ones(count), np.ones(count), np.zeros(count)
        self.gravity_mm = self.robot.body.center_of_gravity_mm

    def add(self, *terms: Term) -> None:
        """Add terms; those with coefficient 0 are dropped, so that an absent effect costs nothing."""
        for term in terms:
            if term.acts_on_drive:
                self.mix[term.channel - LEFT_DRIVE, term.basis - LEFT_COMMAND] += term.coefficient
            elif term.coefficient:
                self.terms.append(term)

    def finally_do(self, act: Callable[[Draft], None]) -> None:
        """Defer an effect that needs the loads or the centre of gravity until all others have acted."""
        self.last.append(act)

    def finish(self) -> None:
        """Apply the deferred effects."""
        for act in self.last:
            act(self)
        self.last.clear()

    def loads_uN(self) -> tuple[Array, Array]:
        """Weight share and load f_z of each wheel, (n,) each, by statics; 0 where a wheel has lifted off."""
        layout, attraction = self.layout, self.layout.attraction_uN * self.attraction_factor
        robot = self.robot
        return wheel_loads(robot.name, layout.places_mm, robot.weight_uN, self.gravity_mm, attraction, layout.rectangle)
