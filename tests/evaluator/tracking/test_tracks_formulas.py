"""Where a mark is expected, where it is looked for once it is lost, and what of its track is no course of a body."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.following import shape, tracker
from evaluator.tracking.following.background import _steady
from evaluator.tracking.following.jumps import _worth, off_course
from evaluator.tracking.following.motion import Motion
from evaluator.tracking.following.tracker import Tracker
from evaluator.tracking.observation import ABSENT, OK, Sighting
from evaluator.tracking.refinement import fast_path
from evaluator.tracking.refinement.disc import make_disc
from evaluator.tracking.settings import TrackingSettings


def at(x: float, y: float) -> Sighting:
    return Sighting(x, y, 1e-4, 1e-4, 0.0, OK)


def frame(time_s: float = 0.0) -> Any:
    return SimpleNamespace(time_s=time_s)


def moving(**said: Any) -> Motion:
    one = Motion()
    usual = {"position": (10.0, 20.0), "velocity": (3.0, -4.0), "time_s": 2.0, "missed": 0}
    for name, value in (usual | said).items():
        setattr(one, name, value)
    return one


def test_a_mark_is_expected_at_constant_velocity() -> None:
    assert moving().predicted(2.5) == pytest.approx((11.5, 18.0))
    assert moving(position=None).predicted(2.5) is None
    assert moving().step_px(0.5) == pytest.approx(3.5)  # both axes together


@pytest.mark.parametrize(
    ("missed", "time_s", "steady", "velocity"),
    [(0, 2.25, True, (4.0, -8.0)), (0, 2.0, False, (3.0, -4.0)), (3, 2.25, False, (3.0, -4.0)),
     (4, 2.25, False, (0.0, 0.0))],
)  # fmt: skip
def test_velocity_is_that_since_the_frame_before_and_nothing_after_more_than_three_misses(
    missed: int, time_s: float, steady: bool, velocity: tuple[float, float]
) -> None:
    one = moving(missed=missed)
    assert one.move(at(11.0, 18.0), time_s) == steady
    assert one.velocity == pytest.approx(velocity)
    assert (one.position, one.time_s, one.missed) == ((11.0, 18.0), time_s, 0)
    assert not one.move(ABSENT["not seen"], 3.0)
    assert (one.position, one.time_s, one.missed) == ((11.0, 18.0), time_s, 1)


def test_pieces_that_stand_beside_one_that_moves_count_a_third_up_to_half_a_jump() -> None:
    moves, stands = np.outer(np.arange(20.0), [3.0, 0.0]), np.full((30, 2), 7.0)
    places = np.vstack([moves, stands])
    assert _worth([slice(0, 20), slice(20, 32)], places, 1.5).tolist() == [20.0, 4.0]
    assert _worth([slice(0, 20), slice(20, 50)], places, 1.5).tolist() == [20.0, 7.5]
    assert _worth([slice(0, 20), slice(20, 40), slice(40, 50)], places, 1.5) == pytest.approx([20.0, 5.0, 2.5])
    assert _worth([slice(20, 30), slice(30, 50)], places, 1.5).tolist() == [10.0, 20.0]  # nothing moves


@pytest.mark.parametrize(("step_px", "told"), [(0.6, True), (0.4, False)])
def test_standing_is_told_from_motion_of_half_a_pixel_a_frame_on(step_px: float, told: bool) -> None:
    points = np.column_stack([step_px * np.arange(60.0), np.zeros(60)])
    points[21:31] = points[20]
    assert np.flatnonzero(off_course(np.arange(60) / 30, points, 4.0)).tolist() == (list(range(21, 31)) if told else [])


def test_seven_frames_tell_a_place_that_a_mark_cannot_have_come_to() -> None:
    points = np.column_stack([2.0 * np.arange(7.0), np.zeros(7)])
    points[3] += 60.0
    assert np.flatnonzero(off_course(np.arange(7) / 30, points, 8.0)).tolist() == [3]


def resting(monkeypatch: pytest.MonkeyPatch, places: np.ndarray) -> bool:
    """Whether something else that moves is looked for instead of a mark that was seen at some places."""
    asked = []
    monkeypatch.setattr(shape, "candidates", lambda *_: [])
    monkeypatch.setattr(shape, "mover", lambda *_: asked.append(True) or (None, []))
    held = [(frame(), at(*place)) for place in places]
    assert shape.try_mover("green", held, TrackingSettings(), np.zeros(4)) == (None, [])
    return bool(asked)


def test_something_that_moves_is_looked_for_instead_of_a_mark_that_rests(monkeypatch: pytest.MonkeyPatch) -> None:
    still = np.tile([90.0, 30.0], (8, 1))
    assert resting(monkeypatch, still)
    assert not resting(monkeypatch, still[:2])
    for axis in (0, 1):
        moved = still + np.outer(np.arange(8), np.eye(2)[axis]) * 0.2
        assert resting(monkeypatch, moved)
        assert not resting(monkeypatch, still + np.outer(np.arange(8), np.eye(2)[axis]) * 0.22)


class Probe(Motion):
    """A follower that notes where it is looked for."""

    radius_px = 8.0

    def __init__(self, **said: Any) -> None:
        vars(self).update(vars(moving(**said)))
        self.last_sighting, self.asked = (None, 0.0), list[Any]()

    def look_at(self, _frame: object, _cell: object, place: Any, reach: float, _interval: float) -> Sighting:
        self.asked.append((place, reach))
        return at(*place)

    def look_again(self, _frame: object, _cell: object, place: Any, *_: object) -> Sighting:
        self.asked.append(place)
        return ABSENT["no disc"]


def test_a_mark_is_looked_for_within_half_a_step_more_for_every_miss_and_after_eight_in_the_whole_image() -> None:
    one: Any = Tracker(TrackingSettings())
    one.interval_s = 0.5
    for missed, reach in ((0, 3.75), (2, 11.25)):  # 2 px and half of a step of 3.5 px, for each frame
        probe = Probe(missed=missed)
        assert one._followed(probe, frame(), 2.5).status == OK
        assert probe.asked == [(pytest.approx((11.5, 18.0)), pytest.approx(reach))]
    assert one._followed(Probe(missed=9), frame(), 2.5).status == "not seen"
    assert one._followed(Probe(position=None), frame(), 2.5).status == "not seen"


@pytest.mark.parametrize(
    ("pair", "second", "noted"),
    [(True, at(4.0, 6.0), True), (False, at(4.0, 6.0), False), (True, ABSENT["not seen"], False)],
)
def test_the_distance_of_a_pair_is_learnt_from_frames_that_show_both(
    pair: bool, second: Sighting, *, noted: bool
) -> None:
    seen = list[Any]()
    body = SimpleNamespace(note=lambda *places: seen.append(places))
    one: Any = SimpleNamespace(settings=SimpleNamespace(pair=pair), body=body)
    for sightings in ([at(1.0, 2.0), second], [second, at(1.0, 2.0)]):
        Tracker._note_distance(one, sightings)
    assert seen == ([((1.0, 2.0), (4.0, 6.0)), ((4.0, 6.0), (1.0, 2.0))] if noted else [])


@pytest.mark.parametrize("missed", [7, 8])
def test_of_the_places_of_a_lost_mark_the_three_nearest_to_its_course_are_looked_at_or_the_first(missed: int) -> None:
    one: Any = Tracker(TrackingSettings())
    places = [(90.0, 18.0), (11.0, 30.0), (14.0, 18.0), (12.0, 19.0)]
    probe, miss = Probe(missed=missed), ABSENT["not seen"]
    assert one._found_again(probe, frame(2.5), places, (0.0, 0.0), miss) is miss
    assert probe.asked == ([places[3], places[2], places[1]] if missed == 7 else places[:3])
    assert probe.last_sighting == (probe.asked[0], 2.5)


def test_a_lost_mark_can_have_come_as_far_as_its_partner_is_and_two_steps_for_every_frame() -> None:
    lost = moving(missed=1)  # 40 px and four steps of 3.5 px: 54 px
    assert lost.may_be_at((10.0 + 30.0, 20.0 - 23.9), 0.5, 40.0)
    assert not lost.may_be_at((10.0 - 30.0, 20.0 + 24.1), 0.5, 40.0)
    assert moving(position=None).may_be_at((500.0, 500.0), 0.5, 40.0)


def test_an_interval_is_the_time_since_the_frame_before_and_a_repeated_frame_shows_no_mark_that_moves() -> None:
    one: Any = Tracker(TrackingSettings())
    one._shape = (8, 8)
    one.followers = {name: Probe(velocity=(0.0, 70.0)) for name in one.names}
    for time_s, interval_s in ((0.0, 1 / 60), (0.1, 0.1), (0.1, 0.1), (0.15, 0.05)):
        shown = SimpleNamespace(time_s=time_s, luma=np.zeros((8, 8)), repeated=True)
        assert [one.status for one in one.step(shown)] == ["repeated frame"] * 2
        assert one.interval_s == pytest.approx(interval_s)


@pytest.mark.parametrize(("far", "steady"), [(53.9, True), (54.1, False)])
def test_distances_of_one_body_differ_by_two_seventh_parts_and_two_pixels(far: float, steady: bool) -> None:
    """Of 40 px: 0.3 of them for slant and perspective, 2 px for noise; a tenth may lie beyond at either end."""
    assert _steady(np.array([1.0, *[40.0] * 9, *[far] * 9, 900.0])) == steady


@pytest.mark.parametrize(("origin", "step", "cell"), [(0, 1, (2, 2, 0.5, 0.5)), (1, 2, (2, 4, 0.5, 2.0))])
def test_a_chroma_sample_lies_amid_the_pixels_that_it_colours(
    origin: int, step: int, cell: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tracker, "Search", lambda *_: None)
    one, planes = Tracker(TrackingSettings()), np.zeros((10, 12), np.uint8)
    seen: Any = SimpleNamespace(luma=planes, u=planes[::2, ::2], v=planes[::2, ::2], row_origin=origin, row_step=step)
    seen.cosited = False
    one._prepare(seen)
    assert one.cell == pytest.approx(cell)


def test_a_smear_is_no_longer_than_the_mark() -> None:
    disc = make_disc(8.0, 0.9, (0.0, 0.0), (120.0, 40.0), 4.0).numbers()
    fast_path.smear(disc, 3.0, -4.0)
    assert disc[5:7] == pytest.approx([3.0, -4.0])
    fast_path.smear(disc, 30.0, -40.0)
    assert disc[5:7] == pytest.approx([9.6, -12.8])  # a diameter of 16 px
