from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from evaluator.comparison import trajectory_gap

STILL = np.zeros(4)


@pytest.mark.parametrize("turns", [-2, 0, 1])
def test_heading_gap_counts_from_the_start_and_whole_turns_in_between_stay(turns: int) -> None:
    measured = SimpleNamespace(x_mm=STILL, y_mm=STILL, heading_rad=np.radians([10.0, 100.0, 200.0, 300.0]))
    heading = np.radians([12.0, 190.0, 380.0, 665.0]) + 2 * np.pi * turns
    simulated = SimpleNamespace(x_mm=STILL, y_mm=STILL, heading_rad=heading)
    assert trajectory_gap(measured, simulated)["heading_gap_end_deg"] == pytest.approx(365.0)  # type: ignore[arg-type]


def test_gap_is_that_of_the_frames_where_the_pose_is_known() -> None:
    measured = SimpleNamespace(x_mm=np.array([0.0, np.nan, 0.0, np.nan]), y_mm=STILL, heading_rad=STILL)
    simulated = SimpleNamespace(x_mm=np.array([3.0, 9.0, 4.0, 9.0]), y_mm=STILL, heading_rad=STILL)
    gap = trajectory_gap(measured, simulated)  # type: ignore[arg-type]
    assert gap["gap_rms_mm"] == pytest.approx(np.sqrt((9 + 16) / 2))
    assert gap["gap_end_mm"] == pytest.approx(4.0)
