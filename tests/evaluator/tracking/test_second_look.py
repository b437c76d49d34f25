"""What is in view when a recording begins is left for the robot's marks once these are seen."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from evaluator.recording import open_recording
from evaluator.tracking import TrackingSettings, track
from evaluator.tracking.detection.find import Reading
from evaluator.tracking.detection.selection import Candidate
from evaluator.tracking.following import second_look, tracker
from evaluator.tracking.following.second_look import WITHIN, SecondLook, at_place_of, beside_partner, covers
from evaluator.tracking.following.tracker import Tracker
from evaluator.tracking.observation import ABSENT, MISTAKEN, OK, Sighting
from tests.evaluator.tracking.plain_video import (
    GREEN,
    YELLOW,
    Clip,
    box,
    ellipse,
    finished,
    paint,
    pair,
    texture,
)

LATE = 20
Place = tuple[float, float]


def scored(clip: Clip, folder: Path) -> tuple[int, float]:
    """How many marks are measured that are none, and the share found of those in view from six frames after LATE."""
    table = track(open_recording(clip.write(folder)))
    wrong, found = 0, list[NDArray[np.bool_]]()
    for name, truth in clip.truth.items():
        seen = (table[f"{name}_status"] == "ok").to_numpy()
        error = np.hypot(*(table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy() - truth).T)
        wrong += int((seen & ~(error < clip.half_px)).sum())
        found.append(seen[LATE + 16 + 6 :])
        assert MISTAKEN in set(table[f"{name}_status"])
    return wrong, float(np.mean(found))


def test_a_robot_that_comes_in_is_followed_rather_than_what_lay_there_before(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    floor = texture(rng)
    paint(floor, box(26, 9), (40, 30), 0.3, tuple(0.8 * np.array(GREEN)))  # type: ignore[arg-type]
    paint(floor, box(20, 12), (75, 40), 1.2, tuple(0.8 * np.array(YELLOW)))  # type: ignore[arg-type]
    clip = pair(rng, ellipse(12, 12), 6.0, 44.0, frames=60, floor=floor)
    clip.frames[:LATE] = [finished(rng, floor) for _ in range(LATE)]
    for truth in clip.truth.values():
        truth[:LATE] = np.nan
    wrong, found = scored(clip, tmp_path)
    assert wrong == 0
    assert found == 1.0


def test_a_mark_that_stays_is_measured_anew_where_its_first_shape_was_half_a_hand(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is seen before its partner proves to be another one is held until its shape is learnt."""
    look, done = Tracker(TrackingSettings()), dict[str, list[int]]()

    def step(frame: Any) -> list[Sighting]:
        if frame.index == 5:
            look.began["yellow"] = 5
        return []

    for name in ("learn_anew", "measure_anew", "choose_shapes"):

        def note(_one: object, _two: object, held: list[Any], *_: object, name: str = name) -> None:
            done.setdefault(name, []).extend(frame.index for frame, _ in held)

        monkeypatch.setattr(tracker, name, note)
    monkeypatch.setattr(look, "step", step)
    look.followers = {"green": cast("Any", object())}
    frames = [SimpleNamespace(index=k) for k in range(20)]
    given = [cast("Any", frame).index for frame, _ in look.run(cast("Any", frames))]
    assert given == list(range(20))
    assert done == {
        "learn_anew": list(range(5, 17)),
        "measure_anew": list(range(5)),
        "choose_shapes": list(range(5, 17)),
    }


@pytest.mark.parametrize(
    ("green", "yellow", "sure"),
    [
        ((20.0, 0.0), (20.0, 40.0), True),  # four radii, as one body
        ((14.0, 0.0), (14.0, 40.0), False),  # hardly moved
        ((0.0, 0.0), (20.0, 40.0), False),  # one of them rests: the robot turns about it, or it is none of the robot's
        ((20.0, 0.0), (60.0, 40.0), False),  # on no one body
    ],
)
def test_what_is_followed_is_doubted_until_both_marks_have_travelled_as_one_body(
    green: Place, yellow: Place, sure: bool
) -> None:
    look, settings = SecondLook(), TrackingSettings()

    def at(one: Place, other: Place) -> Any:
        places = {"green": one, "yellow": other}
        return {name: SimpleNamespace(position=place, missed=0, radius_px=5.0) for name, place in places.items()}

    assert look._doubtful(settings, at((0.0, 0.0), (0.0, 40.0)))
    assert look._doubtful(settings, at(green, yellow)) != sure
    look.begin()
    assert look._doubtful(settings, at(green, yellow))
    assert look._doubtful(settings, {})


def looked(
    monkeypatch: pytest.MonkeyPatch, indices: list[int], *, known: tuple[int, ...] = (), score: float = 0.0,
    whole: bool = True, followed: tuple[str, ...] = ("green", "yellow"), seen: int = 2,
) -> tuple[list[int], list[int], SecondLook]:  # fmt: skip
    """Frames that are searched, those in which another pair is given, and what looked at them.

    known: frames that show the pair that is followed. score, whole: of the pair found. seen: marks that are found.
    """
    look, searched, at = SecondLook(), list[int](), [0]
    found: Any = SimpleNamespace(
        chosen=dict.fromkeys(["green", "yellow"][:seen], SimpleNamespace(whole=whole)), blobs=[]
    )
    monkeypatch.setattr(second_look, "find_marks", lambda *_: searched.append(at[0]) or found)
    monkeypatch.setattr(second_look, "choose", lambda *_: ({}, score))
    monkeypatch.setattr(second_look, "alike", lambda *_: ["pair"])
    monkeypatch.setattr(second_look, "_followed", lambda *_: at[0] in known)
    monkeypatch.setattr(SecondLook, "_doubtful", lambda *_: True)
    given = []
    for index in indices:
        at[0] = index
        frame: Any = SimpleNamespace(index=index, time_s=index / 60)
        if look.better(frame, TrackingSettings(), cast("Any", dict.fromkeys(followed))) is not None:
            given.append(index)
    return searched, given, look


def test_another_pair_is_followed_that_three_frames_in_a_row_show(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = list(range(14, 40))
    assert looked(monkeypatch, frames)[:2] == ([16, 17, 18, 32, 33, 34], [18, 34])
    assert looked(monkeypatch, frames, followed=("green",))[0][:7] == [16, 17, 18, 20, 21, 22, 24]
    searched, given, look = looked(monkeypatch, frames, known=(17, 33))
    assert (searched, given, look.plausible) == ([16, 17, 32, 33], [], True)
    for odd in ({"score": -4.1}, {"whole": False}, {"seen": 1}):
        searched, given, look = looked(monkeypatch, frames, **cast("Any", odd))
        assert (searched, given, look.plausible) == ([16, 32], [], False)


@pytest.mark.parametrize(("apart_px", "same"), [(15.9, True), (16.1, False)])
def test_a_blob_is_the_mark_that_is_followed_within_two_radii_beside_its_way(apart_px: float, *, same: bool) -> None:
    """Three pixels of radius, and a way of 10 px in a frame."""
    follower: Any = SimpleNamespace(position=(0.0, 0.0), predicted=lambda _time: (10.0, 0.0))
    blob: Any = SimpleNamespace(center_px=(10.0, apart_px), radius_px=3.0)
    assert at_place_of(blob, follower, 0.0) == same
    assert not at_place_of(blob, None, 0.0)
    other: Any = SimpleNamespace(position=None, predicted=lambda _time: None)
    assert not at_place_of(blob, other, 0.0)


def test_a_mark_that_touches_another_is_not_at_its_place_within_one_radius() -> None:
    follower: Any = SimpleNamespace(position=(10.0, 10.0), predicted=lambda _time: (10.0, 10.0))
    blob: Any = SimpleNamespace(center_px=(10.0, 15.0), radius_px=4.0)
    assert at_place_of(blob, follower, 0.0)
    assert not at_place_of(blob, follower, 0.0, WITHIN)


def test_partner_of_a_mark_that_moves_by_their_distance_in_a_frame_is_another_mark() -> None:
    """The predicted position errs by the motion in a frame at most; the measured one does not."""
    follower: Any = SimpleNamespace(position=(0.0, 0.0), predicted=lambda _time: (40.0, 0.0))
    partner: Any = SimpleNamespace(center_px=(38.0, 25.0), radius_px=6.0)
    assert not covers(follower, Sighting(38.0, 0.0, 0.01, 0.01, 0.0, OK), partner, 0.0)
    assert covers(follower, Sighting(38.0, 22.0, 0.01, 0.01, 0.0, OK), partner, 0.0)
    assert covers(follower, ABSENT["not seen"], partner, 0.0)


def test_the_other_mark_of_a_robot_is_sought_beside_the_one_that_is_followed() -> None:
    settings = TrackingSettings.model_validate({"mark": {"red": {}, "blue": {}}, "body": ["red", "blue"]})
    far, near = (
        Candidate("blue", (x, 40.0), 10.0, 1.0, chroma, (90.0, 90.0)) for x, chroma in ((400.0, 90.0), (63.0, 80.0))
    )
    follower: Any = SimpleNamespace(position=(50.0, 40.0), radius_px=10.0, predicted=lambda _time: (50.0, 40.0))
    found = Reading({"blue": far}, [far, near], 1.0)
    assert beside_partner(found, settings, {}, 0.0) == {"blue": far}
    assert beside_partner(found, settings, {"red": follower}, 0.0) == {"blue": near}


def test_a_pair_is_plausible_that_looks_like_one_or_whose_places_were_said(monkeypatch: pytest.MonkeyPatch) -> None:
    pair: Any = {"green": None, "yellow": None}
    place = {"region_px": (0, 0, 9, 9)}
    for score, marks, plausible in (
        (-3.9, {}, True),
        (-4.1, {}, False),
        (-9.0, {"green": place, "yellow": place}, True),
        (-9.0, {"green": place, "yellow": {}}, False),
    ):
        monkeypatch.setattr(second_look, "choose", lambda *_, score=score: ({}, score))
        look = SecondLook()
        look.note(pair, TrackingSettings.model_validate({"mark": marks} if marks else {}))
        assert look.plausible == plausible
