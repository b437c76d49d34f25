"""Clips that carry their frame number as bright and dark squares, so that a frame can be recognised."""

from __future__ import annotations

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
