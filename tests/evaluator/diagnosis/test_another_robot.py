"""A session whose experiment names another robot than the one that was filmed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import PER_RUN, RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.mistakes.recognise import recognise
from evaluator.diagnosis.mistakes.session import another_robot
from evaluator.diagnosis.mistakes.session.another_robot import of_another_robot
from simulator.effects.entry import EffectEntry
from simulator.robot import Robot, load_robot
from tests.evaluator.diagnosis.marks_of_motion import recorded

BARREL, TIRES = load_robot("barrel"), load_robot("tire")
COMMANDS = [(30.0, 30.0), (-20.0, -20.0), (15.0, 40.0), (40.0, 15.0), (-40.0, -12.0), (12.0, -28.0), (-30.0, 5.0)]


def runs_of(robot: Robot, commands: list[tuple[float, float]]) -> list[RunData]:
    """Two seconds of each command, from the start of the motors, without noise."""
    blank = replace(recorded(np.zeros((61, 4))), time_s=np.linspace(0.0, 2.0, 61), start_s=0.0)
    runs = [replace(blank, id=f"r{k}", left_rpm=left, right_rpm=right) for k, (left, right) in enumerate(commands)]
    forward = Simulated([robot] * len(runs), runs, {})
    seen = forward.marks([Task(k, (0.0,) * PER_RUN) for k in range(len(runs))])
    return [replace(run, marks_mm=marks) for run, marks in zip(runs, seen, strict=True)]


def test_turns_of_another_robot_that_comes_with_turnscope_are_told_with_its_name() -> None:
    runs = runs_of(BARREL, COMMANDS)
    (mistake,) = recognise(runs, [TIRES] * len(runs))
    assert (mistake.kind, mistake.everywhere, len(mistake.runs)) == ("wrong-robot", True, len(runs))
    assert "turns as the robot barrel, not as its file says (5 of 5 turns; distance of" in mistake.sentence
    assert mistake.sentence.endswith('For barrel, write robot = "barrel" in experiment.toml')


@pytest.mark.parametrize(
    ("driven", "commands"),
    [
        (TIRES, COMMANDS),  # the right file
        (BARREL, COMMANDS[:2] * 3),  # straight runs tell nothing
        (BARREL, COMMANDS[:4]),  # two turns may each have a mistake of their own
        (BARREL, [*COMMANDS[:5], *[(30.0, 32.0)] * 4]),  # most turns agree with the file
    ],
)
def test_a_session_has_its_robot_unless_most_of_several_turns_are_those_of_another(
    driven: Robot, commands: list[tuple[float, float]]
) -> None:
    runs = runs_of(driven, commands)
    assert of_another_robot(runs, [TIRES] * len(runs)) == []


def test_of_many_turns_some_are_judged_and_all_runs_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(another_robot, "MOST_JUDGED", 4)
    runs = runs_of(BARREL, COMMANDS)
    found = of_another_robot(runs, [TIRES] * len(runs))
    assert [item.run for item in found] == [run.id for run in runs]
    assert "(4 of 4 turns; distance" in found[0].seen


def test_two_robots_of_one_session_are_not_judged() -> None:
    runs = runs_of(BARREL, COMMANDS)
    assert of_another_robot(runs, [TIRES, *[load_robot("tire")] * 6]) == []


def test_an_effect_that_changes_every_turn_is_no_other_robot() -> None:
    scrubbing = TIRES.model_copy(
        update={"effect": (EffectEntry.model_validate({"id": "friction-across", "factor": 0.5}),)}
    )
    runs = runs_of(scrubbing, COMMANDS)
    assert of_another_robot(runs, [TIRES] * len(runs)) == []
