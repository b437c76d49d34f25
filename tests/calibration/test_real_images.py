"""Photographs by others, outside this project; skipped where the folder is absent."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibration.assessment.quality import assess
from calibration.assignment.array_in_image import find_array
from calibration.assignment.lattice import rows_and_columns
from calibration.detection.image import read_image
from calibration.estimation.calibrate import calibrate
from calibration.gauge.geometry import Gauge

REAL = Path(__file__).parents[3] / "shared" / "real"
pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="the folder of real recordings, ../shared/real, is absent")
SYMMETRIC = sorted((REAL / "dot_grids" / "symmetric_grid").glob("*.png"))
ASYMMETRIC = sorted((REAL / "dot_grids" / "asymmetric_grid").glob("*.png"))


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("dot_pattern_01", 6300),
        ("dot_pattern_02", 1290),
        pytest.param("GoPro8_dot_pattern", 1550, marks=pytest.mark.exam),
    ],
)
def test_dense_arrays_are_assigned(name: str, least: int) -> None:
    lattice = find_array(read_image(REAL / "dot_arrays" / f"{name}.jpg"))[1]
    assert len(lattice) >= least


@pytest.mark.parametrize("path", SYMMETRIC, ids=lambda path: path.stem[-8:])
def test_symmetric_photographs_are_assigned_whole(path: Path) -> None:
    lattice = find_array(read_image(path))[1]
    _, index = rows_and_columns(lattice)
    assert (len(lattice), sorted((index.max(axis=0) + 1).tolist())) == (30, [5, 6])


@pytest.mark.parametrize("path", ASYMMETRIC, ids=lambda path: path.stem[-8:])
def test_asymmetric_photographs_are_assigned_whole(path: Path) -> None:
    lattice = find_array(read_image(path))[1]
    layout, index = rows_and_columns(lattice)
    assert (len(lattice), layout, (index.max(axis=0) + 1).tolist()) == (44, "staggered", [4, 11])


@pytest.mark.exam
def test_lines_of_the_dense_array_become_straight() -> None:
    # the array goes on beyond the image: any size that holds it will do
    dots = {"columns": 102, "rows": 80, "pitch_mm": 1.0, "diameter_mm": 0.48}
    gauge = Gauge.model_validate({"format": 1, "name": "dense", "dots": dots})
    found = calibrate([read_image(REAL / "dot_arrays" / "dot_pattern_01.jpg")], gauge)
    match = found.sightings[0].match
    assert len(match) >= 6300
    assert len(found.views[0]) > 0.9 * len(match)
    assert found.rms_px < 0.03  # of the dots kept
    seen = found.sightings[0].dots.centers_px[match.dot]
    on_plate = found.camera.plate_from_image(seen, 0.0)
    off_mm = on_plate - gauge.positions_mm()[match.row, match.column]
    assert np.sqrt((off_mm**2).mean()) * 26.7 < 0.3  # of all that were given a place, at 26.7 px a pitch


@pytest.mark.parametrize("kind", ["symmetric", pytest.param("asymmetric", marks=pytest.mark.exam)])
def test_published_degenerate_sets_are_called_so(kind: str) -> None:
    dots = {"columns": 6, "rows": 5, "pitch_mm": 10.0, "diameter_mm": 6.0}
    if kind == "asymmetric":
        dots = {"columns": 4, "rows": 11, "pitch_mm": (10.0, 5.0), "diameter_mm": 5.0, "layout": "staggered"}
    gauge = Gauge.model_validate({"format": 1, "name": kind, "dots": dots})
    paths = SYMMETRIC if kind == "symmetric" else ASYMMETRIC
    verdict = assess(calibrate([read_image(path) for path in paths], gauge))
    assert verdict.level == "ill-conditioned"
    assert verdict.next_steps
