"""From what a search decides to the answer: relevance, reserves, and runs that do not suffice, with stand-ins."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from evaluator.diagnosis import answer as module
from evaluator.diagnosis.answer import Answer, answer, step_for_drift, too_few_commands, too_few_runs
from evaluator.diagnosis.assessment.gap import TOO_SMALL
from evaluator.diagnosis.assessment.model_comparison import Standing
from evaluator.diagnosis.assessment.relevance import Changes
from evaluator.diagnosis.assessment.verdict import UNDECIDED
from evaluator.settings import Relevant
from evaluator.wording import counted
from tests.evaluator.diagnosis.synthetic import run_data

if TYPE_CHECKING:
    from collections.abc import Sequence

NONE, A, B, AB = frozenset[str](), frozenset({"a"}), frozenset({"b"}), frozenset({"a", "b"})
FREE = frozenset({"free:x"})
LARGE, SMALL = Changes(9.0, 9.0, 9.0), Changes(0.0, 0.0, 0.0)


def answered(
    monkeypatch: pytest.MonkeyPatch,
    decided: tuple[frozenset[str], str],
    *,
    wider: frozenset[str] | None = None,
    changes: dict[str, Changes] | None = None,
    reserve: str = "",
    step: str = "",
    few: str = "",
    untested: str = "",
    finding: bool = False,
    on_ground: bool = False,
    beyond: float = 0.6,
    too_little: str = "too little",
    small: str = "",
    possible: frozenset[str] = NONE,
    asked: dict[str, Any] | None = None,
    ahead: float = 1.0,
    alike: tuple[str, ...] = (),
    hidden: str = "",
) -> Answer:
    """The answer where these parts say so; asked: what they were asked."""
    chosen, verdict = decided
    asked = {} if asked is None else asked
    fits = {ids: f"fit of {sorted(ids)}" for ids in (NONE, A, AB, FREE, FREE | A)}
    problem = SimpleNamespace(open_ground=on_ground)
    search: Any = SimpleNamespace(fits=fits, null=fits[NONE], problem=problem, runs=(0,) * 24, tolerance={})
    session: Any = SimpleNamespace(relevant=Relevant(speed_percent=0.2), known=(), data=())
    table = Standing((A, FREE | A, FREE, NONE), np.array([2.0 + ahead, 2.0, 1.0, 0.0]))

    def decide(*given: Any) -> tuple[frozenset[str], str, str]:
        asked["least_material"] = given[4]
        return chosen, verdict, "so"

    def adequate(fit: Any, _: Any, gain: float = 0.0) -> str:
        asked["gain"] = gain
        return f"left of {fit}"

    def constant(fit: Any, *_: Any) -> list[str]:
        asked["constancy"] = fit
        return ["constant"]

    def doubts(_: Any, halves: Sequence[str], *, material: bool = True, named: bool = False) -> str:
        asked["named"] = named
        if not halves:
            return small
        return "not asked of the halves" if halves != ["constant"] else reserve if material else too_little

    parts: dict[str, Any] = {
        "rank_named": lambda *_: (table, A),
        "decide": decide,
        "name_what_is_off": lambda *_: chosen if wider is None else wider,
        "standing": lambda *_: table,
        "changes": lambda _, __, effect: (changes or {}).get(effect, LARGE),
        "adequacy": adequate,
        "constancy": constant,
        "beyond_noise": lambda *_: beyond,
        "doubts": doubts,
        "undecided": lambda *_: (possible, "odds"),
        "step_for_drift": lambda *_: step,
        "_hidden_by_friction": lambda *_: hidden,
        "too_few_runs": lambda *_: few,
        "too_few_commands": lambda *_: untested,
        "knowledge": lambda *_: (
            SimpleNamespace(is_finding=finding, quantity=SimpleNamespace(name="track"), equivalent=alike),
        ),
        "covariance_of": lambda *_: None,
        "together": lambda *_: SimpleNamespace(is_finding=False),
    }
    for name, part in parts.items():
        monkeypatch.setattr(module, name, part)
    return answer(search, session, {})


def test_an_answer_is_what_is_decided_where_nothing_speaks_against_it(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {}
    found = answered(monkeypatch, (FREE | A, "effect"), asked=asked)
    assert (found.verdict, found.reason, found.chosen, found.negligible) == ("effect", "so", FREE | A, NONE)
    assert found.leftover == "left of fit of ['a', 'free:x']"
    so = {"least_material": -np.inf, "gain": 0.002, "constancy": "fit of ['a']", "named": True}  # 0.2 % of speed matter
    assert asked == so
    answered(monkeypatch, (NONE, "none"), asked=asked)
    assert not asked["named"]
    answered(monkeypatch, (A, "effect"), on_ground=True, asked=asked)
    assert asked["least_material"] == pytest.approx(-3 * 24 * np.log(0.8))


@pytest.mark.parametrize(
    ("changes", "verdict", "negligible"),
    [
        ({"a": SMALL, "b": SMALL}, "none", AB),
        ({"a": LARGE, "b": SMALL}, "effect", NONE),  # one of them matters
    ],
)
def test_effects_of_which_none_matters_are_no_answer(
    changes: dict[str, Changes], verdict: str, negligible: frozenset[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = answered(monkeypatch, (AB, "effect"), changes=changes)
    assert (found.verdict, found.negligible) == (verdict, negligible)
    assert ("below the limits of relevance" in found.reason) == (verdict == "none")


@pytest.mark.parametrize(
    ("possible", "small", "chosen", "verdict", "reason"),
    [
        (NONE, {}, NONE, "none", "so"),
        (A, {}, NONE, "insufficient", "odds"),
        (A, {"a": SMALL}, NONE, "none", "so"),  # it would not matter
        (B, {}, A, "effect", "so; odds"),  # beside one that is named it is told
        (B, {"b": SMALL}, A, "effect", "so"),
        (NONE, {}, A, "effect", "so"),
    ],
)
def test_runs_that_neither_prove_nor_exclude_an_effect_that_would_matter_decide_nothing(
    possible: frozenset[str], small: dict[str, Changes], chosen: frozenset[str], verdict: str, reason: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    decided = (chosen, "effect" if chosen else "none")
    found = answered(monkeypatch, decided, possible=possible, changes=small)
    assert (found.verdict, found.chosen, found.reason) == (verdict, chosen, reason)


@pytest.mark.parametrize(
    ("alike", "finding", "verdict"),
    [
        (("a",), True, "none"),
        (("c", "a"), True, "none"),
        (("a",), False, "insufficient"),
        (("b",), True, "insufficient"),
    ],
)
def test_what_is_told_as_a_value_beyond_its_tolerance_is_decided(
    alike: tuple[str, ...], finding: bool, verdict: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = answered(monkeypatch, (NONE, "none"), possible=A, finding=finding, alike=alike)
    assert found.verdict == verdict
    both = answered(monkeypatch, (NONE, "none"), possible=AB, finding=finding, alike=alike)
    assert both.verdict == "insufficient"


def test_an_effect_that_keeps_values_within_tolerances_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    found = answered(monkeypatch, (NONE, "none"), wider=A, finding=True)
    assert (found.verdict, found.chosen) == ("effect", A)
    assert found.reason == "without a, the runs contradict the tolerance of: track"


@pytest.mark.parametrize(("beyond", "reason"), [(0.49, "too little"), (0.51, "residuals")])
def test_residuals_are_a_reserve_where_they_move_the_marks_by_what_matters(
    beyond: float, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half of the noise floor, unless the user says otherwise."""
    assert answered(monkeypatch, (NONE, "none"), reserve="residuals", beyond=beyond).reason == reason


def test_residuals_that_do_not_matter_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    told = "residuals are 1.4 times the noise"
    for beyond, reason in ((0.49, f"so; {told}, but {TOO_SMALL}"), (0.51, "so")):
        found = answered(monkeypatch, (NONE, "none"), beyond=beyond, too_little="", small=told)
        assert (found.verdict, found.reason) == ("none", reason)


@pytest.mark.parametrize(("reserve", "step"), [("residuals", ""), ("", "a step")])
@pytest.mark.parametrize("verdict", ["none", "effect"])
def test_a_reserve_makes_an_answer_unknown_with_the_most_probable_form(
    verdict: str, reserve: str, step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = answered(monkeypatch, (A, verdict), reserve=reserve, step=step)
    assert (found.verdict, found.reason, found.chosen) == ("unknown", reserve or step, FREE | A)


@pytest.mark.parametrize(
    ("chosen", "fits", "said"),
    [
        ({"speed-drift", "a"}, {"with": "", "without": "step"}, "step"),
        ({"speed-drift", "a"}, {"with": "step", "without": "another"}, "step"),
        ({"speed-drift", "a"}, {"with": ""}, ""),  # a set that was not fitted is not asked
        ({"a"}, {"with": "step", "without": "step"}, ""),
    ],
)
def test_a_step_of_the_speed_is_looked_for_with_the_drift_and_without_it(
    chosen: set[str], fits: dict[str, str], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "adequacy", lambda fit, _: f"left of {fit}")
    monkeypatch.setattr(module, "step_in_speed", lambda fit, left, _: fits[fit] * (left == f"left of {fit}"))
    sets = {"with": frozenset(chosen), "without": frozenset(chosen) - {"speed-drift"}}
    search: Any = SimpleNamespace(fits={sets[name]: name for name in fits})
    assert step_for_drift(search, frozenset(chosen), SimpleNamespace(data=())) == said  # type: ignore[arg-type]


def test_a_free_form_term_that_explains_too_little_is_said_to(monkeypatch: pytest.MonkeyPatch) -> None:
    found = answered(monkeypatch, (A, "effect"), reserve="residuals", small="they remain")
    assert (found.verdict, found.chosen) == ("unknown", FREE | A)
    assert found.reason == "residuals; with the free-form term, they remain"
    assert found.leftover == "left of fit of ['a']"  # of what was no answer: its runs are examined
    assert answered(monkeypatch, (A, "effect"), reserve="residuals").reason == "residuals"
    same = answered(monkeypatch, (A, "effect"), reserve="friction by 30.5 %", small="friction by 29 %")
    assert same.reason == "friction by 30.5 %, with the free-form term as well"


def test_effects_alone_are_nearest_if_they_are_certainly_more_probable_than_with_a_free_form_term(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for ahead, chosen in ((UNDECIDED - 0.01, FREE | A), (UNDECIDED + 0.01, A)):
        found = answered(monkeypatch, (NONE, "none"), reserve="residuals", small="they remain", ahead=ahead)
        assert (found.verdict, found.chosen) == ("unknown", chosen)
    assert found.reason == "residuals"


def test_on_open_ground_a_reserve_is_added_to_an_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    found = answered(monkeypatch, (A, "effect"), reserve="residuals", on_ground=True)
    assert (found.verdict, found.reason, found.chosen) == ("effect", "so; residuals", A)
    without = answered(monkeypatch, (NONE, "none"), reserve="residuals", on_ground=True)
    assert (without.verdict, without.chosen) == ("insufficient", NONE)  # the noise there is that of the usual run
    assert without.reason == "residuals: runs of more commands are needed"


def test_few_runs_do_not_carry_unknown_physics(monkeypatch: pytest.MonkeyPatch) -> None:
    found = answered(monkeypatch, (FREE, "unknown"), few="too few", reserve="not asked")
    assert (found.verdict, found.reason, found.chosen) == ("insufficient", "so; too few", NONE)
    assert found.leftover == "left of fit of []"
    assert answered(monkeypatch, (A, "effect"), few="too few").verdict == "effect"


@pytest.mark.parametrize(("chosen", "told"), [(NONE, True), (A, False)])
def test_values_that_contradict_their_tolerance_are_told_where_nothing_is_missing(
    chosen: frozenset[str], told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = answered(monkeypatch, (chosen, "none"), finding=True)
    assert ("values that contradict their tolerance" in found.reason) == told


def test_a_law_that_the_commands_do_not_test_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    found = answered(monkeypatch, (A, "effect"), untested="too few commands")
    assert (found.verdict, found.reason, found.chosen) == ("insufficient", "too few commands", NONE)
    assert found.leftover == "left of fit of []"
    assert answered(monkeypatch, (NONE, "none"), untested="too few commands").verdict == "none"


@pytest.mark.parametrize(
    ("commands", "form", "least", "told"),
    [
        (2, "free:x", 99.0, True),
        (3, "free:x", 99.0, False),  # more than the parameters of the law
        (2, "free:x", 98.8, False),  # three times less probable
        (2, "b", 99.0, False),  # another effect of the catalogue: a rival
        (2, "a free:x", 99.0, False),  # beside the effect, not in its place
        (1, "free:x", 99.0, True),
    ],
)
def test_commands_as_many_as_the_parameters_of_a_law_do_not_test_it_if_another_law_explains_them(
    commands: int, form: str, least: float, told: bool
) -> None:
    """Two turns of a robot whose friction falls with its speed were explained by a viscous drag."""
    evidence = {A: 100.0, frozenset(form.split()): least}
    search: Any = SimpleNamespace(
        problem=SimpleNamespace(open_ground=False),
        terms={"a": SimpleNamespace(size=2)},
        fits=evidence,
        evidence=evidence.get,
    )
    # forward and backward, to both sides, and repeated: one command
    runs = [run_data(sign * 30.0, sign * (10.0 + k), k) for k in range(commands) for sign in (1, -1, 1)]
    session: Any = SimpleNamespace(data=[*runs, run_data(10.0, 30.0)])
    said = too_few_commands(search, A, session)
    assert bool(said) == told
    assert not told or f"{counted(commands, 'command')} do not test a law of 2 parameters" in said
    search.problem.open_ground = True
    assert too_few_commands(search, A, session) == ""


def test_a_law_that_mends_all_runs_is_asked_for_and_no_law_counts_as_one_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    left = {"null": np.array([*[1.0] * 6, 9.0, 9.0]), "law": np.ones(8)}
    monkeypatch.setattr(module, "adequacy", lambda fit, _: SimpleNamespace(by_run=left[fit]))
    terms = {"free:x": SimpleNamespace(size=2)}
    search: Any = SimpleNamespace(terms=terms, null="null", fits={FREE: "law"})
    session: Any = SimpleNamespace(data=())
    assert too_few_runs(search, FREE, session) == ""
    search.fits = {}
    assert too_few_runs(search, FREE, session)
    left["null"] = np.ones(7)
    assert too_few_runs(search, NONE, session).endswith("until there are 8 runs")


@pytest.mark.parametrize(
    ("verdict", "possible", "said", "reason"),
    [
        ("none", NONE, "insufficient", "friction differs"),
        ("none", A, "insufficient", "odds"),  # what could be right is told first
        ("effect", NONE, "effect", "so"),
        ("unknown", NONE, "unknown", "so"),
    ],
)
def test_nothing_is_missing_only_if_friction_does_not_hide_it(
    verdict: str, possible: frozenset[str], said: str, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = NONE if verdict == "none" else A
    found = answered(monkeypatch, (chosen, verdict), possible=possible, hidden="friction differs")
    assert (found.verdict, found.reason.partition("; ")[0]) == (said, reason)


@pytest.mark.parametrize("on_ground", [False, True])
def test_friction_is_asked_of_the_runs_of_the_model_without_effects(
    monkeypatch: pytest.MonkeyPatch, *, on_ground: bool
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(module, "adequacy", lambda fit, _: f"left of {fit}")
    monkeypatch.setattr(module, "unusual_friction", lambda *given: asked.append(given) or "so")
    data = [SimpleNamespace(order=3 * k, command=(k, k + 1)) for k in range(4)]
    search: Any = SimpleNamespace(null=Null((2, 0)), problem=SimpleNamespace(open_ground=on_ground))
    session: Any = SimpleNamespace(data=data)
    assert module._hidden_by_friction(search, session) == ("" if on_ground else "so")
    if not on_ground:
        ((left, order, commands),) = asked
        assert (left, order.tolist(), commands) == ("left of null", [6.0, 0.0], [(2, 3), (0, 1)])


class Null:
    """A fit of some runs."""

    def __init__(self, runs: tuple[int, ...]) -> None:
        self.runs = runs

    def __str__(self) -> str:
        return "null"
