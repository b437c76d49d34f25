"""Grids of few, large dots are found as surely as dense arrays, and no image ends in a traceback."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.assignment.array_in_image import find_array
from calibration.assignment.lattice import assign_grid, rows_and_columns
from calibration.detection.dots import detect_dots
from tests.calibration.grid_images import GridImage, draw_grid, grid_images, loose_circles
from tests.calibration.known_dots import dots_at


def whole_error_px(image: GridImage) -> float:
    """RMS error of the centres; infinite unless every dot clearly in view is found once and nothing else is."""
    dots, lattice = find_array(image.image)
    distance = np.hypot(*np.moveaxis(dots.centers_px[lattice.dot][:, None] - image.centers_px, -1, 0))
    distance[~np.isfinite(distance)] = np.inf
    near = distance.argmin(axis=1)
    off = distance[np.arange(len(near)), near]
    whole = len(set(near.tolist())) == len(near) and set(np.flatnonzero(image.clear)) <= set(near.tolist())
    return float(np.sqrt(np.mean(off**2))) if whole else np.inf


@pytest.mark.parametrize(
    ("kind", "error_px"),
    [("few large", 0.03), ("tilted", 0.04), ("light on dark", 0.03), ("small image", 0.1), ("asymmetric", 0.05),
     ("hexagonal", 0.06)],
)  # fmt: skip
def test_whole_grid_is_found_and_its_centres_are_right(kind: str, error_px: float) -> None:
    errors = [whole_error_px(image) for image in grid_images(kind, 3, seed=7)]
    assert max(errors) < error_px


def test_soft_edges_and_little_contrast_cost_at_most_one_grid_of_five() -> None:
    errors = [whole_error_px(image) for image in grid_images("thermal", 5, seed=7)]
    assert sorted(errors)[-2] < 0.5


def test_grid_whose_dots_grow_by_half_is_assigned_to_its_rows_and_columns() -> None:
    image = draw_grid("slanted", np.random.default_rng(3), size=(6, 4), diameter=0.75, tilt_deg=75, fill=(0.7, 0.7))
    dots, lattice = find_array(image.image)
    assert np.ptp(np.log(dots.diameter_px[lattice.dot])) > np.log(1.4)
    layout, index = rows_and_columns(lattice)
    assert (len(lattice), layout, sorted((index.max(axis=0) + 1).tolist())) == (24, "square", [4, 6])


def test_few_dots_whose_steps_shrink_by_a_third_are_found_at_a_second_look() -> None:
    image = draw_grid("slanted", np.random.default_rng(5), size=(4, 3), diameter=0.75, tilt_deg=70, fill=(0.7, 0.7))
    assert len(assign_grid(detect_dots(image.image))) >= 6  # at the first look no dot has four arms that are even


def test_loose_circles_form_no_grid_of_their_number() -> None:
    for seed in range(5):
        assert len(find_array(loose_circles(np.random.default_rng(seed)))[1]) < 8


def test_dots_of_a_single_row_form_no_array() -> None:
    """Eight dots of one row of a gauge and ten specks, as one window of the search found them behind a strong lens."""
    row = [(442.3, 313.6), (372.9, 359.3), (350.3, 372.6), (485.9, 280.4), (464.5, 297.0), (328.4, 384.6)]
    row += [(396.0, 344.9), (312.7, 372.3)]
    specks = [(547.4, 434.4), (185.5, 470.0), (627.1, 394.9), (621.4, 386.2), (628.0, 320.1), (393.3, 310.0)]
    specks += [(365.5, 139.5), (285.7, 201.9), (379.5, 137.5), (129.3, 97.3)]
    diameter = [8.98, 8.71, 8.44, 8.75, 8.95, 8.06, 8.95, 8.81]
    diameter += [2.67, 2.25, 3.18, 3.28, 3.38, 3.86, 4.52, 3.91, 6.47, 4.0]
    dots = dots_at(np.array(row + specks), (640, 480), diameter_px=np.array(diameter))
    assert len(assign_grid(dots)) == 0
