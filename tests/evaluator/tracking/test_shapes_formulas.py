"""Marks that are no discs, and the two of a pair that are equal: what is taken for which, from either side."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.detection.appearance import Appearance
from evaluator.tracking.following import follow_blob, shape
from evaluator.tracking.following.equal_discs import agree
from evaluator.tracking.following.follow import Follower
from evaluator.tracking.following.follow_blob import BlobFollower, look_back
from evaluator.tracking.following.shape import try_blob
from evaluator.tracking.observation import ABSENT, OK, REPEATED, Sighting
from evaluator.tracking.refinement.disc import Disc, make_disc

COLOR = np.array([128.0, 128.0, 0.6, -0.8, 18.0, 0.7])
AREA = 100.0


def disc(
    radius: float = 8.0, noise: float = 4.0, slant: float = 0.0, amplitude: float = 120.0, occluded: float = 0.0
) -> Disc:
    return replace(make_disc(radius, 0.9, (slant, 0.0), (amplitude, 40.0), noise), occluded=occluded)


UNSURE = 3 * (disc(noise=4.1)._unsure() + disc(slant=0.02)._unsure())  # what noise may make of it


@pytest.mark.parametrize(
    ("green", "yellow", "takes"),
    [
        (disc(), disc(), ""),
        (disc(occluded=0.06), disc(noise=12.0), "green"),  # a mark that something covers tells less
        (disc(occluded=0.04), disc(), ""),
        (disc(7.3), disc(), "green"),  # something hides its rim: 8 % smaller
        (disc(7.4), disc(), ""),
        (disc(7.3), disc(noise=9.0), "yellow"),  # twice as noisy for its contrast: dazzled, and larger for it
        (disc(7.3), disc(noise=7.5), "green"),
        (disc(7.3), disc(amplitude=80.0), "yellow"),
        (disc(noise=16.4), disc(), "green"),
        (disc(noise=15.6), disc(), ""),
        (disc(noise=4.1), disc(slant=0.1), "green"),  # slanted alone: the noisier one is believed less
        (disc(noise=4.1), disc(slant=0.019 + UNSURE), ""),
        (disc(noise=4.1), disc(slant=0.021 + UNSURE), "green"),
    ],
)
def test_equal_marks_have_the_shape_of_the_one_that_is_seen_better(green: Disc, yellow: Disc, takes: str) -> None:
    followers = {
        name: Follower(Appearance(COLOR, AREA, one), 0.5) for name, one in zip("gy", (green, yellow), strict=True)
    }
    taken: list[Any] = []
    agree(followers, ("g", "y"), lambda one, look: taken.append((one, look.disc)))
    assert len(taken) == bool(takes)
    if takes:
        worse, better = ("g", yellow) if takes == "green" else ("y", green)
        assert taken[0][0] is followers[worse]
        assert (taken[0][1].radius_px, taken[0][1].e1) == (better.radius_px, better.e1)
        assert taken[0][1].amplitude == followers[worse].look.disc.amplitude
    for lacking in ({"g": followers["g"]}, {}):
        agree(lacking, ("g", "y"), lambda *_: pytest.fail("there is one mark only"))
    agree(followers, (), lambda *_: pytest.fail("they are no pair"))


def blob(**said: Any) -> Any:
    """A blob of 12 by 4 px at 30 degrees, 100 px² large, at (50, 40)."""
    along = np.array([np.cos(np.pi / 6), np.sin(np.pi / 6)])
    spread = 12.0**2 / 12 * np.outer(along, along) + 4.0**2 / 12 * (np.eye(2) - np.outer(along, along))
    usual = {
        "center_px": (50.0, 40.0),
        "area_px2": AREA,
        "spread_px2": spread,
        "strength": 40.0,
        "beside": 0.0,
        "whole": True,
    }
    return SimpleNamespace(**usual | {"covariance_px2": np.diag([1e-4, 2e-4])} | said)


def follower(**said: Any) -> BlobFollower:
    one = BlobFollower(COLOR.copy(), AREA, None, position=(50.0, 40.0))
    for name, value in said.items():
        setattr(one, name, value)
    return one


@pytest.mark.parametrize(
    ("said", "status"),
    [
        ({}, OK),
        ({"area_px2": 61.0}, OK),
        ({"area_px2": 59.0}, "partly hidden"),
        ({"area_px2": 169.0}, OK),
        ({"area_px2": 171.0}, "ambiguous"),
        ({"strength": 22.1}, OK),  # 0.55 of 40
        ({"strength": 21.9}, "faded"),
        ({"whole": False}, "outside the image"),
        ({"center_px": (56.7, 40.0)}, OK),  # within reach of 3 px, half the radius of 5.64 px and one more
        ({"center_px": (50.0, 46.9)}, "not seen"),
    ],
)
def test_a_blob_is_the_mark_while_its_size_strength_and_place_are_about_the_usual(
    said: dict[str, Any], status: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(follow_blob, "blobs_around", lambda *_: [blob(**said)])
    one, frame = follower(unsteady=0.01), SimpleNamespace(size_px=(100, 80), time_s=0.0)
    found = one.look_at(frame, np.ones(4), (50.0, 40.0), 3.0, 0.1)  # type: ignore[arg-type]
    assert found.status == status
    if status == OK:
        covariance = np.diag([1e-4, 2e-4]) + 0.01 * blob().spread_px2
        assert (found.var_x, found.var_y, found.cov_xy) == pytest.approx(
            (covariance[0, 0], covariance[1, 1], covariance[0, 1])
        )


@pytest.mark.parametrize(("light", "share"), [(0.5, 0.5), (1.0, 1.0), (2.0, 1.0)])
def test_a_lost_blob_is_looked_for_within_its_radius_and_as_pale_as_the_light_has_become(
    light: float, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A radius of 5.64 px, and 9 px from the middle to its ends; a chroma sample covers 2 px."""
    asked, seen = list[Any](), list[Any]()

    def blobs_around(_frame: Any, _cell: Any, color: np.ndarray, *where: Any) -> list[Any]:
        asked.append((color[4], *where))
        return seen

    monkeypatch.setattr(follow_blob, "blobs_around", blobs_around)
    one, frame = follower(long_px=9.0), SimpleNamespace(size_px=(100, 80), time_s=0.0)
    radius = np.sqrt(AREA / np.pi)
    for strength, status in ((22.1, OK), (21.9, "faded")):
        seen[:] = [blob(strength=strength * share)]
        found = one.look_again(frame, np.full(4, 2.0), (50.0, 40.0), 0.1, (9.0, 9.0), light)  # type: ignore[arg-type]
        assert found.status == status
    assert asked[0] == (18.0 * share, (50.0, 40.0), pytest.approx(9.0 + radius + 4.0), 20.0)
    assert one.color[4] == 18.0
    assert one.look.area_px2 == AREA


@pytest.mark.parametrize(
    ("beside", "beyond", "floor"), [(3.9, False, 3.9), (4.1, False, 0.0), (4.1, True, 4.1), (20.0, False, 0.0)]
)
def test_chroma_around_a_blob_is_its_own_paler_part_unless_it_goes_on_beyond_it(
    beside: float, beyond: bool, floor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a tenth of its 40 levels on: what has half of it lies within 1.7 times its area, or is the floor."""
    asked = list[Any]()

    def extends_beyond(_frame: Any, _cell: Any, color: np.ndarray, *rest: Any) -> bool:
        asked.append((color[4], *rest))
        return beyond

    monkeypatch.setattr(follow_blob, "extends_beyond", extends_beyond)
    monkeypatch.setattr(follow_blob, "replace", lambda one, **new: SimpleNamespace(**vars(one) | new))
    found = follower()._without_own_rim(blob(beside=beside), None, np.ones(4), 9.0)  # type: ignore[arg-type]
    assert found.beside == floor
    assert asked == [(0.5 * beside, (50.0, 40.0), 18.0, pytest.approx(170.0))] * (beside > 4.0)


def test_of_several_blobs_the_one_most_like_it_in_place_and_size_is_the_mark(monkeypatch: pytest.MonkeyPatch) -> None:
    near, alike = blob(center_px=(51.0, 40.0), area_px2=70.0), blob(center_px=(52.0, 40.0))
    monkeypatch.setattr(follow_blob, "blobs_around", lambda *_: [near, alike])
    one, frame = follower(), SimpleNamespace(size_px=(100, 80), time_s=0.0)
    assert one.look_at(frame, np.ones(4), (50.0, 40.0), 3.0, 0.1).x == 52.0  # type: ignore[arg-type]
    near.area_px2 = 90.0
    assert one.look_at(frame, np.ones(4), (50.0, 40.0), 3.0, 0.1).x == 51.0  # type: ignore[arg-type]


def test_what_is_usual_of_a_blob_follows_by_a_fifth_after_the_first_frames_and_its_outline_is_noted() -> None:
    seen = Sighting(50.0, 40.0, 1e-4, 1e-4, 0.0, OK)
    for before, rate in ((0, 1.0), (2, 1 / 3), (9, 0.2)):
        one = follower(seen=before, blob=blob(area_px2=150.0, strength=50.0))
        one.accept(seen, 0.5)
        assert one.area_px2 == pytest.approx(100 + rate * 50)
        assert one.strength == pytest.approx(40 + rate * 10)
        assert one.color[4] == pytest.approx(18 + rate * (0.45 * one.strength - 18))
        ((time_s, long, short, angle),) = one.outline
        assert (time_s, long, short, angle % np.pi) == pytest.approx((0.5, 12.0, 4.0, np.pi / 6))
        assert one.long_px == pytest.approx(2 * np.sqrt(12.0))
        one.accept(ABSENT["faded"], 0.6)
        assert (one.seen, len(one.outline), one.missed) == (before + 1, 1, 1)


def test_unsteadiness_is_the_mean_square_of_second_differences_of_the_area_over_six() -> None:
    one = follower(seen=3)
    for log_area in (4.0, 4.1):
        one._note_area(log_area)
        assert one.unsteady == 1e-6  # three tell
    one._note_area(4.5)
    assert one.unsteady == pytest.approx(1e-6 + 0.3**2 / 6 / 3, rel=1e-3)
    steady = follower(seen=100, unsteady=0.01, areas=(4.0, 4.0, 4.0))
    steady._note_area(9.0)  # cut back to three sigmas, a twentieth of which counts
    assert steady.unsteady == pytest.approx(0.01 + 0.05 * (0.09 - 0.01))
    for seen, square in ((10, 1.0), (11, 0.09)):  # after the tenth frame
        young = follower(seen=seen, unsteady=0.01, areas=(4.0, 4.0, 4.0))
        young._note_area(9.0)
        assert young.unsteady == pytest.approx(0.01 + (square - 0.01) / seen)


@pytest.mark.parametrize(
    ("ratio", "discs", "taken"), [(1.4, 7, False), (1.5, 7, True), (1.4, 3, False), (1.4, 2, True)]
)
def test_a_mark_is_no_disc_that_is_oblong_or_seldom_holds_one(
    ratio: float, discs: int, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of ten frames it was found first in the fourth, and the sixth shows the fifth again: six tell its shape."""
    spread = np.diag([ratio**2, 1.0])
    monkeypatch.setattr(follow_blob, "blobs_around", lambda *_: [blob(spread_px2=spread)])
    held: list[Any] = []
    for index in range(10):
        one = Sighting(50.0, 40.0, 1e-4, 1e-4, 0.0, OK) if index >= 10 - discs else ABSENT["no disc"]
        frame = SimpleNamespace(index=index, time_s=index / 30, size_px=(100, 80))
        held.append((frame, ABSENT[REPEATED] if index == 5 else one))
    found = try_blob(follower(time_s=0.1), 3, held, np.ones(4))
    assert (found is not None) == taken
    if found is not None:
        assert found[0].seen == 6
        assert [one.status for one in found[1][:3]] == [one.status for _, one in held[:3]]
        assert found[1][5].status == REPEATED
    assert try_blob(follower(time_s=0.1), 8, held, np.ones(4)) is None  # two frames do not tell


@pytest.mark.parametrize(("frames", "taken"), [(4, False), (5, True)])
def test_a_blob_that_is_soon_lost_does_not_replace_a_disc(
    frames: int, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    oblong = [[blob(spread_px2=np.diag([4.0, 1.0]))] if k < frames else [] for k in range(10)]
    monkeypatch.setattr(follow_blob, "blobs_around", lambda *_: oblong.pop(0))
    held: list[Any] = [
        (SimpleNamespace(index=k, time_s=k / 30, size_px=(100, 80)), Sighting(50.0, 40.0, 1e-4, 1e-4, 0.0, OK))
        for k in range(10)
    ]
    assert (try_blob(follower(time_s=0.0), 0, held, np.ones(4)) is not None) == taken


def test_a_blob_is_looked_for_three_radii_farther_away_with_every_frame_that_did_not_show_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reaches: list[float] = []

    def look_at(
        _blob: object, _frame: object, _cell: object, _place: object, reach: float, _interval: float
    ) -> Sighting:
        reaches.append(reach)
        return ABSENT["not seen"]

    monkeypatch.setattr(BlobFollower, "look_at", look_at)
    held: list[Any] = [(SimpleNamespace(index=k, time_s=k / 30), ABSENT["no disc"]) for k in range(4)]
    one = follower(time_s=0.0)
    assert try_blob(one, 0, held, np.ones(4)) is None
    assert reaches == pytest.approx(3 * one.radius_px * np.arange(1, 5))


@pytest.mark.parametrize(("share", "taken"), [(0.755, False), (0.75, True)])  # a quarter wider, and 1.2 px
def test_a_disc_that_is_a_small_part_of_its_colour_is_a_reflection_on_the_mark(
    share: float, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(follow_blob, "blobs_around", lambda *_: [blob(area_px2=1256.6, spread_px2=100 * np.eye(2))])
    held: list[Any] = [
        (SimpleNamespace(index=k, time_s=k / 30, size_px=(100, 80)), Sighting(50.0, 40.0, 1e-4, 1e-4, 0.0, OK))
        for k in range(10)
    ]
    found = try_blob(follower(area_px2=1256.6), 0, held, np.ones(4), disc_px=20.0 * share)
    assert (found is not None) == taken


def test_a_blob_is_measured_in_the_frames_before_it_was_begun_back_to_where_it_is_not_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It moves by ten pixels a frame, and is too far away in the second frame."""
    shown = {0: 20.0, 1: 90.0, 2: 30.0, 3: 40.0}
    monkeypatch.setattr(follow_blob, "blobs_around", lambda frame, *_: [blob(center_px=(shown[frame.index], 40.0))])
    before: list[Any] = [
        (SimpleNamespace(index=k, time_s=k / 30, size_px=(100, 80)), [ABSENT["not seen"]] * 2) for k in range(4)
    ]
    assert look_back({"other": "disc", "mark": follower()}, ("other", "mark"), before, np.ones(4)) == 2
    assert [sightings[1].x for _, sightings in before[2:]] == [30.0, 40.0]
    assert [sightings[1].status for _, sightings in before[:2]] == ["not seen"] * 2
    assert all(sightings[0].status == "not seen" for _, sightings in before)


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_a_smear_is_no_oblong_shape_however_long_the_shutter_is_open(
    share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mark that moves by 60 px a frame, smeared along that for a share of it."""
    spread = np.diag([25.0 + (60.0 * share) ** 2 / 12, 25.0])
    centers = iter([(60.0 * k, 40.0) for k in range(1, 9)])
    monkeypatch.setattr(follow_blob, "blobs_around", lambda *_: [blob(center_px=next(centers), spread_px2=spread)])
    held: list[Any] = [
        (SimpleNamespace(index=k, time_s=k / 30, size_px=(1000, 80)), Sighting(60.0 * k, 40.0, 1e-4, 1e-4, 0.0, OK))
        for k in range(1, 9)
    ]
    assert try_blob(follower(position=(0.0, 40.0), velocity=(1800.0, 0.0)), 0, held, np.ones(4)) is None


@pytest.mark.parametrize(("clearer", "taken"), [(0.24, True), (0.26, False)])
def test_a_disc_is_left_for_a_colour_whose_centre_has_a_quarter_of_its_variance(
    clearer: float, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    variances, reaches = iter([clearer, 1.0]), list[float]()
    look = BlobFollower.look_at

    def look_at(one: BlobFollower, frame: Any, cell: Any, place: Any, reach: float, interval_s: float) -> Sighting:
        reaches.append(reach)
        return look(one, frame, cell, place, reach, interval_s)

    monkeypatch.setattr(follow_blob, "blobs_around", lambda *_: [blob(spread_px2=25 * np.eye(2))])
    monkeypatch.setattr(BlobFollower, "look_at", look_at)
    monkeypatch.setattr(shape, "_variance", lambda _: next(variances))
    held: list[Any] = [
        (SimpleNamespace(index=k, time_s=k / 30, size_px=(100, 80)), Sighting(50.0, 40.0, 1e-4, 1e-4, 0.0, OK))
        for k in range(4)
    ]
    assert (try_blob(follower(), 0, held, np.ones(4)) is not None) == taken
    assert reaches == pytest.approx([3.0 * np.sqrt(AREA / np.pi)] * 4)  # three radii about where it is expected
