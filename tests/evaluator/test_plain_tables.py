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


@pytest.mark.parametrize("missing", ["nan", "NaN", "None", "-", ""])
def test_frames_before_a_mark_is_seen_count_also_below_a_line_of_units(tmp_path: Path, missing: str) -> None:
    """Their words for nothing were taken for names of columns: without times, all that followed came too early."""
    path, hidden = tmp_path / "table.csv", [f"{missing},{missing},hidden"] * 3
    for units in ([], ["(mm),(mm),"]):
        rows = ["x,y,status", *units, *hidden, "1,2,seen", "3,4,seen"]
        path.write_text("\n".join(rows) + "\n", encoding="utf-8")
        time_s, points, _ = read_points(path, Tracks(rate_hz=50.0, unit="mm"))
        np.testing.assert_allclose(time_s, np.arange(5) / 50)
        assert points["tracked"][3:].tolist() == [[1.0, 2.0], [3.0, 4.0]]
        assert np.isnan(points["tracked"][:3]).all()


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


TRACKMATE = """LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_T,FRAME
Label,Spot ID,Track ID,Quality,X,Y,T,Frame
Label,Spot ID,Track ID,Quality,X,Y,T,Frame
,,,(quality),(micron),(micron),({time}),
ID7,7,0,5.1,1000,2000,{first},0
ID8,8,0,5.1,1500,2500,{second},1
ID5,5,3,5.1,7000,8000,{second},1
ID9,9,None,5.1,1,1,{second},1
"""


def test_tracks_of_trackmate_are_points_in_the_units_below_its_header_with_y_up(tmp_path: Path) -> None:
    path = tmp_path / "spots.csv"
    path.write_text(TRACKMATE.format(time="sec", first=0, second=0.25), encoding="utf-8")
    time_s, points, unit = read_points(path)
    assert (time_s.tolist(), unit, list(points)) == ([0.0, 0.25], "mm", ["track0", "track3"])
    np.testing.assert_allclose(points["track0"], [[1.0, -2.0], [1.5, -2.5]])
    np.testing.assert_allclose(points["track3"], [[np.nan, np.nan], [7.0, -8.0]])
    path.write_text(TRACKMATE.format(time="frame", first=0, second=1), encoding="utf-8")
    with pytest.raises(InputError, match="give the frame rate"):
        read_points(path)
    np.testing.assert_allclose(read_points(path, Tracks(rate_hz=50.0))[0], [0.0, 0.02])


def test_particles_of_a_long_table_are_points_and_other_columns_may_hold_words(tmp_path: Path) -> None:
    path = tmp_path / "trackpy.csv"
    path.write_text(',y,x,note,frame,particle\n0,2,1,"a, b",0,0\n1,8,7,,0,1\n2,3,2,,1,0\n', encoding="utf-8")
    _, points, _ = read_points(path, Tracks(unit="mm", rate_hz=50.0))
    np.testing.assert_allclose(points["particle0"], [[1.0, 2.0], [2.0, 3.0]])
    np.testing.assert_allclose(points["particle1"], [[7.0, 8.0], [np.nan, np.nan]])


def test_rows_that_are_numbered_are_those_of_one_point(tmp_path: Path) -> None:
    path = tmp_path / "numbered.csv"
    path.write_text("id,t,x,y\n1,0,1,2\n2,0.5,3,4\n", encoding="utf-8")
    assert {name: place.tolist() for name, place in read_points(path, Tracks(unit="mm"))[1].items()} == {
        "tracked": [[1.0, 2.0], [3.0, 4.0]]
    }


@pytest.mark.parametrize("header", ["t;x;y", "time_s;green_x_mm;green_y_mm"])
def test_a_first_line_for_spreadsheets_is_no_header(tmp_path: Path, header: str) -> None:
    path = tmp_path / "german.csv"
    path.write_text(f"sep=;\n{header}\n0,0;1,5;2,5\n0,5;3;4\n", encoding="utf-8-sig")
    time_s, points, _ = read_points(path, Tracks(unit="mm"))
    assert time_s.tolist() == [0.0, 0.5]
    assert next(iter(points.values())).tolist() == [[1.5, 2.5], [3.0, 4.0]]
    path.write_text(f"sep=;\n{header}\n0,0;1,5;2,5\n0,5;here;4\n", encoding="utf-8")
    with pytest.raises(InputError, match="line 4"):
        read_points(path, Tracks(unit="mm"))
