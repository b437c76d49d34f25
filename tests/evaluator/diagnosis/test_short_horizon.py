"""When a search begins with the first seconds of the runs."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.diagnosis.inference.short_horizon import is_implausible
from evaluator.diagnosis.likelihood.point import Point


@pytest.mark.parametrize(
    ("number", "usual", "beyond"),
    [(3, 0.29, 0.31), (3, -0.29, -0.31), (4, 0.059, 0.061), (5, -0.059, -0.061), (6, 9.9, 10.1), (0, 1e3, None)],
)
def test_friction_of_30_percent_or_a_wheel_of_6_percent_hides_a_misfit(
    number: int, usual: float, beyond: float | None
) -> None:
    """A run's own numbers: x, y, heading of its start, friction, gains of left and right, start of motion."""
    own = np.zeros((5, 7))
    own[2, number] = usual
    assert not is_implausible(Point(own, {}, {}))
    if beyond is not None:
        own[2, number] = beyond
        assert is_implausible(Point(own, {}, {}))
