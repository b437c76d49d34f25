"""Values that change once within a session are found with their place; common ones and scatter are no change."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.diagnosis.assessment.knowledge import Knowledge, together
from evaluator.diagnosis.assessment.session_as_found import with_session
from evaluator.diagnosis.changes import stepped_values as module
from evaluator.diagnosis.changes.session_changes import DRIFT
from evaluator.diagnosis.changes.stepped_values import Step, step_of_values, with_step
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.inference.fitted_model import Fit, prior_precision
from evaluator.diagnosis.inference.watch import Watch
from evaluator.diagnosis.likelihood.known_to import Quantity, predicted_sigmas, quantities
from evaluator.diagnosis.likelihood.linear.mixed_model import Linearized, MixedModel, reduce_runs
from evaluator.diagnosis.likelihood.point import Column, Point
from evaluator.diagnosis.likelihood.run_data import PER_RUN, SHARED_UNIT, RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.report.diagnosis.knowledge import changed_sentence, preferred_sentence
from evaluator.settings import KnownTo
from evaluator.workflow import diagnose
from simulator.robot import load_robot
from tests.evaluator.diagnosis.hidden import COMMANDS, offer_few, write_hidden

ROBOT = load_robot("barrel")
LEVEL, SCALE, MASS = Column("plate_level_x_deg"), Column("plane_scale"), Column("body.mass_g")
COLUMNS = (LEVEL, SCALE, MASS)
TOLERANCE = {LEVEL.key: 0.3, SCALE.key: 0.3, MASS.key: 0.3}
KNOWN = tuple(Quantity(key, key, "1", TOLERANCE[key], 1.0) for key in (LEVEL.key, SCALE.key, MASS.key))
FEATURES = 60


def fitted(values: list[float], column: int = 0, order: list[int] | None = None) -> tuple[Any, Fit, Any]:
    """A search, its exact fit and the session, of runs with noise of 1: of a column, a value of 1 adds ten sigmas."""
    rng = np.random.default_rng(3)
    linear = []
    for value in values:
        common = rng.normal(size=(FEATURES, 3)) * [10.0, 10.0, 10.0] / np.sqrt(FEATURES)
        own = rng.normal(size=(FEATURES, 7)) / np.sqrt(FEATURES)
        response = rng.normal(size=FEATURES) + common[:, column] * value
        linear.append(Linearized(response, common, own[:, :3], own[:, 3:]))
    reduced = reduce_runs(linear)
    posterior = MixedModel(reduced, prior_precision(COLUMNS, TOLERANCE)).posterior(range(3))
    nominal = dict(zip(TOLERANCE, posterior.mean.tolist(), strict=True))
    runs = tuple(range(len(values)))
    point = Point(np.zeros((len(runs), PER_RUN)), nominal, {})
    fit = Fit(frozenset(), point, COLUMNS, posterior, reduced, tuple(linear), converged=True, runs=runs)
    data = tuple(SimpleNamespace(id=f"r{run}", order=place) for run, place in zip(runs, order or runs, strict=True))
    session = SimpleNamespace(data=data, known=KNOWN, robots=(ROBOT,))
    return SimpleNamespace(tolerance=TOLERANCE), fit, session


@pytest.mark.parametrize("begin", [3, 4, 7])
def test_a_value_that_changes_once_is_found_with_the_runs_after_it(begin: int) -> None:
    step = step_of_values(*fitted([0.0] * begin + [1.5] * (10 - begin)))
    assert step is not None
    assert [item.key for item in step.quantities] == [LEVEL.key]
    assert step.runs == tuple(range(begin, 10))


def test_runs_before_and_after_are_so_in_the_order_of_the_session() -> None:
    order = [9, 0, 8, 1, 7, 2, 6, 3, 5, 4]
    step = step_of_values(*fitted([1.5 * (place >= 6) for place in order], order=order))
    assert step is not None
    assert step.runs == (0, 2, 4, 6)


@pytest.mark.parametrize(
    "values",
    [
        [0.0] * 10,
        [1.5] * 10,  # off, and common
        [0.0, 0.1, -0.1, 0.05, -0.05, 0.1, -0.1, 0.0, 0.1, -0.1],
        [0.0] * 5 + [0.3] * 5,  # within the noise of ten runs
        [0.0] * 9 + [1.5],  # a single run
        [0.0] * 8 + [1.5] * 2,  # two
        [1.5] * 2 + [0.0] * 8,
    ],
)
def test_values_of_all_runs_and_of_one_or_two_are_no_change(values: list[float]) -> None:
    assert step_of_values(*fitted(values)) is None


def test_too_few_runs_have_no_parts() -> None:
    assert step_of_values(*fitted([0.0] * 2 + [1.5] * 3)) is None
    assert step_of_values(*fitted([0.0] * 3 + [1.5] * 3)) is not None


def test_only_what_is_set_up_anew_changes() -> None:
    """A mass does not change by itself; that of another robot is another matter."""
    assert step_of_values(*fitted([0.0] * 5 + [1.5] * 5, column=2)) is None
    step = step_of_values(*fitted([0.0] * 5 + [1.5] * 5, column=1))
    assert step is not None
    assert [item.key for item in step.quantities] == [SCALE.key]


def test_the_odds_of_a_change_are_those_of_one_more_value_of_the_later_runs_at_any_place_and_of_any_kind() -> None:
    search, fit, session = fitted([0.0] * 5 + [1.5] * 5)
    step = step_of_values(search, fit, session)
    more = [
        replace(view, common=np.column_stack([view.common, view.common[:, 0] * (number > 4)]))
        for number, view in enumerate(fit.linearized)
    ]
    known = prior_precision(COLUMNS, TOLERANCE)
    prior = np.append(known, known[0] / 2)  # a difference of two values, each known to 0.3
    evidence = [
        MixedModel(reduce_runs(views), part).log_evidence(range(len(part)))
        for views, part in ((more, prior), (fit.linearized, known))
    ]
    places, kinds = 5, 2
    assert step is not None
    assert step.odds == pytest.approx(evidence[0] - evidence[1] + np.log(0.05 / (places * kinds)))


@pytest.mark.parametrize(
    ("found", "again", "moved", "ends"),
    [
        (None, "fit", None, None),
        ("first", FloatingPointError, None, "first"),  # a run that cannot be simulated on the way
        ("first", None, None, "first"),  # a misfit too large for a fit of whole runs
        ("first", "fit", None, "first"),
        ("first", "fit", "second", "second"),
    ],
)
def test_the_place_of_a_change_is_found_again_at_the_noise_with_it(
    found: str | None, again: Any, moved: str | None, ends: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = iter([found, moved])
    asked: list[tuple[Any, ...]] = []

    def step_of(*given: Any) -> Any:
        asked.append(given)
        name = next(steps)
        return name and SimpleNamespace(name=name, quantities=("level",))

    def null(ready: Any) -> Any:
        assert ready == ("prepared", "session with first")
        if again is FloatingPointError:
            raise FloatingPointError
        return "part", again

    monkeypatch.setattr(module, "step_of_values", step_of)
    monkeypatch.setattr(module, "with_step", lambda session, step, *_: f"{session} with {step.name}")
    monkeypatch.setattr(module, "prepared", lambda session, *_: ("prepared", session))
    monkeypatch.setattr(module, "null_alone", null)
    monkeypatch.setattr(module, "_without_change", lambda fit, step: (fit, step.name))
    search: Any = SimpleNamespace(problem="problem")
    fit: Any = SimpleNamespace(terms=frozenset())
    got = module.with_changed_values(search, fit, "session", Watch())  # type: ignore[arg-type]
    assert got == (None if ends is None else f"session with {ends}")
    assert asked[1:] in ([], [("part", ("fit", "first"), "session", (("level",),))])


@pytest.mark.parametrize(
    ("terms", "fitted_without", "odds", "taken"),
    [
        ({DRIFT}, True, 12.1, True),
        ({DRIFT}, True, 12.0, False),  # as much as the drift gains
        ({DRIFT}, True, None, False),
        ({DRIFT}, False, 12.1, False),
        ({DRIFT, "plate-tilt"}, True, 12.1, True),
        ({"plate-tilt"}, True, 12.1, False),
    ],
)
def test_a_change_stands_for_a_drift_that_explains_less(
    terms: set[str], fitted_without: bool, odds: float | None, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a scale 0.08 % larger from the ninth run on, the speed seemed to drift, and the verdict was "unknown"."""
    without = frozenset(terms - {DRIFT})
    scores = {frozenset(terms): -88.0, without: -100.0}
    fits = {without: "without"} if fitted_without else {}
    search: Any = SimpleNamespace(fits=fits, score=scores.__getitem__, problem="problem")
    fit: Any = SimpleNamespace(terms=frozenset(terms))

    def step_of(_search: Any, asked: Any, _session: Any) -> Any:
        return SimpleNamespace(odds=odds) if asked == "without" and odds is not None else None

    monkeypatch.setattr(module, "step_of_values", step_of)
    monkeypatch.setattr(module, "with_step", lambda *_: "changed")
    monkeypatch.setattr(module, "prepared", lambda *_: "prepared")
    monkeypatch.setattr(module, "null_alone", lambda _: ("part", None))
    got: Any = module.with_changed_values(search, fit, "session", Watch())  # type: ignore[arg-type]
    assert got == ("changed" if taken else None)


def test_a_value_that_is_free_to_change_already_changes_once_only() -> None:
    search, fit, session = fitted([0.0] * 5 + [1.5] * 5)
    session.known = (*KNOWN, Quantity(f"{LEVEL.key}_later", "", "1", 0.4, 1.0, "r5"))
    assert step_of_values(search, fit, session) is None


def test_only_kinds_that_are_asked_for_are_found() -> None:
    asked = fitted([0.0] * 5 + [1.5] * 5)
    assert step_of_values(*asked, [(KNOWN[1],)]) is None
    step = step_of_values(*asked, [(KNOWN[0],)])
    assert step is not None
    assert step.runs == (5, 6, 7, 8, 9)


TIME = np.arange(240) / 60
RUNS = tuple(
    RunData(f"r{number}", 33.3, 14.4, 0.5, None, TIME, np.zeros((len(TIME), 4)), number) for number in range(2)
)
OF_SESSION = quantities(KnownTo(), ROBOT, RUNS)
START = (3.0, -2.0, 0.7, 0.0, 0.0, 0.0, 0.0)
POINT = Point(np.array([START, START]), {"green_x_mm": 0.01})


@pytest.fixture(scope="module")
def changed() -> Any:
    """A session of two runs with marks that changed before the second."""
    forward = Simulated([ROBOT, ROBOT], RUNS, {}, predicted_sigmas(OF_SESSION))
    marks = tuple(item for item in OF_SESSION if item.key.startswith(("green", "yellow")))
    session: Any = Session(RUNS, (ROBOT, ROBOT), {}, OF_SESSION)
    problem: Any = SimpleNamespace(forward=forward)
    fit: Any = SimpleNamespace(point=POINT)
    return with_step(session, Step(marks, (1,), 20.0), problem, fit)


def test_a_change_moves_marks_of_the_later_runs_alone_as_the_value_itself_does(changed: Any) -> None:
    before = Simulated([ROBOT, ROBOT], RUNS, {}, predicted_sigmas(OF_SESSION))
    after = Simulated([ROBOT, ROBOT], changed.data, {}, predicted_sigmas(changed.known))
    assert [item.key for item in changed.known[len(OF_SESSION) :]] == [
        *("green_x_mm_later", "green_y_mm_later", "yellow_x_mm_later", "yellow_y_mm_later")
    ]
    for change in changed.known[len(OF_SESSION) :]:
        item = next(item for item in OF_SESSION if change.key == f"{item.key}_later")
        assert change.since == "r1"
        assert change.sigma == pytest.approx(2**0.5 * item.sigma)
        assert change.tolerance == pytest.approx(SHARED_UNIT)
        amount_mm = 0.03
        base = {**POINT.nominal, item.key: POINT.nominal.get(item.key, 0.0) + amount_mm / item.per_unit}
        (by_value,) = before.marks([Task(1, START, base)])
        stays, moves = after.marks(
            [Task(run, START, {**POINT.nominal, change.key: amount_mm / change.per_unit}) for run in (0, 1)]
        )
        (unmoved,) = before.marks([Task(0, START, POINT.nominal)])
        assert np.abs(stays - unmoved).max() < 1e-12
        assert np.abs(moves - by_value).max() < 1e-9
        robots = [
            with_session(ROBOT, run, changed.known, replace(POINT, nominal={change.key: amount_mm / change.per_unit}))
            for run in changed.data
        ]
        assert robots[0] == ROBOT
        assert [entry.id for entry in robots[1].effect] == ["mark-offset"]


def test_a_change_is_told_as_that_and_not_as_a_value_off_its_tolerance(changed: Any) -> None:
    change = next(item for item in changed.known if item.key == "green_x_mm_later")
    assert not Knowledge(change, 9 * change.sigma, 0.0, 0.0).is_finding
    item: dict[str, Any] = {"quantity": change.key, "name": change.name, "unit": "mm", "taken": change.sigma}
    item |= {"found": 0.1, "low": 0.09, "high": 0.11, "from_run": change.since}
    zero = item | {
        "quantity": "green_y_mm_later",
        "name": "change of green mark along y of the robot, from r1 on",
        "low": -0.1,
    }
    content = {"known_to": [item, zero]}
    sentence = changed_sentence(content)
    assert sentence.startswith("These values changed within the session, from r1 on,")
    assert "green mark along x of the robot by 0.100 mm [0.090, 0.110]." in sentence
    assert "along y" not in sentence
    assert preferred_sentence(content) == ""
    assert changed_sentence({"known_to": [{**item, "from_run": None}]}) == ""
    assert changed_sentence({"known_to": [zero]}) == ""


def test_a_change_is_no_evidence_against_the_tolerances() -> None:
    _, fit, _ = fitted([1.5] * 10)
    columns = tuple(replace(column, key="plate_level_x_deg_later") if column == LEVEL else column for column in COLUMNS)
    point = replace(fit.point, nominal={**fit.point.nominal, "plate_level_x_deg_later": fit.point.nominal[LEVEL.key]})
    later = replace(fit, columns=columns, point=point)
    tolerance = TOLERANCE | {"plate_level_x_deg_later": 0.3}
    assert together(fit, TOLERANCE).is_finding
    assert not together(later, tolerance).is_finding


def test_marks_glued_on_anew_within_a_session_are_fitted_apart_and_hide_no_effect(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    offer_few(monkeypatch, ("drive-speed-mismatch", "rolling-drag", "plate-tilt"), ())
    file = write_hidden(
        tmp_path / "session", {"drive-speed-mismatch": {"left_over_right": 0.96}}, seconds=4.0, exact=True
    )
    robot = file.with_name("robot.toml")
    text = robot.read_text(encoding="utf-8")
    robot.write_text(text.replace("mark_position_mm = 0.0", "mark_position_mm = 0.05"), encoding="utf-8")
    moved_mm = np.array([0.1, -0.07])
    for number in range(4, len(COMMANDS)):
        move_marks(file.parent / f"r{number}.csv", moved_mm)
    diagnose(file, tmp_path / "found")
    found = json.loads((tmp_path / "found" / "diagnosis.json").read_text(encoding="utf-8"))
    changes = {item["quantity"]: item for item in found["known_to"] if "from_run" in item}
    assert {item["from_run"] for item in changes.values()} == {"r4"}
    for mark in ("green", "yellow"):
        for axis, true in zip("xy", moved_mm, strict=True):
            change = changes[f"{mark}_{axis}_mm_later"]
            assert change["low"] < true < change["high"]
    assert [effect["id"] for effect in found["effects"]] == ["drive-speed-mismatch"]
    assert found["gap"]["after"]["held_out"] < 2 * found["gap"]["noise_floor"]


def move_marks(file: Path, by_mm: np.ndarray) -> None:
    """Move both marks of a run on the robot, x along it."""
    table = pd.read_csv(file)
    across = table[["green_x_mm", "green_y_mm"]].to_numpy() - table[["yellow_x_mm", "yellow_y_mm"]].to_numpy()
    left = across / np.hypot(*across.T)[:, None]
    ahead = np.column_stack([left[:, 1], -left[:, 0]])
    for mark in ("green", "yellow"):
        table[[f"{mark}_x_mm", f"{mark}_y_mm"]] += by_mm[0] * ahead + by_mm[1] * left
    table.to_csv(file, index=False)
