"""Tracks of other programs as marks: OSP Tracker, DeepLabCut (CSV), SLEAP, movement.

Which program wrote a file is seen in the file. What no file says (which of its points are the marks, its unit of
length, the frame rate) stands in [tracks] of experiment.toml. Lengths become mm in the plate frame; picture points (px,
y down, centre of the top left pixel at 0, 0) are placed on the plane of the marks by the camera.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from evaluator.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from calibration.camera import Camera

Array = NDArray[np.float64]
Program = Literal["turnscope", "tracker", "project", "deeplabcut", "movement"]

MM_PER = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}
MARKS = ("green", "yellow")


class UnknownPointError(InputError):
    """A file has no point of the name that was said."""


class Tracks(BaseModel):
    """[tracks] of experiment.toml: how marks files of other programs are read.

    green, yellow: names of the marks there. unit: of lengths there. rate_hz: frames a second, for files that count
    frames. likelihood: points that are less likely count as missing.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    green: str = "green"
    yellow: str = "yellow"
    unit: Literal["px", "mm", "cm", "m", "inch"] | None = None
    rate_hz: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    likelihood: Annotated[float, Field(ge=0, le=1)] = 0.6

    def name(self, mark: str) -> str:
        """Name of a mark in the file."""
        return self.green if mark == "green" else self.yellow


def read_any_marks(
    path: Path, tracks: Tracks | None = None, camera: Camera | None = None, height_mm: float = 0.0
) -> pd.DataFrame:
    """Read marks of any known program as a marks table (evaluator.marks), mm in the plate frame.

    camera, height_mm: for tracks in px. Raises InputError for a file that cannot be read, or that needs more said.
    """
    program = program_of(path)
    said = tracks or Tracks()
    if program == "turnscope":
        from evaluator.marks import read_marks

        return _in_mm(read_marks(path), said)
    time, points, unit = _foreign_points(path, program, said)
    return _marks_table(path, time, points, unit, camera, height_mm)


def read_points(
    path: Path, tracks: Tracks | None = None, camera: Camera | None = None, height_mm: float = 0.0
) -> tuple[Array, dict[str, Array], str]:
    """Read times (n,) and the points (n, 2) of every mark of any known program, and their unit: "mm", or "px".

    Points in px are turned so that y points up, unless a camera places them in mm. A file may hold one mark only.
    """
    program, said = program_of(path), tracks or Tracks()
    if program == "turnscope":
        time, points, unit = _own_points(path, said)
    else:
        time, points, unit = _foreign_points(path, program, said, all_marks=False)
    if unit == "px" and camera is not None:
        table = _marks_table(path, time, points, unit, camera, height_mm)
        return time, {name: table[[f"{name}_x_mm", f"{name}_y_mm"]].to_numpy(float) for name in points}, "mm"
    if unit == "px":
        return time, {name: place * np.array([1.0, -1.0]) for name, place in points.items()}, "px"
    return time, {name: place * MM_PER[unit] for name, place in points.items()}, "mm"


def _own_points(path: Path, tracks: Tracks) -> tuple[Array, dict[str, Array], str]:
    """Marks of a marks CSV under any name, in mm where it has them, else in px."""
    from evaluator.marks import read_marks

    table = read_marks(path, ("time_s",))
    for unit in ("mm", "px"):
        ends = (f"_x_{unit}", f"_y_{unit}")
        names = [str(name).removesuffix(ends[0]) for name in table if str(name).endswith(ends[0])]
        names = [name for name in names if f"{name}{ends[1]}" in table]
        if names:
            points = {name: table[[f"{name}{end}" for end in ends]].to_numpy(float) for name in names}
            return table["time_s"].to_numpy(float), points, tracks.unit or unit if unit == "mm" else "px"
    raise InputError(f"{path}: no columns NAME_x_mm and NAME_y_mm of a mark (or in px); see turnscope turning --help")


def _in_mm(table: pd.DataFrame, tracks: Tracks) -> pd.DataFrame:
    """A marks table whose lengths are in another unit than its columns say."""
    if tracks.unit not in (None, "px", "mm"):
        factor = MM_PER[tracks.unit]
        for name in table:
            if str(name).endswith(("_mm", "_mm2")):
                table[name] *= factor**2 if str(name).endswith("_mm2") else factor
    return table


def _foreign_points(
    path: Path, program: Program, said: Tracks, *, all_marks: bool = True
) -> tuple[Array, dict[str, Array], str]:
    """Times, points by mark and unit of a file of another program; without all_marks one mark is enough."""
    readers = {
        "tracker": _read_tracker,
        "project": _read_project,
        "deeplabcut": _read_deeplabcut,
        "movement": _read_binary,
    }
    reader = readers[program]
    try:
        time, points = reader(path, said, MARKS)
    except UnknownPointError:
        if all_marks:
            raise
        for mark in MARKS:
            try:
                time, points = reader(path, said, (mark,))
                break
            except UnknownPointError:
                continue
        else:
            raise
    unit = said.unit or (_project_unit(path) if program == "project" else "px" if program != "tracker" else None)
    if unit is None:
        raise InputError(
            f'{path}: OSP Tracker did not write its unit of length here; say unit = "mm" (px, cm, m) in [tracks]'
        )
    if len(time) < 2 or not np.all(np.diff(time) > 0):
        raise InputError(f"{path}: times must be at least two and increase from row to row")
    return time, points, unit


def program_of(path: Path) -> Program:
    """Which program wrote a marks file, from its first bytes. Raises InputError where it cannot be read."""
    try:
        with Path(path).open("rb") as file:
            head = file.read(4096)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    if head.startswith((b"CDF", b"\x89HDF")):
        return "movement"
    if head.startswith(b"PK\x03\x04") or head.lstrip(b"\xef\xbb\xbf \r\n\t").startswith((b"<?xml", b"<object")):
        return "project"
    lines = head.decode("utf-8", errors="replace").splitlines()
    if lines and lines[0].split(",")[0].strip() == "scorer":
        return "deeplabcut"
    if len(lines) > 1 and "t" in _cells(lines[1], _delimiter(lines[1])):
        return "tracker"
    return "turnscope"


def _marks_table(
    path: Path, time: Array, points: dict[str, Array], unit: str, camera: Camera | None, height_mm: float
) -> pd.DataFrame:
    import pandas as pd

    table = pd.DataFrame({"time_s": time})
    for mark, place in points.items():
        if unit == "px":
            if camera is None:
                raise InputError(f'{path}: holds picture points; say camera = "camera.json", or unit in [tracks]')
            table[[f"{mark}_x_px", f"{mark}_y_px"]] = place
            seen = np.isfinite(place).all(axis=1)
            placed = np.full_like(place, np.nan)
            placed[seen] = camera.plate_from_picture(place[seen], height_mm)
        else:
            placed = place * MM_PER[unit]
        table[[f"{mark}_x_mm", f"{mark}_y_mm"]] = placed
    return table


def _read_tracker(path: Path, tracks: Tracks, marks: Sequence[str]) -> tuple[Array, dict[str, Array]]:
    """Two header lines: names of the tracks above their columns, then t, x, y …; any usual delimiter."""
    lines = [line for line in path.read_text(encoding="utf-8-sig", errors="replace").splitlines() if line.strip()]
    delimiter = _delimiter(lines[1])
    names, columns = _cells(lines[0], delimiter), _cells(lines[1], delimiter)
    names += [""] * (len(columns) - len(names))
    if names[0] and columns[0] == "t":  # a table of one track carries its name above the time
        names = ["", names[0], *names[1:-1]] if len(names) > 1 else names
    owner = ""
    place: dict[tuple[str, str], int] = {}
    for index, (name, column) in enumerate(zip(names, columns, strict=True)):
        owner = name or owner
        place.setdefault((_plain(owner), column), index)
    rows = [_numbers(path, number, line, delimiter) for number, line in enumerate(lines[2:], start=3)]
    width = len(columns)
    table = np.array([(row + [np.nan] * width)[:width] for row in rows], dtype=float).reshape(-1, width)
    points = {}
    for mark in marks:
        wanted = _plain(tracks.name(mark))
        if (wanted, "x") not in place or (wanted, "y") not in place:
            known = sorted({name for name, _ in place if name})
            raise _unknown(path, tracks, mark, known)
        points[mark] = table[:, [place[wanted, "x"], place[wanted, "y"]]]
    return table[:, columns.index("t")], points


def _read_project(path: Path, tracks: Tracks, marks: Sequence[str]) -> tuple[Array, dict[str, Array]]:
    """A project of OSP Tracker itself: on its own coordinate system, or in px where [tracks] says so."""
    from evaluator.interchange.tracker_project import Project

    project = Project(path)
    named = {_plain(name): places for name, places in project.points_px.items()}
    for mark in marks:
        if _plain(tracks.name(mark)) not in named:
            raise _unknown(path, tracks, mark, sorted(project.points_px))
    chosen = {mark: named[_plain(tracks.name(mark))] for mark in marks}
    frames = np.array(sorted(set().union(*chosen.values())), dtype=float)
    points = {}
    for mark, places in chosen.items():
        place = np.array([places.get(int(frame), (np.nan, np.nan)) for frame in frames])
        # Tracker counts px from the corner of the image, others from the centre of the first pixel.
        points[mark] = place - 0.5 if tracks.unit == "px" else project.on_plate(frames, place)
    return project.times_s(frames, tracks.rate_hz), points


def _project_unit(path: Path) -> str | None:
    """Unit of length that a project names itself; None where it names none that is known."""
    from evaluator.interchange.tracker_project import Project

    unit = Project(path).length_unit
    return unit if unit in MM_PER else None


def _read_binary(path: Path, tracks: Tracks, marks: Sequence[str]) -> tuple[Array, dict[str, Array]]:
    """HDF5 of SLEAP, or netCDF of movement."""
    with path.open("rb") as file:
        sleap = _read_sleap(path, tracks, marks) if file.read(4) == b"\x89HDF" else None
    return sleap or _read_movement(path, tracks, marks)


def _read_sleap(path: Path, tracks: Tracks, marks: Sequence[str]) -> tuple[Array, dict[str, Array]] | None:
    """An analysis file of SLEAP: tracks (individuals, 2, nodes, frames); None for any other HDF5 file.

    Raises InputError for the HDF5 of DeepLabCut, which only pandas with PyTables reads.
    """
    try:
        import h5py
    except ImportError as error:
        raise InputError(f"{path}: HDF5 needs h5py: pip install 'turnscope[netcdf]'") from error
    try:
        with h5py.File(path, "r") as file:
            if "df_with_missing" in file:
                raise InputError(f"{path}: the HDF5 of DeepLabCut; give the CSV that it writes beside it (save_as_csv)")
            if not {"tracks", "node_names"} <= set(file):
                return None
            place, names = file["tracks"][0], [name.decode() for name in file["node_names"][:]]
            score = file["point_scores"][0] if "point_scores" in file else None
    except (OSError, IndexError, AttributeError) as error:
        raise InputError(f"{path}: not an HDF5 file that can be read ({error})") from error
    if tracks.rate_hz is None:
        raise InputError(f"{path}: SLEAP counts frames; say rate_hz (frames a second) in [tracks]")
    points = {}
    for mark in marks:
        if tracks.name(mark) not in names:
            raise _unknown(path, tracks, mark, names)
        index = names.index(tracks.name(mark))
        points[mark] = np.array(place[:, index].T, dtype=float)
        if score is not None:
            points[mark][score[index] < tracks.likelihood] = np.nan
    return np.arange(place.shape[-1]) / tracks.rate_hz, points


def _read_deeplabcut(path: Path, tracks: Tracks, marks: Sequence[str]) -> tuple[Array, dict[str, Array]]:
    """Header lines scorer, (individuals,) bodyparts, coords; a row per frame, counted from 0."""
    import pandas as pd

    if tracks.rate_hz is None:
        raise InputError(f"{path}: DeepLabCut counts frames; say rate_hz (frames a second) in [tracks]")
    with path.open(encoding="utf-8", newline="") as file:
        heads: list[list[str]] = []
        for row in csv.reader(file):
            heads.append(row)
            if row and row[0] == "coords":
                break
        else:
            raise InputError(f"{path}: begins like a DeepLabCut file, but has no line that starts with coords")
    named = {row[0]: row for row in heads}
    parts, coords = named.get("bodyparts", []), heads[-1]
    try:
        table = pd.read_csv(path, skiprows=len(heads), header=None, dtype=float).to_numpy()
    except (ValueError, pd.errors.ParserError) as error:
        raise InputError(f"{path}: {str(error).strip()}") from error
    points = {}
    for mark in marks:
        own = {coord: i for i, (part, coord) in enumerate(zip(parts, coords, strict=True)) if part == tracks.name(mark)}
        if not {"x", "y"} <= own.keys():
            raise _unknown(path, tracks, mark, sorted(set(parts[1:])))
        place = table[:, [own["x"], own["y"]]].copy()
        if "likelihood" in own:
            place[table[:, own["likelihood"]] < tracks.likelihood] = np.nan
        points[mark] = place
    return table[:, 0] / tracks.rate_hz, points


def _read_movement(path: Path, tracks: Tracks, marks: Sequence[str]) -> tuple[Array, dict[str, Array]]:
    """A movement dataset: position over time, space, keypoints, individuals; confidence where there is one."""
    try:
        import xarray as xr
    except ImportError as error:
        raise InputError(f"{path}: netCDF needs xarray: pip install 'turnscope[netcdf]'") from error

    try:
        # By name: what xarray chooses by itself depends on what else is installed.
        with path.open("rb") as file:
            engine = "scipy" if file.read(3) == b"CDF" else "h5netcdf"
        data = xr.load_dataset(path, engine=engine)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not a netCDF file that can be read ({str(error).splitlines()[0]})") from error
    if "position" not in data or not {"time", "space", "keypoints"} <= set(data["position"].dims):
        raise InputError(
            f"{path}: no position over time, space and keypoints in it; is it a movement dataset of poses?"
        )
    if "individuals" in data.dims:
        data = data.isel(individuals=0)
    time = data["time"].to_numpy().astype(float)
    if data.attrs.get("time_unit") == "frames":
        rate = tracks.rate_hz or data.attrs.get("fps")
        if not rate:
            raise InputError(f"{path}: counts frames; say rate_hz (frames a second) in [tracks]")
        time = time / float(rate)
    known = [name.decode() if isinstance(name, bytes) else str(name) for name in data["keypoints"].to_numpy()]
    space = [name.decode() if isinstance(name, bytes) else str(name) for name in data["space"].to_numpy()]
    position = data["position"].transpose("keypoints", "time", "space").to_numpy().astype(float)
    points = {}
    for mark in marks:
        if tracks.name(mark) not in known:
            raise _unknown(path, tracks, mark, known)
        index = known.index(tracks.name(mark))
        place = position[index][:, [space.index("x"), space.index("y")]]
        if "confidence" in data:
            place[data["confidence"].transpose("keypoints", "time").to_numpy()[index] < tracks.likelihood] = np.nan
        points[mark] = place
    return time, points


def _unknown(path: Path, tracks: Tracks, mark: str, known: list[str]) -> UnknownPointError:
    there = ", ".join(known) or "none"
    return UnknownPointError(
        f'{path}: no point named "{tracks.name(mark)}" (there: {there}); say {mark} = "…" in [tracks]'
    )


def _delimiter(line: str) -> str | None:
    return next((mark for mark in "\t;,|" if mark in line), None)  # None: spaces, where names hold none


def _cells(line: str, delimiter: str | None) -> list[str]:
    return [cell.strip().strip('"') for cell in line.rstrip("\r\n").split(delimiter)]


def _plain(name: str) -> str:
    """Tracker writes "mass A" as mass_A."""
    return name.strip().lstrip("#").replace(" ", "_")


def _numbers(path: Path, number: int, line: str, delimiter: str | None) -> list[float]:
    try:
        # Where the delimiter is not a comma, a comma is the decimal sign of the computer that wrote the file.
        plain = line if delimiter == "," else line.replace(",", ".")
        return [float(cell) if cell else np.nan for cell in _cells(plain, delimiter)]
    except ValueError as error:
        raise InputError(f"{path}: line {number} holds something that is not a number") from error
