"""Sessions: output folders of `turnscope analyze` and `diagnose`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from evaluator.errors import InputError
from evaluator.files.csv_tables import read_table
from evaluator.trends.changes import Level
from evaluator.turning.motion.curvature import Z_975
from evaluator.turning.pooling import Pooled, pooled

Array = NDArray[np.float64]
UNITS = {"radius": "mm", "curvature": "1/m", "speed": "mm/s"}


@dataclass(frozen=True)
class Session:
    """One analysed experiment. levels: by name of the series; see `read_session`."""

    name: str
    folder: Path
    day: date | None
    levels: Mapping[str, Level]
    units: Mapping[str, str] = field(default_factory=dict)


def read_sessions(folders: Sequence[Path]) -> tuple[Session, ...]:
    """Sessions in the order of their dates; in the given order if no session has a date.

    Raises InputError for a folder without results or given twice, and if only some sessions have a date.
    """
    places = [Path(folder).resolve() for folder in folders]
    if twice := next((folder for k, folder in enumerate(folders) if places[k] in places[:k]), None):
        raise InputError(f"{twice}: is given twice; a session is compared with others, not with itself")
    sessions = [read_session(folder) for folder in folders]
    dated = [session for session in sessions if session.day is not None]
    if dated and len(dated) < len(sessions):
        missing = next(session for session in sessions if session.day is None)
        raise InputError(
            f"{missing.folder}: its experiment has no date, but {dated[0].folder} has; write date = 2026-03-12 (of "
            "the recording) into every experiment.toml and run `turnscope analyze` again, or into none"
        )
    if dated:
        sessions.sort(key=lambda session: cast("date", session.day))
    return tuple(sessions)


def read_session(folder: Path) -> Session:
    """Series of one session: radius and speed of every command, and the effects found by a diagnosis with their sizes.

    Raises InputError if the folder contains no readable results.
    """
    folder = Path(folder)
    turning, provenance = folder / "turning.csv", folder / "provenance.json"
    if not turning.is_file() or not provenance.is_file():
        raise InputError(
            f"{folder}: no turning.csv and provenance.json in it; expected a results folder of `turnscope analyze`"
        )
    try:
        table = read_table(turning)
        made_from = json.loads(provenance.read_text(encoding="utf-8"))
        settings = made_from["settings"]
        name, day = str(settings["name"]), settings.get("date")
        found, units = _turning_levels(table, _camera(made_from))
        for series, level, unit in _diagnosed(folder / "diagnosis.json"):
            found[series], units[series] = level, unit
        return Session(name, folder, None if day is None else date.fromisoformat(str(day)), found, units)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{folder}: its results cannot be read ({error}); run `turnscope analyze` again") from error


def _camera(made_from: Mapping[str, Any]) -> str:
    """Key of a session's calibration: sessions with the same camera file share its errors."""
    camera = made_from["settings"].get("camera")
    return str(made_from["inputs_sha256"].get(camera, "")) if camera else ""


def _turning_levels(table: pd.DataFrame, camera: str) -> tuple[dict[str, Level], dict[str, str]]:
    levels: dict[str, Level] = {}
    units: dict[str, str] = {}
    there = table[table["speed_mm_s"].notna()]
    group = there["group"].astype("string").fillna("") if "group" in there else pd.Series("", index=there.index)
    for key, rows in there.assign(group=group).groupby(["group", "left_rpm", "right_rpm"], sort=False):
        label, left, right = cast("tuple[str, float, float]", key)
        command = " ".join(filter(None, (f"{left:g} / {right:g} rpm", label)))
        scale = _relative_systematic(rows)
        for quantity, values, sigmas in _quantities(rows, straight=left == right):
            value = pooled(values, sigmas)
            if np.isfinite(value.mean) and np.isfinite(value.error):
                levels[f"{quantity}, {command}"] = _level(value, scale * abs(value.mean), camera)
                units[f"{quantity}, {command}"] = UNITS[quantity]
    return levels, units


def _quantities(rows: pd.DataFrame, *, straight: bool) -> list[tuple[str, Array, Array]]:
    """Values of the runs of a command with their sigmas: the speed, and the radius, or the curvature 1/m if straight.

    The radius of a run that should be straight is known only where it is not, and is beyond all bounds where it is.
    """

    def column(name: str) -> Array:
        return rows[name].to_numpy(float)

    noise = "speed_random_mm_s" if "speed_random_mm_s" in rows else "speed_sigma_mm_s"  # of an earlier version
    found = [("speed", np.abs(column("speed_mm_s")), column(noise))]
    if not straight:
        return [("radius", np.abs(column("radius_mm")), column("radius_random_mm")), *found]
    if "curvature_per_mm" not in rows:  # results of an earlier version
        return found
    sigma = (column("curvature_high_per_mm") - column("curvature_low_per_mm")) / (2 * Z_975)
    return [("curvature", 1000 * column("curvature_per_mm"), 1000 * sigma), *found]


def _relative_systematic(rows: pd.DataFrame) -> float:
    """Relative uncertainty of a length by the camera: that of the radii, which holds for the speeds as well.

    The places of the marks on the robot are the same in all sessions.
    """
    by_marks = rows.get("radius_by_marks_mm", 0.0)  # none in results of an earlier version
    by_camera = np.sqrt(np.maximum(rows["radius_systematic_mm"] ** 2 - by_marks**2, 0.0))
    share = (by_camera / rows["radius_mm"]).median()
    return float(share) if np.isfinite(share) else 0.0


def _level(value: Pooled, systematic: float, source: str) -> Level:
    return Level(value.mean, value.error, value.freedom, systematic, source, repeated=value.runs > 1)


def _diagnosed(path: Path) -> list[tuple[str, Level, str]]:
    """Parameters of the named effects if there is a diagnosis beside the results; errors from their intervals."""
    if not path.is_file():
        return []
    found = json.loads(path.read_text(encoding="utf-8"))
    effects = found["effects"] if found["verdict"] == "effect" else []
    return [
        (
            f"{effect['id']}, {name}",
            Level(float(said["value"]), (float(said["high"]) - float(said["low"])) / (2 * Z_975), np.inf),
            "",
        )
        for effect in effects
        for name, said in effect["parameters"].items()
    ]
