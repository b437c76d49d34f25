"""A recording as one image: each point as it was when it was most colourful, so that the marks draw their paths."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from evaluator.recording.frame import Frame

# Of the frames, 1 in 6: a mark of 1 mm then overlaps with itself up to 10 mm/s at 60 frames/s. Another frame is taken
# where it is more colourful by so many levels of 8 bits; compression changes the colour of a grey plate by a few.
EVERY, MORE_COLOURFUL = 6, 40


def long_exposure(frames: Iterable[Frame]) -> NDArray[np.uint8]:
    """RGB image (height, width, 3) of a recording with at least one frame."""
    image, most = np.zeros((0, 0, 3), np.uint8), np.zeros((0, 0), np.int16)
    for frame in islice(frames, 0, None, EVERY):
        rgb = frame.to_rgb()
        colour = rgb.max(axis=2).astype(np.int16) - rgb.min(axis=2)
        if not image.size:
            image, most = rgb, colour
            continue
        more = colour > most + MORE_COLOURFUL
        image[more], most[more] = rgb[more], colour[more]
    return image
