"""Features that are asked for again are those of the first simulation, and kernels see what the plain formulas see."""

import numpy as np

from evaluator.diagnosis.likelihood.feature_cache import MOST_OF_A_RUN, FeatureCache
from evaluator.diagnosis.likelihood.features import channel_residual, channels_of, residual_of_marks
from evaluator.diagnosis.likelihood.observed_marks import marks_of_states
from evaluator.diagnosis.likelihood.run_data import Task
from simulator.effects.view import View


def _task(run: int, x: float) -> Task:
    return Task(run, (x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), {"body.mass_g": 0.01}, {"plane-scale": (1.0,)})


def test_a_task_is_simulated_once_and_each_of_its_numbers_makes_it_another() -> None:
    asked: list[Task] = []

    def simulated(tasks: list[Task]) -> list[np.ndarray]:
        asked.extend(tasks)
        return [np.array([task.run, task.per_run[0], len(asked)]) for task in tasks]

    cache, first = FeatureCache(), _task(0, 1.0)
    others = [
        _task(1, 1.0),
        _task(0, 2.0),
        Task(0, first.per_run, {"body.mass_g": 0.02}, first.terms),
        Task(0, first.per_run, first.nominal, {"plane-scale": (2.0,)}),
    ]
    before = cache.of([first, first, *others], simulated)
    assert asked == [first, *others]
    after = cache.of([*others, first], simulated)
    assert len(asked) == 5
    np.testing.assert_array_equal(after, [*before[2:], before[0]])


def test_cache_gives_what_it_was_asked_for_however_many_and_forgets_the_oldest() -> None:
    def simulated(tasks: list[Task]) -> list[np.ndarray]:
        return [np.array([task.per_run[0]]) for task in tasks]

    def never(tasks: list[Task]) -> list[np.ndarray]:
        raise AssertionError(tasks)

    cache = FeatureCache()
    many = [_task(0, float(x)) for x in range(MOST_OF_A_RUN + 2)]
    cache.of(many[:1], simulated)
    np.testing.assert_array_equal(np.concatenate(cache.of(many, simulated)), np.arange(len(many)))
    np.testing.assert_array_equal(np.concatenate(cache.of(many[2:], never)), np.arange(2, len(many)))
    asked: list[Task] = []
    cache.of(many[:2], lambda tasks: asked.extend(tasks) or simulated(list(tasks)))  # type: ignore[func-returns-value]
    assert asked == many[:2]


def test_residual_of_marks_is_that_of_their_channels() -> None:
    rng = np.random.default_rng(4)
    marks, measured = rng.normal(0, 5, (50, 4)), rng.normal(0, 5, (50, 4))
    marks[3], measured[7, 2] = np.nan, np.nan
    expected = channel_residual(measured, channels_of(marks), 1.8)
    np.testing.assert_allclose(residual_of_marks(measured, marks, 1.8), expected, atol=1e-13)


def test_marks_of_states_are_those_of_the_view() -> None:
    rng = np.random.default_rng(5)
    states, times = rng.normal(0, 5, (12, 6)), np.arange(12.0)
    plain = View(((1.0, 2.0), (-1.5, -2.0)), scale=1.01)
    tilted = View(plain.places_mm, keystone_per_mm=(1e-3, 0.0))
    for view in (plain, tilted):
        moved = View(((1.03, 2.0), (-1.5, -2.05)), view.scale, view.keystone_per_mm)
        for found, expected in (
            (marks_of_states(states, times, view), view),
            (marks_of_states(states, times, view, (0.03, 0.0, 0.0, -0.05)), moved),
        ):
            there = np.concatenate(expected.marks(*states[:, :3].T, times), axis=1)
            np.testing.assert_allclose(found, there, rtol=1e-12)
