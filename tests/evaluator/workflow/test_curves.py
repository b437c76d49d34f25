"""The curves of a run for its player, in closed form: a turn about a point, and a camera that sees it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from calibration.camera import camera_above
from evaluator.mark_geometry import MarkGeometry
from evaluator.workflow.viewing.curves import _mark_columns, _pose_columns, _slope

TIME_S = np.arange(120) / 60
MARKS = MarkGeometry({"green": (0.0, 1.0), "yellow": (0.0, -1.0)}, height_mm=6.5)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_speed_is_that_along_the_heading_and_places_are_where_the_camera_sees_them(way: float) -> None:
    """At 8 mm about (10, 20) mm, 0.6 rad/s to the left; backward the robot looks the other way."""
    camera = camera_above(size_px=(640, 480), focal_px=2000, distance_mm=150)
    angle = 0.6 * TIME_S
    heading = angle + (0.0 if way > 0 else np.pi)
    x, y = 10 + 8 * np.sin(angle), 20 - 8 * np.cos(angle)
    table = pd.DataFrame({"time_s": TIME_S, "x_mm": x, "y_mm": y, "heading_deg": np.degrees(heading)})
    found = _pose_columns(table, camera, MARKS)
    np.testing.assert_allclose(found["speed_mm_s"], way * 4.8, rtol=2e-3)
    np.testing.assert_allclose(found["yaw_rate_deg_s"], np.degrees(0.6), rtol=1e-6)
    np.testing.assert_allclose(found["heading_deg"], table["heading_deg"])
    for name, ahead in (("center", 0.0), ("nose", 2.2)):
        place = np.stack([x + ahead * np.cos(heading), y + ahead * np.sin(heading), np.full(120, 6.5)], axis=1)
        seen = np.stack([found[f"{name}_x_px"], found[f"{name}_y_px"]], axis=1)
        np.testing.assert_allclose(seen, camera.image_from_plate(place))
    assert "nose_x_px" not in _pose_columns(table, None, MARKS)


def test_a_slope_is_over_a_fifth_of_a_second_and_is_unknown_where_the_value_is() -> None:
    values = np.abs(TIME_S - 1.0)  # turns back at 1 s
    values[5] = np.nan
    slope = _slope(TIME_S, values)
    assert np.isnan(slope[5])
    assert (slope[0], slope[54], slope[66], slope[-1]) == pytest.approx((-1.0, -1.0, 1.0, 1.0))
    assert slope[57] == pytest.approx(-0.5)  # 0.05 s before it turns back
    square = _slope(TIME_S, TIME_S**2)  # the sum of the times at both ends
    assert square[[0, 54, -1]] == pytest.approx([0.1, 1.8, 2 * TIME_S[-1] - 0.1])
    assert np.isnan(_slope(TIME_S, np.where(TIME_S == 0.5, 1.0, np.nan))).all()


def test_marks_have_their_columns_and_why_they_are_absent() -> None:
    marks = pd.DataFrame(
        {"frame": [3, 4], "time_s": [0.0, 0.1], "green_x_mm": [1.0, np.nan], "green_y_mm": [2.0, np.nan]}
    )
    marks["green_status"] = ["ok", None]
    found = _mark_columns(marks.assign(other=1.0))
    assert set(found) == {"frame", "time_s", "green_x_mm", "green_y_mm", "green_status"}
    assert found["green_status"] == ["ok", ""]
    np.testing.assert_array_equal(found["green_y_mm"], [2.0, np.nan])
