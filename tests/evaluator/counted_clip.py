"""Clips that carry their frame number as bright and dark squares, so that a frame can be recognised."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

BITS, CELL = 12, 24
WIDTH, HEIGHT = BITS * CELL, 96


def counted_clip(
    path: Path, frames: int, *, gop: int, b_frames: int = 0, codec: str = "libx264", step: int = 1
) -> Path:
    """Write a clip whose frames show their number in BITS squares; step: ticks between frames vary from 1 to step."""
    grey = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    images = (numbered(grey, number, HEIGHT, (90, 220)) for number in range(frames))
    coding = {"crf": "18", "preset": "ultrafast"}
    return encoded(path, images, np.random.default_rng(0), gop, b_frames, step, coding, codec)


def numbered(image: np.ndarray, number: int, height: int, values: tuple[int, int]) -> np.ndarray:
    """A copy of an image with a number in its upper part, as squares that are dark or bright."""
    image, cell = image.copy(), image.shape[1] // BITS
    for bit in range(BITS):
        image[:height, bit * cell : (bit + 1) * cell] = values[number >> bit & 1]
    return image


def encoded(
    path: Path,
    images: Iterable[np.ndarray],
    rng: np.random.Generator,
    gop: int,
    b_frames: int,
    step: int,
    coding: dict[str, str],
    codec: str = "libx264",
) -> Path:
    """Write images (height, width, 3) as a clip of 60 frames/s; step: ticks between frames vary from 1 to step."""
    ticks = 0
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=60)
        stream.codec_context.time_base = Fraction(1, 60 * step)
        stream.pix_fmt, stream.gop_size = "yuv420p", gop
        parameters = f"keyint={gop}:min-keyint={gop}:scenecut=0:bframes={b_frames}"
        stream.options = {**coding, "bf": str(b_frames), "x264-params": parameters}
        for image in images:
            if not ticks:
                stream.height, stream.width = image.shape[:2]
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = ticks, Fraction(1, 60 * step)
            ticks += int(rng.integers(1, step + 1))
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def number_in(image: np.ndarray, height: int = HEIGHT, middle: float = 155.0) -> int:
    """The number that an image shows; middle: between the values of dark and bright squares."""
    cells = image[:height, : image.shape[1] // BITS * BITS].mean(axis=(0, 2)).reshape(BITS, -1).mean(axis=1)
    return sum(1 << bit for bit, value in enumerate(cells) if value > middle)
