"""What is kept aside, what cannot be decided, and what is written into the robot file."""

from __future__ import annotations

import numpy as np

from evaluator.discrepancy.added import PATTERN_SUMS
from evaluator.discrepancy.experiment import held_out_runs, shortcomings
from evaluator.discrepancy.forward import RunData, Task
from evaluator.discrepancy.free import WHEEL_PATTERNS, free_terms
from evaluator.discrepancy.simulated import Simulated
from evaluator.discrepancy.terms import named_terms
from simulator.effects.catalogue import EFFECTS
from simulator.robot import load_robot
from simulator.terms import PATTERNS


def _runs(commands: list[tuple[float, float]]) -> list[RunData]:
    time = np.arange(90) / 30
    return [
        RunData(f"r{i}", left, right, 0.1, None, time, np.zeros((90, 4)), i) for i, (left, right) in enumerate(commands)
    ]


def test_every_effect_of_the_catalogue_is_a_candidate_with_its_own_parameters() -> None:
    terms = named_terms(20.0, (30.0, 60.0))
    assert set(terms) == set(EFFECTS)
    for effect, term in terms.items():
        assert set(term.physical(term.neutral)) == {parameter.name for parameter in EFFECTS[effect].parameters}


def test_neutral_coordinates_change_nothing() -> None:
    data, terms = _runs([(33.3, 14.4)]), named_terms(20.0, (14.4, 33.3))
    simulated = Simulated([load_robot("barrel")], data, terms)
    own = (1.0, 2.0, 0.3, 0.0, 0.0, 0.0)
    plain = simulated.marks([Task(0, own)])[0]
    for effect, term in terms.items():
        assert np.abs(simulated.marks([Task(0, own, {}, {effect: term.neutral})])[0] - plain).max() < 1e-5, effect


def test_every_free_form_term_acts() -> None:
    data, free = _runs([(33.3, 14.4)]), free_terms()
    simulated = Simulated([load_robot("barrel")], data, free)
    own = (3.0, 2.0, 0.3, 0.0, 0.0, 0.0)
    plain = simulated.marks([Task(0, own)])[0]
    for effect, term in free.items():
        step = tuple(coordinate.step for coordinate in term.coordinates)
        moved = simulated.marks([Task(0, own, {}, {effect: step})])[0]
        assert np.abs(moved - plain).max() > 1e-7, effect


def test_what_cannot_be_simulated_is_nan_not_an_exception() -> None:
    data, terms = _runs([(30, 30)]), named_terms(20.0, (30.0,))
    simulated = Simulated([load_robot("barrel")], data, terms)
    assert np.isnan(simulated.marks([Task(0, (0.0,) * 6, {}, {"mass-offset": (5.0, 0.0)})])[0]).all()


def test_a_whole_command_and_repeats_are_kept_aside() -> None:
    commands = [(30.0, 30.0), (60.0, 60.0), (-30.0, -30.0), (33.3, 14.4), (-33.3, -14.4), (60.0, 40.0)] * 3
    data = _runs([*commands, (20.0, 20.0)])
    aside = held_out_runs(data)
    assert len(aside) == len(data) // 6
    fitted = {run.command for number, run in enumerate(data) if number not in aside}
    assert {data[number].command for number in aside} - fitted == {(20.0, 20.0)}


def test_one_command_alone_cannot_decide() -> None:
    assert "same command" in shortcomings(_runs([(30.0, 30.0)] * 8))[0]
    assert shortcomings(_runs([(30.0, 30.0), (33.3, 14.4)] * 4)) == []


def test_patterns_of_single_wheels_are_sums_of_the_patterns_of_robot_files() -> None:
    for name, parts in PATTERN_SUMS.items():
        total = sum(share * np.array(PATTERNS[part]) for part, share in parts)
        assert np.allclose(total, WHEEL_PATTERNS[name]), name
