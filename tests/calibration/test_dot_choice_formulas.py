"""Which blobs of which window are dots: votes, doubles and the limits of a fit, with fits that are made up."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from calibration.detection import candidates, disturbed, dots
from calibration.detection import image as image_module
from calibration.detection.candidates import Candidates
from calibration.detection.dots import _distinct, _Vote, _without_doubles

PLANE = np.zeros((100, 120), np.float32)


def blobs(count: int, radius: float = 5.0) -> Candidates:
    return Candidates(np.arange(2.0 * count).reshape(-1, 2), np.ones((count, 3)), np.full(count, np.pi * radius**2))


def fitted(places: Any, radius: float = 5.0, contrast: float = 50.0, blur: float = 1.0) -> np.ndarray:
    """Parameters of round dots: cx, cy, A11, A12, A22, blur, background, minus contrast, two slopes."""
    numbers = np.zeros((len(places), 10))
    numbers[:, :2], numbers[:, [2, 4]] = places, radius**-2.0
    numbers[:, 5], numbers[:, 6], numbers[:, 7] = blur, 200.0, -contrast
    return numbers


def voting(monkeypatch: pytest.MonkeyPatch, share: float, radius: float) -> tuple[_Vote, list[int]]:
    """A vote of which a share of the blobs are dots of a radius, and how many were tried."""
    tried = list[int]()

    def fit(_plane: Any, some: Candidates, _noise: float) -> tuple[np.ndarray, None, None]:
        tried.append(len(some))
        return fitted(np.zeros((round(share * len(some)), 2)), radius), None, None

    monkeypatch.setattr(dots, "_fit", fit)
    return _Vote(PLANE, 1.0), tried


def test_a_window_has_as_many_votes_as_its_dots_are_wide_by_a_sample_of_its_blobs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    vote, tried = voting(monkeypatch, 0.5, 4.0)
    vote.try_window(63, few := blobs(40), 1.0)
    assert (vote.votes, vote.candidates, tried) == (pytest.approx(20 * 4.0 * np.pi**0.5), few, [40])
    vote.try_window(127, many := blobs(200), 1.0)  # every fourth
    assert (vote.votes, vote.candidates, tried[1]) == (pytest.approx(4 * 25 * 4.0 * np.pi**0.5), many, 50)
    vote.try_window(255, blobs(190), 1.0)
    assert vote.candidates is many


@pytest.mark.parametrize(
    ("count", "share", "radius", "window", "goes_on"),
    [
        (32, 0.8, 5.0, 31, False),  # 26 dots
        (30, 0.8, 5.0, 31, True),  # 24 are not plenty
        (50, 0.78, 5.0, 31, True),  # nor are 39 of 50 blobs
        (40, 0.8, 7.7, 31, False),  # half as wide as the window
        (40, 0.8, 7.8, 31, True),
        (40, 0.8, 15.7, 63, False),
    ],
)
def test_a_search_ends_with_plenty_of_dots_that_are_narrower_than_half_the_window(
    count: int, share: float, radius: float, window: int, *, goes_on: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    vote, _ = voting(monkeypatch, share, radius)
    vote.try_window(window, blobs(count), 1.0)
    assert vote.open == goes_on


@pytest.mark.parametrize(("left", "window", "goes_on"), [(24, 63, False), (26, 63, True), (24, 31, True)])
def test_a_search_ends_where_a_wider_window_loses_half_of_the_votes(
    left: int, window: int, *, goes_on: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    vote, _ = voting(monkeypatch, 0.5, 4.0)
    vote.try_window(63, blobs(50), 1.0)
    vote.try_window(window, blobs(left), 1.0)
    assert vote.open == goes_on


def test_blobs_of_two_thresholds_that_are_nearer_than_a_seventh_of_their_radius_are_one() -> None:
    """Of 10 px: cells of 1.5 px, and radii that differ by 15 %."""
    places, radii = (
        [(30.1, 30.1), (31.4, 30.1), (31.6, 30.1), (30.1, 31.6), (30.1, 30.1)],
        [10.0, 10.0, 10.0, 10.0, 11.7],
    )
    found = Candidates(np.array(places), np.ones((5, 3)), np.pi * np.array(radii) ** 2)
    assert sorted(_distinct(found).center_px.tolist()) == sorted(map(list, [places[0], *places[2:]]))


def test_of_fits_within_half_a_radius_the_one_with_the_least_misfit_for_its_contrast_is_the_dot() -> None:
    places, noise = [(30.0, 30.0), (32.4, 30.0), (37.6, 30.0), (60.0, 60.0)], np.array([2.0, 1.0, 3.0, 9.0])
    numbers = fitted(places)
    assert sorted(_without_doubles(numbers, noise)) == [1, 2, 3]
    numbers[0, 7] = -150.0  # of three times the contrast
    assert sorted(_without_doubles(numbers, noise)) == [0, 2, 3]
    assert _without_doubles(numbers[:0], noise[:0]).tolist() == []


@pytest.mark.parametrize(
    ("said", "is_one"),
    [
        ({}, True),
        ({"noise": 7.2}, True),  # 0.14 of 50 levels are 7, and noise of 2 is taken off
        ({"noise": 7.3}, False),
        ({"contrast": -50.0}, False),  # brighter than around
        ({"blur": 4.9}, True),
        ({"blur": 5.1}, False),  # no edge
        ({"place": (3.0, 50.0)}, False),  # cut
        ({"possible": False}, False),
    ],
)
def test_a_blob_is_a_dot_that_fits_with_a_dark_sharp_edge(
    said: dict[str, Any], *, is_one: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = said.get("place", (50.0, 50.0))
    one = fitted([place], contrast=said.get("contrast", 50.0), blur=said.get("blur", 1.0))
    gaps = list[Any]()

    def start_values(_plane: Any, _centers: Any, _moments: Any, gap: np.ndarray) -> Any:
        gaps.append(gap.tolist())
        return one, np.array([8.0]), np.array([said.get("possible", True)])

    def fit_dots(_plane: Any, starts: np.ndarray, _reach: Any) -> Any:
        return starts.copy(), np.tile(np.eye(2), (len(starts), 1, 1)), np.full(len(starts), said.get("noise", 1.0))

    monkeypatch.setattr(dots, "start_values", start_values)
    monkeypatch.setattr(dots, "fit_dots", fit_dots)
    monkeypatch.setattr(dots, "fit_again", lambda *_: None)
    monkeypatch.setattr(dots, "doubted", lambda _fitted, covariance, _noise: covariance)
    monkeypatch.setattr(dots, "correlation_factors", lambda *_: np.array([2.0, 3.0]))
    found, covariance, noise = dots._fit(PLANE, blobs(1), 2.0)
    assert len(found) == len(covariance) == len(noise) == is_one
    assert gaps == [[np.inf]]
    wider = dots._fit(PLANE, blobs(1), 2.0, correlated=True)[1]
    assert wider.tolist() == [[[4.0, 0.0], [0.0, 9.0]]] * is_one
    if is_one:
        dots._fit(PLANE, Candidates(np.array([[0.0, 0.0], [3.0, 4.0]]), np.ones((2, 3)), np.ones(2)), 2.0)
        assert gaps[-1] == [5.0, 5.0]


def test_the_sign_with_more_votes_gives_the_dots_in_the_last_window_that_was_needed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked, ended = list[Any](), {1.0: 63, -1.0: 127}

    def try_window(vote: Any, window: int, some: Any, _noise: float) -> None:
        asked.append((vote.sign, window, some))
        vote.votes, vote.candidates, vote.open = 2.0 - vote.sign, (window, some), window < ended[vote.sign]

    monkeypatch.setattr(dots._Vote, "try_window", try_window)
    monkeypatch.setattr(dots, "dark_dots", lambda *_: PLANE + 7.0)
    monkeypatch.setattr(dots, "noise_of", lambda _: 2.0)
    monkeypatch.setattr(
        dots,
        "candidates_by_window",
        lambda *_: ((width, lambda sign, w=width: sign * w) for width in (31, 63, 127, 255)),
    )
    monkeypatch.setattr(dots, "_fit", lambda plane, some, noise, correlated: (plane[0, 0], some, (noise, correlated)))
    monkeypatch.setattr(dots, "_dots", lambda _image, plane, *said: (plane[0, 0], *said))
    found: Any = dots.detect_dots(PLANE)
    assert found == (-7.0, -7.0, (127, -127.0), (2.0, True))
    assert [said[:2] for said in asked] == [(1.0, 31), (-1.0, 31), (1.0, 63), (-1.0, 63), (-1.0, 127)]
    asked.clear()
    found = dots.detect_dots(PLANE, "black", "white")
    assert (found[0], {sign for sign, *_ in asked}) == (7.0, {1.0})
    dots.detect_dots(PLANE, "black")  # of the sheet nothing is said: both signs
    assert {sign for sign, *_ in asked} == {1.0, -1.0}


def test_windows_are_no_wider_than_twice_the_image(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candidates, "_at_window", lambda _plane, window, _noise: window)
    for side, widths in ((31, [31, 15]), (32, [31, 63, 15]), (300, [31, 63, 127, 255, 511, 15]), (7, [])):
        plane = np.zeros((side, 400), np.float32)
        assert [width for width, _ in candidates.candidates_by_window(plane, 1.0)] == [
            w for w in widths if w <= 2 * side
        ]


def test_a_dots_colour_is_the_mean_of_nine_pixels_within_the_image() -> None:
    image = np.arange(100 * 120 * 3, dtype=float).reshape(100, 120, 3)
    numbers = fitted([(50.4, 20.6), (0.2, 99.0), (119.0, 0.3)], radius=3.0)
    found = dots._dots(image, PLANE, numbers, np.zeros((3, 2, 2)), np.ones(3))
    np.testing.assert_allclose(found.color, [image[21, 50], image[98, 1], image[1, 118]])
    assert found.size_px == (120, 100)
    assert found.diameter_px == pytest.approx([6.0] * 3)
    assert found.contrast.tolist() == [50.0] * 3


@pytest.mark.parametrize(
    ("radius", "noise", "found"),
    [
        (9.0, 1.0, True),
        (9.0, 18.0, True),  # it fills 26 % of the window: three quarters of its 100 levels are left of its contrast
        (9.0, 19.0, False),  # and are less than four sigmas
        (13.0, 1.0, True),  # 55 %: half the mean deviation is between the levels
        (3.0, 1.0, True),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_blob_of_a_window_is_farther_from_the_mean_than_noise_and_half_the_usual_deviation(
    radius: float, noise: float, sign: float, *, found: bool
) -> None:
    y, x = np.mgrid[:300, :90]
    plane = np.where(np.hypot(x - 45, y - 270) <= radius, 100.0 - 100.0 * sign, 100.0).astype(np.float32)
    of_sign = candidates._at_window(plane, 31, noise)
    blob = of_sign(sign)
    assert len(blob) == found
    if found:
        assert blob.center_px[0] == pytest.approx([45.0, 270.0])
        assert blob.area_px[0] == pytest.approx(np.pi * radius**2, rel=0.08)
    assert len(of_sign(-sign)) == 0


def test_an_odd_dot_is_fitted_again_beside_its_edge_and_the_better_fit_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 20 dots whose residuals scatter by two per cent; two blurs and a half, 1.5 px at least, its reach at most."""
    rng, asked = np.random.default_rng(4), list[Any]()
    noise = np.exp(0.02 * rng.normal(size=20))
    noise[[3, 8, 11, 15]] = 5.0
    numbers, spread = fitted(np.zeros((20, 2))), np.zeros((20, 2, 2))
    numbers[:, 5], reach = 1.0, np.full(20, 9.0)
    numbers[8, 5], reach[11] = 0.2, 2.0

    def fit_dots(_plane: Any, starts: np.ndarray, close: np.ndarray) -> Any:
        asked.extend(close.tolist())
        return starts + 1.0, np.ones((4, 2, 2)), np.array([1.0, 1.0, 1.0, 4.0])

    monkeypatch.setattr(disturbed, "fit_dots", fit_dots)
    disturbed.fit_again(PLANE, reach, (numbers, spread, noise))
    assert asked == [2.5, 1.5, 2.0, 2.5]
    assert np.flatnonzero(numbers[:, 0]).tolist() == np.flatnonzero(spread[:, 0, 0]).tolist() == [3, 8, 11]
    assert (noise > 2.0).nonzero()[0].tolist() == [15]
    asked.clear()
    disturbed.fit_again(PLANE, reach[:3], (numbers[:3], spread[:3], noise[:3]))
    assert asked == []  # too few to tell what is odd


@pytest.mark.parametrize("way", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (-0.6, 0.0, 0.8), (0.5, 0.5, 0.5)])
def test_dots_are_told_by_the_colour_in_which_neighbouring_pixels_differ_most(way: tuple[float, float, float]) -> None:
    """Brighter toward white; however much light or colour changes slowly over the sheet, and however large it is."""
    y, x = np.mgrid[:150, :160] / 150.0
    dots_on = np.sin(105 * x) * np.sin(105 * y) > 0.5
    image = 100.0 - 40.0 * dots_on[..., None] * np.array(way) + (60.0 * x)[..., None] * np.array([0.0, 1.0, -0.5])
    axis = image_module._detail_axis(image.astype(np.float32))
    assert axis == pytest.approx(np.array(way) / np.linalg.norm(way), abs=0.03)
