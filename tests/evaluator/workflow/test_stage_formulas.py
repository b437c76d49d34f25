"""Checks, delays and stages of a run in closed form: stand-ins instead of recordings, cameras and simulations."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.errors import InputError
from evaluator.interchange.commands import RunCommand
from evaluator.interchange.log_offset import LogOffset
from evaluator.interchange.tracks import Tracks
from evaluator.mark_geometry import MarkGeometry
from evaluator.pose import Poses
from evaluator.settings import Run
from evaluator.turning.clock import CommandDelay
from evaluator.workflow import checks, turning_tables
from evaluator.workflow.circular import evaluate
from evaluator.workflow.runs import phases, stages
from evaluator.workflow.turning_tables import Request, Ruler
from simulator.command import Command

TIME_S = np.arange(301) / 60
LOG = RunCommand(Command.steps([(0.0, 30.0, 20.0), (1.0, 0.0, 0.0), (2.0, -20.0, 30.0)]), logged=True)


def poses(count: int = 301, **more: Any) -> Any:
    seen = np.isin(np.arange(301), np.linspace(0, 300, count).astype(int))
    return SimpleNamespace(measured=seen, time_s=TIME_S, x_mm=TIME_S, y_mm=TIME_S, heading_rad=TIME_S, **more)


@pytest.mark.parametrize(
    ("offset", "found", "late_s", "expected"),
    [
        (None, CommandDelay(0.1, 0.05, 0.15, 0.02), 1.0, (0.1, 0.05, 0.15, 0.02)),
        (LogOffset(1.9, 1.8, 2.1), CommandDelay(0.1, 0.05, 0.15), 2.0, (0.1, 0.05, 0.15, 0.0)),  # near, and allowed
        (LogOffset(1.9, 1.8, 2.1), CommandDelay(0.1, 0.05, 0.15), 1.8, (2.0, 1.95, 2.05, 0.0)),  # farther
        (LogOffset(1.9, 1.8, 2.1), CommandDelay(), 1.8, (1.9, 1.8, 2.1, 0.0)),  # not even from there
        (LogOffset(1.9, 1.8, 2.1), CommandDelay(), 2.0, (1.9, 1.8, 2.1, 0.0)),  # changes show nothing
        (LogOffset(-3.0, -3.1, -2.8), CommandDelay(0.1, 0.0, 0.3), 1.0, (-2.9, -3.0, -2.7, 0.0)),  # clocks far apart
    ],
)
def test_a_delay_is_that_of_the_changes_near_the_log_or_near_the_whole_motion(
    offset: LogOffset | None,
    found: CommandDelay,
    late_s: float,
    expected: tuple[float, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(phases, "_offset", lambda *given: asked.append((len(given[1]), given[3])) or offset)
    monkeypatch.setattr(phases, "command_delay", lambda _, __, changes, ___: asked.append(changes) or found)
    monkeypatch.setattr(phases, "most_late_s", lambda *_: late_s)
    delay = phases.command_delay_of(LOG, poses())
    assert (delay.value_s, delay.low_s, delay.high_s, delay.rise_s) == pytest.approx(expected)
    far = offset.value_s if offset is not None else 0.0
    searched = [apart for apart in dict.fromkeys([0.0, far]) if abs(far - apart) <= late_s]
    usable = searched if not np.isfinite(found.value_s) else searched[:1]
    assert asked == [(301, 2.0), *([at + apart for at in (0.0, 1.0, 2.0) if 0 < at + apart < 5] for apart in usable)]


@pytest.mark.parametrize(("count", "logged", "said"), [(12, True, True), (11, True, False), (301, False, False)])
def test_the_start_that_fits_the_motion_is_told_where_a_log_and_a_dozen_poses_are_there(
    count: int, logged: bool, said: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        phases, "_offset", lambda _, time, __, near: LogOffset(1.25 + near, 0, 0) if len(time) == count else None
    )
    run: Any = SimpleNamespace(start_s=0.5)
    sentence = phases.start_by_motion(run, RunCommand(LOG.command, logged=logged), poses(count))
    assert sentence == (
        "; the motion follows the log with start_s = 1.75 (delay of the motors included)" if said else ""
    )
    monkeypatch.setattr(phases, "_offset", lambda *_: None)
    assert phases.start_by_motion(run, LOG, poses()) == ""


@pytest.mark.parametrize(
    ("offset_s", "said"),
    [
        (-3599.8, "; 1 h, as of two time zones or of summer time)"),
        (19_829.0, "; 5.5 h, as of two time zones or of summer time)"),
        (1829.0, "; 0.5 h, as of"),
        (1831.0, "included)"),
        (29.0, "included)"),
    ],
)
def test_a_log_in_another_time_zone_is_told_as_that(
    offset_s: float, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(phases, "_offset", lambda *_: LogOffset(offset_s, 0, 0))
    run: Any = SimpleNamespace(start_s=0.5)
    sentence = phases.start_by_motion(run, LOG, poses())
    assert f"start_s = {offset_s + 0.5:.2f} (delay of the motors included" in sentence
    assert said in sentence


def a_run(**more: Any) -> Any:
    usual = dict.fromkeys(("video", "marks", "poses", "camera", "topics", "rate_hz", "commands"))
    run = SimpleNamespace(**{**usual, "id": "r", "start_s": None, "source": Path("r.csv"), **more})
    run.run_command = lambda: SimpleNamespace(logged=False, stop_s=run.stop, start_s=None)
    run.outside = lambda command, first, last: Run.outside(run, command, first, last)
    return run


@pytest.mark.parametrize(("stop", "fault"), [(1.0, True), (1.1, False)])
def test_motors_that_stop_before_a_recording_begins_are_a_fault_of_every_kind_of_run(
    stop: float, fault: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Marks and poses from 1 s on; a video begins at 0 and has the length that its container states."""
    table = pd.DataFrame({"time_s": [1.0, 2.0, 9.0]})
    monkeypatch.setattr(
        "evaluator.interchange.tracks.program_of", lambda path: "turnscope" if "own" in str(path) else ""
    )
    monkeypatch.setattr("evaluator.marks.read_marks", lambda _: table)
    monkeypatch.setattr("evaluator.interchange.poses.read_poses", lambda *_: SimpleNamespace(table=table))
    monkeypatch.setattr(
        "evaluator.interchange.poses.poses_of", lambda found: SimpleNamespace(time_s=found["time_s"].to_numpy())
    )
    monkeypatch.setattr("evaluator.workflow.runs.phases.start_by_motion", lambda *_: "; so")
    marks, given = a_run(marks=Path("own.csv"), stop=stop), a_run(poses=Path("p.csv"), stop=stop)
    assert bool(checks._outside(marks, {})) is fault
    assert str(checks._outside(given, {})).endswith("commanded off; so") is fault
    assert (checks._outside(given, {}) is None) is not fault
    assert checks._outside(a_run(marks=Path("other.csv"), stop=0.0), {}) is None
    for length, stopped, early in ((5.0, -1.0, True), (5.0, 0.5, False), (None, -1.0, False)):
        monkeypatch.setattr(
            "evaluator.recording.open_recording", lambda *_, length=length, **__: SimpleNamespace(expected_s=length)
        )
        assert bool(checks._outside(a_run(video=Path("v.mp4"), stop=stopped), {})) is early

    def unreadable(_: Path) -> None:
        raise InputError("no table")

    monkeypatch.setattr("evaluator.marks.read_marks", unreadable)
    assert checks._outside(marks, {}) is None  # reported for the file itself


def test_recordings_have_the_size_of_their_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: dict[str, Any] = {
        "same.mp4": (640, 480),
        "other.mp4": (320, 240),
        "bad.mp4": InputError("bad.mp4: no video"),
    }

    def opened(video: Path, **_: Any) -> Any:
        if isinstance(size := sizes[video.name], Exception):
            raise size
        return SimpleNamespace(size_px=size)

    monkeypatch.setattr("evaluator.recording.open_recording", opened)
    monkeypatch.setattr("calibration.store.load_camera", lambda _: SimpleNamespace(size_px=(640, 480)))
    runs = [a_run(video=Path(name), camera=Path("c.json")) for name in sizes]
    runs += [a_run(video=Path("other.mp4")), a_run(marks=Path("m.csv"), camera=Path("c.json"))]
    found = list(checks._faults_of_sizes(SimpleNamespace(run=runs)))  # type: ignore[arg-type]
    assert found[0].startswith("r: other.mp4: frames of 320×240 px")
    assert found[1:] == ["bad.mp4: no video"]


def test_poses_are_a_table_with_the_roots_of_their_variances() -> None:
    covariance = np.tile(np.diag([4.0, 9.0, np.radians(2.0) ** 2]), (2, 1, 1))
    found = stages.pose_table(
        Poses(np.array([0.0, 0.1]), np.array([1.0, 2.0]), np.array([3.0, 4.0]), np.radians([30.0, -60.0]), covariance,
              np.array(["ok", "no"]), np.array([1.0, 1.0]))
    )  # type: ignore[call-arg]  # fmt: skip
    assert found.drop(columns="status").iloc[1].tolist() == pytest.approx([0.1, 2, 4, -60, 2, 3, 2])
    assert list(found) == [
        *("time_s", "x_mm", "y_mm", "heading_deg", "x_sigma_mm", "y_sigma_mm", "heading_sigma_deg", "status"),
    ]


GEOMETRY = MarkGeometry({"green": (0.0, 1.0), "yellow": (0.0, -1.0), "third": (5.0, 0.0)}, height_mm=6.5)


def robot(shape: Any = None) -> Any:
    return SimpleNamespace(marks=lambda: GEOMETRY, shape=shape, height_mm=6.5)


def test_marks_of_the_robot_are_those_that_the_table_shows_and_a_misspelt_one_is_named() -> None:
    there, never = np.ones((3, 2)), np.full((3, 2), np.nan)
    some = there * [[1.0], [np.nan], [np.nan]]

    def found(**points: np.ndarray) -> Any:
        return turning_tables._marks(Path("a.csv"), points, robot())

    assert found(green=there, yellow=some, third=never).names == ("green", "yellow")
    assert found(green=there, yellow=never, third=never) is None
    assert found(green=there, yellow=there, aside=there).names == ("green", "yellow")
    assert turning_tables._marks(Path("a.csv"), {"green": there}, None) is None
    with pytest.raises(InputError, match=r"a\.csv: has no mark yellow.*did you mean yelow_mm"):
        found(green=there, yelow=there)


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """What is measured of a table of points, with its unit, and what is asked of the measurement."""

    def measure(points: dict[str, np.ndarray], unit: str, request: Request) -> Any:
        asked: list[Any] = []
        time = np.arange(4) / 10
        monkeypatch.setattr(turning_tables, "holds_poses", lambda _: False)
        monkeypatch.setattr("evaluator.interchange.tracks.program_of", lambda _: "")
        monkeypatch.setattr(turning_tables, "read_points", lambda *_: (time, points, unit))
        monkeypatch.setattr(turning_tables, "poses_from_marks", lambda marks, *_: asked.append(marks) or poses())
        monkeypatch.setattr(turning_tables, "_measured", lambda *given: asked.append(given) or "done")
        monkeypatch.setattr(turning_tables, "_each_mark", lambda *given: asked.append(given) or ({}, ["said"]))
        return turning_tables.measure_table(Path("a.csv"), request), asked

    return measure


def test_pixels_become_millimetres_by_a_ruler_or_by_the_distance_of_the_marks(measured: Callable[..., Any]) -> None:
    along = np.array([[10.0, 20.0]] * 4)
    points = {"green": along, "yellow": np.add(along, [0.0, 8.0])}
    ruler = Ruler((0.0, 0.0, 30.0, 40.0), 25.0)  # 0.5 mm to a pixel
    done, (marks, given) = measured(points, "px", Request(robot=robot(), ruler=ruler))
    assert done == "done"
    assert marks[["green_x_mm", "green_y_mm", "yellow_y_mm"]].iloc[0].tolist() == [5.0, 10.0, 14.0]
    assert (given[3][0][:35], given[4]) == ("scale from the ruler, known to 2.8 ", pytest.approx(np.sqrt(2) / 50))
    _, (marks, given) = measured(points, "px", Request(robot=robot()))
    assert marks[["time_s", "green_x_mm", "yellow_y_mm"]].iloc[1].tolist() == pytest.approx([0.1, 2.5, 7.0])
    assert given[3][0].startswith("px: scale from the distance of the marks, 0.25 mm per px")
    assert given[4] == 0.0
    _, (marks, given) = measured(points, "mm", Request(robot=robot(), left_rpm=3.0))
    assert marks["green_x_mm"].tolist() == [10.0] * 4
    assert given[0] == {"run": "a", "left_rpm": 3.0, "right_rpm": None}
    with pytest.raises(InputError, match="holds lengths in mm; --scale-px is for columns in px"):
        measured(points, "mm", Request(robot=robot(), ruler=ruler))
    alone, (given,) = measured({"green": along}, "px", Request(robot=robot(), ruler=ruler))
    assert (given[2]["green"][0].tolist(), given[3], given[4]) == ([5.0, 10.0], "mm", pytest.approx(np.sqrt(2) / 50))
    assert alone.lines[0] == "said"


def test_poses_of_another_clock_are_measured_in_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    poses = pd.DataFrame({"time_s": [0.0, 9.0]})
    read = SimpleNamespace(table=poses, zero_s=100.0, notes=lambda: ["a note"])
    monkeypatch.setattr(turning_tables, "read_poses", lambda _: read)
    monkeypatch.setattr(turning_tables, "poses_of", lambda table: table)
    monkeypatch.setattr(turning_tables, "in_recording_s", lambda at, zero: at - zero)
    monkeypatch.setattr(turning_tables, "_measured", lambda *given: asked.append(given))
    turning_tables._of_poses(Path("p.csv"), Request(start_s=101.5, right_rpm=4.0, tracks=Tracks()))
    head, table, request, lines, sigma = asked[0]
    assert (head, lines, sigma) == ({"run": "p", "left_rpm": None, "right_rpm": 4.0}, ["a note"], 0.0)
    assert table is poses
    assert (request.start_s, request.stop_s) == (1.5, None)
    with pytest.raises(InputError, match="holds poses; --scale-px"):
        turning_tables._of_poses(Path("p.csv"), Request(ruler=Ruler((0, 0, 9, 9), 1.0)))


def test_a_wheelbase_is_that_of_wheels_that_grip_or_the_track_of_one_axle() -> None:
    def of(*places: tuple[float, bool]) -> float:
        wheels = [SimpleNamespace(x_mm=x, grips=grips) for x, grips in places]
        return evaluate._wheelbase(SimpleNamespace(all_wheels=wheels, track_mm=7.0))  # type: ignore[arg-type]

    assert of((1.5, True), (-2.0, True), (-9.0, False)) == 3.5
    assert of((1.5, True), (1.5, True), (-9.0, False)) == 7.0
    points = pd.DataFrame({"run": ["a", "b"], "speed_mm_s": [1.0, 2.0]})
    names = ["yaw_rate_deg_s", "radius_mm", "sideslip_deg", "lateral_acceleration_mm_s2"]
    simulated: Any = SimpleNamespace(points=points.iloc[::-1].assign(**dict.fromkeys(names, 0.0)), series=())
    both = evaluate.circular_test_table(evaluate.CircularResult(SimpleNamespace(points=points), simulated))  # type: ignore[arg-type]
    assert both["simulated_speed_mm_s"].tolist() == [1.0, 2.0]
    assert evaluate.circular_test_table(evaluate.CircularResult(None, simulated)) is simulated.points


@pytest.mark.parametrize(
    ("run", "start_s", "told"),
    [
        ({}, 0.5, ["note of green at 0.5"]),
        ({"video": None}, 0.5, []),
        ({"starts_at_rest": False}, 0.5, []),
        ({}, 9.0, []),
    ],
)
def test_motion_at_rest_is_sought_in_videos_that_begin_before_their_start(
    run: dict[str, Any], start_s: float, told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def found(_: Any, names: list[str], at_s: float) -> Any:
        return SimpleNamespace(note=f"note of {names[0]} at {at_s:g}") if at_s < 1.0 else None

    monkeypatch.setattr(stages, "motion_at_rest", found)
    one: Any = SimpleNamespace(
        run_command=SimpleNamespace(start_s=start_s, starts_at_rest=run.get("starts_at_rest", True)),
        run=SimpleNamespace(video=run.get("video", "a.mp4")),
        marks=None,
        job=SimpleNamespace(robot=SimpleNamespace(layout=[SimpleNamespace(name="green")])),
    )
    assert stages._Stages._at_rest(one) == told
