"""What a laboratory knows only to within a tolerance is no effect, and what lies far beyond it is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evaluator.diagnosis import diagnosis
from evaluator.diagnosis.assessment.knowledge import Knowledge
from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.diagnosis import Diagnosis, diagnose
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.likelihood.known_to import predicted_sigmas, quantities, seen_marks, seen_shift
from evaluator.diagnosis.likelihood.preparation import build_problem
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.progress import no_progress
from evaluator.settings import KnownTo
from tests.evaluator.diagnosis.hidden import hidden_session

LATE_S = 0.010
UNCERTAIN = ("start_common_s", "wheels.radius_mm", "green_x_mm")


def _known(found: Diagnosis, key: str) -> Knowledge:
    return next(item for item in found.known if item.quantity.key == key)


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """A clean experiment whose start_s is 10 ms too late in all runs; little else is uncertain, to save time."""
    session = hidden_session(tmp_path_factory.mktemp("late"), {})
    data = tuple(
        replace(
            run,
            start_s=run.start_s + LATE_S,
            systematic={key: shift for key, shift in run.systematic.items() if key in UNCERTAIN},
        )
        for run in session.data
    )
    known = tuple(item for item in session.known if item.key in UNCERTAIN)
    assert len(known) == len(UNCERTAIN)
    return diagnose(replace(session, data=data, known=known), no_progress)


def test_a_start_wrong_by_ten_milliseconds_is_no_effect_and_is_found(late: Diagnosis) -> None:
    assert late.verdict == "none"
    start = _known(late, "start_common_s")
    assert start.low < -LATE_S < start.high
    assert start.found == pytest.approx(-LATE_S, abs=0.003)


def test_of_a_laboratory_that_no_model_follows_nothing_is_said(
    late: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stain of low friction, fitted by nothing, was said to prove the plate level to a tenth of a degree."""
    monkeypatch.setattr(diagnosis, "MISSED", 0.0)
    lost = diagnosis._looked_at_again(late, late.fit.point)
    assert lost.verdict == "unknown"
    assert all(item.found == 0.0 for item in lost.known)
    assert _known(lost, "start_common_s").high == pytest.approx(1.96 * _known(late, "start_common_s").quantity.sigma)


def test_what_is_preferred_beyond_three_tolerances_is_told(late: Diagnosis) -> None:
    start = _known(late, "start_common_s")
    assert not start.is_finding
    told = Knowledge(replace(start.quantity, sigma=0.002), 0.020, 0.018, 0.022)
    assert told.is_finding
    assert told.sentence == "motion starts 20 ms later than start_s in all runs"


def test_knowledge_of_nothing_less_than_exact_leaves_no_parameter(tmp_path: Path) -> None:
    session: Session = hidden_session(tmp_path, {})
    exact = KnownTo(start_common_s=0.0, start_per_run_s=0.0, time_base=0.0, plane_scale=0.0)
    keys = {item.key for item in quantities(exact, session.robots[0], session.data)}
    assert not keys & {"start_common_s", "time_base", "plane_scale"}
    assert {"green_x_mm", "wheels.radius_mm", "plate_level_x_deg"} <= keys


def test_a_mark_that_is_elsewhere_moves_with_the_robot(tmp_path: Path) -> None:
    session = hidden_session(tmp_path, {})
    robot = session.robots[0]
    (quantity,) = (item for item in quantities(KnownTo(), robot, session.data) if item.key == "green_x_mm")
    run = session.data[2]
    shift = seen_shift({quantity.key: quantity.sigma}, run.marks_mm, seen_marks(robot))
    seen = np.isfinite(run.marks_mm).all(axis=1)
    across = run.marks_mm[seen, :2] - run.marks_mm[seen, 2:]
    assert np.allclose(np.hypot(*shift[seen, :2].T), quantity.sigma, rtol=0.01)  # these marks are noisy
    assert np.abs(np.sum(shift[seen, :2] * across, axis=1)).max() < 1e-9  # ahead is at right angles to the marks' line
    assert np.all(shift[seen, 2:] == 0.0)


def test_a_scale_of_the_plate_against_one_of_the_prediction_does_not_explain_the_noise(tmp_path: Path) -> None:
    """Stretching measured marks, which hold their noise, beside predicted ones left nothing over in any run."""
    session = hidden_session(tmp_path, {})
    terms = named_terms(20.0, (30.0, 60.0))
    forward = Simulated(session.robots, session.data, terms, predicted_sigmas(session.known), session.start_sigma_s)
    problem, start = build_problem(session.data, forward)
    alone, both = (
        fit_model(problem, start, [terms[effect] for effect in ids], session.tolerance)
        for ids in ((), ("plane-scale",))
    )
    assert both.excess == pytest.approx(alone.excess, rel=0.1)
