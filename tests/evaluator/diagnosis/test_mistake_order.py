"""The order in which mistakes are looked for: a run has one, and what hides another is found first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes import recognise as module
from evaluator.diagnosis.mistakes.intervals import unlike
from evaluator.diagnosis.mistakes.misread.hypotheses import Misread
from evaluator.diagnosis.mistakes.motion import Motion
from evaluator.diagnosis.mistakes.recognised import Found, Kind
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from simulator.robot import Robot, load_robot
from tests.evaluator.diagnosis.straight_session import ROBOT, driven

HUSKY = load_robot(Path(__file__).parents[2] / "driven_robot" / "husky.toml")
LOG = RunCommand(Command.constant(30.0, 30.0), logged=True)
SEARCHES: dict[str, Kind] = {
    "copies": "duplicate",
    "wrong_scale": "wrong-unit",
    "repainted_runs": "wrong-robot",
    "misread": "reversed",
    "disturbed_runs": "stuck",
    "late_starts": "late-start",
}


def searches(monkeypatch: pytest.MonkeyPatch, finds: Callable[[str, list[str]], Sequence[str]]) -> list[Any]:
    """Replace every search by one that finds its kind in some of the runs that it is given; what each was given."""
    given: list[Any] = []

    def search(name: str) -> Callable[..., list[Found]]:
        def found(data: Sequence[RunData], robots: Sequence[Robot] | None = None) -> list[Found]:
            ids = [run.id for run in data]
            assert robots is None or len(robots) == len(ids)
            given.append((name, ids))
            return [Found(run, SEARCHES[name], "", "") for run in finds(name, ids)]

        return found

    for name in SEARCHES:
        monkeypatch.setattr(module, name, search(name))
    monkeypatch.setattr(module, "misread", lambda *given: Misread(search("misread")(*given)))
    monkeypatch.setattr(module, "standing_runs", lambda *_: {"r7"})
    return given


def test_each_search_is_given_the_runs_in_which_nothing_was_found_and_all_that_is_found_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """r7 stands: nothing tells what it was commanded. Logs, of r8 and r9, are read before anything else disturbs."""
    given = searches(monkeypatch, lambda name, ids: ids[-1:] if (name, len(given)) == ("misread", 4) else ids[:1])
    data = [replace(driven(number), log=LOG if number > 7 else None) for number in range(10)]
    told = module.recognise(data, [ROBOT] * 10)
    assert given == [
        ("copies", [f"r{number}" for number in range(10)]),
        ("wrong_scale", [f"r{number}" for number in range(1, 10)]),
        ("repainted_runs", [f"r{number}" for number in range(2, 10)]),
        ("misread", ["r3", "r4", "r5", "r6", "r8", "r9"]),
        ("disturbed_runs", ["r3", "r4", "r5", "r6", "r7", "r8"]),
        ("misread", ["r4", "r5", "r6", "r8"]),
        ("late_starts", ["r5", "r6", "r8"]),
    ]
    assert {(item.runs[0], item.kind) for item in told} == {
        *(("r0", "duplicate"), ("r1", "wrong-unit"), ("r2", "wrong-robot"), ("r9", "reversed")),
        *(("r3", "stuck"), ("r4", "reversed"), ("r5", "late-start")),
    }


@pytest.mark.parametrize(("standing", "alike", "read"), [(8, True, 10), (7, True, 3), (8, False, 2)])
def test_runs_that_hardly_move_are_read_if_most_do_and_one_factor_slows_them(
    standing: int, alike: bool, read: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = searches(monkeypatch, lambda *_: [])
    monkeypatch.setattr(module, "standing_runs", lambda *_: {f"r{number}" for number in range(standing)})
    monkeypatch.setattr(module, "share_a_factor", lambda *_: alike)
    module.recognise([driven(number) for number in range(10)], [ROBOT] * 10)
    assert [len(ids) for name, ids in given if name in ("misread", "late_starts")] == [read] * 2


@pytest.mark.parametrize(
    ("search", "from_poses", "wrong", "told"),
    [
        ("wrong_scale", True, 8, 1),
        ("wrong_scale", True, 7, 0),
        ("wrong_scale", False, 1, 1),
        ("disturbed_runs", False, 1, 1),  # a camera that moves by 40 mm is seen without any model
        ("misread", False, 8, 1),
        ("misread", False, 7, 0),
    ],
)
def test_on_open_ground_single_runs_are_believed_if_marks_show_the_mistake_and_no_comparison_with_the_model(
    search: str, from_poses: bool, wrong: int, told: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    searches(monkeypatch, lambda name, ids: {"copies": ids[:1], search: ids[:wrong]}.get(name, []))
    monkeypatch.setattr(module, "standing_runs", lambda *_: set())
    runs = [replace(driven(number), from_poses=from_poses or number == 9) for number in range(10)]
    found = module.recognise(runs, [HUSKY] * 10)
    assert [item.kind for item in found] == ["duplicate", *[SEARCHES[search]] * told]


@pytest.mark.parametrize(("far", "told"), [({"r3", "r4"}, True), ({"r4"}, False)])
def test_on_open_ground_a_run_is_read_wrongly_if_it_disagrees_much_more_than_all_others(
    far: set[str], *, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of ten runs seen by a camera, one whose marks are exchanged was kept, and spoilt the diagnosis."""
    searches(monkeypatch, lambda *_: [])
    monkeypatch.setattr(module, "standing_runs", lambda *_: set())
    reversed_ = [Found("r3", "reversed", "", "")]
    monkeypatch.setattr(module, "misread", lambda *_: Misread(reversed_, far=frozenset(far)))
    runs = [replace(driven(number), from_poses=number == 9) for number in range(10)]
    found = module.recognise(runs, [HUSKY] * 10)
    assert [item.runs for item in found] == [("r3",)] * told
    (believed,) = module.recognise([driven(number) for number in range(10)], [HUSKY] * 10)  # on a laboratory's floor
    assert believed.runs == ("r3",)


def test_that_most_of_hundreds_of_runs_are_not_read_wrongly_but_disagree_is_told_of_no_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    searches(monkeypatch, lambda *_: [])
    monkeypatch.setattr(module, "misread", lambda *_: Misread([], "so many disagree"))
    (told,) = module.recognise([driven(number) for number in range(3)], [ROBOT] * 3)
    assert (told.runs, told.sentence, told.everywhere) == ((), "so many disagree", True)


def test_moments_are_unlike_a_run_beyond_eight_of_its_own_standard_deviations() -> None:
    """Nine values of which half lie beyond 1 of their median: a standard deviation of 1.4826."""
    usual = np.array([-2.0, -1.0, -1.0, 0.0, 0.0, 1.0, 1.0, 2.0, 0.0])
    for channel in range(3):
        for sigmas, is_unlike in ((7.9, False), (8.1, True), (-8.1, True)):
            values = np.tile(usual + 5.0, (3, 1))
            values[channel, -1] += sigmas * 1.4826
            assert unlike(Motion(np.arange(9.0), *values)).tolist() == [False] * 8 + [is_unlike]
