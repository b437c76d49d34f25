from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calibration.camera import camera_above
from evaluator.errors import InputError
from evaluator.interchange.tracks import Tracks, read_any_marks
from evaluator.marks import COLUMNS
from tests.evaluator.synthetic import circling_marks

MARKS = ("green", "yellow")


@pytest.fixture
def truth() -> pd.DataFrame:
    table = circling_marks(6.0, seconds=1.0, sigma_mm=0.0)
    table.loc[3, ["yellow_x_mm", "yellow_y_mm"]] = np.nan
    return table


def assert_same(table: pd.DataFrame, truth: pd.DataFrame, within_mm: float = 1e-9) -> None:
    np.testing.assert_allclose(table[list(COLUMNS)], truth[list(COLUMNS)], atol=within_mm)


@pytest.mark.parametrize(("delimiter", "decimal"), [("\t", "."), (",", "."), (";", ",")])
def test_tracker_text_is_read_with_any_delimiter_and_decimal_sign(
    truth: pd.DataFrame, tmp_path: Path, delimiter: str, decimal: str
) -> None:
    lines = [delimiter.join(["", "mass_A", "", "mass_B", ""]), delimiter.join(["t", "x", "y", "x", "y"])]
    for row in truth[list(COLUMNS)].itertuples(index=False):
        values = [row[0], *(value / 1000 for value in row[1:])]
        lines.append(delimiter.join("" if np.isnan(v) else f"{v:.12E}".replace(".", decimal) for v in values))
    path = tmp_path / "tracker.txt"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    tracks = Tracks(green="mass A", yellow="mass B", unit="m")
    assert_same(read_any_marks(path, tracks), truth, within_mm=1e-8)


def test_tracker_text_without_a_unit_is_asked_for_it(tmp_path: Path) -> None:
    path = tmp_path / "tracker.txt"
    path.write_text("\tgreen\t\tyellow\t\nt\tx\ty\tx\ty\n0\t1\t2\t3\t4\n1\t1\t2\t3\t5\n", encoding="utf-8")
    with pytest.raises(InputError, match="unit"):
        read_any_marks(path)


def test_an_unknown_track_is_answered_with_the_known_ones(tmp_path: Path) -> None:
    path = tmp_path / "tracker.txt"
    path.write_text("\tmass_A\t\tmass_B\t\nt\tx\ty\tx\ty\n0\t1\t2\t3\t4\n", encoding="utf-8")
    with pytest.raises(InputError, match=r'no point named "green" \(there: mass_A, mass_B\)'):
        read_any_marks(path, Tracks(unit="mm"))


def deeplabcut_text(points: dict[str, np.ndarray], likelihood: np.ndarray) -> str:
    names = list(points)
    heads = {
        "scorer": ["net"] * 3 * len(names),
        "bodyparts": [name for name in names for _ in range(3)],
        "coords": ["x", "y", "likelihood"] * len(names),
    }
    lines = [",".join([head, *cells]) for head, cells in heads.items()]
    for frame in range(len(likelihood)):
        cells = [f"{value:.9f}" for name in names for value in (*points[name][frame], likelihood[frame])]
        lines.append(",".join([str(frame), *cells]))
    return "\n".join(lines) + "\n"


def test_deeplabcut_points_are_placed_by_the_camera_and_unlikely_ones_are_missing(tmp_path: Path) -> None:
    truth = circling_marks(6.0, seconds=1.0, sigma_mm=0.0)
    camera = camera_above(size_px=(640, 480), focal_px=2000, distance_mm=150, tilt_deg=8, k1=-0.2)
    height = 6.5
    points = {}
    for mark, name in zip(MARKS, ("left_led", "right_led"), strict=True):
        place = truth[[f"{mark}_x_mm", f"{mark}_y_mm"]].to_numpy()
        points[name] = camera.picture_from_plate(np.column_stack([place, np.full(len(place), height)]))
    likelihood = np.full(len(truth), 0.99)
    likelihood[5] = 0.1
    path = tmp_path / "r01DLC.csv"
    path.write_text(deeplabcut_text(points, likelihood), encoding="utf-8")
    tracks = Tracks(green="left_led", yellow="right_led", rate_hz=60.0)
    table = read_any_marks(path, tracks, camera, height)
    expected = truth.copy()
    expected.loc[5, list(COLUMNS[1:])] = np.nan
    assert_same(table, expected, within_mm=1e-6)


def test_deeplabcut_without_rate_or_camera_is_asked_for_them(tmp_path: Path) -> None:
    points = {mark: np.zeros((4, 2)) for mark in MARKS}
    path = tmp_path / "dlc.csv"
    path.write_text(deeplabcut_text(points, np.ones(4)), encoding="utf-8")
    with pytest.raises(InputError, match="rate_hz"):
        read_any_marks(path)
    with pytest.raises(InputError, match="camera"):
        read_any_marks(path, Tracks(rate_hz=60.0))


def test_movement_dataset_is_read_in_seconds_and_in_frames(truth: pd.DataFrame, tmp_path: Path) -> None:
    xr = pytest.importorskip("xarray", reason="reading netCDF-4 is an optional extra")
    position = np.stack([truth[[f"{mark}_x_mm", f"{mark}_y_mm"]].to_numpy() for mark in MARKS], axis=-1)[..., None]
    dims = ("time", "space", "keypoints", "individuals")
    coords = {"space": ["x", "y"], "keypoints": list(MARKS), "individuals": ["robot"]}
    for unit, time in (("seconds", truth["time_s"].to_numpy()), ("frames", np.arange(len(truth)))):
        data = xr.Dataset(
            {"position": (dims, position), "confidence": (dims[:1] + dims[2:], np.ones((len(truth), 2, 1)))},
            coords={"time": time, **coords},
            attrs={"time_unit": unit, "fps": 60.0, "ds_type": "poses"},
        )
        path = tmp_path / f"{unit}.nc"
        data.to_netcdf(path, engine="h5netcdf")
        assert_same(read_any_marks(path, Tracks(unit="mm")), truth)
