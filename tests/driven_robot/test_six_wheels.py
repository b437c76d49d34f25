"""A robot of another making and another world: from commands and poses to named effects and bands that hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evaluator.diagnosis.assessment.model_comparison import standing
from evaluator.diagnosis.assessment.verdict import pays
from evaluator.diagnosis.candidates.coordinates import named_terms, size_of
from evaluator.diagnosis.candidates.free_form import free_terms
from evaluator.diagnosis.experiment import session_of
from evaluator.diagnosis.likelihood.preparation import build_problem
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.search_ground import searched_on_ground, singles_on_ground
from evaluator.diagnosis.search_input import Prepared
from evaluator.progress import no_progress
from evaluator.settings import load_experiment
from evaluator.workflow import analyze
from simulator.robot import load_robot
from tests.driven_robot.corrected import Model
from tests.driven_robot.drive import Drive, load, write_experiment
from tests.driven_robot.predicted import predicted
from tests.driven_robot.six_wheels import RADIUS_M, WINDOW_S, Truth, driven, recorded, write_recording

ROBOT = Path(__file__).with_name("six_wheels.toml")
MIXED = "free:left_drive.left_command=right_drive.right_command+left_drive.right_command=right_drive.left_command"


def test_the_robot_drives_straight_as_fast_as_its_drive_makes_of_the_command_and_as_late() -> None:
    truth = Truth()
    times, poses = driven(np.full((3, 2), 4.0), truth)
    speed = (truth.own + truth.other) * 4.0 * RADIUS_M
    last = times[-1]
    assert poses[-1, 0] == pytest.approx(speed * (last - truth.dead_time_s - truth.time_constant_s), abs=0.05)
    assert np.abs(poses[:, 1:]).max() < 1e-9


def test_a_recording_is_read_as_it_was_written_and_its_clock_is_late(tmp_path: Path) -> None:
    drive = recorded(4, 1)
    write_recording(drive, tmp_path)
    again: Drive = load(tmp_path)
    assert np.allclose(again.pose, drive.pose)
    assert np.allclose(again.command_rad_s, drive.command_rad_s)
    later, earlier = (recorded(4, 1, Truth(clock_s=clock, outliers=0.0)).pose for clock in (0.12, 0.0))
    assert np.abs(later - earlier).max() > 0.05


@pytest.mark.exam  # late motors of logs, and mixed sides, each by themselves: test_logs.py, test_own_effect.py
def test_late_motors_are_found_beside_the_mixing_of_sides_with_their_sizes(tmp_path: Path) -> None:
    truth = Truth()
    path = write_experiment(recorded(8, 2), np.arange(16), ROBOT, tmp_path)
    outputs = analyze(path, tmp_path / "out", workers=1).outputs
    experiment = load_experiment(path)
    session = session_of(experiment, {run.id: outputs.marks(run.id) for run in experiment.run})
    size = size_of(session.robots[0])
    # not friction-level: this world's law of friction is another, and beside a level of it the mixing is not one number
    named = {"command-lag", "viscous-drag", "drive-speed-scale", "time-base"}
    terms = {name: term for name, term in named_terms(5e3, (30.0,), size=size).items() if name in named}
    terms[MIXED] = free_terms(size)[MIXED]
    problem, start = build_problem(session.data, Simulated(session.robots, session.data, terms))
    ready = Prepared(problem, start, {}, terms)
    part, search = searched_on_ground(singles_on_ground(ready, no_progress), ready, no_progress)
    assert set(part.runs) < set(search.runs)
    table = standing(search, families=1)
    best = next(ids for ids in table.sets if pays(search, table, 1, ids))  # viscous-drag beside them gains 4
    assert best == {"command-lag", MIXED}
    found = search.fits[best].point.terms
    assert found[MIXED] == pytest.approx((truth.own - 1, truth.other), abs=0.1)
    assert found["command-lag"][0] == pytest.approx(truth.delay_s, abs=0.1)


@pytest.mark.exam
def test_bands_of_predictions_hold_steps_that_were_not_fitted() -> None:
    drive = recorded(36, 3)
    aside = drive.fold == 0
    found = predicted(Model(load_robot(ROBOT), drive), ~aside, starts=1)
    off = np.abs(found.pose - drive.pose[:, -1])[aside]
    held = (off <= found.half_width[aside]).mean(axis=0)
    assert (held >= 0.8).all()  # 24 windows: 95 % less three standard deviations
    place = np.hypot(off[:, 0], off[:, 1])
    assert np.median(place) < 0.1  # of a way of 2 m in WINDOW_S, of which 0.02 m is noise of both ends
    assert WINDOW_S == 3.0
