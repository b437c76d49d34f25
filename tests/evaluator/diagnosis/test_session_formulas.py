"""What a session is taken to be from its runs alone: stand-ins instead of files."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis import experiment, search_input
from evaluator.diagnosis.experiment import Session, _check_tolerances, _own_frames, _run_data, with_knowledge
from evaluator.diagnosis.likelihood.known_to import LEVEL
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.run_data import SHARED_UNIT
from evaluator.errors import InputError
from evaluator.settings import KnownTo


def run_at(off_mm: float, *, from_poses: bool = True, command: tuple[float, float] = (30.0, 10.0)) -> Any:
    """A run whose marks, 5 mm apart, begin so far from where others do."""
    first = np.array([3.0 + off_mm, 4.0, off_mm, 0.0])
    marks = np.stack([first, first + 7.0 + 3.0 * off_mm**2])  # only the first frame counts
    return SimpleNamespace(marks_mm=marks, from_poses=from_poses, command=command, systematic={}, id="r")


def session_of(runs: list[Any], robots: list[Any] | None = None, **more: Any) -> Session:
    return Session(tuple(runs), tuple(robots or [SimpleNamespace(tolerance={})] * len(runs)), {}, **more)


@pytest.mark.parametrize(
    ("places", "from_poses", "one_frame"),
    [
        ([0.0, 0.0, 0.0, 0.0], True, False),
        ([0.0, 0.0, 0.0, 0.0], False, True),  # marks that a camera saw
        ([0.0, 0.0, 0.0, 9.0], True, False),
        ([0.0, 0.0, 9.0, -9.0], True, True),  # half of them
        ([0.0, 0.0, 4.9e-6, 9.0, -9.0], True, False),  # a millionth of 5 mm
        ([0.0, 0.0, 5.2e-6, 9.0, -9.0], True, True),
        ([0.0], True, True),
    ],
)
def test_runs_share_a_frame_unless_most_poses_begin_at_one_place_to_a_millionth_of_the_robot(
    places: list[float], from_poses: bool, one_frame: bool
) -> None:
    assert session_of([run_at(off, from_poses=from_poses) for off in places]).one_frame == one_frame


def test_runs_of_which_one_has_no_poses_share_a_frame() -> None:
    assert session_of([run_at(0.0), run_at(0.0), run_at(0.0, from_poses=False)]).one_frame


@pytest.mark.parametrize(
    ("driven", "full_size", "recur"),
    [
        ("ab", False, True),
        ("abab", True, True),
        ("aabb", True, False),  # one after another
        ("abac", True, False),  # one command alone comes again
        ("abcab", True, True),
    ],
)
def test_on_open_ground_two_commands_must_come_again_after_others(
    driven: str, full_size: bool, recur: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(experiment, "on_open_ground", lambda *_: full_size)
    runs = [run_at(0.0, command=(float(ord(letter)), 0.0)) for letter in driven]
    assert session_of(runs).commands_recur == recur


@pytest.mark.parametrize("one_frame", [True, False])
def test_tolerances_are_those_of_the_file_of_shared_errors_and_of_what_is_known_where_it_means_something(
    one_frame: bool,
) -> None:
    runs = [run_at(9.0 * k if one_frame else 0.0) for k in range(3)]
    runs[1].systematic = {"camera 1: shift": None}
    known: Any = tuple(SimpleNamespace(key=key, tolerance=0.2) for key in ("clock", *LEVEL))
    robot = SimpleNamespace(tolerance={"wheels.track_mm": 0.05, "body.mass_g": 0.0})
    expected = {"wheels.track_mm": 0.05, "camera 1: shift": SHARED_UNIT, "clock": 0.2}
    expected |= dict.fromkeys(LEVEL, 0.2) if one_frame else {}
    assert session_of(runs, [robot, *[SimpleNamespace(tolerance={})] * 2], known=known).tolerance == expected
    assert Session((), (), {}).tolerance == {}


def test_what_is_known_is_that_of_the_first_robot_and_of_all_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiment, "quantities", lambda *given: given)
    monkeypatch.setattr(experiment, "start_per_run_s", lambda known, data: (len(data), known)[0] / 10)
    robots: list[Any] = [SimpleNamespace(tolerance={}, name=str(k)) for k in range(2)]
    session, known = session_of([run_at(0.0), run_at(1.0)], robots), KnownTo()
    found = with_knowledge(session, known)
    assert found.known == (known, robots[0], session.data)
    assert found.start_sigma_s == pytest.approx(0.2)
    assert with_knowledge(Session((), (), {}), known).known == ()


def test_frames_between_hands_begin_and_end_with_marks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiment, "between_hands", lambda _: slice(2, 9))
    marks = np.zeros((12, 4))
    marks[[2, 5, 8]] = np.nan
    assert _own_frames(SimpleNamespace(marks_mm=marks), 4) == slice(3, 8)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"^4 frames in which no hand moves the robot; at least 5 are needed$"):
        _own_frames(SimpleNamespace(marks_mm=marks), 5)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("at_rest", "logged_s", "poses", "start_s"),
    [
        (True, 0.7, None, 0.7),
        (True, 0.7, "poses.csv", 0.7),
        (True, None, None, 0.4),  # of the file
        (True, None, "poses.csv", 0.1),  # the first of the poses
        (False, 0.7, None, 0.1),
    ],
)
@pytest.mark.parametrize("driven", [0, 1, 2])
@pytest.mark.parametrize("said", [(), ("start_s",)])
def test_a_run_starts_where_its_log_or_its_file_says_and_one_that_moves_already_with_its_first_frame(
    at_rest: bool, logged_s: float | None, poses: str | None, start_s: float, driven: int, said: tuple[str, ...]
) -> None:
    command = SimpleNamespace(
        starts_at_rest=at_rest, start_s=logged_s, stop_s=2.5, driven=range(driven), main=lambda *ends: ends
    )
    run: Any = SimpleNamespace(
        id="r1", start_s=0.4, poses=poses, commands=None, model_fields_set=set(said),
        run_command=lambda: command, outside=lambda *_: "",
    )  # fmt: skip
    found = _run_data(run, 3, np.array([0.1, 0.2, 2.0]), np.zeros((3, 4)))
    assert (found.id, found.left_rpm, found.right_rpm, found.order) == ("r1", 0.1, 2.0, 3)
    assert (found.start_s, found.stop_s) == (start_s, 2.5)
    assert (found.log is None) == (at_rest and driven < 2)
    assert (found.from_poses, found.start_is_stated) == (poses is not None, poses is not None or bool(said))
    run.outside = lambda *_: "the log is of another day"
    with pytest.raises(InputError, match="another day"):
        _run_data(run, 3, np.array([0.1, 0.2, 2.0]), np.zeros((3, 4)))


def test_a_tolerance_is_of_a_number_of_the_robot_file_and_the_same_for_all_robots() -> None:
    def robot(robot: str, **tolerance: float) -> Any:
        tables = SimpleNamespace(track_mm=4.0, count=4, name="text", spare=True)
        return SimpleNamespace(name=robot, wheels=tables, tolerance={f"wheels.{k}": v for k, v in tolerance.items()})

    _check_tolerances([robot("one", track_mm=0.05, count=1.0), robot("two", track_mm=0.05, count=1.0)])
    for robots, said in (
        ([robot("one", track_mm=0.05), robot("two", track_mm=0.06)], "robots one and two state different tolerances"),
        ([robot("one", name=0.1)], r"one: \[tolerance\] wheels.name is not a number"),
        ([robot("one", spare=0.1)], r"wheels.spare is not a number"),
        ([robot("one", absent=0.1)], r"wheels.absent is not a number"),
    ):
        with pytest.raises(InputError, match=said):
            _check_tolerances(robots)


def shown(square: float, starts: float) -> Any:
    """Two runs whose response to one column, and to a start, is half along the start pose, which is fitted anyway."""
    along, aside = np.array([0.6, 0.8, 0.0]), np.array([-0.8, 0.6, 0.0])
    common = np.sqrt(square / 2) * aside + 3.0 * along
    scatter = np.sqrt(starts / 2) * np.array([0.0, 0.0, 1.0]) + 5.0 * along
    effects = np.column_stack([9 * along, 9 * aside, scatter])  # the start is the last of them
    item = SimpleNamespace(start=along[:, None], common=common[:, None], scatter=effects)
    return SimpleNamespace(attempted=lambda *_: [item, None, item], data=range(3), given=())


@pytest.mark.parametrize(("sigmas", "visible"), [(0.51, True), (0.49, False)])
def test_what_all_runs_show_by_less_than_half_a_sigma_is_not_fitted(sigmas: float, *, visible: bool) -> None:
    """Per unit, and a tolerance of 0.1: so much more is shown by a unit."""
    problem = shown((sigmas / 0.1) ** 2, sigmas**2)
    point = Point(np.zeros((3, 7)))
    found = search_input.visible_tolerances(problem, point, {"key": 0.1, "exact": 0.0})
    assert found == ({"key": 0.1} if visible else {})
    assert search_input.show_starts(problem, point) is visible
    # what acts beside an effect that the robots lack cannot be seen yet
    kept = search_input.visible_tolerances(problem, point, {"key": 0.1, "left_wheel_turns": 0.1})
    assert ("key" in kept, "left_wheel_turns" in kept) == (visible, True)
    square, starts = search_input._squares_shown(problem, point, [Column("key")])
    assert (square[0], starts) == (pytest.approx((sigmas / 0.1) ** 2), pytest.approx(sigmas**2))
