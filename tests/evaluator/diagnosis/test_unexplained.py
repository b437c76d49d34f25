"""Beside the verdict that nothing is missing, nothing that matters may be left over."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.assessment.residuals import unexplained as module
from evaluator.diagnosis.assessment.residuals.disagreement import Dependence
from evaluator.diagnosis.assessment.residuals.unexplained import moved_mm, unexplained

HALF_MM, LASTING_S, FLOOR_MM = 1.8, 8.0, 0.005


@pytest.fixture
def problem(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Five runs, of which one is short."""
    monkeypatch.setattr(module, "noise_floor", lambda _, runs: np.full(len(runs), FLOOR_MM))
    lasting = [LASTING_S] * 4 + [2.0]
    data = [SimpleNamespace(time_s=np.array([0.0, 0.5 + s]), start_s=0.5) for s in lasting]
    return SimpleNamespace(data=data, half_distance_mm=HALF_MM)


def asked(sigmas: float, rms: float, quantity: str = "along_mm_s") -> list[Dependence]:
    """Fifty things asked, of which one stands out."""
    others = [Dependence(quantity, "place", "odd", 1.0, "", (), 0.1)] * 49
    return [*others, Dependence(quantity, "speed", "odd", sigmas, "it grows with speed", (), rms)]


def test_a_constant_rate_moves_marks_by_what_no_start_pose_takes_up(problem: Any) -> None:
    time = np.linspace(0, LASTING_S, 2001)
    along = asked(9.0, 0.01)[-1]
    assert moved_mm(along, problem) == pytest.approx(np.std(0.01 * time), rel=1e-3)
    turning = asked(9.0, 0.2, "yaw_deg_s")[-1]
    assert moved_mm(turning, problem) == pytest.approx(np.std(np.radians(0.2) * HALF_MM * time), rel=1e-3)


# of fifty things one reaches 4.265 sigmas by chance once in a thousand experiments; half a noise floor are 1.08 um/s
@pytest.mark.parametrize(
    ("sigmas", "rms", "believed"),
    [(4.28, 0.0012, True), (4.25, 0.0012, False), (4.4, 0.0010, False), (8.2, 0.0005, False)],
)
def test_what_is_no_chance_and_matters_is_left_unexplained(
    sigmas: float, rms: float, believed: bool, problem: Any
) -> None:
    found = unexplained(asked(sigmas, rms), problem, 0.5)
    assert (found is not None and found.sentence == "it grows with speed") is believed


def test_the_most_significant_is_told(problem: Any) -> None:
    items = [*asked(6.0, 0.1), *asked(9.0, 0.01), *asked(7.0, 0.2)]
    found = unexplained(items, problem, 0.5)
    assert found is not None
    assert found.sigmas == 9.0
