"""experiment.toml: which robot, which camera, which runs."""

from __future__ import annotations

import datetime as dt
import re
import tomllib
import unicodedata
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticKnownError

from evaluator.errors import InputError
from evaluator.interchange.bags import Topics
from evaluator.interchange.tracks import Tracks
from evaluator.wording import counted
from simulator.files.named import named_in
from simulator.mark_layout import Mark, Marks, checked_layout
from simulator.nominal_robot import KnownTo as RobotKnownTo
from simulator.robot import Robot, shipped_robot_text, shipped_robots

if TYPE_CHECKING:
    from evaluator.interchange.commands import RunCommand

# No robot keeps one command for so long before a recording: one of the clocks counts from 1970.
FORGOTTEN_S = 1e6
DEVICE = re.compile(r"(con|prn|aux|nul|com[1-9]|lpt[1-9])(\..*)?", re.IGNORECASE)  # what Windows writes to no file
LONGEST_BYTES = 240  # of 255 in most file systems; the rest is for endings and temporary names
# strict: neither true nor "33.3" is a number
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]
FASTEST_RPM = 1e6  # a hundred times as fast as motors of microrobots: the rims of a wheel of 1 mm move at 50 m/s
Speed = Annotated[float, Field(strict=True, ge=-FASTEST_RPM, le=FASTEST_RPM, allow_inf_nan=False)]


def _names_files(value: str) -> str:
    """Letters and digits of any script, which every file system accepts in names."""
    said = all(unicodedata.category(c)[0] in "LMN" or c in "._-" for c in value)
    if not (value and said and unicodedata.category(value[0])[0] in "LN" and value[-1] != "."):
        raise ValueError("expected letters and digits of any script, with . _ - between them (it names files)")
    if DEVICE.fullmatch(value):
        raise ValueError("Windows keeps this name for a device; it must not name files")
    if len(value.encode()) > LONGEST_BYTES:
        raise ValueError(f"too long to name files: at most {LONGEST_BYTES} bytes in UTF-8")
    return value


def _refuse_one_name_of_two_runs(ids: list[str]) -> None:
    """Refuse ids whose files would replace each other.

    Windows and macOS do not distinguish R1 from r1; macOS not é in one character from é in two.
    """
    if twice := sorted(name for name, count in Counter(ids).items() if count > 1):
        raise ValueError(f"run id {', '.join(twice)} is used more than once")
    alike: dict[str, list[str]] = {}
    for name in ids:
        alike.setdefault(unicodedata.normalize("NFC", name).casefold(), []).append(name)
    if same := next((names for names in alike.values() if len(names) > 1), None):
        raise ValueError(f"run ids {', '.join(same)} name one file on Windows and macOS; rename all but one of them")


class Table(BaseModel):
    """A table of experiment.toml: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Run(Table):
    """One recorded run: its command, and its video, marks or poses."""

    id: Annotated[str, Field(max_length=80), AfterValidator(_names_files)]  # letters, digits, . _ -
    commands: Path | None = None  # command log or ROS recording, instead of a constant command
    left_rpm: Annotated[Speed | None, Field(validate_default=True)] = None  # negative: backward
    right_rpm: Annotated[Speed | None, Field(validate_default=True)] = None  # negative: backward
    start_s: Finite = 0.0  # motors on; with a log: the time of the recording at which its clock reads 0
    stop_s: Finite | None = None  # motors off, if they stop
    starts_at_rest: bool = True  # false if the robot moves when the recording begins
    video: Path | None = None  # one of video, marks and poses is required
    marks: Path | None = None  # table of tracked marks
    poses: Path | None = None  # table of poses
    corrections: Path | None = None  # manual corrections: CSV of frame, mark, x, y or "absent"
    rate_hz: Positive | None = None  # frame rate, if the video has no times
    group: str = ""  # wheel type, operator, …: drawn as one series
    robot: str | None = None  # if not that of the experiment
    camera: Path | None = None  # if not that of the experiment
    topics: Topics | None = None  # of a ROS recording, if not those of [commands]
    notes: str = ""

    @field_validator("left_rpm", "right_rpm")
    @classmethod
    def _said_without_a_log(cls, value: float | None, info: ValidationInfo) -> float | None:
        if value is None and "commands" in info.data and info.data["commands"] is None:
            raise PydanticKnownError("missing")
        return value

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if sum(item is not None for item in (self.video, self.marks, self.poses)) != 1:
            raise ValueError(f"run {self.id} needs exactly one of video, marks and poses")
        sides = [name for name in ("left_rpm", "right_rpm") if getattr(self, name) is not None]
        if self.commands is not None and (sides or self.stop_s is not None):
            taken = " and ".join([*sides, *(["stop_s"] if self.stop_s is not None else [])])
            raise ValueError(f"run {self.id}: commands replaces {taken}; keep only one of them")
        if self.stop_s is not None and self.stop_s <= self.start_s:
            raise ValueError(f"run {self.id}: stop_s = {self.stop_s} is not after start_s = {self.start_s}")
        return self

    @property
    def source(self) -> Path:
        """The recording: video, marks or poses."""
        found = self.video or self.marks or self.poses
        assert found is not None  # validated
        return found

    def run_command(self) -> RunCommand:
        """Command over the time of the recording. Raises InputError if the log or the clock cannot be read."""
        from evaluator.interchange.commands import constant, from_log

        rests, begin_s, stop_s, zero_s = self.starts_at_rest, self.start_s, self.stop_s, 0.0
        if self.poses is not None:  # if the clock counts from 1970: times of a recording begin at zero
            from evaluator.interchange.poses import clock_zero_s, in_recording_s

            zero_s = clock_zero_s(self.poses, self.topics)
            begin_s = in_recording_s(begin_s, zero_s)
            stop_s = None if stop_s is None else in_recording_s(stop_s, zero_s)
        if self.commands is not None:
            return from_log(self.commands, begin_s, zero_s, starts_at_rest=rests, topics=self.topics)
        assert self.left_rpm is not None  # validated
        assert self.right_rpm is not None
        return constant(self.left_rpm, self.right_rpm, begin_s, stop_s, starts_at_rest=rests)

    def outside(self, command: RunCommand, first_s: float, last_s: float) -> str | None:
        """Why the motors are off throughout a recording from first_s to last_s; None if they are on."""
        named = self.source.name
        if command.logged and not command.starts_at_rest:
            begin_s, end_s = (float(command.command.time_s[k]) for k in (0, -1))
            apart = f"begins {begin_s - last_s:.4g} s after {named} ends" if begin_s >= last_s else ""
            if end_s < first_s - FORGOTTEN_S:
                apart = f"ends {first_s - end_s:.4g} s before {named} begins"
            if apart:
                return f"run {self.id}: its log of commands {apart}; do both count from one moment (start_s)?"
        key = "commands: motors on at" if command.logged else "start_s ="
        if (start_s := command.start_s) is not None and start_s >= last_s:
            return (
                f"run {self.id}: {key} {start_s:g} s, but {named} ends at {last_s:.2f} s; "
                "give the time in the recording at which the motors were commanded on"
            )
        key = "commands: motors off at" if command.logged else "stop_s ="
        if command.stop_s is not None and command.stop_s <= first_s:
            return (
                f"run {self.id}: {key} {command.stop_s:g} s, but {named} begins at {first_s:.2f} s; "
                "give the time in the recording at which the motors were commanded off"
            )
        return None


NotNegative = Annotated[float, Field(strict=True, ge=0, allow_inf_nan=False)]


class KnownTo(Table):
    """Standard uncertainties of quantities that are not known exactly; 0 is exact."""

    start_common_s: NotNegative | None = None  # offset of start_s common to all runs; default: one frame
    start_per_run_s: NotNegative | None = None  # of each run and later change of a command; default: half a frame
    time_base: NotNegative = 1e-4  # relative
    plane_scale: NotNegative = 1e-3  # relative, also across the plate: pitch tolerance of the gauge, lens


class Relevant(Table):
    """Limits of relevance: an effect that changes less than all of these is listed separately."""

    path_noise_floors: NotNegative = 0.5  # RMS change of the path, in noise floors
    radius_percent: NotNegative = 0.1  # change of the turning radius
    speed_percent: NotNegative = 0.1  # change of the speed


class Experiment(Table):
    """An experiment: robot, camera and runs. Paths are absolute once loaded."""

    format: Literal[1]
    name: str
    robot: str  # shipped robot or robot.toml
    camera: Path | None = None  # camera.json; required for videos
    tracking: Path | None = None  # tracking.toml: colours, size, region and masks
    tracks: Tracks | None = None  # for marks files of other programs
    commands: Topics = Topics()  # topics of ROS recordings
    run: tuple[Run, ...] = ()  # at least one
    known_to: KnownTo = KnownTo()  # uncertainties (1 sigma) of times and scale
    relevant: Relevant = Relevant()  # limits of relevance of an effect
    date: dt.date | None = None  # of the recording; orders the sessions of `turnscope trends`
    notes: str = ""

    def __repr__(self) -> str:
        """One line: name, robot and number of runs."""
        return f"Experiment({self.name}: robot {self.robot}, {counted(len(self.run), 'run')})"

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not self.run:
            raise ValueError("there is no [[run]]; an experiment needs at least one")
        _refuse_one_name_of_two_runs([run.id for run in self.run])
        blind = [run.id for run in self.run if run.video and not (run.camera or self.camera)]
        if blind:
            raise ValueError(
                f'runs {", ".join(blind)} are videos: say camera = "camera.json" (from turnscope calibrate)'
            )
        return self


def load_experiment(path: Path | str) -> Experiment:
    """Read experiment.toml; paths in it are taken relative to it.

    A missing recording is a fault of its run, found during its analysis, not of the experiment.
    Raises OSError (also for a file outside of the sandbox, see named_in), tomllib.TOMLDecodeError,
    pydantic.ValidationError; InputError if tracking.toml is missing.
    """
    path = Path(path)
    raw = Experiment.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))

    def absolute(value: Path | None) -> Path | None:
        return None if value is None else named_in(path, value)

    runs = tuple(
        run.model_copy(
            update={
                **{key: absolute(getattr(run, key)) for key in ("video", "marks", "poses", "commands", "corrections")},
                "camera": absolute(run.camera or raw.camera),
                "topics": run.topics or raw.commands,
                "robot": robot_named_in(path, run.robot or raw.robot),
            }
        )
        for run in raw.run
    )
    experiment = raw.model_copy(
        update={
            "run": runs,
            "camera": absolute(raw.camera),
            "robot": robot_named_in(path, raw.robot),
            "tracking": absolute(raw.tracking),
        }
    )
    if experiment.tracking and not experiment.tracking.exists():
        raise InputError(f"{path}: tracking = {raw.tracking}: no such file")
    return experiment


class MeasuredRobot(BaseModel):
    """The part of robot.toml that measurement reads; the simulator checks the rest, except for unknown tables."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = "robot"
    marks: Marks | None = None
    mark: tuple[Mark, ...] = ()
    body: dict[str, Any] = Field(default_factory=dict)
    wheels: dict[str, Any] = Field(default_factory=dict)
    wheel: tuple[dict[str, Any], ...] = ()
    known_to: RobotKnownTo = RobotKnownTo()
    format: Any = None
    magnetic_attraction: Any = None
    slip: Any = None
    tolerance: Any = None
    effect: Any = None

    @model_validator(mode="after")
    def _has_marks(self) -> Self:
        if self.marks is None and not self.mark:
            raise ValueError("there is neither [marks] nor [[mark]]; give the positions of the marks on the robot")
        if not checked_layout(self.marks or Marks(), self.mark):
            raise ValueError("[marks] has no mark; give the position of each, NAME_mm = [x, y]")
        return self

    @property
    def layout(self) -> tuple[Mark, ...]:
        """All marks, in the order of the file."""
        return self.mark or (self.marks or Marks()).each()

    @property
    def points_mm(self) -> dict[str, tuple[float, float]]:
        """Positions of all points that a tracker measures, by name: centres of marks, and corners of tags."""
        return {name: place for mark in self.layout for name, place in mark.points_mm().items()}


def load_measured(name_or_path: Path) -> MeasuredRobot:
    """Read what measurement needs from a shipped robot by name or from any robot.toml by path.

    Raises SimulationError for an unknown name, else OSError, tomllib.TOMLDecodeError, pydantic.ValidationError.
    """
    return MeasuredRobot.model_validate(tomllib.loads(_robot_text(name_or_path)))


def robot_named_in(file: Path, name: str) -> str:
    """A robot that an experiment names: one of the package, or the path of its file, relative to the experiment.

    Raises PermissionError for a file outside of the sandbox, see named_in.
    """
    if name in shipped_robots():
        return name
    path = named_in(file, name)
    is_file = name.endswith(".toml") or path.exists() or Path(name).exists()
    return str(path) if is_file else name  # of a misspelt one the nearest is told


def load_any_robot(name_or_path: Path) -> Robot | MeasuredRobot:
    """Read a robot; if a file has no [slip], so that it cannot be simulated, only what measurement needs.

    Raises as `load_measured`.
    """
    content = tomllib.loads(_robot_text(name_or_path))
    return Robot.model_validate(content) if "slip" in content else MeasuredRobot.model_validate(content)


def _robot_text(name_or_path: Path) -> str:
    text = str(name_or_path)
    if text not in shipped_robots() and (text.endswith(".toml") or Path(text).exists()):
        return Path(text).read_text(encoding="utf-8")
    return shipped_robot_text(text)
