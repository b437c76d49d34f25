"""Grids by the names and counts of OpenCV and BoofCV, and what is said of one that is shifted the other way."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from calibration.assignment.gauge_in_image import sight
from calibration.errors import CalibrationError
from tests.calibration.drawing import gauge_of
from tests.calibration.grid_images import Layout, draw_grid, grid_places


@pytest.mark.parametrize(
    ("name", "layout", "size", "pitch_mm"),
    [
        ("symmetric", "symmetric", (7, 5), 1.0),
        ("circle_grid", "symmetric", (5, 4), 1.0),
        ("asymmetric", "asymmetric", (4, 11), 2**-0.5),
        ("circle_hexagonal", "hexagonal", (10, 8), 1.0),
        ("circle_hexagonal", "hexagonal", (10, 7), 1.0),
        ("circle_hexagonal", "hexagonal", (9, 8), 1.0),
        ("circle_hexagonal", "hexagonal", (9, 7), 1.0),
    ],
)
def test_named_grid_has_the_dots_of_its_library_and_is_found(
    name: str, layout: Layout, size: tuple[int, int], pitch_mm: float
) -> None:
    gauge = gauge_of(diameter_mm=0.5, layout=name, columns=size[0], rows=size[1], pitch_mm=pitch_mm)
    places = grid_places(layout, size) * (1, -1)
    middle = (places.min(axis=0) + places.max(axis=0)) / 2
    mine = gauge.sheet_mm()[gauge.present()]
    assert np.allclose(sorted(map(tuple, np.round(mine, 6))), sorted(map(tuple, np.round(places - middle, 6))))
    image = draw_grid(name, np.random.default_rng(1), layout=layout, size=size, fill=(0.7, 0.7))
    match = sight(image.image, gauge, "image").match
    assert len(match) == len(places)
    assert match.certain or layout == "symmetric"


def test_array_shifted_the_other_way_is_said_without_mirrors_and_fiducials() -> None:
    image = draw_grid("hex", np.random.default_rng(1), layout="hexagonal", size=(14, 12), fill=(0.7, 0.7))
    wrong = gauge_of(diameter_mm=0.5, layout="staggered", columns=7, rows=12, pitch_mm=(1.0, 0.75**0.5))
    with pytest.raises(CalibrationError, match=r'set shifted_rows = "even" in gauge\.toml') as raised:
        sight(image.image, wrong, "image")
    assert "fiducial" not in str(raised.value)
    right = gauge_of(
        diameter_mm=0.5, layout="staggered", columns=7, rows=12, pitch_mm=(1.0, 0.75**0.5), shifted_rows="even"
    )
    assert len(sight(image.image, right, "image").match) == 84


def test_hexagonal_grid_with_two_pitches_is_refused() -> None:
    with pytest.raises(ValidationError, match="one pitch_mm"):
        gauge_of(diameter_mm=0.5, layout="circle_hexagonal", columns=9, rows=7, pitch_mm=[1.0, 0.9])


def test_shifted_rows_of_the_file_hold_for_a_named_layout() -> None:
    named = {"diameter_mm": 0.5, "layout": "circle_hexagonal", "columns": 10, "rows": 8, "pitch_mm": 1.0}
    assert gauge_of(**named).shifted()[0]
    assert not gauge_of(**named, shifted_rows="odd").shifted()[0]


def test_unknown_layout_is_answered_with_all_names() -> None:
    with pytest.raises(ValidationError, match=r"'square', 'staggered', .*'asymmetric', 'circle_hexagonal'"):
        gauge_of(diameter_mm=0.5, layout="hexagon", columns=9, rows=7, pitch_mm=1.0)


@pytest.mark.parametrize("pitch", [-1.0, [1.0, 0.0], [1.0], "2 mm"])
def test_pitch_that_is_no_length_has_one_fault(pitch: object) -> None:
    with pytest.raises(ValidationError, match="a length above 0, or two") as raised:
        gauge_of(diameter_mm=0.5, columns=9, rows=7, pitch_mm=pitch)
    assert raised.value.error_count() == 1
