"""Intervals of sizes that the linear view does not describe."""

from __future__ import annotations

import numpy as np
import pytest

from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.inference.profile_likelihood import Profile, profile_of
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.preparation import build_problem
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.turning.motion.curvature import Z_975
from simulator.effects.coordinates import Candidate, Coordinate
from tests.evaluator.diagnosis.hidden import hidden_session

WEAKER = {"driving_factor": 0.73, "driven_factor": 1.14}
# Coordinates that the runs determine along a curve only: inverse level, and the ratio of the attractions.
CURVED = Candidate(
    "magnet-strength",
    (
        Coordinate("weakness", 1.0, 0.02, 0.2, 20.0, prior_sigma=3.0),
        Coordinate("driven_over_driving", 1.0, 0.02, 0.0, 20.0, closed=True),
    ),
    lambda values: {"driving_factor": 1 / values[0], "driven_factor": values[1] / values[0]},
)
ENOUGH = 1.5  # of the drop of 3.84: the ends are walked to within a tenth, and the density is rough by 0.8


@pytest.fixture(scope="module")
def search(tmp_path_factory: pytest.TempPathFactory) -> Search:
    """Runs of weaker magnets, fitted: how strong they are shows in little but weight and inertia beside them."""
    session = hidden_session(tmp_path_factory.mktemp("weaker"), {"magnet-strength": WEAKER}, exact=True)
    terms = named_terms(20.0, (30.0, 60.0)) | {"magnet-strength": CURVED}
    problem, start = build_problem(session.data, Simulated(session.robots, session.data, terms))
    found = Search(problem, terms, session.tolerance, tuple(range(len(session.data))))
    found.fits[frozenset({"magnet-strength"})] = fit_model(problem, start, [terms["magnet-strength"]], found.tolerance)
    return found


def test_draws_on_a_profile_have_its_interval_and_follow_it() -> None:
    profile = Profile(0, -1.0, 4.0, np.array([-1.0, 0.0, 4.0]), np.array([[-1.0, 2.0], [0.0, 0.0], [4.0, 8.0]]))
    covariance = np.array([[1.0, 0.5], [0.5, 0.2504]])
    draws = np.random.default_rng(1).multivariate_normal([0.0, 0.0], covariance, 40000)
    moved = profile.transform(draws, np.zeros(2), covariance)
    assert np.percentile(moved[:, 0], [2.5, 97.5]) == pytest.approx([-1.0, 4.0], abs=0.08)
    assert np.abs(moved[:, 1] - np.where(moved[:, 0] > 0, 2.0, -2.0) * moved[:, 0]).std() == pytest.approx(
        0.02, rel=0.5
    )


def test_an_interval_ends_where_the_density_has_dropped_whatever_the_linear_view_says(search: Search) -> None:
    term, fit = search.terms["magnet-strength"], search.fits[frozenset({"magnet-strength"})]
    profile = profile_of(search, fit, term)
    assert profile is not None
    column = fit.columns[profile.column]
    best, sigma = fit.point.value(column), float(np.sqrt(fit.posterior.covariance[profile.column, profile.column]))

    def drop(value: float) -> float:
        there = fit.point
        for item, moved in zip(fit.columns, profile.follow(np.array([value]))[0], strict=True):
            there = there.moved(item, moved - there.value(item))
        held = fit_model(search.problem, there, [term], search.tolerance, fit.runs, held=column)
        assert held.converged
        return held.posterior.misfit - fit.posterior.misfit

    assert drop(profile.low) == pytest.approx(Z_975**2, abs=ENOUGH)
    assert drop(best - Z_975 * sigma) < Z_975**2 - ENOUGH
