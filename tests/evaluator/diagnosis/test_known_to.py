"""What a laboratory knows only to within a tolerance is no effect, and what lies far beyond it is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from evaluator.diagnosis import review
from evaluator.diagnosis.assessment.knowledge import Knowledge
from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.diagnosis import diagnose
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.likelihood.known_to import predicted_sigmas, quantities
from evaluator.diagnosis.likelihood.preparation import build_problem
from evaluator.diagnosis.likelihood.run_data import Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.result import Diagnosis
from evaluator.progress import no_progress
from evaluator.settings import KnownTo
from simulator.effects.view import View
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
    monkeypatch.setattr(review, "farthest_followed", lambda _, runs: np.zeros(len(runs)))
    lost = review.reviewed(replace(late, nominal=late.fit.point))
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


def test_scale_and_places_of_marks_are_seen_as_the_camera_sees_everything(tmp_path: Path) -> None:
    """A tilted camera shows a mark that is glued elsewhere where it shows that place."""
    session = hidden_session(tmp_path, {})
    terms, known = named_terms(20.0, (30.0, 60.0)), predicted_sigmas(session.known)
    forward = Simulated(session.robots, session.data, terms, known)
    own, tilt = (10.0, 5.0, 2.0, 0.0, 0.0, 0.0, 0.0), {"camera-tilt": (0.003, 0.001, 1.0)}
    straight, moved, scaled = forward.marks(
        [
            Task(2, own),
            Task(2, own, {"yellow_y_mm": 0.05 / known["yellow_y_mm"]}, tilt),
            Task(2, own, {"plane_scale": 1e-3 / known["plane_scale"]}, tilt),
        ]
    )
    camera = View((), keystone_per_mm=(0.003, 0.001), perspective=1.0)
    green, yellow = straight[:, :2], straight[:, 2:]
    left = (green - yellow) / np.linalg.norm(green - yellow, axis=1)[:, None]  # of the robot: green is on its left
    np.testing.assert_allclose(moved, np.hstack([camera.place(green), camera.place(yellow + 0.05 * left)]), atol=1e-6)
    np.testing.assert_allclose(scaled, 1.001 * np.hstack([camera.place(green), camera.place(yellow)]), atol=1e-6)


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


def test_motors_start_when_a_clock_that_is_off_says_so(tmp_path: Path) -> None:
    """Start and frames are read off one clock: seconds counted too long move neither against the other."""
    session = hidden_session(tmp_path, {})
    forward = Simulated(session.robots, session.data, named_terms(20.0, (30.0, 60.0)))
    own = (10.0, 5.0, 2.0, 0.0, 0.0, 0.0, 0.0)
    slow, right = forward.marks([Task(2, own, {}, {"time-base": (0.5,)}), Task(2, own)])
    run = session.data[2]
    moving = [run.time_s[np.flatnonzero(np.hypot(*(marks - marks[0])[:, :2].T) > 0.02)[0]] for marks in (slow, right)]
    assert moving == pytest.approx([run.start_s, run.start_s], abs=0.05)
