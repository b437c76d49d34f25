"""Declaration of a parameter of an effect: unit, value at which it vanishes, step and bounds of a fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf


@dataclass(frozen=True)
class Unit:
    """A unit of parameters: how names of parameters end in it (of gradients: begin), and how it is shown to people.

    length, force: powers of length and of force in it.
    """

    ending: str
    shown: str
    length: int = 0
    force: int = 0


# By the unit that a parameter declares. The longer endings stand before those that they end in.
UNITS = {
    "rpm/(µN·mm)": Unit("rpm_per_uN_mm", "rpm/(µN·mm)", -1, -1),
    "deg/mN": Unit("deg_per_mN", "°/mN", 0, -1),
    "mN·s/mm": Unit("mN_s_mm", "mN·s/mm", -1, 1),
    "µN·mm·s": Unit("uN_mm_s", "µN·mm·s", 1, 1),
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


@dataclass(frozen=True)
class Size:
    """How large a robot is beside the paper's: ratios of length and of the load on its wheels.

    Steps and bounds of parameters are stated for the paper's robot; of another they are as many times as large. Times,
    angles and rotational frequencies are alike: a robot of a metre moves as many of its lengths in a second.
    """

    length: float = 1.0
    force: float = 1.0

    def of(self, unit: str) -> float:
        """How many times as large a quantity with this unit, a key of UNITS, is on the robot."""
        return float(self.length ** UNITS[unit].length * self.force ** UNITS[unit].force)


PAPER_SIZE = Size()
# Metres of a lidar, of motion capture or of satellites hold to some per cent: a factor beyond a tenth is a wrong unit.
# Quartz holds seconds to 1e-4: beyond a per cent a recording was played at another rate. Of a gauge laid on a plate and
# of a frame rate anything may be stated.
OF_METRES, OF_SECONDS = (0.9, 1.1), (0.99, 1.01)
SHOWN_STEPS = 20  # a step shows in the marks; so many show in a small drawing


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    unit: a key of UNITS; absent: the value at which the effect vanishes, and which holds where an entry does not give
    the parameter; step: a small change that shows in the marks, for differences and scaling; low, high: bounds of a
    fit; at_least: values below make no sense and are refused; period: of an angle, in its unit, else None; shown: value
    at which the catalogue draws the effect, without it SHOWN_STEPS steps from absent; on_ground: bounds of a fit to a
    robot of another size than the paper's, where they are not in proportion; closed: see Coordinate; begin: of a user's
    own effect, where a fit begins besides where a linear view leads.
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
        if self.on_ground and size != PAPER_SIZE:
            return replace(self, low=self.on_ground[0], high=self.on_ground[1])
        factor = size.of(self.unit)
        if factor == 1.0:
            return self
        low, high = ((bound - self.absent) * factor + self.absent for bound in (self.low, self.high))
        return replace(self, step=self.step * factor, low=low, high=high)
