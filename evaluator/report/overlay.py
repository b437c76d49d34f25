"""Overlay video of the measurement, and a contact sheet of frames with doubtful marks.

Everything is drawn in image px at sub-pixel precision. Nothing is measured here.
"""

from __future__ import annotations

import colorsys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.files import written_whole
from evaluator.progress import Progress, no_progress
from evaluator.recording import Frame
from evaluator.tracking.settings import HUE_RANGES, hue_word

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Color = tuple[int, int, int]

OTHER = (120, 200, 255)  # of a mark without a colour in its name
CENTER, CIRCLE, INK, WARNING = (255, 90, 160), (255, 255, 255), (255, 255, 255), (255, 120, 70)
TRAIL_FRAMES = 240  # four seconds of most recordings: longer trails hide the plate
SHIFT = 4  # OpenCV draws to 1/16 px


@dataclass(frozen=True)
class Drawing:
    """Overlays other than the marks, in px; rows are those of the table of marks.

    center_px, nose_px, left_px: (n, 2), the robot's centre, a point ahead of it and one to its left: the axes of the
    body. circle_px: (m, 2), the turning circle. axes_px: (3, 2), origin of the drawn axes of the plate and the tips of
    x and y.
    """

    center_px: Array = field(default_factory=lambda: np.empty((0, 2)))
    nose_px: Array = field(default_factory=lambda: np.empty((0, 2)))
    left_px: Array = field(default_factory=lambda: np.empty((0, 2)))
    circle_px: Array = field(default_factory=lambda: np.empty((0, 2)))
    axes_px: Array = field(default_factory=lambda: np.empty((0, 2)))
    caption: str = ""


def mark_names(table: pd.DataFrame) -> list[str]:
    """Marks in a table of `track` or `place_on_plate`."""
    return [column.removesuffix("_x_px") for column in map(str, table) if column.endswith("_x_px")]


def color_of(name: str) -> Color:
    """RGB of a mark by the colour in its name."""
    hues = HUE_RANGES.get(hue_word(name))
    if hues is None:
        return OTHER
    red, green, blue = colorsys.hsv_to_rgb(sum(hues) / 720 % 1, 0.7, 1.0)
    return round(255 * red), round(255 * green), round(255 * blue)


def write_overlay(
    recording: Iterable[Frame],
    table: pd.DataFrame,
    path: Path,
    drawing: Drawing | None = None,
    progress: Progress = no_progress,
) -> None:
    """Write the recording as H.264 video with marks, trails, centre, heading, circle and time drawn on it.

    table: of `track`, a row per frame of the recording. The frames keep their presentation times.
    """
    drawing = drawing or Drawing()
    with written_whole(path) as temporary, av.open(str(temporary), "w") as container:
        stream: Any = None
        for row, frame in enumerate(recording):
            image = draw_frame(frame, table, row, drawing)
            if stream is None:
                stream = container.add_stream("libx264", rate=60, options={"crf": "20", "preset": "veryfast"})
                # H.264 in 4:2:0 needs even sizes: an odd last line or column is left out.
                stream.width, stream.height = image.shape[1] // 2 * 2, image.shape[0] // 2 * 2
                stream.pix_fmt = "yuv420p"
                stream.codec_context.time_base = _short(frame.tick)
            shown = av.VideoFrame.from_ndarray(
                np.ascontiguousarray(image[: stream.height, : stream.width]), format="rgb24"
            )
            shown.time_base = stream.codec_context.time_base
            shown.pts = round(frame.time / shown.time_base)
            container.mux(stream.encode(shown))
            progress("drawing", row + 1, len(table))
        if stream is not None:
            container.mux(stream.encode())


def _short(tick: Fraction) -> Fraction:
    """A clock that encoders accept: that of the recording unless its numbers are too large."""
    return tick if tick.denominator <= 1_000_000 else Fraction(1, 90_000)


def draw_frame(frame: Frame, table: pd.DataFrame, row: int, drawing: Drawing) -> Image:
    """One frame of the overlay, RGB."""
    image = np.ascontiguousarray(frame.to_rgb())
    size = max(image.shape[0] / 480, 0.6)
    thick = max(1, round(size))
    if len(drawing.circle_px):
        _line(image, drawing.circle_px, CIRCLE, thick, closed=True)
    for name in mark_names(table):
        points = table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy(float)
        _trail(image, points[max(0, row - TRAIL_FRAMES) : row + 1], color_of(name), thick)
        _cross(image, points[row], color_of(name), 6 * size, thick)
    if len(drawing.center_px):
        _trail(image, drawing.center_px[max(0, row - TRAIL_FRAMES) : row + 1], CENTER, thick)
        if np.isfinite([drawing.center_px[row], drawing.nose_px[row]]).all():
            _arrow(image, drawing.center_px[row], drawing.nose_px[row], CENTER, thick + 1)
            if len(drawing.left_px):
                _arrow(image, drawing.center_px[row], drawing.left_px[row], CENTER, thick)
    for name, tip in zip("xy", drawing.axes_px[1:], strict=False):
        _arrow(image, drawing.axes_px[0], tip, INK, thick)
        beyond = tip + 12 * size * (tip - drawing.axes_px[0]) / np.hypot(*(tip - drawing.axes_px[0]))
        _write(image, name, (round(beyond[0] - 5 * size), round(beyond[1] + 5 * size)), size, INK)
    lines = [f"{table['time_s'].iloc[row]:8.3f} s   frame {int(table['frame'].iloc[row])}   {drawing.caption}".rstrip()]
    lines += [
        f"{name}: {status}"
        for name in mark_names(table)
        if (status := str(table[f"{name}_status"].iloc[row])) not in {"ok", "corrected"}
    ]
    for k, text in enumerate(lines):
        _write(image, text, (round(8 * size), round((20 + 22 * k) * size)), size, INK if k == 0 else WARNING)
    return image


def write_contact_sheet(recording: Iterable[Frame], table: pd.DataFrame, path: Path, most: int = 24) -> int:
    """Write a PNG of enlarged cut-outs of the most doubtful frames; return the number of cut-outs (0: no file).

    Doubtful: a mark is absent, or its uncertainty is unusually large. Of neighbouring frames only one is shown.
    """
    chosen = doubtful(table, most)
    if not chosen:
        return 0
    tiles = [_tile(frame, table, name) for frame, name in _wanted(recording, table, chosen)]
    columns = min(6, len(tiles))
    blank = np.zeros_like(tiles[0])
    rows = [
        np.hstack([*tiles[k : k + columns], *[blank] * (columns - len(tiles[k : k + columns]))])
        for k in range(0, len(tiles), columns)
    ]
    sheet = cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR)
    with written_whole(path) as temporary:
        cv2.imwrite(str(temporary), sheet)
    return len(tiles)


def doubtful(table: pd.DataFrame, most: int) -> list[tuple[int, str]]:
    """Rows and marks to inspect, the most doubtful of each interval of frames, in order of time."""
    found: list[tuple[float, int, str]] = []
    for name in mark_names(table):
        sigma = _sigma(table, name)
        usual = np.nanmedian(sigma) if np.isfinite(sigma).any() else 1.0
        doubt = np.where(np.isfinite(sigma), sigma / usual, 100.0)
        rows = np.flatnonzero(doubt > 2.5)
        for stretch in np.split(rows, np.flatnonzero(np.diff(rows) > 3) + 1):
            if len(stretch):
                worst = int(stretch[np.argmax(doubt[stretch])])
                found.append((float(doubt[worst]) * len(stretch) ** 0.5, worst, name))
    return sorted((row, name) for _, row, name in sorted(found, reverse=True)[:most])


def _sigma(table: pd.DataFrame, name: str) -> Array:
    """Uncertainty of a mark in each frame, both axes together, px; NaN if it is absent."""
    return np.asarray(np.hypot(*table[[f"{name}_x_sigma_px", f"{name}_y_sigma_px"]].to_numpy(float).T))


def why_doubtful(table: pd.DataFrame, name: str, row: int) -> str:
    """The reason why a frame is doubtful: why the mark is absent, or its uncertainty."""
    sigma = _sigma(table, name)
    if not np.isfinite(sigma[row]):
        return str(table[f"{name}_status"].iloc[row])
    return f"sigma {sigma[row]:.2g} px, usually {np.nanmedian(sigma):.2g}"


def _wanted(
    recording: Iterable[Frame], table: pd.DataFrame, chosen: list[tuple[int, str]]
) -> Iterator[tuple[Frame, str]]:
    names: dict[int, list[str]] = {}
    for row, name in chosen:
        names.setdefault(int(table["frame"].iloc[row]), []).append(name)
    for frame in recording:
        for name in names.get(frame.index, []):
            yield frame, name


def _tile(frame: Frame, table: pd.DataFrame, name: str) -> Image:
    """A cut-out of 48 px around the position of a mark, the nearest in time if absent, enlarged to 240 px."""
    row = int(np.flatnonzero(table["frame"].to_numpy() == frame.index)[0])
    points = table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy(float)
    seen = np.flatnonzero(np.isfinite(points).all(axis=1))
    image, side, zoom = frame.to_rgb(), 48, 5
    height, width = image.shape[:2]
    place = points[seen[np.argmin(np.abs(seen - row))]] if len(seen) else np.array([width / 2, height / 2])
    matrix = np.array([[1 / zoom, 0, place[0] - side / 2], [0, 1 / zoom, place[1] - side / 2]])
    tile: Image = cv2.warpAffine(
        image, matrix, (side * zoom, side * zoom), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
    ).astype(np.uint8)
    if np.isfinite(points[row]).all():
        _cross(tile, np.full(2, side * zoom / 2), color_of(name), 14, 1)
    _write(tile, f"frame {frame.index}: {table['time_s'].iloc[row]:.3f} s", (6, 16), 0.9, INK)
    _write(tile, f"{name}:", (6, side * zoom - 27), 0.9, WARNING)
    _write(tile, why_doubtful(table, name, row), (6, side * zoom - 8), 0.9, WARNING)
    tile[:, -1], tile[-1] = 60, 60
    return tile


def _trail(image: Image, points: Array, color: Color, thick: int) -> None:
    absent = np.flatnonzero(~np.isfinite(points).all(axis=1))
    for part in np.split(points, absent):
        _line(image, part[np.isfinite(part).all(axis=1)], color, thick)


def _line(image: Image, points: Array, color: Color, thick: int, *, closed: bool = False) -> None:
    if len(points) > 1:
        fixed = np.rint(points * 2**SHIFT).astype(np.int32)
        cv2.polylines(image, [fixed], closed, color, thick, cv2.LINE_AA, SHIFT)


def _arrow(image: Image, start: Array, tip: Array, color: Color, thick: int) -> None:
    cv2.arrowedLine(image, _fixed(start), _fixed(tip), color, thick, cv2.LINE_AA, SHIFT, 0.25)


def _cross(image: Image, point: Array, color: Color, arm: float, thick: int) -> None:
    if np.isfinite(point).all():
        for dx, dy in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
            way = np.array([dx, dy])
            _line(image, np.stack([point + arm * way, point + 2.2 * arm * way]), color, thick)


def _fixed(point: Array) -> tuple[int, int]:
    return round(float(point[0]) * 2**SHIFT), round(float(point[1]) * 2**SHIFT)


def _write(image: Image, text: str, place: tuple[int, int], size: float, color: Color) -> None:
    """Text on a darkened strip, readable on any frame."""
    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45 * size, 1)
    left, bottom = place
    strip = image[max(bottom - height - 3, 0) : bottom + below + 2, max(left - 4, 0) : left + width + 4]
    strip[:] = strip // 3
    cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45 * size, color, 1, cv2.LINE_AA)
