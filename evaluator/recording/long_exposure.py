"""A recording as one image: each point as it was when it was most colourful, so that the marks draw their paths."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from evaluator.recording.frame import Frame, Plane

# Of the frames, 1 in 12: a mark of 1 mm then overlaps with itself up to 5 mm/s at 60 frames/s. Another frame is taken
# where it is more colourful by this share of the range; compression changes the colour of a grey plate by less.
EVERY, MORE_COLOURFUL = 12, 0.08


def long_exposure(frames: Iterable[Frame]) -> NDArray[np.uint8]:
    """RGB image (height, width, 3) of a recording with at least one frame; of a grey one, its first frame."""
    frames = islice(frames, 0, None, EVERY)
    first = next(frames)
    if first.u is None or first.v is None:
        return first.to_rgb()
    shown = replace(first, luma=first.luma.copy(), u=first.u.copy(), v=first.v.copy())
    assert shown.u is not None
    assert shown.v is not None
    most = _colourfulness(first.u, first.v, first.depth)
    more_by = int(MORE_COLOURFUL * 2**first.depth)
    for frame in frames:
        assert frame.u is not None
        assert frame.v is not None
        colour = _colourfulness(frame.u, frame.v, frame.depth)
        more = colour > most + more_by
        if not more.any():
            continue
        shown.u[more], shown.v[more], most[more] = frame.u[more], frame.v[more], colour[more]
        of_luma = first.upsampled(more)
        shown.luma[of_luma] = frame.luma[of_luma]
    return shown.to_rgb()


def _colourfulness(u: Plane, v: Plane, depth: int) -> NDArray[np.int32]:
    """Distance from grey by pixel of the colour planes, in their levels."""
    grey = 1 << (depth - 1)
    return np.asarray(np.abs(u.astype(np.int32) - grey) + np.abs(v.astype(np.int32) - grey))
