"""Assignment of dots to places, in closed form: completion, sizes, and how an array of the gauge ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.assignment import completion
from calibration.assignment.lattice import Lattice
from calibration.assignment.neighbours import nearest
from calibration.assignment.regularity import evidence, off_rows, regular
from calibration.assignment.relative_size import relative_size
from calibration.assignment.wrong_gauge import (
    does_not_fit,
    ends_early,
    goes_on,
    place_on_sheet,
    row_offset,
    shows_bare_line,
    size_ratio,
)
from tests.calibration.drawing import gauge_of
from tests.calibration.known_dots import places

Array = NDArray[np.float64]
GAUGE = gauge_of(columns=6, rows=5)


@pytest.mark.parametrize(
    ("layout", "shifted", "offsets"),
    [("staggered", "odd", [-1, 0, 0, 1, 1, 2]), ("staggered", "even", [0, 0, 1, 1, 2, 2]), ("square", "odd", [0] * 6)],
)
def test_columns_of_a_staggered_array_gain_one_every_second_row(layout: str, shifted: str, offsets: list[int]) -> None:
    gauge = gauge_of(columns=6, rows=5, layout=layout, shifted_rows=shifted)
    rows = np.arange(-1, 5)
    assert row_offset(rows, gauge).tolist() == offsets
    sites = np.stack([10 + rows, rows], axis=1)
    assert place_on_sheet(sites, gauge).tolist() == [
        [10 + row + off, row] for row, off in zip(rows, offsets, strict=True)
    ]


@pytest.mark.parametrize(
    ("gauge", "line", "across", "told"),
    [
        (GAUGE, (-1, None), range(3), True), (GAUGE, (-1, None), range(2), False), (GAUGE, (6, None), range(3), True),
        (GAUGE, (7, None), range(5), False), (GAUGE, (None, -1), range(3), True), (GAUGE, (None, 5), range(3), True),
        (GAUGE, (None, 6), range(6), False), (GAUGE, (-1, None), range(5, 12), False),  # beside no dot
        (gauge_of(columns=10, rows=5), (None, -1), range(5), True),
        (gauge_of(columns=10, rows=5), (None, -1), range(4), False),  # less than half of a line
    ],
)  # fmt: skip
def test_an_array_goes_on_where_half_a_line_lies_beside_it(
    gauge: Any, line: tuple[int | None, int | None], across: range, *, told: bool
) -> None:
    beside = [[at if value is None else value for value in line] for at in across]
    seen = np.concatenate([places(gauge.dots.columns, gauge.dots.rows), beside])
    assert goes_on(seen, gauge) is told


def ended(first: Array, last: Array) -> tuple[str, str]:
    """How an array of four columns and all rows ends, with light beside its first and its last column."""
    seen = np.add(places(4, 5), [1, 0])
    free = [(0, row) for row in range(len(first))] + [(5, row) for row in range(len(last))]
    return ends_early(seen, np.array(free), np.concatenate([first, last]), gauge_of(columns=7, rows=5))


@pytest.mark.parametrize(
    ("first", "last", "along"),
    [
        ([0.0] * 5, [0.11] * 5, "short"), ([0.0] * 5, [0.13] * 5, "open"), ([-0.06] * 5, [0.07] * 5, "open"),
        ([0.34] * 5, [0.36] * 5, "open"), ([0.34] * 5, [0.3] * 5, "short"), ([0.9] * 5, [0.4] * 5, "short"),
        ([0.0] * 4, [0.0] * 4, "short"), ([0.0] * 3, [0.0] * 3, "open"),  # four of five must be in view
        ([0.0] * 4, [0.9, 0.9, 0.0, 0.0], "open"),  # half of it is hidden
        ([0.9] * 4, [0.9, 0.9, 0.0, 0.0], "short"),
    ],
)  # fmt: skip
def test_an_array_that_ends_alike_on_both_sides_is_a_shorter_one(
    first: list[float], last: list[float], along: str
) -> None:
    assert ended(np.array(first), np.array(last)) == (along, "whole")


def test_places_off_the_sides_of_an_array_say_nothing_of_its_end() -> None:
    """Of three rows that are in view, places beside the two others do not count."""
    seen = np.add(places(4, 3), [1, 0])
    free, gauge = np.array([(column, row) for column in (0, 5) for row in (3, 4, 5)]), gauge_of(columns=7, rows=5)
    assert ends_early(seen, free, np.zeros(6), gauge) == ("open", "open")
    assert ends_early(seen, free - [0, 3], np.zeros(6), gauge) == ("short", "open")
    strays = np.concatenate([seen, [(-3, 0), (9, 9)]])  # beyond the gauge
    assert ends_early(strays, free - [0, 3], np.zeros(6), gauge) == ("short", "open")


@pytest.mark.parametrize(
    ("column", "light", "bare"),
    [
        (0, [0.34, -0.34, 0.0], True), (0, [0.36, 0.36, 0.0], False), (0, [0.0, 0.0], False),
        (0, [0.0, 0.0, 0.9, 0.9], False), (0, [0.0, 0.0, 0.0, 0.9, 0.9], True), (6, [0.0, 0.0, 0.0], False),
        (5, [0.0, 0.0, 0.0], False),
    ],
)  # fmt: skip
def test_a_line_of_the_gauge_is_bare_where_three_of_its_places_and_most_show_the_sheet(
    column: int, light: list[float], *, bare: bool
) -> None:
    """Columns 1 to 5 of six are seen: column 0 is the gauge's, column 6 is not."""
    free = np.array([(column, row) for row in range(len(light))])
    assert shows_bare_line(np.add(places(5, 5), [1, 0]), free, np.array(light), GAUGE) is bare
    swapped = gauge_of(columns=5, rows=6)
    assert shows_bare_line(np.add(places(5, 5), [1, 0])[:, ::-1], free[:, ::-1], np.array(light), swapped) is bare


def test_dots_are_as_large_as_the_cell_that_they_span_says() -> None:
    """A cell of 20 px · 5 px where the gauge has 3 mm · 3 mm: 10/3 px/mm; dots of 1.2 mm that are 6 px wide."""
    column, row = places(4, 3).T
    points, gauge = np.stack([20.0 * column, 5.0 * row + 3.0 * column], axis=1), gauge_of(columns=6, rows=5)
    assert size_ratio(points, np.full(12, 6.0), column, row, gauge) == pytest.approx(6.0 / (1.2 * 10 / 3))
    wide = gauge_of(columns=6, rows=5, pitch_mm=(6.0, 1.5), fiducial=[{"column": 0, "row": 0, "diameter_mm": 0.6}])
    width = np.where((column == 0) & (row == 0), 3.0, 6.0)
    assert size_ratio(points, width, column, row, wide) == pytest.approx(6.0 / (1.2 * 10 / 3))
    assert np.isnan(size_ratio(points[:2], width[:2], column[:2], row[:2], wide))
    every = places(6, 5)
    assert size_ratio(10.0 * every, np.full(30, 6.0), *every.T, gauge) == pytest.approx(6.0 / (1.2 * 10 / 3))
    lattice = Lattice(np.arange(12), places(4, 3))
    assert does_not_fit(lattice, GAUGE).startswith(
        "the image shows a square array of about 4 × 3 dots (12 seen), which does not fit the gauge "
        '"plate", square, 6 × 5'
    )


SLANT = np.array([[12.0, 2.0, 60.0], [1.0, 11.0, 50.0], [0.003, 0.006, 1.0]])


def slanted(index: NDArray[np.int64]) -> Array:
    seen = np.column_stack([index, np.ones(len(index))]) @ SLANT.T
    return np.asarray(seen[:, :2] / seen[:, 2:])


@pytest.mark.parametrize(
    ("aside", "wider", "darker", "taken"),
    [
        (0.0, 1.0, 1.0, True), (0.24, 1.0, 1.0, True), (0.26, 1.0, 1.0, False), (0.0, 1.49, 1.0, True),
        (0.0, 1.51, 1.0, False), (0.0, 1 / 1.51, 1.0, False), (0.0, 1.0, 1.99, True), (0.0, 1.0, 2.01, False),
        (0.0, 1.0, 1 / 2.01, False),
    ],
)  # fmt: skip
def test_a_dot_continues_an_array_within_a_quarter_of_a_pitch_if_it_looks_like_its_neighbours(
    aside: float, wider: float, darker: float, *, taken: bool
) -> None:
    index = places(5, 4)
    points, widths, contrasts = slanted(index), np.full(20, 6.0), np.full(20, 50.0)
    last = np.flatnonzero((index == [4, 3]).all(axis=1))[0]
    around = slanted(np.array([4, 3]) + completion.NEXT) - points[last]
    points[last] += aside * np.hypot(*around.T).min() * np.array([0.6, -0.8])
    widths[last], contrasts[last] = 6.0 * wider, 50.0 * darker
    begun = np.flatnonzero((index < [3, 3]).all(axis=1))
    dot, place = completion.completed(points, widths, contrasts, begun, index[begun])
    assert (last in dot) is taken
    assert len(dot) == 19 + taken
    np.testing.assert_array_equal(place, index[dot])


def test_an_array_of_five_dots_or_in_one_line_is_not_continued() -> None:
    index = places(5, 4)
    points, alike = slanted(index), np.ones(20)
    few = np.array([0, 1, 2, 5, 6])
    assert completion.completed(points, alike, alike, few, index[few])[0].tolist() == few.tolist()
    assert len(completion.completed(points, alike, alike, np.append(few, 7), index[np.append(few, 7)])[0]) == 20
    line = np.arange(5)
    assert completion._predicted(points[line], index[line], np.array([5, 0])) is None
    at, pitch, near = completion._predicted(points, index, np.array([2, -1]))  # type: ignore[misc]
    np.testing.assert_allclose(at, slanted(np.array([[2, -1]]))[0], atol=1e-6)
    around = slanted(np.array([2, -1]) + completion.NEXT) - at
    assert (pitch, len(near)) == (pytest.approx(np.hypot(*around.T).min(), rel=1e-6), 16)
    for scale, there in ((0.31, True), (0.26, False)):  # a least pitch of 3 px
        assert (completion._predicted(scale * points, index, np.array([2, 1])) is not None) is there


@pytest.mark.parametrize(("aside", "strays"), [(0.28, 0), (0.32, 1)])
def test_a_member_three_tenths_of_a_pitch_off_its_place_is_none(aside: float, strays: int) -> None:
    index = places(5, 4)
    points = 10.0 * index
    points = points + 0.0
    points[7, 1] += 10.0 * aside
    keep = completion.without_strays(points, np.arange(20), index)
    assert np.flatnonzero(~keep).tolist() == [7][:strays]
    few = np.arange(7)
    assert completion.without_strays(points[few] * [1, 5], few, index[few]).all()


@pytest.mark.parametrize(
    ("aside", "certain", "kept"), [(0.04, True, True), (0.06, True, False), (0.004, False, True), (0.006, False, False)]
)
def test_a_member_off_its_rows_by_a_twentieth_of_a_pitch_is_none_an_unsharp_one_by_less(
    aside: float, *, certain: bool, kept: bool
) -> None:
    """At a corner, at an angle of 45 degrees to its rows, off each of them by as much."""
    index = places(6, 5)
    points = 20.0 * index.astype(float)
    points[0] += 20.0 * aside * np.array([1.0, -1.0])
    covariance = np.tile(1e-4 * np.eye(2), (30, 1, 1))
    covariance[0] *= 1.0 if certain else 100.0
    assert off_rows(points, index)[0] == pytest.approx(aside / 2, rel=0.1)  # of the middle one of three in a row
    points[0] += 20.0 * aside * np.array([1.0, -1.0])
    assert off_rows(points, index)[0] == pytest.approx(aside, rel=0.15)
    assert regular(points, covariance, index).tolist() == [kept] + [True] * 29


def test_straight_rows_are_evidence_by_the_ratio_of_what_chance_gives_to_their_deviation() -> None:
    index = places(6, 5)
    points = 20.0 * index.astype(float)
    assert evidence(points, index) == pytest.approx(np.log(10.0))
    zigzag = points + [0.0, 1.0] * (index[:, :1] % 2)
    rows = off_rows(zigzag, index)
    assert rows.min() == pytest.approx(0.0, abs=1e-12)  # columns are straight
    few = places(3, 3)
    assert evidence(20.0 * few, few) == pytest.approx(np.log(10.0))  # of eight rows
    assert evidence(20.0 * few[:6], few[:6]) == 0.0  # of two rows
    bent = 20.0 * few.astype(float)
    bent[4] += [0.0, 0.8]  # the middle of all of its four rows, by 0.04 and 0.04/√2 and 0 pitches
    off = np.array([0.04, 0.0, 0.02, 0.02, 0.0, 0.0, 0.0, 0.0])
    assert evidence(bent, few) == pytest.approx(np.log(0.1 / np.sqrt(np.mean(off**2))), rel=0.05)


def test_sizes_are_relative_to_those_around_whatever_the_slant_of_the_sheet() -> None:
    index = places(7, 6)
    points = 10.0 * index.astype(float)
    neighbours = nearest(points, 12)[1]
    sizes = 6.0 * np.exp(0.2 * index[:, 1])
    sizes[24] *= 1.4
    found = relative_size(points, sizes, neighbours)
    assert found[24] == pytest.approx(np.log(1.4), abs=0.02)
    assert np.abs(np.delete(found, 24)).max() < 0.02
    four = relative_size(points, sizes, neighbours[:, :4])  # too few for a plane: their median
    assert four[0] == pytest.approx(np.log(sizes[0]) - np.median(np.log(sizes[neighbours[0, :4]])))
