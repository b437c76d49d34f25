"""One recording to its marks CSV."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pandas as pd

from calibration.camera import Camera
from calibration.store import load_camera
from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.marks import write_marks
from evaluator.progress import Progress, no_progress
from evaluator.recording import Source, open_recording
from evaluator.robot_geometry import RobotGeometry, read_geometry, sought
from evaluator.tracking import (
    AsCalibrated,
    TrackingSettings,
    WithPlate,
    astray_note,
    correct,
    load_settings,
    of_common_readouts,
    place_on_plate,
    read_corrections,
    repeated_note,
    track,
)
from evaluator.tracking.observation import UNLIKE
from evaluator.wording import counted
from evaluator.workflow.execution.precompile import precompile_tracker
from evaluator.workflow.results.unchanged import CHANGED, AsFound
from evaluator.workflow.runs.job import spacing_note
from simulator.mark_layout import Mark

Fields = Literal["auto", "none", "top", "bottom"]


@dataclass(frozen=True, repr=False)
class Tracked:
    """A recording with the table of its marks, and the camera and robot that place them on the plate, if any."""

    recording: Source
    marks: pd.DataFrame
    notes: tuple[str, ...]
    names: tuple[str, ...]
    camera: Camera | None = None
    geometry: RobotGeometry | None = None

    @property
    def shares(self) -> dict[str, float]:
        """Share of the frames in which each mark is seen."""
        return {name: float(self.marks[f"{name}_x_px"].notna().mean()) for name in self.names}

    def __repr__(self) -> str:
        """One line: frames, and the share in which each mark is seen."""
        seen = ", ".join(f"{name} in {share:.1%}" for name, share in self.shares.items())
        return f"Tracked({counted(len(self.marks), 'frame')}, {seen})"


def not_looked_at(recording: Source, marks: pd.DataFrame, settings: TrackingSettings) -> None:
    """Do not show the search for marks."""
    del recording, marks, settings


def _colourless(recording: Source) -> bool:
    """Whether the first frame is grey; False for a stream that cannot be read again."""
    if getattr(recording, "live", False):
        return False
    first = next(iter(recording), None)
    return first is not None and first.colourless


def track_recording(
    video: Path | str,
    output: Path | str | None = None,
    *,
    settings: Path | None = None,
    camera: Path | None = None,
    robot: Path | str = "barrel",
    height_mm: float | None = None,
    rate_hz: float | None = None,
    fields: Fields = "auto",
    corrections: Path | None = None,
    looked_at: Callable[[Source, pd.DataFrame, TrackingSettings], None] = not_looked_at,
    where_to_look: str = "evaluator.report.measurement.search_sheet shows all candidates",
    progress: Progress = no_progress,
) -> Tracked:
    """Track the marks of a recording and write them as a marks CSV.

    settings: tracking.toml; camera: camera.json, without which marks have no position on the plate; height_mm: of the
    marks above the plate, by default that of the robot; rate_hz, fields: as for `open_recording`; corrections: CSV of
    manual corrections. looked_at: called with the tracked table, also if no mark was found, to show the search for
    marks; where_to_look: says in that case where it is shown.
    Raises InputError for a file that cannot be used or changes meanwhile, and if no mark is found in any frame.
    """
    wanted = read_with(load_settings, settings) if settings else None
    by_hand = read_corrections(corrections) if corrections else None
    seen_by = read_with(load_camera, camera) if camera is not None else None
    geometry = read_geometry(Path(robot))
    wanted = sought(geometry, wanted)
    read = AsFound.of([Path(video)])
    recording = open_recording(video, rate_hz=rate_hz, fields=fields)
    frames = WithPlate(recording if seen_by is None else AsCalibrated(recording, seen_by))
    precompile_tracker()
    marks = track(frames, wanted, progress)
    if read.changed():
        raise InputError(f"{video}: {CHANGED}")
    if by_hand is not None:
        marks = correct(marks, by_hand, str(corrections))
    looked_at(recording, marks, wanted)
    if not any(marks[f"{name}_x_px"].notna().any() for name in wanted.mark):
        missed = f"{video}: no mark was found in any of {counted(len(marks), 'frame')}"
        if any(mark.kind == "color" for mark in wanted.mark.values()) and _colourless(recording):
            raise InputError(
                f"{missed}: the recording has no colour; record in colour, or use lights or tags as marks"
                ' (kind = "light", "aruco" or "apriltag")'
            )
        if any((marks[f"{name}_status"] == UNLIKE).any() for name in wanted.mark):
            missed += ": objects of their colours never move and do not look like the two marks of a robot"
        raise InputError(
            f"{missed}; state color, diameter_px and region_px in a tracking.toml (--settings); {where_to_look}"
        )
    moved = frames.found(marks, wanted.mark)
    placing: list[str] = []
    if seen_by is not None:
        above_mm = geometry.height_mm if height_mm is None else height_mm
        marks = place_on_plate(marks, seen_by, above_mm)
        placing += spacing_note(_distance_ratio(marks, geometry.layout))
        if not marks[[f"{name}_x_mm" for name in wanted.mark]].notna().any(axis=None):
            placing.append(
                f"the camera does not see the plane {above_mm:g} mm above the plate, so that no mark is placed in mm: "
                "is it the robot of this recording (--robot), and the height of its marks (--height-mm)?"
            )
    if output is not None:
        write_marks(marks, Path(output))
    readout = None if wanted.shutter_stated else of_common_readouts(marks, wanted.mark, recording.size_px[1])
    of_marks = repeated_note(marks), astray_note(marks), moved.note if moved else "", readout.note if readout else ""
    notes = (*recording.report().notes, *filter(None, of_marks), *placing)
    return Tracked(recording, marks, notes, tuple(wanted.mark), seen_by, geometry)


def _distance_ratio(marks: pd.DataFrame, layout: Sequence[Mark]) -> float:
    """Median distance of the first two marks of a robot on the plate over that of its file; NaN where unknown."""
    if len(layout) < 2 or not all(f"{mark.name}_x_mm" in marks for mark in layout[:2]):
        return math.nan
    first, second = layout[:2]
    apart = [marks[f"{first.name}_{axis}_mm"] - marks[f"{second.name}_{axis}_mm"] for axis in ("x", "y")]
    stated = math.hypot(first.x_mm - second.x_mm, first.y_mm - second.y_mm)
    return float((apart[0] ** 2 + apart[1] ** 2).median() ** 0.5) / stated if stated else math.nan
