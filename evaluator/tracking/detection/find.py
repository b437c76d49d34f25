"""First search for marks in a whole frame: coloured blobs, their shape, the most probable pair.

Works on the colour planes at their resolution. If the white balance of `color_map` gives no good pair, the plate itself
may be coloured, and the balance of the camera is used.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking.detection.color_map import ColorMap, allowed_cells, color_map
from evaluator.tracking.detection.selection import Candidate, choose, shortlist
from evaluator.tracking.settings import MarkSettings, TrackingSettings

LEAST_AREA_PX2 = 6.0  # a mark of 1.4 px radius: below that no shape can be distinguished from noise
LEVELS = 5  # doublings of the least chroma: from the faintest tint to the strongest colour that 8 bits hold
SAME = 1.25  # blobs of two levels are one if their radii differ by a smaller factor, and their centres by half a radius
# Alternatives for unusual colours: share of the plate's tint that is due to the lamp, degrees by which hues lie outside
# their usual ranges, and their log odds. A plate may be coloured, and a camera may render yellow as orange.
UNUSUAL = ((0.0, 0.0, 2.0), (1.0, 15.0, 4.0), (0.0, 15.0, 6.0))
GOOD = -4.0  # log-likelihood of a pair (98 % of true pairs) from which no alternative is tried
# Least ratio of a blob's chroma to the level that delimits it; smaller ones are noise peaks of a blob of a lower level.
SUMMIT = 1.15
STRIPE = 6.0  # aspect ratio above that of a sticker, or of a disc with a motion blur of twice its diameter
SMALLEST_RATIO, LARGEST_RATIO = 0.6, 1.7  # of a blob's diameter at its threshold over diameter_px
MOST = 12  # blobs examined per mark: the most colourful ones, and as many from the most probable pairs
UNSEEN = 30.0  # penalty of a mark that is not found, above that of the worst candidate


class Reading(NamedTuple):
    """Result of the search in a frame with one white balance.

    chosen: the most probable blob of each mark, if there is one. blobs: all candidates. balance: of `color_map`.
    """

    chosen: dict[str, Candidate]
    blobs: list[Candidate]
    balance: float


def find_marks(frame: Frame, settings: TrackingSettings, names: list[str]) -> Reading:
    """Find the named marks anywhere in a frame."""
    anywhere = allowed_cells(frame, settings)
    if not anywhere.any():
        return Reading({}, [], 1.0)

    balanced = color_map(frame, anywhere)

    def read(balance: float, wider_deg: float = 0.0) -> tuple[Reading, float]:
        colors = balanced if balance == 1.0 else color_map(frame, anywhere, balance)
        blobs = _candidates(frame, colors, settings, names, wider_deg)
        chosen, score = choose(blobs, settings)
        return Reading(chosen, blobs, balance), score - UNSEEN * (len(names) - len(chosen))

    best, most = read(1.0)
    # A user who states a colour has read it off the image: hues are then compared without white balance.
    if balanced.motley or all(settings.mark[name].said for name in names):
        best, most = max((best, most), read(0.0), key=lambda one: one[1])
    if len(names) == 1 or most > GOOD:
        return best
    for balance, wider_deg, odds in UNUSUAL:
        reading, score = read(balance, wider_deg)
        # A gain to less than a good pair does not justify another reading of the colours.
        if score > GOOD and score - odds > most:
            best, most = reading, score - odds
    return best


def candidates(frame: Frame, settings: TrackingSettings, names: list[str]) -> list[Candidate]:
    """All blobs that could be one of the named marks."""
    anywhere = allowed_cells(frame, settings)
    return _candidates(frame, color_map(frame, anywhere), settings, names) if anywhere.any() else []


def _candidates(
    frame: Frame, colors: ColorMap, settings: TrackingSettings, names: list[str], wider_deg: float = 0.0
) -> list[Candidate]:
    """Blobs that could be one of the named marks, the most colourful of each first, as many as are worth examining.

    wider_deg: number of degrees by which hues outside their ranges count, on sides away from those of other marks.
    """
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
        # A mark may lie on something of its own hue (a circuit board, its own reflection): blobs are separated at
        # several levels of chroma.
        for level in colors.floor * 2.0 ** np.arange(LEVELS):
            cells, chroma = cells[chroma > level], chroma[chroma > level]
            if not len(cells):
                break
            least = SUMMIT * level if level > colors.floor else 0.0
            here = (one for one in blobs_of(name, colors, cells) if one.chroma > least and _fits(one, mark))
            blobs += [one for one in here if not is_known(one, blobs)]
        found += blobs
    return shortlist(found, settings, MOST)


def _widened(low: float, high: float, by: float, ranges: list[tuple[float, float]]) -> tuple[float, float]:
    """A range of hues, widened on the sides on which no other range begins."""
    return (low - by * all(low != other for _, other in ranges), high + by * all(high != other for other, _ in ranges))


def is_known(blob: Candidate, blobs: list[Candidate]) -> bool:
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
    """Blobs that consist of some cells, which are counted along the rows."""
    y, x = np.divmod(cells, colors.chroma.shape[1])
    first_x, first_y = int(x.min()), int(y.min())
    window = np.zeros((int(y.max()) - first_y + 1, int(x.max()) - first_x + 1), np.uint8)
    window[y - first_y, x - first_x] = 1
    count, labels, stats, _ = cv2.connectedComponentsWithStats(window, connectivity=8)
    stats[:, :2] += first_x, first_y
    cell_area, (rows, columns) = colors.cell_px[0] * colors.cell_px[1], colors.chroma.shape
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
                whole=bool(left > 0 and top > 0 and left + width < columns and top + height < rows),
            )
        )
    return blobs
