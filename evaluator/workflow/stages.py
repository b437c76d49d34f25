"""What is done for one run: track, turn, simulate; each stage is kept and reused while it is up to date.

A stage reads what the stage before it wrote (not what it had in memory), so that an analysis that was interrupted and
one that ran through give the same bytes.
"""

from __future__ import annotations

import traceback
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from calibration.camera import Camera
from calibration.errors import CalibrationError
from evaluator.comparison import comparison_row, simulated_counterpart
from evaluator.errors import InputError
from evaluator.files import read_with, write_table, write_text
from evaluator.marks import MARKS, read_marks, write_marks
from evaluator.pose import MarkGeometry, Poses, poses_from_marks
from evaluator.recording import open_recording
from evaluator.settings import Run
from evaluator.tracking import load_settings, place_on_plate, track
from evaluator.turning import Turning, measure_turning
from evaluator.workflow.freshness import Record, file_hash, key_of
from evaluator.workflow.glimpses import Glimpsed
from evaluator.workflow.outputs import Outputs
from simulator.errors import SimulationError
from simulator.robot import Robot


@dataclass(frozen=True)
class Job:
    """One run to analyse: everything a worker process needs to know."""

    run: Run
    robot: Robot
    tracking: Path | None
    out: Path
    simulate: bool


@dataclass(frozen=True)
class RunResult:
    """What came of one run: rows for the tables, or the one reason why there are none."""

    run: str
    turning: dict[str, Any] | None = None
    comparison: dict[str, Any] | None = None
    fault: str | None = None
    reused: bool = False  # nothing had to be computed


def analyse_run(job: Job) -> RunResult:
    """Analyse one run; a recording that cannot be used is a result with a reason, not an exception."""
    try:
        return _Stages(job).result()
    except (InputError, CalibrationError, SimulationError) as error:
        fault = str(error)
    except OSError as error:
        fault = f"{error.filename}: {error.strerror}" if error.filename else str(error)
    except Exception as error:  # noqa: BLE001 - a defect met in one run must not cost the others; it is reported
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}, line {place.lineno}"
        fault = f"unexpected {type(error).__name__} in {where}: {error}; please report this with the recording"
    Record.load(Outputs(job.out).record(job.run.id)).forget()
    return RunResult(job.run.id, fault=" ".join(fault.split()))


def lost_run(job: Job) -> RunResult:
    """The result of a run whose worker process died."""
    return RunResult(
        job.run.id,
        fault="the process that analysed it was killed (out of memory?); try again with fewer --workers",
    )


def stages_of(job: Job) -> tuple[str, ...]:
    """Stages that a job asks for, in their order."""
    return ("track", "turn", "simulate") if job.simulate else ("track", "turn")


def outdated_stages(job: Job) -> list[str]:
    """Stages of a job that are not up to date. Raises OSError where an input is missing."""
    return _Stages(job).outdated()


class _Stages:
    """The stages of one run, each computed at most once."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self.run = job.run
        self.out = Outputs(job.out)
        self.record = Record.load(self.out.record(job.run.id))
        self.reused = True

    def result(self) -> RunResult:
        """Bring every stage up to date."""
        values = {stage: self._bring_up_to_date(stage) for stage in stages_of(self.job)}
        return RunResult(self.run.id, turning=values["turn"], comparison=values.get("simulate"), reused=self.reused)

    def outdated(self) -> list[str]:
        """Stages that would have to be computed."""
        return [stage for stage in stages_of(self.job) if self.record.fresh(stage, self.keys[stage]) is None]

    @cached_property
    def keys(self) -> dict[str, str]:
        """What each stage is made from, as one hash; a stage's key holds that of the stage before it."""
        source, robot = self.run.video or self.run.marks, self.job.robot
        assert source is not None  # held by the model of the file
        track = key_of(
            {
                "source": file_hash(source),
                "camera": file_hash(self.run.camera) if self.run.camera else None,
                "tracking": file_hash(self.job.tracking) if self.job.tracking and self.run.video else None,
                "marks": robot.marks.model_dump(),
            }
        )
        command = {name: getattr(self.run, name) for name in ("left_rpm", "right_rpm", "start_s", "stop_s")}
        body = {"body": robot.body.model_dump(), "wheels": robot.wheels.model_dump()}
        turn = key_of({"track": track, "command": command, **body})
        simulate = key_of({"turn": turn, "robot": robot.model_dump(mode="json")})
        return {"track": track, "turn": turn, "simulate": simulate}

    def _bring_up_to_date(self, stage: str) -> dict[str, Any]:
        kept = self.record.fresh(stage, self.keys[stage])
        if kept is not None:
            return kept
        self.reused = False
        compute = {"track": self._track, "turn": self._turn, "simulate": self._simulate}[stage]
        files, values = compute()
        return self.record.keep(stage, self.keys[stage], files, values)

    @cached_property
    def camera(self) -> Camera | None:
        if self.run.camera is None:
            return None
        from calibration.store import load_camera  # type: ignore[import-not-found,unused-ignore]

        camera: Camera = read_with(load_camera, self.run.camera)
        return camera

    @cached_property
    def poses(self) -> Poses:
        marks = self.job.robot.marks
        geometry = MarkGeometry(green_mm=marks.green_mm, yellow_mm=marks.yellow_mm, height_mm=marks.height_mm)
        return poses_from_marks(read_marks(self.out.marks(self.run.id)), geometry, camera=self.camera)

    @cached_property
    def turning(self) -> Turning:
        return measure_turning(self.poses, start_s=self.run.start_s, stop_s=self.run.stop_s)

    def _track(self) -> tuple[list[Path], dict[str, Any]]:
        path, pictures = self.out.marks(self.run.id), self.out.pictures(self.run.id)
        if self.run.marks is not None:
            write_marks(read_marks(self.run.marks), path)
            return [path], {}
        assert self.run.video is not None  # either, says the model of the file
        assert self.camera is not None
        recording = Glimpsed(open_recording(self.run.video))
        settings = read_with(load_settings, self.job.tracking) if self.job.tracking else None
        table = track(recording, settings)
        notes = recording.report().notes
        for mark in MARKS:
            _refuse_unseen(table, mark, self.run.video)
        write_marks(place_on_plate(table, self.camera, self.job.robot.marks.height_mm), path)
        write_text(pictures, recording.to_json())
        return [path, pictures], {"notes": list(notes)}

    def _turn(self) -> tuple[list[Path], dict[str, Any]]:
        path = self.out.poses(self.run.id)
        write_table(pose_table(self.poses), path)
        return [path], self.turning.to_row()

    def _simulate(self) -> tuple[list[Path], dict[str, Any]]:
        counterpart = simulated_counterpart(self.job.robot, self.run, self.poses)
        path = self.out.simulated(self.run.id)
        write_table(counterpart.motion.to_table(), path)
        return [path], comparison_row(self.record.stages["turn"]["values"], self.poses, counterpart)


def _refuse_unseen(table: pd.DataFrame, mark: str, video: Path) -> None:
    status = table[f"{mark}_status"] if f"{mark}_status" in table else pd.Series(["not sought (tracking.toml)"])
    if not (status == "ok").any():
        reason = status.mode().iloc[0]
        raise InputError(
            f"{video}: the {mark} mark is in none of the {len(table)} pictures ({reason}); "
            f"say its color, diameter_px and region_px in a tracking.toml"
        )


def pose_table(poses: Poses) -> pd.DataFrame:
    """Poses as a table: centre and heading with their standard uncertainty from frame to frame, and the status."""
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
