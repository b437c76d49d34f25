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
from evaluator.tracking.following import tracker
from evaluator.tracking.following.second_look import SecondLook
from evaluator.tracking.following.tracker import Tracker
from evaluator.tracking.observation import MISTAKEN, Sighting
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
