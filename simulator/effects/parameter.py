"""Declaration of a parameter of an effect: unit, value at which it vanishes, step and bounds of a fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf


@dataclass(frozen=True)
class Unit:
    """A unit of parameters: the suffix of their names (for gradients the prefix), and how it is shown to people.

    length, force: its powers of length and of force.
    """

    ending: str
    shown: str
    length: int = 0
    force: int = 0


# Keys are the units that parameters declare. A suffix that ends in another one stands before it.
UNITS = {
    "rpm/(µN·mm)": Unit("rpm_per_uN_mm", "rpm/(µN·mm)", -1, -1),
    "deg/mN": Unit("deg_per_mN", "°/mN", 0, -1),
    "mN·s/mm": Unit("mN_s_mm", "mN·s/mm", -1, 1),
    "µN·mm·s": Unit("uN_mm_s", "µN·mm·s", 1, 1),
    "ms/mm": Unit("ms_per_mm", "ms/mm", -1),
    "mN/mm": Unit("mN_mm", "mN/mm", -1, 1),
    "1/run": Unit("per_run", "per run"),
    "1/mm": Unit("per_mm", "per mm", -1),
    "deg/s": Unit("deg_s", "°/s"),
    "mm/s": Unit("mm_s", "mm/s", 1),
    "rpm/s": Unit("rpm_s", "rpm/s"),
    "deg": Unit("deg", "°"),
    "mm": Unit("mm", "mm", 1),
    "mN": Unit("mN", "mN", 0, 1),
    "rpm": Unit("rpm", "rpm"),
    "s": Unit("s", "s"),
    "": Unit("", ""),
}


# Largest size on a plate: wheels 45 mm from their middle, so that tight turns need a quarter of a metre of plate.
ON_PLATE = 16.0


@dataclass(frozen=True)
class Size:
    """Size of a robot relative to the paper's: ratios of length and of wheel load.

    Steps and bounds of parameters are declared for the paper's robot and scaled for others. Times, angles and
    rotational frequencies are not scaled: a robot of a metre moves about as many of its lengths per second.
    """

    length: float = 1.0
    force: float = 1.0
    filmed: bool = False

    @property
    def full(self) -> bool:
        """Whether the robot is too large for a plate."""
        return self.length > ON_PLATE

    @property
    def on_ground(self) -> bool:
        """Whether the robot drives on open ground: it is too large for a plate, and no fixed camera sees its marks."""
        return self.full and not self.filmed

    def of(self, unit: str) -> float:
        """Factor by which a quantity with this unit, a key of UNITS, is scaled for the robot."""
        return float(self.length ** UNITS[unit].length * self.force ** UNITS[unit].force)


PAPER_SIZE = Size()
# Bounds on open ground. Lengths from lidar, motion capture or satellites are right to some per cent: a factor beyond 10
# % is a wrong unit. Quartz clocks are right to 1e-4: beyond 1 %, a recording was replayed at another rate. On a plate
# both are stated by the user (gauge, frame rate) and may be wrong by any factor.
OF_METRES, OF_SECONDS = (0.9, 1.1), (0.99, 1.01)
SHOWN_STEPS = 20  # one step is visible in the marks, 20 in a small drawing


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    unit: a key of UNITS; absent: the value at which the effect vanishes, which is also the default of an entry; step: a
    small change that is visible in the marks, for finite differences and scaling; low, high: bounds of a fit; at_least:
    smaller values are physically impossible and refused; period: of an angle, in its unit, else None; shown: value at
    which the catalogue draws the effect, by default SHOWN_STEPS steps from absent; on_ground: bounds of a fit to a
    robot on open ground, if they are not proportional to its size; closed: see Coordinate; begin: initial
    value of a fit of a user's effect, besides those from linearization.
    """

    name: str
    unit: str
    absent: float
    step: float
    low: float = -inf
    high: float = inf
    at_least: float = -inf
    period: float | None = None
    shown: float | None = None
    on_ground: tuple[float, float] | None = None
    closed: bool = False
    begin: float | None = None

    @property
    def shown_value(self) -> float:
        """The value at which the catalogue draws the effect."""
        return self.absent + SHOWN_STEPS * self.step if self.shown is None else self.shown

    def sized(self, size: Size) -> Parameter:
        """The parameter with the step and the bounds of a fit to a robot of another size."""
        if self.on_ground and size.on_ground:
            return replace(self, low=self.on_ground[0], high=self.on_ground[1])
        factor = size.of(self.unit)
        if factor == 1.0:
            return self
        low, high = ((bound - self.absent) * factor + self.absent for bound in (self.low, self.high))
        return replace(self, step=self.step * factor, low=low, high=high)
