"""Lattices and their match to the gauge, in closed form: bases, parts, empty places, features, turns and refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.assignment import lattice
from calibration.assignment.fiducials import SIZE_SIGMA, features_promised, features_seen, of_equal_size
from calibration.assignment.lattice import Lattice, array_size, assign_grid, places_without_dot, rows_and_columns
from calibration.assignment.matching import _no_fiducials, _turned, match_gauge
from calibration.errors import CalibrationError
from tests.calibration.drawing import gauge_of
from tests.calibration.known_dots import MARKED, PLAIN, dots_at, of, places, view

Array = NDArray[np.float64]


SKEWS = [[[1, 0], [1, 1]], [[1, 0], [-1, 1]], [[2, 1], [1, 1]], [[1, 3], [0, 1]], [[1, -1], [0, 1]], [[0, 1], [-1, 0]]]


@pytest.mark.parametrize("skew", SKEWS)
def test_indices_are_those_of_the_shortest_basis(skew: list[list[int]]) -> None:
    """Dots 10 px apart along x and 12 px along y, numbered in another basis of the same lattice."""
    index = places(6, 5)
    points = index * [10.0, 12.0]
    reduced = lattice._reduced(points, index @ np.array(skew))
    fitted = np.linalg.lstsq(np.column_stack([reduced, np.ones(30)]), points, rcond=None)[0]
    np.testing.assert_allclose(np.hypot(*fitted[:2].T), [10.0, 12.0])
    np.testing.assert_allclose(fitted[0] @ fitted[1], 0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("aside", "turned", "count", "joined"),
    [
        (0.0, False, 8, True),
        (0.0, True, 8, True),
        (0.19, False, 8, True),
        (0.21, False, 8, False),
        (0.0, False, 5, False),
    ],
)
def test_a_part_beyond_a_gap_joins_where_its_dots_lie_on_places(
    aside: float, turned: bool, count: int, *, joined: bool
) -> None:
    index = places(10, 4)
    left, right = np.flatnonzero(index[:, 0] < 6), np.flatnonzero(index[:, 0] >= 8)[:count]
    points = 10.0 * index + 0.0
    points[right[0]] += [0.0, 10.0 * aside]
    own = index[right] - index[right[0]]
    part = Lattice(right, own[:, ::-1] * [1, -1] if turned else own)
    found = lattice._joined(points, Lattice(left, index[left]), part)
    assert (found is not None) is joined
    if found is not None:
        np.testing.assert_array_equal(found.index, index[found.dot])


def test_a_part_does_not_join_a_small_array_nor_on_places_that_are_taken_nor_with_another_pitch() -> None:
    index = places(10, 4)
    points, left, right = 10.0 * index, np.flatnonzero(index[:, 0] < 6), np.flatnonzero(index[:, 0] >= 8)
    main, part = Lattice(left, index[left]), Lattice(right, index[right])
    assert lattice._joined(points, Lattice(left[1:], index[left[1:]]), part) is None  # 23 dots beside it
    over = np.where((index[:, :1] >= 8), points - [30.0, 0.0], points)
    assert lattice._joined(over, main, part) is None
    wide = np.where((index[:, :1] >= 8), points * [2.0, 1.0], points)
    assert lattice._joined(wide, main, part) is None


@pytest.mark.parametrize(("known", "whole"), [(5, False), (6, True), (100, True), (101, False)])
def test_lattices_of_six_to_a_hundred_dots_are_continued(known: int, whole: bool) -> None:
    index = places(3, 4) if known < 9 else places(11, 11)
    found = lattice._completed(dots_at(20.0 * index + 30), Lattice(np.arange(known), index[:known]))
    assert len(found) == (len(index) if whole else known)


def test_members_that_are_tiny_or_faint_are_dirt() -> None:
    index = places(6, 5)
    size, contrast = np.full(30, 10.0), np.full(30, 100.0)
    size[[7, 8]], contrast[[21, 22]] = [4.1, 3.9], [16.0, 14.0]
    dots = dots_at(20.0 * index + 50, diameter_px=size, contrast=contrast)
    kept = lattice._without_specks(dots, of(index)).dot
    assert sorted(set(range(30)) - set(kept.tolist())) == [8, 22]


@pytest.mark.parametrize(("turn_deg", "upright"), [(0, False), (20, False), (70, True), (110, True), (160, False)])
def test_an_array_is_counted_across_and_down_the_image(turn_deg: float, upright: bool) -> None:
    index = places(5, 3)
    cosine, sine = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    points = index @ np.array([[13.0 * cosine, 13.0 * sine], [-10.0 * sine, 10.0 * cosine]])
    assert array_size(of(index), points) == (("square", 3, 5) if upright else ("square", 5, 3))
    layout, found = rows_and_columns(of(np.add(index, [4, -7])))
    assert (layout, found.tolist()) == ("square", index.tolist())
    assert all(rows_and_columns(of(index[cut:]))[0] == "square" for cut in (1, 2, 3))  # the rim of the image cuts it
    diagonal = index[(index.sum(axis=1) % 2) == 0]  # every second place of a square array is a staggered one
    assert rows_and_columns(of(np.stack([diagonal.sum(axis=1), diagonal[:, 1] - diagonal[:, 0]], axis=1) // 2))[0] == (
        "staggered"
    )


DIAGONALS = [
    [[1, -1], [1, 1]],
    [[1, 1], [-1, 1]],
    [[2, 1], [0, 1]],
    [[1, 2], [1, 0]],
    [[2, -1], [0, 1]],
    [[-1, 2], [1, 0]],
]


@pytest.mark.parametrize("basis", DIAGONALS)
def test_a_staggered_array_is_read_along_its_rows_in_whatever_basis_it_is_numbered(basis: list[list[int]]) -> None:
    """Rows of four dots, five of them, of which every second is half a pitch to the right: read the other way, they
    fill their box less.

    basis: steps across (half a pitch each) and down, in terms of the basis of the numbers.
    """
    steps = np.array([(2 * column + row % 2, row) for row in range(5) for column in range(4)])
    index = np.rint(steps @ np.linalg.inv(basis).T).astype(int)
    np.testing.assert_array_equal(index @ np.transpose(basis), steps)
    layout, found = rows_and_columns(of(index - [3, 8]))
    assert (layout, found.tolist()) == ("staggered", np.stack([steps[:, 0] // 2, steps[:, 1]], axis=1).tolist())
    assert array_size(of(index), steps * [10.0, 20.0]) == ("staggered", 4, 5)
    assert rows_and_columns(of(index[(steps[:, 1] > 0) | (steps[:, 0] > 3)]))[0] == "staggered"  # two are missing
    for ratio, size in ((0.577, (4, 5)), (1.0, (4, 5)), (1.25, (4, 5)), (1.4, (3, 8)), (1.732, (3, 8))):
        assert array_size(of(index), steps * [10.0 * ratio, 10.0]) == ("staggered", *size)  # rows are the nearer dots


def test_an_empty_place_counts_from_a_dots_width_within_the_image() -> None:
    """Places left, above, right and below of three by three dots of 8 px lie 7, 8, 9 or more px within its rim."""
    index = places(3, 3)
    for margin, seen in ((7, 0), (8, 0), (9, 12), (10, 12)):
        size_px = (2 * margin + 81, 2 * margin + 81)  # pixel centres from 0: the last place is 80 px from the first
        free, light = places_without_dot(dots_at(20.0 * index + 20 + margin, size_px=size_px), of(index))
        assert (len(free), light.tolist()) == (seen, [0.0] * seen)


def test_places_without_a_dot_have_the_light_of_the_sheet_beside_them_in_contrasts() -> None:
    index = np.array([place for place in places(4, 3).tolist() if place != [2, 1]])
    points = 20.0 * index + [25.0, 30.0]
    dots = dots_at(points, size_px=(200, 100))
    dots.plane[47:54, 62:69] = 180.0  # about the place of (2, 1), which has no dot
    dots.plane[87:94, 42:49] = 165.0  # of (1, 3), below the array
    free, light = places_without_dot(dots, of(index))
    found = dict(zip(map(tuple, free.tolist()), light.tolist(), strict=True))
    assert found == pytest.approx(
        {(2, 1): -0.2, (1, 3): -0.35, **dict.fromkeys([(0, -1), (1, -1), (3, -1), (0, 3), (3, 3), (4, 0), (4, 2)], 0.0)}
    )  # none at 5 px from the left rim, less than a dot's width, nor where a dot beside it is missing


def test_a_whole_array_is_assigned_and_a_second_one_counted() -> None:
    rng = np.random.default_rng(1)
    index = places(8, 6)
    points = 20.0 * index + [30.0, 40.0]
    other = 14.0 * places(6, 5) + [230.0, 150.0]
    order = rng.permutation(78)
    dots = dots_at(np.concatenate([points, other])[order])
    found = assign_grid(dots)
    assert (len(found), found.others) == (48, 30)
    seen = dots.centers_px[found.dot]
    fitted = np.linalg.lstsq(np.column_stack([found.index, np.ones(48)]), seen, rcond=None)[0]
    np.testing.assert_allclose(np.abs(fitted[:2]).sum(axis=0), 20.0)
    np.testing.assert_allclose(np.column_stack([found.index, np.ones(48)]) @ fitted, seen, atol=1e-9)
    faint = np.where(np.arange(78) < 48, 100.0, 14.0)[order]
    assert assign_grid(dots_at(dots.centers_px, contrast=faint)).others == 0  # the weave of a cloth
    assert assign_grid(dots_at(np.concatenate([points, other[:23]]))).others == 0  # less than half of the first
    assert len(assign_grid(dots_at(points[:5]))) == 0
    width = np.append(np.full(48, 8.0), 3.0)  # dirt at the place after the last dot of a row
    assert sorted(assign_grid(dots_at(np.append(points, [[190.0, 80.0]], axis=0), diameter_px=width)).dot) == list(
        range(48)
    )


@pytest.mark.parametrize("turn_deg", [0.0, 37.0, 90.0, 180.0, -100.0])
def test_fiducials_name_every_dot_however_the_gauge_is_turned(turn_deg: float) -> None:
    dots, found, index = view(MARKED, turn_deg)
    match = match_gauge(dots, found, MARKED)
    np.testing.assert_array_equal(np.stack([match.column, match.row], 1), index[match.dot])
    assert (match.certain, match.unseen, match.foreign, len(match)) == (True, 0, 0, 63)
    with pytest.raises(CalibrationError, match="the image is mirrored"):
        match_gauge(*view(MARKED, turn_deg, mirrored=True)[:2], MARKED)
    with pytest.raises(CalibrationError, match="fiducial dots of the gauge"):
        match_gauge(*view(PLAIN, turn_deg)[:2], MARKED)


@pytest.mark.parametrize(
    ("turn_deg", "half"), [(0.0, False), (80.0, False), (-80.0, False), (100.0, True), (180.0, True)]
)
def test_without_fiducials_a_gauge_is_turned_as_little_as_possible(turn_deg: float, half: bool) -> None:
    dots, found, index = view(PLAIN, turn_deg)
    match = match_gauge(dots, found, PLAIN)
    named = [8, 6] - index[match.dot] if half else index[match.dot]
    np.testing.assert_array_equal(np.stack([match.column, match.row], 1), named)
    assert (match.certain, match.extent) == (True, ("whole", "whole"))
    turns = [_turned(np.radians(angle)) for angle in (-90.0, 90.0, 0.0, 179.9)]
    assert turns[0] < turns[1]
    assert turns[2] < turns[0]
    assert turns[3] > 3.0


def test_a_part_of_a_gauge_is_placed_where_it_ends_and_uncertain_where_it_does_not() -> None:
    index = places(9, 7)
    inner = match_gauge(*view(PLAIN, keep=(index > 0).all(axis=1) & (index < [6, 5]).all(axis=1))[:2], PLAIN)
    assert (inner.certain, inner.extent) == (False, ("short", "short"))
    column = gauge_of(columns=9, rows=7, fiducial=[{"column": 1, "row": row, "diameter_mm": 0.7} for row in range(7)])
    strip = match_gauge(*view(column, keep=(index[:, 1] > 0) & (index[:, 1] < 5))[:2], column)
    assert not strip.certain  # no other turn fits, but two shifts do
    lost = match_gauge(*view(MARKED, keep=index[:, 0] > 0)[:2], MARKED)
    assert (lost.certain, len(lost), lost.column.min(), lost.unseen) == (True, 56, 1, 7)
    for count, refused in ((2, False), (7, False), (8, True)):  # a tenth of all
        extra = [(9, row) for row in (0, 6)][:count] + [(10 + k, 9) for k in range(count - 2)]
        dots, found, _ = view(MARKED, extra=extra)
        if refused:
            with pytest.raises(CalibrationError, match="does not fit the gauge"):
                match_gauge(dots, found, MARKED)
        else:
            assert match_gauge(dots, found, MARKED).foreign == count


@pytest.mark.parametrize(("first", "certain"), [(2, False), (1, True)])
def test_fiducials_that_fit_both_ways_in_a_cut_view_do_not_name_the_origin(first: int, *, certain: bool) -> None:
    """Fiducials in columns 4 and 6 of 9: turned by half a turn, columns 2 to 8 are 8 to 2, but 1 would be a tenth."""
    equal = gauge_of(columns=9, rows=7, fiducial=[{"column": k, "row": 3, "diameter_mm": 1.8} for k in (4, 6)])
    dots, found, _ = view(equal, keep=places(9, 7)[:, 0] >= first)
    left = 105.0 + 20.0 * first  # the border of the image, 15 px before the first column in view
    cut = dots_at(dots.centers_px - [left, 0.0], (295 - round(left), 300), diameter_px=dots.diameter_px)
    assert match_gauge(cut, found, equal).certain == certain


def test_features_are_sizes_and_colours_in_their_scatter() -> None:
    colored = gauge_of(columns=9, rows=7, fiducial=[{"column": 0, "row": 0, "color": "red", "diameter_mm": 2.4}])
    promised = features_promised(colored, 4)
    assert promised[0, 0, 0] == pytest.approx(np.log(2.0) / 0.06)
    np.testing.assert_allclose(promised[1:, 0, 0], [0.0, 0.0, 10.0])  # BGR, in tenths of the step from black to white
    assert np.abs(promised[:, 1:]).max() == 0.0
    assert features_promised(MARKED, 4)[0, 2, 1] == pytest.approx(np.log(0.7 / 1.2) / 0.06)
    color = np.full((63, 3), 100.0)
    color[30] = [100.0, 120.0, 70.0]
    dots, found, _ = view(PLAIN)
    size = dots.diameter_px * np.where(np.arange(63) == 31, 1.2, 1.0)
    seen = features_seen(dots_at(dots.centers_px, diameter_px=size, color=color), found, colored)
    np.testing.assert_allclose(seen[:, 30], [0.0, 0.0, 2.0, -3.0], atol=1e-6)
    assert seen[0, 31] == pytest.approx(np.log(1.2) / 0.06, rel=1e-2)
    assert not features_seen(dots, found, PLAIN)[1:].any()


@pytest.mark.parametrize(
    ("gauge", "low", "high"), [(PLAIN, 1 / 1.419, 1.419), (MARKED, 0.7 / 1.2 / 1.419, 1.5 * 1.419)]
)
def test_dots_of_a_size_that_no_dot_of_the_gauge_has_are_none(gauge: Any, low: float, high: float) -> None:
    dots, found, _ = view(PLAIN)
    for ratio, kept in ((1.02 * low, True), (0.98 * low, False), (0.98 * high, True), (1.02 * high, False)):
        size = dots.diameter_px * np.where(np.arange(63) == 31, ratio, 1.0)
        assert (31 in of_equal_size(dots_at(dots.centers_px, diameter_px=size), found, gauge).dot) is kept


def test_a_dot_of_another_size_is_not_matched() -> None:
    dots, found, index = view(PLAIN)
    odd = dots_at(dots.centers_px, diameter_px=dots.diameter_px * np.where(np.arange(63) == 31, 1.6, 1.0))
    match = match_gauge(odd, found, PLAIN)
    assert sorted(match.dot) == [k for k in range(63) if k != 31]
    np.testing.assert_array_equal(np.stack([match.column, match.row], 1), index[match.dot])


@pytest.mark.parametrize(
    ("channels", "colored", "said"),
    [(1, True, "which a grey image does not show"), (3, True, "not visible"), (1, False, "not visible")],
)
def test_fiducials_that_are_not_found_are_missing_or_of_a_colour_that_the_image_lacks(
    channels: int, colored: bool, said: str
) -> None:
    look = {"color": "red"} if colored else {"diameter_mm": 0.7}
    gauge = gauge_of(columns=9, rows=7, fiducial=[{"column": 1, "row": 2, **look}])
    assert said in _no_fiducials(dots_at(np.zeros((4, 2)), color=np.zeros((4, channels))), gauge)


def test_a_fiducial_is_promised_by_its_size_and_its_colour_in_steps_from_dots_to_sheet() -> None:
    """Gray dots, 128 of 255, on a white sheet: a step of 127; a tenth of it is one sigma."""
    look = {"column": 2, "row": 1, "color": "#ff0000", "diameter_mm": 1.8}
    gauge = gauge_of(columns=9, rows=7, color="#808080", fiducial=[look])
    promised = features_promised(gauge, 4)
    sigmas = [np.log(1.8 / gauge.dots.diameter_mm) / SIZE_SIGMA, *([-128.0, -128.0, 127.0] / np.array(12.7))]
    assert promised[:, 1, 2] == pytest.approx(sigmas)
    promised[:, 1, 2] = 0.0
    assert not promised.any()
