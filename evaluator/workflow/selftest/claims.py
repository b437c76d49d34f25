"""The accuracy claims of this version: limits that a self-test must meet on any machine.

The measured figures, with their conditions, are in tests/benchmarks/README.md; a limit allows for other noise, not for
another algorithm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Claim:
    """A figure and its allowed range. stage: step of the self-test that measures it."""

    id: str
    stage: str
    what: str
    unit: str
    low: float
    high: float
    why: str

    @property
    def expected(self) -> str:
        """The range in words."""
        if self.low == self.high:
            return f"{self.low:g}{self._unit}"
        if math.isinf(self.low):
            return f"at most {self.high:g}{self._unit}"
        return f"{self.low:g} to {self.high:g}{self._unit}"

    def holds(self, value: float) -> bool:
        """Whether a value is in the range; NaN is not."""
        return self.low <= value <= self.high

    @property
    def _unit(self) -> str:
        return f" {self.unit}" if self.unit else ""


def at_most(id: str, stage: str, what: str, high: float, unit: str, why: str) -> Claim:  # noqa: A002  # the field's name
    """A claim that a figure, such as an absolute error, is small."""
    return Claim(id, stage, what, unit, -math.inf, high, why)


def exactly(id: str, stage: str, what: str, value: float, why: str) -> Claim:  # noqa: A002
    """A claim that a count, or yes (1) and no (0), has a certain value."""
    return Claim(id, stage, what, "", value, value, why)


CALIBRATING, TRACKING, FITTING, SIMULATING, DIAGNOSING = "calibrate", "track", "fit", "simulate", "diagnose"

CLAIMS = (
    at_most(
        "residual_px", CALIBRATING, "residual of the gauge's dots, RMS", 0.005, "px",
        "0.0018 px on the reference machine; rendered gauges are exact",
    ),
    at_most(
        "marks_um", TRACKING, "error of a mark's place on the plate, RMS", 5.0, "µm",
        "0.037 px in H.264 at 16 px/mm is 2.3 µm, and the camera adds as much",
    ),
    exactly("frames", TRACKING, "share of the frames in which both marks are found", 1.0, "nothing hides them"),
    at_most(
        "radius_percent", FITTING, "error of the turning radius", 0.1, "%",
        "the sample recordings are within 0.02 %; this arc is shorter",
    ),
    at_most(
        "radius_intervals", FITTING, "error of the radius over half its 95 % interval", 1.5, "",
        "beyond 1 in one of 20 draws, beyond 1.5 in one of 300",
    ),
    at_most(
        "simulated_um", SIMULATING, "largest distance from the path that came with this version", 0.01, "µm",
        "the path is written to 0.0001 µm; another processor may round otherwise",
    ),
    exactly("named", DIAGNOSING, "only the hidden effect is named (1: yes)", 1.0, "it is as large as in the puzzle"),
    at_most(
        "size_intervals", DIAGNOSING, "error of its size over half its 95 % interval", 1.5, "",
        "beyond 1 in one of 20 draws, beyond 1.5 in one of 300",
    ),
    exactly("swapped", DIAGNOSING, "only the exchanged run is left out (1: yes)", 1.0, "it turns the other way"),
)  # fmt: skip
