"""Fits of terms to runs: what their evidence counts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.inference.search import Search, fit_set
from evaluator.diagnosis.likelihood.linear.mixed_model import USUAL_SCATTER
from evaluator.diagnosis.likelihood.preparation import build_problem
from evaluator.diagnosis.likelihood.simulation import Simulated
from tests.evaluator.diagnosis.hidden import hidden_session


def fitted(session: Session, *effects: str) -> Fit:
    """The fit of some effects to all runs of a session."""
    terms = named_terms(20.0, (30.0, 60.0))
    problem, start = build_problem(session.data, Simulated(session.robots, session.data, terms))
    return fit_model(problem, start, [terms[effect] for effect in effects], session.tolerance)


@pytest.fixture(scope="module")
def faster(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """Wheels that are faster than commanded: drag with the wrong sign would explain it."""
    return hidden_session(tmp_path_factory.mktemp("faster"), {"drive-speed-scale": {"factor": 1.01}}, exact=True)


def test_what_only_a_value_beyond_the_bounds_would_gain_is_no_evidence(faster: Session) -> None:
    null, drag, scale = (fitted(faster, *effects) for effects in ((), ("rolling-drag",), ("drive-speed-scale",)))
    assert scale.posterior.log_evidence > null.posterior.log_evidence + 5
    assert drag.point.terms["rolling-drag"] == (0.0,)
    assert drag.posterior.mean[0] < -0.001  # without bounds
    assert drag.posterior.log_evidence < null.posterior.log_evidence
    assert drag.posterior.misfit == pytest.approx(null.posterior.misfit, abs=0.1)


def test_fit_that_wants_friction_no_run_can_have_is_not_tried_without_limit_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only friction of 0.4 times the nominal explains the runs; each run's own may go to half of it."""
    session = hidden_session(tmp_path, {"friction-level": {"factor": 0.4}}, exact=True)
    right, wrong = fitted(session, "friction-level"), fitted(session, "mark-offset")
    assert (right.converged, right.overreaches) == (True, False)
    assert (wrong.converged, wrong.overreaches) == (False, True)

    limits = []

    def counted(*given: Any, rival: float) -> Fit:
        limits.append(given[6])
        return fit_model(*given, rival=rival)

    monkeypatch.setattr("evaluator.diagnosis.inference.search.fit_model", counted)
    terms = named_terms(20.0, (30.0, 60.0))
    problem, start = build_problem(session.data, Simulated(session.robots, session.data, terms))
    search = Search(problem, terms, session.tolerance, tuple(range(len(session.data))))
    null = fit_model(problem, start, [], session.tolerance)
    found = fit_set(search, frozenset({"mark-offset"}), {}, null)
    assert found is not None
    assert found.converged
    assert limits == [None, USUAL_SCATTER]


def test_slopes_at_hand_lead_to_the_same_end_with_fewer_views(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = hidden_session(tmp_path, {"friction-level": {"factor": 0.8}}, exact=True)
    carried = fitted(session, "friction-level")
    monkeypatch.setattr("evaluator.diagnosis.inference.fit._carried_on", lambda *given: given[3])
    viewed = fitted(session, "friction-level")
    assert (carried.converged, viewed.converged) == (True, True)
    assert carried.steps < viewed.steps
    assert carried.posterior.log_evidence == pytest.approx(viewed.posterior.log_evidence, abs=0.05)


@pytest.mark.parametrize("seed", [103, 3])
def test_wheels_that_follow_late_by_two_causes_are_not_taken_for_one(seed: int, tmp_path: Path) -> None:
    """A dead time alone is nearly as good, and in dead time and time constant no step leads away from it."""
    lag = {"dead_time_s": 0.02, "time_constant_s": 0.05}
    fit = fitted(hidden_session(tmp_path, {"command-lag": lag}, seed), "command-lag")
    physical = named_terms(20.0, (30.0,))["command-lag"].physical(fit.point.terms["command-lag"])
    assert physical == pytest.approx(lag, abs=0.004)  # four standard uncertainties
