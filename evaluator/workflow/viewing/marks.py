"""Candidates for marks in a frame, and edits of tracking.toml and of the manual corrections."""

from __future__ import annotations

import base64
import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from evaluator.errors import InputError
from evaluator.files import explain, named_from
from evaluator.workflow.editing.documents import change_document, read_document, replace_text, version_of
from evaluator.workflow.editing.unfinished import read_unfinished, run_of

if TYPE_CHECKING:
    from evaluator.recording import Frame
    from evaluator.tracking import TrackingSettings

TRACKING = "tracking.toml"
FRESH = "# Help for the tracker. Lengths in px, boxes as [left, top, right, bottom].\nformat = 1\n"
COLUMNS = ("frame", "mark", "x", "y")


@dataclass(frozen=True)
class TrackingFile:
    """The tracking.toml of an experiment: its path, whether or not it exists, version and content.

    sought: settings of the tracked marks by name: those of the robot if the file names none.
    """

    path: Path
    version: str
    said: dict[str, Any]
    sought: dict[str, Any]


def settings_of(said: Mapping[str, Any]) -> TrackingSettings:
    """Settings from the content of tracking.toml. Raises InputError with all faults."""
    from evaluator.tracking import TrackingSettings, load_settings

    try:
        return TrackingSettings.model_validate(dict(said))
    except ValidationError as error:
        raise InputError(explain(error, load_settings)) from error


def look_at(frame: Frame, settings: TrackingSettings) -> dict[str, Any]:
    """Mask, blobs and measured centre of every mark in a single frame, independent of other frames."""
    from evaluator.tracking import track
    from evaluator.tracking.detection.explain import explain as seen_in

    table = track([frame], settings)
    marks = {}
    for seen in seen_in(frame, settings):
        row = {part: table[f"{seen.mark}_{part}"].iloc[0] for part in ("x_px", "y_px", "x_sigma_px", "status")}
        blobs = [
            {
                "x_px": float(one.blob.center_px[0]),
                "y_px": float(one.blob.center_px[1]),
                "radius_px": float(one.blob.radius_px),
                "hue_deg": float(one.hue_deg),
                "verdict": one.verdict,
                "chosen": bool(one.chosen),
            }
            for one in seen.blobs
        ]
        marks[seen.mark] = {
            **{name: value if isinstance(value, str) else float(value) for name, value in row.items()},
            "mask": _png(seen.mask),
            "cell_px": list(seen.cell_px),
            "origin_px": list(seen.origin_px),
            "hue_range_deg": list(seen.hue_range_deg),
            "blobs": blobs,
        }
    return {"frame": frame.index, "time_s": frame.time_s, "marks": marks}


def tracking_file(experiment: Path) -> TrackingFile:
    """The tracking.toml of an experiment. Raises InputError."""
    from evaluator.robot_geometry import read_geometry, sought

    described = read_unfinished(experiment)
    path = described.tracking or experiment.resolve().parent / TRACKING
    document, version = read_document(path) if path.exists() else (None, "")
    said = {} if document is None else dict(document.unwrap())
    settings = sought(read_geometry(Path(described.robot)), settings_of(said) if said else None)
    marks = {name: mark.model_dump(mode="json", exclude_defaults=True) for name, mark in settings.mark.items()}
    return TrackingFile(path, version, said, marks)


def write_tracking(experiment: Path, version: str, said: Mapping[str, Any]) -> TrackingFile:
    """Write changes into the tracking.toml of an experiment, and name the file in the experiment.

    said: whole content of the file; comments of unchanged entries are kept. Raises ChangedMeanwhileError; InputError
    for faults.
    """
    settings_of(said)
    there = tracking_file(experiment)
    if not there.path.exists():
        replace_text(there.path, version, FRESH)
        version = version_of(there.path)

    def change(document: Any) -> None:
        _merge(document, {"format": 1, **said})

    change_document(there.path, version, change)
    if read_unfinished(experiment).tracking is None:
        name = named_from(experiment.resolve().parent, there.path)

        def naming(document: Any) -> None:
            document["tracking"] = name

        change_document(experiment, version_of(experiment), naming)
    return tracking_file(experiment)


def corrections_file(experiment: Path, run_id: str) -> Path:
    """Path of the corrections of a run, whether or not it exists."""
    return run_of(experiment, run_id).corrections or experiment.resolve().parent / f"{run_id}-corrections.csv"


def corrections_of(experiment: Path, run_id: str) -> tuple[list[dict[str, Any]], str]:
    """Rows of the corrections of a run, x and y None for a removed mark; and the version of the file."""
    from evaluator.tracking import read_corrections

    path = corrections_file(experiment, run_id)
    if not path.exists():
        return [], ""
    table = read_corrections(path)
    rows = [
        {"frame": int(frame), "mark": str(mark), "x": _known(x), "y": _known(y)}
        for frame, mark, x, y in table[list(COLUMNS)].itertuples(index=False)
    ]
    return rows, version_of(path)


def write_corrections(experiment: Path, run_id: str, version: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Write the corrections of a run, and name the file in the run; return the file's new version."""
    path = corrections_file(experiment, run_id)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in sorted(rows, key=lambda one: (one["frame"], one["mark"])):
        placed = row.get("x") is not None
        place = [f"{row['x']:.3f}", f"{row['y']:.3f}"] if placed else ["absent", ""]
        writer.writerow([row["frame"], row["mark"], *place])
    found = replace_text(path, version, text.getvalue())
    _, of_experiment = read_document(experiment)
    name = named_from(experiment.resolve().parent, path)

    def naming(document: Any) -> None:
        for run in document["run"]:
            if run.get("id") == run_id and run.get("corrections") != name:
                run["corrections"] = name

    change_document(experiment, of_experiment, naming)
    return found


def _merge(table: Any, said: Mapping[str, Any]) -> None:
    for key in [key for key in table if key not in said]:
        del table[key]
    for key, value in said.items():
        if isinstance(value, Mapping):
            if key not in table:
                table[key] = {}
            _merge(table[key], value)
        elif key not in table or table[key] != value:
            table[key] = value


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _png(mask: Any) -> str:
    import cv2
    import numpy as np

    done, data = cv2.imencode(".png", np.where(mask, 255, 0).astype(np.uint8))
    assert done
    return base64.b64encode(bytes(data)).decode()
