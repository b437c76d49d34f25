"""Projects of OSP Tracker: .trk (XML) and .trz (a zip with a .trk), with their origin, scale and frame times.

Points are stored in px of the image, y down. The coordinate system of the project (origin, angle of its x axis
counter-clockwise, px per unit of length) transforms them to the plate.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from calibration.tables import NO_TEXT, ZIPPED
from evaluator.errors import InputError

Array = NDArray[np.float64]
LARGEST_BYTES = 500_000_000  # of XML: days of manual marks; limits the size of an unpacked zip
PROJECTS = (".trz", ".trk", ".zip")  # names of zipped projects
TO_DO = "save the project in Tracker again, or export its tables as text"


class Project:
    """A Tracker project: length_unit as stated, else ""; tracks by name."""

    def __init__(self, path: Path) -> None:
        """Read a .trk or .trz. Raises InputError for a file that is neither."""
        self.path = path
        with path.open("rb") as file:
            is_zip = file.read(len(ZIPPED)) == ZIPPED.encode()
        if is_zip and path.suffix.lower() not in PROJECTS:
            raise InputError(f"{path}: {NO_TEXT}")
        content = _xml(path)
        try:
            self._root = _root(content)
        except (ET.ParseError, ValueError, LookupError) as error:  # also for an unknown encoding
            raise InputError(f"{path}: not a project of OSP Tracker ({error}); {TO_DO}") from error
        self.length_unit = _text(self._root, "length_unit")
        clip, control = _object(self._root, "videoclip"), _object(self._root, "clipcontrol")
        self._first_frame = _number(clip, "startframe", 0.0)
        self._start_s = _number(clip, "starttime", 0.0) / 1000
        self.frame_s = _number(control, "delta_t", np.nan) / 1000
        self.points_px = self._tracks()

    def _tracks(self) -> dict[str, dict[int, tuple[float, float]]]:
        """Positions by frame of every track with positions."""
        found: dict[str, dict[int, tuple[float, float]]] = {}
        for track in self._root.iter("object"):
            name = _text(track, "name")
            data = _property(track, "framedata")
            if not name or data is None:
                continue
            places = {}
            for index, item in enumerate(data.findall("property")):
                step = item.find("object")
                x, y = (_number(step, axis, np.nan) for axis in "xy")
                if np.isfinite([x, y]).all():
                    number = (item.get("name") or "").strip("[]")
                    places[int(_number(step, "n", float(number) if number.isdigit() else index))] = (x, y)
            if places:
                found[name] = places
        return found

    def times_s(self, frames: Array, rate_hz: float | None) -> Array:
        """Times of frames (n,). Raises InputError if the project does not state the duration of a frame."""
        frame_s = 1 / rate_hz if rate_hz else self.frame_s
        if not (np.isfinite(frame_s) and frame_s > 0):
            raise InputError(f"{self.path}: has no frame duration; give rate_hz (frames per second)")
        return self._start_s + (frames - self._first_frame) * frame_s

    def on_plate(self, frames: Array, points_px: Array) -> Array:
        """Points (n, 2) in the project's unit of length, y up. Raises InputError for a project without a scale."""
        system = _object(self._root, "coords")
        data = _property(system, "framedata") if system is not None else None
        items = data.findall("property/object") if data is not None else []
        if not items:
            raise InputError(f"{self.path}: has no coordinate system; calibrate it in Tracker, or read it in px")
        rows = np.array(
            [[_number(item, key, default) for key, default in SYSTEM.items()] for item in items], dtype=float
        )
        x0, y0, angle, x_scale, y_scale = rows[np.clip(frames.astype(int), 0, len(rows) - 1)].T
        if not ((x_scale > 0) & (y_scale > 0)).all():
            raise InputError(f"{self.path}: has a scale that is not positive; calibrate it in Tracker")
        right, up, turn = points_px[:, 0] - x0, y0 - points_px[:, 1], np.radians(angle)
        along, across = np.cos(turn) * right + np.sin(turn) * up, np.cos(turn) * up - np.sin(turn) * right
        return np.column_stack([along / x_scale, across / y_scale])


SYSTEM = {"xorigin": 0.0, "yorigin": 0.0, "angle": 0.0, "xscale": 1.0, "yscale": 1.0}


def _root(content: bytes) -> ET.Element:
    """The root of XML; Tracker of Windows wrote its code page, but called it UTF-8."""
    try:
        return ET.fromstring(content)  # noqa: S314 - expat limits the expansion of entities
    except ET.ParseError:
        try:
            content.decode("utf-8")
        except UnicodeDecodeError:
            return ET.fromstring(content.decode("cp1252", errors="replace"))  # noqa: S314 - as above
        raise


def _xml(path: Path) -> bytes:
    if not zipfile.is_zipfile(path):
        return path.read_bytes()
    try:
        with zipfile.ZipFile(path) as archive:
            names = [item for item in archive.infolist() if item.filename.lower().endswith(".trk")]
            content = b""
            if len(names) == 1:
                with archive.open(names[0]) as packed:
                    content = packed.read(LARGEST_BYTES + 1)  # the size stated in the archive may be wrong
    except Exception as error:  # zipfile raises various errors for a damaged archive
        raise InputError(f"{path}: cannot be unpacked ({error}); {TO_DO}") from error
    if len(names) != 1:
        found = ", ".join(Path(item.filename).name for item in names) or "none"
        raise InputError(f"{path}: must hold one project (.trk; there: {found}); unpack it, and name one of them")
    if len(content) > LARGEST_BYTES:
        raise InputError(f"{path}: {names[0].filename} unpacks to more than {LARGEST_BYTES / 1e6:.0f} MB; {TO_DO}")
    return content


def _property(owner: ET.Element | None, name: str) -> ET.Element | None:
    if owner is None:
        return None
    return next((item for item in owner.findall("property") if item.get("name") == name), None)


def _object(owner: ET.Element, name: str) -> ET.Element | None:
    found = _property(owner, name)
    return None if found is None else found.find("object")


def _text(owner: ET.Element, name: str) -> str:
    found = _property(owner, name)
    return (found.text or "").strip() if found is not None else ""


def _number(owner: ET.Element | None, name: str, default: float) -> float:
    found = _property(owner, name)
    try:
        return float(found.text or "") if found is not None else default
    except ValueError:
        return default
