"""What is held out, what cannot be decided, and what is written into the robot file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.candidates.free_form import free_terms
from evaluator.diagnosis.experiment import FEWEST_POSES, shortcomings
from evaluator.diagnosis.held_out import held_out_runs
from evaluator.diagnosis.likelihood.features import compression
from evaluator.diagnosis.likelihood.noise.tracking import Noise
from evaluator.diagnosis.likelihood.run_data import START_POSE, RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.likelihood.variants import varies_by_run
from evaluator.diagnosis.output.effect_tables import PATTERN_SUMS
from evaluator.interchange.commands import RunCommand
from evaluator.workflow.diagnosis.experiment import diagnose_experiment
from simulator.command import Command
from simulator.dynamics.model import compile_robot
from simulator.dynamics.terms import pattern_weights
from simulator.effects.catalogue import EFFECTS
from simulator.effects.entry import EffectEntry
from simulator.effects.free_form import ID as FREE_FORM
from simulator.effects.parameter import Size
from simulator.observation import marks_of_run
from simulator.robot import load_robot
from simulator.run import State
from simulator.simulation import simulate


def _runs(commands: list[tuple[float, float]]) -> list[RunData]:
    time = np.arange(90) / 30
    return [
        RunData(f"r{i}", left, right, 0.1, None, time, np.zeros((90, 4)), i) for i, (left, right) in enumerate(commands)
    ]


def test_every_effect_of_the_catalogue_is_a_candidate_with_its_own_parameters() -> None:
    terms = named_terms(20.0, (30.0, 60.0), size=Size(100.0, 1e4))
    assert set(terms) == set(EFFECTS)
    for effect, term in terms.items():
        assert set(term.physical(term.absent)) == {parameter.name for parameter in EFFECTS[effect].parameters}


def test_neutral_coordinates_change_nothing() -> None:
    data, terms = _runs([(33.3, 14.4)]), named_terms(20.0, (14.4, 33.3))
    simulated = Simulated([load_robot("barrel")], data, terms)
    own = (1.0, 2.0, 0.3, 0.0, 0.0, 0.0, 0.0)
    plain = simulated.marks([Task(0, own)])[0]
    for effect, term in terms.items():
        assert np.abs(simulated.marks([Task(0, own, {}, {effect: term.absent})])[0] - plain).max() < 1e-5, effect


def test_every_free_form_term_acts() -> None:
    data, free = _runs([(33.3, 14.4)]), free_terms()
    simulated = Simulated([load_robot("barrel")], data, free)
    own = (3.0, 2.0, 0.3, 0.0, 0.0, 0.0, 0.0)
    plain = simulated.marks([Task(0, own)])[0]
    for effect, term in free.items():
        step = tuple(coordinate.step for coordinate in term.coordinates)
        moved = simulated.marks([Task(0, own, {}, {effect: step})])[0]
        assert np.abs(moved - plain).max() > 1e-7, effect


def test_only_effects_that_are_compiled_run_by_run_know_the_order_of_the_runs() -> None:
    barrel = load_robot("barrel")
    for effect, definition in EFFECTS.items():
        values = {parameter.name: parameter.absent + parameter.step for parameter in definition.parameters}
        robot = barrel.model_copy(update={"effect": (EffectEntry.model_validate({"id": effect, **values}),)})
        same = compile_robot(robot, 0).tobytes() == compile_robot(robot, 7).tobytes()
        assert same == (not varies_by_run(effect)), effect


def test_marks_of_a_task_are_those_of_a_robot_with_its_friction_gains_and_effects() -> None:
    data = _runs([(30.0, 30.0), (33.3, 14.4)])
    barrel, terms = load_robot("barrel"), {**named_terms(20.0, (14.4, 33.3)), **free_terms()}
    creep = "free:camera_x.time+camera_y.time"
    own = (1.0, 2.0, 0.3, 0.05, 0.02, -0.01, 0.0)
    task = Task(1, own, {"slip.lateral_friction": 0.1}, {"drive-speed-scale": (1.03,), creep: (0.02, -0.01)})
    seen = Simulated([barrel, barrel], data, terms).marks([Task(0, own), task])[1]
    slip = barrel.slip.model_copy(
        update={
            "lateral_friction": barrel.slip.lateral_friction * 1.1 * 1.05,
            "longitudinal_friction": barrel.slip.longitudinal_friction * 1.05,
        }
    )
    entries = [
        {"id": "drive-speed-scale", "factor": 1.03},
        {"id": FREE_FORM, "channel": "camera_x", "basis": "time", "coefficient": 0.02},
        {"id": FREE_FORM, "channel": "camera_y", "basis": "time", "coefficient": -0.01},
    ]
    robot = barrel.model_copy(update={"slip": slip, "effect": tuple(map(EffectEntry.model_validate, entries))})
    command = Command.constant(33.3 * 1.02, 14.4 * 0.99, 0.1)
    marks = marks_of_run(robot, simulate(robot, command, data[1].time_s, State(*own[:3])))
    assert np.abs(seen - marks.iloc[:, 1:].to_numpy()).max() < 2e-5


def test_what_cannot_be_simulated_is_nan_not_an_exception() -> None:
    data, terms = _runs([(30, 30)]), named_terms(20.0, (30.0,))
    simulated = Simulated([load_robot("barrel")], data, terms)
    assert np.isnan(simulated.marks([Task(0, (0.0,) * 7, {}, {"mass-offset": (20.0, 0.0)})])[0]).all()


def test_a_whole_command_and_repeats_are_kept_aside() -> None:
    commands = [(30.0, 30.0), (60.0, 60.0), (-30.0, -30.0), (33.3, 14.4), (-33.3, -14.4), (60.0, 40.0)] * 3
    data = _runs([*commands, (20.0, 20.0)])
    aside = held_out_runs(data)
    assert len(aside) == len(data) // 6
    fitted = {run.command for number, run in enumerate(data) if number not in aside}
    assert {data[number].command for number in aside} - fitted == {(20.0, 20.0)}


def test_the_fastest_command_is_kept_aside_whose_direction_and_side_others_have() -> None:
    runs = [(20.0, 20.0), (-70.0, -70.0), (40.0, 40.0), (60.0, 60.0), (30.0, 10.0), (30.0, 10.0), (10.0, 90.0)]
    assert held_out_runs(_runs(runs)) == (3,)


def test_of_three_commands_none_is_kept_aside_as_a_whole_but_the_middle_repetitions() -> None:
    runs = [(20.0, 20.0), (40.0, 40.0), *[(60.0, 60.0)] * 5, *[(40.0, 40.0)] * 5]
    assert held_out_runs(_runs(runs)) == (4, 9)  # the fourth of the six of 40 rpm, the third of the five of 60 rpm


@pytest.mark.parametrize("repeated", [True, False])
def test_the_only_run_that_drives_backward_in_a_part_of_its_log_is_fitted(repeated: bool) -> None:
    """Its main command is that of others, and it would be the run held out."""
    rpm = [(20.0, 10.0)] * 8 if repeated else [(20.0, 10.0 + k) for k in range(8)]
    data = _runs(rpm)
    (usual,) = held_out_runs(data)
    left, right = rpm[usual]
    log = RunCommand(Command.steps([(0.0, left, right), (2.0, -left, -right)]), logged=True)
    data[usual] = replace(data[usual], log=log)
    (held_out,) = held_out_runs(data)
    assert held_out != usual


def test_no_run_is_held_out_twice() -> None:
    """A command of two runs is held out as a whole, and a run of each of the three others; the sixth is any other."""
    rpm = [(20.0, 20.0)] * 2 + [(30.0, 30.0)] * 11 + [(40.0, 40.0)] * 11 + [(50.0, 50.0)] * 12
    aside = held_out_runs(_runs(rpm))
    assert set(aside) >= {0, 1}
    assert len(set(aside)) == len(aside) == 6


def test_of_fewer_than_six_runs_none_is_held_out_and_of_six_one() -> None:
    assert held_out_runs(_runs([(20.0, 20.0), (40.0, 40.0)] * 2 + [(20.0, 20.0)])) == ()
    assert len(held_out_runs(_runs([(20.0, 20.0), (40.0, 40.0)] * 3))) == 1


def test_one_command_alone_cannot_decide() -> None:
    assert "same command" in shortcomings(_runs([(30.0, 30.0)] * 8))[0]
    assert shortcomings(_runs([(30.0, 30.0), (33.3, 14.4)] * 4)) == []


def test_runs_with_the_same_log_of_several_commands_do_not_have_one_command_alone() -> None:
    several = RunCommand(Command.steps([(0.0, 30.0, 30.0), (1.0, 33.3, 14.4), (2.0, 0.0, 0.0)]), logged=True)
    one = RunCommand(Command.steps([(0.0, 33.3, 14.4), (2.0, 0.0, 0.0)]), logged=True)
    runs = _runs([(30.0, 30.0)] * 8)
    assert shortcomings([replace(run, log=several) for run in runs]) == []
    (advice,) = shortcomings([replace(run, log=one) for run in runs])
    assert advice.startswith("all runs have the same command, 33.3 / 14.4 rpm: drive other ratios of the wheel speeds")


def test_where_too_few_runs_are_left_it_is_said_why_the_others_are_not() -> None:
    few, skipped = _runs([(30.0, 30.0), (33.3, 14.4)]), {"w042": "7 poses that do not repeat the one before"}
    assert shortcomings(few, skipped)[1] == "1 run left out (w042: 7 poses that do not repeat the one before)"
    assert shortcomings(_runs([(30.0, 30.0), (33.3, 14.4)] * 4), skipped) == []


def test_the_fewest_poses_leave_twice_of_what_a_start_pose_takes_and_one_less_nothing() -> None:
    left = []
    for count in (FEWEST_POSES, FEWEST_POSES - 1):
        part = compression(np.linspace(0.0, 2.0, count), np.ones(count, dtype=np.bool_), (Noise(1.0, 0.0, 0.1),) * 4)
        left.append(sum(functional.shape[1] for functional in part.functional[:3]))  # x, y and heading
    assert left == [2 * START_POSE, START_POSE]


def test_a_run_of_few_poses_is_left_out_for_poses_not_for_marks(tmp_path: Path) -> None:
    for name, count in (("few", 5), ("many", 30)):
        time_s = 0.2 * np.arange(count)
        table = pd.DataFrame({"time_s": time_s, "x_mm": 3 * time_s, "y_mm": 0.0, "heading_deg": 0.0})
        table.to_csv(tmp_path / f"{name}.csv", index=False)
    runs = "".join(
        f'[[run]]\nid = "{name}"\nposes = "{name}.csv"\nleft_rpm = 60.0\nright_rpm = 60.0\n' for name in ("few", "many")
    )
    path = tmp_path / "experiment.toml"
    path.write_text(f'format = 1\nname = "poses"\nrobot = "barrel"\n{runs}', encoding="utf-8")
    content = diagnose_experiment(path, tmp_path / "out", workers=1)[1]
    assert content["skipped_runs"] == {"few": "5 poses that do not repeat the one before; at least 6 are needed"}


def test_patterns_of_single_wheels_are_sums_of_the_patterns_of_robot_files() -> None:
    for name, parts in PATTERN_SUMS.items():
        wheels = load_robot("barrel").all_wheels
        total = sum(share * np.array(pattern_weights(part, wheels)) for part, share in parts)
        assert np.allclose(total, pattern_weights(name, wheels)), name
