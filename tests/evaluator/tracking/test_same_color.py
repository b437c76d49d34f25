"""Two marks of one colour on one body keep their names, or lose them; they never bear each other's unsaid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from evaluator.recording import open_recording
from evaluator.tracking import TrackingSettings, track
from evaluator.tracking.following.pair import ENOUGH, Body
from evaluator.tracking.following.same_color import exchanged
from tests.evaluator.tracking.plain_video import SIZE, YELLOW, Clip, box, ellipse, finished, loop, paint, texture

Array = NDArray[np.float64]


def turning(frames: int, rate: float) -> tuple[Array, Array, Array]:
    """Times, s, and two marks 40 px apart that turn by a rate, rad a frame, about a place that moves."""
    angle = rate * np.arange(frames)
    half, middle = 20.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1), np.arange(frames)[:, None] * [2.0, 1.0]
    return np.arange(frames) / 30.0, middle - half, middle + half


def test_names_that_were_exchanged_in_a_gap_are_given_back() -> None:
    time_s, one, other = turning(60, 0.08)
    one[20:30], other[22:32] = np.nan, np.nan
    one[32:], other[32:] = other[32:].copy(), one[32:].copy()
    swapped, unknown = exchanged(time_s, one, other)
    assert np.array_equal(swapped, np.arange(60) >= 32)
    assert np.array_equal(unknown, (np.arange(60) >= 20) & (np.arange(60) < 32))


def test_nobody_knows_the_names_after_a_gap_in_which_the_body_may_have_turned_by_a_right_angle() -> None:
    for gap, known in ((15, True), (25, False)):
        time_s, one, other = turning(80, 0.08)
        one[20 : 20 + gap] = other[20 : 20 + gap] = np.nan
        swapped, unknown = exchanged(time_s, one, other)
        assert not swapped.any()
        assert unknown[20:].any() != known


@pytest.mark.parametrize(("degrees", "back"), [(85.0, False), (-85.0, False), (95.0, True), (-95.0, True)])
def test_names_are_exchanged_where_the_line_between_marks_turns_by_more_than_a_right_angle(
    degrees: float, *, back: bool
) -> None:
    time_s, one, other = turning(40, 0.0)
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    middle = (one + other) / 2
    one[20:], other[20:] = ((points - middle)[20:] @ turn.T + middle[20:] for points in (one, other))
    swapped, unknown = exchanged(time_s, one, other)
    assert np.array_equal(swapped, (np.arange(40) >= 20) & back)
    assert not unknown.any()


def test_two_marks_are_never_at_one_place() -> None:
    body = Body()
    for _ in range(ENOUGH):
        assert not body.at_one_place((0.0, 0.0), (0.0, 0.0))  # nothing is known yet
        body.note((0.0, 0.0), (40.0, 0.0))
    assert body.at_one_place((0.0, 0.0), (19.0, 0.0))
    assert not body.at_one_place((0.0, 0.0), (21.0, 0.0))
    assert not body.at_one_place((0.0, 0.0), (np.nan, np.nan))


def test_marks_of_one_colour_are_found_and_keep_their_names_under_a_bar(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    floor, (path, heading), frames = texture(rng), loop(60, (SIZE[0] / 2, SIZE[1] / 2), (85.0, 60.0), 0.05), []
    across = 22.0 * np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    ends = (path - across, path + across)
    bar = np.zeros_like(floor)
    paint(bar, box(26, 600), (140, 120), 0.5, (1, 1, 1))  # its share of each pixel, the same in all frames
    for k in range(60):
        canvas = floor.copy()
        paint(canvas, box(80, 36), tuple(path[k]), heading[k] + np.pi / 2, (28, 28, 30))
        for end in ends:
            paint(canvas, ellipse(12, 12), tuple(end[k]), 0.0, YELLOW)
        frames.append(finished(rng, canvas * (1.0 - bar) + 25.0 * bar))
    settings = TrackingSettings.model_validate(
        {"body": ["yellow_a", "yellow_b"], "mark": {"yellow_a": {}, "yellow_b": {}}}
    )
    table = track(open_recording(Clip(frames, {}, 6.0).write(tmp_path)), settings)
    places = [table[[f"yellow_{name}_x_px", f"yellow_{name}_y_px"]].to_numpy() for name in "ab"]
    if np.hypot(*(places[0][0] - ends[0][0])) > 6.0:  # which is called a is chance
        ends = ends[::-1]
    errors = np.concatenate([np.hypot(*(seen - end).T) for seen, end in zip(places, ends, strict=True)])
    assert np.nanmax(errors) < 1.0
    assert np.isfinite(errors).mean() > 0.8
    assert np.isfinite(errors.reshape(2, -1)[:, -5:]).all()
