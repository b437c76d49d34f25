"""Growth of a lattice in closed form: seeds, cells, how far off its place a dot may lie, and what is crossed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.assignment import growth
from calibration.assignment.neighbours import nearest
from tests.calibration.known_dots import places

Array = NDArray[np.float64]


def seeds(points: Array, share: float = growth.OPPOSITE) -> tuple[Array, Array]:
    return growth.seed_bases(points, nearest(points, 12)[1], share)


def test_a_seed_has_the_arms_to_its_neighbours_right_handed_and_none_at_a_rim() -> None:
    index = places(5, 5)
    points = np.stack([12.0 * index[:, 0] + 3.0 * index[:, 1], 10.0 * index[:, 1]], axis=1)
    bases, mismatch = seeds(points)
    inner = ((index > 0) & (index < 4)).all(axis=1)
    corner = ((index == 0) | (index == 4)).all(axis=1)
    np.testing.assert_allclose(mismatch[inner], 0.0, atol=1e-12)
    assert np.isinf(mismatch[corner]).all()
    area = bases[inner, 0] * bases[inner, 3] - bases[inner, 1] * bases[inner, 2]
    np.testing.assert_allclose(area, 120.0)
    assert {tuple(np.abs(base).round(6)) for base in bases[inner]} == {(3.0, 10.0, 12.0, 0.0)}


@pytest.mark.parametrize(("aside", "uneven"), [(0.21, 0.21), (0.27, 0.27 / 1.27), (0.29, np.inf)])
def test_arms_of_a_seed_are_even_within_a_fifth_of_either_length(aside: float, uneven: float) -> None:
    """Of five dots in a cross the right one lies farther than the left one, by a share of the shorter arm."""
    cross = 10.0 * np.array([[0.0, 0.0], [1.0 + aside, 0.0], [-1.0, 0.0], [0.0, 1.01], [0.0, -1.01]])
    bases, mismatch = growth.seed_bases(cross, nearest(cross, 4)[1])
    assert mismatch[0] == pytest.approx(uneven)
    if np.isfinite(uneven):
        assert np.abs(bases[0]).max() == pytest.approx(10.0 * (1 + aside / 2))


def test_the_cell_of_a_seed_beside_a_hole_is_too_wide() -> None:
    index = places(5, 7)
    points = 10.0 * index[~(np.isin(index[:, 0], (1, 3)) & np.isin(index[:, 1], (2, 3, 4)))].astype(float)
    _, mismatch = seeds(points)
    for place, found in (((20.0, 30.0), 1.0), ((20.0, 10.0), 0.0)):
        assert mismatch[np.flatnonzero((points == place).all(axis=1))[0]] == pytest.approx(found, abs=1e-9)


def test_every_dot_is_linked_to_its_cell() -> None:
    points = np.random.default_rng(4).uniform([5.0, -20.0], [60.0, 30.0], (50, 2))
    cells, following, origin = growth.bucket(points, 7.0)
    np.testing.assert_array_equal(origin, points.min(axis=0))
    seen = []
    for (row, column), first in np.ndenumerate(cells):
        k = int(first)
        while k >= 0:
            assert ((points[k] - origin) // 7.0).tolist() == [column, row]
            seen.append(k)
            k = int(following[k])
    assert sorted(seen) == list(range(50))


SQUARE = np.array([10.0, 0.0, 0.0, 10.0])


def grown(
    points: Array, seed: int, odd: NDArray[np.bool_] | None = None, basis: Array = SQUARE
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    none = np.zeros(len(points), bool)
    cells, following, origin = growth.bucket(points, 10.0)
    given = (points, seed, basis, none if odd is None else odd, none, cells, following, 10.0, origin)
    index, member = growth.grow(*given)
    return index, member


@pytest.mark.parametrize(
    ("aside", "odd", "reached"), [(0.27, False, True), (0.29, False, False), (0.12, True, True), (0.13, True, False)]
)
def test_growth_takes_dots_near_their_places_and_odd_ones_only_nearer(aside: float, odd: bool, reached: bool) -> None:
    index = places(5, 4)
    points = 10.0 * index.astype(float)
    points[19] += 10.0 * aside * np.array([0.6, 0.8])
    found, member = grown(points, 6, np.arange(20) == 19 if odd else None)
    assert (member >= 0).tolist() == [True] * 19 + [reached]
    np.testing.assert_array_equal(found[:19], index[:19] - index[6])
    if reached:
        assert found[19].tolist() == [3, 2]


def test_growth_crosses_one_missing_line_but_not_two_and_follows_a_bend() -> None:
    index = places(8, 4)
    for missing, whole in (([4], True), ([4, 5], False)):
        there = index[~np.isin(index[:, 0], missing)]
        found, member = grown(10.0 * there, 0)
        assert bool((member >= 0).all()) is whole
        np.testing.assert_array_equal(found[member >= 0], there[member >= 0])
    bent = 10.0 * index + 0.25 * index[:, :1] ** 2 * [1.0, 0.0]  # steps grow by half a px, to 13.5 px
    found, member = grown(bent, 9)
    assert (member >= 0).all()
    np.testing.assert_array_equal(found, index - index[9])


@pytest.mark.parametrize("step", growth.STEPS[:8])
def test_a_single_line_is_followed_in_every_direction_of_a_slanted_basis(step: tuple[int, int]) -> None:
    """Its steps grow by half a per cent; each dot is predicted from the two before it alone."""
    basis = np.array([[8.0, 5.0], [-4.0, 9.0]])
    along = np.arange(9.0)
    points = (along + 0.0025 * along**2)[:, None] * (np.array(step) @ basis) + [300.0, 200.0]
    found, member = grown(points, 0, basis=basis.ravel())
    assert (member >= 0).all()
    np.testing.assert_array_equal(found, np.arange(9)[:, None] * np.array(step))
    # Of three dots the outer ones lie 2.3 px off to one side of the line, three quarters of what is allowed: the second
    # of them is expected half as far to that side.
    for aside in ([2.3, 0.0], [-2.3, 0.0], [0.0, 2.3], [0.0, -2.3]):
        bent = np.array([[0], [1], [-1]]) * (np.array(step) @ basis) + np.array([[0], [1], [1]]) * aside + 300
        found, member = grown(bent, 0, basis=basis.ravel())
        np.testing.assert_array_equal(found, [[0, 0], step, np.negative(step)])


def test_the_basis_of_a_dot_is_the_mean_of_its_arms_without_odd_dots() -> None:
    """A dot at (50, 40) with neighbours that lie 8 and 11 px beside it, and 9 and 13 px below and above."""
    points = np.array([[42.0, 41.0], [50.0, 40.0], [61.0, 40.0], [50.0, 31.0], [49.0, 53.0]])
    grid = np.full((3, 3), -1)
    grid[0, 1], grid[1, 1], grid[2, 1], grid[1, 0], grid[1, 2] = range(5)
    for odd, basis in (
        ([], [9.5, -0.5, -0.5, 11.0]),
        ([0], [11.0, 0.0, -0.5, 11.0]),
        ([2], [8.0, -1.0, -0.5, 11.0]),
        ([0, 2], [7.0, 7.0, -0.5, 11.0]),  # as it was inherited
        ([3], [9.5, -0.5, -1.0, 13.0]),
        ([4], [9.5, -0.5, 0.0, 9.0]),
        ([3, 4], [9.5, -0.5, 7.0, 7.0]),
    ):
        found = np.full(4, 7.0)
        growth._local_basis(points, grid, np.isin(np.arange(5), odd), 1, 1, 1, found)
        np.testing.assert_allclose(found, basis)
