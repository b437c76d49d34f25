"""Which array of an image is taken, and why an image is refused, in closed form: no image is searched."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from calibration.assignment import array_in_image, gauge_in_image
from calibration.assignment.array_in_image import _alike, _convinces, _size_classes, _weight
from calibration.assignment.lattice import Lattice
from calibration.errors import ImageError
from tests.calibration.drawing import gauge_of
from tests.calibration.known_dots import PLAIN, dots_at, of, places, view


def test_dots_are_searched_in_classes_of_size_that_overlap() -> None:
    sizes = np.array([1.0, 3.0, 5.0, 9.0])
    classes = _size_classes(dots_at(np.zeros((4, 2)), diameter_px=sizes))
    assert [one.diameter_px.tolist() for one in classes] == [[1.0, 3.0], [3.0, 5.0], [5.0, 9.0]]
    assert len(_size_classes(dots_at(np.zeros((2, 2)), diameter_px=np.array([2.0, 8.0])))) == 1
    assert _size_classes(dots_at(np.zeros((0, 2)))) == []


def test_dots_like_those_of_an_array_are_half_as_wide_again_and_twice_as_dark_at_most() -> None:
    found = dots_at(
        np.zeros((6, 2)),
        diameter_px=np.array([8.0, 14.9, 15.1, 5.4, 5.3, 8.0]),
        contrast=np.array([50.0, 51.0, 52.0, 53.0, 54.0, 201.0]),
    )
    array = dots_at(np.zeros((2, 2)), diameter_px=np.array([8.0, 10.0]), contrast=np.array([90.0, 100.0]))
    (alike,) = _alike(found, array, of(np.zeros((2, 2), np.int64)))
    assert alike.contrast.tolist() == [50.0, 51.0, 53.0]
    faint = dots_at(np.zeros((2, 2)), contrast=np.array([46.0, 44.0]))
    assert _alike(faint, array, of(np.zeros((2, 2), np.int64)))[0].contrast.tolist() == [46.0]
    assert _alike(found, array, of(np.zeros((0, 2), np.int64))) == []


@pytest.mark.parametrize(
    ("columns", "rows", "missing", "others", "sure"),
    [
        (15, 11, 15, 99, True), (15, 11, 15, 101, False), (15, 11, 16, 0, False), (4, 3, 0, 8, True),
        (4, 3, 0, 9, False), (11, 1, 0, 0, False), (6, 4, 1, 0, False), (5, 5, 0, 16, True), (5, 5, 0, 17, False),
    ],
)  # fmt: skip
def test_an_array_convinces_that_is_large_or_whole_and_holds_most_of_the_dots(
    columns: int, rows: int, missing: int, others: int, *, sure: bool
) -> None:
    index = places(columns, rows)[missing:]
    dots = dots_at(np.zeros((len(index) + others, 2)))
    assert _convinces(dots, of(index)) is sure
    small = dots_at(np.zeros((len(index) + 99, 2)), diameter_px=np.r_[np.full(len(index), 8.0), np.full(99, 0.4)])
    whole = missing == 0 and len(index) >= 12
    assert _convinces(small, of(index)) is (whole or (missing == 15))
    assert _weight(dots_at(20.0 * index), of(index)) == pytest.approx(8.0 * len(index) * np.log(10))


@pytest.mark.parametrize(("columns", "rows", "fewest"), [(6, 5, 12), (3, 3, 8), (4, 3, 8), (4, 4, 11), (17, 13, 12)])
def test_two_thirds_of_a_small_gauge_must_be_seen_and_twelve_dots_of_a_large_one(
    columns: int, rows: int, fewest: int
) -> None:
    assert gauge_in_image.fewest_dots(gauge_of(columns=columns, rows=rows)) == fewest


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, ""), ({"dots": 11}, "11 dots of color black found, at least 12 are needed"),
        ({"dots": 11, "inverse": 12}, "12 of color white on black; exchange color"),
        ({"lattice": 11}, "only 11 of them form a regular array"), ({"others": 30}, "of 63 and 30 dots"),
        ({"blur": 0.51, "wide": 1.21}, "dots are smeared to 1.2 times their size"), ({"blur": 0.49, "wide": 1.21}, ""),
        ({"blur": 0.51, "wide": 1.19}, ""), ({"depth": 1.1}, "not discs but squares"), ({"depth": 0.9}, ""),
        ({"depth": 1.1, "blur": 0.41}, ""), ({"ratio": 1.81}, "is 1.8 times that of the gauge"), ({"ratio": 1.79}, ""),
        ({"ratio": 0.55}, "is 0.55 times that of the gauge"), ({"ratio": 0.56}, ""),
    ],
)  # fmt: skip
def test_an_image_is_refused_for_one_reason(
    change: dict[str, float], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def found_array(_: Any, color: str, __: str) -> Any:
        if color == "white":
            return None, of(places(int(change.get("inverse", 2)), 1))
        dots, whole, _ = view(PLAIN, keep=slice(int(change.get("dots", 63))))
        size = dots.diameter_px * change.get("wide", 1.0)
        dots = dots_at(dots.centers_px, diameter_px=size, blur_px=size / 2 * change.get("blur", 0.2))
        some = slice(int(change.get("lattice", 63)))
        return dots, Lattice(whole.dot[some], whole.index[some], int(change.get("others", 0)))

    monkeypatch.setattr(gauge_in_image, "find_array", found_array)
    nothing = np.zeros(1, np.int64)
    matched = SimpleNamespace(dot=nothing, column=nothing, row=nothing)
    monkeypatch.setattr(gauge_in_image, "match_gauge", lambda *_: matched)
    depth = change.get("depth", 0.0) * gauge_in_image.OUT_OF_ROUND
    monkeypatch.setattr(gauge_in_image, "out_of_round", lambda *_: (4, depth))
    monkeypatch.setattr(gauge_in_image, "size_ratio", lambda *_: change.get("ratio", 1.0))
    if said:
        with pytest.raises(ImageError, match=said.replace("(", r"\(")):
            gauge_in_image.sight(np.zeros((2, 2)), PLAIN, "a.png")
        return
    seen = gauge_in_image.sight(np.zeros((2, 2)), PLAIN, "a.png")
    assert seen.bloom == pytest.approx(0.7 * (change.get("blur", 0.2) - 0.15))
    staggered = gauge_of(columns=9, rows=7, layout="staggered", pitch_mm=(3.0, 1.2), diameter_mm=1.0)
    assert gauge_in_image._expected_diameter_px(*view(PLAIN)[:2], staggered) == pytest.approx(20.0 / np.hypot(1.5, 1.2))
    assert gauge_in_image._expected_diameter_px(*view(PLAIN)[:2], PLAIN) == pytest.approx(8.0)


def test_an_array_of_specks_has_no_weight(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a slower search finds counts where it weighs more; of nothing straight nothing is left."""
    index = places(6, 5)
    straight, loose = dots_at(20.0 * index), dots_at(20.0 * index + np.random.default_rng(2).uniform(-4, 4, (30, 2)))
    monkeypatch.setattr(array_in_image, "assign_grid", lambda dots: of(index[: len(dots)]))
    monkeypatch.setattr(array_in_image, "detect_dots", lambda *_: loose)
    monkeypatch.setattr(array_in_image, "_convinces", lambda *_: False)
    for found, count in (([straight], 30), ([], 0)):
        monkeypatch.setattr(array_in_image, "every_dot", lambda *_, found=found: found)
        dots, array = array_in_image.find_array(np.zeros((2, 2)))
        assert len(array) == count
        assert count == 0 or dots.centers_px is not loose.centers_px
