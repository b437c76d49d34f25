"""Tags in closed form: where one is sought, in which dictionary, and where its borders meet."""

from __future__ import annotations

from math import sqrt
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import erf

from evaluator.errors import InputError
from evaluator.tracking.luma_marks import explain, tag_borders, tags
from evaluator.tracking.settings import MarkSettings
from tests.evaluator.tracking.synthetic import frame_of

FIELD = frame_of(np.zeros((50, 100), np.uint8), origin=1, step=2)  # of odd rows
WHOLE = frame_of(np.zeros((50, 100), np.uint8))


@pytest.mark.parametrize(
    ("kind", "number", "names"),
    [
        ("aruco", 49, ["4X4_50", "5X5_50", "6X6_50", "7X7_50", "ARUCO_ORIGINAL", "ARUCO_MIP_36h12"]),
        ("aruco", 50, ["4X4_100", "5X5_100", "6X6_100", "7X7_100", "ARUCO_ORIGINAL", "ARUCO_MIP_36h12"]),
        ("aruco", 250, ["4X4_1000", "5X5_1000", "6X6_1000", "7X7_1000", "ARUCO_ORIGINAL"]),
        ("aruco", 1000, ["ARUCO_ORIGINAL"]),
        ("apriltag", 29, ["APRILTAG_36h11", "APRILTAG_25h9", "APRILTAG_16h5", "APRILTAG_36h10"]),
        ("apriltag", 30, ["APRILTAG_36h11", "APRILTAG_25h9", "APRILTAG_36h10"]),
        ("apriltag", 587, ["APRILTAG_36h10"]),
    ],
)
def test_a_tag_is_sought_in_the_smallest_dictionaries_that_hold_it(kind: Any, number: int, names: list[str]) -> None:
    assert tags.dictionaries("tag", MarkSettings(kind=kind), number) == tuple(f"DICT_{name}".upper() for name in names)
    with pytest.raises(InputError, match="no dictionary holds a tag 5000"):
        tags.dictionaries("tag", MarkSettings(kind=kind), 5000)


def test_a_tag_has_the_number_at_the_end_of_its_name_and_the_dictionary_that_is_said() -> None:
    assert tags.number_of("tag2_17", MarkSettings(kind="aruco")) == 17
    assert tags.number_of("tag2_17", MarkSettings(kind="aruco", id=0)) == 0
    for said in ("6x6_250", "DICT_6X6_250", "dict_6x6_250"):
        assert tags.dictionaries("t", MarkSettings(kind="aruco", dictionary=said), 1) == ("DICT_6X6_250",)
    assert tags.tag_names("t") == ["t", "t_corner1", "t_corner2", "t_corner3", "t_corner4"]
    deep = np.array([[1023, 4]], np.uint16)
    assert tags.luma_of_8_bits(frame_of(deep, depth=10)).tolist() == [[255, 1]]


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])  # clockwise, y down


@pytest.mark.parametrize(
    ("side", "low", "high", "least"), [(20, 57, 164, 12.0), (40, 15, 226, 20.0), (80, 0, 300, 40.0)]
)
def test_a_tag_is_sought_within_one_and_a_half_diagonals_of_where_it_was_by_half_its_size(
    side: int, low: int, high: int, least: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From 100 px on; a diagonal of the least size is √2 times as long as its side may be."""
    finder = tags.TagFinder({"tag_7": MarkSettings(kind="aruco")})
    asked: list[Any] = []

    def detected(_: Any, part: np.ndarray, least_px: float) -> dict[int, np.ndarray]:
        asked.append((part.shape, part[0, 0], least_px))
        return {7: SQUARE, 8: SQUARE + 1}

    monkeypatch.setattr(tags, "_detected", detected)
    luma = np.add.outer(np.arange(300), np.arange(300)).astype(np.uint16)
    assert finder._near("tag_7", luma) is None  # type: ignore[arg-type]
    finder._last["tag_7"] = 100.0 + side * SQUARE
    np.testing.assert_allclose(finder._near("tag_7", luma), SQUARE + low)  # type: ignore[arg-type]
    assert asked == [((high - low,) * 2, 2 * low, pytest.approx(least))]
    assert finder._near("tag_7", luma[: low + 8]) is None  # type: ignore[arg-type]  # too small a part to hold a tag
    assert len(asked) == 1


def test_of_two_tags_with_a_number_the_larger_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    for order in (1, -1):
        both = [(7, 10.0 * SQUARE), (7, 50.0 + 12.0 * SQUARE)][::order]
        monkeypatch.setattr(tags, "_outlines", lambda *_, both=both: (both, []))
        assert tags._detected(None, None)[7][0, 0] == 50.0  # type: ignore[arg-type]


def test_points_of_a_tag_in_a_field_have_the_rows_and_variances_of_the_full_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    finder = tags.TagFinder({"tag_7": MarkSettings(kind="aruco")})
    points, covariance = np.arange(10.0).reshape(5, 2), np.array([[0.01, 0.002], [0.002, 0.03]])
    monkeypatch.setattr(tags, "measured_tag", lambda *_: (points, np.tile(covariance, (5, 1, 1))))
    found = finder._measured("tag_7", SQUARE, None, FIELD)  # type: ignore[arg-type]
    assert list(found) == tags.tag_names("tag_7")
    assert list(found["tag_7_corner1"]) == [2.0, 7.0, *(pytest.approx(v) for v in (0.01, 0.12, 0.004)), "ok"]
    monkeypatch.setattr(tags, "measured_tag", lambda *_: None)
    assert finder._measured("tag_7", SQUARE, None, FIELD)["tag_7"].status == "disturbed"  # type: ignore[arg-type]
    assert finder._measured("tag_7", None, None, FIELD)["tag_7"].status == "not seen"  # type: ignore[arg-type]
    assert finder._last == {}


@pytest.mark.parametrize(
    ("others", "kept"),
    [((True, 1, 4.9), "new"), ((False, 1, 4.9), "new"), ((False, None, 4.9), "old"), ((True, 1, 5.1), "both")],
)
def test_of_two_outlines_at_one_place_the_chosen_or_the_read_one_is_listed(
    others: tuple[bool, int | None, float], kept: str
) -> None:
    chosen, number, distance = others
    old = explain.Thing((10.0, 10.0), 10.0, "old", "", chosen=False)
    new = explain.Thing((10.0, 10.0 + distance), 10.0, "new", "", chosen=chosen, number=number)
    things = [old]
    explain._add(things, new)
    assert [one.what for one in things] == (["old", "new"] if kept == "both" else [kept])
    square = explain._square(np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 8.0], [0.0, 8.0]]), WHOLE)
    assert (square.center_px, square.radius_px, square.chosen) == ((3.0, 4.0), 5.0, False)


def test_lines_meet_where_they_cross_and_parallels_nowhere() -> None:
    a, b, c, d = (np.array(point, float) for point in ((0, 0), (4, 2), (0, 5), (1, 4)))
    np.testing.assert_allclose(tag_borders._meet(a, b, c, d), (10 / 3, 5 / 3))
    assert np.isnan(tag_borders._meet(a, b, c, c + (b - a))).all()
    frames = np.array(
        [[(p + q) / 2, q - p, (q - p)[::-1] * [1, -1]] for p, q in zip(SQUARE, np.roll(SQUARE, -1, 0), strict=True)]
    )
    lines = np.array([[0.1, 0.0], [0.2, 0.0], [0.3, 0.0], [0.4, 0.0]])  # outward: up, right, down, left
    found = tag_borders._points(lines, frames)
    corners = [[-0.4, -0.1], [1.2, -0.1], [1.2, 1.3], [-0.4, 1.3]]
    np.testing.assert_allclose(found, [[0.4, 0.6], *corners], atol=1e-12)
    lines[0] = [0.0, 0.2]  # from 0.1 inward at its beginning to 0.1 outward at its end
    np.testing.assert_allclose(tag_borders._points(lines, frames)[1], [-0.4, 0.18], atol=1e-12)


def drawn(corner: tuple[float, float], side: float, turn: float, blur: float) -> tuple[np.ndarray, np.ndarray]:
    """A dark square on white with blurred edges, and its corners."""
    along = np.array([np.cos(turn), np.sin(turn)])
    corners = np.array(corner) + side * SQUARE @ np.array([along, [-along[1], along[0]]])
    y, x = np.mgrid[0:120, 0:120]

    def rise(distance: np.ndarray) -> np.ndarray:
        return np.asarray(0.5 * (1 + erf(distance / (sqrt(2) * blur))))

    across = [
        (x - corner[0]) * along[0] + (y - corner[1]) * along[1],
        (y - corner[1]) * along[0] - (x - corner[0]) * along[1],
    ]
    inside = np.prod([rise(one) * rise(side - one) for one in across], axis=0)
    return 230.0 - 200.0 * inside, corners


@pytest.mark.parametrize(("side", "turn"), [(40.0, 0.0), (55.0, 0.3), (30.0, -0.6)])
def test_corners_and_centre_of_a_tag_are_where_its_borders_cross(side: float, turn: float) -> None:
    luma, corners = drawn((45.3, 40.8), side, turn, 0.8)
    luma, about = np.rint(luma).astype(np.uint8), np.array([[0.8, -0.5], [-0.6, 0.7], [0.4, 0.5], [-0.7, 0.6]])
    found = tag_borders.measured_tag(luma, corners + about)
    assert found is not None
    np.testing.assert_allclose(found[0], [corners.mean(axis=0), *corners], atol=0.03)
    wavy = np.stack([np.roll(luma[:, k], 2 * (k // 8 % 2)) for k in range(120)], axis=1)  # by a pixel to either side
    assert tag_borders.measured_tag(wavy, corners) is None
    assert tag_borders.measured_tag(np.full((120, 120), 30, np.uint8), corners) is None
    assert tag_borders.measured_tag(luma, 45.0 + 6.0 * SQUARE) is None  # four points a side


def test_the_uncertainty_of_a_tag_is_that_of_its_noise() -> None:
    luma, corners = drawn((45.3, 40.8), 40.0, 0.2, 0.8)
    rng = np.random.default_rng(5)
    squares = []
    for _ in range(20):
        noisy = np.clip(np.rint(luma + rng.normal(0, 6.0, luma.shape)), 0, 255).astype(np.uint8)
        found = tag_borders.measured_tag(noisy, corners)
        assert found is not None
        off = found[0] - [corners.mean(axis=0), *corners]
        squares.append(np.einsum("ki,kij,kj->k", off, np.linalg.inv(found[1]), off) / 2)
    assert 0.5 < np.mean(squares) < 1.6


def test_a_border_tells_as_much_as_its_pixels_and_none_where_they_are_too_few() -> None:
    """A sheet is white above 49.5 px; its edge is sampled once a px over the inner part between corners at 50 px."""
    luma = np.where(np.arange(100)[:, None] < 50, 200, 0).repeat(100, axis=1).astype(np.uint8)
    for length in (40.0, 64.0):
        found = tag_borders._line(luma, np.array([20.0, 50.0]), np.array([20.0 + length, 50.0]))
        assert found is not None
        count = int(length * (1 - 2 * tag_borders.KEPT))
        where = np.linspace(-0.5 + tag_borders.KEPT, 0.5 - tag_borders.KEPT, count)
        np.testing.assert_allclose(found[0], [0.5, 0.0], atol=1e-6)  # half a px outward
        np.testing.assert_allclose(found[1], [[20 + length / 2, 50.0], [length, 0.0], [0.0, -1.0]])
        usual = 2.0 * 0.01**2  # a hundredth of a px, and two points that are alike count as one
        np.testing.assert_allclose(found[2], np.diag([usual / count, usual / (where @ where)]), rtol=1e-3, atol=1e-9)
    for length, seen in ((7.15, True), (7.13, False)):  # five points on seven tenths of it
        assert (tag_borders._line(luma, np.array([20.0, 50.0]), np.array([20.0 + length, 50.0])) is not None) is seen
    assert tag_borders._line(luma, np.array([60.0, 50.0]), np.array([20.0, 50.0])) is None  # white lies inward


def test_outlines_are_sought_from_the_perimeter_of_the_smallest_tag_that_is_seen_aslant() -> None:
    """A detector that finds tags 7 and 3 and refuses one outline: each corner (4, 2) of its own."""
    corners = np.arange(24.0).reshape(3, 1, 4, 2).astype(np.float32)
    parameters = SimpleNamespace(minMarkerPerimeterRate=0.03)
    for numbers in (np.array([[7], [3]]), None):
        detector: Any = SimpleNamespace(
            getDetectorParameters=lambda: parameters,
            setDetectorParameters=lambda _: None,
            detectMarkers=lambda _, numbers=numbers: (corners[:2] if numbers is not None else [], numbers, corners[2:]),
        )
        read, refused = tags._outlines(detector, np.zeros((50, 200), np.uint8), 12.0)
        assert parameters.minMarkerPerimeterRate * 200 == pytest.approx(4 * 12.0 / tags.SLANTING)
        assert [number for number, _ in read] == ([7, 3] if numbers is not None else [])
        for (_, found), drawn_ in zip(read, corners, strict=False):
            np.testing.assert_array_equal(found, drawn_[0])
        np.testing.assert_array_equal(refused, corners[2])


@pytest.mark.parametrize(("period", "factor"), [(8.0, 5.3), (16.0, 9.0), (3.5, 2.0)])
def test_a_wavy_border_tells_less_the_more_its_neighbouring_points_are_alike(period: float, factor: float) -> None:
    """Waves of 0.2 px: of points 1.04 px apart, the correlation is the cosine of the phase, and at most 0.8."""
    y, x = np.mgrid[0:100, 0:100]
    edge = 49.5 + 0.2 * np.cos(2 * np.pi * x / period)
    luma = np.rint(100.0 * (1 - erf((y - edge) / sqrt(2)))).astype(np.uint8)
    found = tag_borders._line(luma, np.array([20.0, 50.0]), np.array([84.0, 50.0]))
    assert found is not None
    count = int(64 * (1 - 2 * tag_borders.KEPT))
    at = np.linspace(-0.5 + tag_borders.KEPT, 0.5 - tag_borders.KEPT, count) * 64 + 52
    low = np.floor(at).astype(int)
    waves = -(edge[0, low] + (at - low) * (edge[0, low + 1] - edge[0, low]))  # interpolated between pixels
    assert found[2][0, 0] * count == pytest.approx(factor * np.var(waves), rel=0.15)
