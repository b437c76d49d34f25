"""Tables of a script of one's own: times or frames, and x and y of points under any usual name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evaluator.errors import InputError
from evaluator.interchange.tracks import Tracks, read_points

TIME_S = np.arange(4) / 50
PLACE = np.array([[1.0, 2.0], [1.5, 2.5], [np.nan, np.nan], [2.5, 3.5]])


def written(path: Path, header: str, before: list[str]) -> Path:
    rows = [[*([first] if first else []), *("" if np.isnan(v) else f"{v}" for v in place)]
            for first, place in zip(before, PLACE, strict=True)]  # fmt: skip
    path.write_text("\n".join([header, *(",".join(row) for row in rows)]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("header", "scale", "said", "factor"),
    [
        ("t,x,y", 1.0, {"unit": "mm"}, 1.0),
        ("time_s,x_mm,y_mm", 1.0, {}, 1.0),
        ("Time_ms,X_m,Y_m", 1e3, {}, 1000.0),
        ("timestamp_us,tracked_x_cm,tracked_y_cm", 1e6, {}, 10.0),
        ("frame,x,y", 50.0, {"unit": "mm", "rate_hz": 50.0}, 1.0),
    ],
)
def test_times_and_points_of_a_plain_table_are_read_by_the_names_of_its_columns(
    tmp_path: Path, header: str, scale: float, said: dict[str, object], factor: float
) -> None:
    path = written(tmp_path / "table.csv", header, [f"{scale * t:.6f}" for t in TIME_S])
    time_s, points, unit = read_points(path, Tracks.model_validate(said))
    assert unit == "mm"
    np.testing.assert_allclose(time_s, TIME_S, atol=1e-12)
    np.testing.assert_allclose(points["tracked"], factor * PLACE)


def test_rows_without_times_and_frames_are_counted_and_image_points_turned_up(tmp_path: Path) -> None:
    path = written(tmp_path / "table.csv", "x_px,y_px", [""] * 4)
    time_s, points, unit = read_points(path, Tracks(rate_hz=50.0))
    np.testing.assert_allclose(time_s, TIME_S)
    np.testing.assert_allclose(points["tracked"], PLACE * [1.0, -1.0])
    assert unit == "px"


def test_numbered_and_named_points_keep_their_names(tmp_path: Path) -> None:
    path = tmp_path / "table.txt"
    path.write_text("t\tx1\ty1\tfront_x\tfront_y\n0\t1\t2\t3\t4\n0,5\t1\t2\t3\t4,5\n", encoding="utf-8")
    time_s, points, _ = read_points(path, Tracks(unit="mm"))
    assert time_s.tolist() == [0.0, 0.5]
    assert {name: place[1].tolist() for name, place in points.items()} == {"mark1": [1.0, 2.0], "front": [3.0, 4.5]}


@pytest.mark.parametrize(
    ("header", "asked"), [("frame,x_px,y_px", "--rate-hz"), ("t,x,y", "--unit"), ("t,x_mm,z_mm", "lacks time_s")]
)
def test_what_a_plain_table_lacks_is_asked_for(tmp_path: Path, header: str, asked: str) -> None:
    path = written(tmp_path / "table.csv", header, ["0", "1", "2", "3"])
    with pytest.raises(InputError, match=asked):
        read_points(path)
