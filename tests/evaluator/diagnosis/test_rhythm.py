"""A rhythm of the residuals that all runs share is told with frequency and size; noise and random walks have none."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.assessment.residuals.rhythm import is_of_robot, rhythm

TIME = np.arange(260) / 60
START_S, STOP_S = 0.5, 4.0
HALF_MM = 1.83
Noise = Callable[[np.random.Generator], np.ndarray]


def white(rng: np.random.Generator) -> np.ndarray:
    return rng.normal(0.0, 0.002, len(TIME))


def walk(rng: np.random.Generator) -> np.ndarray:
    return np.cumsum(rng.normal(0.0, 0.002, len(TIME)))


def problem(
    *, along: float = 0.0, yaw: float = 0.0, noise: Noise = white, runs: int = 8, frequency: float = 1.3,
    shaken: tuple[float, float] = (0.0, 0.0), turns: float = 0.7, rest: float = 1.0,
) -> Any:  # fmt: skip
    """Runs whose residual speed, mm/s, and yaw rate, rad/s, oscillate with phases of their own, driven in a turn.

    shaken: amplitudes of the camera in x and y, mm, also at rest, there times `rest`. turns: from run to run, rad.
    """
    rng = np.random.default_rng(runs)
    residuals, channels, data = [], [], []
    for number in range(runs):
        heading = turns * number + 0.4 * TIME * (turns > 0)
        angle = 2 * np.pi * frequency * TIME + rng.uniform(0, 6)
        driven = (TIME > START_S) & (TIME < STOP_S)
        way, turned = (size / (2 * np.pi * frequency) * np.sin(angle) * driven for size in (along, yaw))
        way, turned = way + noise(rng) + 0.02 * TIME**2, turned + noise(rng) / HALF_MM
        residual = np.column_stack([np.cos(heading) * way, np.sin(heading) * way, HALF_MM * turned, 0 * TIME])
        shake = np.sin(angle)[:, None] * shaken * np.where(driven, 1.0, rest)[:, None]
        residual[:, :2] += shake
        residual[30:33] = np.nan
        residuals.append(residual)
        resting = 0.0005 * rng.normal(size=(len(TIME), 2)) + shake
        channels.append(np.column_stack([resting, heading + np.pi / 2, 0 * TIME + 2 * HALF_MM]))
        data.append(SimpleNamespace(time_s=TIME, start_s=START_S, stop_s=STOP_S if number else None))
    return SimpleNamespace(
        data=data, channels=channels, half_distance_mm=HALF_MM, residuals=lambda tasks: [residuals[k] for k in tasks]
    )


POINT: Any = SimpleNamespace(task=lambda number: number)


@pytest.mark.parametrize("frequency", [1.3, 4.0])
def test_a_speed_that_oscillates_in_all_runs_is_told_with_frequency_and_size(frequency: float) -> None:
    found = rhythm(problem(along=0.25, frequency=frequency), POINT)
    assert found is not None
    assert (found.quantity, found.by) == ("along_mm_s", "rhythm")
    assert found.sizes[0][0] == pytest.approx(frequency, abs=0.08)
    assert found.rms == pytest.approx(0.25 / np.sqrt(2), rel=0.1)
    assert f"measured speed along the robot oscillates at {frequency:.2g}"[:-1] in found.sentence
    assert "mm/s (that explains 9" in found.sentence


def test_of_speed_and_yaw_rate_the_one_is_told_that_is_explained_better() -> None:
    found = rhythm(problem(along=0.02, yaw=0.3, noise=walk), POINT)
    assert found is not None
    assert found.quantity == "yaw_deg_s"
    assert found.rms == pytest.approx(np.degrees(0.3) / np.sqrt(2), rel=0.15)


@pytest.mark.parametrize("noise", [white, walk])
def test_noise_has_no_rhythm(noise: Noise) -> None:
    for runs in (5, 8, 12):
        assert rhythm(problem(noise=noise, runs=runs), POINT) is None


def test_slow_courses_few_runs_and_short_ones_have_no_rhythm() -> None:
    assert rhythm(problem(along=0.25, frequency=0.5), POINT) is None  # less than two periods in a run
    assert rhythm(problem(along=0.25, runs=4), POINT) is None
    short = problem(along=0.25)
    for run in short.data:
        run.stop_s = START_S + 0.4
    assert rhythm(short, POINT) is None


@pytest.mark.parametrize(
    ("shown", "of_robot"),
    [
        ({"along": 0.25}, True),
        ({"along": 0.25, "shaken": (0.001, 0.001), "frequency": 8.0}, True),
        ({"yaw": 0.3}, True),
        ({"shaken": (0.03, 0.0)}, False),  # in all directions of driving
        ({"shaken": (0.03, 0.03), "frequency": 4.0}, False),
        ({"shaken": (0.03, 0.03), "yaw": 0.03}, True),  # what turns with it is no camera
        ({"shaken": (0.03, 0.03), "yaw": 0.004}, False),
        ({"shaken": (0.03, 0.0), "turns": 0.0, "frequency": 8.0}, False),  # along all runs, and before they start
        ({"shaken": (0.03, 0.0), "turns": 0.0, "frequency": 8.0, "rest": 0.4}, True),
        ({"shaken": (0.03, 0.0), "turns": 0.0, "frequency": 8.0, "rest": 0.6}, False),
        ({"shaken": (0.03, 0.0), "turns": 0.0, "frequency": 4.0}, True),  # two periods at rest are too few to tell
    ],
)
def test_a_camera_that_shakes_moves_marks_across_the_path_and_at_rest(shown: dict[str, Any], *, of_robot: bool) -> None:
    seen = problem(**shown)
    beat = rhythm(seen, POINT)
    assert beat is not None
    assert is_of_robot(seen, POINT, beat) == of_robot
