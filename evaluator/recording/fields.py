"""Interlaced recordings: each field is a picture of its own, at its own time, on every second line.

The cameras of the CCD age expose the odd and the even lines half a frame apart. Weaving them into one picture tears
everything that moves; taken apart, they are pictures at twice the rate. Which field comes first is seen from the
pictures: a field resembles the one that is next to it in time more than the one that is farther away.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Literal

import numpy as np

from evaluator.recording.frame import Frame

Fields = Literal["auto", "none", "top", "bottom"]

MOVED = 12.0  # levels of 8 bits by which a pixel changes when an edge moves over it; twice the noise of dim recordings
ENOUGH = 400  # moved pixels from which the verdict is taken
# Lines of the other field fit worse than lines of the same field twice as far away: by 1.0 or less on progressive
# pictures, by 2 and more where fields differ by a quarter of a pixel at a mark's edge.
TORN = 1.4


def fields_of(frame: Frame, first: str, half_ticks: int, index: int) -> Iterator[Frame]:
    """Split a picture into its two fields in the order of time.

    first: "top" or "bottom". half_ticks: half the time between pictures, in the halved ticks that fields count in.
    index: of the first field.
    """
    order = (0, 1) if first == "top" else (1, 0)
    for place, parity in enumerate(order):
        yield replace(
            frame,
            index=index + place,
            ticks=2 * frame.ticks + place * half_ticks,
            tick=frame.tick / 2,
            luma=frame.luma[parity::2],
            u=None if frame.u is None else frame.u[parity::2],
            v=None if frame.v is None else frame.v[parity::2],
            row_origin=parity,
            row_step=2,
        )


def field_order(frames: Iterable[Frame]) -> Literal["none", "top", "bottom"] | None:
    """See from the pictures whether they are woven of two fields, and which comes first; None where nothing moves."""
    torn = smooth = 0.0
    top_first = bottom_first = 0.0
    moved_pixels = 0
    before: np.ndarray | None = None
    for frame in frames:
        luma = frame.luma.astype(np.float32) * np.float32(2.0 ** (8 - frame.depth))
        luma = luma[: luma.shape[0] // 2 * 2]
        if before is not None and before.shape == luma.shape:
            moved = np.abs(luma - before)[2:-2] > MOVED
            # An edge moves a few of its neighbours too; noise moves single pixels.
            moved[:, 1:] &= moved[:, :-1]
            moved_pixels += int(moved.sum())
            torn += float(np.sum((luma[1:-3] + luma[3:-1] - 2 * luma[2:-2])[moved] ** 2))
            smooth += float(np.sum((luma[:-4] + luma[4:] - 2 * luma[2:-2])[moved] ** 2))
            pairs = moved[0::2] | moved[1::2]
            now_top, now_bottom = luma[2:-2:2], luma[3:-2:2]
            old_top, old_bottom = before[2:-2:2], before[3:-2:2]
            rows = min(len(now_bottom), len(pairs))
            top_first += float(np.sum((now_top[:rows] - old_bottom[:rows])[pairs[:rows]] ** 2))
            bottom_first += float(np.sum((now_bottom[:rows] - old_top[:rows])[pairs[:rows]] ** 2))
        before = luma
        if moved_pixels > 10 * ENOUGH:
            break
    if moved_pixels < ENOUGH:
        return None
    if torn < TORN * smooth:
        return "none"
    return "top" if top_first < bottom_first else "bottom"
