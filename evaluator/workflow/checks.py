"""All errors in the files of an experiment, found without analysing it."""

from __future__ import annotations

import filecmp
import math
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from evaluator.errors import InputError
from evaluator.files import read_with, refuse_stream
from evaluator.settings import Experiment, Run, load_experiment
from evaluator.workflow.runs.implausible import doubts_of_robots
from evaluator.workflow.runs.mistakes import given_marks, mistakes_of_marks
from evaluator.workflow.runs.stored_diagnosis import own_effect_ids
from simulator.files.named import named_in

if TYPE_CHECKING:
    from evaluator.interchange.tracker_faults import Mended


HEAD_BYTES = 65_536  # of a video: those with another begin or size need not be compared whole


@dataclass(frozen=True)
class Written:
    """What experiment.toml says, also where it has faults; read once, as it may name thousands of files.

    marks: of the marks files that could be read, by path.
    """

    path: Path
    content: dict[str, Any]
    marks: dict[Path, Mended] = field(default_factory=dict)

    @cached_property
    def folder(self) -> Path:
        """Where relative paths begin."""
        return self.path.resolve().parent

    @cached_property
    def marks_of_robot(self) -> tuple[str, ...]:
        """Marks of the robot; none if it cannot be read, which is reported for the robot."""
        from evaluator.settings import load_any_robot, robot_named_in
        from simulator.errors import SimulationError

        try:
            return tuple(load_any_robot(Path(robot_named_in(self.path, str(self.content.get("robot", ""))))).points_mm)
        except (OSError, ValueError, SimulationError):
            return ()


@dataclass(frozen=True)
class Check:
    """Result of a check: faults that prevent an analysis, probable mistakes, number of runs and videos.

    unseen: runs without a video whose motion could not be compared with their commands. notes: what is mended in marks
    files of turnscope's form without being asked.
    """

    faults: tuple[str, ...]
    runs: int = 0
    videos: int = 0
    mistakes: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def check_experiment(path: Path) -> Check:
    """Read experiment.toml and every file it names; each fault is one sentence."""
    path = Path(path)
    faults: list[str] = []
    experiment: Experiment | None = None
    try:
        experiment = read_with(load_experiment, path)
    except InputError as error:
        faults.append(str(error))
    written = _written(path)
    faults += _faults_of_named_files(written) if written else ()
    runs, marks = experiment.run if experiment else (), written.marks if written else {}
    faults += [fault for run in runs for fault in _faults_of_topics(run)]
    faults += [fault for run in runs if (fault := _outside(run, marks))]
    if experiment is not None:
        faults += _faults_of_sizes(experiment)
        faults += _fault(partial(own_effect_ids, experiment=experiment), path)
    mistakes: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()
    if experiment is not None and not faults:
        from evaluator.workflow.runs.given import converted_marks  # with all readers of other programs' files

        given = given_marks(experiment)
        with TemporaryDirectory() as folder:
            converted = converted_marks(experiment, given, Path(folder))
            outside = (_outside_of_marks(run, converted[run.id]) for run in runs if run.marks and run.id in converted)
            faults += filter(None, outside)
            given |= converted
            found = mistakes_of_marks(experiment, given, marks)
        unseen = tuple(run.id for run in runs if run.video is None and run.id not in given and run.source.exists())
        doubts = (*doubts_of_robots(experiment), *doubled_videos(experiment.run))
        mistakes = (*doubts, *(item.sentence for item in found))
    videos = sum(run.video is not None for run in runs)
    notes = tuple(f"{run.id}: {note}" for run in runs if run.marks in marks for note in marks[run.marks].notes)
    return Check(tuple(dict.fromkeys(faults)), len(runs), videos, mistakes, unseen, notes)


def doubled_videos(runs: Sequence[Run]) -> Iterator[str]:
    """Runs whose video is that of an earlier run, byte for byte, over a part of the time that the earlier run shows."""
    alike: dict[tuple[int, bytes], list[tuple[Run, Path]]] = {}
    for run in runs:
        if run.video is None or not run.video.is_file():
            continue
        with run.video.open("rb") as file:
            earlier = alike.setdefault((run.video.stat().st_size, file.read(HEAD_BYTES)), [])
        for other, video in earlier:
            if _overlap(run, other) and (video == run.video or filecmp.cmp(video, run.video, shallow=False)):
                yield (
                    f"{run.id}: its video {run.video.name} is that of {other.id}, byte for byte; "
                    "is it the right recording?"
                )
                break
        earlier.append((run, run.video))


def _overlap(run: Run, other: Run) -> bool:
    """Whether two runs in one recording are at the same time; without a stop a run lasts to its end."""
    return all(
        first.start_s < (math.inf if second.stop_s is None else second.stop_s)
        for first, second in ((run, other), (other, run))
    )


def _faults_of_sizes(experiment: Experiment) -> Iterator[str]:
    """Images without a rate, and recordings of another size than the images that their camera was calibrated with."""
    from calibration.store import load_camera
    from evaluator.recording import open_recording
    from evaluator.tracking import of_another_size

    for run in experiment.run:
        if run.video is None or run.camera is None:
            continue
        try:
            found, expected = open_recording(run.video, rate_hz=run.rate_hz).size_px, load_camera(run.camera).size_px
        except InputError as error:
            yield str(error)
            continue
        except (OSError, ValueError):
            continue  # reported for the file itself
        if found != expected:
            yield f"{run.id}: {run.video}: {of_another_size(found, expected)}"


def _faults_of_topics(run: Run) -> Iterator[str]:
    """Faults of recordings of ROS and of logs of velocities, which only the run with its topics can read."""
    from evaluator.interchange.bags import is_bag
    from evaluator.interchange.poses import read_poses

    try:
        if run.poses is not None and is_bag(run.poses):
            read_poses(run.poses, run.topics)
        log = run.commands
        if log is not None and (is_bag(log) or not list(_faults_of_log(log))):
            run.run_command()
    except InputError as error:
        yield str(error)


def _outside(run: Run, marks: Mapping[Path, Mended]) -> str | None:
    """The fault of motors that start or stop outside the recording, by the duration that the container states."""
    from evaluator.interchange.tracks import program_of
    from evaluator.recording import open_recording

    try:
        if run.video is not None:
            last = open_recording(run.video, rate_hz=run.rate_hz).expected_s
            return run.outside(run.run_command(), 0.0, last) if last is not None else None
        if run.marks is not None and (run.marks in marks or program_of(run.marks) == "turnscope"):
            return _outside_of_marks(run, run.marks, marks.get(run.marks))
        return _outside_of_poses(run, run.poses) if run.poses is not None else None
    except (InputError, OSError):
        return None  # reported for the file itself


def _outside_of_marks(run: Run, path: Path, found: Mended | None = None) -> str | None:
    """The fault of a run with marks; path: of its marks CSV, found: its content, if it has been read."""
    from evaluator.marks import read_marks

    times = found.time_s if found else read_marks(path)["time_s"].to_numpy(float)
    return run.outside(run.run_command(), float(times[0]), float(times[-1]))


def _outside_of_poses(run: Run, path: Path) -> str | None:
    """The fault of a run with poses, with the start that the motion shows."""
    from evaluator.interchange.poses import poses_of, read_poses

    poses, command = poses_of(read_poses(path, run.topics).table), run.run_command()
    fault = run.outside(command, float(poses.time_s[0]), float(poses.time_s[-1]))
    if fault is None:
        return None
    from evaluator.workflow.runs.phases import start_by_motion  # loads scipy.signal, which takes a second

    return fault + start_by_motion(run, command, poses)


def _written(path: Path) -> Written | None:
    """What an experiment says; None if it cannot be read, which is reported for the experiment."""
    try:
        refuse_stream(path)
        return Written(path, tomllib.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, RecursionError):
        return None


def _faults_of_named_files(written: Written) -> Iterator[str]:
    """Faults of the files an experiment names, even if the experiment itself has faults."""
    runs = written.content.get("run", [])
    tables = [written.content]
    tables += [run for run in runs if isinstance(run, dict)] if isinstance(runs, list) else []
    for key, check in CHECKS.items():
        for name in dict.fromkeys(table[key] for table in tables if isinstance(table.get(key), str)):
            outside = list(_fault(partial(named_in, name=name), written.path))
            yield from outside or check(written, name)


def _robot(written: Written, name: str) -> Iterator[str]:
    from evaluator.settings import load_any_robot, robot_named_in

    yield from _fault(load_any_robot, Path(robot_named_in(written.path, name)))


def _camera(written: Written, name: str) -> Iterator[str]:
    from calibration.store import load_camera

    yield from _fault(load_camera, written.folder / name)


def _tracking(written: Written, name: str) -> Iterator[str]:
    from evaluator.tracking.settings import load_settings

    yield from _fault(load_settings, written.folder / name)


def _video(written: Written, name: str) -> Iterator[str]:
    from evaluator.recording import has_no_clock, open_recording

    video = written.folder / name
    if not video.exists() or not has_no_clock(video):  # images are opened with the rate of their run
        yield from _fault(open_recording, video)


def _marks(written: Written, name: str) -> Iterator[str]:
    """Read a marks file as the analysis does, except for the conversion of px by the camera."""
    from evaluator.interchange.tracker_faults import mended
    from evaluator.interchange.tracks import Tracks, program_of, read_points
    from evaluator.marks import mark_names, read_marks

    try:
        tracks = Tracks.model_validate(written.content.get("tracks", {}))
    except ValueError:
        return  # reported already
    path, names = written.folder / name, written.marks_of_robot
    found: list[str] = []

    def read(file: Path) -> None:
        if program_of(file) == "turnscope":
            table = read_marks(file, names or None)
            if not (found_names := mark_names(table)):  # the robot and the names of its marks are unknown
                raise InputError(f"{file}: holds no mark; expected columns NAME_x_mm and NAME_y_mm")
            written.marks[file] = mended(table, found_names)
            return
        _, points, _ = read_points(file, tracks, marks=names)
        found.extend(mark for mark in points if mark in names)

    yield from _fault(read, path)
    if len(found) == 1 and len(names) > 1:
        yield f"{path}: holds the {found[0]} mark alone; a pose needs two (its name: [tracks] of {written.path})"


def _poses(written: Written, name: str) -> Iterator[str]:
    from evaluator.interchange.bags import is_bag
    from evaluator.interchange.poses import read_poses

    if not is_bag(written.folder / name):  # recordings of ROS are read with the topics of their run
        yield from _fault(read_poses, written.folder / name)


def _commands(written: Written, name: str) -> Iterator[str]:
    yield from _faults_of_log(written.folder / name)


def _faults_of_log(path: Path) -> Iterator[str]:
    from evaluator.interchange.bags import Topics, is_bag
    from evaluator.interchange.commands import from_log

    if not is_bag(path):  # the wheels are checked with the topics of the run
        any_wheels = Topics(wheel_radius_m=1.0, track_m=1.0)
        yield from _fault(lambda log: from_log(log, topics=any_wheels), path)


def _fault(load: Callable[[Path], Any], path: Path) -> Iterator[str]:
    from calibration.errors import CalibrationError
    from simulator.errors import SimulationError

    try:
        read_with(load, path)
    except (InputError, CalibrationError, SimulationError) as error:
        yield str(error)


CHECKS: dict[str, Callable[[Written, str], Iterator[str]]] = {
    "robot": _robot,
    "camera": _camera,
    "tracking": _tracking,
    "video": _video,
    "marks": _marks,
    "poses": _poses,
    "commands": _commands,
}
