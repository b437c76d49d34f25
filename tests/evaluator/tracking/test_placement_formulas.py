"""Marks on the plate in closed form: under a camera straight above, millimetres are pixels by distance over focus."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from calibration.camera import camera_above
from evaluator.errors import InputError
from evaluator.tracking.placement import AsCalibrated, of_another_size, place_on_plate

CAMERA = camera_above(size_px=(640, 480), focal_px=2000.0, distance_mm=156.5)
MM_PER_PX = 150.0 / 2000.0  # 6.5 mm above the plate


def test_marks_and_their_errors_are_those_of_pixels_times_the_scale_of_their_height() -> None:
    """Image y runs down where the plate's y runs up, so that errors of both axes together change their sign."""
    table = pd.DataFrame(
        {
            "frame": [7, 8], "time_s": [0.1, 0.2], "a_x_px": [339.5, np.nan], "a_y_px": [199.5, 3.0],
            "a_x_sigma_px": [0.02, 0.1], "a_y_sigma_px": [0.04, 0.1], "a_xy_cov_px2": [0.0004, 0.0],
            "a_status": ["ok", "faded"],
        }
    )  # fmt: skip
    placed = place_on_plate(table, CAMERA, 6.5)
    assert list(placed)[:9] == [
        *("time_s", "a_x_mm", "a_y_mm", "frame", "a_x_sigma_mm", "a_y_sigma_mm", "a_xy_cov_mm2", "a_status", "a_x_px"),
    ]
    middle = CAMERA.plate_from_image(np.array([[319.5, 239.5]]), 6.5)[0]
    first = placed.iloc[0]
    assert [first["a_x_mm"] - middle[0], abs(first["a_y_mm"] - middle[1])] == pytest.approx(
        [20 * MM_PER_PX, 40 * MM_PER_PX]
    )
    assert [first["a_x_sigma_mm"], first["a_y_sigma_mm"]] == pytest.approx([0.02 * MM_PER_PX, 0.04 * MM_PER_PX])
    way = np.sign(first["a_y_mm"] - middle[1]) * -1.0
    assert first["a_xy_cov_mm2"] == pytest.approx(way * 0.0004 * MM_PER_PX**2)
    assert placed.iloc[1][["a_x_mm", "a_y_mm", "a_x_sigma_mm", "a_xy_cov_mm2"]].isna().all()
    assert placed["a_status"].tolist() == ["ok", "faded"]
    assert placed["a_xy_cov_px2"].tolist() == [0.0004, 0.0]


def test_frames_of_another_size_than_the_camera_are_refused_and_turned_ones_told() -> None:
    frames = [SimpleNamespace(size_px=(640, 480)), SimpleNamespace(size_px=(480, 640))]

    class Recording(list[Any]):
        name, expected_frames = "r.mp4", 2

    seen = AsCalibrated(Recording(frames), CAMERA)
    assert (seen.name, seen.expected_frames, AsCalibrated([], CAMERA).expected_frames) == ("r.mp4", 2, 0)
    passed = iter(seen)
    assert next(passed) is frames[0]
    with pytest.raises(InputError, match=r"r\.mp4: frames of 480×640 px.*turned one of them by 90 degrees"):
        next(passed)
    assert "calibrate in the camera mode" in of_another_size((320, 240), (640, 480))
