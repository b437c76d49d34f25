"""Poses of other systems (motion capture, SLAM, another tracker): centre and heading over time, plate frame.

A CSV with time, x, y and heading (units by suffix: `time_s` or `time_ns`, `x_mm` or `x_m`, `heading_deg` or
`heading_rad`; instead of a heading a quaternion `qx`, `qy`, `qz`, `qw`; standard uncertainties `x_sigma_mm`,
`heading_sigma_rad`, …, and `xy_cov_mm2` if they are known), a trajectory in TUM's format (`timestamp x y z qx qy qz
qw`, m) or the ground truth of EuRoC (ns, m), as read by evo; or a recording of ROS (bags).

A sensor that is sampled faster than it measures repeats its last value. Such a file is recognised by values that
repeat during motion; all repetitions are dropped, so that a value has the time of its first occurrence.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.frames import plate_from_body
from calibration.tables import line_of, numbers_of, table_head
from evaluator.errors import InputError
from evaluator.files import quoted, read_with, refuse_stream
from evaluator.files.csv_tables import read_table
from evaluator.interchange.bags import Topics, heading_rad, is_bag, read_trajectory
from evaluator.interchange.delimited_text import cells_of, delimiter_of
from evaluator.interchange.pose_units import heading_unit
from evaluator.mark_geometry import MarkGeometry
from evaluator.marks import check_marks, repeats
from evaluator.pose import OK, Poses, unwrapped_across_gaps
from evaluator.wording import counted
from simulator.command import SECONDS
from simulator.units import DATES, plain_name, with_plain_columns

Array = NDArray[np.float64]

MM_PER = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
RAD_PER = {"rad": 1.0, "deg": np.pi / 180}
QUATERNION = ("qx", "qy", "qz", "qw")
HEADINGS = {"qz", *(f"heading_{unit}" for unit in RAD_PER)}
MOST_COMMENTS = 100  # lines before a table, of which the first ones are looked at
TUM_COLUMNS = 8  # time, three coordinates and a quaternion; EuRoC's begins with the same ones
KITTI_COLUMNS = 12  # the first three rows of a matrix
# Larger times are those of clocks that count from 1970 or from the start of a computer; they are shifted to begin at 0.
LARGEST_CLOCK_S = 1e6
# Number of groups of equal values among others from which they are not a coincidence.
HELD_SHARE, FEWEST_HELD = 0.05, 3
FEWEST = 4  # poses without uncertainties: a parabola in time passes through three
NEIGHBOURS = 9  # poses to which a parabola in time is fitted: motion is smooth over this number, noise is not
MEDIAN_OF_CHI2 = {6: 5.348}  # by degrees of freedom of NEIGHBOURS poses about a parabola
LEAST_SIGMA_MM, LEAST_SIGMA_RAD = 1e-6, 1e-8  # for simulated poses without noise


@dataclass(frozen=True)
class PoseTable:
    """Poses of a file, and the numbers of dropped repetitions, twice: with the time of the one before.

    table: time_s, x_mm, y_mm, heading_deg, x_sigma_mm, y_sigma_mm, heading_sigma_deg, xy_cov_mm2; NaN if there is no
    pose. zero_s: reading of the file's clock at time 0. noise_stated: whether the file states its uncertainty.
    """

    table: pd.DataFrame
    dropped: int
    zero_s: float
    noise_stated: bool
    twice: int = 0

    def notes(self) -> list[str]:
        """Notes on the file."""
        kept = len(self.table)
        said = []
        if self.dropped:
            said.append(
                f"{self.dropped} of {kept + self.dropped} poses repeat the previous one (held values) and are dropped"
            )
        if self.twice:
            said.append(f"{counted(self.twice, 'pose')} came twice with the same time; one of each counts")
        if unit := heading_unit(self.table):
            said.append(
                f"its headings look like {unit}: only so do they turn with its path; correct the name of the column"
            )
        if not self.noise_stated:
            sigma, angle = (self.table[name].median() for name in ("x_sigma_mm", "heading_sigma_deg"))
            said.append(f"noise estimated from the poses: {sigma:.3g} mm, {angle:.3g} degrees")
        return said


def read_poses(path: Path, topics: Topics | None = None) -> PoseTable:
    """Read poses of any known format; topics: of a bag. Raises InputError that names the line or the column."""
    return read_with(lambda file: _read(file, topics or Topics()), path)


def refuse_few(found: PoseTable, path: Path) -> None:
    """Refuse poses from which neither a motion nor its noise can be determined. Raises InputError."""
    seen = int(found.table["x_mm"].notna().sum())
    if seen < FEWEST and not found.noise_stated:
        raise InputError(f"{path}: {counted(seen, 'pose')}; a motion and its noise show from {FEWEST} poses on")


def holds_poses(path: Path) -> bool:
    """Whether a file contains poses, by its first lines; False for a file that cannot be read."""
    if is_bag(path):
        return True
    try:
        refuse_stream(Path(path))
        with Path(path).open(encoding="utf-8-sig") as file:
            lines = list(itertools.islice((line for line in file if line.strip()), MOST_COMMENTS))
    except (OSError, UnicodeDecodeError):
        return False
    first = next((line for line in lines if not line.lstrip().startswith("#")), "")
    named = _names_poses(table_head(lines).names)
    return named or _is_numbers(first, None, TUM_COLUMNS) or _is_numbers(first, ",", TUM_COLUMNS)


def _names_poses(names: str) -> bool:
    """Whether a line of names is that of a table of poses."""
    cells = set(map(plain_name, cells_of(names, delimiter_of(names))))
    timed = any(f"time_{unit}" in cells for unit in SECONDS)
    # a column of dates with times may be one of marks without a unit, too, but these have no heading
    timed |= any(cell.strip().lower() in DATES for cell in cells) and bool(cells & HEADINGS)
    return timed and any({f"x_{unit}", f"y_{unit}"} <= cells for unit in MM_PER)


def clock_zero_s(path: Path, topics: Topics | None = None) -> float:
    """Reading of the clock of a file of poses at time 0 of its recording. Raises InputError."""
    return read_with(lambda file: _zero_s(_as_stated(file, topics or Topics())["time_s"].to_numpy(float)), path)


def in_recording_s(stated_s: float, zero_s: float) -> float:
    """A time by the clock of a recording, counted from its beginning, at which the clock reads zero_s.

    If that clock counts from 1970, a stated time that does not is counted from the beginning already.
    """
    return stated_s - zero_s if abs(stated_s) > LARGEST_CLOCK_S else stated_s


def _read(path: Path, topics: Topics) -> PoseTable:
    raw = _as_stated(path, topics)
    zero_s = _zero_s(raw["time_s"].to_numpy(float))
    raw["time_s"] -= zero_s
    # a message that was delivered or recorded twice
    twice = repeats(raw[["time_s", "x_mm", "y_mm", "heading_deg"]].to_numpy(float))
    raw = raw[~twice]
    check_marks(raw.rename(columns={"x_mm": "center_x_mm", "y_mm": "center_y_mm"}), path)
    kept = ~held(raw[["x_mm", "y_mm", "heading_deg"]].to_numpy(float))
    table = raw[kept].reset_index(drop=True)
    stated = {"x_sigma_mm", "y_sigma_mm", "heading_sigma_deg"} <= set(table)
    if not stated:
        table = _with_noise(table)
    if "xy_cov_mm2" not in table:
        table["xy_cov_mm2"] = 0.0
    if not table["x_mm"].notna().any():
        raise InputError(f"{path}: no row holds a pose")
    return PoseTable(table, int((~kept).sum()), zero_s, stated, int(twice.sum()))


def _as_stated(path: Path, topics: Topics) -> pd.DataFrame:
    """The columns of a PoseTable that a file or a bag has, with times of its clock."""
    return _of_bag(path, topics) if is_bag(path) else _columns(path)


def _zero_s(time_s: Array) -> float:
    first = time_s[np.isfinite(time_s)][:1]
    return float(np.floor(first[0])) if len(first) and abs(first[0]) > LARGEST_CLOCK_S else 0.0


def held(values: Array) -> NDArray[np.bool_]:
    """Rows (n,) of values (n, k) that repeat the one before, if the file repeats values during motion.

    A robot at rest has equal poses, too, if they have no noise: one long group or a few. Repeated values of a sensor
    form many groups.
    """
    again = repeats(values) & np.isfinite(values).all(axis=1)
    starts = np.flatnonzero(~again)
    sizes = np.diff(np.r_[starts, len(values)])
    groups = int((sizes > 1).sum())
    return again if groups >= max(FEWEST_HELD, HELD_SHARE * len(sizes)) else np.zeros(len(values), dtype=np.bool_)


def _columns(path: Path) -> pd.DataFrame:
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    if _names_poses(table_head(lines).names):
        return _from_csv(path)
    said = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if said and len(said[0].split()) == KITTI_COLUMNS and _is_numbers(said[0], None, KITTI_COLUMNS):
        raise InputError(f"{path}: a trajectory in the format of KITTI has no times; write it in that of TUM")
    if said and _is_numbers(said[0], None, TUM_COLUMNS):
        return _from_quaternions(_numbers(path, said, None), 1.0, (4, 5, 6, 7))
    if said and _is_numbers(said[0], ",", TUM_COLUMNS):  # EuRoC: ns, x, y, z, qw, qx, qy, qz and further columns
        return _from_quaternions(_numbers(path, said, ","), SECONDS["ns"], (5, 6, 7, 4))
    return _from_csv(path)


def _of_bag(path: Path, topics: Topics) -> pd.DataFrame:
    time_s, pose, covariance = read_trajectory(path, topics)
    found = {
        "time_s": time_s,
        "x_mm": MM_PER["m"] * pose[:, 0],
        "y_mm": MM_PER["m"] * pose[:, 1],
        "heading_deg": np.degrees(pose[:, 2]),
    }
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    if (sigma > 0).all():  # if some are unknown, the noise is estimated from the poses
        found |= {"x_sigma_mm": MM_PER["m"] * sigma[:, 0], "y_sigma_mm": MM_PER["m"] * sigma[:, 1]}
        found |= {"heading_sigma_deg": np.degrees(sigma[:, 2]), "xy_cov_mm2": MM_PER["m"] ** 2 * covariance[:, 0, 1]}
    return pd.DataFrame(found)


def _is_numbers(line: str, delimiter: str | None, least: int) -> bool:
    cells = line.split(delimiter)
    try:
        return len([float(cell) for cell in cells]) >= least
    except ValueError:
        return False


def _numbers(path: Path, lines: list[str], delimiter: str | None) -> Array:
    rows = []
    for number, line in enumerate(lines, start=1):
        if not _is_numbers(line, delimiter, TUM_COLUMNS):
            raise InputError(f"{path}: pose {number} ({line[:40]!r}) is not a time, a place and a quaternion")
        rows.append([float(cell) for cell in line.split(delimiter)[:TUM_COLUMNS]])
    return np.array(rows)


def _from_quaternions(rows: Array, seconds: float, order: tuple[int, int, int, int]) -> pd.DataFrame:
    """Heading of the body's x axis over the plane of x and y; order: columns of qx, qy, qz, qw."""
    heading = heading_rad(*rows[:, list(order)].T)
    return pd.DataFrame(
        {
            "time_s": seconds * rows[:, 0],
            "x_mm": MM_PER["m"] * rows[:, 1],
            "y_mm": MM_PER["m"] * rows[:, 2],
            "heading_deg": np.degrees(heading),
        }
    )


def _from_csv(path: Path) -> pd.DataFrame:
    table = with_plain_columns(read_table(path))
    found: dict[str, Array] = {}
    _take(path, table, "time", SECONDS, "s", found)
    for name in ("x", "y", "x_sigma", "y_sigma"):
        _take(path, table, name, MM_PER, "mm", found)
    for name in ("heading", "heading_sigma"):
        if name == "heading" and set(QUATERNION) <= set(table):
            found["heading_deg"] = np.degrees(heading_rad(*(_column(path, table, part) for part in QUATERNION)))
            continue
        _take(path, table, name, {unit: np.degrees(size) for unit, size in RAD_PER.items()}, "deg", found)
    _take(path, table, "xy_cov", {f"{unit}2": size**2 for unit, size in MM_PER.items()}, "mm2", found)
    missing = [name for name in ("time_s", "x_mm", "y_mm", "heading_deg") if name not in found]
    if missing:
        raise InputError(
            f"{path}: lacks {', '.join(missing)}; poses have time_s, x_mm, y_mm, heading_deg "
            f"(or time_ns, timestamp in ISO 8601, x_m, heading_rad, qx, qy, qz, qw; "
            f"found: {', '.join(map(str, table.columns))})"
        )
    return pd.DataFrame(found)


def _take(
    path: Path, table: pd.DataFrame, name: str, units: dict[str, float], wanted: str, found: dict[str, Array]
) -> None:
    """Add a column to found, converted to the wanted unit."""
    there = [unit for unit in units if f"{name}_{unit}" in table]
    if len(there) > 1:
        raise InputError(f"{path}: {' and '.join(f'{name}_{unit}' for unit in there)}; keep one of them")
    for unit in there:
        found[f"{name}_{wanted}"] = units[unit] * _column(path, table, f"{name}_{unit}")


def _column(path: Path, table: pd.DataFrame, name: str) -> Array:
    values = numbers_of(table[name])
    bad = values.isna() & table[name].notna()
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        cell = quoted(table[name].iloc[row])
        raise InputError(f"{path}: line {line_of(table, row)}, {name} = {cell} is not a number")
    return values.to_numpy(float)


def _with_noise(table: pd.DataFrame) -> pd.DataFrame:
    """The table with noise estimated from its poses: one value for both coordinates, one for the heading."""
    there = table[["x_mm", "y_mm", "heading_deg"]].notna().all(axis=1).to_numpy()
    time = table["time_s"].to_numpy(float)[there]
    x, y = (table[name].to_numpy(float)[there] for name in ("x_mm", "y_mm"))
    heading = unwrapped_across_gaps(time, np.radians(table["heading_deg"].to_numpy(float)[there]))
    place = np.sqrt((scatter(time, x) ** 2 + scatter(time, y) ** 2) / 2)
    result = table.copy()
    for name in ("x_sigma_mm", "y_sigma_mm"):
        result[name] = max(place, LEAST_SIGMA_MM)
    result["heading_sigma_deg"] = np.degrees(max(scatter(time, heading), LEAST_SIGMA_RAD))
    return result


def scatter(time_s: Array, values: Array) -> float:
    """Standard deviation of the noise of values (n,): the median about parabolas in time fitted to neighbours."""
    if len(values) < NEIGHBOURS:
        return 0.0
    windows = np.lib.stride_tricks.sliding_window_view
    times, parts = windows(time_s, NEIGHBOURS), windows(values, NEIGHBOURS)
    since = times - times.mean(axis=1, keepdims=True)
    basis = np.linalg.qr(np.stack([np.ones_like(since), since, since**2], axis=2))[0]
    fitted = np.einsum("nik,nk->ni", basis, np.einsum("nik,ni->nk", basis, parts))
    squares = np.sum((parts - fitted) ** 2, axis=1)
    return float(np.sqrt(np.median(squares) / MEDIAN_OF_CHI2[NEIGHBOURS - 3]))


def poses_of(table: pd.DataFrame) -> Poses:
    """Poses from the table of a PoseTable."""
    time = table["time_s"].to_numpy(float)
    pose = table[["x_mm", "y_mm", "heading_deg"]].to_numpy(float)
    there = np.isfinite(pose).all(axis=1)
    pose = np.where(there[:, None], pose, np.nan)
    sigma = table[["x_sigma_mm", "y_sigma_mm", "heading_sigma_deg"]].to_numpy(float) * [1.0, 1.0, np.pi / 180]
    covariance = sigma[:, :, None] ** 2 * np.eye(3)
    covariance[:, 0, 1] = covariance[:, 1, 0] = table["xy_cov_mm2"].to_numpy(float)
    return Poses(
        time_s=time,
        x_mm=pose[:, 0],
        y_mm=pose[:, 1],
        heading_rad=unwrapped_across_gaps(time, np.radians(pose[:, 2])),
        covariance=covariance,
        status=np.where(there, OK, "no pose in the file").astype(str),
    )


def with_marks(table: pd.DataFrame, geometry: MarkGeometry) -> pd.DataFrame:
    """The table with the marks of a robot computed from its poses, for functions that use marks."""
    x, y, heading = (table[name].to_numpy(float) for name in ("x_mm", "y_mm", "heading_deg"))
    result = table.copy()
    for name, place in geometry.places_mm.items():
        points = plate_from_body(np.broadcast_to(place, (len(table), 2)), x, y, np.radians(heading))
        result[[f"{name}_x_mm", f"{name}_y_mm"]] = points
    return result
