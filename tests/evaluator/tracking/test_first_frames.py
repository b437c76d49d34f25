"""What the first frames of a mark decide: its shape, whether it is a disc, and whether something else moves instead."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.tracking.following import shape
from evaluator.tracking.observation import ABSENT, OK, Sighting
from evaluator.tracking.settings import TrackingSettings
from tests.evaluator.tracking.test_tracker_choices import Blob, Disc, at, frame

PAIR, SINGLE = TrackingSettings(), TrackingSettings.model_validate({"mark": {"green": {}}})
CELL = np.ones(4)


class Seen(Disc):
    """A disc that is measured where it is looked for, and notes how."""

    def look_at(self, _frame: Any, _cell: Any, place: Any, reach_px: float, interval_s: float) -> Sighting:
        self.notes.append((place, reach_px, interval_s))
        return at(place[0] + 0.5, place[1])


def held(*green: Sighting, yellow: Sighting = ABSENT["not seen"], step_s: float = 0.1) -> list[Any]:
    """Frames with a green and a yellow mark, the last of them late."""
    times = [step_s * k + 0.5 * (k == len(green) - 1) for k in range(len(green))]
    return [
        (SimpleNamespace(time_s=time_s, index=k + 7), [one, yellow])
        for k, (time_s, one) in enumerate(zip(times, green, strict=True))
    ]


def test_discs_are_measured_again_where_they_were_seen_and_nothing_else_is() -> None:
    green, frames = Seen(), held(at(1.0, 2.0), ABSENT["no disc"], at(3.0, 4.0), yellow=at(9.0, 9.0))
    shape.measure_anew({"green": green, "yellow": Blob()}, PAIR, frames, CELL)
    assert green.notes == [((1.0, 2.0), 2.0, 0.0), ((3.0, 4.0), 2.0, 0.0)]
    assert [sightings[0] for _, sightings in frames] == [at(1.5, 2.0), ABSENT["no disc"], at(3.5, 4.0)]
    assert [sightings[1] for _, sightings in frames] == [at(9.0, 9.0)] * 3
    yellow = Seen()
    shape.measure_anew({"yellow": yellow}, PAIR, frames[:1], CELL)  # green is not followed
    assert yellow.notes == [((9.0, 9.0), 2.0, 0.0)]
    assert frames[0][1] == [at(1.5, 2.0), at(9.5, 9.0)]
    shape.measure_anew({"green": green}, PAIR, frames[:1], CELL, {"green"})  # its centre is within a radius
    assert green.notes[-1] == ((1.5, 2.0), 8.0, 0.0)


@pytest.mark.parametrize("learnt", [True, False])
def test_a_shape_is_learnt_from_every_second_frame_and_shared_before_all_are_measured(
    learnt: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = list[Any]()

    def agreed(followers: Any, pair: Any, _take: Any) -> None:
        done.append(pair)
        if learnt:
            followers["green"].look = "that of its partner"

    monkeypatch.setattr(shape, "patch_of", lambda one, place, radius: (one.index, place, radius))
    monkeypatch.setattr(shape, "finished", lambda lesson: lesson)
    monkeypatch.setattr(shape, "with_disc", lambda look, disc: (look, disc))
    monkeypatch.setattr(shape, "agree", agreed)
    monkeypatch.setattr(shape, "measure_anew", lambda *said: done.append(("measured", said[-1])))
    green: Any = Disc(look="look", take_look=done.append)
    green.learn_anew = lambda patches, interval_s: done.append((patches, interval_s)) or ("disc" if learnt else None)
    frames = held(at(1.0, 2.0), ABSENT["no disc"], at(3.0, 4.0), at(5.0, 6.0), at(7.0, 8.0))
    shape.learn_anew({"green": green, "yellow": Blob()}, PAIR, frames, CELL)
    lesson = [(7, (1.0, 2.0), 8.0), (10, (5.0, 6.0), 8.0)], pytest.approx(0.1)
    assert done == [
        lesson,
        *[("look", "disc")] * learnt,
        ("green", "yellow"),
        ("measured", ["green"] * learnt),
    ]
    done.clear()
    shape.learn_anew({"green": green}, PAIR, held(at(1.0, 2.0)), CELL)
    assert done[0] == ([(7, (1.0, 2.0), 8.0)], 0.0)  # of one frame no interval is known


def partly_seen(*, occluded: bool) -> Any:
    look = SimpleNamespace(disc=SimpleNamespace(radius_px=6.0))
    return Disc(look=look, _slow_path=SimpleNamespace(occluded=occluded))


def choosing(monkeypatch: pytest.MonkeyPatch, mover: Any, blob: Any, settings: TrackingSettings) -> tuple[Any, ...]:
    """What a disc is followed as after three frames, its sightings, what is excluded, and what was tried."""
    tried = list[Any]()
    excluded: Any = SimpleNamespace(blobs=None)
    excluded.exclude = lambda blobs: setattr(excluded, "blobs", blobs)
    monkeypatch.setattr(shape, "try_mover", lambda *_: tried.append("mover") or mover)
    monkeypatch.setattr(shape, "try_blob", lambda *said, disc_px: tried.append((*said[:2], disc_px)) or blob)
    followers: Any = {"green": partly_seen(occluded=False)}
    frames = held(*[at(1.0, 2.0)] * 3)
    shape.choose_shapes(followers, settings, frames, CELL, {"green": (4, "start")}, excluded)  # type: ignore[dict-item]
    return followers["green"], [sightings[0] for _, sightings in frames], excluded.blobs, tried


def test_a_mark_is_followed_as_a_blob_if_that_fits_better_and_a_single_one_where_something_moves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    there = [at(5.0, 6.0), ABSENT["faded"], at(7.0, 8.0)]
    of_pair = choosing(monkeypatch, None, ("blob", there), PAIR)
    assert of_pair == ("blob", there, None, [("start", 4, 6.0)])
    kept, seen, excluded, tried = choosing(monkeypatch, (None, ["thing"]), None, SINGLE)
    assert (type(kept), seen, excluded, len(tried)) == (Disc, [at(1.0, 2.0)] * 3, ["thing"], 2)
    moved = choosing(monkeypatch, (("mover", there), ["thing"]), None, SINGLE)
    assert moved == ("mover", there, ["thing"], ["mover"])


@pytest.mark.parametrize(("occluded", "partner"), [(True, "disc"), (False, "disc"), (True, "blob"), (True, "absent")])
def test_an_oblong_part_of_a_disc_beside_a_whole_one_is_no_blob(
    occluded: bool, partner: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = [at(5.0, 6.0)]
    blobs = {"start of green": ("blob", there), "start of yellow": ("blob", there) if partner == "blob" else None}
    monkeypatch.setattr(shape, "try_blob", lambda start, *_, **__: blobs[start])
    followers: Any = {"green": partly_seen(occluded=occluded), "yellow": partly_seen(occluded=False)}
    if partner == "absent":
        del followers["yellow"]
    starts: Any = {name: (0, f"start of {name}") for name in ("green", "yellow")}
    frames = held(at(1.0, 2.0))
    rivals: Any = SimpleNamespace(exclude=lambda _: None)
    shape.choose_shapes(followers, PAIR, frames, CELL, starts, rivals)
    assert (followers["green"] == "blob") == (not occluded or partner != "disc")
    assert frames[0][1][0] == (there[0] if followers["green"] == "blob" else at(1.0, 2.0))


@pytest.mark.parametrize(
    ("ways", "moves"), [((0.0, 0.5, 1.4), True), ((0.0, 0.5, 1.6), False), ((0.0, 1.4), False), ((), False)]
)
def test_something_else_is_followed_where_a_single_mark_rests_in_three_frames(
    ways: tuple[float, ...], *, moves: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = [*(at(50.0, 40.0 + way) for way in ways), ABSENT["not seen"]]
    mine: Any = [(frame(index), one) for index, one in enumerate(seen)]
    found: Any = SimpleNamespace(center_px=(3.0, 4.0), radius_px=5.0)
    monkeypatch.setattr(shape, "candidates", lambda one, _settings, names: [one.index, *names])
    monkeypatch.setattr(shape, "mover", lambda before, after: (found, [before, after]))
    monkeypatch.setattr(shape, "allowed_cells", lambda *_: None)
    monkeypatch.setattr(shape, "neutral_of", lambda *_: (0.0, 0.0))
    monkeypatch.setattr(shape, "learn_color", lambda *_: "color")
    monkeypatch.setattr(shape, "start_blob", lambda _frame, _cell, *where: where)
    monkeypatch.setattr(shape, "try_blob", lambda *said, surely: (*said[:2], surely))
    tried, resting = shape.try_mover("green", mine, SINGLE, CELL)
    if moves:
        assert tried == (((3.0, 4.0), 5.0, "color", None), 0, True)
        assert resting == [[0, "green"], [len(seen) - 1, "green"]]
        monkeypatch.setattr(shape, "try_blob", lambda *_, **__: None)
        assert shape.try_mover("green", mine, SINGLE, CELL) == (None, [])
    else:
        assert (tried, resting) == (None, [])
    monkeypatch.setattr(shape, "mover", lambda *_: (None, ["thing"]))
    assert shape.try_mover("green", mine, SINGLE, CELL) == (None, [])


def test_a_blob_begins_with_the_largest_area_of_its_colour_about_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what was found, perhaps a small bright part; within two radii, and four pixels at least."""
    from evaluator.tracking.following import follow_blob

    asked = list[Any]()

    def blobs_around(*said: Any) -> list[Any]:
        asked.append(said[3:])
        found = {5.0: 99.0, 9.0: 150.0, 11.0: 999.0}
        return [SimpleNamespace(center_px=(50.0 + off, 40.0), area_px2=area) for off, area in found.items()]

    monkeypatch.setattr(follow_blob, "blobs_around", blobs_around)
    color = np.array([128.0, 128.0, 0.6, -0.8, 18.0, 0.7])
    one = follow_blob.start_blob(frame(3), CELL, (50.0, 40.0), 5.0, color, None)
    assert (one.area_px2, one.position, one.time_s) == (150, (50.0, 40.0), 0.05)
    assert asked == [((50.0, 40.0), 10.0, pytest.approx(0.2 * np.pi * 25.0))]
    small = follow_blob.start_blob(frame(3), CELL, (50.0, 40.0), 1.0, color, 0.3)
    assert small.area_px2 == pytest.approx(np.pi)  # nothing is so near
    assert (asked[1][1], small.shutter) == (4.0, (0.3, 0.0))
    assert one.shutter == (0.5, pytest.approx(12**-0.5))
    assert one.color is not color


def test_only_what_was_seen_counts_for_the_usual_variance_of_a_centre() -> None:
    seen = [Sighting(0.0, 0.0, 1.0, 3.0, 0.0, OK), ABSENT["faded"], Sighting(0.0, 0.0, 5.0, 9.0, 0.0, OK), at(0.0, 0.0)]
    assert shape._variance(seen) == 2.0


def test_shapes_are_learnt_one_after_the_other_one_step_a_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three frames of lessons that need two steps: the third tells what was learnt, if anything."""
    from evaluator.tracking.following import lessons as module

    monkeypatch.setattr(module, "with_disc", lambda look, disc: (look, disc))
    taken, given = list[Any](), list[Any]()

    def lesson(learnt: Any) -> Any:
        yield
        yield
        return learnt

    def mark(learnt: Any) -> Any:
        def learn_anew(views: Any, interval_s: float) -> Any:
            given.append((len(views), interval_s))
            return lesson(learnt)

        return SimpleNamespace(look="look", learn_anew=learn_anew, take_shape=taken.append)

    queue = module.Lessons()
    for learnt, views in ((None, 12), ("disc", 13), ("other", 25)):
        queue.begin(mark(learnt), ["view"] * views, 0.1)  # type: ignore[list-item]
    assert given == [(12, 0.1), (7, 0.1), (9, 0.1)]  # twelve views at most
    assert [queue.go_on() for _ in range(9)] == [False] * 5 + [True, False, False, True]
    assert taken == [("look", "disc"), ("look", "other")]
    assert not queue
