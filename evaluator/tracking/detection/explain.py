"""Explanation of a search: why coloured regions of a frame were accepted or rejected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking.detection.color_map import ColorMap, allowed_cells, color_map
from evaluator.tracking.detection.find import LARGEST_RATIO, SMALLEST_RATIO, STRIPE, blobs_of, find_marks, is_known
from evaluator.tracking.detection.selection import Candidate
from evaluator.tracking.settings import TrackingSettings

PALE = 0.5  # of the minimum chroma: paler blobs are not listed
MOST = 8  # blobs listed per mark
SAME_PLACE = 1.0  # radii within which a blob is identified with the chosen one


@dataclass(frozen=True)
class Explained:
    """A coloured blob, its hue (degrees), and the result of the search for one mark: chosen, or the reason why not."""

    blob: Candidate
    hue_deg: float
    verdict: str
    chosen: bool


@dataclass(frozen=True)
class Seen:
    """Evidence of the search for one mark in a frame.

    mask: (rows, columns) of the colour planes, cells of its colour in the searched area. cell_px, origin_px: of a cell.
    hue_range_deg, floor: required hues and minimum chroma. blobs: the most colourful ones, of any hue.
    """

    mark: str
    mask: NDArray[np.bool_]
    cell_px: tuple[float, float]
    origin_px: tuple[float, float]
    hue_range_deg: tuple[float, float]
    floor: float
    blobs: tuple[Explained, ...]


def explain(frame: Frame, settings: TrackingSettings) -> list[Seen]:
    """Evidence of a search of the whole frame for every mark, without knowledge of earlier frames."""
    settings = settings.model_copy(update={"mark": settings.of_kind("color")})
    if frame.u is None or not settings.mark:
        return []
    anywhere = allowed_cells(frame, settings)
    if not anywhere.any():
        return []
    colors = color_map(frame, anywhere, share_of_floor=PALE)
    chosen = find_marks(frame, settings, list(settings.mark)).chosen
    hue = np.full(colors.chroma.size, np.nan, np.float32)
    hue[colors.colorful] = colors.hue_deg
    blobs = blobs_of("", colors, colors.colorful) if len(colors.colorful) else []
    ranked = sorted(blobs, key=lambda one: -one.chroma * min(one.radius_px, 10.0))
    return [_of_mark(name, frame, settings, colors, hue, ranked, chosen.get(name)) for name in settings.mark]


def _of_mark(
    name: str, frame: Frame, settings: TrackingSettings, colors: ColorMap, hue: NDArray[np.float32],
    blobs: list[Candidate], chosen: Candidate | None,
) -> Seen:  # fmt: skip
    mark = settings.mark[name]
    low, high = mark.hue_range(name)
    allowed = allowed_cells(frame, settings, mark)
    planes = hue.reshape(colors.chroma.shape)
    with np.errstate(invalid="ignore"):
        within = np.mod(planes - np.float32(low), 360) < np.mod(high - low, 360)
    mask = within & allowed & (colors.chroma > colors.floor)
    explained = []
    for blob in _with_own(blobs, blobs_of(name, colors, np.flatnonzero(mask)) if mask.any() else []):
        column, row = (
            round((at - first) / size)
            for at, first, size in zip(blob.center_px, colors.origin_px, colors.cell_px, strict=True)
        )
        of_blob = _hue_around(planes, row, column, blob.radius_px / colors.cell_px[0])
        here = bool(allowed[row, column])
        taken = chosen is not None and _is_part(chosen, blob)
        verdict = (
            "chosen" if taken else _refusal(blob, of_blob, (low, high), colors.floor, mark.diameter_px, allowed=here)
        )
        explained.append(Explained(blob, of_blob, verdict, taken))
    return Seen(name, mask, colors.cell_px, colors.origin_px, (low, high), colors.floor, tuple(explained))


def _with_own(blobs: list[Candidate], own: list[Candidate]) -> list[Candidate]:
    """The most colourful blobs of any hue, after the largest of the mark's own hue that are no blob by themselves.

    A mark that touches something of another hue (a hand that holds it) is a part of one blob with that.
    """
    largest = sorted(own, key=lambda one: -one.radius_px)[: MOST // 2]
    missing = [one for one in largest if not any(is_known(one, [other]) for other in blobs)]
    return [*missing, *blobs][:MOST]


def _is_part(chosen: Candidate, blob: Candidate) -> bool:
    """Whether a blob is the chosen one, or contains it as its brighter part."""
    apart = float(np.hypot(*np.subtract(chosen.center_px, blob.center_px)))
    return apart < SAME_PLACE * max(chosen.radius_px, 0.3 * blob.radius_px)


def _hue_around(planes: NDArray[np.float32], row: int, column: int, radius: float) -> float:
    """Mean hue of the cells around one, degrees."""
    reach = max(int(radius), 1)
    part = planes[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
    angle = np.radians(part[np.isfinite(part)])
    return float(np.degrees(np.arctan2(np.sin(angle).sum(), np.cos(angle).sum())) % 360) if len(angle) else float("nan")


def _refusal(
    blob: Candidate, hue_deg: float, wanted: tuple[float, float], floor: float, diameter_px: float | None,
    *, allowed: bool,
) -> str:  # fmt: skip
    """Why a blob was rejected, with the number and the setting that would change it."""
    low, high = wanted
    if not allowed:
        return "outside region_px, or under mask_px"
    if not np.mod(hue_deg - low, 360) < np.mod(high - low, 360):
        return f"hue {hue_deg:.0f} deg is not within {low:.0f} to {high:.0f}: say color or hue_deg"
    if blob.chroma < floor:
        return f"too pale: chroma {blob.chroma:.0f}, the frame's own tints reach {floor:.0f}"
    if diameter_px is not None and not SMALLEST_RATIO < 2 * blob.radius_px / diameter_px < LARGEST_RATIO:
        return f"{2 * blob.radius_px:.0f} px across is not about diameter_px = {diameter_px:g}"
    if blob.elongation > STRIPE:
        return f"a stripe: {blob.elongation:.1f} times as long as wide"
    cut = "cut by the border of the image: a mark is followed once all of it has been seen"
    return cut if not blob.whole else "another is likelier by colour, shape, size and the distance of the pair"
