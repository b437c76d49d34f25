"""Bad input is normal input: a result with a reason, never a traceback or a wrong number."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from calibration.camera import camera_above
from evaluator.errors import InputError
from evaluator.pose import poses_from_marks
from evaluator.turning import Turning, measure_turning

from .synthetic import GEOMETRY, arc_poses, marks_of, resting

MARKS = ["green_x_mm", "green_y_mm", "yellow_x_mm", "yellow_y_mm"]


def circle(sigma_mm: float = 0.01, frames: int = 300, turned_deg: float = 360.0) -> pd.DataFrame:
    return marks_of(arc_poses(5.0, turned_deg, frames), sigma_mm, np.random.default_rng(0))


def measured(marks: pd.DataFrame) -> Turning:
    return measure_turning(poses_from_marks(marks, GEOMETRY))


def test_recording_without_marks_has_no_radius_but_a_reason() -> None:
    marks = circle()
    marks[MARKS] = np.nan
    camera = camera_above(size_px=(640, 480), focal_px=2000, distance_mm=150)
    turning = measure_turning(poses_from_marks(marks, GEOMETRY, camera))
    assert np.isnan(turning.radius_mm)
    assert turning.radius_status == "0 frames with a pose; 8 are needed"


@pytest.mark.parametrize("frames", [2, 5, 7, 8, 9, 12])
def test_few_frames_give_a_wide_interval_or_a_reason(frames: int) -> None:
    turning = measured(circle(0.001, frames, 40.0))
    width = turning.radius_high_mm - turning.radius_low_mm
    assert turning.radius_status != "ok" or abs(turning.radius_mm - 5.0) < width  # four standard uncertainties


def test_half_the_frames_missing_in_long_gaps_leaves_the_radius_right() -> None:
    marks = circle(0.01, 400, 720.0)
    for start in range(20, 400, 80):
        marks.loc[start : start + 39, MARKS] = np.nan
    turning = measured(marks)
    assert turning.radius_low_mm < 5.0 < turning.radius_high_mm
    assert turning.turned_deg == pytest.approx(720, abs=80)


def test_exchanged_marks_are_set_aside() -> None:
    marks = circle()
    marks.loc[100:107, MARKS] = marks.loc[100:107, [*MARKS[2:], *MARKS[:2]]].to_numpy()
    turning = measured(marks)
    assert turning.radius_mm == pytest.approx(5.0, rel=1e-3)
    assert turning.share_used < 1


def test_turn_on_the_spot_has_an_interval_that_reaches_zero() -> None:
    turning = measured(marks_of(arc_poses(1e-4, 720, 400), 0.01, np.random.default_rng(1)))
    assert turning.radius_status == "ok"
    assert turning.radius_low_mm == pytest.approx(0.0, abs=1e-3)
    assert turning.radius_high_mm < 0.01


def test_motion_outside_the_commanded_time_is_not_measured() -> None:
    marks = marks_of(resting(arc_poses(5.0, 360, 300), 200, 10), 0.01, np.random.default_rng(2))
    turning = measure_turning(poses_from_marks(marks, GEOMETRY), start_s=0.0, stop_s=2.0)
    assert turning.radius_status.startswith("at rest")


def test_stop_before_start_is_refused() -> None:
    with pytest.raises(InputError, match="not after start"):
        measure_turning(poses_from_marks(circle(), GEOMETRY), start_s=3.0, stop_s=1.0)


def test_recording_of_a_frozen_picture_is_at_rest() -> None:
    marks = circle()
    marks[MARKS] = marks.loc[0, MARKS].to_numpy(float)
    assert measured(marks).radius_status.startswith("at rest")
