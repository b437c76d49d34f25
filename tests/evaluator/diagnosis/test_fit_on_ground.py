"""Fits to a robot of a metre: jumps of its motion, what runs have of their own, and estimates at a bound."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.inference.bounds import is_at_bound
from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.likelihood.features import Compression
from evaluator.diagnosis.likelihood.jumps import smooth_slope
from evaluator.diagnosis.likelihood.linear.mixed_model import MixedModel, reduce_runs
from evaluator.diagnosis.likelihood.noise.tracking import Noise
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.problem import OF_GROUND, START, Problem
from evaluator.diagnosis.likelihood.run_data import RunData, Task
from evaluator.diagnosis.output.silence import silent_reaches
from evaluator.diagnosis.search_input import show_starts
from simulator.effects.coordinates import Candidate, Coordinate
from simulator.effects.parameter import Size

FRAMES = 12
TRUTH = 3.0
EDGE = 0.05  # of the parameter: beyond it the second run turns over; the shortest step from 0 leads farther


@dataclass(frozen=True)
class Steps:
    """A world of one parameter, by which runs drift across; beyond EDGE run 1 drifts by a jump more."""

    jump_mm: float
    robots: tuple[Any, ...] = ()

    def marks(self, tasks: list[Task]) -> list[Any]:
        """Marks of every task, 2 mm apart, on a line along x."""
        time = np.linspace(0.0, 1.0, FRAMES)
        result = []
        for task in tasks:
            (size,) = task.terms.get("drift", (0.0,))
            aside = self.jump_mm if task.run == 1 and size > EDGE else 0.0
            x, y = (
                task.per_run[0] + (1 + task.per_run[3] + task.per_run[4]) * time,
                task.per_run[1] + (size + aside) * time**2,
            )
            angle = task.per_run[2] + np.zeros(FRAMES)
            result.append(np.column_stack([x - np.sin(angle), y + np.cos(angle), x + np.sin(angle), y - np.cos(angle)]))
        return result


@dataclass(frozen=True)
class Late(Steps):
    """A world whose parameter does nothing up to EDGE."""

    def marks(self, tasks: list[Task]) -> list[Any]:
        """Marks of every task for what of the parameter lies beyond."""
        beyond = [(max(task.terms.get("drift", (0.0,))[0] - EDGE, 0.0),) for task in tasks]
        return super().marks([replace(task, terms={"drift": more}) for task, more in zip(tasks, beyond, strict=True)])


DRIFT = Candidate("drift", (Coordinate("size", 0.0, 0.1, -10.0, 10.0),), lambda values: {"size": values[0]})


def problem_of(world: Steps, length: float, *, from_poses: bool = True) -> Problem:
    """Three runs of the world at the truth, without noise; their features are the channels themselves."""
    time = np.linspace(0.0, 1.0, FRAMES)
    true = Steps(0.0).marks([Task(run, (0.0,) * 7, {}, {"drift": (TRUTH,)}) for run in range(3)])
    data = tuple(
        RunData(str(run), 30.0, 60.0, 0.0, None, time, marks, run, from_poses=from_poses)
        for run, marks in enumerate(true)
    )
    channels = tuple(np.column_stack([np.zeros(FRAMES)] * 4) for _ in data)
    for channel, marks in zip(channels, true, strict=True):
        channel[:, 0], channel[:, 1] = (marks[:, 0] + marks[:, 2]) / 2, (marks[:, 1] + marks[:, 3]) / 2
        channel[:, 2], channel[:, 3] = np.pi / 2, 2.0
    whole = Compression(np.ones(FRAMES, dtype=np.bool_), (np.eye(FRAMES),) * 4)
    noise = ((Noise(1.0, 0.0, 0.1),) * 4,) * 3
    return Problem(data, cast("Any", world), channels, (whole,) * 3, noise, 1.0, length)


def fit_of(world: Steps, length: float) -> Fit:
    """The fit of the drift from where it is absent."""
    return fit_model(problem_of(world, length), Point(np.zeros((3, 7))), [DRIFT], {})


def test_a_fit_on_ground_goes_on_over_a_jump_of_one_run_and_keeps_the_best_point() -> None:
    """At 0 three runs miss by 3 each, 27 in squares; beyond, run 1 wants 3 + 6: at 5 they miss by 2, 4 and 2, 24.

    Every step from 0 makes it worse, also the whole one to 3: 36.
    """
    over = fit_of(Steps(-6.0), 100.0)
    assert over.point.terms["drift"][0] == pytest.approx(TRUTH + 6 / 3, abs=0.01)
    assert over.shortfall < 0.1
    assert fit_of(Steps(-6.0), 1.0).point.terms["drift"] == (0.0,)  # a plate's only goes down


def test_what_no_step_reached_is_taken_from_the_evidence() -> None:
    ground, plate = (fit_of(Steps(-40.0), length) for length in (100.0, 1.0))
    assert ground.converged
    assert ground.point.terms["drift"] == (0.0,)
    there = fit_of(Steps(0.0), 100.0).posterior.log_evidence  # what the view at 0 promises
    assert ground.posterior.log_evidence == pytest.approx(there - ground.shortfall / 2)
    assert ground.shortfall > 5
    assert plate.excess < 1.5  # on a plate, too, where the model explains the runs
    assert plate.converged
    assert plate.shortfall > 5


@dataclass(frozen=True)
class Bent(Steps):
    """A world whose runs drift by a parabola of the parameter."""

    bend: float = 0.0

    def marks(self, tasks: list[Task]) -> list[Any]:
        """Marks of every task."""
        sizes = [task.terms.get("drift", (0.0,))[0] for task in tasks]
        changed = [{"drift": (size + self.bend * size**2,)} for size in sizes]
        return super().marks([replace(task, terms=terms) for task, terms in zip(tasks, changed, strict=True)])


@pytest.mark.parametrize(
    ("bend", "length", "taken_at"), [(2000.0, 1.0, 0.1), (200.0, 1.0, 0.11), (2000.0, 100.0, 0.11)]
)
def test_a_slope_is_taken_from_both_sides_where_motion_on_a_plate_bends(
    bend: float, length: float, taken_at: float
) -> None:
    """A step is 0.02, so that a difference to one side is the slope at 0.11 instead of 0.1."""
    problem = problem_of(Bent(0.0, bend=bend), length)
    (view,) = problem.linearized(Point(np.zeros((3, 7)), terms={"drift": (0.1,)}), [Column("drift", 0, DRIFT)], [0])
    across = np.linspace(0.0, 1.0, FRAMES) ** 2
    if length == 1.0:
        assert view.common[FRAMES : 2 * FRAMES, 0] == pytest.approx((1 + 2 * bend * taken_at) * across, rel=1e-6)
    else:  # there such a step is a jump, to both sides
        assert not view.common.any()


def test_the_start_of_motion_has_one_side() -> None:
    """Before the first frame it hides how the robot starts: both sides together told twice what the runs know."""
    assert not Column("start_common_s").has_two_sides
    assert Column("time_base").has_two_sides
    assert Column("drift", 0, DRIFT).has_two_sides

    class Started(Bent):
        """A world whose runs drift by a parabola of their common start."""

        def marks(self, tasks: list[Task]) -> list[Any]:
            late = [{"drift": (task.nominal.get("start_common_s", 0.0),)} for task in tasks]
            return super().marks([replace(task, terms=terms) for task, terms in zip(tasks, late, strict=True)])

    problem = problem_of(Started(0.0, bend=2e6), 1.0)
    column = Column("start_common_s")
    (view,) = problem.linearized(Point(np.zeros((3, 7)), {"start_common_s": 0.002}), [column], [0])
    across = np.linspace(0.0, 1.0, FRAMES) ** 2
    forward = 1 + 2e6 * (2 * 0.002 + column.step)
    assert view.common[FRAMES : 2 * FRAMES, 0] == pytest.approx(forward * across, rel=1e-6)


def test_runs_on_ground_have_a_start_of_their_own_but_no_friction_and_gains() -> None:
    for length, has in ((1.0, True), (100.0, False)):
        problem = problem_of(Steps(0.0), length)
        (view,) = problem.linearized(Point(np.zeros((3, 7))), (), [0])
        assert view.start.any(axis=0).all()
        assert view.scatter[:, :2].any() == has
        model = MixedModel(reduce_runs([view]), np.zeros(0))
        assert (len(model.tau) > 1) == has
        assert model.logdet.min() == pytest.approx(0.0, abs=1e-6 if not has else 1e-3)
    assert len(OF_GROUND) == 4


@pytest.mark.parametrize(("from_poses", "varied"), [(True, [0, 1, 2, 6]), (False, [0, 1, 2, 3, 4, 5, 6])])
def test_runs_of_a_large_robot_whose_marks_a_camera_sees_have_friction_and_gains_of_their_own(
    from_poses: bool, varied: list[int]
) -> None:
    """On a slope, friction that differed by 10 % from run to run was named as one that varies over the plate.

    Wheel speeds that differed by 0.15 % were a speed that depends on the heading, with a grain of friction of 0.09 %.
    """
    assert problem_of(Steps(0.0), 100.0, from_poses=from_poses).varied.tolist() == varied


def test_a_parameter_that_no_run_shows_is_known_up_to_where_runs_are_worse_followed() -> None:
    """Beyond EDGE runs that drifted by TRUTH are followed better at first; 1.96² worse than before, they end it."""
    point, columns = Point(np.zeros((3, 7)), terms={"drift": (0.0,)}), (Column("drift", 0, DRIFT),)
    per_size = 3 * np.sum(np.linspace(0.0, 1.0, FRAMES) ** 4)
    end = EDGE + TRUTH + np.sqrt(TRUTH**2 + 1.96**2 / per_size)
    for world, wanted in ((Late(0.0), {0: end}), (Steps(0.0), {})):
        problem = problem_of(world, 100.0)
        fit: Any = SimpleNamespace(
            columns=columns, point=point, runs=(0, 1, 2), linearized=problem.linearized(point, columns)
        )
        assert silent_reaches(problem, fit) == pytest.approx(wanted, rel=0.02)


def test_an_estimate_is_at_a_bound_where_more_might_lie_beyond() -> None:
    lag = named_terms(20.0, (30.0,))["command-lag"]
    delay, share = Column("command-lag", 0, lag), Column("command-lag", 1, lag)
    assert [is_at_bound(delay, value) for value in (0.0, 0.3, 2.0)] == [False, False, True]  # absent at 0
    assert not is_at_bound(share, 1.0)  # a share ends at one
    stiffness = Column("tether-spring", 0, named_terms(20.0, (30.0,))["tether-spring"])
    assert [is_at_bound(stiffness, value) for value in (0.0, 0.001)] == [True, False]  # soft from afar: a tether-pull
    level = named_terms(20.0, (30.0,))["friction-level"]
    assert [is_at_bound(Column("friction-level", 0, level), value - 1) for value in (0.2, 1.0, 5.0)] == [
        True,
        False,
        True,
    ]


def test_friction_of_ice_is_not_believed_without_late_motors() -> None:
    level = named_terms(250.0, (30.0,), size=Size(250.0, 1e6))["friction-level"]
    column, point = Column("friction-level", 0, level), Point(np.zeros((3, 7)), terms={"friction-level": (-2.3,)})
    for beside, unbelieved in ((frozenset(), {"friction-level"}), (frozenset({"command-lag"}), frozenset())):
        fit: Any = SimpleNamespace(terms=beside | {"friction-level"}, columns=(column,), point=point)
        assert cast("Any", Fit.unbelieved).fget(fit) == unbelieved


def test_slopes_hold_no_jump() -> None:
    """The step of the derivative is 0.02; at 0.04 it leads over the edge at 0.05, and the other side is smooth."""
    at = Point(np.zeros((3, 7)), terms={"drift": (0.04,)})
    column = Column("drift", 0, DRIFT)
    for length in (100.0, 1.0):
        first, second, _ = problem_of(Steps(-60.0), length).linearized(at, [column])
        np.testing.assert_allclose(second.common, first.common, atol=1e-9)
        for view in (first, second):  # what is left of the response at the point is what the model leaves there
            left = view.response - view.common @ [0.04]
            assert np.abs(left).max() == pytest.approx(TRUTH - 0.04, abs=1e-9)


def test_beyond_its_bounds_no_parameter_is_tried_and_half_a_step_ahead_takes_the_place_of_one_behind() -> None:
    tried: list[float] = []

    @dataclass(frozen=True)
    class Watched(Steps):
        def marks(self, tasks: list[Task]) -> list[Any]:
            tried.extend(size for task in tasks for size in task.terms.get("drift", ()))
            return super().marks(tasks)

    bounded = replace(DRIFT, coordinates=(Coordinate("size", 0.0, 0.1, 0.03, 10.0),))
    for value, in_first_half in ((0.035, False), (0.045, True)):
        at = Point(np.zeros((3, 7)), terms={"drift": (value,)})
        first, second, _ = problem_of(Watched(-60.0), 100.0).linearized(at, [Column("drift", 0, bounded)])
        assert second.common.any() != in_first_half
        if not in_first_half:
            np.testing.assert_allclose(second.common, first.common, atol=1e-9)
    assert min(tried) == 0.035


def test_a_run_that_jumps_to_both_sides_says_nothing_of_a_parameter() -> None:
    here, ahead = np.array([1.0, 2.0]), np.array([0.0, 90.0])
    assert smooth_slope(ahead, here, here + np.array([0.0, 0.1]), 0.5, -0.5).tolist() == pytest.approx([0.0, 0.2])
    assert smooth_slope(ahead, here, here + np.array([0.0, 5.0]), 0.5, -0.5).tolist() == [0.0, 0.0]
    assert smooth_slope(ahead, here, here * np.nan, 0.5, -0.5).tolist() == [0.0, 0.0]


@pytest.mark.parametrize(("slope", "taken"), [(86.0, True), (85.0, False)])  # of 90: apart by less than a twentieth
def test_a_step_that_a_precise_run_shows_as_far_as_a_jump_is_smooth_where_both_sides_agree(
    slope: float, *, taken: bool
) -> None:
    here, behind = np.zeros(1), np.array([slope * 0.5])
    assert smooth_slope(np.array([90.0]), here, behind, 0.5, -0.5).tolist() == [slope if taken else 0.0]


def test_a_drift_is_fitted_to_runs_so_precise_that_its_smallest_step_is_many_sigmas() -> None:
    problem = problem_of(Steps(0.0), 100.0)
    precise = Compression(np.ones(FRAMES, dtype=np.bool_), (1e4 * np.eye(FRAMES),) * 4)
    fit = fit_model(replace(problem, compressions=(precise,) * 3), Point(np.zeros((3, 7))), [DRIFT], {})
    assert fit.point.terms["drift"][0] == pytest.approx(TRUTH, rel=1e-6)


def test_starts_are_fitted_where_what_is_unknown_of_them_shows() -> None:
    problem, at = problem_of(Steps(0.0), 100.0), Point(np.zeros((3, 7)))
    assert not show_starts(problem, at)  # in this world nothing depends on them
    assert list(replace(problem, starts_show=False).varied) == [0, 1, 2]
    assert START in problem.varied
