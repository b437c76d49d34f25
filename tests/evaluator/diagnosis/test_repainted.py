"""Two groups of runs whose marks differ in their distance are told; a keystone, a camera or a spread makes none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes import repainted
from evaluator.diagnosis.mistakes.recognised import mistakes_of
from evaluator.diagnosis.mistakes.repainted import repainted_runs
from simulator.robot import load_robot

ROBOT = load_robot("barrel")  # its marks are 3.66 mm apart
TIME = np.arange(60) / 30


def _runs(
    spacings_mm: Sequence[float], places_mm: NDArray[np.float64] | None = None, keystone: float = 0.0
) -> list[RunData]:
    """Robots that turn on their place, seen by a camera whose scale grows by so much in 1 mm along x."""
    rng = np.random.default_rng(0)
    places_mm = rng.uniform(-30, 30, (len(spacings_mm), 2)) if places_mm is None else places_mm
    runs = []
    for number, (apart_mm, place) in enumerate(zip(spacings_mm, places_mm, strict=True)):
        half = apart_mm / 2 * np.column_stack([np.cos(TIME + number), np.sin(TIME + number)])
        marks = np.concatenate([place + half, place - half], axis=1)
        marks = marks * (1 + keystone * marks[:, [0, 0, 2, 2]]) + rng.normal(size=marks.shape) * 0.003
        runs.append(RunData(f"r{number}", 30.0, 20.0, 0.0, None, TIME, marks, number))
    return runs


@pytest.fixture(autouse=True)
def speeds(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Measured over simulated speeds of the runs; these turn on their place, which shows none."""
    found = [np.nan] * 12
    monkeypatch.setattr(repainted, "speeds_over_simulated", lambda data, _: np.array(found[: len(data)]))
    return found


@pytest.mark.parametrize(("changed", "kind"), [(0.95, "wrong-robot"), (1.05, "wrong-robot"), (1.01, "camera-moved")])
def test_marks_of_another_distance_in_the_last_two_runs_are_told(*, changed: float, kind: str) -> None:
    """A change that another calibration may cause is one of the camera, if errors of its scale may not."""
    found = mistakes_of(repainted_runs(_runs([3.66] * 6 + [3.66 * changed] * 2), [ROBOT] * 8), 8)
    assert [(item.runs, item.kind) for item in found] == [(("r6", "r7"), kind)]
    assert f"r7: their marks are {3.66 * changed:.3f}"[:-2] in found[0].sentence
    asked = "were they repainted?" if kind == "wrong-robot" else "was the camera moved or calibrated again, or"
    assert f"mm apart, in the other runs 3.66 mm; {asked}" in found[0].sentence.replace("3.659", "3.66")
    assert found[0].equivalent_kinds == (() if kind == "wrong-robot" else ("wrong-robot",))


@pytest.mark.parametrize(
    ("changed", "kind"),
    [*((share, None) for share in (0.93, 0.98, 0.997, 1.003, 1.01, 1.07)), (0.9, "wrong-robot"), (1.1, "wrong-robot")],
)
def test_marks_glued_on_anew_between_two_runs_are_no_mistake(*, changed: float, kind: str | None) -> None:
    """The distance of two of them, each known to 0.05 mm along each axis, changes by up to 8 %."""
    found = repainted_runs(_runs([3.66] * 6 + [3.66 * changed] * 3), [ROBOT] * 9)
    assert [(item.run, item.kind) for item in found] == ([(f"r{run}", kind) for run in (6, 7, 8)] if kind else [])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("faster", "scatter", "told"),
    [
        (0.02, 0.002, True),
        (0.011, 0.002, True),
        (0.009, 0.002, False),
        (0.02, 0.007, False),
        (0.02, 0.02, False),
        (-0.02, 0.002, False),
    ],
)
def test_a_camera_set_up_anew_is_told_from_the_speeds_which_change_as_the_distance_of_the_marks(
    speeds: list[float], *, faster: float, scatter: float, told: bool
) -> None:
    """By 2 % or at least by half of it, and beyond three standard errors; one run in each part shows no speed."""
    speeds[:9] = np.exp([0, scatter, -scatter, scatter, -scatter, np.nan, *(faster + np.array([0, scatter, -scatter]))])
    found = repainted_runs(_runs([3.66] * 6 + [3.66 * 1.02] * 3), [ROBOT] * 9)
    assert [(item.run, item.kind) for item in found] == [(f"r{run}", "camera-moved") for run in (6, 7, 8) if told]
    speeds[6:8] = [-1.0, np.nan]  # of the later runs a single one shows it, and one drives the other way
    assert repainted_runs(_runs([3.66] * 6 + [3.66 * 1.02] * 3), [ROBOT] * 9) == []


def test_a_small_change_to_and_fro_is_none_of_the_camera(speeds: list[float]) -> None:
    speeds[:8] = [1.0, 1.0, 1.008, 1.008] * 2
    runs = _runs([3.66, 3.66, 3.69, 3.69, 3.66, 3.66, 3.69, 3.69])
    assert repainted_runs(runs, [ROBOT] * 8) == []
    in_file = [replace(run, order=order) for run, order in zip(runs, (0, 1, 4, 5, 2, 3, 6, 7), strict=True)]
    assert {found.kind for found in repainted_runs(in_file, [ROBOT] * 8)} == {"camera-moved"}


@pytest.mark.parametrize("changed", [0.9, 1.1])
def test_of_two_halves_the_one_farther_from_the_robot_file_is_told_and_of_poses_none(changed: float) -> None:
    runs = _runs([3.66 * changed] * 4 + [3.66] * 4)
    assert [found.run for found in repainted_runs(runs, [ROBOT] * 8)] == ["r0", "r1", "r2", "r3"]
    runs[7] = replace(runs[7], from_poses=True)
    assert repainted_runs(runs, [ROBOT] * 8) == []


@pytest.mark.parametrize("wide", [0.03, 0.1])
def test_marks_of_all_distances_are_no_two_groups(wide: float) -> None:
    for seed in range(20):
        spread = np.random.default_rng(seed).uniform(-wide, wide, 12)
        assert repainted_runs(_runs(list(3.66 * (1 + spread))), [ROBOT] * 12) == []


def test_runs_in_two_corners_under_a_tilted_camera_are_no_two_groups() -> None:
    corners = np.array([[-30.0, 0.0]] * 6 + [[30.0, 0.0]] * 6) + np.random.default_rng(1).uniform(-8, 8, (12, 2))
    assert repainted_runs(_runs([3.66] * 12, corners, keystone=1e-3), [ROBOT] * 12) == []


def test_one_run_alone_is_no_group() -> None:
    assert repainted_runs(_runs([3.66] * 6 + [3.5]), [ROBOT] * 7) == []
    assert repainted_runs(_runs([3.66, 3.66, 3.5]), [ROBOT] * 3) == []


def test_four_runs_are_two_groups_only_if_they_are_without_a_keystone() -> None:
    """Some keystone makes two groups of no range of any four runs, such as of marks whose tracker errs slowly."""
    for seed in range(40):
        errors = np.random.default_rng(seed).normal(0.0, 0.003, 4)
        places = np.random.default_rng(seed + 100).uniform(-8, 8, (4, 2))
        assert repainted_runs(_runs(list(3.66 + errors), places), [ROBOT] * 4) == [], seed
    found = repainted_runs(_runs([3.66, 3.66, 3.5, 3.5]), [ROBOT] * 4)
    assert [item.run for item in found] == ["r2", "r3"]
