"""Interlaced recordings: each field is a frame of its own, at its own time, on every second line.

The cameras of the CCD age expose the odd and the even lines half a frame apart. Weaving them into one frame tears
everything that moves; taken apart, they are frames at twice the rate. Which field comes first is seen from the
frames: a field resembles the one that is next to it in time more than the one that is farther away.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.recording.frame import Frame, Plane

Fields = Literal["auto", "none", "top", "bottom"]

MOVED = 12  # levels of 8 bits by which a pixel changes when an edge moves over it; twice the noise of dim recordings
ENOUGH = 400  # moved pixels from which the verdict is taken
# Lines of the other field fit worse than lines of the same field twice as far away: by 1.0 or less on progressive
# frames, by 2 and more where fields differ by a quarter of a pixel at a mark's edge.
TORN = 1.4


def fields_of(frame: Frame, first: str, half_ticks: int, index: int) -> Iterator[Frame]:
    """Split a frame into its two fields in the order of time.

    first: "top" or "bottom". half_ticks: half the time between frames, in the halved ticks that fields count in.
    index: of the first field.
    """
    order = (0, 1) if first == "top" else (1, 0)
    for place, parity in enumerate(order):
        yield replace(
            frame,
            index=index + place,
            ticks=2 * frame.ticks + place * half_ticks,
            tick=frame.tick / 2,
            luma=np.ascontiguousarray(frame.luma[parity::2]),
            u=None if frame.u is None else np.ascontiguousarray(frame.u[parity::2]),
            v=None if frame.v is None else np.ascontiguousarray(frame.v[parity::2]),
            row_origin=parity,
            row_step=2,
        )


def field_order(frames: Iterable[Frame]) -> Literal["none", "top", "bottom"] | None:
    """See from the frames whether they are woven of two fields, and which comes first; None where nothing moves."""
    torn = smooth = 0.0
    top_first = bottom_first = 0.0
    moved_pixels = 0
    before: Plane | None = None
    for frame in frames:
        luma = np.ascontiguousarray(frame.luma[: frame.luma.shape[0] // 2 * 2])
        if before is not None and before.shape == luma.shape and len(luma) > 4:
            moved = cv2.absdiff(luma, before)[2:-2] > luma.dtype.type(MOVED * 2 ** (frame.depth - 8))
            # An edge moves a few of its neighbours too; noise moves single pixels.
            moved[:, 1:] &= moved[:, :-1]
            rows, columns = _places(moved)
            moved_pixels += len(rows)
            lines = luma[rows + np.arange(5)[:, None], columns].astype(float)  # a pixel's own, and two on either side
            torn += float(np.sum((lines[1] + lines[3] - 2 * lines[2]) ** 2))
            smooth += float(np.sum((lines[0] + lines[4] - 2 * lines[2]) ** 2))
            pairs, columns = _places(moved[0::2] | moved[1::2])
            top, bottom = (2 + 2 * pairs, columns), (3 + 2 * pairs, columns)
            top_first += float(np.sum((luma[top].astype(float) - before[bottom]) ** 2))
            bottom_first += float(np.sum((luma[bottom].astype(float) - before[top]) ** 2))
        before = luma
        if moved_pixels > 10 * ENOUGH:
            break
    if moved_pixels < ENOUGH:
        return None
    if torn <= TORN * smooth:  # equal where whole frames change their brightness: both are nothing
        return "none"
    return "top" if top_first < bottom_first else "bottom"


def _places(mask: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of what is marked, as `np.nonzero` gives them, in a fifth of its time."""
    rows, columns = np.divmod(np.flatnonzero(mask), mask.shape[1])
    return rows, columns
