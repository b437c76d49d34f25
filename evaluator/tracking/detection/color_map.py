"""A frame's colours, balanced, at the resolution of its colour planes.

White balance: the most common colour of the frame (plate, field) is taken as neutral, so that hues do not depend on the
lamp; a balance of 0 keeps that of the camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.recording.frame import Plane
from evaluator.robust import robust_sigma
from evaluator.tracking.detection import color_kernels
from evaluator.tracking.settings import Box, MarkSettings, TrackingSettings

Array = NDArray[np.float64]
SAMPLE = 1 << 14  # cells used for medians, which are then known to 1 % of their spread
# Largest minimum chroma that the colours of a scene may cause: stickers have 70 and more in good light. Without this
# limit, a scene that is coloured everywhere (wood, skin, a carpet) would exclude them.
STICKER = 56.0


@dataclass(frozen=True)
class ColorMap:
    """A frame's colours at the resolution of its colour planes.

    chroma: (rows, columns), largest minus smallest of the balanced R, G, B, levels of 8 bits. floor: chroma of the
    frame's noise and tints. colorful: (m,), flat indices of the cells above it; hue_deg: (m,), their HSV hue relative
    to the neutral. u, v: the planes, in levels of their bit depth. motley: whether the frame has so many colours that
    their median does not show the tint of the lamp.
    """

    chroma: NDArray[np.float32]
    floor: float
    colorful: NDArray[np.intp]
    hue_deg: NDArray[np.float32]
    u: Plane
    v: Plane
    cell_px: tuple[float, float]
    origin_px: tuple[float, float]
    motley: bool


def cell_of(frame: Frame) -> tuple[int, int]:
    """Luma samples across and down that one chroma sample covers."""
    assert frame.u is not None
    return -(-frame.luma.shape[1] // frame.u.shape[1]), -(-frame.luma.shape[0] // frame.u.shape[0])


def color_map(frame: Frame, allowed: NDArray[np.bool_], balance: float = 1.0, share_of_floor: float = 1.0) -> ColorMap:
    """Balance a frame's colours.

    allowed: (rows, columns) of the colour planes, where to look. balance: share of the plate's tint that is due to the
    lamp. share_of_floor: of the floor, from which cells count as colourful.
    """
    assert frame.u is not None
    assert frame.v is not None
    rows, columns = frame.u.shape
    across, down = cell_of(frame)
    luma: Plane = np.asarray(
        cv2.resize(np.ascontiguousarray(frame.luma), (columns, rows), interpolation=cv2.INTER_AREA), frame.luma.dtype
    )
    to_rgb = frame.rgb_from_planes
    sample = sampled(allowed)
    middle = np.maximum(np.median(_rgb(to_rgb, luma[sample], frame.u[sample], frame.v[sample]), axis=1), 1.0)
    # Lamps from candle to blue sky stay within a factor of two between channels.
    to_rgb *= (np.clip(middle.mean() / middle, 0.6, 1.7) ** balance)[:, None]
    chroma = np.empty((rows, columns), np.float32)
    color_kernels.chroma_plane(luma, frame.u, frame.v, to_rgb.astype(np.float32), chroma)
    typical = chroma[sample]
    spread = robust_sigma(typical)
    tints = float(np.median(typical)) + 6 * spread
    floor = max(min(tints, STICKER), 14.0)
    colorful = np.flatnonzero(chroma > share_of_floor * floor)
    cells = np.unravel_index(colorful, chroma.shape)
    hue = _hue(_rgb(to_rgb, luma[cells], frame.u[cells], frame.v[cells]))
    cell = float(across), float(down * frame.row_step)
    origin = (across - 1) / 2, frame.row_origin + (down - 1) / 2 * frame.row_step
    return ColorMap(chroma, floor, colorful, hue, frame.u, frame.v, cell, origin, tints > STICKER)


def _rgb(to_rgb: Array, luma: Plane, u: Plane, v: Plane) -> NDArray[np.float32]:
    """(3, m): R, G, B of m cells."""
    return np.asarray(to_rgb[:, :3] @ np.stack([luma, u, v]) + to_rgb[:, 3:], np.float32)


def neutral_of(frame: Frame, allowed: NDArray[np.bool_], balance: float = 1.0) -> tuple[float, float]:
    """(u, v) that is grey for a balance of `color_map`, in levels of the planes' bit depth."""
    assert frame.u is not None
    assert frame.v is not None
    sample, grey = sampled(allowed), 128.0 * 2.0 ** (frame.depth - 8)
    u, v = (grey + balance * (float(np.median(plane[sample])) - grey) for plane in (frame.u, frame.v))
    return u, v


def sampled(allowed: NDArray[np.bool_]) -> tuple[NDArray[np.intp], ...]:
    """About SAMPLE of the allowed cells, evenly spaced, as an index of a plane, for medians over a frame."""
    step = max(int(np.count_nonzero(allowed)) // SAMPLE, 1) | 1  # odd, and so in all columns
    return np.unravel_index(step * np.flatnonzero(allowed.ravel()[::step]), allowed.shape)


def _hue(rgb: NDArray[np.float32]) -> NDArray[np.float32]:
    """HSV hue in degrees."""
    red, green, blue = rgb
    most, least = rgb.max(axis=0), rgb.min(axis=0)
    chroma = np.maximum(most - least, np.float32(1e-6))
    of_green, of_blue = (blue - red) / chroma + 2, (red - green) / chroma + 4
    hue = np.where(most == red, np.mod((green - blue) / chroma, 6), np.where(most == green, of_green, of_blue))
    return np.asarray(hue * np.float32(60), np.float32)


def allowed_cells(frame: Frame, settings: TrackingSettings, mark: MarkSettings | None = None) -> NDArray[np.bool_]:
    """Cells in which marks may be searched: the regions without the masks."""
    assert frame.u is not None
    across, down = cell_of(frame)
    allowed = np.ones(frame.u.shape, bool)

    def cells(box: Box) -> tuple[slice, slice]:
        left, top, right, bottom = box
        height = down * frame.row_step
        return (
            slice(max(int(np.floor(top / height)), 0), max(int(np.ceil(bottom / height)), 0)),
            slice(max(int(np.floor(left / across)), 0), max(int(np.ceil(right / across)), 0)),
        )

    for region in (settings.region_px, mark.region_px if mark else None):
        if region is not None:
            inside = np.zeros_like(allowed)
            inside[cells(region)] = True
            allowed &= inside
    for box in settings.mask_px:
        allowed[cells(box)] = False
    return allowed
