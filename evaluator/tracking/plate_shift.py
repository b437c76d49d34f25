"""Motion of the plate in the image: of a recording whose camera should stand still.

Image stabilisation, autofocus and a loose tripod move the whole image by a few px. The marks then err by as much, both
together, so that their distance does not show it, but the texture of the plate does. Some frames are compared with the
first, tile by tile: a tile has moved by the shift that, with a change of its brightness, explains it best. Away from
the marks the tiles must agree on one motion, a shift and a change of scale; a plain plate, or one of which something
else moves, says nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.recording import Frame

Array = NDArray[np.float64]
Single = NDArray[np.float32]

SAMPLES = 16  # frames compared, about: each takes as long as a few frames of tracking, 5 ms
ASSUMED_FRAMES = 64  # if the container does not state their number; of more, fewer are compared
WIDTH = 640.0  # px of the compared images: texture of the plate is lost in smaller ones
TILE = 64  # px of a side: enough grains of texture that noise moves a tile by hundredths of a px
# Standard error of a tile's shift, px of the compared image: noise alone gives tiles without texture more than that.
CERTAIN_PX = 0.25
AWAY_TILES = 1.5  # tiles around a mark, which its robot may touch
LEFT = 0.8  # share of the change that a shift by whole px may leave: noise is not explained by any
AWAY_SPACINGS = 2.0  # and distances of the marks, which span much of their robot
# Whatever else moves, a hand or another robot, does not fill seven of nine parts of the image.
PARTS, LEAST_PARTS, LEAST_IN_PART = 3, 7, 2
SAME = 0.3  # share of a tile's detail that must be as it was: that of noise is 0 within hundredths
# Share of the tiles with texture, which the robot may hide in part, that must be near where they were; else a shift by
# whole px is sought, which takes as long again.
MOST_TILES, STILL_PX = 0.8, 0.5
ROUNDS = 4  # a shift by several px is not linear, and is found by steps
AGREE = 0.7  # share of the tiles that must agree on the motion
CLEAR = 5.0  # standard errors of a motion that counts
OVER_STATED = 3.0  # times the stated uncertainty of the marks: beyond its intervals
# Standard error that a codec gives to all tiles together, over that of one: in 13 clips of a still brushed plate (x264)
# it moved the texture by up to 1.9 along the strokes and 0.8 across them, of which CLEAR times this is beyond.
SHARED = 0.5
THRICE = 3  # frames that must show it: a codec damages single ones, as far as 0.17 px in a still clip
LEAST_PX = 0.25  # and it moves the texture of a still plate by up to 0.14 px (the samples, and x264 with CRF 18)


@dataclass(frozen=True)
class PlateShift:
    """Largest motion of the plate in the image since the first frame.

    shift_px: of the middle of its tiles. scale: relative change of its size. of_scale_px: what this moves, RMS of the
    tiles. over_stated: the whole motion over the standard uncertainty of the marks.
    """

    shift_px: float
    scale: float
    of_scale_px: float
    over_stated: float

    @property
    def note(self) -> str:
        """One sentence for people."""
        shown = max(self.shift_px, self.of_scale_px) / 2
        parts = [f"moves by {self.shift_px:.2g} px"] if self.shift_px >= shown else []
        parts += [f"changes in size by {100 * abs(self.scale):.2g} %"] if self.of_scale_px >= shown else []
        return (
            f"the plate {' and '.join(parts)} in the image, {self.over_stated:.0f} times the stated uncertainty of the "
            "marks, so positions and radius may be off by more than their intervals: image stabilisation, autofocus, "
            "or a camera that is not fixed? Switch both off, fix the camera and record again"
        )


class WithPlate:
    """A recording that compares some of its frames with the first while it is read."""

    def __init__(self, recording: Iterable[Frame]) -> None:
        """Wrap a recording; nothing is decoded before the first iteration."""
        self._recording = recording
        self._first: _Reference | None = None
        self._moved: list[tuple[int, Array, Array]] = []

    def __getattr__(self, name: str) -> Any:
        """All other attributes are those of the recording."""
        return getattr(self._recording, name)

    def __iter__(self) -> Iterator[Frame]:
        """Frames of the recording."""
        self._first, self._moved, due = None, [], 0
        step = max(1, (int(getattr(self._recording, "expected_frames", 0)) or ASSUMED_FRAMES) // SAMPLES)
        for frame in self._recording:
            if frame.index >= due and (self._first is None or self._first.comparable(frame)):
                due = frame.index + step
                if self._first is None:
                    self._first = _Reference(frame)
                else:
                    self._moved.append((frame.index, *self._first.shifts(frame)))
                    if len(self._moved) == 4 * SAMPLES:
                        self._moved, step = self._moved[1::2], 2 * step
            yield frame

    def found(self, table: pd.DataFrame, names: Iterable[str]) -> PlateShift | None:
        """Motion of the plate beyond what the marks state, if it is seen; table: of `track`, names: of its marks."""
        if self._first is None:
            return None
        marks = [table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy(float) for name in names]
        sigmas = table[[f"{name}_{axis}_sigma_px" for name in names for axis in "xy"]].to_numpy(float)
        if not np.isfinite(sigmas).any():
            return None
        stated, rows = float(np.nanmedian(sigmas)), table["frame"].to_numpy(int)
        found = []
        for index, shift, sigma in self._moved:
            seen = [mark[[0, min(int(np.searchsorted(rows, index)), len(rows) - 1)]] for mark in marks]
            fit = self._first.motion(shift, sigma, seen)
            if fit is None:
                continue
            moved = float(np.hypot(fit.shift_px, fit.of_scale_px))
            if moved > max(CLEAR * fit.error_px, OVER_STATED * stated, LEAST_PX):
                found.append(PlateShift(fit.shift_px, fit.scale, fit.of_scale_px, moved / stated))
        return max(found, key=lambda one: one.over_stated) if len(found) >= THRICE else None


@dataclass(frozen=True)
class _Motion:
    """Motion of the plate since the first frame; see PlateShift.

    error_px: standard error, from the tiles' scatter and what they share.
    """

    shift_px: float
    scale: float
    of_scale_px: float
    error_px: float


class _Reference:
    """The first frame, prepared for comparison."""

    def __init__(self, frame: Frame) -> None:
        self._kind = frame.size_px, frame.row_origin, frame.row_step
        self._scale = max(frame.size_px[0] / WIDTH, 1.0)
        self._image = self._reduced(frame)
        # Tiles in the compared image, whose height is halved for a field.
        rows, columns = (side // TILE for side in self._image.shape)
        middles = (np.mgrid[:rows, :columns].reshape(2, -1).T[:, ::-1] + 0.5) * TILE - 0.5
        self._px = self._scale * np.array([1.0, frame.row_step])  # of a px of the compared image
        self.middles = (middles + 0.5) * self._px - 0.5
        self._tiles = columns, rows
        self._textured: NDArray[np.bool_] = np.zeros(len(middles), np.bool_)
        if all(self._tiles):
            self._textured = np.asarray(np.isfinite(self._beyond(self._image, np.zeros(2))[1]).all(axis=1))

    def comparable(self, frame: Frame) -> bool:
        """Whether a frame has the same size and, of interlaced recordings, shows the same field."""
        return self._kind == (frame.size_px, frame.row_origin, frame.row_step)

    def _reduced(self, frame: Frame) -> Single:
        """Detail of the luma, without what light and vignetting do."""
        rows, columns = frame.luma.shape
        size = max(round(columns / self._scale), TILE), max(round(rows / self._scale), TILE)
        small = cv2.resize(np.ascontiguousarray(frame.luma), size, interpolation=cv2.INTER_AREA).astype(np.float32)
        return np.asarray(small - cv2.blur(small, (TILE // 2 - 1, TILE // 2 - 1)), np.float32)

    def _over_tiles(self, values: Single) -> Array:
        """Means over the tiles, in the order of their middles."""
        columns, rows = self._tiles
        inside = values[: rows * TILE, : columns * TILE]
        return cv2.resize(inside, self._tiles, interpolation=cv2.INTER_AREA).astype(float).ravel()

    def _moved(self, whole: Array, after: Single) -> Single:
        """The first image, moved by a whole number of px."""
        if not whole.any():
            return self._image
        matrix = np.array([[1.0, 0.0, whole[0]], [0.0, 1.0, whole[1]]])
        return np.asarray(cv2.warpAffine(self._image, matrix, after.shape[::-1]), np.float32)

    def _whole_px(self, after: Single) -> Array:
        """Shift by whole px after which the first image is more like another in most tiles; else none.

        The shift itself may be that of the robot, which has more contrast than the plate.
        """
        whole, rest = np.rint(cv2.phaseCorrelate(self._image, after)[0]), np.zeros(2)
        return whole if whole.any() and self._nearer(after, whole, rest) else rest

    def _nearer(self, after: Single, whole: Array, other: Array) -> bool:
        """Whether one shift by whole px leaves less of the change than another in most tiles."""
        left, lefter = (self._over_tiles((after - self._moved(shift, after)) ** 2) for shift in (whole, other))
        return float(np.median(left - LEFT * lefter)) < 0

    def shifts(self, frame: Frame) -> tuple[Array, Array]:
        """Shift of every tile since the first frame and its standard error, (n, 2) px; NaN without texture."""
        if not all(self._tiles) or not self._spread(self.middles[self._textured]):  # a plain plate says nothing
            return np.full(self.middles.shape, np.nan), np.full(self.middles.shape, np.nan)
        after, whole = self._reduced(frame), np.zeros(2)
        shift, sigma = self._beyond(after, whole)
        if not self._is_near(shift, sigma):
            whole = self._whole_px(after)
            shift, sigma = self._beyond(after, whole)
        for _ in range(ROUNDS):
            certain = (sigma < CERTAIN_PX).all(axis=1)
            further = np.rint(np.median(shift[certain], axis=0)) if certain.any() else np.zeros(2)
            if not further.any() or not self._nearer(after, whole + further, whole):
                break
            whole = whole + further
            shift, sigma = self._beyond(after, whole)
        return (whole + shift) * self._px, sigma * self._px

    def _is_near(self, shift: Array, sigma: Array) -> bool:
        """Whether most tiles with texture are where they were, within a part of a px, as of most recordings."""
        seen = np.isfinite(sigma).all(axis=1)
        still = np.median(np.abs(shift[seen]), axis=0) < STILL_PX if seen.any() else np.zeros(2, bool)
        return bool(seen.sum() >= MOST_TILES * self._textured.sum() and still.all())

    def _beyond(self, after: Single, whole: Array) -> tuple[Array, Array]:
        """Shift of every tile beyond one by whole px and its standard error, (n, 2) px of the compared image."""
        before = self._moved(whole, after)
        # The brightness of a tile may change, so its own pattern is one of the three by which it is explained. The
        # slopes are those of both images' mean, which is exact to the second order of the shift.
        mean = (before + after) / 2
        patterns = [before, -cv2.Sobel(mean, -1, 1, 0, scale=1 / 8), -cv2.Sobel(mean, -1, 0, 1, scale=1 / 8)]
        normal = np.stack([[self._over_tiles(a * b) for a in patterns] for b in patterns]).transpose(2, 0, 1)
        right = np.stack([self._over_tiles(a * (after - before)) for a in patterns], axis=1)
        inverse = np.linalg.pinv(normal, rcond=1e-6, hermitian=True)
        found = np.einsum("nij,nj->ni", inverse, right)
        left = self._over_tiles((after - before) ** 2) - np.einsum("ni,ni->n", found, right)
        # Noise is smoothed by most cameras and codecs: a quarter of the px of a tile count as independent.
        variance = np.maximum(left, 0)[:, None] * inverse[:, [1, 2], [1, 2]] / (TILE**2 / 4)
        sigma = np.sqrt(np.maximum(variance, 0))
        plain = (np.diagonal(inverse, axis1=1, axis2=2)[:, 1:] <= 0).any(axis=1)
        # Of noise, or where something else lies now, nothing is as it was: the pattern explains its own absence.
        sigma[plain | (1 + found[:, 0] < SAME)] = np.nan
        return found[:, 1:], sigma

    def motion(self, shift: Array, sigma: Array, marks: Iterable[Array]) -> _Motion | None:
        """The motion on which the tiles away from the marks agree.

        marks: of each mark the places (2, 2) in the first frame and now. None if the tiles are few or do not agree.
        """
        used = (sigma < CERTAIN_PX * self._px).all(axis=1)
        for places in np.swapaxes(np.array(list(marks)), 0, 1):  # in the first frame, and now
            spacing = max(float(np.hypot(*(one - other))) for one in places for other in places)
            far = max(AWAY_TILES * TILE * self._scale, AWAY_SPACINGS * spacing if np.isfinite(spacing) else 0.0)
            for place in places[np.isfinite(places).all(axis=1)]:
                used &= np.hypot(*(self.middles - place).T) > far
        at, by = self.middles[used], shift[used]
        if not self._spread(at):
            return None
        about, rough = at - at.mean(axis=0), np.median(by, axis=0)
        # Tiles agree if a shift with a change of scale describes them as well as their errors allow.
        scale, apart, kept = 0.0, np.zeros(len(at)), np.ones(len(at), bool)
        for _ in range(5):
            rough = by[kept].mean(axis=0)
            centered = about[kept] - about[kept].mean(axis=0)
            scale = float((centered * (by[kept] - rough)).sum() / (centered**2).sum())
            apart = np.hypot(*(by - rough - scale * (about - about[kept].mean(axis=0))).T)
            kept = apart < 3.0 * max(1.4826 * float(np.median(apart)), 1e-6)
        if kept.mean() < AGREE or not self._spread(at[kept]):
            return None
        scatter = float(np.sqrt((apart[kept] ** 2).mean() / kept.sum()))
        wide = float(np.sqrt((about[kept] ** 2).sum(axis=1).mean()))
        moved, of_scale = float(np.hypot(*rough)), abs(scale) * wide
        along = rough / max(float(np.hypot(moved, of_scale)), 1e-9)
        shared = SHARED * float(np.hypot(*(along * np.median(sigma[used][kept], axis=0))))
        return _Motion(moved, scale, of_scale, float(np.hypot(scatter, shared)))

    def _spread(self, at: Array) -> bool:
        """Whether there are tiles in most parts of the image."""
        part = np.floor(PARTS * (at + 0.5) / self._kind[0]).astype(int) @ [PARTS, 1]
        return int((np.bincount(part, minlength=PARTS**2) >= LEAST_IN_PART).sum()) >= LEAST_PARTS
