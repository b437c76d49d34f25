"""A disc that drives away from a slanted camera is no longer the disc that was learnt: it is followed as a blob."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.recording import Frame
from evaluator.tracking.following.follow import GONE, Follower
from evaluator.tracking.following.follow_blob import BlobFollower
from evaluator.tracking.following.shape import UNLIKE, resized
from evaluator.tracking.following.tracker import Tracker
from evaluator.tracking.observation import OK, Sighting
from evaluator.tracking.settings import TrackingSettings
from tests.evaluator.tracking.synthetic import draw, frames_in_memory

SIZE, PLACE = (160, 120), (80.0, 60.0)


def followed(radius_px: float) -> tuple[Tracker, Follower, Frame]:
    """A disc of 8 px that was followed for 15 frames, and a frame in which it has another radius."""
    rng = np.random.default_rng(2)
    images = [draw(rng, SIZE, {"green": PLACE}, 8.0, 0.8, 2.0) for _ in range(15)]
    *first, last = frames_in_memory([*images, draw(rng, SIZE, {"green": PLACE}, radius_px, 0.8, 2.0)])
    tracker = Tracker(TrackingSettings.model_validate({"mark": {"green": {}}}))
    list(tracker.run(first))
    follower = tracker.followers["green"]
    assert isinstance(follower, Follower)
    return tracker, follower, last


@pytest.mark.parametrize(
    ("radius_px", "unlike", "is_blob"), [(5.0, UNLIKE, True), (5.0, UNLIKE - 1, False), (8.0, UNLIKE, False)]
)
def test_a_mark_long_unlike_its_disc_and_smaller_goes_on_as_a_blob(
    radius_px: float, unlike: int, *, is_blob: bool
) -> None:
    tracker, follower, frame = followed(radius_px)
    follower.unlike = unlike
    blob = resized(follower, frame, tracker.cell, Sighting(*PLACE, 9.0, 9.0, 0.0, OK))
    assert isinstance(blob, BlobFollower) == is_blob
    if blob is not None:
        assert blob.radius_px == pytest.approx(radius_px, rel=0.1)


@pytest.mark.parametrize(("turned", "found"), [(0.25, True), (0.45, False)])
def test_what_has_another_hue_is_no_view_of_a_mark_and_not_found_again_when_it_was_long_gone(
    turned: float, *, found: bool
) -> None:
    """An arm where a ball was seen last, a wooden handle after it was taken out of view."""
    tracker, follower, frame = followed(5.0)
    follower.unlike = UNLIKE
    mean_uv = follower.color[2:4].copy()
    follower.color[2:4] = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]]) @ mean_uv
    blob = resized(follower, frame, tracker.cell, Sighting(*PLACE, 9.0, 9.0, 0.0, OK))
    assert (blob is not None) == found
    _, disc, same = followed(8.0)
    disc.color[2:4] = follower.color[2:4]
    for missed, seen in ((GONE, True), (GONE + 1, found)):
        disc.missed = missed
        assert (disc.look_again(same, tracker.cell, PLACE, 0.02, (0.0, 0.0), 1.0).status == OK) == seen


def test_frames_whose_centre_is_vague_or_missing_count_as_unlike_the_disc_until_one_is_sharp() -> None:
    _, follower, _ = followed(8.0)
    x, y = PLACE
    for k, one in enumerate((Sighting(x, y, 9.0, 9.0, 0.0, OK), Sighting(np.nan, np.nan, 0, 0, 0, "no disc"))):
        follower.accept(one, 1.0 + k)
        assert follower.unlike == k + 1
    follower.accept(Sighting(x, y, 0.01, 0.01, 0.0, OK), 3.0)
    assert follower.unlike == 0


def test_a_mark_that_was_hidden_altogether_is_no_smaller_one_until_it_was_seen_whole() -> None:
    """Something dark that crosses a mark of a dark body leaves part of it for many frames, and then another part."""
    tracker, follower, frame = followed(5.0)
    gone, sharp = Sighting(np.nan, np.nan, 0, 0, 0, "not seen"), Sighting(*PLACE, 0.01, 0.01, 0.0, OK)
    vague = Sighting(*PLACE, 9.0, 9.0, 0.0, OK)
    for k, one in enumerate([*[gone] * UNLIKE, vague]):
        follower.accept(one, 1.0 + k)
    assert follower.unlike > UNLIKE
    assert resized(follower, frame, tracker.cell, vague) is None
    for k, one in enumerate([sharp, *[vague] * UNLIKE]):
        follower.accept(one, 20.0 + k)
    assert resized(follower, frame, tracker.cell, vague) is not None
