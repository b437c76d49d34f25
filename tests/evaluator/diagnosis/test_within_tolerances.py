"""The best agreement of a run with its file within tolerances, of marks that are linear in every value."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.likelihood import within_tolerances
from evaluator.diagnosis.likelihood.run_data import PER_RUN, START_POSE, Task
from evaluator.diagnosis.likelihood.within_tolerances import _line, _step, misfit_within_tolerances

PATH = np.array([1.0, 1j, -1.0, -1j])  # a change of its size is neither a shift nor a rotation of it
SHAPE = np.array([1.0, -1.0, 1.0, -1.0])  # and neither is this


def test_marks_of_a_frame_are_two_points_of_the_plane() -> None:
    assert _line(np.array([[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]])).tolist() == [1 + 2j, 3 + 4j, 5 + 6j, 7 + 8j]


@pytest.mark.parametrize(
    ("misses", "value", "step"),
    [
        (0.5, 0.0, 0.5 / 1.0025),  # a ridge of a tenth of the misfit: its square is a hundredth of misses²
        (-0.5, 1.0, (-0.5 - 0.0025) / 1.0025),
        (3.0, 0.0, 2.0),  # two sigmas at most
        (3.0, 0.5, 1.5),
        (-5.0, 0.5, -2.5),
    ],
)
@pytest.mark.parametrize("pose", [(0.0, 0.0), (0.8, 3.0 - 2.0j)])
def test_a_value_steps_by_what_its_path_misses_to_two_sigmas_at_most_wherever_it_starts(
    misses: float, value: float, step: float, pose: tuple[float, complex]
) -> None:
    measured = np.exp(1j * pose[0]) * (1 + misses * 0.25) * PATH + pose[1]
    change = 0.25 * PATH + 0.4j * PATH + 2 - 1j  # the start pose makes up for the rotation and the shift
    found = _step(np.array([value]), measured, PATH + 0j, [change])
    assert found == pytest.approx([step], rel=1e-9)


def test_values_of_one_influence_share_a_step_and_one_without_any_moves_not() -> None:
    measured = PATH + 0.4 * SHAPE
    found = _step(np.zeros(3), measured, PATH + 0j, [SHAPE + 0j, SHAPE + 0j, 0j * SHAPE])
    assert found == pytest.approx([0.4 / (2 + 0.1**2 * 0.4**2)] * 2 + [0.0], abs=1e-9)


class Linear:
    """Marks that every value moves in its own way; friction, the last, by its deviation per 0.1."""

    def __init__(self, robots: Sequence[Any], data: Sequence[Any], terms: Any, known: Any) -> None:
        assert (len(robots), len(data), terms, known) == (1, 1, {}, "sigmas")
        self.ways = np.random.default_rng(5).normal(size=(4, 20, 4))

    def marks(self, tasks: Sequence[Task]) -> list[np.ndarray]:
        assert {task.run for task in tasks} == {0}
        return [
            self.ways[0]
            + 0.2 * task.nominal.get("known", 0.0) / 0.5 * self.ways[1]
            + 0.2 * task.nominal.get("table.name", 0.0) / 0.03 * self.ways[2]
            + 0.2 * task.per_run[START_POSE] / 0.1 * self.ways[3]
            for task in tasks
        ]


@pytest.mark.parametrize(
    ("truth", "misfit"), [((1.0, -0.7, 1.5), 0.0), ((-1.9, 1.9, -1.9), 0.0), ((0.0, 0.0, 4.0), 2 * 0.2)]
)
def test_values_of_tolerance_and_friction_are_fitted_in_their_sigmas(
    monkeypatch: pytest.MonkeyPatch, truth: tuple[float, float, float], misfit: float
) -> None:
    """Of a run beyond two sigmas of its friction, what the other two remain: the change of the marks in length."""
    monkeypatch.setattr(within_tolerances, "Simulated", Linear)
    monkeypatch.setattr(within_tolerances, "quantities", lambda *_: [SimpleNamespace(key="known", tolerance=0.5)])
    monkeypatch.setattr(within_tolerances, "predicted_sigmas", lambda _: "sigmas")
    robot: Any = SimpleNamespace(tolerance={"table.name": 0.03, "table.exact": 0.0}, effect=())
    per_run = np.zeros(PER_RUN)
    per_run[START_POSE] = 0.1 * truth[2]
    forward = Linear([robot], [0], {}, "sigmas")
    (marks,) = forward.marks([Task(0, tuple(per_run), {"known": 0.5 * truth[0], "table.name": 0.03 * truth[1]})])
    turned = np.exp(0.7j) * _line(marks) + 5 - 3j
    run: Any = SimpleNamespace(marks_mm=np.column_stack([turned.real, turned.imag]).reshape(20, 4))
    found = misfit_within_tolerances(run, robot)
    exact = float(np.sqrt(np.mean(forward.ways[3] ** 2) * 2)) * misfit
    assert found == pytest.approx(exact, rel=0.1, abs=2e-3)


def test_a_run_that_cannot_be_simulated_is_infinitely_far(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(within_tolerances, "Simulated", Linear)
    monkeypatch.setattr(Linear, "marks", lambda _, tasks: [np.full((20, 4), np.nan) for _ in tasks])
    monkeypatch.setattr(within_tolerances, "quantities", lambda *_: [SimpleNamespace(key="known", tolerance=0.5)])
    monkeypatch.setattr(within_tolerances, "predicted_sigmas", lambda _: "sigmas")
    run: Any = SimpleNamespace(marks_mm=np.zeros((20, 4)))
    robot: Any = SimpleNamespace(tolerance={}, effect=())
    assert misfit_within_tolerances(run, robot) == np.inf


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_each_of_two_turns_is_found_between_which_the_least_step_of_a_value_decides(
    side: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A turn on the spot on tires was told as one of exchanged marks: its other turn, with the robot the other way."""

    class Forking(Linear):
        def marks(self, tasks: Sequence[Task]) -> list[np.ndarray]:
            turns = [np.sign(task.nominal.get("table.name", 0.0)) for task in tasks]
            return [marks + turn * self.ways[3] for marks, turn in zip(super().marks(tasks), turns, strict=True)]

    monkeypatch.setattr(within_tolerances, "Simulated", Forking)
    monkeypatch.setattr(within_tolerances, "quantities", lambda *_: [SimpleNamespace(key="known", tolerance=0.5)])
    monkeypatch.setattr(within_tolerances, "predicted_sigmas", lambda _: "sigmas")
    robot: Any = SimpleNamespace(tolerance={"table.name": 0.03}, effect=())
    values = {"known": 0.3, "table.name": 0.02 * side}
    (marks,) = Forking([robot], [0], {}, "sigmas").marks([Task(0, (0.0,) * PER_RUN, values)])
    assert misfit_within_tolerances(SimpleNamespace(marks_mm=marks), robot) < 0.01  # type: ignore[arg-type]
