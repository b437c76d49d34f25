"""A sheet of the search for marks: frames, colour masks, candidates and why each was rejected."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.files import written_whole
from evaluator.recording import Frame
from evaluator.report.overlay import INK, WARNING, color_of
from evaluator.tracking.detection.explain import Seen, explain
from evaluator.tracking.luma_marks.explain import SeenInLuma, Thing, explain_luma
from evaluator.tracking.settings import TrackingSettings

Image = NDArray[np.uint8]

FRAMES = 4  # shown, spread over the recording
WIDTH = 620  # px of a frame, and of a mask beside it
LINE = 20  # px of a line of text
DARK, CHOSEN = 3, (120, 255, 140)  # factor by which the mask darkens the frame; colour of chosen candidates


def write_search_sheet(recording: Iterable[Frame], table: pd.DataFrame, settings: TrackingSettings, path: Path) -> None:
    """Write a PNG: a row for every mark in some frames, numbered blobs beside the mask of the colour.

    table: of `track`, for the status of the marks in these frames.
    """
    rows = np.unique(np.linspace(0, len(table) - 1, FRAMES + 2).astype(int)[1:-1])
    wanted = {int(table["frame"].iloc[row]): row for row in rows}
    panels = [
        _panel(frame, seen, table, wanted[frame.index])
        for frame in recording
        if frame.index in wanted
        for seen in (*map(_in_words, explain(frame, settings)), *explain_luma(frame, settings))
    ]
    if not panels:
        return
    with written_whole(path) as temporary:
        cv2.imwrite(str(temporary), cv2.cvtColor(np.vstack(panels), cv2.COLOR_RGB2BGR))


def _in_words(seen: Seen) -> SeenInLuma:
    """Candidates by colour, in the form of candidates in luma."""
    low, high = seen.hue_range_deg
    sought = f"sought: hue {low:.0f} to {high:.0f} deg, chroma above {seen.floor:.0f}; right: pixels of this colour"
    things = tuple(
        Thing(
            one.blob.center_px,
            one.blob.radius_px,
            f"hue {one.hue_deg:.0f} deg, chroma {one.blob.chroma:.0f}",
            one.verdict,
            one.chosen,
        )
        for one in seen.blobs
    )
    return SeenInLuma(seen.mark, seen.mask, seen.cell_px, seen.origin_px, sought, things)


def _panel(frame: Frame, seen: SeenInLuma, table: pd.DataFrame, row: int) -> Image:
    image = frame.to_rgb()
    scale = WIDTH / image.shape[1]
    size = WIDTH, round(image.shape[0] * scale)
    shown = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    # Positions of the cells of the mask in the scaled image.
    to_cell = np.array(
        [
            [1 / (scale * seen.cell_px[0]), 0, -seen.origin_px[0] / seen.cell_px[0]],
            [0, 1 / (scale * seen.cell_px[1]), -seen.origin_px[1] / seen.cell_px[1]],
        ]
    )
    flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    mask = cv2.warpAffine(seen.mask.astype(np.uint8), to_cell, size, flags=flags) > 0
    masked = shown // DARK
    masked[mask] = color_of(seen.mark)
    for number, one in enumerate(seen.things, start=1):
        for canvas in (shown, masked):
            _circle(canvas, one, number, scale)
    status = table[f"{seen.mark}_status"].iloc[row]
    title = f"frame {int(table['frame'].iloc[row])}, {table['time_s'].iloc[row]:.3f} s, mark {seen.mark}: {status}"
    lines = [(title, INK), (seen.sought, INK)]
    lines += [
        (_line(number, one), CHOSEN if one.chosen else WARNING) for number, one in enumerate(seen.things, start=1)
    ]
    if not seen.things:
        lines.append(("no candidate in this frame", WARNING))
    text = np.zeros(((len(lines) + 1) * LINE, 2 * WIDTH, 3), np.uint8)
    for k, (line, ink) in enumerate(lines, start=1):
        cv2.putText(text, line, (8, k * LINE), cv2.FONT_HERSHEY_SIMPLEX, 0.45, ink, 1, cv2.LINE_AA)
    return np.vstack([np.hstack([shown, masked]), text])


def _line(number: int, one: Thing) -> str:
    x, y = one.center_px
    return f"{number}: at {x:.0f}, {y:.0f} px, {2 * one.radius_px:.0f} px across, {one.what}: {one.verdict}"


def _circle(canvas: Image, one: Thing, number: int, scale: float) -> None:
    x, y = (round(scale * at) for at in one.center_px)
    radius = max(round(1.5 * scale * one.radius_px), 6)
    color = CHOSEN if one.chosen else WARNING
    cv2.circle(canvas, (x, y), radius, color, 1, cv2.LINE_AA)
    cv2.putText(canvas, str(number), (x + radius, y - radius), cv2.FONT_HERSHEY_SIMPLEX, 0.5, color, 1, cv2.LINE_AA)
