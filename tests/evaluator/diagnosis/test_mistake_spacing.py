"""The distance of the marks as it is seen, under a tilted camera as well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.mistakes.disturbances import wrong_scale
from evaluator.diagnosis.mistakes.repainted import repainted_runs
from evaluator.diagnosis.mistakes.spacing import by_keystone, spacing
from evaluator.robot_geometry import reference_line
from simulator.robot import load_robot
from tests.evaluator.diagnosis.marks_of_motion import TIME, moving, recorded

BARREL = load_robot("barrel")


def test_spacing_is_the_distance_over_the_stated_one_and_a_keystone_stretches_by_the_place() -> None:
    marks = moving(TIME)
    item = spacing(marks, 3.2)
    assert len(item.ratio) == 40
    np.testing.assert_allclose(item.ratio, 4.0 / 3.2)
    keystone = np.array([2e-4, -1e-4])
    bent = marks.copy()
    for mark in (slice(0, 2), slice(2, 4)):
        bent[:, mark] *= 1 + (marks[:, mark] @ keystone)[:, None]
    predicted = item.stretch_mm @ keystone
    np.testing.assert_allclose(spacing(bent, 3.2).ratio / item.ratio - 1, predicted, atol=1e-5)
    assert np.abs(predicted).max() > 5e-4


def under(keystone: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """Marks (n, 4) as a tilted camera shows them."""
    points = marks.reshape(-1, 2, 2)
    return (points / (1 - points @ keystone)[:, :, None]).reshape(-1, 4)


def test_keystone_is_learned_from_four_other_runs_one_of_which_may_be_of_another_robot() -> None:
    keystone = np.array([2e-3, -1e-3])
    paths = [moving(TIME, 2.0, 0.4, heading=number) + number for number in range(6)]
    runs = [spacing(under(keystone, path), 4.0) for path in paths]
    runs[2] = spacing(under(keystone, paths[2]), 4.0 / 1.4)
    expected = float(np.median(runs[0].ratio)) - 1
    assert abs(expected) > 2e-3
    assert by_keystone(runs[0], runs[1:]) == pytest.approx(expected, rel=0.05)
    assert by_keystone(runs[0], runs[1:4]) == 0.0


def test_a_camera_that_is_tilted_far_makes_no_other_robot_and_hides_none() -> None:
    """Distances that differ by a fifth, and then one of nine runs of a larger robot."""
    keystone, places = np.array([2.3e-3, -1.9e-3]), np.random.default_rng(3).uniform(-35.0, 35.0, (9, 2))
    line = np.hypot(*reference_line(BARREL))
    paths = [moving(TIME, 2.0, 0.4, heading=number) * line / 4.0 + np.tile(at, 2) for number, at in enumerate(places)]
    runs = [replace(recorded(under(keystone, path)), id=f"r{number}") for number, path in enumerate(paths)]
    ratios = [np.median(spacing(run.marks_mm, line).ratio) for run in runs]
    assert np.ptp(ratios) > 0.2
    assert wrong_scale(runs, [BARREL] * 9) == repainted_runs(runs, [BARREL] * 9) == []
    middle = (paths[5][:, :2] + paths[5][:, 2:]) / 2
    larger = np.tile(middle, 2) + 1.15 * (paths[5] - np.tile(middle, 2))
    runs[5] = replace(runs[5], marks_mm=under(keystone, larger))
    assert [(item.run, item.kind) for item in wrong_scale(runs, [BARREL] * 9)] == [("r5", "wrong-robot")]
