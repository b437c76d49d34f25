"""Pairs and blobs that look alike: when motion decides, by blobs that are put there."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from evaluator.tracking.detection import search as search_module
from evaluator.tracking.detection.lookalikes import Rivals, mover
from evaluator.tracking.detection.search import Search
from evaluator.tracking.detection.selection import Candidate, choose, shortlist
from evaluator.tracking.following.follow_blob import BlobFollower
from evaluator.tracking.settings import TrackingSettings

SETTINGS = TrackingSettings(distance_diameters=3.0)
RADIUS = 5.0
GREEN = Candidate("green", (50.0, 40.0), RADIUS, 1.0, 80.0, (90.0, 90.0))
Pair = dict[str, Candidate]


def pair(x: float = 0.0, y: float = 0.0, wider: float = 0.0) -> Pair:
    """A green and a yellow blob three diameters apart, moved from where they usually are."""
    return {
        "green": replace(GREEN, center_px=(50.0 + x, 40.0 + y)),
        "yellow": replace(GREEN, mark="yellow", center_px=(80.0 + x + wider, 40.0 + y)),
    }


RESTING = pair(y=100.0)


def decided(rivals: Rivals, *pairs: Pair) -> Pair:
    return rivals.decide([blob for one in pairs for blob in one.values()], SETTINGS, pairs[0])


def test_a_pair_without_a_rival_is_the_robots_at_once() -> None:
    rivals = Rivals()
    assert decided(rivals, pair()) == pair()
    assert not rivals.undecided


@pytest.mark.parametrize(("way", "moves"), [(1.45, False), (1.55, True)])
def test_of_two_alike_the_one_is_the_robots_that_has_moved_by_one_and_a_half_radii(way: float, *, moves: bool) -> None:
    rivals = Rivals()
    assert decided(rivals, pair(), RESTING) == {}
    assert decided(rivals, pair(x=0.6 * RADIUS), RESTING) == {}
    assert rivals.undecided
    found = decided(rivals, there := pair(x=way * RADIUS), RESTING)
    assert found == (there if moves else {})
    assert rivals.undecided != moves
    if moves:  # the other is remembered as none of its marks
        assert rivals.there((50.0, 140.0 + 4.9), RADIUS)
        assert not rivals.there((50.0, 140.0 + 5.1), RADIUS)
        assert not rivals.there((50.0, 40.0), RADIUS)


@pytest.mark.parametrize(("wider", "moves"), [(0.75, True), (0.85, False)])
def test_what_moves_as_one_body_keeps_its_distance_to_a_tenth_of_the_way(wider: float, *, moves: bool) -> None:
    rivals = Rivals()
    decided(rivals, pair(), RESTING)
    there = pair(y=8.0, wider=wider)  # a way of 8.0 px, of the yellow blob a little more
    assert decided(rivals, there, RESTING) == (there if moves else {})


@pytest.mark.parametrize(("wider", "stays"), [(2.9, True), (3.1, False)])
def test_a_pair_whose_distance_changes_by_three_pixels_is_no_rival_any_more(wider: float, *, stays: bool) -> None:
    def large(one: Pair) -> Pair:  # three times as large: 3 px are 3 % of the distance, and the pair is still alike
        places = {name: (3 * blob.center_px[0], 3 * blob.center_px[1]) for name, blob in one.items()}
        return {name: replace(blob, center_px=places[name], radius_px=15.0) for name, blob in one.items()}

    rivals, rests = Rivals(), large(RESTING)
    decided(rivals, large(pair()), rests)
    decided(rivals, large(pair(x=4.0, wider=wider / 3)), rests)
    there = large(pair(x=9.0))  # from where it was first 1.8 radii, from where it would begin anew 1
    assert decided(rivals, there, rests) == (there if stays else {})


@pytest.mark.parametrize(("step", "known"), [(9.9, True), (10.1, False)])
def test_a_pair_is_known_again_within_two_radii_from_frame_to_frame(step: float, *, known: bool) -> None:
    rivals = Rivals()
    decided(rivals, pair(), RESTING)
    assert decided(rivals, there := pair(x=step), RESTING) == (there if known else {})


def test_two_that_move_leave_it_undecided() -> None:
    rivals = Rivals()
    decided(rivals, pair(), RESTING)
    assert decided(rivals, pair(x=9.0), pair(x=9.0, y=100.0)) == {}


@pytest.mark.parametrize(("radius", "rests"), [(4.0, 1.5), (8.0, 2.0)])
def test_a_blob_rests_within_a_quarter_of_its_radius_and_no_less_than_one_and_a_half_pixels(
    radius: float, rests: float
) -> None:
    still = replace(GREEN, radius_px=radius)
    robot = replace(GREEN, center_px=(150.0, 40.0))
    gone = replace(robot, center_px=(170.0, 40.0))
    near, far = (replace(still, center_px=(50.0 + rests * share, 40.0)) for share in (0.99, 1.01))
    assert mover([still, robot], [near, gone]) == (robot, [still])
    assert mover([still, robot], [far, gone])[1] == []


@pytest.mark.parametrize(
    ("size", "chroma", "same"), [(1.39, 1.0, True), (1.41, 1.0, False), (1.0, 1 / 1.39, True), (1.0, 1 / 1.41, False)]
)
def test_what_moved_is_known_again_by_its_size_and_colour(size: float, chroma: float, *, same: bool) -> None:
    gone = replace(GREEN, center_px=(90.0, 40.0), radius_px=RADIUS * size, chroma=80.0 * chroma)
    assert (mover([GREEN], [gone])[0] == GREEN) == same


@pytest.mark.parametrize(("chroma", "counts"), [(33.0, True), (31.0, False)])
def test_what_is_fainter_than_two_fifths_of_the_strongest_does_not_move(chroma: float, *, counts: bool) -> None:
    faint = replace(GREEN, center_px=(150.0, 40.0), chroma=chroma)
    moved = replace(faint, center_px=(180.0, 40.0))
    assert (mover([GREEN, faint], [GREEN, moved])[0] == faint) == counts


def test_two_things_that_move_apart_from_each_other_are_no_robot() -> None:
    other = replace(GREEN, center_px=(150.0, 40.0))
    after = [replace(one, center_px=(one.center_px[0], 90.0)) for one in (GREEN, other)]
    assert mover([GREEN, other], after)[0] is None


@pytest.mark.parametrize(
    ("radius", "chroma", "first"),
    [(5.0, 81.0, True), (5.0, 79.0, False), (2.9, 83.0, True), (2.9, 82.0, False), (1.5, 161.0, True)],
)
def test_blobs_are_examined_by_their_colour_and_below_three_pixels_by_their_size(
    radius: float, chroma: float, *, first: bool
) -> None:
    """Beside one of 80 levels and a radius of 5; of a mark alone there is no pair to tell more."""
    other = replace(GREEN, center_px=(150.0, 40.0), radius_px=radius, chroma=chroma)
    assert shortlist([GREEN, other], SETTINGS, 2) == ([other, GREEN] if first else [GREEN, other])
    assert shortlist([GREEN, other], SETTINGS, 1) == [other if first else GREEN]


def test_blobs_of_the_likeliest_pairs_are_examined_beside_more_colourful_ones() -> None:
    """A bright blob of each colour far from all others, a pair, and two of which neither is true."""
    green, yellow = pair().values()
    bright = [replace(one, center_px=(place, 400.0), chroma=120.0) for one, place in ((green, 0.0), (yellow, 900.0))]
    faint = [replace(one, center_px=(place, 900.0), chroma=70.0) for one, place in ((green, 0.0), (yellow, 900.0))]
    found = [faint[0], green, bright[0], faint[1], yellow, bright[1]]
    assert shortlist(found, SETTINGS, 1) == [bright[0], green, bright[1], yellow]
    assert shortlist(found[:5], SETTINGS, 1) == [bright[0], green, yellow]
    assert shortlist(found, SETTINGS, 3) == [bright[0], green, faint[0], bright[1], yellow, faint[1]]


def test_marks_without_a_pair_are_the_best_of_each_with_the_sum_of_their_scores() -> None:
    """The score of a round, whole one of the strongest colour is the odds of a disc to a sticker of any shape."""
    alone = TrackingSettings.model_validate({"mark": {"green": {}}})
    dim = replace(GREEN, center_px=(150.0, 40.0), chroma=70.0)
    assert choose([dim, GREEN], alone) == ({"green": GREEN}, pytest.approx(np.log1p(np.exp(-2.0))))
    assert choose([dim], alone) == ({"green": dim}, pytest.approx(np.log1p(np.exp(-2.0))))
    assert choose([], alone) == ({}, 0.0)
    of_pair = choose([GREEN, dim], SETTINGS)  # of which only one mark is seen
    assert of_pair == ({"green": GREEN}, pytest.approx(np.log1p(np.exp(-2.0))))


def places(
    drawn: list[tuple[int, int, int, int]], area_px2: float, monkeypatch: pytest.MonkeyPatch, follower: Any = None
) -> list[object]:
    """What a search finds of boxes (left, top, width, height) of a colour; a chroma sample covers 2 × 2 px."""
    mask = np.zeros((40, 60), np.uint8)
    for left, top, width, height in drawn:
        cv2.rectangle(mask, (left, top), (left + width - 1, top + height - 1), 1, -1)
    y, x = np.nonzero(mask)

    def scan(
        _u: object, _v: object, _allowed: object, _color: object, least: float, found: np.ndarray
    ) -> tuple[int, ...]:
        assert least == pytest.approx(0.5 * 20.0)  # of the usual least chroma: a blurred mark is weaker
        found[:] = mask
        return (len(x), int(y.min()), int(y.max()), int(x.min()), int(x.max()))

    monkeypatch.setattr(search_module.color_kernels, "color_scan", scan)
    sought: Any = Search.__new__(Search)
    sought._cell, sought._allowed, sought._mask = np.array([2.0, 2.0, 0.5, 0.5]), {"green": None}, np.zeros_like(mask)
    color = np.array([0, 0, 0, 0, 20.0, 0])
    follower = follower or SimpleNamespace(color=color, look=SimpleNamespace(area_px2=area_px2))
    return list(sought.places("green", SimpleNamespace(u=None, v=None), follower, 1.0))


def test_places_of_a_colour_come_with_the_likeliest_size_first(monkeypatch: pytest.MonkeyPatch) -> None:
    boxes = [(4, 6, 3, 4), (20, 10, 4, 4), (40, 20, 5, 5)]  # 48, 64 and 100 px²
    found = places(boxes, 64.0, monkeypatch)
    centers = [(0.5 + 2 * (left + (w - 1) / 2), 0.5 + 2 * (top + (h - 1) / 2)) for left, top, w, h in boxes]
    assert found == [pytest.approx(centers[k]) for k in (1, 0, 2)]


@pytest.mark.parametrize(
    ("box", "is_one"),
    [
        ((5, 5, 6, 6), True),  # 2.25 of the area
        ((5, 5, 7, 7), False),  # 3.06
        ((5, 5, 2, 3), True),  # 0.375
        ((5, 5, 2, 2), False),  # 0.25
        ((5, 5, 8, 3), True),  # 2.7 times as wide as high
        ((5, 5, 9, 3), False),  # three times
    ],
)
def test_a_place_is_a_blob_of_about_the_area_that_is_no_stripe(
    box: tuple[int, int, int, int], *, is_one: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert bool(places([box], 64.0, monkeypatch)) == is_one


@pytest.mark.parametrize(("length", "is_one"), [(23, True), (24, False)])
def test_a_sticker_may_be_eight_times_as_long_as_wide(
    length: int, *, is_one: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    bar = BlobFollower(np.array([0, 0, 0, 0, 20.0, 0]), 4.0 * 3 * length, 0.0)
    assert bool(places([(5, 5, length, 3)], bar.area_px2, monkeypatch, bar)) == is_one
