"""A run that its own command explains within the tolerances of the robot has no other command."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import simulator.robot
from evaluator.diagnosis.likelihood.known_to import predicted_sigmas, quantities
from evaluator.diagnosis.likelihood.run_data import PER_RUN, RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.likelihood.within_tolerances import misfit_within_tolerances
from evaluator.diagnosis.mistakes.misread import belief
from evaluator.diagnosis.mistakes.misread.alternatives import Alternative
from evaluator.diagnosis.mistakes.misread.belief import is_beyond_tolerances
from evaluator.diagnosis.mistakes.misread.hypotheses import judgements_of, misread_runs
from evaluator.diagnosis.mistakes.misread.judgement import BETTER, Judgement
from evaluator.diagnosis.mistakes.recognised import Found
from evaluator.settings import KnownTo
from simulator.robot import load_robot
from tests.evaluator.diagnosis.marks_of_motion import recorded

TIRES = load_robot("tire")
STATED, OTHER = (60.0, 18.0), (30.0, 9.0)


def run_of(
    center_of_gravity_y_mm: float, command: tuple[float, float] = STATED, stated: tuple[float, float] = STATED
) -> RunData:
    """Four seconds on tires with a centre of gravity aside; 0.1 mm is its tolerance."""
    blank = recorded(np.zeros((81, 4)))
    run = replace(blank, time_s=np.linspace(0.0, 4.0, 81), start_s=0.0, left_rpm=command[0], right_rpm=command[1])
    (item,) = (item for item in quantities(KnownTo(), TIRES, [run]) if item.key == "center_of_gravity_y_mm")
    task = Task(0, (0.0,) * PER_RUN, {item.key: center_of_gravity_y_mm / item.per_unit})
    (marks,) = Simulated([TIRES], [run], {}, predicted_sigmas([item])).marks([task])
    return replace(run, marks_mm=marks, left_rpm=stated[0], right_rpm=stated[1])


def is_other_command(run: RunData) -> tuple[bool, bool]:
    """Whether half the command fits a run three times better than its file, as it is and within tolerances."""
    ways = [Alternative(None, run), Alternative("wrong-command", replace(run, left_rpm=OTHER[0], right_rpm=OTHER[1]))]
    (item,) = judgements_of([ways], [TIRES])
    better = BETTER * item.misfits_mm[1] <= item.misfits_mm[0]
    return bool(better), is_beyond_tolerances(Found(run.id, "wrong-command", "", ""), item, TIRES)


def test_a_turn_that_hangs_on_the_centre_of_gravity_is_no_other_command() -> None:
    assert is_other_command(run_of(-0.15)) == (True, False)
    assert is_other_command(run_of(0.0, OTHER)) == (True, True)


def test_exchanged_sides_are_told_though_they_fit_little_better_than_the_file_without_tolerances() -> None:
    """Of 54 / 90 rpm, with a centre of gravity 0.15 mm aside: 0.55 and 0.78 mm."""
    good = [run_of(-0.15, command, command) for command in ((90.0, 90.0), (90.0, 76.5), (45.0, 38.2))]
    runs = [replace(run, id=f"r{k}") for k, run in enumerate([*good, run_of(-0.15, (54.0, 90.0), (90.0, 54.0))])]
    assert [(item.run, item.kind) for item in misread_runs(runs, [TIRES] * 4)] == [("r3", "sides-swapped")]
    assert misread_runs(runs[:3], [TIRES] * 3) == []


def test_a_run_under_a_spring_of_the_robot_file_is_compared_from_where_it_begins(tmp_path: Path) -> None:
    """A pivot 40 mm from the anchor: 25 mm nearer to it, the same commands make another path."""
    file = tmp_path / "robot.toml"
    spring = '[[effect]]\nid = "tether-spring"\nstiffness_mN_mm = 0.045\nanchor_x_mm = -22.5\nanchor_y_mm = -28.6\n'
    shipped = Path(simulator.robot.__file__).parent / "robots" / "barrel.toml"
    file.write_text(f"{shipped.read_text(encoding='utf-8')}\n{spring}", encoding="utf-8")
    robot = load_robot(str(file))
    blank = replace(run_of(0.0), left_rpm=117.0, right_rpm=-183.0)
    pose = (4.8, 7.5, 2.6, 0.0, 0.0, 0.0, 0.0)
    (marks,) = Simulated([robot], [blank], {}).marks([Task(0, pose)])
    run = replace(blank, marks_mm=marks)
    assert judgements_of([[Alternative(None, run)]], [robot])[0].misfits_mm[0] < 0.05
    assert misfit_within_tolerances(run, robot) < 0.05
    assert judgements_of([[Alternative(None, replace(run, marks_mm=marks + 25.0))]], [robot])[0].misfits_mm[0] > 1.0


def test_values_within_tolerances_explain_a_run_to_a_hundredth_of_its_misfit() -> None:
    run = run_of(-0.08)
    assert (
        misfit_within_tolerances(run, TIRES)
        < 0.01 * judgements_of([[Alternative(None, run)]], [TIRES])[0].misfits_mm[0]
    )
    exchanged = replace(run, left_rpm=STATED[1], right_rpm=STATED[0])
    assert misfit_within_tolerances(exchanged, TIRES) > 0.3


@pytest.mark.parametrize(
    ("within", "holds", "asked"),
    [
        ((3.1, 0.1), True, 1),  # three times what the mistake misses as it is: it fits no worse within tolerances
        ((2.9, 0.9), True, 2),
        ((2.9, 1.0), False, 2),
        ((np.inf, 1.0), True, 1),
    ],
)
def test_a_mistake_is_fitted_within_tolerances_only_where_that_decides(
    within: tuple[float, float], holds: bool, asked: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    fitted = iter(within)
    tried: list[RunData] = []

    def misfit(run: RunData, _: Any) -> float:
        tried.append(run)
        return next(fitted)

    monkeypatch.setattr(belief, "misfit_within_tolerances", misfit)
    ways = [Alternative(kind, recorded(np.zeros((9, 4)))) for kind in (None, "mirrored", "reversed")]
    item = Judgement(ways, np.array([9.0, 0.5, 1.0]), 10.0, ())
    assert is_beyond_tolerances(Found("r", "reversed", "", ""), item, TIRES) == holds
    assert [run is ways[place].run for run, place in zip(tried, (0, 2), strict=False)] == [True] * asked


@pytest.mark.parametrize(
    ("count", "commands", "wrong", "kept", "asked"),
    [
        (40, 32, range(12, 40), 32, 5),  # four in five of 40 runs show it: five are tested, of which three hold
        (40, 32, range(20, 40), 0, 5),
        (41, 32, range(20, 40), 12, 32),
        (4, 4, (0, 2, 3), 3, 4),
        (41, 1, range(12, 40), 32, 5),  # so are runs of one command
        (41, 1, range(20, 40), 0, 5),
        (41, 2, range(20, 40), 12, 32),  # 16 of each are few
        (99, 1, range(20, 40), 0, 5),
    ],
)
def test_a_few_runs_stand_for_all_of_a_kind_that_most_show_or_many_of_one_command(
    count: int, commands: int, wrong: Collection[int], kept: int, asked: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    tested: list[str] = []

    def holds(item: Found, *_: Any) -> bool:
        tested.append(item.run)
        return int(item.run) in wrong

    monkeypatch.setattr(belief, "is_beyond_tolerances", holds)
    runs = [SimpleNamespace(id=str(k), log=None, command=(k % commands, 1)) for k in range(count)]
    seen: Any = [SimpleNamespace(ways=[SimpleNamespace(run=run)], turn_rad=(np.nan, np.nan)) for run in runs]
    found = [Found(str(k), "reversed", "", "") for k in range(min(count, 32))]
    assert len(belief.beyond_tolerances(found, seen, [TIRES] * count)) == kept
    assert len(tested) == asked


KINDS: tuple[Any, ...] = (None, "reversed", "sides-swapped", "mirrored", "wrong-command")


@pytest.mark.parametrize(
    ("within", "odd", "misfits", "asked"),
    [
        ({"reversed": 1.0, "sides-swapped": 3.5, None: 6.0}, 1, (6.0, 1.0, 3.5, 5.0, 3.1), KINDS[1:3]),
        ({"reversed": 3.4}, 1, (9.0, 3.4, 4.0, 5.0, 3.1), KINDS[1:2]),  # 9 is less than three times as much
        ({"reversed": 1.0, "sides-swapped": 4.5, None: 12.0}, 1, (9.0, 1.0, 4.0, 5.0, 3.1), KINDS[1:3]),
        ({}, 0, (9.0, 3.5, 4.0, 5.0, 3.1), ()),
        ({}, 2, (9.0, 3.5, 4.0, 5.0, 3.1), ()),  # most runs are odd
        ({}, -1, (9.0, 3.5, 4.0, 5.0, 3.1), ()),  # more than are varied
    ],
)
def test_readings_are_tried_within_tolerances_nearest_first_while_they_fit_three_times_better_than_the_file(
    within: dict[Any, float], odd: int, misfits: tuple[float, ...], asked: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = {kind: recorded(np.zeros((9, 4))) for kind in KINDS}
    tried = []

    def fitted(run: RunData, _: Any) -> float:
        kind = next(kind for kind, its in runs.items() if its is run)
        tried.append(kind)
        return within[kind]

    monkeypatch.setattr(belief, "misfit_within_tolerances", fitted)
    ways = [Alternative(kind, run) for kind, run in runs.items()]
    one = Judgement(ways, np.array([9.0, 3.5, 4.0, 5.0, 3.1]), 10.0, ())
    if odd < 0:
        monkeypatch.setattr(belief, "MOST_VARIED", 0)
    found = belief.misfits_within_tolerances([one] * 3, [TIRES] * 3, [number < abs(odd) for number in range(3)])
    assert found[0].tolist() == list(misfits)
    assert found[2].tolist() == one.misfits_mm.tolist() == [9.0, 3.5, 4.0, 5.0, 3.1]
    assert tried == [*asked, *([None] if None in within else [])]
