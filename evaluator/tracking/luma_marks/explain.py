"""Explanation of a search: why bright blobs and square outlines were accepted or rejected."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.recording import Frame
from evaluator.tracking.luma_marks.lights import WEAKEST, allowed, bright_blobs, shape_fault
from evaluator.tracking.luma_marks.tag_borders import measured_tag
from evaluator.tracking.luma_marks.tags import FAMILIES, dictionaries, luma_of_8_bits, number_of, outlines
from evaluator.tracking.settings import MarkSettings, TrackingSettings

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
MOST = 8  # candidates listed per mark
WINDOW, DARKER = (
    13,
    7,
)  # px and levels of the mask of a tag: the middle one of the thresholds that OpenCV's reader tries
SAME_PLACE = 0.5  # half diagonals: outlines closer than this are one


@dataclass(frozen=True)
class Thing:
    """A candidate in a frame: its position and half its extent (px), what it is, and the verdict.

    number: of a tag that was read, else None.
    """

    center_px: tuple[float, float]
    radius_px: float
    what: str
    verdict: str
    chosen: bool
    number: int | None = None


@dataclass(frozen=True)
class SeenInLuma:
    """Evidence of the search for one tag, or for one of the lights, in a frame.

    mask: (rows, columns) of the luma, bright (lights) or darker than the surroundings (tags). cell_px, origin_px: of a
    sample, as in `Seen`. sought: the target of the search, in words. things: most probable first.
    """

    mark: str
    mask: NDArray[np.bool_]
    cell_px: tuple[float, float]
    origin_px: tuple[float, float]
    sought: str
    things: tuple[Thing, ...]


def explain_luma(frame: Frame, settings: TrackingSettings) -> list[SeenInLuma]:
    """Evidence of a search of the whole frame for every light and tag, without knowledge of earlier frames."""
    lights, tags = settings.of_kind("light"), settings.of_kind("aruco", "apriltag")
    seen = [_of_light(name, frame, settings, len(lights)) for name in lights]
    return seen + [_of_tag(name, mark, frame) for name, mark in tags.items()]


def _seen(mark: str, frame: Frame, mask: NDArray[np.bool_], sought: str, things: list[Thing]) -> SeenInLuma:
    cell, origin = (1.0, float(frame.row_step)), (0.0, float(frame.row_origin))
    return SeenInLuma(mark, mask, cell, origin, sought, tuple(things[:MOST]))


def _of_light(name: str, frame: Frame, settings: TrackingSettings, count: int) -> SeenInLuma:
    found = bright_blobs(frame)
    strongest = sorted(found.blobs, key=lambda blob: -blob.light)
    inside = [blob for blob in strongest if allowed(blob.place, frame, settings)]
    weakest = inside[count - 1].light if len(inside) >= count else 0.0
    likely = sum(blob.light > WEAKEST * weakest for blob in inside)
    things = []
    for blob in strongest:
        chosen = False
        if not allowed(blob.place, frame, settings):
            verdict = "outside region_px, or under mask_px"
        elif blob.light <= WEAKEST * weakest:
            verdict = f"too weak: {100 * blob.light / weakest:.0f} % of the light of the weakest that is sought"
        elif likely > count:
            verdict = f"one of {likely} where {count} are sought: lights are those that move; say region_px"
        elif likely < count:
            verdict = f"likely a light, but only {likely} of {count} that are sought are seen"
        else:
            verdict, chosen = "likely a light", True
        things.append(Thing(_in_frame(blob.place, frame), blob.radius, "bright blob", verdict, chosen))
    for box in sorted(found.refused, key=lambda box: -box[4]):
        left, top, wide, high, _ = box
        place = _in_frame((left + (wide - 1) / 2, top + (high - 1) / 2), frame)
        fault = shape_fault(box, frame.luma.size)
        things.append(Thing(place, max(wide, high) / 2, "bright blob", fault, chosen=False))
    sought = (
        f"sought: {count} of lights, luma above {found.level:.0f} of {2**frame.depth - 1}; right: what is as bright"
    )
    return _seen(name, frame, found.mask > 0, sought, things)


def _of_tag(name: str, mark: MarkSettings, frame: Frame) -> SeenInLuma:
    luma, number = luma_of_8_bits(frame), number_of(name, mark)
    tried = dictionaries(name, mark, number)
    things: list[Thing] = []
    for dictionary in tried:
        read, squares = outlines(dictionary, luma)
        for found, corners in read:
            _add(things, _read_thing(found, number, dictionary, corners, luma, frame))
        for corners in squares:
            _add(things, _square(corners, frame))
    if not any(one.chosen for one in things):
        for one in _tags_of_other_families(tried, number, luma, frame):
            _add(things, one)
    things.sort(key=lambda one: (not one.chosen, one.number is None, -one.radius_px))
    mask = cv2.adaptiveThreshold(luma, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, WINDOW, DARKER) > 0
    sought = f"sought: tag {number} of {', '.join(_short(one) for one in tried)}; right: what is darker than around it"
    return _seen(name, frame, np.asarray(mask), sought, things)


def _read_thing(found: int, number: int, dictionary: str, corners: Array, luma: Image, frame: Frame) -> Thing:
    """A tag that was read with one of the tried dictionaries."""
    thing = replace(_square(corners, frame), what=f"tag {found} of {_short(dictionary)}", number=found)
    if found != number:
        return replace(thing, verdict=f"not number {number}: say id = {found} if it is the mark")
    if measured_tag(luma, corners) is None:
        return replace(
            thing, verdict="its borders are no straight lines: hidden, bent, blurred, or without a white margin"
        )
    return replace(thing, verdict="chosen", chosen=True)


def _square(corners: Array, frame: Frame) -> Thing:
    """An outline of four corners in which no tag was read."""
    center = corners.mean(axis=0)
    radius = float(np.hypot(*(corners[0] - corners[2]))) / 2
    verdict = "no tag is read in it: too few px a cell, blurred, half hidden, or none"
    return Thing(
        _in_frame((float(center[0]), float(center[1])), frame), radius, "square outline", verdict, chosen=False
    )


def _tags_of_other_families(tried: tuple[str, ...], number: int, luma: Image, frame: Frame) -> list[Thing]:
    """Tags that other dictionaries than the tried ones read."""
    things = []
    for kind, families in FAMILIES.items():
        for family in families:
            if any(family in dictionary for dictionary in tried):
                continue
            dictionary = f"DICT_{family}_1000" if family[0].isdigit() else f"DICT_{family}"
            for found, corners in outlines(dictionary, luma)[0]:
                said = f'say kind = "{kind}", dictionary = "{_short(dictionary)}"'
                said += "" if found == number else f" and id = {found}"
                what = f"tag {found} of {_short(dictionary)}"
                things.append(
                    replace(_square(corners, frame), what=what, number=found, verdict=f"{said} if it is the mark")
                )
    return things


def _add(things: list[Thing], thing: Thing) -> None:
    """Add a candidate; of several at one position, keep the chosen one, or else one that was read."""
    for k, other in enumerate(things):
        if np.hypot(*np.subtract(other.center_px, thing.center_px)) < SAME_PLACE * other.radius_px:
            if (thing.chosen, thing.number is not None) > (other.chosen, other.number is not None):
                things[k] = thing
            return
    things.append(thing)


def _in_frame(place: tuple[float, float], frame: Frame) -> tuple[float, float]:
    """Position in the full frame of a position in its luma."""
    return place[0], frame.row_origin + frame.row_step * place[1]


def _short(dictionary: str) -> str:
    return dictionary.removeprefix("DICT_").lower()
