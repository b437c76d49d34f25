"""Frames by number are the frames that iterating gives: clips carry their frame number as bright and dark squares."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from evaluator.errors import InputError
from evaluator.recording import open_recording
from evaluator.recording.seek import Frames

BITS, CELL = 12, 24
WIDTH, HEIGHT = BITS * CELL, 96


def counted_clip(
    path: Path, frames: int, *, gop: int, b_frames: int = 0, codec: str = "libx264", step: int = 1
) -> Path:
    """Write a clip whose frames show their number in BITS squares; step: ticks between frames vary from 1 to step."""
    rng = np.random.default_rng(0)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=60)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 60 * step)
        stream.gop_size = gop
        stream.options = {
            "crf": "18",
            "preset": "ultrafast",
            "bf": str(b_frames),
            "x264-params": f"keyint={gop}:min-keyint={gop}:scenecut=0:bframes={b_frames}",
        }
        ticks = 0
        for number in range(frames):
            image = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
            for bit in range(BITS):
                if number >> bit & 1:
                    image[:, bit * CELL : (bit + 1) * CELL] = 220
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = ticks, Fraction(1, 60 * step)
            ticks += int(rng.integers(1, step + 1))
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def number_in(image: np.ndarray) -> int:
    cells = image.mean(axis=(0, 2)).reshape(BITS, CELL).mean(axis=1)
    return sum(1 << bit for bit, value in enumerate(cells) if value > 155)


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


def test_times_and_numbers_are_those_of_iterating(tmp_path: Path) -> None:
    path = counted_clip(tmp_path / "v.mp4", 90, gop=12, b_frames=2, step=4)
    recording = open_recording(path)
    seen = [(frame.time_s, number_in(frame.to_rgb())) for frame in recording]
    frames = Frames(path)
    assert list(frames.contents.time_s) == [time for time, _ in seen]
    assert [number_in(frames.image(index)) for index in range(90)] == [number for _, number in seen]


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
