"""Densities of runs left out and sizes of effects in halves, against dense Gaussians."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from evaluator.diagnosis.assessment import cross_validation
from evaluator.diagnosis.assessment.cross_validation import (
    Constancy,
    _densities,
    advantage,
    constancy,
    covariance_over_commands,
    predicts_better,
)
from evaluator.diagnosis.assessment.model_comparison import (
    predictive_score,
)
from evaluator.diagnosis.held_out import left_out_together
from evaluator.diagnosis.inference.fitted_model import prior_precision
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized, MixedModel, reduce_runs
from tests.evaluator.diagnosis.synthetic import (
    column,
    fit_of,
    free_of_start,
    linear_runs,
    minus_two_log,
    run_data,
)

TAU = np.array([0.05, 0.02, 0.02, 1.0])


COLUMNS = [column("slip.lateral_friction", effect=False), column("effect")]
TOLERANCE = {"slip.lateral_friction": 0.7}


def log_density(runs: list[Any], weight: np.ndarray) -> float:
    """Dense log density of runs with Gaussian parameters of these precisions integrated out, without constants."""
    normal, right, total = np.diag(weight), np.zeros(len(weight)), 0.0
    for run in runs:
        response, common, scatter = free_of_start(run)
        inverse = np.linalg.inv(np.eye(len(response)) + scatter @ np.diag(TAU**2) @ scatter.T)
        normal, right = normal + common.T @ inverse @ common, right + common.T @ inverse @ response
        total += minus_two_log(run, np.zeros(len(weight)), TAU)
    return -0.5 * (total - right @ np.linalg.solve(normal, right) + np.linalg.slogdet(normal)[1])


def test_density_of_runs_left_out_is_that_of_all_less_that_of_the_others() -> None:
    runs = linear_runs(count=6)
    fit = fit_of(runs, COLUMNS, np.zeros(2), TAU)
    weight = prior_precision(COLUMNS, TOLERANCE)
    assert weight == pytest.approx([0.7**-2, 0.0])
    groups = [np.array([0, 3]), np.array([1])]
    found = _densities(fit, groups, TOLERANCE)
    for group, value in zip(groups, found, strict=True):
        rest = [run for at, run in enumerate(runs) if at not in group]
        assert value == pytest.approx(log_density(runs, weight) - log_density(rest, weight), rel=1e-6)


def test_advantage_is_the_gain_over_commands_with_the_error_of_a_sum() -> None:
    runs = linear_runs(count=6)
    data = [run_data(30.0, 30.0 - 5 * (number // 2), number) for number in range(6)]
    one, other = fit_of(runs, COLUMNS, np.zeros(2), TAU), fit_of(runs, COLUMNS[:1], np.zeros(1), TAU)
    narrow = [type(run)(run.response, run.common[:, :1], run.start, run.scatter) for run in runs]
    other = fit_of(narrow, COLUMNS[:1], np.zeros(1), TAU)
    groups = [np.array([0, 1]), np.array([2, 3]), np.array([4, 5])]
    gains = _densities(one, groups, TOLERANCE) - _densities(other, groups, TOLERANCE)
    gain, error = advantage(one, other, data, TOLERANCE)
    assert gain == pytest.approx(gains.sum())
    of_three = stats.t.isf(stats.norm.sf(2.0), 2) / 2.0  # what two standard errors are of a spread told by three
    assert error == pytest.approx(gains.std(ddof=1) * np.sqrt(3) * of_three)
    assert advantage(one, other, [run_data(30.0, 20.0, number) for number in range(6)], TOLERANCE)[1] == np.inf


def is_better(monkeypatch: pytest.MonkeyPatch, missed: np.ndarray) -> bool:
    """Whether a model predicts five commands better than one that misses each by so many times as much."""
    runs: Any = SimpleNamespace(runs=range(5))
    one, other = copy(runs), copy(runs)
    found = {id(one): -np.full(5, 30.0), id(other): -30.0 * missed}
    monkeypatch.setattr(cross_validation, "_densities", lambda fit, *_: found[id(fit)])
    return predicts_better(one, other, [run_data(30.0, 5.0 * number, number) for number in range(5)], TOLERANCE)


@pytest.mark.parametrize(
    ("missed", "better"),
    [
        ((3.0, 2.5, 4.0, 3.5, 2.8), True),  # each command is missed by a third of what it was
        ((0.9, 1.1, 900.0, 0.95, 1.05), False),  # a single command that was missed by much
        ((20.0, 15.0, 30.0, 0.3, 0.4), False),  # three are better, two as much worse as is chance among five
        ((1.0, 1.0, 1.0, 1.0, 1.0), False),
    ],
)
def test_a_model_predicts_better_where_it_misses_most_commands_by_less_whatever_one_of_them_weighs(
    missed: tuple[float, ...], better: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert is_better(monkeypatch, np.array(missed)) == better


@pytest.mark.parametrize(("mean", "better"), [(0.95, False), (0.96, True)])
def test_a_model_that_is_no_better_passes_once_in_twenty(
    mean: float, better: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Student's one-sided 5 % of five commands are 2.132 standard errors; the scatter here makes one of 0.447."""
    missed = np.exp(mean + np.array([-1.0, 1.0, -1.0, 1.0, 0.0]))
    assert is_better(monkeypatch, missed) == better


def test_predictive_score_is_the_gaussian_density_of_new_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = linear_runs(count=3)
    theta, covariance = np.array([0.4, -0.2]), np.array([[0.3, 0.1], [0.1, 0.5]])
    model = MixedModel(reduce_runs(runs), prior_precision(COLUMNS, TOLERANCE))
    tau = model.tau[130]
    fit = fit_of(runs, COLUMNS, theta, tau * 1.01, covariance)
    module = "evaluator.diagnosis.assessment.model_comparison"
    monkeypatch.setattr(f"{module}.place_runs", lambda *_: None)
    search: Any = SimpleNamespace(problem=SimpleNamespace(linearized=lambda *_: runs), tolerance=TOLERANCE)
    blocks, shift, columns = [], [], []
    for run in runs:
        response, common, scatter = free_of_start(run)
        blocks.append(np.eye(len(response)) + scatter @ np.diag(tau**2) @ scatter.T)
        shift.append(response - common @ theta)
        columns.append(common)
    whole = np.zeros((18, 18))
    for at, block in enumerate(blocks):
        whole[6 * at : 6 * at + 6, 6 * at : 6 * at + 6] = block
    stacked, away = np.concatenate(columns), np.concatenate(shift)
    whole += stacked @ covariance @ stacked.T
    expected = -0.5 * (away @ np.linalg.solve(whole, away) + np.linalg.slogdet(whole)[1])
    assert predictive_score(search, fit, [0, 1, 2]) == pytest.approx(expected, rel=1e-6)


def halves(sizes: tuple[float, float], sigma: float = 0.1) -> list[Constancy]:
    """Eight runs, forward the first four, whose effect has these sizes forward and backward, each to sigma."""
    from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized

    rng = np.random.default_rng(0)
    runs = []
    for number in range(8):
        start = rng.normal(size=(4, 3))
        common = np.linalg.qr(start, mode="complete")[0][:, 3:] / (2 * sigma)  # four runs know the size to sigma
        runs.append(Linearized(common[:, 0] * sizes[number // 4], common, start, np.zeros((4, 4))))
    data = [run_data(*((30.0, 20.0) if number < 4 else (-30.0, -20.0)), number) for number in range(8)]
    fit = fit_of(runs, [column("effect")], np.array([1.0]), TAU)
    return constancy(fit, data, {})


def test_effects_of_unlike_size_in_halves_have_the_probability_of_chi_squared_with_slack() -> None:
    found = {item.halves: item.probability for item in halves((1.2, 0.8))}
    square = 0.4**2 / (0.1**2 + 0.1**2 + 0.05**2)
    assert found["forward and backward"] == pytest.approx(stats.chi2.sf(square, 1), rel=1e-4)
    assert {item.halves: item.probability for item in halves((1.0, 1.0))}["forward and backward"] == pytest.approx(1.0)
    assert found["left and right"] == found["forward and backward"]  # backward they turn to the other side
    assert "slow and fast" not in found  # all have one speed: no half has four runs


def test_halves_of_three_runs_are_not_compared_and_neither_is_a_model_without_effects() -> None:
    runs = linear_runs(count=7)
    data = [run_data(30.0, 30.0, number) if number < 4 else run_data(-30.0, -30.0, number) for number in range(7)]
    assert constancy(fit_of(runs, COLUMNS, np.zeros(2), TAU), data, TOLERANCE) == []
    narrow = [type(run)(run.response, run.common[:, :1], run.start, run.scatter) for run in runs]
    assert constancy(fit_of(narrow, COLUMNS[:1], np.zeros(1), TAU), data, TOLERANCE) == []


def test_size_of_an_effect_is_that_of_all_its_coordinates_in_their_steps() -> None:
    """Of (3, 4) in steps of 1 and 2 it is 3² + 2² = 13 steps squared, so 13 and 52 in the units of the coordinates."""
    from types import SimpleNamespace

    from evaluator.diagnosis.assessment.cross_validation import _squares

    term = SimpleNamespace(coordinates=(SimpleNamespace(step=1.0), SimpleNamespace(step=2.0)))
    columns = [SimpleNamespace(key="tether", coordinate=i, term=term) for i in (0, 1)]
    sizes = {0: 3.0, 1: 4.0}
    fit = SimpleNamespace(columns=columns, point=SimpleNamespace(value=lambda column: sizes[column.coordinate]))
    assert _squares(fit) == pytest.approx([13.0, 52.0])  # type: ignore[arg-type]


def test_slow_runs_are_those_up_to_the_median_of_the_speed_whichever_way_they_drive() -> None:
    from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized

    rng = np.random.default_rng(0)
    speeds = [10.0, -10.0, 12.0, -12.0, 40.0, -40.0, 50.0, -50.0]
    runs = []
    for speed in speeds:
        start = rng.normal(size=(4, 3))
        common = np.linalg.qr(start, mode="complete")[0][:, 3:] / 0.2
        runs.append(Linearized(common[:, 0] * (1.2 if abs(speed) < 20 else 0.8), common, start, np.zeros((4, 4))))
    data = [run_data(speed, speed, number) for number, speed in enumerate(speeds)]
    found = {i.halves: i.probability for i in constancy(fit_of(runs, [column("effect")], np.ones(1), TAU), data, {})}
    assert found["slow and fast"] == pytest.approx(stats.chi2.sf(0.4**2 / (0.02 + 0.05**2), 1), rel=1e-4)
    assert found["forward and backward"] == pytest.approx(1.0)
    assert "left and right" not in found


@pytest.mark.exam
def test_intervals_over_commands_hold_where_commands_differ_and_those_of_runs_do_not() -> None:
    """Eight commands of three runs, each with a size of its own about 1 that scatters by 0.3."""
    rng = np.random.default_rng(3)
    holds = []
    for _ in range(300):
        sizes = np.repeat(1.0 + 0.3 * rng.normal(size=8), 3)
        slopes = [3 * rng.normal(size=(9, 1)) for _ in sizes]
        runs = [
            Linearized(slope[:, 0] * size + rng.normal(size=9), slope, rng.normal(size=(9, 3)), np.zeros((9, 4)))
            for slope, size in zip(slopes, sizes, strict=True)
        ]
        reduced = reduce_runs(runs)
        information = reduced.G.sum(axis=0)[0, 0]
        found = reduced.g.sum(axis=0) / information
        fit = fit_of(runs, COLUMNS[:1], found, TAU, np.array([[1 / information]]))
        data = [run_data(30.0, float(number // 3), number) for number in range(24)]
        wide = covariance_over_commands(fit, data, TOLERANCE)
        assert wide[0, 0] >= fit.posterior.covariance[0, 0]
        holds.append([abs(found[0] - 1) < 1.96 * np.sqrt(item[0, 0]) for item in (wide, fit.posterior.covariance)])
    over_commands, over_runs = np.mean(holds, axis=0)
    assert 0.9 < over_commands < 0.99
    assert over_runs < 0.6


def test_what_commands_differ_by_is_the_error_of_their_mean_with_students_factor_for_their_number() -> None:
    """Runs alike but for their response, one a command: leaving one out in turn, s/√m is the error of the mean."""
    rng = np.random.default_rng(7)
    common, start, scatter = 3 * rng.normal(size=(9, 1)), rng.normal(size=(9, 3)), np.zeros((9, 4))
    values = np.array([0.3, 1.4, 0.8, 2.0, 1.1])
    runs = [Linearized(common[:, 0] * value, common, start, scatter) for value in values]
    fit = fit_of(runs, [column("effect")], np.array([values.mean()]), TAU, np.array([[1e-6]]))
    data = [run_data(30.0, float(number), number) for number in range(5)]
    sigma = stats.t.ppf(0.975, 4) / stats.norm.ppf(0.975) * values.std(ddof=1) / np.sqrt(5)
    assert covariance_over_commands(fit, data, {})[0, 0] == pytest.approx(sigma**2, rel=1e-6)


def test_a_single_command_leaves_the_covariance_as_it_is() -> None:
    runs = linear_runs(3, parameters=1)
    fit = fit_of(runs, COLUMNS[:1], np.zeros(1), TAU, np.array([[0.04]]))
    assert covariance_over_commands(fit, [run_data(30.0, 20.0, n) for n in range(3)], TOLERANCE)[0, 0] == 0.04


@pytest.mark.parametrize(
    ("recordings", "parts", "by_recording"),
    [(6, 2, True), (5, 3, False), (8, 1, False)],  # few recordings, and runs that are whole, by their commands
)
def test_parts_of_a_recording_are_left_out_together(recordings: int, parts: int, *, by_recording: bool) -> None:
    """They share friction and place: a force that depends on the place predicts other parts of the same recording."""
    runs = [
        replace(run_data(10.0 + part, 30.0), id=f"r{recording}" + f"@{3 * part}.0s" * (parts > 1))
        for recording in range(recordings)
        for part in range(parts)
    ]
    groups = [group.tolist() for group in left_out_together(runs)]
    numbers = np.arange(recordings * parts).reshape(recordings, parts)
    assert groups == (numbers if by_recording else numbers.T).tolist()
