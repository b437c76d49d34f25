"""Runs of a plan: where they fit, what they tell by hand, and which are chosen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.design import candidate_runs, plan
from evaluator.diagnosis.design.candidate_runs import CORNERS, MIDDLE, CandidateRun, Room, commands_at, placed
from evaluator.diagnosis.likelihood.known_to import FRAMES_COMMON, FRAMES_PER_RUN
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.point import Column
from evaluator.robot_geometry import reference_places
from simulator.effects.coordinates import Candidate, Coordinate
from simulator.errors import SimulationError
from simulator.robot import load_robot
from tests.evaluator.diagnosis.synthetic import free_of_start, linear_runs


def effect(name: str, step: float = 0.1, **said: Any) -> Candidate:
    """An effect of one coordinate."""
    coordinate = Coordinate("size", 0.0, step)
    return Candidate(name, (coordinate,), lambda values: {"size": values[0]}, **said)


def test_commands_are_straight_and_turns_to_both_sides_forward_and_backward() -> None:
    level = {(20.0, 20.0), (20.0, 14.0), (14.0, 20.0), (20.0, 8.0), (8.0, 20.0)}
    forward = level | {(left / 2, right / 2) for left, right in level}  # half of the highest, too
    assert commands_at([20.0]) == sorted(forward | {(-left, -right) for left, right in forward})
    pivots = {(20.0, 0.0), (0.0, 20.0), (20.0, -20.0), (-20.0, 20.0)}
    assert pivots | {(10.0, -10.0), (-10.0, 0.0)} <= set(commands_at([20.0], pivots=True))
    assert "-0.0" not in str(commands_at([20.0], pivots=True))
    many = {max(pair) for pair in commands_at([0.0, *np.linspace(3.0, 60.0, 20)]) if pair[0] == pair[1] > 0}
    assert (len(many), min(many), max(many)) == (8, 3.0, 60.0)


def test_a_path_reaches_as_far_as_its_marks_turned_by_its_heading() -> None:
    path = np.array([[0.0, 0.0, 0.0, 1.0], [2.0, 0.0, 2.0, 1.0], [9.0, 0.0, 9.0, 1.0]])
    path = np.repeat(path, [1, candidate_runs.STEPS_PER_S, 1], axis=0)
    low, high = candidate_runs._reach(path, 90.0, 1.0)  # after a second it is at 2 mm; its left is then -x
    assert low == pytest.approx([-1.0, 0.0])
    assert high == pytest.approx([0.0, 2.0])
    low, high = candidate_runs._reach(path, 180.0, 2.0)
    assert (*low, *high) == pytest.approx((-9.0, -1.0, 0.0, 0.0))


def test_corners_lie_near_those_of_the_room_opposite_ones_first() -> None:
    corners = np.array(CORNERS)
    assert (np.abs(corners) < 1).all()
    assert (np.abs(corners) > 0.5).all()
    assert {tuple(signs) for signs in np.sign(corners)} == {(1, 1), (-1, -1), (1, -1), (-1, 1)}
    np.testing.assert_array_equal(corners[::2], -corners[1::2])


def test_room_is_the_plate_without_its_margin_or_where_marks_were() -> None:
    assert Room.of_plate((40.0, 30.0), 4.5) == Room((0.0, 0.0), (15.5, 10.5))
    assert Room.of_plate((8.0, 30.0), 4.5).half_mm == (0.0, 10.5)
    marks = [np.array([[1.0, 2.0, 5.0, -4.0], [np.nan] * 4]), np.array([[-3.0, 0.0, 0.0, 8.0]])]
    assert Room.of_marks(marks) == Room((1.0, 2.0), (4.0, 6.0))


@pytest.mark.parametrize(
    ("half_mm", "seconds"),
    [((25.0, 21.0), {0: 5.0, 90: 4.0}), ((9.9, 40.5), {90: 8.0}), ((40.0, 0.9), {}), ((10.0, 1.0), {0: 2.0})],
)
def test_runs_are_as_long_as_their_path_fits_and_lie_where_it_leaves_room(
    half_mm: tuple[float, float], seconds: dict[int, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot 2 mm wide that drives 10 mm a second along its heading; along y 2 mm less room is left for it."""
    sides = tuple(np.column_stack([np.arange(81.0), np.full(81, side)]) for side in (1.0, -1.0))
    told: Any = SimpleNamespace(is_by_chance=False, x_mm=None, y_mm=None, heading_rad=None, time_s=None)
    monkeypatch.setattr(candidate_runs, "simulate", lambda *_: told)
    monkeypatch.setattr(candidate_runs, "view_of", lambda *_: None)
    monkeypatch.setattr(candidate_runs, "seen_of_run", lambda *_: sides)
    room = Room((3.0, -2.0), half_mm)
    found = list(placed(load_robot("barrel"), (30.0, 30.0), (0, 90), room, (MIDDLE, CORNERS[0])))
    assert {run.heading_deg: run.duration_s for run in found} == seconds
    for middle, corner in zip(found[::2], found[1::2], strict=True):
        way = 5.0 * middle.duration_s  # half of it lies before the middle of the room
        along = np.array([way, 0.0]) if middle.heading_deg == 0 else np.array([0.0, way])
        free = np.array(half_mm) - np.maximum(along, np.array([0.0, 1.0]) if along[0] else np.array([1.0, 0.0]))
        assert (middle.x_mm, middle.y_mm) == pytest.approx(np.array([3.0, -2.0]) - along, abs=0.06)
        assert (corner.x_mm - middle.x_mm, corner.y_mm - middle.y_mm) == pytest.approx(0.9 * free, abs=0.11)
    assert {run.command for run in found} <= {(30.0, 30.0)}


def test_a_command_at_which_chance_decides_is_no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candidate_runs, "simulate", lambda *_: SimpleNamespace(is_by_chance=True))
    assert not list(placed(load_robot("barrel"), (30.0, 30.0), (0,), Room((0.0, 0.0), (99.0, 99.0)), (MIDDLE,)))


def test_a_command_whose_motion_cannot_be_followed_is_no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any) -> None:
        raise SimulationError("the simulation did not finish")

    monkeypatch.setattr(candidate_runs, "simulate", refused)
    assert not list(placed(load_robot("barrel"), (30.0, 30.0), (0,), Room((0.0, 0.0), (99.0, 99.0)), (MIDDLE,)))


def test_path_of_a_straight_run_is_that_of_the_marks_from_the_origin_for_eight_seconds() -> None:
    robot = load_robot("barrel")
    path = candidate_runs._path(robot, (30.0, 30.0))
    assert path is not None
    assert path.shape == (81, 4)
    assert path[0] == pytest.approx(np.ravel(reference_places(robot)))
    assert path[-1] - path[0] == pytest.approx([4 * np.pi, 0.0, 4 * np.pi, 0.0], rel=0.01, abs=1e-6)  # 0.5 turns/s


@pytest.mark.parametrize(
    ("levels", "cell", "commands"),
    [
        ((60.0, 30.0), (1, 0), [(30, 30), (60, 60)]),
        ((30.0, 60.0), (-1, 0), [(-30, -30), (-60, -60)]),
        ((30.0, 60.0), (1, 1), [(12.9, 30), (42, 60)]),  # to the left: tight and slow, wide and fast
        ((30.0, 60.0), (1, -1), [(30, 12.9), (60, 42)]),
        ((30.0, 60.0), (-1, 1), [(-30, -12.9), (-60, -42)]),
        ((30.0, 60.0), (-1, -1), [(-12.9, -30), (-42, -60)]),
        ((10.0, 30.0, 60.0), (1, 1), [(4.3, 10), (21, 30), (25.8, 60)]),
        ((30.0,), (1, 1), [(12.9, 30), (21, 30)]),
    ],
)
def test_a_cell_of_a_plan_has_a_run_at_each_speed_and_both_turns_at_a_single_one(
    levels: tuple[float, ...], cell: tuple[int, int], commands: list[tuple[float, float]]
) -> None:
    assert plan._commands(levels, *cell) == commands


# What a run tells of a nominal value and two effects, by its heading: the first effect or the second in effect, or the
# first only beside the nominal value, whose prior leaves half of it.
TELLS = {
    0.0: np.diag([0.0, 9.0, 0.0]),
    90.0: np.diag([0.0, 0.0, 4.0]),
    45.0: 100 * np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]]),
}


def telling(information: np.ndarray) -> Linearized:
    """A run of this information about its columns, whatever its start pose; random effects do nothing."""
    values, vectors = np.linalg.eigh(information)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))).T
    size = len(root)
    unit = np.eye(3 + size)
    return Linearized(unit[0], np.vstack([np.zeros((3, size)), root]), unit[:, :3], np.zeros((3 + size, 4)))


def laboratory(monkeypatch: pytest.MonkeyPatch, tells: Callable[[CandidateRun], np.ndarray], **tolerance: float) -> Any:
    """A robot with values known to these tolerances, whose runs have this information."""

    def hypothetical(_robot: Any, _terms: Any, _noise: Any, runs: list[CandidateRun], *_: Any) -> tuple[Any, None]:
        return SimpleNamespace(attempted=lambda *_: [telling(tells(run)) for run in runs]), None

    monkeypatch.setattr(plan, "hypothetical", hypothetical)
    monkeypatch.setattr(plan, "quantities", lambda *_: ())
    return SimpleNamespace(tolerance=tolerance)


# Two effects, seen at ten steps, of 0.1 and 0.05, and a nominal value known to 0.5.
BOTH = {"a": effect("a"), "b": effect("b", step=0.05)}


def of_heading(run: CandidateRun) -> np.ndarray:
    """What a run tells of the nominal value and of both effects at these sizes, see TELLS."""
    return np.asarray(TELLS[run.heading_deg] / np.outer([0.5, 1.0, 0.5], [0.5, 1.0, 0.5]))


def test_each_run_of_a_plan_tells_most_that_is_new_of_the_effects_and_repeats_come_last(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = laboratory(monkeypatch, of_heading, k=0.5, exact=0.0)
    monkeypatch.setattr(
        plan,
        "placed",
        lambda _, command, *__: [CandidateRun(command[0], command[1], heading) for heading in (45.0, 0.0, 90.0)],
    )
    runs = plan.plan_runs(robot, BOTH, (30.0, 60.0), Room((0.0, 0.0), (9.0, 9.0)), 13)
    # gains of a tell of 10, 19/10, 28/19, … and of b 5, 9/5, 13/9, …, in the order of their size
    assert [run.heading_deg for run in runs[:6]] == [0.0, 90.0, 0.0, 90.0, 0.0, 90.0]
    signs = [(np.sign(run.left_rpm), np.sign(run.right_rpm - run.left_rpm)) for run in runs]
    assert signs[:6] == signs[6:12] == [(1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)]
    assert len({run.command for run in runs[:12]}) == 12
    assert {max(map(abs, run.command)) for run in runs} == {30.0, 60.0}
    assert runs[12].command in {runs[0].command, runs[6].command}


def test_an_effect_shows_by_what_values_within_their_tolerances_cannot_imitate(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = laboratory(monkeypatch, of_heading, k=0.5, exact=0.0)
    runs = [CandidateRun(30.0, 30.0, heading) for heading in (0.0, 0.0, 90.0, 45.0)]
    of_a, of_b = plan.expected(robot, BOTH, runs)
    alone = 18.0 + 100.0
    seen = np.sqrt(alone - 100.0**2 / 101.0)
    assert (of_a.effect, of_a.parameter, of_a.nearest, of_a.measure) == ("a", "size", "b", "k")
    assert (of_a.size, of_a.sigmas, of_a.apart_sigmas) == pytest.approx((1.0, seen, seen))
    assert of_a.measured_sigmas == pytest.approx(np.sqrt(alone))
    assert of_b.sigmas == pytest.approx(2.0)
    assert (of_b.measure, of_b.measured_sigmas) == ("", None)


@pytest.mark.parametrize(("own", "measure"), [(1.4, "k"), (2.2, "")])
def test_a_measurement_is_proposed_that_makes_an_effect_a_tenth_more_visible(
    own: float, measure: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 1 + own sigmas², a value as uncertain hides half of the 1: √(2.4/1.9) = 1.12, √(3.2/2.7) = 1.09."""
    told = np.array([[1.0, 1.0, 0.0], [1.0, 1.0 + own, 0.0], [0.0, 0.0, 4.0]]) / np.outer([0.5, 1, 0.5], [0.5, 1, 0.5])
    robot = laboratory(monkeypatch, lambda _: told, k=0.5)
    of_a, _ = plan.expected(robot, BOTH, [CandidateRun(30.0, 30.0, 0.0)])
    assert of_a.sigmas == pytest.approx(np.sqrt(own + 0.5))
    assert of_a.measure == measure


@pytest.mark.parametrize(
    ("squares", "shown"), [((4.0, 0.0), ("size", 2.0)), ((9.0, 4.0), ("kind", 2.0)), ((0.0, 0.0), ("size", 0.0))]
)
def test_an_effect_is_as_visible_as_its_least_visible_parameter_but_for_those_that_only_say_of_which_kind_it_is(
    squares: tuple[float, float], shown: tuple[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    coordinates = tuple(Coordinate(name, 0.0, 0.1) for name in ("size", "kind"))
    terms = {"a": effect("a"), "c": Candidate("c", coordinates, lambda values: {"size": values[0]})}
    robot = laboratory(monkeypatch, lambda _: np.diag([1.0, *squares]))
    _, found = plan.expected(robot, terms, [CandidateRun(30.0, 30.0, 0.0)])
    assert found.parameter == shown[0]
    assert found.sigmas == pytest.approx(shown[1])


def test_a_laboratory_knows_the_start_to_some_frames_and_what_its_robot_file_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known = SimpleNamespace(key="start_common_s", tolerance=0.1)
    asked: list[Any] = []
    monkeypatch.setattr(plan, "quantities", lambda usual, *_: asked.append(usual) or (known,))
    robot: Any = SimpleNamespace(tolerance={"body.mass_g": 0.05})
    assert plan._laboratory(robot) == ((known,), {"body.mass_g": 0.05, "start_common_s": 0.1})
    (usual,) = asked
    assert (60 * usual.start_common_s, 60 * usual.start_per_run_s) == pytest.approx((FRAMES_COMMON, FRAMES_PER_RUN))


def test_what_no_others_imitate_is_the_square_less_their_part() -> None:
    total = np.array([[4.0, 3.0], [3.0, 9.0]])
    assert plan._left_over(total, 0, []) == 2.0
    assert plan._left_over(total, 0, [1]) == pytest.approx(np.sqrt(4 - 9 / 9))
    assert plan._left_over(np.array([[4.0, 6.0], [6.0, 9.0]]), 0, [1]) == pytest.approx(0.0, abs=1e-6)


def test_an_attraction_is_told_by_its_size_at_four_of_its_places() -> None:
    coordinates = tuple(Coordinate(name, 0.0, 0.1) for name in ("size", "x_mm"))
    places = tuple((0.0, float(k)) for k in range(8))
    pull = Candidate("pull", coordinates, lambda values: {"size": values[0]}, starts=places)
    found = plan._columns({"pull": pull, "band": effect("band", stepwise=True), "a": effect("a")})
    assert [(column.key, column.coordinate, column.start) for column in found] == [
        *(("pull", 0, place) for place in places[::2]), ("a", 0, None),
    ]  # fmt: skip


def test_a_size_is_stated_as_the_parameter_that_its_coordinate_is_or_the_size_of_its_components() -> None:
    plain = Coordinate("factor", 1.0, 0.01)
    scale = Candidate("scale", (plain,), lambda values: {"factor": values[0]})
    name, value = plan._stated(Column("scale", 0, scale), 0.1)
    assert name == "factor"
    assert value == pytest.approx(1.1)
    parts = tuple(Coordinate(name, 0.0, 0.2) for name in ("along", "across"))
    tilt = replace(scale, coordinates=parts, physical=lambda _: {"angle_deg": 0.0, "azimuth_deg": 0.0})
    assert plan._stated(Column("tilt", 1, tilt), 2.0) == ("angle_deg", 2.0)
    assert plan._size(Column("tilt", 1, tilt)) == pytest.approx(2.0)


def test_a_run_tells_what_its_start_pose_and_its_own_friction_cannot_imitate(monkeypatch: pytest.MonkeyPatch) -> None:
    """A place of an attraction has a column of its own, every other one of the eight around; a step no column."""
    seen: list[Any] = []
    terms = {
        "magnet": effect("magnet", starts=tuple((float(place),) for place in range(8))),
        "band": effect("band", stepwise=True, starts=((1.0,),)),
        "tilt": effect("tilt"),
    }
    runs = linear_runs(count=2, parameters=6)

    def hypothetical(*given: Any) -> Any:
        seen.extend(given)
        return SimpleNamespace(attempted=lambda *_: [runs[0], None, runs[1]]), None

    monkeypatch.setattr(plan, "hypothetical", hypothetical)
    asked = [CandidateRun(30.0, 30.0, 0.0)] * 3
    found, columns = plan._information(load_robot("barrel"), terms, asked, [0, 1, 2], [Column("k")])
    assert [(column.key, column.start) for column in columns] == [
        ("k", None), ("magnet", (0.0,)), ("magnet", (2.0,)), ("magnet", (4.0,)), ("magnet", (6.0,)), ("tilt", None),
    ]  # fmt: skip
    scatter = np.array([0.03, 0.006, 0.006, 1.0])  # of friction, either gain, and the start in its own deviation
    for run, information in zip(runs, (found[0], found[2]), strict=True):
        _, common, own = free_of_start(run)
        covariance = np.eye(len(common)) + own @ np.diag(scatter**2) @ own.T
        np.testing.assert_allclose(information, common.T @ np.linalg.solve(covariance, common))
    assert not found[1].any()
    assert seen[-1] == pytest.approx(0.5 / 60)  # a run starts within half a frame
