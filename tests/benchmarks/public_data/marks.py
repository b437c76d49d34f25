"""Videos of others: marks found, wrong ones, scatter and time, beside threshold and centroid."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from evaluator.recording import open_recording
from evaluator.tracking import TrackingSettings, track
from tests.benchmarks.public_data.sets import BALL, FIELD, Published

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
HUES = {"green": (90.0, 165.0), "yellow": (42.0, 72.0), "blue": (195.0, 255.0)}
IN_VIEW = (21, 32)  # frames in which the ball is seen


def marks(folder: Path) -> None:
    """A row for each mark: share found, wrong, scatter (px), for turnscope and for the threshold; s."""
    print("\nmarks in video: found, wrong, scatter px | threshold and centroid")
    if (path := _there(FIELD, folder)) is not None:
        _resting(path)
        _pair(path)
    if (path := _there(BALL, folder)) is not None:
        _ball(path)


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


def _pair(path: Path) -> None:
    """Green and blue mark of one robot: their distance is one number; a frame in which it is not has a wrong mark."""
    content: dict[str, object] = {"mark": {"green": {}, "blue": {}}, "body": ["green", "blue"], "mask_px": [BORDER]}
    ours, seconds = _tracked(path, content)
    theirs = {name: _threshold(path, name, (98, 0, 632, 468)) for name in ("green", "blue")}
    cells = []
    for found in (ours, theirs):
        distance = np.hypot(*(found["green"] - found["blue"]).T)
        seen = np.isfinite(distance)
        usual = np.median(distance[seen])
        right = np.abs(distance - usual) < FAR_PX
        cells.append(f"{right.mean():6.1%} {int((seen & ~right).sum()):4d} {np.std(distance[right]):.3f}")
    print(f"{FIELD.name}, pair: {cells[0]} | {cells[1]} (scatter of the distance); {seconds:.1f} s")


def _ball(path: Path) -> None:
    ours, seconds = _tracked(path, {"mark": {"green": {}}})
    cells = []
    for found in (ours["green"], _threshold(path, "green", (0, 0, 1e9, 1e9))):
        seen = np.isfinite(found[:, 0])
        due = np.zeros(len(seen), bool)
        due[IN_VIEW[0] : IN_VIEW[1] + 1] = True
        cells.append(f"{(seen & due).sum() / due.sum():6.1%} {int((seen & ~due).sum()):4d}")
    print(f"{BALL.name}: {cells[0]} | {cells[1]}; {seconds:.1f} s")


def _threshold(path: Path, name: str, region_px: Box) -> Array:
    """Centroid of the largest blob within the hues of a name in a region, (n, 2); NaN without one of 20 px²."""
    low, high = HUES[name]
    left, top, right, bottom = (round(min(edge, 1e6)) for edge in region_px)
    places = []
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            shown = frame.to_ndarray(format="rgb24")[top : bottom + 1, left : right + 1]
            hsv = cv2.cvtColor(np.ascontiguousarray(shown), cv2.COLOR_RGB2HSV_FULL)
            turned = (hsv[..., 0].astype(np.int16) * 360 // 256 - round(low)) % 360
            mask = ((turned < (high - low) % 360) & (hsv[..., 1] > 80) & (hsv[..., 2] > 80)).astype(np.uint8)
            count, _, stats, centers = cv2.connectedComponentsWithStats(mask, connectivity=8)
            best = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])) if count > 1 else 0
            good = best and stats[best, cv2.CC_STAT_AREA] >= 20
            places.append(tuple(centers[best] + (left, top)) if good else (np.nan, np.nan))
    return np.array(places)
