"""Commands that are rounded are told only where that explains how much the speeds of the wheels vary."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.diagnosis.output.scatter_json import rounding_rpm


@pytest.mark.parametrize(
    ("speeds", "low", "high", "step"),
    [
        ((35.0, 10.0, -25.0, 20.0, 0.0, 45.0, 30.0), 0.03, 0.08, 5.0),  # 1.4 rpm of 27: 6.7 %
        ((35.0, 10.0, -25.0, 20.0, 0.0, 45.0, 30.0), 0.001, 0.01, None),
        ((35.0, 10.0, -25.0, 20.0, 0.0, 45.0, 30.0), 0.09, 0.1, None),
        ((35.0, 10.0, -25.0, 20.0, 0.0, 45.0, 30.1), 0.03, 0.08, None),
        ((35.0, 10.0, -25.0, 20.0, 0.0, 45.0), 0.03, 0.08, None),  # five speeds may be multiples by chance
        ((33.5, 10.0, -25.0, 20.0, 0.5, 45.0, 30.0), 0.001, 0.3, 0.5),
        ((335.0, 100.5, -250.0, 200.5, 400.0, 450.0, 300.0), 0.0001, 0.3, None),  # 0.08 %: motors vary more
    ],
)
def test_commands_that_are_rounded_are_told_if_that_explains_the_scatter_of_speeds(
    speeds: tuple[float, ...], low: float, high: float, step: float | None
) -> None:
    runs: Any = [SimpleNamespace(log=None, command=(speed, 0.0)) for speed in speeds]
    assert rounding_rpm(runs, low, high) == step
    logs: Any = [SimpleNamespace(log=object(), command=(speed, 0.0)) for speed in speeds]
    assert rounding_rpm(logs, low, high) is None
