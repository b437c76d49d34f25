"""An experiment put together from runs whose marks are known in closed form: noise, bases of derivatives, batches."""

from __future__ import annotations

from dataclasses import replace
from threading import get_ident
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.inference.watch import Cores, Watch
from evaluator.diagnosis.likelihood import problem as problems
from evaluator.diagnosis.likelihood.features import channels_of
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.linear.random_effects import MOST_SCATTER, _per_run_goal, secant, settled
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.preparation import NO_DISTANCE_MM, build_problem
from evaluator.diagnosis.likelihood.problem import Problem
from evaluator.diagnosis.likelihood.run_data import RunData, Task
from simulator.robot import load_robot
from tests.evaluator.diagnosis.synthetic import linear_runs

TIME = np.arange(120) / 30
SIGMA_MM = 0.004


def marks_at(x: np.ndarray, y: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Marks 2 mm to the left and to the right."""
    left = 2 * np.column_stack([-np.sin(heading), np.cos(heading)])
    middle = np.column_stack([x, y])
    return np.concatenate([middle + left, middle - left], axis=1)


class Circle:
    """Robots that turn on a circle of 5 mm at 1 rad/s times their gain; the effect "pull" drags them by a·t²."""

    robots = (load_robot("barrel"),)

    def __init__(self, data: tuple[RunData, ...]) -> None:
        self.data = data
        self.asked: list[int] = []

    def marks(self, tasks: list[Task]) -> list[np.ndarray]:
        self.asked.append(len(tasks))
        found = []
        for task in tasks:
            own, (pull, power) = task.per_run, task.terms.get("pull", (0.0, 1.0))
            turned = (1 + own[3] + 0.5 * own[4] - 0.5 * own[5] - 0.02 * own[6]) * self.data[task.run].time_s
            drag = 0.1 * pull * self.data[task.run].time_s ** power
            x, y = own[0] + 5 * np.sin(own[2] + turned) + drag, own[1] - 5 * np.cos(own[2] + turned)
            found.append(marks_at(x, y, own[2] + turned))
        return found


def measured(runs: int = 3, seed: int = 0, sigma_mm: float = SIGMA_MM, **changes: Any) -> tuple[RunData, ...]:
    rng = np.random.default_rng(seed)
    bare = tuple(
        RunData(f"r{number}", 30.0, 20.0, 0.0, None, TIME, np.zeros((120, 4)), number, **changes)
        for number in range(runs)
    )
    exact = Circle(bare).marks([Task(n, (n, 2.0, 0.3 * n, 0.0, 0.0, 0.0, 0.0)) for n in range(runs)])
    noisy = [marks + sigma_mm * rng.normal(size=marks.shape) for marks in exact]
    return tuple(replace(run, marks_mm=marks) for run, marks in zip(bare, noisy, strict=True))


def test_noise_of_an_experiment_is_that_of_its_frames_and_starts_are_laid_on_them() -> None:
    data = measured(runs=8)
    problem, point = build_problem(data, Circle(data))  # type: ignore[arg-type]
    assert problem.half_distance_mm == pytest.approx(2.0, abs=1e-3)
    np.testing.assert_allclose(point.per_run[:, :3], [[n, 2.0, 0.3 * n] for n in range(8)], atol=0.01)
    # Middle and direction of two marks: that of a coordinate over √2; their distance: times √2.
    sizes = np.mean([[part.sigma_mm for part in parts] for parts in problem.noise], axis=0)
    assert sizes == pytest.approx(SIGMA_MM * np.sqrt([0.5, 0.5, 0.5, 2.0]), rel=0.2)
    assert all(part.drift.size_mm == 0 for parts in problem.noise for part in parts)
    (view, *_) = problem.linearized(settled(problem, point, range(8), None)[0], [])
    assert view.response @ view.response / len(view.response) == pytest.approx(1.0, abs=0.5)


@pytest.mark.parametrize("frame", [0, 60])
def test_a_jump_below_the_motion_from_frame_to_frame_does_not_count(frame: int) -> None:
    data = measured(runs=8)
    marks = data[1].marks_mm.copy()
    marks[frame, :2] += 0.1  # the robot moves by 0.17 mm from frame to frame
    spoilt = tuple(replace(run, marks_mm=marks) if run.id == "r1" else run for run in data)
    problem, _ = build_problem(spoilt, Circle(spoilt))  # type: ignore[arg-type]
    lost = [np.flatnonzero(np.isnan(item).any(axis=1)).tolist() for item in problem.channels]
    assert lost == [[], [frame], *[[]] * 6]
    assert problem.counting_frames(1).sum() == len(TIME) - 1


def test_marks_that_stand_for_poses_have_no_distance_to_be_wrong() -> None:
    data = measured(from_poses=True)
    problem, _ = build_problem(data, Circle(data))  # type: ignore[arg-type]
    assert [parts[3].white_mm for parts in problem.noise] == [NO_DISTANCE_MM] * 3
    stretched = np.zeros((120, 4))
    stretched[:, 3] = 1.0  # a millimetre
    assert np.abs(problem.compressions[0].features(stretched)).max() < 1e-6
    assert problem.noise[0][0].white_mm < 0.01


def pull(power: float, size: float = 0.0) -> Column:
    """How far a pull drags, seen from where it has this size and grows with this power of the time."""
    coordinates = (SimpleNamespace(step=0.5, absent=0.0), SimpleNamespace(step=1.0, absent=1.0))
    term: Any = SimpleNamespace(coordinates=coordinates, absent=(0.0, 1.0))
    return Column("pull", 0, term, (size, power))


@pytest.fixture(scope="module")
def built() -> tuple[Problem, Point]:
    data = measured()
    problem, point = build_problem(data, Circle(data))  # type: ignore[arg-type]
    return problem, replace(point, per_run=np.add(point.per_run, [0, 0, 0, 0.01, 0, 0, 0]))


@pytest.mark.parametrize(("power", "size"), [(1.0, 0.0), (2.0, 0.0), (2.0, 0.4)])
def test_an_effect_seen_from_a_place_of_its_own_has_the_derivative_of_that_place(
    built: tuple[Problem, Point], power: float, size: float
) -> None:
    """What the pull does to the marks, 0.1·t to its power along x, less what is predicted: minus the residual."""
    problem, point = built
    columns = [pull(1.0), pull(power, size), Column("time_base")]
    views = problem.linearized(point, columns)
    for run, view in enumerate(views):
        shift = np.zeros((120, 4))
        shift[:, 0] = 0.1 * TIME**power
        np.testing.assert_allclose(view.common[:, 1], problem.compressions[run].features(shift), atol=1e-5)
        assert (view.common[:, 2] == 0).all()  # the circle knows no clock
    assert problem.linearized(point, columns[1:2], [2])[0].response == pytest.approx(views[2].response)


@pytest.mark.parametrize(
    ("fails", "seen"),
    [
        (lambda task: task.terms.get("pull", (0.0,))[0] > 0, True),  # a candidate offers nothing where it fails
        (lambda task: task.per_run[4] > 0, False),  # but a run needs its slopes by friction and gains
        (lambda task: task.per_run[6] > 0, False),
        (lambda _: True, False),
    ],
    ids=["effect", "gain", "start", "everything"],
)
def test_a_run_is_seen_without_the_effects_that_cannot_be_simulated(fails: Any, seen: bool) -> None:
    data = measured()
    circle: Any = Circle(data)
    problem, point = build_problem(data, circle)
    marks = circle.marks
    circle.marks = lambda tasks: [
        found * np.nan if fails(task) else found for task, found in zip(tasks, marks(tasks), strict=True)
    ]
    point = replace(point, per_run=np.add(point.per_run, [0, 0, 0, 0.01, 0, 0, 0]))
    columns = [*(Column(f"unknown_{number}") for number in range(8)), pull(1.0)]  # a circle knows none of these
    view = problem.attempted(point, columns, [1])[0]
    assert (view is not None) == seen
    if view is not None:
        assert not view.common.any()
        assert np.abs(view.scatter).max() > 0


def test_starts_far_from_where_a_run_began_are_found_in_more_steps_than_one(built: tuple[Problem, Point]) -> None:
    """Headings off by half a radian are beyond what one linear step makes good."""
    problem, point = built
    off = replace(point, per_run=np.array([[number, 2.0, 0.3 * number + 0.5, 0, 0, 0, 0] for number in range(3)]))
    found, value = settled(problem, off, range(3), None)
    np.testing.assert_allclose(found.per_run[:, :3], [[n, 2.0, 0.3 * n] for n in range(3)], atol=0.01)
    assert value / sum(len(view.response) for view in problem.linearized(found, [])) < 1.5


def test_slopes_from_nearby_lead_to_the_same_place_with_fewer_simulations(built: tuple[Problem, Point]) -> None:
    problem, point = built
    forward: Any = problem.forward
    off = replace(point, per_run=np.add(point.per_run, [0.05, -0.05, 0.02, -0.01, 0, 0, 0]))
    views = problem.linearized(point, [])
    found = []
    for seen in (None, views):
        forward.asked.clear()
        found.append((*settled(problem, off, range(3), None, seen), sum(forward.asked)))
    (there, value, simulated), (other, same, fewer) = found
    np.testing.assert_allclose(other.per_run[:, :3], there.per_run[:, :3], atol=2e-3)
    assert same == pytest.approx(value, abs=0.06)  # three runs, each settled to 0.02
    assert fewer < 0.7 * simulated


@pytest.mark.parametrize("common", [0, 2])
def test_a_step_corrects_slopes_along_itself_to_what_it_changed_and_no_other_way(common: int) -> None:
    rng = np.random.default_rng(6)
    steps = np.array([*(5e-4, 0.2)[:common], 1e-3, 1e-3, 1e-4, 1e-3, 2e-4, 2e-4, 0.1])
    before, moved = rng.normal(0, 1e-2, common + 7), steps * rng.normal(0, 1, common + 7)
    true, slopes = rng.normal(0, 1, (30, common + 7)), rng.normal(0, 1, (30, common + 7))
    counted = np.r_[np.ones(common), np.zeros(3), np.ones(4)]  # a start pose is measured from where a view was taken

    def view(own: np.ndarray) -> Linearized:
        return Linearized(-true @ own + slopes @ (counted * own), *np.split(slopes, [common, common + 3], axis=1))

    after = before + moved
    found = secant(view(before), view(after), before, after, steps)
    corrected = np.column_stack([found.common, found.start, found.scatter])
    np.testing.assert_allclose(corrected @ moved, true @ moved, rtol=1e-9)
    aside = np.linalg.svd((moved / steps)[None])[2][1:].T * steps[:, None]  # steps at right angles to the one made
    np.testing.assert_allclose(corrected @ aside, slopes @ aside, atol=1e-12)
    np.testing.assert_allclose(found.response - corrected @ (counted * after), -true @ after, atol=1e-12)


def test_one_core_and_three_see_the_same_to_the_last_bit(
    built: tuple[Problem, Point], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, point = built
    columns = [pull(1.0), pull(2.0)]
    monkeypatch.setattr(problems, "TASKS_AT_ONCE", 10)  # a piece for each run
    at: list[int] = []
    with Cores(3) as each:
        watch = Watch(each=lambda work, items: each(lambda item: at.append(get_ident()) or work(item), items))
        shared = replace(problem, watch=watch).linearized(point, columns)
    assert len(at) == 3
    assert get_ident() not in at
    for one, other in zip(problem.linearized(point, columns), shared, strict=True):
        for name in ("response", "common", "start", "scatter"):
            assert (getattr(one, name) == getattr(other, name)).all()


def test_cores_do_their_work_in_order_in_their_block_and_after_it() -> None:
    with Cores(2) as each:
        assert list(each(abs, [-3, 2, -1])) == [3, 2, 1]
    assert list(each(abs, [-3, 2, -1])) == [3, 2, 1]


def test_batches_of_any_size_see_the_same(built: tuple[Problem, Point], monkeypatch: pytest.MonkeyPatch) -> None:
    problem, point = built
    columns = [pull(1.0), pull(2.0)]
    whole = problem.attempted(point, columns, [0, 1, 2])
    forward: Any = problem.forward
    forward.asked.clear()
    monkeypatch.setattr(problems, "TASKS_AT_ONCE", 20)  # a run takes 2 columns, 7 numbers of its own and itself
    parts = replace(problem).attempted(point, columns, [0, 1, 2])  # nothing is cached
    assert len(forward.asked) == 2  # of two runs and of one
    for one, other in zip(whole, parts, strict=True):
        assert one is not None
        assert other is not None
        np.testing.assert_array_equal(one.common, other.common)
        np.testing.assert_array_equal(one.response, other.response)


def test_fingerprint_is_that_of_the_marks(built: tuple[Problem, Point]) -> None:
    first, same, other = (
        replace(built[0], channels=tuple(channels_of(run.marks_mm) for run in data)).fingerprint
        for data in (measured(), measured(), measured(seed=1))
    )
    assert first == same != other


def test_own_numbers_of_a_run_stay_where_a_linear_step_can_be_trusted() -> None:
    """A response of thousands asks for friction and gains of ten: half is the most, and a start of 12 sigmas."""
    (run,) = linear_runs(count=1)
    loose = np.array([1e3, 1e3, 1e3, 1e3])
    wild = replace(run, response=run.scatter @ np.array([10.0, -10.0, 10.0, -50.0]))
    np.testing.assert_allclose(_per_run_goal(wild, np.zeros(7), loose)[3:], [0.5, -0.5, 0.5, -12.0])
    tame = replace(run, response=run.scatter @ np.array([0.45, -0.45, 0.45, -11.0]))
    np.testing.assert_allclose(_per_run_goal(tame, np.zeros(7), loose)[3:], [0.45, -0.45, 0.45, -11.0], rtol=1e-4)
    assert MOST_SCATTER.tolist() == [0.5, 0.5, 0.5, 12.0]
