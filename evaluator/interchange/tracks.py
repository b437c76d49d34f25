"""Tracks of other programs as marks: plain tables, OSP Tracker, DeepLabCut, SLEAP, movement.

The program that wrote a file is recognised by its content. Properties that are not in the file (which points are the
marks, unit of length, frame rate) are stated in [tracks] of experiment.toml. Lengths become mm in the plate frame;
image points (px, y down, centre of the top left pixel at 0, 0) are placed on the plane of the marks by the camera.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from calibration.tables import table_head
from evaluator.errors import InputError
from evaluator.files import refuse_stream
from evaluator.interchange.delimited_text import cells_of, delimiter_of
from evaluator.interchange.named_points import FileHints, NamedPoints
from evaluator.interchange.plain_table import columns_of, read_plain
from evaluator.interchange.pose_estimators import read_binary, read_deeplabcut, read_sleap
from evaluator.interchange.tracker_files import plain_name, read_project, read_tracker_text
from evaluator.wording import MM_PER
from simulator.mark_layout import is_mark_name

if TYPE_CHECKING:
    import pandas as pd

    from calibration.camera import Camera

Array = NDArray[np.float64]
Program = Literal["turnscope", "plain", "tracker", "project", "deeplabcut", "sleap", "movement"]


class Tracks(BaseModel):
    """[tracks] of experiment.toml: properties of marks files of other programs.

    MARK = "name": name of a mark in the file, if it differs from robot.toml. unit: of lengths in the file. rate_hz:
    frames a second, for files that count frames. likelihood: points that are less likely count as missing.
    """

    model_config = ConfigDict(extra="allow", frozen=True)
    __pydantic_extra__: dict[str, str] = Field(init=False)

    unit: Literal["px", "um", "mm", "cm", "m", "inch"] | None = None
    rate_hz: Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)] | None = None
    likelihood: Annotated[float, Field(strict=True, ge=0, le=1)] = 0.6

    @model_validator(mode="before")
    @classmethod
    def _no_misspelt_key(cls, content: Any) -> Any:
        for key in content if isinstance(content, dict) else ():
            near = difflib.get_close_matches(str(key), list(cls.model_fields), n=1, cutoff=0.75)
            if near and key not in cls.model_fields:
                raise ValueError(f"unknown key tracks.{key}; did you mean {near[0]}?")
        return content

    @property
    def names(self) -> dict[str, str]:
        """Stated names in the file, by mark."""
        return dict(self.__pydantic_extra__ or {})

    def name(self, mark: str) -> str:
        """Name of a mark in the file."""
        return self.names.get(mark, mark)


def read_any_marks(
    path: Path,
    tracks: Tracks | None = None,
    camera: Camera | None = None,
    height_mm: float = 0.0,
    marks: Sequence[str] = (),
) -> pd.DataFrame:
    """Read marks of any known program as a marks table (evaluator.marks), mm in the plate frame.

    camera, height_mm: for tracks in px. marks: those of the robot, of three and more at least two; by default those of
    the paper's robot. Raises InputError for a file that cannot be read, or that needs further properties in [tracks].
    """
    program = program_of(path)
    said = tracks or Tracks()
    if program == "turnscope":
        from evaluator.interchange.tracker_faults import without_faults
        from evaluator.marks import mark_names, read_marks

        table = _in_mm(read_marks(path, marks or None, said.names), said)
        return without_faults(table, mark_names(table))
    time, points, unit = _foreign_points(path, program, said, marks := marks or tuple(said.names), min(2, len(marks)))
    return _marks_table(path, time, points, unit, camera, height_mm)


def read_points(
    path: Path,
    tracks: Tracks | None = None,
    camera: Camera | None = None,
    height_mm: float = 0.0,
    marks: Sequence[str] = (),
) -> tuple[Array, dict[str, Array], str]:
    """Read times (n,) and the points (n, 2) of every mark of any known program, and their unit: "mm", or "px".

    Points in px are converted so that y points up, unless a camera places them in mm. A file may contain only one mark.
    marks: those of the robot; by default the names in [tracks], else every point that the file names. Faults of
    trackers are left in (evaluator.interchange.tracker_faults).
    """
    program, said = program_of(path), tracks or Tracks()
    if program == "turnscope":
        time, points, unit = _own_points(path, said)
    else:
        time, points, unit = _foreign_points(path, program, said, marks or tuple(said.names), 1)
    if unit == "px" and camera is not None:
        table = _marks_table(path, time, points, unit, camera, height_mm)
        return time, {name: table[[f"{name}_x_mm", f"{name}_y_mm"]].to_numpy(float) for name in points}, "mm"
    if unit == "px":
        return time, {name: place * np.array([1.0, -1.0]) for name, place in points.items()}, "px"
    return time, {name: place * MM_PER[unit] for name, place in points.items()}, "mm"


def _own_points(path: Path, tracks: Tracks) -> tuple[Array, dict[str, Array], str]:
    """Marks of a marks CSV under any name, in mm if it has them, else in px."""
    from evaluator.marks import mark_names, read_marks

    table = read_marks(path, called=tracks.names)
    for unit in ("mm", "px"):
        ends = (f"_x_{unit}", f"_y_{unit}")
        if names := mark_names(table, unit):
            points = {name: table[[f"{name}{end}" for end in ends]].to_numpy(float) for name in names}
            return table["time_s"].to_numpy(float), points, tracks.unit or unit if unit == "mm" else "px"
    raise InputError(f"{path}: no columns NAME_x_mm and NAME_y_mm (or _px) of a mark; see turnscope turning --help")


def _in_mm(table: pd.DataFrame, tracks: Tracks) -> pd.DataFrame:
    """Convert a marks table whose lengths have another unit than its column names."""
    if tracks.unit not in (None, "px", "mm"):
        factor = MM_PER[tracks.unit]
        for name in table:
            if str(name).endswith(("_mm", "_mm2")):
                table[name] *= factor**2 if str(name).endswith("_mm2") else factor
    return table


def _foreign_points(
    path: Path, program: Program, said: Tracks, marks: Sequence[str], needed: int
) -> tuple[Array, dict[str, Array], str]:
    """Times, points by mark and unit of a file of another program; needed: number of required marks.

    Without marks, every point of the file is a mark.
    """
    readers: dict[str, Callable[[Path, FileHints], NamedPoints]] = {
        "plain": read_plain,
        "tracker": read_tracker_text,
        "project": read_project,
        "deeplabcut": read_deeplabcut,
        "sleap": read_sleap,
        "movement": read_binary,
    }
    named = _whole(readers[program], path, said)
    known = {plain_name(name): name for name in named.points} if program in ("tracker", "project") else {}
    if not marks:
        marks = [name for name in known or named.points if is_mark_name(name)]
    points = {}
    for mark in marks:
        there = known.get(plain_name(said.name(mark)), said.name(mark))
        if there in named.points:
            points[mark] = named.points[there]
    if len(points) < max(needed, 1) or any(mark in marks and mark not in points for mark in said.names):
        raise _unknown(path, said, next((mark for mark in marks if mark not in points), "a mark"), sorted(named.points))
    time = named.time_s
    unit = said.unit or named.unit
    if unit is None:
        raise InputError(
            f'{path}: the file has no unit of length; say --unit mm (px, um, cm, m), or unit = "mm" in [tracks]'
        )
    if len(time) < 2 or not np.all(np.diff(time) > 0):
        back = np.flatnonzero(np.diff(time) <= 0)
        where = f"; row {back[0] + 2} of the data does not come after the one before" if len(back) else ""
        raise InputError(
            f"{path}: times must be at least two and increase from row to row{where} (of several objects, keep one)"
        )
    return time, points, unit


def _whole(reader: Callable[[Path, FileHints], NamedPoints], path: Path, said: FileHints) -> NamedPoints:
    """Read a file that may be damaged anywhere: errors of its reader become one sentence."""
    try:
        return reader(path, said)
    except (InputError, OSError):
        raise
    except Exception as error:
        reason = (str(error).splitlines() or [""])[0] or type(error).__name__
        raise InputError(f"{path}: not in the format of its program ({reason}); is it damaged?") from error


def program_of(path: Path) -> Program:
    """The program that wrote a marks file, by its first bytes. Raises InputError if it cannot be read."""
    try:
        refuse_stream(Path(path))
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
    lines = head.decode("utf-8-sig", errors="replace").splitlines()
    begin = table_head(lines)
    lines = [begin.names, *lines[begin.number :]] if lines else []
    if lines and lines[0].split(",")[0].strip() == "scorer":
        return "deeplabcut"
    if lines and {"track", "frame_idx"} <= set(lines[0].split(",")):
        return "sleap"
    if len(lines) > 1 and "t" in cells_of(lines[1], delimiter_of(lines[1])):
        return "tracker"
    return "plain" if lines and _is_plain(lines[0]) else "turnscope"


def _is_plain(header: str) -> bool:
    """Whether a table has points, but not as marks CSV of turnscope name them."""
    names = cells_of(header, delimiter_of(header))
    own = "time_s" in names and any(name.endswith(("_x_mm", "_x_px")) for name in names)
    return not own and columns_of(header) is not None


def _marks_table(
    path: Path, time: Array, points: dict[str, Array], unit: str, camera: Camera | None, height_mm: float
) -> pd.DataFrame:
    import pandas as pd

    from evaluator.interchange.tracker_faults import without_faults

    table = pd.DataFrame({"time_s": time})
    for mark, place in points.items():
        if unit == "px":
            if camera is None:
                raise InputError(f'{path}: holds image points; set camera = "camera.json", or unit in [tracks]')
            table[[f"{mark}_x_px", f"{mark}_y_px"]] = place
            seen = np.isfinite(place).all(axis=1)
            placed = np.full_like(place, np.nan)
            placed[seen] = camera.plate_from_image(place[seen], height_mm)
        else:
            placed = place * MM_PER[unit]
        table[[f"{mark}_x_mm", f"{mark}_y_mm"]] = placed
    return without_faults(table, tuple(points))


def _unknown(path: Path, tracks: Tracks, mark: str, known: list[str]) -> InputError:
    if not known:
        return InputError(f"{path}: holds no point with coordinates; mark one frame by frame in its program")
    there = ", ".join(known)
    return InputError(
        f'{path}: no point named "{tracks.name(mark)}" (there: {there}); say --name {mark}="…", '
        f'or {mark} = "…" in [tracks]'
    )
