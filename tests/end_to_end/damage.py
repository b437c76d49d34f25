"""Eleven ways in which recordings arrive damaged, and the words a user needs to hear."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import av
import numpy as np

INDEX_FIRST = "mp4, index first"
Damage = Callable[[Path, Path], None]


def first_images(source: Path, target: Path, count: int | None = None, kind: str = "mp4") -> None:
    """Copy a recording, or its first images, without encoding it anew; an mp4 has its index at the end."""
    options = {"movflags": "faststart"} if kind == INDEX_FIRST else {}
    name = "mp4" if kind == INDEX_FIRST else kind
    with av.open(str(source)) as video, av.open(str(target), "w", format=name, options=options) as copy:
        stream = video.streams.video[0]
        same = copy.add_stream_from_template(stream)
        for number, packet in enumerate(video.demux(stream)):
            if packet.dts is None or number == count:
                break
            packet.stream = same
            copy.mux(packet)


def cut_in_the_middle(good: Path, target: Path) -> None:
    """The file stops half way; its index stands at the front, so it opens."""
    first_images(good, target, kind=INDEX_FIRST)
    content = target.read_bytes()
    target.write_bytes(content[: len(content) // 2])


def cut_matroska(good: Path, target: Path) -> None:
    """A Matroska file stops half way: it needs no index, only its length tells."""
    first_images(good, target, kind="matroska")
    content = target.read_bytes()
    target.write_bytes(content[: len(content) // 2])


def cut_before_its_index(good: Path, target: Path) -> None:
    """The file stops half way, and its index stood at the end."""
    content = good.read_bytes()
    target.write_bytes(content[: len(content) // 2])


def without_robot(good: Path, target: Path) -> None:
    """The plate, and no robot on it."""
    del good
    _write_video(target, _plates(24), "yuv420p")


def grey(good: Path, target: Path) -> None:
    """Recorded without colour."""
    del good
    _write_video(target, _plates(24), "gray")


def one_image(good: Path, target: Path) -> None:
    """A still instead of a recording."""
    del good
    _write_video(target, _plates(1), "yuv420p")


def sound_only(good: Path, target: Path) -> None:
    """The microphone was on, the camera was not."""
    del good
    with av.open(str(target), "w") as file:
        stream = file.add_stream("aac", rate=48000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 2048), np.float32), format="fltp", layout="mono")
        frame.sample_rate = 48000
        for packet in (*stream.encode(frame), *stream.encode()):
            file.mux(packet)


def text(good: Path, target: Path) -> None:
    """Something else under the name of a video."""
    del good
    target.write_text("Dear colleague, the recordings are on the other disk.\n" * 40, encoding="utf-8")


def overwritten(good: Path, target: Path) -> None:
    """The right size, and zeros inside."""
    target.write_bytes(bytes(good.stat().st_size))


DAMAGES: dict[str, tuple[Damage, str]] = {
    "missing": (lambda _, __: None, "no such file"),
    "empty": (lambda _, target: target.touch(), "empty"),
    "folder": (lambda _, target: target.mkdir(), "folder of images has no time stamps"),
    "text": (text, "not a video"),
    "overwritten": (overwritten, "not a video"),
    "cut": (cut_in_the_middle, "cut off after"),
    "cut-matroska": (cut_matroska, "the file announces 1.48 s"),
    "cut-index": (cut_before_its_index, "not a video that FFmpeg can open"),
    "sound": (sound_only, "holds no video"),
    "grey": (grey, "mark is in none of 24 frames"),
    "no-robot": (without_robot, "mark is in none of 24 frames"),
}


def _plates(count: int) -> list[np.ndarray]:
    random = np.random.default_rng(3)
    return [random.normal(90, 3, (480, 640)).clip(0, 255).astype(np.uint8) for _ in range(count)]


def _write_video(target: Path, images: list[np.ndarray], pixels: str) -> None:
    with av.open(str(target), "w") as video:
        stream = video.add_stream("libx264", rate=60)
        stream.width, stream.height, stream.pix_fmt = 640, 480, pixels
        for image in images:
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, format="gray")):
                video.mux(packet)
        for packet in stream.encode():
            video.mux(packet)
