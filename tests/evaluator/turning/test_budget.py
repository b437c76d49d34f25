"""The uncertainty budget: sources of known size give what geometry says they give, and sum to the stated interval."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.mark_geometry import MarkGeometry
from evaluator.turning.budget import Budget, Knowledge, uncertainty_budget
from tests.evaluator.synthetic import circling_marks

RADIUS = 6.0
GEOMETRY = MarkGeometry({"green": (-1.55, 1.83), "yellow": (-1.55, -1.83)}, height_mm=6.5)


def budget(**known: float) -> Budget:
    noise = np.random.default_rng(6)
    marks = circling_marks(RADIUS)
    marks.iloc[:, 1:5] += noise.normal(0, 0.002, (len(marks), 4))
    return uncertainty_budget(marks, GEOMETRY, known=Knowledge(**known))


def test_marks_off_along_both_axes_give_what_geometry_says() -> None:
    sigma = 0.05
    (places,) = [item for item in budget(mark_position_mm=sigma).contributions if item.source.startswith("places")]
    # A mark off along x turns the heading by sigma / spacing, and the centre, 1.55 mm ahead of the marks, moves
    # sideways by 1.55 mm times that; one off along y moves the middle of both by half of it. There are two of each.
    turned = sigma * np.sqrt(2) / 3.66
    assert places.heading_deg == pytest.approx(np.degrees(turned), rel=0.03)
    assert places.radius_mm == pytest.approx(np.hypot(1.55 * turned, sigma / np.sqrt(2)), rel=0.03)
    assert not places.measured


def test_measurement_alone_is_the_interval() -> None:
    found = budget()
    turning = found.turning
    half = (turning.radius_high_mm - turning.radius_low_mm) / 2
    assert found.combined(measured_only=True).radius_mm * 1.96 == pytest.approx(half, rel=0.15)
    assert found.combined(measured_only=False).radius_mm > 10 * found.combined(measured_only=True).radius_mm


def test_the_clock_concerns_speed_alone() -> None:
    (clock,) = [item for item in budget(time_base=0.01).contributions if item.source.startswith("clock")]
    assert clock.speed_mm_s == pytest.approx(0.01 * abs(budget().turning.speed_mm_s), rel=1e-6)
    assert (clock.radius_mm, clock.heading_deg) == (0.0, 0.0)
