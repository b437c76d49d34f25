"""Runs that are proposed: what they tell, against dense least squares, and which are chosen for which rivals."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.assessment.model_comparison import Standing
from evaluator.diagnosis.design import next_runs
from evaluator.diagnosis.design.candidate_runs import CORNERS, MIDDLE, CandidateRun, Room
from evaluator.diagnosis.design.next_runs import Information, NextRuns, Rival, best_next_runs, from_chosen, from_rival
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.noise.tracking import Noise
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.simulation import Simulated
from simulator.effects.coordinates import Candidate, Coordinate
from simulator.robot import load_robot
from tests.evaluator.diagnosis.synthetic import fit_of, free_of_start, linear_runs, run_data

NONE: frozenset[str] = frozenset()
A, B, AB = frozenset({"a"}), frozenset({"b"}), frozenset({"a", "b"})
TAU = np.array([0.05, 0.02, 0.02, 1.0])


def effect(name: str, step: float = 0.1, **said: Any) -> Candidate:
    """An effect of one coordinate."""
    coordinate = Coordinate("size", 0.0, step)
    return Candidate(name, (coordinate,), lambda values: {"size": values[0]}, **said)


def test_a_hypothetical_run_rests_for_half_a_second_and_begins_where_it_is_placed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tasks: list[Any] = []

    def marks(_: Any, asked: list[Any]) -> list[np.ndarray]:
        tasks.extend(asked)
        return [np.tile([0.0, 1.0 + task.run, 0.0, -1.0 - task.run], (len(times[task.run]), 1)) for task in asked]

    monkeypatch.setattr(Simulated, "marks", marks)
    times = [np.arange(130) / 20, np.arange(50) / 20, np.arange(50) / 20]  # with the rest before it
    runs = [CandidateRun(30.0, 20.0, 90.0, 1.0, 2.0, 6.0), *[CandidateRun(10.0, 10.0, 0.0, 0.0, 0.0, 2.0)] * 2]
    point = Point(np.zeros((0, 7)), {"body.mass_g": 0.1})
    noise = (Noise(0.01, 0.0, 0.1),) * 4
    problem, at = next_runs.hypothetical(load_robot("barrel"), {}, noise, runs, [4, 5, 6], point)
    assert [(run.left_rpm, run.right_rpm, run.start_s, run.order) for run in problem.data] == [
        (30.0, 20.0, 0.5, 4), (10.0, 10.0, 0.5, 5), (10.0, 10.0, 0.5, 6),
    ]  # fmt: skip
    for number, (run, time) in enumerate(zip(problem.data, times, strict=True)):
        np.testing.assert_allclose(run.time_s, time)
        assert run.marks_mm[-1].tolist() == [0.0, 1.0 + number, 0.0, -1.0 - number]  # as predicted
    assert at.per_run.tolist() == [[1.0, 2.0, np.pi / 2, 0, 0, 0, 0], [0.0] * 7, [0.0] * 7]
    assert (at.nominal, tasks[0].nominal) == ({"body.mass_g": 0.1},) * 2
    assert problem.half_distance_mm == 1.0  # of most frames
    forward = problem.forward
    assert isinstance(forward, Simulated)
    assert (forward.start_sigma_s, forward.known) == (0.0, {})


def problem_of(runs: list[Linearized | None]) -> Any:
    """A problem of these runs, whatever the point; None for one that cannot be simulated."""
    return SimpleNamespace(data=[None] * len(runs), attempted=lambda *_: runs, given=())


def whitened(run: Linearized, columns: Any = slice(None)) -> tuple[np.ndarray, np.ndarray]:
    """Response and common columns of a run in units of its noise, whatever its start pose and random effects."""
    response, common, scatter = free_of_start(run)
    root = np.linalg.inv(np.linalg.cholesky(np.eye(len(response)) + scatter @ np.diag(TAU**2) @ scatter.T))
    return root @ response, root @ common[:, columns]


def least_square(rows: list[tuple[np.ndarray, np.ndarray]]) -> float:
    """What no parameters take off responses, over rows of response and columns."""
    response, columns = (np.concatenate(part) for part in zip(*rows, strict=True))
    return float(np.sum((response - columns @ np.linalg.lstsq(columns, response, rcond=None)[0]) ** 2))


def test_a_rival_imitates_runs_within_what_is_known_of_its_parameters() -> None:
    runs, at = linear_runs(count=4, scale=0.5), np.array([0.4, -0.2])
    spread = np.random.default_rng(3).normal(size=(2, 2))
    columns = [Column("a", 0, effect("a")), Column("b", 0, effect("b"))]
    fit = fit_of(runs, columns, at, TAU, spread @ spread.T)
    point = Point(np.zeros((0, 7)), {}, {"a": (0.4,), "b": (-0.2,)})
    fit.point, where = point, Point(np.zeros((4, 7)))
    told = from_rival(problem_of([*runs, None]), where, Rival(fit, 1.5))
    prior = np.linalg.solve(spread, at), np.linalg.inv(spread)
    for made in ([], [2], [0, 3]):
        expected = [1.5**2 + least_square([prior, *(whitened(runs[k]) for k in (*made, one))]) for one in range(4)]
        assert told.squares(made)[:4] == pytest.approx(expected)
        left = least_square([prior, *(whitened(runs[k]) for k in made)])
        assert told.squares(made)[4] == pytest.approx(1.5**2 + left)


def test_what_the_chosen_effects_do_is_imitated_by_the_rivals_and_by_values_within_their_tolerances() -> None:
    """Of a nominal value k, the chosen effect a, the rival's b and c of both."""
    runs, tolerance = linear_runs(count=7, parameters=4, scale=0.5), {"k": 0.3, "exact": 0.0}
    terms = {name: effect(name, stepwise=name == "s") for name in "abcs"}
    at_hand: Any = SimpleNamespace(terms=terms, tolerance=tolerance, problem=problem_of(runs[:3]))  # type: ignore[arg-type]
    point = Point(np.zeros((0, 7)), {}, {"a": (0.7,), "c": (0.2,)})
    chosen: Any = SimpleNamespace(terms=frozenset("acs"), point=point, posterior=SimpleNamespace(scatter=TAU))
    rival: Any = Rival(SimpleNamespace(terms=frozenset("bc")))  # type: ignore[arg-type]
    told = from_chosen(at_hand, chosen, problem_of(runs[3:]), Point(np.zeros((4, 7))), rival)  # type: ignore[arg-type]

    def row(run: Linearized) -> tuple[np.ndarray, np.ndarray]:
        _, columns = whitened(run)
        return 0.7 * columns[:, 1], columns[:, [0, 2, 3]]

    prior = np.zeros(1), np.array([[1 / 0.3, 0.0, 0.0]])
    for made in ([], [1], [2, 2]):
        expected = [
            least_square([prior, *map(row, runs[:3]), *(row(runs[3 + k]) for k in (*made, one))]) for one in range(4)
        ]
        assert told.squares(made) == pytest.approx(expected)


def telling(*sigmas: float) -> Information:
    """Candidates that separate a rival without parameters by so many sigmas each."""
    count = len(sigmas)
    return Information(np.square(sigmas), np.zeros((count, 1)), np.zeros((count, 1, 1)), 0.0, np.zeros(1), np.eye(1))


OPTIONS = [CandidateRun(30.0, rpm, 0.0) for rpm in (30.0, 20.0, 10.0)]


@pytest.mark.parametrize(
    ("information", "chosen", "expected"),
    [
        ({"b": telling(0, 3, 4)}, A, NextRuns((OPTIONS[1], OPTIONS[2]), {"b": 5.0}, {})),  # that is enough
        ({"b": telling(0, 5.01, 4)}, A, NextRuns((OPTIONS[1],), {"b": 5.01}, {})),
        ({"b": telling(0, 4.99, 4)}, A, NextRuns((OPTIONS[1],) * 2, {"b": 4.99 * 2**0.5}, {})),
        ({"b": telling(6, 0, 0), "c": telling(0, 1, 0)}, A, NextRuns((OPTIONS[0],), {"b": 6.0}, {"c": 8**0.5})),
        ({"b": telling(6, 0, 0), "c": telling(0, 1, 0)}, NONE, NextRuns((OPTIONS[0],), {"b": 6.0}, {})),
        ({"c": telling(0, 1, 0)}, A, NextRuns((), {}, {"c": 8**0.5})),
        ({"c": telling(0, 1, 0)}, NONE, None),
        ({"b": telling(6, 0, 0), "c": telling(0, 7, 0)}, A,
         NextRuns((OPTIONS[0], OPTIONS[1]), {"b": 6.0, "c": 7.0}, {})),
    ],
)  # fmt: skip
def test_runs_are_added_until_each_rival_is_five_sigmas_away_that_eight_runs_can_exclude(
    information: dict[str, Information], chosen: frozenset[str], expected: NextRuns | None
) -> None:
    found = next_runs._until_separated(OPTIONS, {name: [one] for name, one in information.items()}, chosen)
    if expected is None or found is None:
        assert found == expected
        return
    assert found.runs == expected.runs
    assert found.sigmas == pytest.approx(expected.sigmas)
    assert found.inseparable == pytest.approx(expected.inseparable)


def test_a_separation_is_that_of_the_more_pessimistic_view() -> None:
    two = {"b": [telling(6, 0, 5.5), telling(0, 6, 5.2)]}
    found = next_runs._until_separated(OPTIONS, two, A)
    assert found is not None
    assert found.runs == (OPTIONS[2],)
    assert found.sigmas == pytest.approx({"b": 5.2})


def rivals(scores: dict[frozenset[str], float], chosen: frozenset[str], apart: Any = None) -> dict[str, float]:
    """Names of the rivals with their separations by the runs at hand."""
    ordered = sorted(scores, key=lambda ids: -scores[ids])
    table = Standing(tuple(ordered), np.array([scores[ids] for ids in ordered]))
    search: Any = SimpleNamespace(fits=dict.fromkeys([*scores, frozenset({"c"}), frozenset({"d"})]))
    found = next_runs._rivals(search, chosen, table, apart or {})
    return {name: rival.at_hand_sigmas for name, rival in found.items()}


def test_rivals_are_sets_of_a_fiftieth_of_the_probability_but_for_those_with_one_effect_more() -> None:
    assert rivals({A: 10.0, B: 8.5, AB: 12.0, NONE: 1.0}, A) == {"b": pytest.approx(3**0.5)}
    assert rivals({A: 10.0, NONE: 10.0 - np.log(48)}, A) == {"no effect": pytest.approx((2 * np.log(48)) ** 0.5)}
    assert rivals({A: 10.0, NONE: 10.0 - np.log(50)}, A) == {}
    assert rivals({NONE: 3.0, A: 4.0, B: 2.0}, NONE) == {"a": 0.0}  # without the odds, but likelier than none
    form = frozenset({"free:x", "a"})
    assert rivals({NONE: 3.0, A: 4.0, form: 6.0}, NONE) == {"a": 0.0}  # what has no name is told from nothing
    assert rivals({AB: 4.0, frozenset({"b", "a2"}): 4.0}, AB) == {"a2 + b": 0.0}


def test_rivals_are_also_the_three_effects_nearest_to_a_chosen_one_below_four_sigmas() -> None:
    scores = {A: 20.0, B: 1.0}
    apart = {"a": {"": 1.0, "b": 3.9, "c": 4.1, "never fitted": 0.1}}
    assert rivals(scores, A, apart) == {"b": 3.9}
    every = {"a": {"b": 3.0, "c": 2.0, "d": 1.0, "never fitted": 0.1}}
    assert rivals(scores, A, every) == {"d": 1.0, "c": 2.0}  # of the three nearest, those that were fitted
    assert rivals({A: 9.0, B: 9.0, NONE: 9.0, frozenset({"c"}): 8.0, frozenset({"d"}): 7.0}, A).keys() == {
        "b", "no effect", "c",
    }  # fmt: skip


@pytest.mark.parametrize("of_place", [False, True])
@pytest.mark.parametrize("starts", [False, True])
@pytest.mark.parametrize(("last", "pivots"), [((20.0, -20.0), False), ((-20.0, -20.0), True)])
def test_next_runs_are_sought_at_the_speeds_driven_and_where_effects_depend_on_it_at_other_places(
    *, of_place: bool, starts: bool, last: tuple[float, float], pivots: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    driven = [(10.0, 10.0), (20.0, 20.0), (30.0, 12.0), (40.0, 40.0), (50.0, -50.0), (0.0, 0.0), last]
    data = [run_data(*command) for command in driven]
    told: dict[str, Any] = {"places": [], "views": []}

    def commands(levels: list[float], *, pivots: bool) -> list[tuple[float, float]]:
        told.update(levels=levels, pivots=pivots)
        return [(10.0, 10.0), (30.0, 30.0)]

    def options_of(_robot: Any, command: Any, headings: Any, room: Room, places: Any) -> list[CandidateRun]:
        told.update(room=room, headings=headings)
        told["places"].append((command, places))
        return [CandidateRun(command[0], command[1], 45.0 * number) for number in range(len(places))]

    def view(kind: str) -> Any:
        def told_by(*given: Any) -> Information:
            told["views"].append(kind)
            problem = given[0] if kind == "rival" else given[2]
            return telling(
                *(6.0 if run.left_rpm == 30.0 and run.heading_deg in (0.0, 90.0) else 1.0 for run in problem)
            )

        return told_by

    monkeypatch.setattr(next_runs, "commands_at", commands)
    monkeypatch.setattr(next_runs, "placed", options_of)

    def hypothetical(*given: Any, from_poses: bool) -> Any:
        told.update(from_poses=from_poses)
        return given[3], given[4]

    monkeypatch.setattr(next_runs, "hypothetical", hypothetical)
    monkeypatch.setattr(next_runs, "from_rival", view("rival"))
    monkeypatch.setattr(next_runs, "from_chosen", view("chosen"))
    monkeypatch.setattr(
        next_runs, "depends_on_place", lambda _, terms: of_place and {t.id for t in terms} == {"a", "b"}
    )
    terms = {"a": effect("a"), "b": effect("b", starts=((0.0,),) if starts else ())}
    fits = {ids: SimpleNamespace(terms=ids, point=None) for ids in (A, B)}
    forward = SimpleNamespace(robots=(load_robot("barrel"),))
    problem = SimpleNamespace(data=data, forward=forward, noise=[None], open_ground=False)
    search: Any = SimpleNamespace(problem=problem, fits=fits, terms=terms)
    table = Standing((A, B), np.array([10.0, 9.0]))
    found = best_next_runs(search, A, table, {})
    assert not told["from_poses"]
    assert found is not None
    assert (told["levels"], told["pivots"]) == ([10.0, 30.0, 50.0], pivots)
    assert told["room"] == Room((0.0, 0.0), (0.0, 2.0))
    assert told["headings"] == (0, 45, 90, 135, 180, 225, 270, 315)
    assert told["places"][:2] == [((10.0, 10.0), (MIDDLE,)), ((30.0, 30.0), (MIDDLE,))]
    assert told["places"][2:] == ([((30.0, 30.0), (MIDDLE, *CORNERS))] if of_place else [])
    assert told["views"] == ["rival", *(["chosen"] if not starts else [])] * (2 if of_place else 1)
    assert found.runs == (CandidateRun(30.0, 30.0, 0.0),)
    assert found.sigmas == {"b": pytest.approx(6.0)}
    assert best_next_runs(search, A, Standing((A,), np.zeros(1)), {}) is None
    problem.open_ground = True
    assert best_next_runs(search, A, table, {}) == found
    assert told["from_poses"]
    assert told["headings"] == (0, 90, 180, 270)
    monkeypatch.setattr(next_runs, "placed", lambda *_: [])
    assert best_next_runs(search, A, table, {}) is None
