"""The drift that both marks share, from slow left-overs that do not repeat themselves from run to run."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.features import Compression, compression
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized, MixedModel, reduce_runs
from evaluator.diagnosis.likelihood.noise.common_drift import (
    LASTING_S,
    RATES_MM,
    CommonNoise,
    changed,
    common_drift,
    drift_of,
)
from evaluator.diagnosis.likelihood.noise.drift import BELIEVED
from evaluator.diagnosis.likelihood.noise.drift_evidence import OF_MARKS, OF_POSES, RunInModes, RunsInModes
from evaluator.diagnosis.likelihood.noise.friction_wander import RATES
from evaluator.diagnosis.likelihood.noise.tracking import NO_DRIFT, Drift, Noise, correlated
from tests.evaluator.diagnosis.synthetic import FEATURES, linear_runs

Floats = NDArray[np.float64]

FRAMES, RUNS = 240, 12
TIME_S = np.arange(FRAMES) / 60
WHITE = Noise(0.003, 0.0, 1 / 60)
TRUE = Drift(0.008, 8.0)


def _drifting(rng: np.random.Generator, drift: Drift) -> Floats:
    """Ornstein-Uhlenbeck noise and a steady motion (n,), mm."""
    root = np.linalg.cholesky(correlated(TIME_S, drift.lasting_s, np.eye(FRAMES)) + 1e-9 * np.eye(FRAMES))
    return np.asarray(drift.size_mm * root @ rng.normal(size=FRAMES) + rng.normal(0, drift.creep_mm_s) * TIME_S)


def _path(run: int) -> Floats:
    """What an effect of size one does to the midpoint in a run, (n, 4) mm: a sideways motion, to either side."""
    effect = np.zeros((FRAMES, 4))
    effect[:, 1] = (-1) ** run * TIME_S**2
    return effect


def _runs(
    seed: int,
    drift: Drift,
    effect: float = 0.0,
    assumed: Drift = NO_DRIFT,
    offered: bool = False,
    of_heading: Drift = NO_DRIFT,
) -> tuple[list[Linearized], list[Compression]]:
    """Views of runs with white noise, a drift of both marks and an effect; offered: as a common column.

    of_heading: drift of the direction of the marks.
    """
    rng = np.random.default_rng(seed)
    midpoint = Noise(WHITE.white_mm, 0.0, 1 / 60, common_drift=assumed)
    views, compressions = [], []
    for run in range(RUNS):
        residual = rng.normal(0, WHITE.white_mm, (FRAMES, 4)) + effect * _path(run)
        residual[:, 0] += _drifting(rng, drift)
        residual[:, 1] += _drifting(rng, drift)
        residual[:, 2] += _drifting(rng, of_heading)
        made = compression(TIME_S, np.ones(FRAMES, dtype=bool), (midpoint, midpoint, WHITE, WHITE))
        start = np.zeros((3, FRAMES, 4))
        start[0, :, 0] = start[1, :, 1] = start[2, :, 2] = 1.0
        start[2, :, 1] = 10 * TIME_S  # a heading that is off leads away
        common = made.features(_path(run)) if offered else np.zeros(made.features(residual).shape)
        views.append(
            Linearized(made.features(residual), common[:, None], made.features(start).T, np.zeros((len(common), 4)))
        )
        compressions.append(made)
    return views, compressions


def _found(views: list[Linearized], compressions: list[Compression], assumed: Drift = NO_DRIFT) -> Drift:
    nothing = [np.zeros((len(view.response), 1)) for view in views]
    return common_drift(views, compressions, [TIME_S] * RUNS, np.array([0.0]), assumed, nothing).drift


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("true", [TRUE, Drift(creep_mm_s=0.003), Drift(0.008, 8.0, 0.004)])
def test_drift_is_found_by_what_it_does_within_a_run(true: Drift, seed: int) -> None:
    found = _found(*_runs(seed, true))
    assert found.about_mean_mm(4.0) == pytest.approx(true.about_mean_mm(4.0), rel=0.35)


@pytest.mark.parametrize("seed", range(4))
def test_the_heading_of_a_tracker_of_poses_drifts_as_its_position_does(seed: int) -> None:
    """In a field of view of seven robots, too; of marks, a drift of the direction is that of single marks."""
    views, compressions = _runs(seed, TRUE, of_heading=TRUE)
    nothing = [np.zeros((len(view.response), 1)) for view in views]
    times, prior = [TIME_S] * RUNS, np.array([0.0])
    given = views, compressions, times, prior, NO_DRIFT, nothing
    both, one = common_drift(*given, axes=OF_POSES), common_drift(*given)
    assert both.drift.about_mean_mm(4.0) == pytest.approx(TRUE.about_mean_mm(4.0), rel=0.3)
    assert both.log_evidence > one.log_evidence + 100
    far = common_drift(*_runs(seed, TRUE.scaled(7.0)), times, prior, NO_DRIFT, nothing)
    field = common_drift(*_runs(seed, TRUE.scaled(7.0)), times, prior, NO_DRIFT, nothing, field=7.0)
    assert field.drift.about_mean_mm(4.0) == pytest.approx(7 * TRUE.about_mean_mm(4.0), rel=0.35)
    assert field.log_evidence > far.log_evidence


@pytest.mark.parametrize("axes", [OF_MARKS, OF_POSES])
@pytest.mark.parametrize(("walk", "late_changes"), [(0.0, 0), (0.7, 0), (0.0, 2), (0.7, 2)])
@pytest.mark.parametrize("drift", [NO_DRIFT, Drift(0.6, 8.0), Drift(creep_mm_s=0.8), Drift(0.6, 8.0, 0.8)])
def test_evidence_of_a_drift_is_that_of_its_dense_covariance(
    drift: Drift, walk: float, late_changes: int, axes: int
) -> None:
    """Of features that are three of either coordinate of the midpoint and three others; start poses are free."""
    rng, prior, third = np.random.default_rng(0), np.array([0.7**-2.0, 0.0]), FEATURES // 3
    runs, dense, widths = [], [], 0.0
    for view in linear_runs():
        wanders, creeps = rng.uniform(0, 5, third), rng.normal(size=third)
        friction = rng.normal(size=(FEATURES, 2))
        late = rng.normal(size=(FEATURES, late_changes))
        runs.append(RunInModes(view, wanders, creeps, friction, late))
        covariance = np.eye(FEATURES) + walk**2 * friction @ friction.T + late @ late.T
        for coordinate in [slice(axis * third, (axis + 1) * third) for axis in range(axes)]:
            covariance[coordinate, coordinate] += drift.size_mm**2 * np.diag(wanders)
            covariance[coordinate, coordinate] += drift.creep_mm_s**2 * np.outer(creeps, creeps)
        white = np.linalg.inv(np.linalg.cholesky(covariance))
        dense.append(changed(view, lambda part, white=white: part @ white.T))
        widths += np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(dense[-1].start.T @ dense[-1].start)[1]
    expected = MixedModel(reduce_runs(dense), prior).log_evidence([0, 1]) - widths / 2
    assert RunsInModes(runs, axes).log_evidence(drift, walk, prior) == pytest.approx(expected, abs=1e-6)


def test_what_creeps_is_told_from_what_wanders() -> None:
    creeping, wandering = _found(*_runs(5, Drift(creep_mm_s=0.004))), _found(*_runs(5, Drift(0.012, 1.0)))
    assert creeping.creep_mm_s > 0.002
    assert Drift(creeping.size_mm, creeping.lasting_s).about_mean_mm(4.0) < 0.001
    assert wandering.creep_mm_s < 0.001


@pytest.mark.parametrize("seed", range(4))
def test_white_noise_is_no_drift(seed: int) -> None:
    assert _found(*_runs(seed, NO_DRIFT)) == NO_DRIFT


def test_effect_that_a_model_misses_looks_like_drift_and_that_it_holds_does_not() -> None:
    assert _found(*_runs(1, NO_DRIFT, effect=0.002)) != NO_DRIFT
    assert _found(*_runs(1, NO_DRIFT, effect=0.002, offered=True)) == NO_DRIFT


def test_answer_does_not_depend_on_the_drift_that_was_assumed() -> None:
    assert _found(*_runs(2, TRUE, assumed=Drift(0.004, 1.0)), Drift(0.004, 1.0)) == _found(*_runs(2, TRUE))
    assert _found(*_runs(3, NO_DRIFT, assumed=TRUE), TRUE) == NO_DRIFT


@pytest.mark.parametrize("drift", [TRUE, Drift(creep_mm_s=0.003), Drift(0.008, 0.5, 0.003)])
def test_drift_about_its_mean_over_a_time(drift: Drift) -> None:
    kernel = drift.covariance(TIME_S)
    about_mean = np.trace(kernel) / FRAMES - kernel.mean()
    assert drift.about_mean_mm(4.0) == pytest.approx(np.sqrt(about_mean), rel=0.02)
    assert Noise(0.003, 0.0, 0.1, common_drift=TRUE).about_mean_mm(4.0) == pytest.approx(
        np.hypot(0.003, TRUE.about_mean_mm(4.0))
    )


def test_common_drift_is_part_of_the_covariance() -> None:
    noise = Noise(0.003, 0.001, 0.1, drift=Drift(0.002, 2.0), common_drift=Drift(0.008, 8.0, 0.005))
    lag = np.abs(TIME_S[:, None] - TIME_S)
    expected = 1e-6 * (np.exp(-lag / 0.1) + 4 * np.exp(-lag / 2.0) + 64 * np.exp(-lag / 8.0) + 9 * (lag == 0))
    expected += 25e-6 * np.outer(TIME_S, TIME_S)
    assert noise.covariance(TIME_S) == pytest.approx(expected)
    assert noise.times(TIME_S, np.eye(FRAMES)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("top", "by_drift", "by_wander", "told"),
    [
        ((7, 2, 3, 4), BELIEVED + 0.1, BELIEVED + 0.1, (7, 2, 3, 4)),
        ((7, 2, 3, 4), BELIEVED + 0.1, BELIEVED - 0.1, (7, 2, 3, 0)),  # the ground may be even
        ((7, 2, 3, 4), BELIEVED - 0.1, BELIEVED + 0.1, (0, 2, 0, 4)),  # the marks may stand still
        ((7, 2, 3, 4), 0.4 * BELIEVED, 0.4 * BELIEVED, (0, 2, 0, 0)),
        ((0, 1, 0, 4), BELIEVED + 0.1, BELIEVED + 0.1, (0, 1, 0, 4)),
        ((7, 2, 0, 4), BELIEVED + 0.1, BELIEVED + 0.1, (7, 2, 0, 4)),  # it wanders and does not creep
        ((0, 2, 3, 4), BELIEVED + 0.1, BELIEVED + 0.1, (0, 2, 3, 4)),  # it creeps alone
    ],
)
def test_drift_and_uneven_ground_are_told_where_they_gain_beyond_chance(
    top: tuple[int, int, int, int],
    by_drift: float,
    by_wander: float,
    told: tuple[int, int, int, int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Evidence that falls from one place of the grid on, and jumps where there is neither of the two."""

    def evidence(_: object, drift: Drift, wander: float, prior: Floats) -> float:
        time = LASTING_S.index(drift.lasting_s)
        rate = int(np.argmin(np.abs(np.array(RATES_MM) - drift.size_mm / np.sqrt(drift.lasting_s))))
        place = rate, time, RATES_MM.index(drift.creep_mm_s), list(RATES).index(wander)
        off = np.array(place) - top
        fall = 1e-3 * float(off @ off)
        still = (place[0] == 0 < top[0]) or (place[2] == 0 < top[2])
        return 100.0 - fall - by_drift * still - by_wander * (place[3] == 0) + 0.0 * prior.sum()

    monkeypatch.setattr(RunsInModes, "log_evidence", evidence)
    found = common_drift([], [], [], np.zeros(1), NO_DRIFT, [])
    drift = NO_DRIFT if told[0] == told[2] == 0 else drift_of(*told[:3])
    assert found == CommonNoise(drift, RATES[told[3]], pytest.approx(100.0), top)
