"""What lies about is no mark of a robot: letters in the frame, and coloured things of which none ever moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evaluator.errors import InputError
from evaluator.recording import open_recording
from evaluator.tracking import TrackingSettings, track
from evaluator.tracking.following.background import travels
from evaluator.tracking.observation import UNLIKE
from evaluator.workflow.tracking import track_recording
from tests.evaluator.tracking.plain_video import GREEN, YELLOW, Clip, box, ellipse, finished, paint, pair, texture

FRAMES = 30
RADIUS = 5.0


def wrong(clip: Clip, folder: Path, settings: TrackingSettings | None = None) -> tuple[int, set[str]]:
    """How many marks are measured, and why the others are not."""
    table = track(open_recording(clip.write(folder)), settings)
    statuses = [status for name in ("green", "yellow") for status in table[f"{name}_status"]]
    return statuses.count("ok"), set(statuses)


def things(green_px: tuple[float, float], yellow_px: tuple[float, float]) -> Clip:
    """A round green and a yellow thing at rest, of these lengths and widths; no robot."""
    rng = np.random.default_rng(3)
    floor = texture(rng)
    paint(floor, ellipse(*green_px), (90, 110), 0.3, GREEN)
    paint(floor, ellipse(*yellow_px), (200, 120), 1.2, YELLOW)
    frames = [finished(rng, floor) for _ in range(FRAMES)]
    return Clip(frames, {name: np.full((FRAMES, 2), np.nan) for name in ("green", "yellow")}, 5.0)


def test_things_of_which_none_moves_and_that_look_like_no_pair_are_no_marks(tmp_path: Path) -> None:
    clip = things((9, 9), (30, 16))
    assert wrong(clip, tmp_path) == (0, {UNLIKE})
    with pytest.raises(InputError, match="never move and do not look like the two marks of a robot"):
        track_recording(tmp_path / "clip.mp4")


@pytest.mark.parametrize("hand_px", [0.0, 1.0])
def test_things_before_a_camera_that_pans_are_no_marks(hand_px: float, tmp_path: Path) -> None:
    """Pans by 2.5 px a frame, and by hand_px more or less in each."""
    rng = np.random.default_rng(11)
    floor = texture(rng, (480, 240))
    paint(floor, ellipse(9, 9), (190, 110), 0.3, GREEN)
    paint(floor, ellipse(30, 16), (290, 120), 1.2, YELLOW)
    at = 2.5 * np.arange(2 * FRAMES) + hand_px * rng.normal(size=2 * FRAMES)
    frames = [finished(rng, floor[:, round(x) : round(x) + 320]) for x in np.clip(at, 0, 160)]
    clip = Clip(frames, {name: np.full((2 * FRAMES, 2), np.nan) for name in ("green", "yellow")}, 5.0)
    assert wrong(clip, tmp_path)[0] == 0


def test_a_user_who_says_where_each_mark_is_vouches_for_it(tmp_path: Path) -> None:
    regions = {"green": {"region_px": [70, 90, 110, 130]}, "yellow": {"region_px": [170, 90, 230, 150]}}
    found, _ = wrong(things((9, 9), (30, 16)), tmp_path, TrackingSettings.model_validate({"mark": regions}))
    assert found == 2 * FRAMES


def test_a_robot_that_rests_all_the_time_has_its_marks(tmp_path: Path) -> None:
    clip = pair(np.random.default_rng(5), ellipse(12, 12), 6.0, 44.0, frames=FRAMES, step=0.0)
    assert wrong(clip, tmp_path)[0] == 2 * FRAMES


def test_marks_are_found_beside_many_stronger_letters(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    floor = texture(rng)
    for k in range(24):  # such as a camera writes into its frames
        paint(floor, box(8, 3), (12 + 13 * k, 230), 0.9 * k, (0, 255, 60))
    clip = pair(rng, ellipse(12, 12), 6.0, 44.0, frames=FRAMES, floor=floor)
    table = track(open_recording(clip.write(tmp_path)))
    for name, truth in clip.truth.items():
        error = np.hypot(*(table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy() - truth).T)
        assert (error < 1.0).all()


@pytest.mark.parametrize(
    ("step_px", "moves"),
    [
        (0.0, False),
        (0.6, True),  # slow: 18 px in 30 frames
        (17.0, True),  # every step is longer than the mark
    ],
)
def test_a_mark_travels_slowly_or_fast(step_px: float, moves: bool) -> None:
    rng = np.random.default_rng(7)
    places = np.outer(np.arange(FRAMES), [step_px, 0.0]) + rng.normal(0, 0.3, (FRAMES, 2))
    assert travels(places, RADIUS) == moves


def test_things_taken_for_one_another_do_not_travel() -> None:
    places = np.random.default_rng(8).choice(np.array([[20.0, 30.0], [90.0, 40.0], [60.0, 120.0]]), FRAMES)
    assert not travels(places, RADIUS)
