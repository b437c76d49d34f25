"""Limits that decide a verdict or a status, each from either side, against published formulas or by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import optimize, stats

from evaluator.diagnosis.assessment import cross_validation, gap
from evaluator.diagnosis.assessment.adequacy import unlike_runs
from evaluator.diagnosis.assessment.gap import Gap, beyond_noise, not_shrunk
from evaluator.diagnosis.assessment.knowledge import strained
from evaluator.diagnosis.assessment.sole_run import sole_gains
from evaluator.diagnosis.assessment.verdict import material_gain
from evaluator.diagnosis.likelihood.point import Column
from evaluator.diagnosis.output.effects_json import equivalents

OTHERS = np.array([-1.3, -0.8, -0.4, -0.1, 0.2, 0.5, 0.7, 1.2, -0.6, 0.6])


def critical(probability: float, count: int) -> float:
    """Grubbs' critical deviation of the farthest of some normal values, in their standard deviations."""
    square = stats.t.ppf(1 - probability / (2 * count), count - 2) ** 2
    return float((count - 1) / np.sqrt(count) * np.sqrt(square / (count - 2 + square)))


@pytest.mark.parametrize(("times", "unlike"), [(0.99, False), (1.01, True)])
def test_a_run_is_unlike_the_others_where_chance_makes_one_so_in_a_thousand_experiments(
    times: float, unlike: bool
) -> None:
    """A third of that for friction and for either gain."""

    def apart(value: float) -> float:
        every = np.append(OTHERS, value)
        return float((value - every.mean()) / every.std(ddof=1))

    value = float(optimize.brentq(lambda at: apart(at) - times * critical(1e-3 / 3, 11), 1.0, 50.0))
    effects = np.zeros((11, 4))
    effects[:, 0] = 0.01 * np.append(OTHERS, value)
    left: Any = SimpleNamespace(random_effects=effects, shares=np.ones((11, 4)))
    assert [item.runs for item in unlike_runs(left, range(11))] == ([(10,)] if unlike else [])


@pytest.mark.parametrize(("before", "contradicted"), [(2.4, False), (2.6, True)])
def test_a_gap_of_held_out_runs_has_to_shrink_where_it_is_two_and_a_half_times_the_noise_floor(
    before: float, contradicted: bool
) -> None:
    seen = Gap(np.array([9.0, before]), np.array([1.0, before]), np.ones(2), np.ones(2), np.ones(2))
    assert bool(not_shrunk(seen, [1])) == contradicted


@pytest.mark.parametrize(
    ("off_mm", "random_mm", "floors"), [(0.0, 0.0, 0.0), (6.0, 0.0, 0.980), (6.0, 4.0, 0.696), (6.0, 8.0, 0.0)]
)
def test_residuals_beyond_noise_are_counted_in_floors_of_all_runs_and_channels(
    off_mm: float, random_mm: float, floors: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two runs with noise of 3, 4 and 5 mm along x, y and the direction; one of them is off in its direction."""
    noise = [SimpleNamespace(sigma_mm=sigma) for sigma in (3.0, 4.0, 5.0, 1.0)]
    rows = np.array([[3.0, 4.0, 5.0, 90.0], [-3.0, np.nan, 0.0, 0.0], [3.0, -4.0, -5.0, 90.0]])
    runs = [rows, rows.copy()]
    runs[1][:, 2] = [-off_mm - 5.0, 0.0, off_mm + 5.0]  # the mark that is missing between them counts nowhere
    problem: Any = SimpleNamespace(
        open_ground=True,
        noise=[noise, noise],
        residuals=lambda tasks: [runs[task] for task in tasks],
        compressions=[SimpleNamespace(random_mm=random_mm)] * 2,
        of_tracking="noise of tracking alone",
    )
    placed = SimpleNamespace(task=lambda run: run)
    monkeypatch.setattr(gap, "place_runs", lambda *asked: placed if asked == wanted else None)
    fit: Any = SimpleNamespace(runs=(0, 1), point="fitted", posterior=SimpleNamespace(scatter="scatter"))
    wanted = "noise of tracking alone", "fitted", (0, 1), "scatter"
    assert beyond_noise(problem, fit) == pytest.approx(floors, abs=1e-3)


@pytest.mark.parametrize(
    ("value", "size", "candidates", "better"),
    [
        (2.30, 1.0, 1, False),
        (2.40, 1.0, 1, True),
        (2.40, 0.02, 1, True),
        (2.40, 1.0, 20, True),  # more than the best of many gains by chance
        (2.40, 0.02, 20, False),
        (7.40, 0.02, 20, False),
        (7.50, 0.02, 20, True),  # 7.453 standard errors for one of twenty
    ],
)
def test_commands_left_out_are_predicted_better_at_five_per_cent_of_student(
    value: float, size: float, candidates: int, better: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of four commands: 2.353 standard errors of the mean logarithm of the ratio."""
    steps = size * np.array([-1.0, 1.0, -1.0, 1.0])
    ratios = value * steps.std(ddof=1) / 2 + steps
    answers = iter((-np.full(4, 10.0), -10.0 * np.exp(ratios)))
    monkeypatch.setattr(cross_validation, "_densities", lambda *_: next(answers))
    monkeypatch.setattr(cross_validation, "left_out_together", lambda _: [np.array([k]) for k in range(4)])
    fit: Any = SimpleNamespace(runs=range(4))
    found = cross_validation.predicts_better(fit, fit, [None] * 4, {}, candidates)  # type: ignore[list-item]
    assert found == better


@pytest.mark.parametrize(("runs", "found"), [(4, 3), (3, None)])
def test_three_runs_that_agree_show_that_a_fourth_does_not(runs: int, found: int | None) -> None:
    effects = np.zeros((runs, 4))
    effects[:, 1] = [*(0.001 * np.arange(runs - 1)), 0.9]
    effects[:, 2] = 0.001 * np.arange(runs)[::-1]
    left: Any = SimpleNamespace(random_effects=effects, shares=np.ones((runs, 4)))
    assert sole_gains(left, tuple(range(runs)), 0.1) == found


def test_a_material_gain_shrinks_three_slow_modes_of_every_run_by_a_fifth() -> None:
    """Log density of a Gaussian whose standard deviation is a fifth smaller: ln 1.25 for each number."""
    assert material_gain(10) == pytest.approx(30 * np.log(1.25))


@pytest.mark.parametrize(("sigmas", "names"), [(3.9, ["mass-offset"]), (4.1, [])])
def test_effects_within_four_sigmas_of_one_are_equivalent_to_it(sigmas: float, names: list[str]) -> None:
    diagnosis: Any = SimpleNamespace(separation={"plate-tilt": {"": 1.0, "mass-offset": sigmas}})
    assert equivalents(diagnosis, "plate-tilt") == names


@pytest.mark.parametrize(("short", "strains"), [(0.5e-3, True), (1.5e-3, False)])
def test_a_value_within_a_thousandth_of_its_range_from_the_end_is_at_the_end(
    short: float, strains: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On open ground it counts although the fit without effects moves it as far."""
    monkeypatch.setattr(
        "evaluator.diagnosis.assessment.knowledge.bounds", lambda *_: (np.array([-1.0]), np.array([1.0]))
    )
    columns = [Column("body.mass_g")]
    fit: Any = SimpleNamespace(columns=columns, point=SimpleNamespace(value=lambda _: 1.0 - 2 * short))
    assert strained(fit, fit, {"body.mass_g": 0.1}, on_ground=True) == (
        frozenset({"body.mass_g"}) if strains else frozenset()
    )
