"""Centre of a mark of any shape: the centroid of its colour, each pixel weighted by the share that the mark covers.

The share is a linear discriminant of luma and chroma (Fisher) between the colour of the blob's core and that of the
ring around it, in the direction in which the ring varies least. Edge pixels count in part, chroma dominates on a floor
that varies in luma, and no model of the shape is needed. The centre is midway between those for a linear camera and one
with a gamma.

Image coordinates, px.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Mask = NDArray[np.uint8]
Part = NDArray[np.bool_]  # of the pixels around a blob

RIM_PX, RING_PX = 3, 9  # beyond a blob's half height: the end of a blurred edge; the end of the surroundings considered
FEW = 12  # pixels: fewest from which a mean colour is computed
MOSTLY = 2.0  # standard deviations of the luma around the blob; few of the surrounding pixels are brighter
MOST_OF = 0.9  # of the surroundings have less chroma than a floor that the blob may touch
BEYOND = 0.2  # largest share below 0 or above 1 that noise can cause; beyond it the pixel shows something else
LEAST_VARIANCE = 1.0  # levels²: rounding of luma and chroma to whole levels, and of chroma between its samples
OTHER_HUE = 0.35  # rad: half the angle by which pixels of a mark's colour may differ from it; a whole mark differs less
LUMPS = 7  # px: side of the squares whose means show over what distance errors of pixels are correlated
GAMMA, LIGHTEST = 2.2, 255.0  # of cameras that write sRGB or BT.709, which both are close to; level of the whitest
SHORTEST = 1.0 / 12.0  # px²: variance of a single pixel, the least along any axis


@dataclass(frozen=True)
class Blob:
    """A coloured blob. center_px: (2,). covariance_px2: (2, 2) of the centre, from the scatter of the pixels around.

    area_px2: sum of the shares, which blur does not change. spread_px2: (2, 2), second moments about the centre.
    strength: mean chroma of the blob along its colour, levels; beside: chroma that a tenth of its surroundings exceeds.
    whole: does not touch the border of the image. turned_rad: angle of its mean colour from that sought, about the
    neutral.
    """

    center_px: tuple[float, float]
    covariance_px2: Array
    area_px2: float
    spread_px2: Array
    strength: float
    whole: bool
    beside: float = 0.0
    turned_rad: float = 0.0


def elongation(spread_px2: Array, path_px: tuple[float, float] = (0.0, 0.0)) -> float:
    """Longer over shorter axis, corrected for motion blur along a path; at least 1."""
    smear = np.outer(path_px, path_px) / 12.0
    small, large = np.linalg.eigvalsh(spread_px2 - smear)
    return float(np.sqrt(max(large, SHORTEST) / max(small, SHORTEST)))


def blobs_around(
    frame: Frame, cell: Array, color: Array, place: tuple[float, float], half_px: float, least_px2: float
) -> list[Blob]:
    """Blobs of a colour within half_px of a position, of at least least_px2; cell, color: see `color_window`."""
    assert frame.u is not None
    assert frame.v is not None
    rows, columns = frame.u.shape
    left, right = _span(place[0], half_px, cell[2], cell[0], columns)
    top, bottom = _span(place[1], half_px, cell[3], cell[1], rows)
    if right - left < 2 or bottom - top < 2:
        return []
    u, v = (plane[top:bottom, left:right].astype(np.float32) for plane in (frame.u, frame.v))
    along, member = _members(u, v, color)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(member, connectivity=8)
    found = []
    for label in range(1, count):
        if stats[label, cv2.CC_STAT_AREA] * cell[0] * cell[1] < least_px2:
            continue
        x, y = stats[label, cv2.CC_STAT_LEFT], stats[label, cv2.CC_STAT_TOP]
        right_end, low_end = x + stats[label, cv2.CC_STAT_WIDTH], y + stats[label, cv2.CC_STAT_HEIGHT]
        whole = left + x > 0 and top + y > 0 and left + right_end < columns and top + low_end < rows
        margin_x, margin_y = (int(np.ceil((RING_PX + 2) / size)) for size in cell[:2])
        part = (
            slice(max(top + y - margin_y, 0), min(top + low_end + margin_y, rows)),
            slice(max(left + x - margin_x, 0), min(left + right_end + margin_x, columns)),
        )
        own = np.zeros((part[0].stop - part[0].start, part[1].stop - part[1].start), np.uint8)
        own[
            top + y - part[0].start : top + low_end - part[0].start,
            left + x - part[1].start : left + right_end - part[1].start,
        ] = labels[y:low_end, x:right_end] == label
        here = labels == label
        strength = float(along[here].mean())
        blob = _measured(frame, cell, color, part, own, strength, whole=bool(whole))
        if blob is not None:
            found.append(replace(blob, turned_rad=_turned(float(u[here].mean()), float(v[here].mean()), color)))
    return found


def has_another_hue(frame: Frame, cell: Array, color: Array, place: tuple[float, float], half_px: float) -> bool:
    """Whether the pixels of a colour about a position are mostly of a neighbouring one; cell, color: as above."""
    assert frame.u is not None
    assert frame.v is not None
    left, right = _span(place[0], half_px, cell[2], cell[0], frame.u.shape[1])
    top, bottom = _span(place[1], half_px, cell[3], cell[1], frame.u.shape[0])
    u, v = (plane[top:bottom, left:right].astype(np.float32) for plane in (frame.u, frame.v))
    here = _members(u, v, color)[1] > 0
    return bool(here.any()) and abs(_turned(float(u[here].mean()), float(v[here].mean()), color)) > OTHER_HUE


def extends_beyond(
    frame: Frame, cell: Array, color: Array, place: tuple[float, float], half_px: float, most_px2: float
) -> bool:
    """Whether the region of a colour at a position covers more than an area, or is cut by a window about it.

    half_px: half the side of the window; cell, color: see `color_window`.
    """
    assert frame.u is not None
    assert frame.v is not None
    rows, columns = frame.u.shape
    left, right = _span(place[0], half_px, cell[2], cell[0], columns)
    top, bottom = _span(place[1], half_px, cell[3], cell[1], rows)
    row, column = round((place[1] - cell[3]) / cell[1]) - top, round((place[0] - cell[2]) / cell[0]) - left
    if not (0 <= row < bottom - top and 0 <= column < right - left):
        return True
    u, v = (plane[top:bottom, left:right].astype(np.float32) for plane in (frame.u, frame.v))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(_members(u, v, color)[1], connectivity=8)
    x, y, wide, high, area = stats[labels[row, column]].tolist()
    whole = labels[row, column] > 0 and x > 0 and y > 0 and x + wide < right - left and y + high < bottom - top
    return not whole or area * cell[0] * cell[1] > most_px2


def _span(middle: float, half: float, origin: float, size: float, count: int) -> tuple[int, int]:
    """First sample within half of the middle, and one beyond the last."""
    return max(int(np.floor((middle - half - origin) / size)), 0), min(
        int(np.ceil((middle + half - origin) / size)) + 1, count
    )


def _members(u: Single, v: Single, color: Array) -> tuple[Single, Mask]:
    """Chroma along the colour, and the samples that have it by `color_kernels.is_color`."""
    du, dv = u - np.float32(color[0]), v - np.float32(color[1])
    along = du * np.float32(color[2]) + dv * np.float32(color[3])
    across = np.abs(dv * np.float32(color[2]) - du * np.float32(color[3]))
    return along, ((along > color[4]) & (across < color[5] * along)).astype(np.uint8)


def _turned(u: float, v: float, color: Array) -> float:
    """Angle of a mean (u, v) about the neutral, from the direction of a colour, rad."""
    du, dv = u - float(color[0]), v - float(color[1])
    return math.atan2(dv * float(color[2]) - du * float(color[3]), du * float(color[2]) + dv * float(color[3]))


def _measured(
    frame: Frame, cell: Array, color: Array, part: tuple[slice, slice], own: Mask, strength: float, *, whole: bool
) -> Blob | None:
    """Measure the blob in the mask `own` of a part of the chroma planes; None if no surroundings are visible."""
    assert frame.u is not None
    assert frame.v is not None
    across, down = round(cell[0]), round(cell[1] / frame.row_step)
    x0, y0 = part[1].start * across, part[0].start * down
    luma = frame.luma[y0 : part[0].stop * down, x0 : part[1].stop * across].astype(np.float32)
    # Column i of the luma lies (i - cell[2]) / across chroma samples from the first one of this part.
    to_chroma = np.array([[1 / across, 0, -cell[2] / across], [0, 1 / down, (1 / down - 1) / 2]])
    size = luma.shape[1], luma.shape[0]

    def upsampled(plane: Single) -> Single:
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return np.asarray(
            cv2.warpAffine(plane, to_chroma, size, flags=flags, borderMode=cv2.BORDER_REPLICATE), np.float32
        )

    u, v = (upsampled(plane[part].astype(np.float32)) for plane in (frame.u, frame.v))
    mask = (upsampled(own.astype(np.float32)) > 0.5).astype(np.uint8)
    if mask.sum() < FEW:
        return None
    core = cv2.erode(mask, np.ones((3, 3), np.uint8)) > 0
    core = core if core.sum() >= FEW else mask > 0
    outline = _outline(mask)
    along, member = _members(u, v, color)
    other = (member > 0) & (_grown(outline, RIM_PX) == 0)
    around = (_grown(outline, RING_PX) > 0) & (_grown(outline, RIM_PX + 1) == 0) & ~other
    if around.sum() < FEW:
        return None
    planes = np.stack([luma, u, v])
    shares = [_share(each, core, around) for each in (planes, _in_light(planes, frame.rgb_from_planes))]
    # The reflection of a lamp removes the colour of a part of the mark and adds light. Pixels within the outline that
    # are brighter than everything else therefore belong to the mark. A wire is darker, or extends beyond the outline.
    beside = luma[around]
    highlights = (outline > 0) & (luma > max(luma[core].mean(), beside.mean() + MOSTLY * beside.std()))
    mask |= highlights.view(np.uint8)
    for share in shares:
        share[highlights & (share < 1.0)] = 1.0
    region = (_grown(mask, RIM_PX) > 0) & ~(_grown(other.astype(np.uint8), 1) > 0)
    grid = x0, frame.row_origin + y0 * frame.row_step, frame.row_step
    inside = cv2.erode(outline & mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * RIM_PX + 1,) * 2)) > 0
    recorded, in_light = (
        _moments(share, (region, core, around, inside), grid, strength, whole=whole) for share in shares
    )
    if recorded is None or in_light is None:
        return None
    return replace(_between(recorded, in_light), beside=float(np.quantile(along[around], MOST_OF)))


def _in_light(planes: Single, rgb_from_planes: Array) -> Single:
    """Planes as light: R, G, B that a camera with a gamma of GAMMA would have written as these; (3, rows, columns)."""
    matrix = rgb_from_planes.astype(np.float32)
    rgb = np.tensordot(matrix[:, :3], planes, axes=1) + matrix[:, 3, None, None]
    return np.asarray((np.clip(rgb, 0.0, LIGHTEST) / LIGHTEST) ** GAMMA, np.float32) * LIGHTEST


def _between(recorded: Blob, in_light: Blob) -> Blob:
    """The blob midway between those of two tone curves; that of the camera is anywhere between them.

    A lens mixes light, so that an edge lies where light is half, but not luma or chroma of a camera with a gamma: each
    edge of a mark is shifted by its own contrast, and the centroid with them.
    """
    one, other = np.array(recorded.center_px), np.array(in_light.center_px)
    x, y = ((one + other) / 2).tolist()
    covariance = (recorded.covariance_px2 + in_light.covariance_px2) / 2 + np.outer(one - other, one - other) / 12
    return replace(recorded, center_px=(x, y), covariance_px2=covariance)


def _outline(mask: Mask) -> Mask:
    """The convex hull of a mask: stickers are convex."""
    return np.asarray(cv2.fillConvexPoly(np.zeros_like(mask), cv2.convexHull(cv2.findNonZero(mask)), 1), np.uint8)


def _grown(mask: Mask, by_px: int) -> Mask:
    side = 2 * by_px + 1
    return np.asarray(cv2.dilate(mask, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))), np.uint8)


def _share(planes: Single, core: NDArray[np.bool_], around: NDArray[np.bool_]) -> Array:
    """Share of the core's colour in each pixel, the rest being that of the surroundings; planes: (3, rows, columns)."""
    inside, outside = planes[:, core].astype(float), planes[:, around].astype(float)
    middle, apart = outside.mean(axis=1), inside.mean(axis=1) - outside.mean(axis=1)
    scatter = np.cov(outside) + np.cov(inside) + LEAST_VARIANCE * np.eye(3)
    direction = np.linalg.solve(scatter, apart)
    return np.tensordot(direction / (direction @ apart), planes - middle[:, None, None].astype(np.float32), axes=1)


def _moments(
    share: Array, parts: tuple[Part, Part, Part, Part], grid: tuple[int, int, int], strength: float, *, whole: bool
) -> Blob | None:
    """Moments of the shares in a region; grid: x and y of the first pixel, step of the rows.

    parts: the region, the core, what is around it, and what the mark covers whole however light falls on it.
    """
    region, core, around, inside = parts
    rows, columns = np.nonzero(region)
    weight = np.where(inside, 1.0, np.clip(share / _light(share, core), -BEYOND, 1.0 + BEYOND))[region]
    total = float(weight.sum())
    if total < FEW / 2:
        return None
    x, y = grid[0] + columns.astype(float), grid[1] + grid[2] * rows.astype(float)
    center = float(weight @ x) / total, float(weight @ y) / total
    away = np.stack([x - center[0], y - center[1]])
    # Variation within the blob (light, blocks of a codec) has the same weight as variation around it.
    variance = np.where(core, _lumpy_variance(share, core), _lumpy_variance(share, around))
    variance = np.where(inside, 0.0, variance)[region]
    covariance = (variance * away) @ away.T / total**2
    spread = (weight * away) @ away.T / total
    return Blob(center, covariance, total * grid[2], spread, strength, whole)


def _light(share: Array, core: NDArray[np.bool_]) -> Array:
    """Light on a blob relative to its mean, as a plane through the shares of its core; in each pixel.

    The plane is shrunk by the share of its slopes that noise explains (empirical Bayes): a small blob has none.
    """
    rows, columns = np.nonzero(core)
    middle = rows.mean(), columns.mean()
    away = np.stack([rows - middle[0], columns - middle[1]])
    level = np.clip(share[core], 1.0 - BEYOND, 1.0 + BEYOND)
    moments = away @ away.T + np.eye(2)
    slopes = np.linalg.solve(moments, away @ (level - level.mean()))
    left = np.zeros(share.shape)
    left[core] = level - slopes @ away
    squares = float(slopes @ moments @ slopes) / max(_lumpy_variance(left, core), 1e-12)
    slopes *= max(1.0 - 2.0 / max(squares, 1e-12), 0.0)
    y, x = np.ogrid[: share.shape[0], : share.shape[1]]
    plane = 1.0 + slopes[0] * (y - middle[0]) + slopes[1] * (x - middle[1])
    return np.asarray(np.clip(plane, 1.0 - BEYOND, 1.0 + BEYOND))


def _lumpy_variance(share: Array, part: NDArray[np.bool_]) -> float:
    """Variance of a pixel's share in a part of the image, times the number of pixels with correlated errors."""
    variance = float(np.var(share[part]))
    side = (LUMPS, LUMPS)
    count = cv2.boxFilter(part.astype(np.float64), -1, side, normalize=False)[part]
    mean = cv2.boxFilter(np.where(part, share - share[part].mean(), 0.0), -1, side, normalize=False)[part] / count
    together = float(np.mean(mean**2 * count)) / max(variance, 1e-12)
    return variance * min(max(together, 1.0), float(LUMPS**2))
