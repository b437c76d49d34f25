from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from evaluator.turning.pooling import pool_runs, pooled


def test_scatter_between_runs_is_told_from_measurement_uncertainty() -> None:
    rng = np.random.default_rng(0)
    sigmas = rng.uniform(0.01, 0.03, 400)
    values = 5.0 + 0.05 * rng.normal(size=400) + sigmas * rng.normal(size=400)
    pool = pooled(values, sigmas)
    assert pool.between == pytest.approx(0.05, rel=0.1)
    assert pool.within == pytest.approx(np.sqrt(np.mean(sigmas**2)))
    assert pool.p_same < 1e-6


def test_runs_that_agree_have_no_scatter_between_them() -> None:
    pool = pooled(np.array([5.0, 5.001, 4.999]), np.array([0.01, 0.01, 0.01]))
    assert pool.between == 0.0
    assert pool.p_same > 0.9


@pytest.mark.parametrize("runs", [3, 6])
def test_interval_of_few_repetitions_holds(runs: int) -> None:
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(300):
        sigmas = rng.uniform(0.01, 0.05, runs)
        pool = pooled(5.0 + 0.05 * rng.normal(size=runs) + sigmas * rng.normal(size=runs), sigmas)
        held += pool.low <= 5.0 <= pool.high
    assert 0.91 <= held / 300 <= 0.99  # three standard errors of 300 runs


def test_nothing_to_pool_gives_nothing() -> None:
    assert pooled(np.array([np.nan]), np.array([0.1])).runs == 0


def test_commands_are_pooled_one_by_one_and_what_the_standard_asks_for_is_said() -> None:
    rows = [(33.0, 14.0, 7.8, -20.0)] * 3 + [(14.0, 33.0, 7.9, 20.0)] * 2 + [(33.0, 33.0, np.nan, 0.0)]
    table = pd.DataFrame(rows, columns=["left_rpm", "right_rpm", "radius_mm", "yaw_rate_deg_s"])
    table["radius_random_mm"] = 0.01
    pools = pool_runs(table).set_index(["left_rpm", "right_rpm"])
    assert pools.loc[(33.0, 14.0), "side"] == "right"
    assert pools.loc[(33.0, 14.0), "note"] == ""
    assert "2 of at least 3" in pools.loc[(14.0, 33.0), "note"]
    assert pools.loc[(33.0, 33.0), "runs"] == 0
