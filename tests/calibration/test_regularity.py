"""Arrays of dots among specks: what chance puts near a place of a lattice belongs to none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.assignment.array_in_image import find_array
from calibration.assignment.lattice import Lattice, array_size
from calibration.assignment.regularity import evidence, off_rows, regular

Array = NDArray[np.float64]
PLACES = np.array([(a, b) for a in range(6) for b in range(5)])
SLANT = np.array([[40.0, 6.0, 90.0], [-4.0, 30.0, 60.0], [0.02, 0.05, 1.0]])


def seen() -> Array:
    """The places as a slanted view shows them, px."""
    return np.asarray(cv2.perspectiveTransform(PLACES[None].astype(float), SLANT)[0])


def alike(count: int) -> Array:
    return np.tile(1e-4 * np.eye(2), (count, 1, 1))


def test_rows_of_a_slanted_array_are_straight_and_those_of_specks_are_not() -> None:
    rng = np.random.default_rng(3)
    pitch = 40.0
    grown = pitch * (PLACES + rng.uniform(-0.2, 0.2, PLACES.shape))  # wherever growth takes them
    assert off_rows(seen(), PLACES).max() < 1e-9
    assert evidence(seen(), PLACES) > 1.5
    assert evidence(grown, PLACES) == 0.0
    assert evidence(pitch * PLACES + 0.5 * (grown - pitch * PLACES), PLACES) == 0.0  # the best that chance gives


@pytest.mark.parametrize("aside", [(0.5, 1.0), (-0.5, 1.0)])  # pitches from a row to the next: either way is a basis
def test_a_staggered_array_is_one_in_either_basis(aside: tuple[float, float]) -> None:
    column, row = (each.ravel() for each in np.meshgrid(range(4), range(5), indexing="ij"))
    points = 20.0 * np.column_stack([column + 0.5 * (row % 2), row])
    index = np.rint(points / 20.0 @ np.linalg.inv([[1.0, 0.0], aside])).astype(np.int64)
    assert array_size(Lattice(np.arange(20), index), points) == ("staggered", 4, 5)


@pytest.mark.parametrize("turn", range(6))
@pytest.mark.parametrize("apart", [1, 2, -1, -2])
def test_a_hexagonal_array_has_its_rows_along_the_nearest_dots_in_any_basis(turn: int, apart: int) -> None:
    """14 × 24 dots are 12 × 28, too; neighbours at 60 or 120 degrees are a basis."""
    column, row = (each.ravel() for each in np.meshgrid(range(14), range(24), indexing="ij"))
    points = 20.0 * np.column_stack([column + 0.5 * (row % 2), np.sqrt(0.75) * row])
    along, aside = np.exp(1j * np.pi / 3 * np.array([turn, turn + apart]))
    basis = 20.0 * np.array([[along.real, along.imag], [aside.real, aside.imag]])
    index = np.rint(points @ np.linalg.inv(basis)).astype(np.int64)
    assert array_size(Lattice(np.arange(len(index)), index), points) == ("staggered", 14, 24)


def test_a_speck_beside_the_array_is_no_member_and_a_dot_without_a_row_is_none() -> None:
    strays = np.array([(6, 1), (6, 2), (9, 9)])
    points = np.concatenate([seen(), cv2.perspectiveTransform(strays[None].astype(float), SLANT)[0]])
    points[len(PLACES) : -1] += (0.0, 8.0)  # the last lies on its place, but alone
    keep = regular(points, alike(len(points)), np.concatenate([PLACES, strays]))
    assert keep[: len(PLACES)].all()
    assert not keep[len(PLACES) :].any()


def test_few_large_dots_are_found_among_many_specks() -> None:
    rng = np.random.default_rng(10)
    image = np.full((240, 320), 160, np.uint8)
    for x, y, radius in zip(
        rng.uniform(0, 320, 100), rng.uniform(0, 240, 100), rng.uniform(1.5, 3.5, 100), strict=True
    ):
        cv2.circle(image, (round(16 * x), round(16 * y)), round(16 * radius), 60, -1, cv2.LINE_AA, 4)
    cv2.rectangle(image, (90, 60), (230, 200), 230, -1)
    for column in range(3):
        for row in range(3):
            cv2.circle(image, (120 + 40 * column, 90 + 40 * row), 10, 30, -1, cv2.LINE_AA)
    image = np.clip(cv2.GaussianBlur(image, (0, 0), 0.8) + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)
    dots, lattice = find_array(image)
    assert array_size(lattice, dots.centers_px[lattice.dot]) == ("square", 3, 3)
    assert np.allclose(dots.diameter_px[lattice.dot], 20.0, atol=2.5)
