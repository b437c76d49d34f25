"""One run as a job: inputs, cache validity and result.

Light to import, because the parent process of a batch needs only this module; its workers import the other libraries.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibration.errors import CalibrationError
from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.interchange.tracks import Tracks, program_of
from evaluator.settings import Experiment, MeasuredRobot, Run, load_any_robot
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.results.validity import Record, file_hash, key_of
from simulator.errors import SimulationError
from simulator.own_effects.files import is_own, text_of
from simulator.robot import Robot, load_robot

# Marks are placed on a robot to some hundredths of a millimetre, 1 to 2 % of their distance; a wrong gauge or a wrong
# height of the marks causes a larger deviation.
SPACING_PERCENT = 3.0
# Scatter of the distance of the marks in a run, in percent and over the stated one, from which it is told. Of 38 drawn
# recordings (28 Nov) a cable over a mark and lamps reflected in both gave 1.6 % and 11, 3.5 % and 3.4; of the others
# none exceeded 1.8 times what is stated by more than 0.3 %.
VARIES_PERCENT, VARIES_TIMES = 1.0, 2.5
LATE_S = 0.1  # accuracy of times read by hand: a recording that ends when the motors stop is complete


@dataclass(frozen=True)
class Job:
    """One run to analyse: all inputs of a worker process."""

    run: Run
    robot: Robot | MeasuredRobot
    tracking: Path | None
    tracks: Tracks | None
    out: Path
    simulate: bool
    order: int = 0  # of the run within its session, from 0
    marks_only: bool = False  # for a diagnosis, which does not need the turning

    @property
    def stages(self) -> tuple[str, ...]:
        """Requested stages in order."""
        if self.marks_only:
            return ("track",)
        return ("track", "turn", "simulate") if self.simulate else ("track", "turn")

    @property
    def camera(self) -> Path | None:
        """The camera that places the marks; None for marks in mm and for poses."""
        if self.run.poses is not None:
            return None
        if self.run.marks is not None:
            unit = self.tracks.unit if self.tracks else None
            if unit not in (None, "px") or program_of(self.run.marks) == "turnscope":
                return None
        return self.run.camera

    @property
    def files(self) -> list[Path]:
        """Files that are read; their contents are part of the keys."""
        of_video = [self.tracking, self.run.corrections] if self.run.video else []
        return [path for path in (self.run.source, self.camera, self.run.commands, *of_video) if path]

    def record(self) -> Record:
        """The record of earlier results."""
        return Record.load(Outputs(self.out).record(self.run.id))

    def keys(self) -> dict[str, str]:
        """Hash of the inputs of each stage; it includes the key of the stage before.

        Raises OSError or InputError if an input cannot be read.
        """
        track = key_of(
            {
                "source": file_hash(self.run.source),
                "camera": file_hash(self.camera) if self.camera else None,
                "rate_hz": self.run.rate_hz,
                "tracking": file_hash(self.tracking) if self.tracking and self.run.video else None,
                "corrections": file_hash(self.run.corrections) if self.run.corrections and self.run.video else None,
                "tracks": self.tracks.model_dump() if self.tracks and self.run.marks else None,
                "topics": self.run.topics.model_dump() if self.run.topics and self.run.poses else None,
                "marks": [mark.model_dump() for mark in self.robot.layout],
            }
        )
        named = ("left_rpm", "right_rpm", "start_s", "stop_s", "starts_at_rest")
        command = {name: getattr(self.run, name) for name in named}
        command["commands"] = file_hash(self.run.commands) if self.run.commands else None
        command["topics"] = self.run.topics.model_dump() if self.run.topics and self.run.commands else None
        turn = key_of({"track": track, "command": command, **_shape_of(self.robot)})
        inputs = {"turn": turn, "robot": self.robot.model_dump(mode="json"), "order": self.order}
        entries = self.robot.effect if isinstance(self.robot, Robot) else ()
        own = {entry.id: text_of(entry.id) for entry in entries if is_own(entry.id)}
        simulate = key_of(inputs | ({"own": own} if own else {}))
        return {"track": track, "turn": turn, "simulate": simulate}


def _shape_of(robot: Robot | MeasuredRobot) -> dict[str, Any]:
    """Properties of a robot other than marks on which a measured turn depends: body and wheels."""
    if isinstance(robot, MeasuredRobot):
        return robot.model_dump(include={"body", "wheels", "wheel"})
    wheels = [wheel.model_dump(exclude={"slip", "attraction_mN"}) for wheel in robot.all_wheels]
    return {"body": robot.body.model_dump(), "wheels": wheels}


def jobs_of(experiment: Experiment, outputs: Outputs, *, simulate: bool) -> list[Job]:
    """The job of every run. Raises InputError for a robot that cannot be read, because it concerns all its runs."""
    robots: dict[str, Robot | MeasuredRobot] = {}
    load = load_robot if simulate else load_any_robot  # measurement needs only the marks of a robot
    for run in experiment.run:
        name = run.robot or experiment.robot
        if name not in robots:
            robots[name] = read_with(load, Path(name))
    # Absolute, because workers may have another working directory.
    shared = (experiment.tracking, experiment.tracks, outputs.folder.resolve(), simulate)
    return [
        Job(run, robots[run.robot or experiment.robot], *shared, order=order)
        for order, run in enumerate(experiment.run)
    ]


@dataclass(frozen=True)
class RunResult:
    """Result of one run: rows for the tables, one for each phase, or the reason why there are none.

    readout: of a shutter that is not stated, what it would do, over the uncertainty of the marks and as a note.
    at_rest: notes on motion before the start, where no motion of the plate is noted.
    """

    run: str
    turning: tuple[dict[str, Any], ...] = ()
    comparison: tuple[dict[str, Any], ...] = ()
    notes: tuple[str, ...] = ()  # peculiarities of the recording
    fault: str | None = None
    reused: bool = False  # from the cache
    readout: tuple[float, str] | None = None
    at_rest: tuple[str, ...] = ()

    @staticmethod
    def of(job: Job, values: dict[str, dict[str, Any]], *, reused: bool) -> RunResult:
        """The result of a job from the values of its stages."""
        rows, simulated = (tuple(values.get(stage, {}).get("rows", ())) for stage in ("turn", "simulate"))
        scatter = values.get("turn", {}).get("spacing_scatter", (0.0, 0.0))
        notes = (*_notes(job.run, values["track"], rows[0] if rows else {}), *_spacing_notes(*scatter))
        readout = tuple(values["track"].get("readout", ())) or None
        at_rest = () if values["track"].get("plate_moves") else tuple(values.get("turn", {}).get("at_rest", ()))
        return RunResult(job.run.id, rows, simulated, notes, reused=reused, readout=readout, at_rest=at_rest)


def _of_a_rise(hidden_s: float) -> str:
    """The part of a delay that may be half of a rise of the speed too short to be seen, as the end of a sentence."""
    if round(hidden_s, 3) <= 0:
        return ""
    return f"; if the speed takes up to {hidden_s:.3f} s to change, which would not show, half of that is included"


def spacing_note(ratio: float) -> Iterator[str]:
    """Note on marks whose distance is not that of the robot file; ratio: of both."""
    off = 100 * (ratio - 1)
    if abs(off) > SPACING_PERCENT:
        way = "farther apart" if off > 0 else "nearer"
        yield (
            f"the marks are {abs(off):.0f} % {way} than robot.toml says: either their positions there are off, or "
            "every length is by as much (is the scale or the pitch of the gauge right, the height of the marks?), or "
            "something else of a mark's colour is taken for it"
        )


def _spacing_notes(relative: float, over_stated: float) -> Iterator[str]:
    """Note on marks whose distance varies; relative, over_stated: of `Poses.spacing_scatter`."""
    if 100 * relative > VARIES_PERCENT and over_stated > VARIES_TIMES:
        yield (
            f"the distance of the marks varies by {100 * relative:.1f} %, {over_stated:.0f} times what their "
            "uncertainties state, so heading and radius may be off by more than their intervals: does something cover "
            "a part of a mark, or a lamp shine in it? Look at the overlay (turnscope track --overlay)"
        )


def _notes(run: Run, tracked: dict[str, Any], turning: dict[str, Any]) -> Iterator[str]:
    """Peculiarities of a recording; truncation of a stream without an index is detected by its command log."""
    yield from spacing_note(turning.get("mark_spacing_ratio", float("nan")))
    yield from tracked.get("notes", ())
    if "late_s" in turning and turning["late_high_s"] - turning["late_low_s"] < LATE_S < abs(turning["late_s"]):
        yield (
            f"moves {turning['late_s']:.3f} s later than its command log (95 % from "
            f"{turning['late_low_s']:.3f} to {turning['late_high_s']:.3f}): a clock that is off (start_s), or motors "
            f"that wait{_of_a_rise(turning.get('hidden_rise_s', 0.0))}"
        )
    if not math.isfinite(turning.get("late_s", 0.0)):
        yield (
            "the offset between its motion and its command log cannot be determined, because it does not move as the "
            "log commands, or too little of it is recorded; start_s is taken as stated"
        )
    last_s = tracked.get("last_s")
    if last_s is not None and run.stop_s is not None and run.stop_s > last_s + LATE_S:
        yield (
            f"ends at {last_s:.2f} s, before the motors are commanded off at {run.stop_s:g} s: "
            "is it cut off, or stop_s wrong?"
        )


def outdated_stages(job: Job) -> list[str]:
    """Stages of a job that are not up to date. Raises OSError if an input cannot be read."""
    record, keys = job.record(), job.keys()
    return [stage for stage in job.stages if record.fresh(stage, keys[stage]) is None]


def step_of(job: Job, stage: str) -> str:
    """Name of a stage of a job for people: given marks or poses are read, not tracked."""
    if stage != "track" or job.run.video is not None:
        return stage
    return "read marks" if job.run.marks is not None else "read poses"


def known_result(job: Job) -> RunResult | None:
    """The result of a job that needs no computation: up to date, or without a readable input; None otherwise."""
    record = job.record()
    try:
        keys = job.keys()
    except (OSError, InputError) as error:
        return failed(job, error)
    values = {stage: record.fresh(stage, keys[stage]) for stage in job.stages}
    there = {stage: value for stage, value in values.items() if value is not None}
    return RunResult.of(job, there, reused=True) if len(there) == len(values) else None


def failed(job: Job, error: Exception) -> RunResult:
    """The result of a job that ended in an error; results of earlier inputs are removed."""
    job.record().forget()
    source = str(job.run.source)
    reason = " ".join(_reason(error).split())
    about_file = any(str(path) in reason for path in (source, job.run.camera, job.tracking, job.run.commands) if path)
    return RunResult(job.run.id, fault=reason if about_file else f"{source}: {reason}")


def lost_run(job: Job) -> RunResult:
    """The result of a run whose worker process died."""
    return RunResult(
        job.run.id,
        fault="the process that analysed it was killed (out of memory?); try again with fewer --workers",
    )


def _reason(error: Exception) -> str:
    if isinstance(error, (InputError, CalibrationError, SimulationError)):
        return str(error)
    if isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {str(error.strerror).lower()}"
    place = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{Path(place.filename).name}, line {place.lineno}"
    return f"unexpected {type(error).__name__} in {where}: {error}; please report this with the recording"
