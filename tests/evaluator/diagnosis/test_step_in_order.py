"""What changes over a session: a speed once, which is no drift, or the friction, which is no missing physics."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import optimize

from evaluator.diagnosis.assessment.adequacy import Adequacy, _order, unlike_runs
from evaluator.diagnosis.changes.session_changes import (
    DRIFT,
    _least_line,
    friction_change,
    step_in_speed,
    step_over_line,
    without_change,
)
from evaluator.diagnosis.likelihood.run_data import RunData

ORDER = np.arange(16.0)
# Speeds of 16 runs of a laboratory's simulation, percent, a hundredth slower from the ninth on; the seventh is unlike.
TWO_DAYS = np.array(
    [-0.10, -0.12, -0.07, -0.10, -0.32, -0.12, -0.94, -0.04, -1.12, -1.34, -1.44, -0.78, -1.16, -1.22, -1.18, -1.40]
)


def said(speed: np.ndarray, per_run: float, share: np.ndarray | float = 0.5) -> str:
    """The answer where a drift was fitted and the gains of each run hold the rest, of which a share is seen."""
    shares = np.tile(np.broadcast_to(share, 16)[:, None], (1, 4))
    gains = shares[:, 0] * (speed - per_run * ORDER)
    left: Any = SimpleNamespace(shares=shares, random_effects=np.column_stack([5 + gains, gains, gains, 0.1 - gains]))
    point = SimpleNamespace(terms={DRIFT: (per_run,)})
    fit: Any = SimpleNamespace(terms=frozenset([DRIFT]), point=point, runs=tuple(range(16)))
    data: Any = [SimpleNamespace(id=f"r{run + 1}", order=run) for run in range(16)]
    return step_in_speed(fit, left, data)


def test_step_is_told_with_its_place_and_size() -> None:
    assert said(0.01 * TWO_DAYS, -0.001).startswith("the speed changes by -1.1 % between r8 and r9, once")


def test_runs_count_by_what_they_tell_of_their_speed() -> None:
    """Each estimate is shrunk by its share; a run that tells less than a hundredth of each side is not asked."""
    share = np.tile([0.2, 0.9], 8)
    share[8] = 0.0075
    speed = np.where(ORDER > 7, -0.02, 0.0) + np.random.default_rng(3).normal(0.0, 1e-4, 16)
    assert said(speed, -0.001, share).startswith("the speed changes by -2 % between r8 and r10, once")


@pytest.mark.parametrize(("off", "told"), [(-0.1, False), (0.1, True)])
def test_step_is_told_from_odds_of_twenty_to_one(off: float, told: bool) -> None:
    """Between a drift, 0, and a step, 1, both of a per cent, over the scatter of the same runs."""
    noise = np.random.default_rng(2).normal(0.0, 0.002, 16)

    def speed(share: float) -> np.ndarray:
        return noise - 0.01 * ((1 - share) * ORDER / 15 + share * (ORDER > 7))

    def odds(share: float) -> float:
        return (step_over_line(ORDER, speed(share), np.ones(16)) or (0, 0.0, 0.0))[2]

    share = optimize.brentq(lambda share: odds(share) - np.log(20) - off, 0.0, 1.0)
    assert bool(said(speed(share), -0.001)) == told


def test_drift_is_no_step() -> None:
    noise = np.random.default_rng(0).normal(0.0, 0.001, 16)
    assert said(noise - 0.0015 * ORDER, -0.0015) == ""


def test_speeds_of_a_fit_without_a_drift_are_its_gains() -> None:
    """These are speeds of a robot whose supply fell by 3 %, before the sixth of 11 runs, fitted without a drift."""
    speeds = [0.0085, 0.0086, 0.0085, 0.0129, 0.0127, -0.0241, -0.0217, -0.0215, -0.0219, -0.0179, -0.0176]
    shares = np.ones((11, 4))
    left: Any = SimpleNamespace(shares=shares, random_effects=np.outer(speeds, [0, 1, 1, 0]))
    fit: Any = SimpleNamespace(terms=frozenset(["plate-tilt"]), runs=tuple(range(11)))
    data: Any = [SimpleNamespace(id=f"r{run + 1}", order=run) for run in range(11)]
    assert step_in_speed(fit, left, data).startswith("the speed changes by -3 % between r5 and r6, once")


@pytest.mark.parametrize(("after", "size"), [(8, -1.0), (3, 0.5), (14, 2.0)])
def test_best_step_is_exact_without_noise(after: int, size: float) -> None:
    last, found, odds = step_over_line(ORDER, size * (after <= ORDER), np.ones(16)) or (0, 0.0, 0.0)
    assert (last, found) == (after - 1, size)
    assert odds > 100


@pytest.mark.parametrize("seed", range(3))
def test_best_line_is_that_of_the_least_absolute_deviations(seed: int) -> None:
    """As a linear program: values less the line are what is over it less what is under it."""
    rng = np.random.default_rng(seed)
    order, values, weights = np.sort(rng.uniform(0, 9, 6)), rng.normal(size=6), rng.uniform(0.5, 2, 6)
    design = np.column_stack([np.ones(6), order, np.eye(6), -np.eye(6)])
    bounds = [(None, None)] * 2 + [(0, None)] * 12
    found = optimize.linprog([0, 0, *weights, *weights], A_eq=design, b_eq=values, bounds=bounds)
    assert _least_line(order, values, weights) == pytest.approx(found.fun)


def test_one_run_is_no_side_of_a_step() -> None:
    assert step_over_line(ORDER[:4], np.array([0.0, 1.0, 1.0, 1.0]), np.ones(4)) is None


def test_weak_drifts_pass_for_steps_as_seldom_as_the_odds_say() -> None:
    rng = np.random.default_rng(1)
    odds = [
        (step_over_line(ORDER, 0.5 * ORDER / 15 + rng.normal(0.0, 0.1, 16), np.ones(16)) or (0, 0.0, 0.0))[2]
        for _ in range(200)
    ]
    assert np.mean(np.array(odds) > np.log(20)) <= 0.05


RUNS = [RunData(f"r{k}", 30.0, 20.0, 0.0, None, np.arange(2.0), np.zeros((2, 4)), k) for k in range(14)]


def with_friction(friction: np.ndarray, share: float = 0.5) -> Adequacy:
    """A model whose runs have these frictions, each seen by a share of its variance and shrunk by as much."""
    effects = np.zeros((len(friction), 4))
    effects[:, 0] = share * friction
    return Adequacy(1.0, 0.0, np.ones(len(friction)), effects, np.full(effects.shape, share), 1.0, "")


SCATTER_OF_FRICTION = np.random.default_rng(4).normal(0.0, 0.02, 14)
WIPED, DUSTY = np.where(np.arange(14) > 4, -0.15, 0.0), -0.01 * np.arange(14)


@pytest.mark.parametrize("friction", [WIPED, DUSTY])
def test_friction_that_changes_over_the_session_is_no_missing_physics(friction: np.ndarray) -> None:
    left = with_friction(friction + SCATTER_OF_FRICTION)
    assert _order(left.random_effects, left.shares, RUNS, np.zeros(4))[0] == 1.0


def test_friction_of_a_plate_wiped_after_five_runs_is_told_with_place_and_size() -> None:
    found = friction_change(with_friction(WIPED + SCATTER_OF_FRICTION), range(14), RUNS)
    assert found is not None
    assert (found.runs, found.once) == (tuple(range(5, 14)), True)
    assert found.change == pytest.approx(-0.15, abs=0.03)


def test_runs_before_a_change_are_not_unlike_those_after_it_but_a_dirty_one_is() -> None:
    friction = np.where(np.arange(14) > 1, -0.2, 0.0) + SCATTER_OF_FRICTION / 10
    friction[9] += 0.1
    left = with_friction(friction)
    changed = friction_change(left, range(14), RUNS)
    assert changed is not None
    assert (changed.runs, changed.once) == (tuple(range(2, 14)), True)
    assert {0, 1} <= {run for item in unlike_runs(left, range(14)) for run in item.runs}
    (found,) = unlike_runs(without_change(left, range(14), changed, RUNS), range(14))
    assert (found.runs, found.what) == ((9,), "friction")


def test_friction_of_a_plate_that_gathers_dust_is_told_from_the_first_run_to_the_last() -> None:
    found = friction_change(with_friction(2 * DUSTY + SCATTER_OF_FRICTION), range(14), RUNS)
    assert found is not None
    assert (found.runs, found.once) == (tuple(range(14)), False)
    assert found.change == pytest.approx(-0.26, abs=0.06)


def test_a_sticky_first_run_does_not_hide_that_friction_falls() -> None:
    friction = 2.5 * DUSTY + SCATTER_OF_FRICTION
    friction[0] += 0.6
    left = with_friction(friction)
    found = friction_change(left, range(14), RUNS)
    assert found is not None
    assert (found.runs, found.once) == (tuple(range(1, 14)), False)
    assert found.change == pytest.approx(-0.3, abs=0.06)
    (odd,) = unlike_runs(without_change(left, range(14), found, RUNS), range(14))
    assert (odd.runs, odd.what) == ((0,), "friction")


def test_scatter_of_friction_is_no_change_over_the_session() -> None:
    assert friction_change(with_friction(SCATTER_OF_FRICTION), range(14), RUNS) is None
