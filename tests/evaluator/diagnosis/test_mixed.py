"""The mixed model against closed forms and against its own claims on simulated scatter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized, MixedModel, Reduced, reduce_runs, solve_within


def _runs(rng: np.random.Generator, theta: float, tau: float, count: int = 24) -> list[Linearized]:
    """Runs whose effect hides entirely in their friction: what happens in one run says nothing beyond that run."""
    result = []
    for _ in range(count):
        start, scatter = rng.normal(size=(40, 3)), rng.normal(size=(40, 4)) * 50
        common = scatter[:, :1]
        own = np.array([tau, 1e-3, 1e-3, 1.0]) * rng.normal(size=4)
        response = common[:, 0] * theta + scatter @ own + start @ rng.normal(size=3) * 10 + rng.normal(size=40)
        result.append(Linearized(response, common, start, scatter))
    return result


def test_evidence_of_an_effect_counts_runs_not_frames() -> None:
    rng = np.random.default_rng(1)
    model = MixedModel(reduce_runs(_runs(rng, 0.0, 0.05)), np.zeros(1))
    with_effect, without = model.posterior([0]), model.posterior([])
    # the mean of 24 random numbers of 5 % is off by 1 %: no evidence, though the frames alone would shout
    assert with_effect.log_evidence < without.log_evidence + 3
    assert np.sqrt(with_effect.covariance[0, 0]) == pytest.approx(0.05 / np.sqrt(24), rel=0.35)


def test_intervals_under_scatter_cover_as_they_claim() -> None:
    rng = np.random.default_rng(2)
    inside = 0
    for _ in range(150):
        found = MixedModel(reduce_runs(_runs(rng, 0.03, 0.05, count=12)), np.zeros(1)).posterior([0])
        inside += abs(found.mean[0] - 0.03) < 1.96 * np.sqrt(found.covariance[0, 0])
    assert 0.88 <= inside / 150 <= 0.99


def test_scatter_is_recovered() -> None:
    rng = np.random.default_rng(3)
    found = MixedModel(reduce_runs(_runs(rng, 0.0, 0.05, count=60)), np.zeros(1)).posterior([])
    assert found.scatter[0] == pytest.approx(0.05, rel=0.25)


def test_the_interval_of_the_scatter_covers_as_it_claims() -> None:
    """Of friction that scatters by 5 % and of gains that scatter by 0.1 %, each time in 12 runs."""
    rng = np.random.default_rng(5)
    inside, ratios = np.zeros(2), []
    for _ in range(150):
        ends = MixedModel(reduce_runs(_runs(rng, 0.0, 0.05, count=12)), np.zeros(1)).scatter_interval([])
        inside += (ends[:, 0] < [0.05, 1e-3]) & (ends[:, 1] > [0.05, 1e-3])
        ratios.append(ends[0, 1] / ends[0, 0])
    assert (inside / 150 >= 0.88).all()
    chances = stats.chi2.isf([0.975, 0.025], 12)
    assert np.median(ratios) == pytest.approx(np.sqrt(chances[1] / chances[0]), rel=0.2)


def test_a_prior_holds_a_nominal_value_within_its_tolerance() -> None:
    rng = np.random.default_rng(4)
    runs = _runs(rng, 0.2, 0.001)
    tight = MixedModel(reduce_runs(runs), np.array([1e-6**-2.0])).posterior([0])
    assert abs(tight.mean[0]) < 1e-5


@pytest.mark.parametrize("seed", range(10))
def test_parameters_that_only_stand_for_each_runs_own_friction_stay_within_their_bounds(seed: int) -> None:
    # what is left of the common parameters is a difference of equal numbers: rounding, of either sign
    rng = np.random.default_rng(seed)
    same, root = rng.normal(size=(4, 4)), 1e7 * rng.normal(size=(6, 4, 4))
    A, own = np.swapaxes(root, 1, 2) @ root, rng.normal(size=(6, 4))
    c = np.einsum("nij,nj->ni", A, own)
    s, C = np.einsum("ni,ni->n", own, c), A @ same
    reduced = Reduced(s, c @ same, same.T @ C, c, C, A, np.full(6, 100))
    found = solve_within(reduced, np.zeros(4), np.array([0.3, 0.1, 0.1, 1.0]), np.full(4, -0.01), np.full(4, 0.01))
    assert (np.abs(found) <= 0.01).all()
