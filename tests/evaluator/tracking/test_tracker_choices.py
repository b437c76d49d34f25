"""What a tracker decides from frame to frame, with followers and searches that are made up."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.following import tracker as module
from evaluator.tracking.following.follow import Follower
from evaluator.tracking.following.follow_blob import BlobFollower
from evaluator.tracking.following.tracker import Tracker
from evaluator.tracking.observation import ABSENT, OK, REPEATED, Sighting
from evaluator.tracking.settings import TrackingSettings

LOST = ABSENT["not seen"]


def at(x: float, y: float) -> Sighting:
    return Sighting(x, y, 1e-4, 1e-4, 0.0, OK)


def frame(index: int = 0, **said: Any) -> Any:
    return SimpleNamespace(index=index, time_s=index / 60, repeated=False, luma=np.zeros((8, 8)), **said)


class Disc(Follower):
    """Stands for a follower of a disc, which is where the search says that it is."""

    def __init__(self, **said: Any) -> None:
        usual = {"position": (10.0, 20.0), "velocity": (3.0, -4.0), "time_s": 0.0, "missed": 0, "seen": 100}
        self.notes, self.views, self.radius_px = list[Any](), ["view"] * 25, 8.0
        self.color, self.last_sighting = np.array([128.0, 128.0, 0.6, 0.8, 20.0, 0.5]), (None, 0.0)
        vars(self).update(usual | said)

    def look_again(self, _frame: Any, _cell: Any, place: Any, _interval: float, guide: Any, light: float) -> Sighting:
        self.notes.append((guide, light))
        return at(*place)

    def keep_view(self, _frame: Any) -> None:
        self.notes.append("view")

    def note_light(self, _frame: Any) -> None:
        self.notes.append("light")

    def looks_changed(self) -> bool:
        return bool(self.notes)

    def learn_anew(self, patches: Any, _interval: float) -> Any:
        self.notes.append(len(patches))
        return iter(())


class Blob(BlobFollower):
    """Stands for a follower of a sticker."""

    def __init__(self, **said: Any) -> None:
        vars(self).update({"missed": 0, "seen": 100, **said})


def following(**followers: Any) -> Any:
    one: Any = Tracker(TrackingSettings())
    one.followers = followers
    return one


def paired(one: Any, distance: float = 40.0) -> None:
    """Let the marks' distance be known."""
    for _ in range(6):
        one.body.note((0.0, 0.0), (distance, 0.0))


@pytest.fixture
def places(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """Where each mark is found in the whole image."""
    found: dict[str, list[Any]] = {"green": [], "yellow": []}
    monkeypatch.setattr(Tracker, "_places", lambda _self, name, _frame: found[name])
    monkeypatch.setattr(module, "mean_light", lambda _frame: 30.0)
    return found


@pytest.mark.parametrize(("before", "light"), [(60.0, 0.5), (0.0, 1.0), (300.0, 0.2), (20.0, 1.5)])
def test_a_lost_mark_is_found_at_its_distance_from_its_partner_and_as_fast_in_the_light_that_is_left(
    before: float, light: float, places: dict[str, list[Any]]
) -> None:
    one = following(green=Disc(), yellow=Disc(velocity=(7.0, 1.0)))
    one._light = before
    paired(one)
    places["green"] += [(10.0, 20.0), (60.0, 20.0), (140.0, 20.0)]
    sightings = [LOST, at(100.0, 20.0)]
    one._recover(frame(), sightings)
    assert sightings[0][:2] in {(60.0, 20.0), (140.0, 20.0)}
    assert one.followers["green"].notes == [((7.0, 1.0), light)]
    assert one.body.confirmed


def test_two_lost_marks_are_found_as_a_pair_or_one_alone_within_reach(places: dict[str, list[Any]]) -> None:
    one = following(green=Disc(), yellow=Disc())
    paired(one)
    places["green"] += [(300.0, 300.0), (500.0, 500.0)]
    places["yellow"] += [(340.0, 300.0), (900.0, 900.0)]
    sightings = [LOST, LOST]
    one._recover(frame(), sightings)
    assert [found[:2] for found in sightings] == [(300.0, 300.0), (340.0, 300.0)]
    assert one.followers["green"].notes[0][0] == (0.0, 0.0)
    assert not one.body.confirmed  # at a place where one of them was alone first

    one = following(green=Disc(), yellow=Disc())
    paired(one)
    places["green"][:], places["yellow"][:] = [(300.0, 300.0), (10.0 + 39.0, 20.0)], []
    sightings = [LOST, LOST]
    one._recover(frame(), sightings)
    assert [found[:2] for found in sightings[:1]] == [(49.0, 20.0)]  # as far as its partner is
    assert sightings[1] is LOST

    one = following(green=Disc())  # yellow was never seen: nothing is known of the distance
    sightings = [LOST, LOST]
    one._recover(frame(), sightings)
    assert sightings[0][:2] == (49.0, 20.0)


@pytest.mark.parametrize("confirmed", [False, True])
def test_a_mark_found_alone_is_left_for_the_pair_that_fits(confirmed: bool, places: dict[str, list[Any]]) -> None:
    one = following(green=Disc(), yellow=Disc())
    paired(one)
    one.body.confirmed = confirmed
    places["green"] += [(300.0, 300.0)]
    places["yellow"] += [(200.0, 200.0), (340.0, 300.0)]
    sightings = [LOST, at(200.0, 200.0)]
    one._recover(frame(), sightings)
    expected = [LOST[:2], (200.0, 200.0)] if confirmed else [(300.0, 300.0), (340.0, 300.0)]
    np.testing.assert_array_equal([found[:2] for found in sightings], expected)


@pytest.mark.parametrize(
    ("follower", "given_up"),
    [
        (Disc(missed=31, seen=11), True),
        (Disc(missed=30, seen=11), False),
        (Disc(missed=31, seen=12), False),
        (Blob(missed=9, seen=11), True),
        (Blob(missed=8, seen=11), False),
    ],
)
def test_what_hardly_ever_fitted_is_given_up(follower: Any, given_up: bool) -> None:
    one = following(green=follower)
    one._note("green", frame(), LOST)
    assert ("green" in one.followers) != given_up


@pytest.mark.parametrize(
    ("index", "seen", "noted"),
    [
        (2, 100, ["view", "light"]),
        (3, 100, ["view"]),
        (32, 600, ["view", "light"]),  # seldom once it was seen in 512 frames
        (34, 600, ["view"]),
        (33, 600, ["view"]),
        (3, 60, ["view", 9]),  # every third of 25 views, twelve at most
        (3, 240, ["view", 9]),
        (3, 61, ["view"]),
    ],
)
def test_views_light_and_lessons_are_taken_as_often_as_they_tell(index: int, seen: int, noted: list[Any]) -> None:
    one = following(green=Disc(seen=seen))
    one._note("green", frame(index), at(1.0, 2.0))
    assert one.followers["green"].notes == noted
    assert len(one._lessons) == (9 in noted)
    one = following(green=Blob(seen=seen))
    one._note("green", frame(index), at(1.0, 2.0))
    assert not one._lessons


def test_a_disc_that_is_smaller_now_is_followed_as_a_blob_once_the_first_frames_are_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    blob = Blob()
    monkeypatch.setattr(module, "resized", lambda *_: blob)
    for settled in (False, True):
        one = following(green=Disc())
        one._settled = settled
        one._note("green", frame(1), at(1.0, 2.0))
        assert (one.followers["green"] is blob) == settled


@pytest.mark.parametrize(("step_px", "again"), [(0.29, False), (0.31, True)])
def test_a_repeated_frame_shows_earlier_places_of_marks_that_move_by_three_tenths_of_a_pixel(
    step_px: float, again: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, repeated, looked = following(green=Disc(velocity=(60 * step_px, 0.0)), yellow=Disc()), frame(1), list[Any]()
    one._shape, repeated.repeated = (8, 8), True
    one.followers["yellow"].velocity = (0.0, 0.0)
    monkeypatch.setattr(one, "_discover", lambda _: None)
    monkeypatch.setattr(one, "_all_followed", lambda *_: looked.append(1) or [at(1.0, 2.0), at(41.0, 2.0)])
    monkeypatch.setattr(one, "_note", lambda *_: None)
    for mark in one.followers.values():
        monkeypatch.setattr(mark, "accept", lambda *_: None)
    found = one.step(repeated)
    assert ([sighting.status for sighting in found] == [REPEATED] * 2) == again
    assert len(looked) == (not again)
