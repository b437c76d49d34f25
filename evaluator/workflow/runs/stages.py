"""Stages of one run: track, turn, simulate; each is cached and reused while it is up to date.

A stage reads the files of the stage before it, not its values in memory, so that an interrupted and an uninterrupted
analysis give identical files.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from calibration.camera import Camera
from evaluator.comparison import comparison_row, simulated_path, simulated_poses
from evaluator.errors import InputError
from evaluator.files import read_with, write_text
from evaluator.files.csv_tables import write_table
from evaluator.interchange.commands import RunCommand
from evaluator.interchange.poses import poses_of
from evaluator.mark_geometry import MarkGeometry, equal_height_mm
from evaluator.marks import read_marks, write_marks
from evaluator.pose import Poses, poses_from_marks
from evaluator.progress import Progress, no_progress
from evaluator.recording import TimingReport, open_recording
from evaluator.robot_geometry import RobotGeometry, robot_shape, sought
from evaluator.tracking import (
    AsCalibrated,
    WithPlate,
    correct,
    load_settings,
    motion_at_rest,
    of_common_readouts,
    place_on_plate,
    read_corrections,
    repeated_note,
    track,
)
from evaluator.turning import Turning
from evaluator.wording import counted
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.results.unchanged import CHANGED, AsFound
from evaluator.workflow.runs.given import read_given
from evaluator.workflow.runs.job import Job, RunResult
from evaluator.workflow.runs.phases import Phase, phases_of, rows_of, start_by_motion
from evaluator.workflow.runs.thumbnails import WithThumbnails
from simulator.robot import Robot


def bring_up_to_date(job: Job, progress: Progress = no_progress) -> RunResult:
    """Compute every stage of a job that is not up to date. Raises for an input that cannot be used.

    progress: of the tracking of a video.
    """
    return _Stages(job, progress).result()


class _Stages:
    """The stages of one run, each computed at most once."""

    def __init__(self, job: Job, progress: Progress) -> None:
        self.job = job
        self.progress = progress
        self.run = job.run
        self.out = Outputs(job.out)
        self.record = job.record()
        self.found = AsFound.of(job.files)
        self.keys = job.keys()
        self.reused = True

    def result(self) -> RunResult:
        """Bring every stage up to date."""
        values = {stage: self._bring_up_to_date(stage) for stage in self.job.stages}
        return RunResult.of(self.job, values, reused=self.reused)

    def _bring_up_to_date(self, stage: str) -> dict[str, Any]:
        cached = self.record.fresh(stage, self.keys[stage])
        if cached is not None:
            return cached
        self.reused = False
        compute = {"track": self._track, "turn": self._turn, "simulate": self._simulate}[stage]
        files, values = compute()
        self._refuse_changed(stage, files)
        return self.record.keep(stage, self.keys[stage], files, values)

    def _refuse_changed(self, stage: str, files: list[Path]) -> None:
        """Remove results of a file that changed while it was read, because their key is wrong, and raise InputError."""
        changed = self.found.changed()
        if changed and self.job.keys()[stage] != self.keys[stage]:
            for file in files:
                file.unlink(missing_ok=True)
            raise InputError(f"{changed[0]}: {CHANGED}")

    @cached_property
    def camera(self) -> Camera | None:
        if self.job.camera is None:
            return None
        from calibration.store import load_camera

        camera: Camera = read_with(load_camera, self.job.camera)
        return camera

    @cached_property
    def marks(self) -> pd.DataFrame:
        return read_marks(self.out.marks(self.run.id))

    @cached_property
    def poses(self) -> Poses:
        if self.run.poses is not None:
            return poses_of(self.marks)
        return poses_from_marks(self.marks, MarkGeometry.of_robot(self.job.robot), camera=self.camera)

    @cached_property
    def run_command(self) -> RunCommand:
        return self.run.run_command()

    @cached_property
    def phases(self) -> tuple[Phase, ...]:
        return phases_of(self.run_command, self.poses, robot_shape(self.job.robot))

    def _height_mm(self) -> float:
        return equal_height_mm(self.job.robot.layout, self.job.robot.name)

    def _track(self) -> tuple[list[Path], dict[str, Any]]:
        path, thumbnails = self.out.marks(self.run.id), self.out.thumbnails(self.run.id)
        if self.run.video is None:
            given = read_given(self.run, self.job.robot, self.job.tracks, self.camera)
            write_marks(given.table, path)
            return [path], {"notes": given.notes}
        assert self.camera is not None
        # One decoder thread, because the other cores process other runs.
        recording = WithThumbnails(open_recording(self.run.video, rate_hz=self.run.rate_hz, threads=1))
        said = read_with(load_settings, self.job.tracking) if self.job.tracking else None
        settings = sought(RobotGeometry(self.job.robot.layout), said)
        frames = WithPlate(AsCalibrated(recording, self.camera))
        table = track(frames, settings, self.progress)
        moved = frames.found(table, settings.mark)
        of_marks = [*filter(None, [repeated_note(table), moved.note if moved else ""])]
        by_hand: list[str] = []
        if self.run.corrections is not None:
            corrections = read_corrections(self.run.corrections)
            table = correct(table, corrections, str(self.run.corrections))
            by_hand = [f"{counted(len(corrections), 'mark')} placed or removed by hand ({self.run.corrections.name})"]
        report = recording.report()
        _refuse_cut(recording, report, self.run.video)
        _refuse_unseen(table, [mark.name for mark in self.job.robot.layout], self.run.video)
        table = place_on_plate(table, self.camera, self._height_mm())
        readout = None if settings.shutter_stated else of_common_readouts(table, settings.mark, self.camera.size_px[1])
        write_marks(table, path)
        write_text(thumbnails, recording.to_json())
        return [path, thumbnails], {
            "notes": [*report.notes, *of_marks, *by_hand],
            "plate_moves": bool(moved),
            "readout": [readout.over_stated, readout.note] if readout else [],
            "last_s": float(report.last or 0),
        }

    def _turn(self) -> tuple[list[Path], dict[str, Any]]:
        fault = self.run.outside(self.run_command, float(self.poses.time_s[0]), float(self.poses.time_s[-1]))
        if fault is not None:
            raise InputError(fault + start_by_motion(self.run, self.run_command, self.poses))
        count = len(self.job.robot.points_mm)  # the path of a single mark is measured, without a heading
        if not (np.isfinite(self.poses.x_mm) if count == 1 else self.poses.measured).any():
            reasons, counts = np.unique(self.poses.status, return_counts=True)
            wanted = {1: "the mark", 2: "both marks"}.get(count, "two marks")
            raise InputError(f"no frame has a pose ({reasons[counts.argmax()]}); does it show {wanted}?")
        path = self.out.poses(self.run.id)
        write_table(pose_table(self.poses), path)
        rows = rows_of(self.phases, self.poses, robot_shape(self.job.robot))
        return [path], {"rows": rows, "spacing_scatter": self.poses.spacing_scatter(), "at_rest": self._at_rest()}

    def _at_rest(self) -> list[str]:
        """Note on a recording whose image moves before the motors start."""
        start_s = self.run_command.start_s if self.run_command.starts_at_rest else None
        if self.run.video is None or start_s is None:
            return []
        found = motion_at_rest(self.marks, [mark.name for mark in self.job.robot.layout], start_s)
        return [found.note] if found else []

    def _simulate(self) -> tuple[list[Path], dict[str, Any]]:
        assert isinstance(self.job.robot, Robot)  # jobs with simulation have a complete robot
        by_path = self.run.poses is None and len(self.job.robot.points_mm) == 1
        simulated = simulated_path if by_path else simulated_poses
        motion, seen = simulated(self.job.robot, self.run_command, self.poses, self.job.order)
        path, shape = self.out.simulated(self.run.id), robot_shape(self.job.robot)
        write_table(motion.to_table(), path)
        measured = self.record.stages["turn"]["values"]["rows"]
        rows = [
            phase.head | comparison_row(row, phase.of(self.poses), phase.of(seen), phase.measured(seen, shape))
            for phase, row in zip(self.phases, measured, strict=False)  # a log without a phase has a row all the same
        ]
        return [path], {"rows": rows or [comparison_row(measured[0], self.poses, seen, Turning())]}


def _refuse_cut(recording: WithThumbnails, report: TimingReport, video: Path) -> None:
    """Refuse a truncated recording; single lost frames are harmless, because each frame has its own time.

    report: of the recording, which has been read.
    """
    if report.interval is None or report.last is None:
        return
    # The commonest interval is longer than the mean one where a camera takes more frames a second for a while.
    there = max(1 + round(report.last / report.interval), report.frames)
    promised, promised_s = recording.expected_frames, recording.expected_s
    shown = promised - recording.left_out_frames  # an edit list cuts frames away without removing them from the file
    if promised and shown - there > promised / 100:
        promise = f"{report.frames} of the {shown} frames announced in the file are present"
    elif not promised and promised_s and promised_s / report.interval - there > there / 100:
        promise = f"the file announces {promised_s:.2f} s"
    else:
        return
    raise InputError(f"{video}: cut off after {float(report.last):.2f} s: {promise}; copy it again from the camera")


def _refuse_unseen(table: pd.DataFrame, marks: Sequence[str], video: Path) -> None:
    """Refuse a recording without a frame with enough marks: one of a single mark, two of several."""
    reasons = {}
    for mark in marks:
        status = table[f"{mark}_status"] if f"{mark}_status" in table else pd.Series(["not sought (tracking.toml)"])
        if not (status == "ok").any():
            reasons[mark] = status.mode().iloc[0]
    tags = [name for name in marks if f"{name}_corner1_x_px" in table and name not in reasons]
    if reasons and len(marks) - len(reasons) < min(2, len(marks)) and not tags:
        mark, reason = next(iter(reasons.items()))
        raise InputError(
            f"{video}: the {mark} mark is in none of {counted(len(table), 'frame')} ({reason}); "
            f"say its color, diameter_px and region_px in a tracking.toml"
        )


def pose_table(poses: Poses) -> pd.DataFrame:
    """Poses as a table: centre and heading with their standard uncertainty between frames, and the status."""
    sigma = np.sqrt(np.diagonal(poses.covariance, axis1=1, axis2=2))
    return pd.DataFrame(
        {
            "time_s": poses.time_s,
            "x_mm": poses.x_mm,
            "y_mm": poses.y_mm,
            "heading_deg": np.degrees(poses.heading_rad),
            "x_sigma_mm": sigma[:, 0],
            "y_sigma_mm": sigma[:, 1],
            "heading_sigma_deg": np.degrees(sigma[:, 2]),
            "status": poses.status,
        }
    )
