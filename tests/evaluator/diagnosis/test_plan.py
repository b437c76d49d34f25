"""A planned experiment is balanced, stays on the plate, and shows what it says."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest
from click.testing import CliRunner

from evaluator.cli.group import turnscope
from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.design.candidate_runs import CandidateRun, Room
from evaluator.diagnosis.design.plan import expected, plan_runs
from evaluator.errors import InputError
from simulator.command import Command
from simulator.effects.coordinates import Candidate
from simulator.observation import marks_of_run
from simulator.robot import load_robot
from simulator.run import State
from simulator.simulation import simulate

ROOM = Room.of_plate((40.0, 30.0), 4.5)
FEW = ("drive-speed-mismatch", "plate-tilt", "scrub-torque", "mark-offset", "friction-gradient")


def _terms() -> dict[str, Candidate]:
    every = named_terms(15.0, (30.0, 60.0))
    return {effect: every[effect] for effect in FEW}


@pytest.fixture(scope="module")
def planned() -> list[CandidateRun]:
    return plan_runs(load_robot("barrel"), _terms(), (30.0, 60.0), ROOM, 18)


def test_a_plan_is_balanced_and_repeats_commands_from_other_headings(planned: list[CandidateRun]) -> None:
    kinds = Counter((np.sign(run.left_rpm + run.right_rpm), np.sign(run.right_rpm - run.left_rpm)) for run in planned)
    assert set(kinds.values()) == {3}
    assert len(kinds) == 6
    commands = Counter(run.command for run in planned)
    assert len(commands) == 12
    assert max(commands.values()) == 2
    assert len({run.heading_deg for run in planned}) >= 4
    assert len({(run.x_mm > 0, run.y_mm > 0) for run in planned}) == 4


def test_planned_runs_stay_on_the_plate(planned: list[CandidateRun]) -> None:
    robot = load_robot("barrel")
    for run in planned:
        start = State(run.x_mm, run.y_mm, np.radians(run.heading_deg))
        path = simulate(robot, Command.constant(*run.command), np.linspace(0, run.duration_s, 50), start)
        points = marks_of_run(robot, path).to_numpy()[:, 1:].reshape(-1, 2)
        assert np.abs(points).max(axis=0) == pytest.approx(
            np.minimum(np.abs(points).max(axis=0), ROOM.half_mm), abs=0.1
        )


def test_repeated_runs_show_more_but_not_what_a_tolerance_hides(planned: list[CandidateRun]) -> None:
    robot = load_robot("barrel")
    once, twice = (expected(robot, _terms(), runs) for runs in (planned[:6], planned[:6] * 2))
    assert [item.effect for item in once] == list(FEW)
    for few, many in zip(once, twice, strict=True):
        assert 0.999 * few.sigmas <= many.sigmas <= 1.02 * np.sqrt(2) * few.sigmas
        assert few.apart_sigmas <= few.sigmas * 1.001
    gained = {few.effect: many.sigmas / few.sigmas for few, many in zip(once, twice, strict=True)}
    assert gained["friction-gradient"] > 1.3
    assert gained["mark-offset"] < 1.1
    shown = {item.effect: item for item in twice}
    assert shown["plate-tilt"].measure.startswith("level of the plate")
    assert shown["mark-offset"].measured_sigmas is not None
    assert shown["mark-offset"].measured_sigmas > 1.1 * shown["mark-offset"].sigmas


def test_a_plate_too_small_for_any_run_is_refused() -> None:
    with pytest.raises(InputError, match="has no room for a run that can be simulated"):
        plan_runs(load_robot("barrel"), _terms(), (30.0,), Room.of_plate((10.0, 10.0), 4.5), 4)


def test_the_command_prints_runs_and_what_they_would_show() -> None:
    done = CliRunner().invoke(turnscope, ["plan", "--runs", "6", "--rpm", "30", "--plate", "30", "25", "--json"])
    assert done.exit_code == 0
    content = json.loads(done.output)
    assert len(content["runs"]) == 6
    shown = {item["effect"]: item["sigmas"] for item in content["effects"]}
    assert {"plate-tilt", "time-base"} <= shown.keys()
    assert min(shown.values()) > 0.1  # every effect at some size, none by what only says of which kind it is
