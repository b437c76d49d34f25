"""One number of an effect as it is declared: unit, the value at which it does nothing, step and bounds of a fit."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf


@dataclass(frozen=True)
class Unit:
    """A unit of parameters: how names of parameters end in it (of gradients: begin), and how it is shown to people."""

    ending: str
    shown: str


# By the unit that a parameter declares. The longer endings stand before those that they end in.
UNITS = {
    "rpm/(µN·mm)": Unit("rpm_per_uN_mm", "rpm/(µN·mm)"),
    "deg/mN": Unit("deg_per_mN", "°/mN"),
    "mN·s/mm": Unit("mN_s_mm", "mN·s/mm"),
    "µN·mm·s": Unit("uN_mm_s", "µN·mm·s"),
    "mN/mm": Unit("mN_mm", "mN/mm"),
    "1/run": Unit("per_run", "per run"),
    "1/mm": Unit("per_mm", "per mm"),
    "deg/s": Unit("deg_s", "°/s"),
    "mm/s": Unit("mm_s", "mm/s"),
    "deg": Unit("deg", "°"),
    "mm": Unit("mm", "mm"),
    "mN": Unit("mN", "mN"),
    "rpm": Unit("rpm", "rpm"),
    "s": Unit("s", "s"),
    "": Unit("", ""),
}


SHOWN_STEPS = 20  # a step shows in the marks; so many show in a small drawing


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    unit: a key of UNITS; absent: the value at which the effect vanishes, and which holds where an entry does not give
    the parameter; step: a small change that shows in the marks, for differences and scaling; low, high: bounds of a
    fit; at_least: values below make no sense and are refused; period: of an angle, in its unit, else None; shown: value
    at which the catalogue draws the effect, without it SHOWN_STEPS steps from absent.
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

    @property
    def shown_value(self) -> float:
        """The value at which the catalogue draws the effect."""
        return self.absent + SHOWN_STEPS * self.step if self.shown is None else self.shown
