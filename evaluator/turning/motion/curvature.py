"""Curvature of a path with its uncertainty, and the radius that follows from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Z_975 = 1.96  # standard deviations on either side of the mean of a normal distribution that include 95 %

LEAST_RADIUS_MM = 1e-6  # lower bound of a radius that may be zero: its curvature is finite


@dataclass(frozen=True)
class Curvature:
    """Curvature of the path of the robot's centre with 95 % bounds, 1/mm; positive counter-clockwise.

    sigma: standard uncertainty from noise, reduced by more frames; systematic: from the uncertainty of the camera and
    of the marks on the robot, reduced by better knowledge of these only. The bounds include both.
    """

    value: float
    low: float
    high: float
    sigma: float
    systematic: float = 0.0

    def with_systematic(self, systematic: float) -> Curvature:
        """Bounds widened by a systematic standard uncertainty; independent errors add in quadrature."""
        reach = Z_975 * systematic
        return Curvature(
            self.value,
            self.value - float(np.hypot(self.value - self.low, reach)),
            self.value + float(np.hypot(self.high - self.value, reach)),
            self.sigma,
            float(np.hypot(self.systematic, systematic)),
        )

    @property
    def straight(self) -> bool:
        """Whether the interval includes a straight path."""
        return self.low <= 0 <= self.high

    def with_radius_error(self, sigma_mm: float) -> Curvature:
        """Bounds widened by a systematic standard uncertainty of the radius; the same if the path may be straight."""
        radius, low, high = self.radius_mm()
        if not np.isfinite(radius) or not sigma_mm:
            return self
        reach = Z_975 * sigma_mm
        tighter = max(radius - float(np.hypot(radius - low, reach)), LEAST_RADIUS_MM)
        wider = radius + float(np.hypot(high - radius, reach))
        low_per_mm, high_per_mm = sorted(np.sign(self.value) / np.array([wider, tighter]))
        systematic = float(np.hypot(self.systematic, sigma_mm / radius**2))
        return Curvature(self.value, float(low_per_mm), float(high_per_mm), self.sigma, systematic)

    def radius_mm(self) -> tuple[float, float, float]:
        """Radius with its 95 % bounds; NaN if the path may be straight."""
        if self.straight or self.value == 0:
            return float("nan"), float("nan"), float("nan")
        ends = sorted((abs(self.low), abs(self.high)))
        return abs(1 / self.value), 1 / ends[1], 1 / ends[0]
