"""diagnosis.json as a whole: each key holds what it is named after, and what was not fitted has no keys."""

from __future__ import annotations

import tomllib
from math import inf, nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from evaluator.diagnosis.assessment.model_comparison import Standing
from evaluator.diagnosis.assessment.relevance import Changes
from evaluator.diagnosis.assessment.residuals.disagreeing_runs import RunDisagreement
from evaluator.diagnosis.candidates.free_form import free_terms
from evaluator.diagnosis.inference.limits import Limit
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.output import alternatives_json, diagnosis_json, effect_tables, effects_json
from evaluator.diagnosis.output.own_effect import own_effects
from evaluator.diagnosis.output.robot_with_effect import robot_with_effect
from simulator.effects.catalogue import BUILT_IN, EFFECTS
from simulator.effects.coordinates import Candidate
from simulator.robot import load_robot
from tests.evaluator.diagnosis.synthetic import run_data


def diagnosis(**more: Any) -> Any:
    """A diagnosis of two runs, of which one was skipped."""
    mistake = SimpleNamespace(runs=("r1",), kind="reversed", equivalent_kinds=("mirrored",), sentence="r1: backward")
    session = SimpleNamespace(
        mistakes=(mistake,), skipped={"r7": "dark"}, left_out={"r8": "alone"}, explained=(), own=(), one_frame=True,
        commands_recur=True, known=("known",), data=[run_data(20.0, 30.0, k) for k in (1, 2)],
    )  # fmt: skip
    return SimpleNamespace(
        **{"verdict": "none", "reason": "so", "session": session, "search": None, "stopped": False, **more}
    )


def test_without_a_fit_there_are_the_mistakes_and_empty_lists() -> None:
    found: Any = diagnosis_json.record(diagnosis())
    assert found["mistakes"] == [
        {"runs": ["r1"], "kind": "reversed", "equivalent_kinds": ["mirrored"], "sentence": "r1: backward"}
    ]
    assert (found["skipped_runs"], found["left_out_runs"]) == ({"r7": "dark"}, {"r8": "alone"})
    assert (found["verdict"], found["reason"], found["gap"], found["next_experiment"]) == ("none", "so", None, None)
    assert {name for name, value in found.items() if value == []} == {
        *("effects", "negligible", "known_to", "where", "disagrees", "rivals"),
    }
    assert "noise" not in found


@pytest.fixture
def parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts with tests of their own, each by its name."""
    plain = ("effects", "rivals", "next_experiment", "unlike")
    for name in (*plain, "_gap", "_noise", "_nominal", "_shared", "_exact_frictions"):
        monkeypatch.setattr(diagnosis_json, name, lambda _, name=name: name)
    monkeypatch.setattr(diagnosis_json, "_far_nominal", lambda _: ["friction off"])
    monkeypatch.setattr(diagnosis_json, "_where", lambda _, apart: ["where", len(apart)])
    monkeypatch.setattr(diagnosis_json, "effect_content", lambda _, effect: {"id": effect, "parameters": {"x": 1}})
    apart = [RunDisagreement("r2", "start", "yaw_rate", 1.23456789, 4.5)]
    monkeypatch.setattr(diagnosis_json, "disagreeing_runs", lambda _: apart)
    monkeypatch.setattr(diagnosis_json, "disagreement", lambda _: pd.DataFrame({"run": ["r1"]}))


@pytest.mark.usefixtures("parts")
def test_every_key_of_a_fitted_diagnosis_holds_what_it_is_named_after() -> None:
    def known(key: str, found: float, *, finding: bool = False, equivalent: tuple[str, ...] = ()) -> Any:
        quantity = SimpleNamespace(key=key, name=f"the {key}", unit="mm", sigma=0.5, since="")
        return SimpleNamespace(
            quantity=quantity,
            found=found,
            low=found - 1,
            high=inf,
            equivalent=equivalent,
            is_finding=finding,
            sentence=f"{key} off",
        )

    together = SimpleNamespace(
        square=12.5, freedom=3, probability=0.001, is_finding=True, sentence=lambda of: f"off: {of}"
    )
    halves = SimpleNamespace(halves="slow and fast", probability=nan)
    found: Any = diagnosis_json.record(
        diagnosis(
            search="searched", negligible=frozenset({"b", "a"}), changes={"a": Changes(1, 2, 3), "b": Changes(4, 5, 6)},
            known=(known("track", 1.5, finding=True), known("mass", 2.5, equivalent=("a",))),
            known_together=together, constancy=(halves,), outlying=(1,), limits=(Limit("c", "size", None, 0.12345678),),
        )
    )  # fmt: skip
    whole = {"effects": "effects", "gap": "_gap", "rivals": "rivals", "next_experiment": "next_experiment"}
    whole |= {"unlike_runs": "unlike", "noise": "_noise", "nominal": "_nominal", "shared_errors_sigmas": "_shared"}
    whole |= {"exact_frictions": "_exact_frictions"}
    assert {name: found[name] for name in whole} == whole
    assert found["where"] == ["where", 1]
    assert found["negligible"] == [
        {"id": "a", "parameters": {"x": 1}, "changes": diagnosis_json._changes(Changes(1, 2, 3))},
        {"id": "b", "parameters": {"x": 1}, "changes": diagnosis_json._changes(Changes(4, 5, 6))},
    ]
    first, second = found["known_to"]
    assert first == {
        "quantity": "track", "name": "the track", "unit": "mm", "taken": 0.5, "found": 1.5, "low": 0.5, "high": None,
        "equivalent": [],
    }  # fmt: skip
    assert (second["quantity"], second["equivalent"], found["findings"]) == (
        "mass",
        ["a"],
        ["track off", "friction off"],
    )
    assert found["known_together"] == {
        "square": 12.5, "freedom": 3, "probability": 0.001, "sentence": "off: ('known',)",
    }  # fmt: skip
    assert found["disagrees"] == [
        {"run": "r2", "phase": "start", "quantity": "yaw_rate", "size": 1.23457, "sigmas": 4.5}
    ]
    assert found["not_driven"] == ["right turns", "backward motion"]
    assert found["limits"] == [{"id": "c", "parameter": "size", "low": None, "high": 0.123457}]
    assert (found["constancy"], found["runs_not_followed"]) == ({"slow and fast": None}, ["r2"])
    together.is_finding = False
    usual: Any = diagnosis_json._together(SimpleNamespace(known_together=together, session=None))  # type: ignore[arg-type]
    assert usual["sentence"] is None
    assert diagnosis_json._together(SimpleNamespace(known_together=None)) is None  # type: ignore[arg-type]


@pytest.mark.usefixtures("parts")
@pytest.mark.parametrize("table", [None, pd.DataFrame()])
def test_without_pieces_of_runs_none_disagrees(monkeypatch: pytest.MonkeyPatch, table: pd.DataFrame | None) -> None:
    monkeypatch.setattr(diagnosis_json, "disagreement", lambda _: table)
    monkeypatch.setattr(diagnosis_json, "_together", lambda _: None)
    found: Any = diagnosis_json.record(
        diagnosis(search="searched", negligible=frozenset(), known=(), constancy=(), outlying=(), limits=())
    )
    assert (found["where"], found["disagrees"]) == (["where", 0], [])


@pytest.mark.parametrize("absent", ["pieces", "pieces_after"])
def test_pieces_of_one_model_alone_make_no_table(absent: str) -> None:
    pieces = pd.DataFrame({"run": ["r1"], **dict.fromkeys(diagnosis_json.QUANTITIES, 1.0)})
    found = diagnosis(**{"pieces": pieces, "pieces_after": pieces, absent: None})
    assert diagnosis_json.disagreement(found) is None


@pytest.mark.parametrize(("one_frame", "recur"), [(True, True), (False, True), (True, False), (False, False)])
def test_effects_that_runs_cannot_show_are_those_of_the_plate_without_a_frame_and_by_run_without_repetitions(
    one_frame: bool, recur: bool
) -> None:
    session: Any = SimpleNamespace(own=(), one_frame=one_frame, commands_recur=recur)
    of_plate = {name for name in BUILT_IN if EFFECTS[name].of_plate}
    by_run = {name for name in BUILT_IN if EFFECTS[name].varies_by_run}
    assert of_plate
    assert by_run
    assert diagnosis_json._not_tried(session) == sorted(
        (set() if one_frame else of_plate) | (set() if recur else by_run)
    )


@pytest.mark.parametrize(
    ("ground", "chosen", "stated", "said"),
    [
        (True, {"speed-limit"}, (), ["longitudinal", "lateral"]),
        (True, {"free:left_drive.right_command", "scrub-torque"}, ("slip.lateral_friction",), ["longitudinal"]),
        (True, {"speed-limit"}, diagnosis_json.FRICTIONS, []),
        (True, {"scrub-torque"}, (), []),  # not of the drive
        (False, {"speed-limit"}, (), []),
    ],
)
def test_frictions_that_count_as_exact_are_named_where_the_size_of_a_drive_depends_on_them(
    ground: bool, chosen: set[str], stated: tuple[str, ...], said: list[str]
) -> None:
    problem, session = SimpleNamespace(open_ground=ground), SimpleNamespace(tolerance=dict.fromkeys(stated, 0.3))
    found: Any = SimpleNamespace(search=SimpleNamespace(problem=problem), chosen=chosen, session=session)
    assert diagnosis_json._exact_frictions(found) == [f"slip.{way}_friction" for way in said]


def unknown(**more: Any) -> Any:
    """A verdict "unknown" without a free-form term that was fitted."""
    item = SimpleNamespace(
        sentence="it drifts", quantity="along", by="heading", parity="", sizes=((1.0, 0.5, 1.5), (2.0, nan, 3.0))
    )
    usual = {"verdict": "unknown", "negligible": frozenset(), "follows": False, "chosen": frozenset({"b", "a"})}
    return diagnosis(**{**usual, "pieces": pd.DataFrame({"run": ["a"]}), "where": (item,), "terms": {}, **more})


def test_an_unknown_effect_that_no_term_explains_is_the_disagreement_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(effects_json, "root_mean_squares", lambda _: {"along_mm_s": (1.0, 0.5, 2.0)})
    monkeypatch.setattr(effects_json, "effect_content", lambda _, effect: {"id": effect})
    monkeypatch.setattr(effects_json, "is_free", lambda effect: effect == "a")
    (shown,) = effects_json.effects(unknown())
    assert (shown["id"], shown["name"], shown["fitted"]) == (
        "free-form",
        "an error of the robot's speed",
        False,
    )
    assert shown["parameters"] == {"rms_along_mm_s": {"value": 1.0, "low": 0.5, "high": 2.0}}
    (term,) = shown["terms"]
    assert (term["channel"], term["basis"], term["parity"]) == ("along", "heading", None)
    assert term["coefficients"][1] == {"value": 2.0, "low": None, "high": 3.0}
    named = [{"id": "a"}, {"id": "b"}]
    assert effects_json.effects(unknown(follows=True)) == named  # a free-form term was fitted and explains the runs
    assert effects_json.effects(unknown(verdict="effect")) == named
    assert effects_json.effects(unknown(pieces=None)) == named
    assert len(effects_json.effects(unknown(follows=True, chosen=frozenset({"b"})))) == 1
    assert len(effects_json.effects(unknown(where=unknown().where * 2))) == 1  # however many dependences there are
    assert effects_json.effects(unknown(negligible=frozenset({"a"}))) == []


def test_a_chosen_effect_is_told_with_its_probability_among_sets_that_may_be_right(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(effects_json, "parameters", lambda *_: {"x": 1})
    monkeypatch.setattr(effects_json, "equivalents", lambda *_: ["other"])
    monkeypatch.setattr(effects_json, "may_be_right", lambda _, ids: "refused" not in ids)
    name = next(iter(free_terms()))
    tried: list[Any] = []
    sets = [frozenset({"plate-tilt"}), frozenset({"refused"}), frozenset({name})]
    standing = SimpleNamespace(sets=sets, containing=lambda effect, among: tried.append((effect, among)) or 0.123456)
    found = diagnosis(
        terms={"plate-tilt": SimpleNamespace(known=None), name: free_terms()[name]},
        standing=standing,
        search="s",
        chosen=frozenset({"refused"}),
    )
    shown = effects_json.effect_content(found, "plate-tilt")
    assert shown == {
        "id": "plate-tilt", "name": EFFECTS["plate-tilt"].name, "parameters": {"x": 1}, "equivalent": ["other"],
        "probability": 0.1235,
    }  # fmt: skip
    assert tried[0] == ("plate-tilt", sets)  # the chosen set counts, refused or not
    found.chosen = sets[0]
    free = effects_json.effect_content(found, name)
    assert (free["id"], free["name"]) == ("free-form", free_terms()[name].describe())
    assert [(item["channel"], item["basis"]) for item in free["terms"]] == [
        (item.channel, item.basis) for item in free_terms()[name].items
    ]
    assert tried[1] == (name, [sets[0], sets[2]])


def test_a_pattern_of_one_wheel_is_the_sum_of_patterns_that_a_robot_file_knows() -> None:
    """Of four wheels in the order front left, front right, rear left, rear right."""
    signs = {
        "driving": [1, 1, 0, 0],
        "driven": [0, 0, 1, 1],
        "left-right": [1, -1, 1, -1],
        "driving-left-right": [1, -1, 0, 0],
    }
    wheels = ("front-left", "front-right", "rear-left", "rear-right")
    for place, name in enumerate(wheels):
        total = sum(share * np.array(signs[pattern]) for pattern, share in effect_tables.PATTERN_SUMS[name])
        np.testing.assert_array_equal(total, np.eye(4)[place])
    rear = sum(share * np.array(signs[pattern]) for pattern, share in effect_tables.PATTERN_SUMS["driven-left-right"])
    np.testing.assert_array_equal(rear, [0, 0, 1, -1])


ONE, PAIR = "free:friction.one.front-left+stiffness.one.front-left", "free:friction.one.driven-left-right"
COMMON = "free:friction.abs_u"


def test_tables_of_fitted_effects_are_what_the_fitted_model_has() -> None:
    """An effect by its parameters; a free-form term of one wheel, or of the driven pair, as sums of known patterns."""
    pull = Candidate("tether-pull", (), lambda values: {"x_mN": values[0], "y_mN": 0.0})
    terms: dict[str, Candidate] = {"tether-pull": pull, ONE: free_terms()[ONE], PAIR: free_terms()[PAIR]}
    fitted = {"tether-pull": (1.5,), ONE: (0.2, 0.4), PAIR: (-0.3,)}
    text = "\n".join(effect_tables.effect_tables(terms, fitted))
    assert text.count("\n\n[[effect]]") == text.count("[[effect]]") - 1  # a line between any two
    robot = effect_tables.corrected_robot(
        load_robot("barrel"),
        terms,
        Point(np.zeros((1, 7)), {"body.mass_g": 0.1, "camera, error 1": 0.5}, fitted),
    )
    assert robot.body.mass_g == pytest.approx(1.1 * load_robot("barrel").body.mass_g)
    forms = [(entry.channel, entry.pattern, entry.coefficient) for entry in robot.effect if entry.id == "free-form"]
    assert forms == [
        ("friction", "left-right", -0.3),
        ("friction", "driving-left-right", 0.3),
        ("friction", "driving", 0.1),
        ("friction", "driving-left-right", 0.1),
        ("stiffness", "driving", 0.2),
        ("stiffness", "driving-left-right", 0.2),
    ]
    assert [entry.id for entry in robot.effect].count("tether-pull") == 1


def test_a_term_of_some_wheels_is_an_own_effect_whose_coefficient_names_them() -> None:
    fit = SimpleNamespace(point=SimpleNamespace(terms={PAIR: (-0.3,), COMMON: (0.2,)}))
    found: Any = SimpleNamespace(terms=free_terms(), fit=fit, follows=True, search=SimpleNamespace(evidence=len))
    names = []
    for form in (PAIR, COMMON):
        found.chosen = frozenset({form})
        (text,) = own_effects(found)
        names.append(tomllib.loads(text)["term"][0]["coefficient"])
    assert names == ["friction_by_one_driven_left_right", "friction_by_abs_u"]
    mixed = next(name for name, form in free_terms().items() if [bool(item.twin) for item in form.items] == [True] * 2)
    found.chosen, fit.point.terms = frozenset({mixed}), {mixed: (-0.2, 0.5)}
    rows = tomllib.loads(own_effects(found)[0])["term"]
    assert [(row["channel"], row["depends_on"], row["coefficient"]) for row in rows] == [
        ("left_drive", "left_command", "by_own_command"),
        ("right_drive", "right_command", "by_own_command"),
        ("left_drive", "right_command", "by_other_command"),
        ("right_drive", "left_command", "by_other_command"),
    ]


def test_a_nominal_value_beyond_three_relative_tolerances_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    """A friction 32 % above the robot file, 3.1 tolerances in the fit, was in no sentence."""
    moved = {"slip.lateral_friction": 0.155, "slip.decrease": -0.149, "wheels.radius_mm": 0.9, "body.mass_g": None}
    nominal = {key: {"relative_change": change, "sigma": 0.02, "tolerance": 0.05} for key, change in moved.items()}
    monkeypatch.setattr(diagnosis_json, "_nominal", lambda _: nominal)
    told = SimpleNamespace(quantity=SimpleNamespace(key="wheels.radius_mm"))
    found = diagnosis(known=(told,), follows=True)
    assert diagnosis_json._far_nominal(found) == ["lateral friction: off by +16 % [95 %: 12 to 19], tolerance 5 %"]
    assert diagnosis_json._far_nominal(diagnosis(known=(told,), follows=False)) == []


def test_eight_rivals_are_listed_the_most_probable_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alternatives_json, "strained", lambda *_: set())
    sets = tuple(frozenset({f"e{k}"}) for k in range(11))
    search = SimpleNamespace(fits=dict.fromkeys(sets), null=0, tolerance={}, problem=SimpleNamespace(open_ground=False))
    standing = Standing(sets, -np.arange(11.0))
    said = alternatives_json.rivals(diagnosis(standing=standing, chosen=sets[0], search=search))
    assert [item["effects"] for item in said] == [[f"e{k}"] for k in range(1, 9)]


def test_an_error_that_no_fit_moved_is_none() -> None:
    fit = SimpleNamespace(point=Point(np.zeros((1, 7)), {}))
    found: Any = SimpleNamespace(fit=fit, session=SimpleNamespace(tolerance={"camera, error 1": 0.02}))
    assert diagnosis_json._shared(found) == {"camera, error 1": 0.0}
    found.session.tolerance = {"body.mass_g": 0.05}
    assert diagnosis_json._shared(found) is None


def test_a_nominal_value_of_all_wheels_moves_in_each_of_their_tables() -> None:
    text = (Path(__file__).parents[2] / "driven_robot" / "six_wheels.toml").read_text(encoding="utf-8")
    point = Point(np.zeros((1, 7)), {"wheel.radius_mm": 0.02, "body.mass_g": 1e-9})
    session = SimpleNamespace(tolerance={"wheel.radius_mm": 0.01})
    found: Any = SimpleNamespace(terms={}, chosen=frozenset(), fit=SimpleNamespace(point=point), session=session)
    before, after = tomllib.loads(text), tomllib.loads(robot_with_effect(found, text))
    for old, new in zip(before.pop("wheel"), after.pop("wheel"), strict=True):
        assert new == {**old, "radius_m": pytest.approx(1.02 * old["radius_m"])}
    assert after == before
