"""Preparation of the runs of an experiment for a diagnosis, and reasons why an experiment cannot be diagnosed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from calibration.store import load_camera
from evaluator.diagnosis.assessment.sole_run import FEWEST_RUNS
from evaluator.diagnosis.candidates.coordinates import is_full_size, on_open_ground
from evaluator.diagnosis.likelihood.known_to import LEVEL, Quantity, quantities, start_per_run_s
from evaluator.diagnosis.likelihood.noise.outliers import without_outliers, without_wrong_pairs
from evaluator.diagnosis.likelihood.run_data import SHARED_UNIT, RunData
from evaluator.diagnosis.likelihood.shared_errors import Sighting, plane_errors, shared_errors
from evaluator.diagnosis.long_sessions import LONGEST_S, NOT_NEEDED, PIECE_S, needed_runs, pieces_of
from evaluator.diagnosis.mistakes.frame_times import wrong_seconds
from evaluator.diagnosis.mistakes.misread.other_log import misassigned
from evaluator.diagnosis.mistakes.misread.pose_headings import in_another_convention
from evaluator.diagnosis.mistakes.recognise import recognise
from evaluator.diagnosis.mistakes.recognised import Mistake, mistakes_of, recording_of
from evaluator.diagnosis.mistakes.start.handling import between_hands
from evaluator.diagnosis.mistakes.start.log_clock import clocks_off
from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.interchange.tracker_faults import Mended, mended, without_faults
from evaluator.mark_geometry import equal_height_mm
from evaluator.marks import columns_of, is_of_film, mark_names, read_marks, require_marks
from evaluator.robot_geometry import reference_line, reference_marks, reference_pair
from evaluator.settings import Experiment, KnownTo, Relevant, Run
from evaluator.wording import counted
from simulator.robot import Robot, load_robot

Floats = NDArray[np.float64]

FEWEST_FRAMES = 12  # 0.2 s at 60 frames/s: a turn of some degrees, against 0.1 degrees of noise in a heading
# A 5 Hz lidar measures seven to eleven poses in two seconds. Three poses determine one mode of each coordinate and of
# the heading (features.compression). The start pose takes one mode of each, so that two are needed.
FEWEST_POSES = 6
FEWEST_COMMANDS = 2  # at a single command, an effect cannot be distinguished from a gain of the wheel speeds
ONE_PLACE = 1e-6  # of the distance of the marks: rounding in the file, far below the repeatability of any sensor


@dataclass(frozen=True)
class Session:
    """Usable runs, in the order of the experiment, their robots, and reasons why others cannot be used.

    known: quantities that the laboratory knows to a tolerance; start_sigma_s: uncertainty of the start of a single run.
    """

    data: tuple[RunData, ...]
    robots: tuple[Robot, ...]
    skipped: Mapping[str, str]
    known: tuple[Quantity, ...] = ()
    start_sigma_s: float = 0.0
    mistakes: tuple[Mistake, ...] = ()  # runs concerned are not in data
    aside: tuple[tuple[RunData, Robot], ...] = ()  # these runs
    explained: tuple[Mistake, ...] = ()  # that the effects found explain; their runs are in left_out
    relevant: Relevant = field(default_factory=Relevant)
    left_out: Mapping[str, str] = field(default_factory=dict)  # usable runs that are not used, with the reason
    own: tuple[str, ...] = ()  # ids of effects of the user, tried like those of the catalogue

    def of_runs(self, keep: Sequence[int]) -> Session:
        """The session with these runs only, by index."""
        return replace(self, data=tuple(self.data[k] for k in keep), robots=tuple(self.robots[k] for k in keep))

    def leaving_out(self, runs: Collection[int], reason: str) -> Session:
        """The session without these runs, by index, which are listed with the reason."""
        left_out = {**self.left_out, **{self.data[run].id: reason for run in sorted(runs)}}
        return replace(self.of_runs([k for k in range(len(self.data)) if k not in runs]), left_out=left_out)

    @property
    def one_frame(self) -> bool:
        """Whether the runs share a frame: not if the poses of most runs begin exactly at the same place.

        No measurement repeats a position to a millionth of the robot's size. Of a few runs the first poses may lack.
        """
        starts = np.array([run.marks_mm[0] for run in self.data if run.from_poses])
        if len(starts) < max(len(self.data), 2):
            return True
        apart = np.hypot(*(starts[0, :2] - starts[0, 2:]))
        off = np.abs(starts - np.median(starts, axis=0)).max(axis=1)
        return bool(np.mean(off <= ONE_PLACE * apart) <= 0.5)

    @property
    def commands_recur(self) -> bool:
        """Whether changes over the session can be distinguished from differences between commands.

        On a plate, yes: the model explains each command to the noise. On open ground the residuals of a model depend on
        the command, and imitate a drift unless at least two commands are driven again after others.
        """
        if not on_open_ground(self.robots, self.data):
            return True
        stretches = [command for command, _ in groupby(run.command for run in self.data)]
        return sum(count > 1 for count in Counter(stretches).values()) >= FEWEST_COMMANDS

    @property
    def tolerance(self) -> dict[str, float]:
        """1-sigma tolerances of free parameters: nominal values, errors that runs share, quantities of [known_to]."""
        if not self.robots:
            return {}
        stated = {key: value for key, value in self.robots[0].tolerance.items() if value > 0}
        shared = {key: SHARED_UNIT for run in self.data for key in run.systematic}
        known = (item for item in self.known if self.one_frame or item.key not in LEVEL)  # level is of one plate
        return stated | shared | {item.key: item.tolerance for item in known}


def without_mistakes(session: Session) -> Session:
    """The session without runs that contain a mistake; these are listed in mistakes."""
    found = recognise(session.data, session.robots)
    wrong = {run for item in found for run in item.runs}
    keep = [k for k, run in enumerate(session.data) if run.id not in wrong]
    pairs = zip(session.data, session.robots, strict=True)
    aside = tuple((run, robot) for run, robot in pairs if run.id in wrong)
    return replace(session.of_runs(keep), mistakes=(*session.mistakes, *found), aside=aside)


def needed_of(session: Session) -> Session:
    """The session with the runs that a diagnosis needs: on open ground those of some dozen commands of hundreds.

    Recordings that are whole because their times are in another unit are kept, so that they are named as mistakes.
    """
    if not on_open_ground(session.robots, session.data):
        return session
    whole = {k for k, run in enumerate(session.data) if run.from_poses and np.ptp(run.time_s) > LONGEST_S}
    unneeded = set(range(len(session.data))) - set(needed_runs(session.data)) - whole
    return session.leaving_out(unneeded, NOT_NEEDED)


def with_knowledge(session: Session, known: KnownTo) -> Session:
    """The session with quantities known to a tolerance as parameters."""
    if not session.data:
        return session
    found = quantities(known, session.robots[0], session.data)
    return replace(session, known=found, start_sigma_s=start_per_run_s(known, session.data))


def session_of(experiment: Experiment, marks: Mapping[str, Path], cameras: Mapping[str, Path] | None = None) -> Session:
    """Read the marks of every run; runs without enough frames are skipped with the reason.

    marks: marks CSV by run id. cameras: camera.json of the runs whose marks it placed. Raises InputError for robots
    that cannot be read or differ in their tolerances.
    """
    cameras = cameras or {}
    known = {path: read_with(load_camera, path) for path in dict.fromkeys(cameras.values())}
    read, tables = _read(experiment, marks, {}, cameras)
    sightings: list[Sighting | None] = []
    for run, robot in zip(read.data, read.robots, strict=True):
        camera = cameras.get(run.id)
        sightings.append(
            Sighting(
                tables[run.id],
                reference_pair(robot) or (),
                f"camera {list(known).index(camera) + 1}",
                known[camera],
                equal_height_mm(robot.layout, robot.name),
            )
            if camera
            else None
        )
    placed = [None if seen or run.from_poses else run.marks_mm for seen, run in zip(sightings, read.data, strict=True)]
    errors = zip(shared_errors(sightings), plane_errors(placed, experiment.known_to.plane_scale), strict=True)
    data = [replace(run, systematic=seen | plane) for run, (seen, plane) in zip(read.data, errors, strict=True)]
    session = without_mistakes(needed_of(_in_pieces(replace(read, data=tuple(data)))))
    return with_knowledge(session, experiment.known_to)


def mistakes_in(
    experiment: Experiment, marks: Mapping[str, Path], known: Mapping[Path, Mended] | None = None
) -> tuple[Mistake, ...]:
    """The mistakes of session_of, without what only a fit needs: no search for mistakes uses errors that runs share.

    The shifts by these of ten thousand short runs take half a gigabyte. known: marks of files that have been read.
    Raises InputError as session_of does.
    """
    session, _ = _read(experiment, marks, known or {})
    return without_mistakes(needed_of(_in_pieces(session))).mistakes


def _in_pieces(session: Session) -> Session:
    """The session with long recordings of poses on open ground cut into pieces; those with a wrong log are mistakes.

    A recording whose times are in another unit is kept whole: the search for mistakes names it.
    """
    runs = list(zip(session.data, session.robots, strict=True))
    posed = [(run, robot) for run, robot in runs if run.from_poses and is_full_size(robot)]
    recorded = [run for run, _ in posed]
    timed = {item.run for item in wrong_seconds(recorded, [robot for _, robot in posed])}
    pieces: dict[str, tuple[RunData, ...]] = {run.id: (run,) for run in session.data}
    pieces |= {run.id: pieces_of(run, FEWEST_POSES) for run in recorded if run.id not in timed}
    off = misassigned(recorded)
    turned = in_another_convention([part for run in recorded for part in pieces[run.id]])
    unread = {recording_of(item.run) for item in [*off, *turned]}  # of the latter any offset would be chance
    off += clocks_off([run for run in recorded if run.id not in unread])
    used = [(run, robot) for run, robot in runs if run.id not in {item.run for item in off}]
    few = f"no stretch of {PIECE_S:g} s of it has {FEWEST_POSES} poses; are its times in seconds?"
    left_out = {run.id: few for run, _ in used if not pieces[run.id]}
    data = tuple(part for run, _ in used for part in pieces[run.id])
    robots = tuple(robot for run, robot in used for _ in pieces[run.id])
    kept = replace(session, data=data, robots=robots, left_out={**session.left_out, **left_out})
    return replace(kept, mistakes=tuple(mistakes_of(off, len(runs))))


def _read(
    experiment: Experiment,
    marks: Mapping[str, Path],
    known: Mapping[Path, Mended],
    cameras: Collection[str] = (),
) -> tuple[Session, dict[str, pd.DataFrame]]:
    """All usable runs of an experiment, and the tables of those in cameras, by id; known: marks of files, if read."""
    robots: dict[str, Robot] = {}
    pairs: dict[str, tuple[str, ...]] = {}
    lines_rad: dict[str, float] = {}
    data, used, skipped, kept = [], [], {}, {}
    for order, run in enumerate(experiment.run):
        name = run.robot or experiment.robot
        if name not in robots:
            robots[name] = read_with(load_robot, Path(name))
            pairs[name] = reference_pair(robots[name]) or ()
        if run.id not in marks:
            skipped[run.id] = "no marks"
            continue
        try:
            table, values, filmed = _pair_of(marks[run.id], robots[name], pairs[name], known, run.id in cameras)
            if name not in lines_rad:
                line = reference_line(robots[name])
                lines_rad[name] = float(np.arctan2(line[1], line[0]))
            shown, own = _read_run(run, order, values, lines_rad[name])
            shown = replace(shown, filmed=filmed)
        except InputError as error:  # an unreadable recording is an error of its run, not of the experiment
            skipped[run.id] = str(error)
            continue
        data.append(shown)
        used.append(robots[name])
        if table is not None:
            kept[run.id] = table[own]
    _check_tolerances(used)
    return Session(tuple(data), tuple(used), skipped, relevant=experiment.relevant), kept


def _pair_of(
    path: Path, robot: Robot, pair: Sequence[str], known: Mapping[Path, Mended], seen: bool
) -> tuple[pd.DataFrame | None, Floats, bool]:
    """Time and places (n, 5) of a robot's reference pair, and the table that they are from if a camera has seen them.

    Also whether they are known to be from a film.

    Of a robot with two marks nothing else is needed, and a table of pandas takes longer than all else for a short run.
    """
    if len(robot.points_mm) == len(pair) and not seen:
        found = known.get(path) or _mended(path)
        if not set(pair) <= set(found.names):
            require_marks(read_marks(path), str(path), pair)
        places = [found.places_mm[:, found.names.index(name)] for name in pair]
        return None, np.column_stack([found.time_s, *places]), found.of_film
    read = read_marks(path)
    table = reference_marks(without_faults(read, mark_names(read)), robot)
    values = table[["time_s", *columns_of(pair)]].to_numpy(dtype=float, copy=True)
    return table if seen else None, values, is_of_film(read)


def _mended(path: Path) -> Mended:
    table = read_marks(path)
    return mended(table, mark_names(table))


def _read_run(run: Run, order: int, values: Floats, line_rad: float) -> tuple[RunData, slice]:
    """The frames of a run that a diagnosis uses, and which they are; values: (n, 5), time and the reference pair.

    line_rad: see RunData. Raises InputError with the reason why the run cannot be used.
    """
    both = np.isfinite(values).all(axis=1)
    fewest = FEWEST_POSES if run.poses else FEWEST_FRAMES
    if both.sum() < fewest:
        seen = "poses that do not repeat the one before" if run.poses else "frames in which both marks are seen"
        raise InputError(f"{both.sum()} {seen}; at least {fewest} are needed")
    first, last = (int(np.flatnonzero(both)[end]) for end in (0, -1))
    values = values[first : last + 1]
    values[:, 1:] = without_outliers(without_wrong_pairs(values[:, 1:]), corners=run.poses is not None)
    shown = _run_data(run, order, values[:, 0], values[:, 1:])
    own = _own_frames(shown, fewest)
    shown = replace(shown, time_s=shown.time_s[own], marks_mm=shown.marks_mm[own], line_rad=line_rad)
    return shown, slice(first + own.start, first + own.stop)


def _run_data(run: Run, order: int, time_s: Floats, marks_mm: Floats) -> RunData:
    """One run with its commands. Raises InputError for a log that cannot be read or is of another time."""
    command, first, last = run.run_command(), float(time_s[0]), float(time_s[-1])
    if fault := run.outside(command, first, last):
        raise InputError(fault)
    left, right = command.main(first, last)
    start_s = first
    if command.starts_at_rest:
        start_s = command.start_s if command.start_s is not None else run.start_s if run.poses is None else first
    single = command.starts_at_rest and len(command.driven) <= 1
    known = (run.id, left, right, start_s, command.stop_s, time_s, marks_mm, order)
    stated = run.poses is not None or run.commands is not None or "start_s" in run.model_fields_set
    log = None if single else command
    return RunData(*known, log=log, from_poses=run.poses is not None, start_is_stated=stated)


def _own_frames(run: RunData, fewest: int) -> slice:
    """The frames of a run between those in which a hand moves it. Raises InputError for too few."""
    own = between_hands(run)
    seen = np.flatnonzero(np.isfinite(run.marks_mm[own]).all(axis=1)) + own.start
    if len(seen) < fewest:
        raise InputError(
            f"{counted(len(seen), 'frame')} in which no hand moves the robot; at least {fewest} are needed"
        )
    return slice(int(seen[0]), int(seen[-1]) + 1)


def _check_tolerances(robots: Sequence[Robot]) -> None:
    for robot in robots:
        if robot.tolerance != robots[0].tolerance:
            raise InputError(f"robots {robots[0].name} and {robot.name} state different tolerances; one set is needed")
        for key in robot.tolerance:
            table, _, name = key.partition(".")
            value = getattr(getattr(robot, table, None), name, None)
            if not isinstance(value, int | float) or isinstance(value, bool):
                raise InputError(f"{robot.name}: [tolerance] {key} is not a number of the robot file")


def shortcomings(data: Sequence[RunData], skipped: Mapping[str, str] | None = None) -> list[str]:
    """Reasons why these runs are insufficient for any verdict; empty if they suffice.

    skipped: reasons why runs were left out, by id.
    """
    reasons = []
    moving = [run for run in data if run.left_rpm or run.right_rpm]
    if len(moving) < FEWEST_RUNS:
        reasons.append(f"{counted(len(moving), 'usable run')} with motors on; at least {FEWEST_RUNS} are needed")
        if skipped:
            first, why = next(iter(skipped.items()))
            reasons.append(f"{counted(len(skipped), 'run')} left out ({first}: {why})")
    commands = {(item.left_rpm, item.right_rpm) for run in moving for item in run.run_command.driven}
    if commands and len(commands) < FEWEST_COMMANDS:
        left_rpm, right_rpm = next(iter(commands))
        reasons.append(
            f"all runs have the same command, {left_rpm:g} / {right_rpm:g} rpm: drive other ratios of the wheel "
            "speeds, to both sides and in both directions"
        )
    return reasons
