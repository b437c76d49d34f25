"""Runs whose motion diverges are found by their second differences."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis import diverging_runs
from evaluator.diagnosis.likelihood.known_to import START as START_COMMON
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.run_data import Task
from simulator.effects.coordinates import Candidate, Coordinate

DRIFT = Candidate("drift", (Coordinate("size", 0.0, 1.0, -10.0, 2.5),), lambda values: {"size": values[0]})
EFFECT = Column("drift", 0, DRIFT)
MASS = "body.mass_g"
COLUMN = Column(MASS)
START = np.eye(5)[:, :3]


def driving(rpm: float) -> Any:
    """A run at a constant command of its own; runs at 1 and 2 rpm are not alike."""
    stretch = SimpleNamespace(left_rpm=rpm + 1.0, right_rpm=-rpm - 1.0)
    command = SimpleNamespace(driven=[stretch], stages=[stretch])
    return SimpleNamespace(left_rpm=rpm + 1.0, right_rpm=-rpm - 1.0, run_command=command)


def search_of(slopes: list[float], bends: list[float], **changes: Any) -> Any:
    """A search whose best fit is at a mass of 2; a step of it changes the features of a run by slope and bends.

    They bend with the drift, too, which is an effect, and with the start, before which nothing is seen.
    """

    def features(tasks: list[Task]) -> list[np.ndarray]:
        steps = [(task.nominal[MASS] - 2.0) / COLUMN.step for task in tasks]
        drifts = [(task.terms["drift"][0] - 1.0) / EFFECT.step for task in tasks]
        return [
            slopes[task.run] * step * np.eye(5)[3]
            + bends[task.run] * step**2 / 2 * np.eye(5)[4]
            + 9 * step**2 * START[:, 0]
            + 0.3 * np.eye(5)[4]  # noise, which is no change
            + 99 * (drift**2 + task.nominal.get(START_COMMON, 0.0) ** 2) * np.eye(5)[4]
            for task, step, drift in zip(tasks, steps, drifts, strict=True)
        ]

    runs = len(slopes)
    view = Linearized(np.zeros(5), np.zeros((5, 0)), START, np.zeros((5, 4)))
    problem = SimpleNamespace(
        open_ground=changes.get("open_ground", False),
        data=[driving(rpm) for rpm in changes.get("rpm", range(runs))],
        features=features,
        attempted=lambda _, __, chosen: [changes.get("view", view)] * len(chosen),
    )
    others = np.ones(runs - 1)
    best = SimpleNamespace(
        runs=range(runs),
        misfits=(np.array([*others, changes.get("misfit", 1.0)]) * 3.0, np.full(runs, 3.0)),
        converged=changes.get("converged", True),
        excess=changes.get("excess", 1.0),
        point=Point(np.zeros((runs, 7)), {MASS: 2.0}, {"drift": (1.0,)}),
        columns=(COLUMN, EFFECT, Column(START_COMMON)),
    )
    fits = {frozenset({"drift"}): best}
    return SimpleNamespace(
        problem=problem,
        fits=fits,
        failed={},
        ranked=lambda: [frozenset({"drift"})],
        initial=lambda most: [best, *changes.get("rivals", ())][:most],
        explained=changes.get("explained", -np.inf),
    )


@pytest.fixture(autouse=True)
def any_runs_suffice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diverging_runs, "shortcomings", lambda data: [] if len(data) > 1 else ["too few"])


def test_a_run_diverges_whose_slope_changes_by_half_of_itself_within_a_step() -> None:
    """What a start pose makes does not count, nor does a fifth of a sigma."""
    found = search_of([1.0, 1.0, 0.3, 0.3], [0.49, 0.51, 0.19, 0.21])
    assert diverging_runs.diverging_runs(found) == [1, 3]


@pytest.mark.parametrize(
    "changes",
    [
        {"open_ground": True},
        {"open_ground": True, "misfit": 9.0},
        {"converged": False},
        {"excess": 1.6},
        {"view": None},
        {"slopes": [1.0, 1.0]},
    ],
)
def test_none_diverges_that_does_not_stand_out_where_no_model_explains_or_where_too_few_are_left(changes: Any) -> None:
    slopes = changes.pop("slopes", [1.0] * 3)
    assert diverging_runs.diverging_runs(search_of(slopes, [9.0, 0.0, 0.0], **changes)) == []


def seeds_of(search: Any, *kinds: dict[str, Any]) -> list[Any]:
    """Fits of the first seconds at the point of the best fit, converged and explaining but for these changes."""
    (best,) = search.fits.values()
    return [SimpleNamespace(**(vars(best) | {"converged": True, "excess": 1.0} | kind)) for kind in kinds]


def test_a_run_that_diverges_after_the_first_seconds_is_found_at_any_fit_that_explains_these() -> None:
    search = search_of([1.0] * 3, [0.0, 9.0, 0.0])
    elsewhere = Point(np.zeros((3, 7)), {MASS: np.nan}, {"drift": (1.0,)})  # from where the runs cannot be simulated
    assert diverging_runs.diverging_beyond(search, seeds_of(search, {"point": elsewhere}, {})) == [1]
    for kinds in ([], [{"converged": False}], [{"excess": 1.6}], [{"point": elsewhere}]):
        assert diverging_runs.diverging_beyond(search, seeds_of(search, *kinds)) == []
    for other in (
        search_of([1.0] * 3, [9.0, 9.0, 0.0]),  # more than half
        search_of([1.0] * 2, [9.0, 0.0]),  # too few are left
        search_of([1.0] * 3, [0.0, 9.0, 0.0], open_ground=True),
    ):
        assert diverging_runs.diverging_beyond(other, seeds_of(other, {})) == []


@pytest.mark.parametrize(
    ("bends", "misfit", "found"),
    [([0.0, 9.0], 11.0, [3]), ([9.0, 9.0], 11.0, [3]), ([0.0, 9.0], 9.0, []), ([9.0, 0.0], 11.0, [])],
)
def test_where_no_model_explains_the_runs_one_diverges_that_obstructs_them(
    bends: list[float], misfit: float, found: list[int]
) -> None:
    """Of four runs the last misses ten times the median of all; a robot was captured there, but not in the model."""
    for changes in ({"excess": 9.0}, {"open_ground": True}):  # there every model explains, as the noise is estimated
        search = search_of([1.0] * 4, [0.0, 0.0, *bends], misfit=misfit, **changes)
        assert diverging_runs.diverging_runs(search) == found


def test_a_run_of_many_frames_stands_out_by_its_misfit_in_each() -> None:
    search = search_of([1.0] * 4, [0.0, 0.0, 0.0, 9.0], misfit=11.0, excess=9.0)
    squares, freedom = search.fits[frozenset({"drift"})].misfits
    squares[3], freedom[3] = 2 * squares[3], 2 * freedom[3]
    assert diverging_runs.diverging_runs(search) == [3]
    freedom[3] *= 2
    assert diverging_runs.diverging_runs(search) == []


def test_more_runs_than_go_wrong_by_themselves_do_not_diverge_from_a_model_that_explains_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search = search_of([1.0] * 5, [0.0, 0.0, 0.0, 9.0, 9.0], converged=False, misfit=11.0)
    search.fits[frozenset({"drift"})].misfits[0][3] = 33.0
    assert diverging_runs.diverging_runs(search) == []
    monkeypatch.setattr(diverging_runs, "most_odd", lambda count: count - 3)
    assert diverging_runs.diverging_runs(search) == [3, 4]


def at_mass(size: float, fit: Any) -> Any:
    """The fit at another mass, which did not converge."""
    return SimpleNamespace(point=replace(fit.point, nominal={MASS: size}), columns=fit.columns)


def test_where_no_model_explains_the_runs_those_that_diverge_at_one_of_the_best_fits_are_suspected() -> None:
    assert diverging_runs.suspected_runs(search_of([1.0] * 4, [0.0, 9.0, 0.0, 0.0], converged=False)) == [1]
    assert diverging_runs.suspected_runs(search_of([1.0] * 4, [0.0] * 4, converged=False)) == []


def test_runs_of_the_command_of_one_that_diverges_are_suspected_with_it() -> None:
    assert diverging_runs.suspected_runs(search_of([1.0] * 4, [9.0, 0.0, 0.0, 0.0], rpm=[3, 9, 3, 30])) == [0, 2]


def test_a_run_may_diverge_at_a_rival_alone_or_at_the_friction_that_all_runs_share(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    search = search_of([1.0] * 6, [0.0] * 6)
    best = search.initial(1)[0]
    scattered = np.zeros((6, 7))
    scattered[:, 3:] = 0.1
    best.point = replace(best.point, per_run=scattered)
    search.initial = lambda most: [best, *(at_mass(size, best) for size in (3.0, 4.0, 5.0))][:most]
    met = {(2.0, True): [0], (2.0, False): [1], (3.0, True): [2], (5.0, True): [4]}  # the fourth fit is not tried
    monkeypatch.setattr(
        diverging_runs,
        "_diverging_at",
        lambda _, point, *__: met.get((point.nominal[MASS], bool(point.per_run.any())), []),
    )
    assert diverging_runs.suspected_runs(search) == [0, 1, 2]


@pytest.mark.parametrize(
    ("changes", "bends"),
    [({"open_ground": True}, [9.0, 0.0, 0.0]), ({"explained": -3.0}, [9.0, 0.0, 0.0]), ({}, [9.0, 9.0, 0.0])],
)
def test_none_is_suspected_on_open_ground_or_beside_a_model_that_explains_or_if_that_were_most_runs(
    changes: Any, bends: list[float]
) -> None:
    assert diverging_runs.suspected_runs(search_of([1.0] * 3, bends, **changes)) == []


def test_none_is_suspected_without_which_too_few_runs_are_left() -> None:
    assert diverging_runs.suspected_runs(search_of([1.0] * 2, [9.0, 0.0])) == []


def jumping(
    monkeypatch: pytest.MonkeyPatch, turns_at: list[float], *, obstructing: tuple[int, ...] = (0, 1), size: float = 9.0
) -> list[int]:
    """Runs found to jump between masses of 2 and 4: each changes its motion by size, half evenly and half at one mass.

    turns_at: that mass of each run; not a number for a run that changes evenly altogether.
    """
    runs = len(turns_at)

    def features(tasks: list[Task]) -> list[np.ndarray]:
        shares = [(task.nominal[MASS] - 2.0) / 2.0 for task in tasks]
        at = [turns_at[task.run] for task in tasks]
        parts = [
            share if np.isnan(mass) else 0.4 * share + 0.6 * (task.nominal[MASS] > mass)
            for task, share, mass in zip(tasks, shares, at, strict=True)
        ]
        return [size * part * np.eye(5)[4] + 99 * part * START[:, 0] for part in parts]

    search = search_of([1.0] * runs, [0.0] * runs, open_ground=True)
    search.problem.features = features
    search.terms, search.tolerance = {"drift": DRIFT}, {"known": 1.0}
    (best,) = search.fits.values()
    best.terms, best.columns = frozenset({"drift"}), (COLUMN, EFFECT)
    best.linearized = [Linearized(np.zeros(5), np.zeros((5, 0)), START, np.zeros((5, 4)))] * runs
    there = replace(best.point, nominal={MASS: 4.0})

    def led(problem: Any, fit: Any, terms: Any, tolerance: Any) -> Any:
        assert (problem, fit, list(terms), tolerance) == (search.problem, best, [DRIFT], {"known": 1.0})
        return (obstructing, there) if obstructing else None

    monkeypatch.setattr(diverging_runs, "way_of_the_others", led)
    return diverging_runs.jumping_runs(search)


@pytest.mark.parametrize("mass", [2.001, 2.6, 3.3, 3.999])
def test_a_run_that_keeps_a_fit_from_the_way_of_the_others_jumps_if_it_takes_another_turn_on_it(
    monkeypatch: pytest.MonkeyPatch, mass: float
) -> None:
    """Wherever that is on the way; a run that bends evenly does not, nor one that does not obstruct the fit."""
    assert jumping(monkeypatch, [mass, np.nan, mass, mass, np.nan]) == [0]
    assert jumping(monkeypatch, [np.nan, mass, mass, mass, np.nan]) == [1]


@pytest.mark.parametrize(("named", "found"), [("drift", [0]), ("free:drift.one", [])])
def test_runs_jump_also_at_the_best_fit_of_named_effects_behind_free_form_terms(
    named: str, found: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Free-form terms bend with a turn that the model does not take, and lead beside such a run."""
    search = search_of([1.0] * 4, [0.0] * 4, open_ground=True)
    (best,) = search.fits.values()
    best.terms = frozenset({named})
    forms = [SimpleNamespace(terms=frozenset({f"free:{number}.one"})) for number in range(3)]
    search.initial = lambda most: [*forms, best][:most]
    search.fits = dict.fromkeys(range(4))
    search.terms, search.tolerance = dict.fromkeys([*(f"free:{k}.one" for k in range(3)), named], DRIFT), {}
    led = lambda _, fit, *__: ((0,), best.point) if fit is best else None  # noqa: E731
    monkeypatch.setattr(diverging_runs, "way_of_the_others", led)
    monkeypatch.setattr(diverging_runs, "_jumps", lambda *_: True)
    assert diverging_runs.jumping_runs(search) == found


def test_no_run_jumps_by_less_than_it_tells_or_with_most_others_or_where_none_obstructs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert jumping(monkeypatch, [2.6, np.nan, np.nan], size=0.1) == []
    assert jumping(monkeypatch, [2.6, 2.6, np.nan, np.nan]) == [0, 1]
    assert jumping(monkeypatch, [2.6, 2.6, np.nan]) == []
    assert jumping(monkeypatch, [2.6, np.nan, np.nan], obstructing=()) == []
    assert jumping(monkeypatch, [2.6, np.nan], obstructing=(0,)) == []  # a single run is left
