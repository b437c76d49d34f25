"""A recording that stands in for a live camera."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np


def camera_file(path: Path, images: list[np.ndarray], rate: int = 5) -> Path:
    """A recording without loss that stands in for a camera."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=rate)
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "gray"
        for number, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="gray")
            frame.pts, frame.time_base = number, Fraction(1, rate)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path
