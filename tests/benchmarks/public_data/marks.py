"""Videos of others: marks found, wrong ones, scatter and time, beside threshold and centroid."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.recording import open_recording
from evaluator.tracking import TrackingSettings, track
from tests.benchmarks.public_data.sets import BALL, FIELD, HELD, PENDULUM, SQUARES, Published

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]
FAR_PX = 6.0  # half a mark of the field: farther from where a thing rests, something else was measured


@dataclass(frozen=True)
class Resting:
    """A mark that rests at a place (px) throughout, sought within a box."""

    place: tuple[float, float]
    region_px: Box


RESTING = (Resting((457.4, 38.5), (430, 15, 485, 65)), Resting((529.4, 202.0), (500, 175, 560, 230)))
BORDER: Box = (0, 0, 97, 468)  # of the screen that was recorded
HUES = {
    "red": (340.0, 375.0),
    "green": (90.0, 165.0),
    "yellow": (42.0, 72.0),
    "blue": (195.0, 255.0),
    "magenta": (285.0, 335.0),
}
BALL_PX = 40.0  # half a hand-held ball
IN_VIEW = (21, 32)  # frames in which the ball is seen


def marks(folder: Path) -> None:
    """A row for each mark: share found, wrong, scatter (px), for turnscope and for the threshold; s."""
    print("\nmarks in video: found, wrong, scatter px | threshold and centroid")
    if (path := _there(FIELD, folder)) is not None:
        _resting(path)
        _pair(FIELD, path, ("green", "blue"), [BORDER], (98, 0, 632, 468))
    for one in SQUARES:
        if (path := _there(one, folder)) is not None:
            for color in ("red", "green", "magenta"):  # the other half of each robot is blue
                _pair(one, path, (color, "blue"))
    if (path := _there(BALL, folder)) is not None:
        _ball(path)
    for one, color, least in (*((ball, "green", 25) for ball in HELD), (PENDULUM, "red", 80)):
        if (path := _there(one, folder)) is not None:
            _large_ball(one.name, path, color, least)


def _there(one: Published, folder: Path) -> Path | None:
    place = one.find(folder)
    if place is None:
        print(one.reason)
    return place


def _tracked(path: Path, settings: dict[str, object]) -> tuple[dict[str, Array], float]:
    start = time.process_time()
    table = track(open_recording(path), TrackingSettings.model_validate(settings))
    names = [name.removesuffix("_status") for name in table.columns if name.endswith("_status")]
    return {
        name: table[[f"{name}_x_px", f"{name}_y_px"]].to_numpy(float) for name in names
    }, time.process_time() - start


def _resting(path: Path) -> None:
    for number, one in enumerate(RESTING, start=1):
        ours, seconds = _tracked(path, {"mark": {"yellow": {"region_px": one.region_px}}})
        cells = []
        for found in (ours["yellow"], _threshold(path, "yellow", one.region_px)):
            off = np.hypot(*(found - np.array(one.place)).T)
            right = off < FAR_PX
            spread = 1.4826 * np.median(np.abs(found[right] - np.median(found[right], axis=0)))
            cells.append(f"{right.mean():6.1%} {int((off >= FAR_PX).sum()):4d} {spread:.3f}")
        print(f"{FIELD.name}, resting {number}: {cells[0]} | {cells[1]}; {seconds:.1f} s")


def _pair(
    one: Published, path: Path, names: tuple[str, str], masks: Sequence[Box] = (), region: Box = (0, 0, 1e9, 1e9)
) -> None:
    """Two marks of one robot: their distance is one number; a frame in which it is not has a wrong mark."""
    ours, seconds = _tracked(path, {"mark": {name: {} for name in names}, "body": names, "mask_px": masks})
    theirs = {name: _threshold(path, name, region) for name in names}
    cells = []
    usual = np.nanmedian(np.hypot(*(ours[names[0]] - ours[names[1]]).T))
    for found in (ours, theirs):
        distance = np.hypot(*(found[names[0]] - found[names[1]]).T)
        seen = np.isfinite(distance)
        right = np.abs(distance - usual) < FAR_PX
        scatter = float(np.std(distance[right])) if right.any() else np.nan
        cells.append(f"{right.mean():6.1%} {int((seen & ~right).sum()):4d} {scatter:.3f}")
    print(
        f"{one.name}, {' and '.join(names)} {usual:.1f} px apart: {cells[0]} | {cells[1]} (scatter of the distance);"
        f" {seconds:.1f} s"
    )


def _ball(path: Path) -> None:
    ours, seconds = _tracked(path, {"mark": {"green": {}}})
    cells = []
    for found in (ours["green"], _threshold(path, "green", (0, 0, 1e9, 1e9))):
        seen = np.isfinite(found[:, 0])
        due = np.zeros(len(seen), bool)
        due[IN_VIEW[0] : IN_VIEW[1] + 1] = True
        cells.append(f"{(seen & due).sum() / due.sum():6.1%} {int((seen & ~due).sum()):4d}")
    print(f"{BALL.name}: {cells[0]} | {cells[1]}; {seconds:.1f} s")


def _large_ball(name: str, path: Path, color: str, least: int) -> None:
    """A ball without truth: frames found by either method, those in which they differ, and the usual distance.

    least: argument of `_threshold`.
    """
    ours, seconds = _tracked(path, {"mark": {color: {}}})
    theirs = _threshold(path, color, (0, 0, 1e9, 1e9), least)
    seen, other = np.isfinite(ours[color][:, 0]), np.isfinite(theirs[:, 0])
    off = np.hypot(*(ours[color] - theirs).T)[seen & other]
    print(
        f"{name}: {seen.sum():4d} | {other.sum():4d} frames; {(off > BALL_PX).sum()} differ, usually by "
        f"{np.median(off):.2f} px; {seconds:.1f} s"
    )


def _threshold(path: Path, name: str, region_px: Box, least: int = 80) -> Array:
    """Centroid of the largest blob within the hues of a name in a region, (n, 2); NaN without one of 20 px².

    least: saturation and brightness of its pixels.
    """
    low, high = HUES[name]
    left, top, right, bottom = (round(min(edge, 1e6)) for edge in region_px)
    places = []
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            shown = frame.to_ndarray(format="rgb24")[top : bottom + 1, left : right + 1]
            hsv = cv2.cvtColor(np.ascontiguousarray(shown), cv2.COLOR_RGB2HSV_FULL)
            turned = (hsv[..., 0].astype(np.int32) * 360 // 256 - round(low)) % 360
            mask = ((turned < (high - low) % 360) & (hsv[..., 1] > least) & (hsv[..., 2] > least)).astype(np.uint8)
            count, _, stats, centers = cv2.connectedComponentsWithStats(mask, connectivity=8)
            best = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])) if count > 1 else 0
            good = best and stats[best, cv2.CC_STAT_AREA] >= 20
            places.append(tuple(centers[best] + (left, top)) if good else (np.nan, np.nan))
    return np.array(places)
