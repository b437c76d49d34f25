"""Find marks in a whole frame without knowing where they are: coloured blobs, their shape, the likeliest pair.

Works on the colour planes at their own resolution. White balance: what most of the frame shows (plate, field) is
taken as neutral, so that hues mean the same under any lamp; where that gives no good pair, the plate itself may be
coloured, and the camera's own balance is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.recording.frame import Plane
from evaluator.tracking.detection import color_kernels
from evaluator.tracking.detection.selection import Candidate, choose
from evaluator.tracking.settings import Box, MarkSettings, TrackingSettings

Array = NDArray[np.float64]
LEAST_AREA_PX2 = 6.0  # a mark of 1.4 px radius: below that no shape can be distinguished from noise
LEVELS = 5  # doublings of the least chroma: from the faintest tint to the strongest colour that 8 bits hold
SAME = 1.25  # blobs of two levels are one where their radii differ by less, and their centres by half a radius
# Share of the plate's tint that the lamp has, degrees by which hues lie beyond their usual ranges, and the log odds
# against it: a plate may be coloured itself, a camera may render yellow as orange.
UNUSUAL = ((0.0, 0.0, 2.0), (1.0, 15.0, 4.0), (0.0, 15.0, 6.0))
SAMPLE = 1 << 14  # cells that medians are taken of: known to a hundredth of their spread
GOOD = -4.0  # log-likelihood of two blobs that look like marks (98 % of pairs that are): nothing unusual is tried
STRIPE = 6.0  # longer than a sticker, or a disc smeared by twice its diameter, is
SMALLEST_RATIO, LARGEST_RATIO = 0.6, 1.7  # of a blob's diameter over diameter_px: about, as thresholds tell it
UNSEEN = 30.0  # as bad as a mark can score, and more


@dataclass(frozen=True)
class ColorMap:
    """A frame's colours at the resolution of its colour planes.

    chroma: (rows, columns), largest minus smallest of the balanced R, G, B, levels of 8 bits. floor: chroma that the
    frame's own noise and tints reach. colorful: (m,), the cells above it, counted along the rows; hue_deg: (m,),
    their HSV hue against the neutral. u, v: the planes, levels of their own depth.
    """

    chroma: NDArray[np.float32]
    floor: float
    colorful: NDArray[np.intp]
    hue_deg: NDArray[np.float32]
    u: Plane
    v: Plane
    cell_px: tuple[float, float]
    origin_px: tuple[float, float]


def cell_of(frame: Frame) -> tuple[int, int]:
    """Luma samples across and down that one chroma sample covers."""
    assert frame.u is not None
    return -(-frame.luma.shape[1] // frame.u.shape[1]), -(-frame.luma.shape[0] // frame.u.shape[0])


def color_map(frame: Frame, allowed: NDArray[np.bool_], balance: float = 1.0, share_of_floor: float = 1.0) -> ColorMap:
    """Balance a frame's colours.

    allowed: (rows, columns) of the colour planes, where to look. balance: share of the plate's tint that the lamp has.
    share_of_floor: from which cells count as colourful.
    """
    assert frame.u is not None
    assert frame.v is not None
    rows, columns = frame.u.shape
    across, down = cell_of(frame)
    luma: Plane = np.asarray(
        cv2.resize(np.ascontiguousarray(frame.luma), (columns, rows), interpolation=cv2.INTER_AREA), frame.luma.dtype
    )
    to_rgb = _rgb_from_planes(frame)
    sample = sampled(allowed)
    middle = np.maximum(np.median(_rgb(to_rgb, luma[sample], frame.u[sample], frame.v[sample]), axis=1), 1.0)
    # Lamps from candle to blue sky stay within a factor of two between channels.
    to_rgb *= (np.clip(middle.mean() / middle, 0.6, 1.7) ** balance)[:, None]
    chroma = np.empty((rows, columns), np.float32)
    color_kernels.chroma_plane(luma, frame.u, frame.v, to_rgb.astype(np.float32), chroma)
    typical = chroma[sample]
    spread = float(np.median(np.abs(typical - np.median(typical)))) * 1.4826
    floor = max(float(np.median(typical)) + 6 * spread, 14.0)
    colorful = np.flatnonzero(chroma > share_of_floor * floor)
    cells = np.unravel_index(colorful, chroma.shape)
    hue = _hue(_rgb(to_rgb, luma[cells], frame.u[cells], frame.v[cells]))
    cell = float(across), float(down * frame.row_step)
    origin = (across - 1) / 2, frame.row_origin + (down - 1) / 2 * frame.row_step
    return ColorMap(chroma, floor, colorful, hue, frame.u, frame.v, cell, origin)


def _rgb_from_planes(frame: Frame) -> Array:
    """(3, 4): R, G, B, levels of 8 bits, from luma, u, v of the frame's own depth and 1."""
    scale = 2.0 ** (8 - frame.depth)
    kr, kb = (0.2126, 0.0722) if frame.matrix == "bt709" else (0.299, 0.114)
    luma, color, black = (1.0, 1.0, 0.0) if frame.full_range else (255 / 219, 255 / 224, 16.0)
    red, blue = 2 * (1 - kr) * color, 2 * (1 - kb) * color
    of_planes = np.array([[0.0, red], [-kb * blue / (1 - kr - kb), -kr * red / (1 - kr - kb)], [blue, 0.0]])
    constant = -luma * black - 128.0 * of_planes.sum(axis=1)
    return np.column_stack([np.full(3, luma * scale), of_planes * scale, constant])


def _rgb(to_rgb: Array, luma: Plane, u: Plane, v: Plane) -> NDArray[np.float32]:
    """(3, m): R, G, B of m cells."""
    return np.asarray(to_rgb[:, :3] @ np.stack([luma, u, v]) + to_rgb[:, 3:], np.float32)


def neutral_of(frame: Frame, allowed: NDArray[np.bool_]) -> tuple[float, float]:
    """(u, v) of what most of the frame shows, in levels of the planes' own depth."""
    assert frame.u is not None
    assert frame.v is not None
    sample = sampled(allowed)
    return float(np.median(frame.u[sample])), float(np.median(frame.v[sample]))


def sampled(allowed: NDArray[np.bool_]) -> tuple[NDArray[np.intp], ...]:
    """Every so many of the allowed cells, as an index of a plane: what is usual in a frame takes no more."""
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
    """Where colour may be sought: the regions, less the masks."""
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


def find_marks(
    frame: Frame, settings: TrackingSettings, names: list[str]
) -> tuple[dict[str, Candidate], list[Candidate]]:
    """The likeliest blob of each of the named marks, as far as there is one; and all blobs of the usual colours."""
    found = candidates(frame, settings, names)
    best, most = choose(found, settings)
    unseen = [name for name in names if name not in best and settings.mark[name].said]
    if unseen:
        # Who says a colour has read it off the image as it is: hues mean what they do without white balance, then.
        best |= choose(candidates(frame, settings, unseen, balance=0.0), settings)[0]
    if len(names) == 1 or (len(best) == len(names) and most > GOOD):
        return best, found
    most -= UNSEEN * (len(names) - len(best))
    for balance, wider_deg, odds in UNUSUAL:
        chosen, score = choose(candidates(frame, settings, names, balance, wider_deg), settings)
        # Less than a good pair is no reason to read the colours in another way.
        if len(chosen) == len(names) and score > GOOD and score - odds > most:
            best, most = chosen, score - odds
    return best, found


def candidates(
    frame: Frame,
    settings: TrackingSettings,
    names: list[str],
    balance: float = 1.0,
    wider_deg: float = 0.0,
    limit: int = 12,
) -> list[Candidate]:
    """All blobs that could be one of the named marks, the most colourful first, at most `limit` a mark.

    balance: of `color_map`. wider_deg: for how much hues count beyond their ranges, away from those of other marks.
    """
    anywhere = allowed_cells(frame, settings)
    if not anywhere.any():
        return []
    colors = color_map(frame, anywhere, balance)
    found = []
    for name in names:
        mark = settings.mark[name]
        allowed = allowed_cells(frame, settings, mark)
        low, high = mark.hue_range(name)
        if mark.hue_deg is None:
            low, high = _widened(
                low, high, wider_deg, [settings.mark[other].hue_range(other) for other in settings.mark]
            )
        within = np.mod(colors.hue_deg - np.float32(low), 360) < np.mod(high - low, 360)
        cells = colors.colorful[within & allowed.ravel()[colors.colorful]]
        chroma = colors.chroma.ravel()[cells]
        blobs: list[Candidate] = []
        # A mark may lie on something of its own hue (a circuit board, a reflection of itself): at each level of chroma
        # other blobs stand apart.
        for level in colors.floor * 2.0 ** np.arange(LEVELS):
            cells, chroma = cells[chroma > level], chroma[chroma > level]
            if not len(cells):
                break
            blobs += [one for one in blobs_of(name, colors, cells) if _fits(one, mark) and not _known(one, blobs)]
        found += sorted(blobs, key=lambda blob: -blob.chroma * min(blob.radius_px, 3.0))[:limit]
    return found


def _widened(low: float, high: float, by: float, ranges: list[tuple[float, float]]) -> tuple[float, float]:
    """A range of hues widened on the sides where no other begins."""
    return (low - by * all(low != other for _, other in ranges), high + by * all(high != other for other, _ in ranges))


def _known(blob: Candidate, blobs: list[Candidate]) -> bool:
    """Whether a blob is among those already found."""
    for other in blobs:
        small, large = sorted((blob.radius_px, other.radius_px))
        apart = np.hypot(*np.subtract(blob.center_px, other.center_px))
        if large < SAME * small and apart < 0.5 * small:
            return True
    return False


def _fits(blob: Candidate, mark: MarkSettings) -> bool:
    if mark.diameter_px is not None and not SMALLEST_RATIO < 2 * blob.radius_px / mark.diameter_px < LARGEST_RATIO:
        return False
    return blob.elongation < STRIPE


def blobs_of(name: str, colors: ColorMap, cells: NDArray[np.intp]) -> list[Candidate]:
    """Blobs that some cells, counted along the rows, make up."""
    y, x = np.divmod(cells, colors.chroma.shape[1])
    first_x, first_y = int(x.min()), int(y.min())
    window = np.zeros((int(y.max()) - first_y + 1, int(x.max()) - first_x + 1), np.uint8)
    window[y - first_y, x - first_x] = 1
    count, labels, stats, _ = cv2.connectedComponentsWithStats(window, connectivity=8)
    stats[:, :2] += first_x, first_y
    cell_area = colors.cell_px[0] * colors.cell_px[1]
    blobs = []
    for label in range(1, count):
        left, top, width, height, area = stats[label]
        if area * cell_area < LEAST_AREA_PX2:
            continue
        part = slice(top, top + height), slice(left, left + width)
        within = slice(top - first_y, top - first_y + height), slice(left - first_x, left - first_x + width)
        own = labels[within] == label
        chroma = np.where(own, colors.chroma[part], 0)
        strong = own & (chroma > 0.5 * np.percentile(chroma[own], 90))  # the blob down to its half height
        if strong.sum() * cell_area < LEAST_AREA_PX2:
            continue
        weight = np.where(strong, chroma, 0).astype(float)
        y, x = np.nonzero(strong)
        w = weight[y, x] / weight[y, x].sum()
        cx, cy = float(w @ x), float(w @ y)
        px, py = (x - cx) * colors.cell_px[0], (y - cy) * colors.cell_px[1]
        spread = np.cov(np.stack([px, py]), ddof=0) + np.diag([colors.cell_px[0] ** 2, colors.cell_px[1] ** 2]) / 12
        small, large = np.linalg.eigvalsh(spread)
        core = strong & (chroma > 0.8 * np.percentile(chroma[strong], 90))
        blobs.append(
            Candidate(
                mark=name,
                center_px=(
                    colors.origin_px[0] + colors.cell_px[0] * (left + cx),
                    colors.origin_px[1] + colors.cell_px[1] * (top + cy),
                ),
                radius_px=float(np.sqrt(strong.sum() * cell_area / np.pi)),
                elongation=float(np.sqrt(large / max(small, 1e-9))),
                chroma=float(np.mean(chroma[core])),
                chroma_uv=(float(colors.u[part][core].mean()), float(colors.v[part][core].mean())),
            )
        )
    return blobs
