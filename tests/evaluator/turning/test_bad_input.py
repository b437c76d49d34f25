"""Bad input is normal input: a result with a reason, never a traceback or a wrong number."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from calibration.camera import camera_above
from evaluator.errors import InputError
from evaluator.pose import poses_from_marks
from evaluator.turning import Turning, measure_turning

from .synthetic import GEOMETRY, arc_poses, marks_of, resting, winding_poses

MARKS = ["green_x_mm", "green_y_mm", "yellow_x_mm", "yellow_y_mm"]


def circle(sigma_mm: float = 0.01, frames: int = 300, turned_deg: float = 360.0) -> pd.DataFrame:
    return marks_of(arc_poses(5.0, turned_deg, frames), sigma_mm, np.random.default_rng(0))


def measured_marks(marks: pd.DataFrame) -> Turning:
    return measure_turning(poses_from_marks(marks, GEOMETRY))


def test_recording_without_marks_has_no_radius_but_a_reason() -> None:
    marks = circle()
    marks[MARKS] = np.nan
    camera = camera_above(size_px=(640, 480), focal_px=2000, distance_mm=150)
    turning = measure_turning(poses_from_marks(marks, GEOMETRY, camera))
    assert np.isnan(turning.radius_mm)
    assert turning.radius_status == "0 frames with a pose; 8 are needed (green: absent)"


@pytest.mark.parametrize("frames", [2, 5, 7, 8, 9, 12])
def test_few_frames_give_a_wide_interval_or_a_reason(frames: int) -> None:
    turning = measured_marks(circle(0.001, frames, 40.0))
    width = turning.radius_high_mm - turning.radius_low_mm
    assert turning.radius_status != "ok" or abs(turning.radius_mm - 5.0) < width  # four standard uncertainties


def test_half_the_frames_missing_in_long_gaps_leaves_the_radius_right() -> None:
    marks = circle(0.01, 400, 720.0)
    for start in range(20, 400, 80):
        marks.loc[start : start + 39, MARKS] = np.nan
    turning = measured_marks(marks)
    assert turning.radius_low_mm < 5.0 < turning.radius_high_mm
    assert turning.turned_deg == pytest.approx(720, abs=80)


def test_exchanged_marks_are_rejected() -> None:
    marks = circle()
    marks.loc[100:107, MARKS] = marks.loc[100:107, [*MARKS[2:], *MARKS[:2]]].to_numpy()
    turning = measured_marks(marks)
    assert turning.radius_mm == pytest.approx(5.0, rel=1e-3)
    assert turning.share_used < 1


def test_turn_on_the_spot_has_an_interval_that_reaches_zero() -> None:
    turning = measured_marks(marks_of(arc_poses(1e-4, 720, 400), 0.01, np.random.default_rng(1)))
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


def test_recording_of_a_frozen_image_is_at_rest() -> None:
    marks = circle()
    marks[MARKS] = marks.loc[0, MARKS].to_numpy(float)
    assert measured_marks(marks).radius_status.startswith("at rest")


@pytest.mark.parametrize(
    ("factor", "said"),
    [(1e-3, "look like m,"), (0.1, "look like cm,"), (1 / 25.4, "look like inches,"), (0.4, "2.5 times too near")],
)
def test_lengths_that_the_marks_belie_are_said_first_with_the_likely_unit(factor: float, said: str) -> None:
    marks = circle()
    marks[MARKS] *= factor
    turning = measured_marks(marks)
    assert said in turning.radius_status
    assert turning.summary() == turning.radius_status
    assert np.isnan(turning.radius_mm)


def test_lengths_in_pixels_are_recognised() -> None:
    marks = circle()
    marks[MARKS] = 40 * marks[MARKS] + 500
    assert "look like px" in measured_marks(marks).radius_status


def test_marks_a_tenth_off_still_have_a_radius() -> None:
    marks = circle()
    marks[MARKS] *= 1.1
    assert measured_marks(marks).radius_status == "ok"


def test_marks_in_one_place_have_no_heading() -> None:
    marks = circle()
    marks.loc[:149, MARKS[2:]] = marks.loc[:149, MARKS[:2]].to_numpy()
    poses = poses_from_marks(marks, GEOMETRY)
    assert not poses.measured[:150].any()
    assert poses.status[0] == "both marks are at one position: no heading"
    assert measure_turning(poses).radius_mm == pytest.approx(5.0, rel=1e-2)


def test_wandering_within_noise_has_no_radius_of_kilometres() -> None:
    """Of straight runs with a bow of 1 µm some are significant at 95 %; none has a radius."""
    curvature = np.full(300, 3e-6)
    found = [
        measured_marks(marks_of(winding_poses(curvature, 0.17), 0.003, np.random.default_rng(seed)))
        for seed in range(10)
    ]
    assert all(np.isnan(turning.radius_mm) for turning in found)
    unproven = ("straight: curvature", "straight or hardly turning: curvature")
    assert all(turning.radius_status.startswith(unproven) for turning in found)
    assert any(turning.curvature_low_per_mm > 0 for turning in found)
