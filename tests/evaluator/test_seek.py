"""Frames by number are the frames that iterating gives: clips carry their frame number as bright and dark squares."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path

import numpy as np
import pytest

from evaluator.errors import InputError
from evaluator.recording import open_recording
from evaluator.recording.seek import Frames, _Seeking
from tests.evaluator.counted_clip import counted_clip, number_in


@pytest.mark.parametrize(
    ("name", "gop", "b_frames", "step"),
    [("a.mp4", 12, 0, 1), ("b.mp4", 12, 3, 1), ("c.mp4", 250, 3, 4), ("d.mkv", 12, 2, 3), ("e.ts", 12, 2, 1)],
)
def test_random_frames_show_their_number(tmp_path: Path, name: str, gop: int, b_frames: int, step: int) -> None:
    path = counted_clip(tmp_path / name, 300, gop=gop, b_frames=b_frames, step=step)
    frames, rng = Frames(path), np.random.default_rng(1)
    assert len(frames.contents.time_s) == 300
    for index in [0, 299, *map(int, rng.integers(0, 300, 60))]:
        assert number_in(frames.image(index)) == index
    for index in (150, 149, 148, 151):  # steps back and forth
        assert number_in(frames.image(index)) == index


@pytest.mark.parametrize("name", ["v.mp4", "v.ts"])  # the clock of the second begins anywhere
def test_times_and_numbers_are_those_of_iterating(tmp_path: Path, name: str) -> None:
    path = counted_clip(tmp_path / name, 50, gop=12, b_frames=2, step=4)
    recording = open_recording(path)
    seen = [(frame.time_s, number_in(frame.to_rgb())) for frame in recording]
    frames = Frames(path)
    assert list(frames.contents.time_s) == [time for time, _ in seen]
    assert [(frames.frame(index).time_s, number_in(frames.image(index))) for index in range(50)] == seen


def test_the_key_frame_before_is_named(tmp_path: Path) -> None:
    frames = Frames(counted_clip(tmp_path / "k.mp4", 60, gop=12))
    assert [frames.key_frame(index) for index in (0, 11, 12, 59)] == [0, 0, 12, 48]


def test_recordings_without_times_are_decoded_from_the_beginning(tmp_path: Path) -> None:
    path = counted_clip(tmp_path / "raw.h264", 60, gop=12)
    expected = [number_in(frame.to_rgb()) for frame in open_recording(path)]
    frames = Frames(path)
    assert len(frames.contents.time_s) == len(expected)
    for index in (40, 3, 59, 20):
        assert number_in(frames.image(index)) == expected[index]


def test_a_frame_that_is_not_there_is_refused(tmp_path: Path) -> None:
    frames = Frames(counted_clip(tmp_path / "s.mp4", 20, gop=12))
    with pytest.raises(InputError, match="there is no frame 20; it has 20"):
        frames.image(20)


def test_a_recording_that_is_opened_at_its_beginning_is_not_decoded_from_there_for_ever(tmp_path: Path) -> None:
    path = counted_clip(tmp_path / "clip.mp4", 60, gop=12)
    frames = Frames(path)
    assert [number_in(frames.image(index)) for index in (0, 1, 40, 13)] == [0, 1, 40, 13]
    assert isinstance(frames._source, _Seeking)


def test_a_closed_recording_is_let_go_without_a_garbage_collection(tmp_path: Path) -> None:
    """Decoded frames are hundreds of megabytes, and so few objects that Python hardly ever collects them."""
    frames = Frames(counted_clip(tmp_path / "closed.mp4", 30, gop=12))
    frames.image(20)
    held = weakref.ref(frames._source)
    gc.disable()
    try:
        frames.close()
        del frames
        assert held() is None
    finally:
        gc.enable()
