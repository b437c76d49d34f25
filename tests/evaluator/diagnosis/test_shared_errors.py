"""What a camera's uncertainty explains is no effect."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from calibration.camera import PARAMETERS, Camera, camera_above
from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.experiment import Session, session_of
from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.inference.fitted_model import Fit
from evaluator.diagnosis.likelihood.preparation import build_problem
from evaluator.diagnosis.likelihood.run_data import SHARED_UNIT, Task
from evaluator.diagnosis.likelihood.shared_errors import BENDS, Sighting, plane_errors, shared_errors
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.marks import columns_of
from evaluator.settings import load_experiment
from tests.evaluator.diagnosis.hidden import write_hidden

COLUMNS = ("time_s", *columns_of(("green", "yellow")))
HEIGHT_MM = 6.5
SIGMAS = {"translation_z_mm": 0.6, "rotation_x": 2e-3}  # 0.4 % of scale, a keystone of 2e-5 per mm


def _camera() -> Camera:
    camera = camera_above(size_px=(640, 480), focal_px=1800.0, distance_mm=150.0, tilt_deg=2.0)
    variances = np.zeros(len(PARAMETERS))
    for name, sigma in SIGMAS.items():
        variances[PARAMETERS.index(name)] = sigma**2
    return replace(camera, covariance=np.diag(variances))


def _misplaced(table: pd.DataFrame, camera: Camera) -> pd.DataFrame:
    """Marks of a camera that calibration got wrong by 1.5 standard deviations of each error."""
    wrong = replace(camera, parameters=camera.parameters + 1.5 * np.sqrt(np.diag(camera.covariance)))
    placed = table.copy()
    for mark in ("green", "yellow"):
        names = [f"{mark}_x_mm", f"{mark}_y_mm"]
        points = np.column_stack([table[names].to_numpy(), np.full(len(table), HEIGHT_MM)])
        placed[names] = wrong.plate_from_image(camera.image_from_plate(points), HEIGHT_MM)
    return placed


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> tuple[Session, Session]:
    """A clean experiment seen by a badly calibrated camera: taken as exact, and with the camera's uncertainty."""
    folder, camera = tmp_path_factory.mktemp("camera"), _camera()
    experiment = load_experiment(write_hidden(folder, {}))
    sightings, marks = [], {}
    for run in experiment.run:
        assert run.marks is not None
        table = _misplaced(pd.read_csv(run.marks), camera)
        table.to_csv(run.marks, index=False)
        marks[run.id] = Path(run.marks)
        sightings.append(Sighting(table[list(COLUMNS)], ("green", "yellow"), "camera 1", camera, HEIGHT_MM))
    read = session_of(experiment, marks)
    plain = tuple(replace(run, systematic={}) for run in read.data)
    exact = replace(read, data=plain, known=(), start_sigma_s=0.0)
    errors = shared_errors(sightings)
    data = tuple(replace(run, systematic=error) for run, error in zip(exact.data, errors, strict=True))
    return exact, Session(data, exact.robots, exact.skipped)


def _null_and_gain(session: Session, effect: str) -> tuple[Fit, float]:
    """The fit without effects, and the gain in log evidence by one."""
    terms = named_terms(20.0, (30.0, 60.0))
    problem, start = build_problem(session.data, Simulated(session.robots, session.data, terms))
    null = fit_model(problem, start, [], session.tolerance)
    fit = fit_model(problem, start, [terms[effect]], session.tolerance)
    assert fit.converged
    return null, fit.posterior.log_evidence - null.posterior.log_evidence


def test_a_camera_known_badly_is_evidence_for_an_effect_only_where_it_is_taken_as_exact(
    sessions: tuple[Session, Session],
) -> None:
    exact, known = sessions
    assert _null_and_gain(exact, "plane-scale")[1] > 1000
    null, gain = _null_and_gain(known, "plane-scale")
    assert (
        gain < 1
    )  # less than an effect among twenty-six must bring to be believed: log odds of 4.5 on top of its prior
    moved = [null.point.nominal[key] / SHARED_UNIT for key in known.tolerance]
    assert 1 < np.hypot.reduce(moved) < 4  # two errors of 1.5 standard deviations each


def test_a_shared_error_moves_the_marks_as_its_unit_says(sessions: tuple[Session, Session]) -> None:
    _, known = sessions
    simulated = Simulated(known.robots, known.data, {})
    own = (0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0)
    key, shift = next(iter(known.data[2].systematic.items()))
    plain, moved = simulated.marks([Task(2, own), Task(2, own, {key: 2 * SHARED_UNIT})])
    assert np.allclose(moved - plain, 2 * shift, atol=1e-12)
    assert np.abs(shift).max() > 1e-3


def scattered(rng: np.random.Generator, middle_mm: float = 30.0) -> np.ndarray:
    """Two marks (200, 4), 3 mm apart at any heading, all over a plate of 80 mm."""
    first = rng.uniform(-40, 40, (200, 2)) + middle_mm
    turn = rng.uniform(0, 2 * np.pi, 200)
    return np.concatenate([first, first + 3 * np.stack([np.cos(turn), np.sin(turn)], axis=1)], axis=1)


def test_a_plane_whose_scale_is_known_to_a_share_may_bend_by_so_much_at_its_edges() -> None:
    """Keystone and lens in each of x and y; scaled with the share, wherever the origin lies."""
    rng = np.random.default_rng(3)
    runs = [scattered(rng), scattered(rng)]
    errors = plane_errors([runs[0], None, runs[1]], 1e-3)
    assert errors[1] == {}
    assert list(errors[0]) == list(errors[2]) == [f"plane, error {k + 1}" for k in range(2 * len(BENDS))]
    shifts = np.stack(list(errors[0].values()), axis=2)
    place = (runs[0] - 30.0) / 41.5  # in half of what the marks cover
    keystone = 1e-3 * 41.5 / 2 * place**2 * [1.0, 0.0, 1.0, 0.0]
    basis = shifts.reshape(-1, shifts.shape[2])
    found = np.linalg.lstsq(basis, keystone.ravel(), rcond=None)[0]
    np.testing.assert_allclose(basis @ found, keystone.ravel(), atol=4e-4)
    assert np.linalg.norm(found) == pytest.approx(1.0, rel=0.05)  # one standard deviation
    halved = plane_errors(runs, 5e-4)[0]
    np.testing.assert_allclose(halved["plane, error 1"], errors[0]["plane, error 1"] / 2, atol=1e-12)


def test_a_plane_known_exactly_or_seen_on_a_spot_has_no_errors_of_its_own() -> None:
    marks = scattered(np.random.default_rng(4))
    assert plane_errors([marks], 0.0) == [{}]
    assert plane_errors([None], 1e-3) == [{}]
    spot = marks.copy()
    spot[:, :2] = marks[:, :2] * 1e-3
    spot[:, 2:] = spot[:, :2] + 0.05
    assert plane_errors([spot], 1e-3) == [{}]
    lost = marks.copy()
    lost[7] = np.nan
    assert all(np.all(shift[7] == 0.0) and np.isfinite(shift).all() for shift in plane_errors([lost], 1e-3)[0].values())
