"""Fits of terms to runs: what their evidence counts."""

from __future__ import annotations

import pytest

from evaluator.discrepancy.experiment import Session, session_of
from evaluator.discrepancy.fit import Fit, fit_model
from evaluator.discrepancy.problem import build_problem
from evaluator.discrepancy.simulated import Simulated
from evaluator.discrepancy.terms import named_terms
from evaluator.settings import load_experiment
from tests.evaluator.discrepancy.hidden import write_hidden


def fitted(session: Session, *effects: str) -> Fit:
    """The fit of some effects to all runs of a session."""
    terms = named_terms(20.0, (30.0, 60.0))
    problem, start = build_problem(session.data, Simulated(session.robots, session.data, terms))
    return fit_model(problem, start, [terms[effect] for effect in effects], session.tolerance)


@pytest.fixture(scope="module")
def faster(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Wheels that are faster than commanded: drag with the wrong sign would explain it."""
    path = write_hidden(tmp_path_factory.mktemp("faster"), {"drive-speed-scale": {"factor": 1.01}})
    experiment = load_experiment(path)
    return session_of(experiment, {run.id: run.marks for run in experiment.run if run.marks is not None})


def test_what_only_a_value_beyond_the_bounds_would_gain_is_no_evidence(faster: Session) -> None:
    null, drag, scale = (fitted(faster, *effects) for effects in ((), ("rolling-drag",), ("drive-speed-scale",)))
    assert scale.posterior.log_evidence > null.posterior.log_evidence + 5
    assert drag.point.terms["rolling-drag"] == (0.0,)
    assert drag.posterior.mean[0] < -0.001  # without bounds
    assert drag.posterior.log_evidence < null.posterior.log_evidence
    assert drag.posterior.misfit == pytest.approx(null.posterior.misfit, abs=0.1)
