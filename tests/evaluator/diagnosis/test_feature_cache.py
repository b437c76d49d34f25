"""Features that are asked for again are those of the first simulation, and kernels see what the plain formulas see."""

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.feature_cache import MOST_OF_A_RUN, FeatureCache
from evaluator.diagnosis.likelihood.features import (
    channel_residual,
    channels_of,
    compression,
    residual_of_marks,
)
from evaluator.diagnosis.likelihood.noise.friction_wander import whitening
from evaluator.diagnosis.likelihood.noise.tracking import Noise
from evaluator.diagnosis.likelihood.observed_marks import Sight
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


def test_features_of_marks_are_those_of_their_residuals_and_of_each_alone() -> None:
    rng = np.random.default_rng(7)
    time, measured = np.arange(150) / 30, channels_of(rng.normal(0, 5, (150, 4)))
    marks, used = rng.normal(0, 5, (3, 150, 4)), rng.random(150) > 0.1
    even = compression(time, used, (Noise(0.004, 0.0, 0.1),) * 4)
    modes = sum(part.shape[1] for part in even.functional)
    for part in (even, replace(even, ground=whitening(rng.normal(size=(modes, 5))))):
        found = part.features_of_marks(measured, marks, 1.8)
        expected = [part.features(residual_of_marks(measured, item, 1.8)[used]) for item in marks]
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-8)
        np.testing.assert_array_equal(found[1], part.features_of_marks(measured, marks[1:2], 1.8)[0])


@pytest.mark.parametrize("shift", [np.zeros((0, 4)), np.full((12, 4), 0.2)])
def test_marks_of_a_path_are_those_of_the_view_of_its_states_laid_elsewhere(shift: np.ndarray) -> None:
    rng = np.random.default_rng(5)
    path, times, begin, start = rng.normal(0, 5, (12, 6)), np.arange(12.0), (1.0, -2.0, 0.3), (4.0, 3.0, -0.5)
    turn = np.exp(1j * (start[2] - begin[2]))
    there = complex(*start[:2]) + turn * (path[:, 0] + 1j * path[:, 1] - complex(*begin[:2]))
    plain = View(((1.0, 2.0), (-1.5, -2.0)), scale=1.01)
    tilted = View(plain.places_mm, keystone_per_mm=(1e-3, 0.0))
    for view in (plain, tilted):
        moved = View(((1.03, 2.0), (-1.5, -2.05)), view.scale, view.keystone_per_mm)
        for off, seen in (((), view), ((0.03, 0.0, 0.0, -0.05), moved)):
            marks = np.concatenate(seen.marks(there.real, there.imag, path[:, 2] + start[2] - begin[2], times), axis=1)
            found = Sight(1.002, shift, off).marks(path, times, begin, start, view)
            np.testing.assert_allclose(found, 1.002 * marks + (shift if len(shift) else 0.0), rtol=1e-12)
