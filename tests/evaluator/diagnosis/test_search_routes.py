"""Which searches a diagnosis makes of its runs, and what of them it keeps: stand-ins instead of fits."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis import deciding
from evaluator.diagnosis import diagnosis as whole_module
from evaluator.diagnosis import session_diagnosis as module
from evaluator.diagnosis.assessment.verdict import Verdict
from evaluator.diagnosis.diagnosis import _completed
from evaluator.diagnosis.diverging_runs import DIVERGING
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.inference.watch import SearchStoppedError, Watch
from evaluator.diagnosis.likelihood.run_data import NotSimulatedError
from evaluator.diagnosis.result import Diagnosis
from evaluator.diagnosis.session_diagnosis import UNSIMULATED, diagnosed
from evaluator.progress import no_progress

TILT = frozenset({"plate-tilt"})


def session_of(runs: int, **more: Any) -> Session:
    data: Any = tuple(SimpleNamespace(id=f"r{number}") for number in range(runs))
    return Session(data, (None,) * runs, {}, **more)  # type: ignore[arg-type]


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Steps of a search in their order; every stage notes what it is given."""
    steps: list[Any] = []

    def noted(name: str, result: Any) -> Any:
        return lambda *given: steps.append((name, *given)) or result

    part: Any = SimpleNamespace(problem="problem of the part", runs=(0, 2))
    whole: Any = SimpleNamespace(problem="problem of all")
    results = {
        "search_named": NAMED, "refined": part, "fit_on_all_runs": whole, "challenge_with_free_terms": None,
        "null_on_ground": "null", "singles_on_ground": "singles", "searched_on_ground": (part, whole),
        "separations": {"a": {}},
        "profiles_of": {"a": "profile"},
        "fitted_where_absent": False,
    }  # fmt: skip
    for name, result in results.items():
        step = noted(name, result)
        for place in (module, deciding):
            monkeypatch.setattr(place, name, step, raising=hasattr(place, name))
    monkeypatch.setattr(module, "shortcomings", lambda *_: [])
    monkeypatch.setattr(module, "without_cancelling", lambda search: (search, ""))
    monkeypatch.setattr(deciding, "_without_contradicted", lambda search, said, _: (search, said))
    monkeypatch.setattr(module, "reviewed", lambda found: found)
    monkeypatch.setattr(module, "_with_changed_values", lambda found, *_: found)
    monkeypatch.setattr(module, "diverging_runs", lambda _: [])
    monkeypatch.setattr(module, "jumping_runs", lambda _: [])
    monkeypatch.setattr(module, "suspected_runs", lambda _: [])
    monkeypatch.setattr(module, "_in_parts", lambda found, _: steps.append(("_in_parts", found)) or found)
    return steps


def answering(monkeypatch: pytest.MonkeyPatch, verdict: str, *, open_ground: bool) -> None:
    ready = SimpleNamespace(
        problem=SimpleNamespace(open_ground=open_ground),
        start="start",
        terms={"a": None},
        free={"free:x": None},
        last={},
    )
    said = SimpleNamespace(
        verdict=verdict, reason="it pays", chosen=TILT, named=frozenset("b"), standing=None, leftover=None,
        constancy=(), changes={}, negligible=frozenset(), known=(), known_together=None,
    )  # fmt: skip
    monkeypatch.setattr(module, "prepared", lambda *_: ready)
    monkeypatch.setattr(deciding, "answer", lambda *_: said)


NAMED: Any = SimpleNamespace(name="named", diverging=(), explained=-np.inf)  # a search
ON_GROUND = ["null_on_ground", "singles_on_ground", "searched_on_ground"]
ON_PLATE = ["search_named", "refined", "fit_on_all_runs", "challenge_with_free_terms"]


@pytest.mark.parametrize(("open_ground", "steps"), [(False, ON_PLATE), (True, ON_GROUND)])
@pytest.mark.parametrize("verdict", ["effect", "unknown"])
def test_a_plate_is_searched_by_names_first_and_open_ground_by_names_and_forms_at_once(
    open_ground: bool, steps: list[str], verdict: str, done: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, verdict, open_ground=open_ground)
    found = diagnosed(session_of(4), no_progress, None)  # type: ignore[arg-type]
    is_effect = verdict == "effect"
    last = ["profiles_of", "fitted_where_absent", "separations"] if is_effect else [] if open_ground else ["_in_parts"]
    assert [step for step, *_ in done] == steps + last
    assert (found.verdict, found.reason, found.chosen, found.held_out) == (verdict, "it pays", TILT, (1, 3))
    assert found.fit_search is not None
    assert (found.problem, found.fit_search.runs) == ("problem of the part", (0, 2))
    assert (found.profiles, found.separation) == (({"a": "profile"}, {"a": {}}) if is_effect else ({}, {}))
    assert found.terms == {"a": None}
    if is_effect:  # told apart from others is the set with names, profiled the answer
        assert [given[2] for given in done[-3:]] == [TILT, TILT, frozenset("b")]
    if not open_ground:
        assert [given[1:] for given in done[:4]] == [
            (done[0][1], no_progress, ()), (NAMED, done[0][1], no_progress), (found.fit_search, {"a": None}),
            (found.search, {"free:x": None}, no_progress),
        ]  # fmt: skip


@pytest.mark.parametrize(("verdict", "told"), [("effect", False), ("unknown", True), ("insufficient", True)])
def test_effects_that_would_cancel_each_other_are_told_where_nothing_better_is_found(
    verdict: str, told: bool, done: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, verdict, open_ground=False)
    kept: Any = SimpleNamespace(problem="problem of all", kept=True)
    monkeypatch.setattr(module, "without_cancelling", lambda _: (kept, "a and b cancel"))
    found = diagnosed(session_of(4), no_progress, None)  # type: ignore[arg-type]
    assert found.search is kept
    assert next(step for step in done if step[0] == "challenge_with_free_terms")[1] is kept
    assert found.reason == ("it pays; a and b cancel" if told else "it pays")


def test_an_answer_is_sought_again_where_a_set_without_one_of_its_effects_fits_better_than_known(
    done: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, "effect", open_ground=False)
    asked = []
    said = deciding.answer(None, None, None)  # type: ignore[arg-type]
    monkeypatch.setattr(deciding, "answer", lambda *_: asked.append(1) or said)
    for better, times in ((False, 1), (True, 2)):
        asked.clear()
        done.clear()
        monkeypatch.setattr(deciding, "fitted_where_absent", lambda *_, better=better: better)
        diagnosed(session_of(4), no_progress, None)  # type: ignore[arg-type]
        assert len(asked) == times
        assert [step for step, *_ in done].count("profiles_of") == times  # of the answer that stands


def test_runs_that_diverge_are_left_out_and_the_others_searched_from_the_fits_so_far(
    done: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, "none", open_ground=False)
    told = iter([[1], []])
    monkeypatch.setattr(module, "diverging_runs", lambda _: next(told))
    monkeypatch.setattr(module, "seeds_without", lambda part, runs: (part.name, runs))
    session = replace(session_of(4), robots=("a", "b", "c", "d"))  # type: ignore[arg-type]
    found = diagnosed(session, no_progress, None)  # type: ignore[arg-type]
    assert [step for step, *_ in done] == ["search_named", *ON_PLATE]
    assert [given[3] for given in done[:2]] == [(), ("named", [1])]  # begun with the fits of the search before
    assert found.session.robots == ("a", "c", "d")  # type: ignore[comparison-overlap]
    assert [run.id for run in found.session.data] == ["r0", "r2", "r3"]
    assert found.session.left_out == {"r1": DIVERGING}
    assert found.held_out == (1,)  # the second of the three that remain
    done.clear()
    told = iter([[], []])
    early = iter([SimpleNamespace(name="of the first seconds", diverging=(2,)), SimpleNamespace(diverging=())])
    monkeypatch.setattr(module, "search_named", lambda *given: done.append(("search_named", *given)) or next(early))
    found = diagnosed(session, no_progress, None)  # type: ignore[arg-type]
    assert [given[3] for given in done[:2]] == [(), ("of the first seconds", (2,))]
    assert [run.id for run in found.session.data] == ["r0", "r1", "r3"]


def test_parts_that_diverge_are_left_out_before_open_ground_is_searched(
    done: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those that jump, at the model without effects or at one with a single one, as often as they are found."""
    answering(monkeypatch, "none", open_ground=True)
    asked: list[Any] = []
    jumps = iter([[2], [], [0], [], []])
    monkeypatch.setattr(module, "diverging_runs", lambda null: asked.append(null) or [1])
    monkeypatch.setattr(module, "jumping_runs", lambda search: asked.append(f"{search}, jumping") or next(jumps))
    session = replace(session_of(6), robots=tuple("abcdef"))  # type: ignore[arg-type]
    found = diagnosed(session, no_progress, None)  # type: ignore[arg-type]
    steps = [step for step, *_ in done if step != "_in_parts"]
    assert steps == [*["null_on_ground"] * 2, *ON_GROUND[:2], *ON_GROUND]
    assert asked == ["null", *["null, jumping"] * 2, "singles, jumping", "null, jumping", "singles, jumping"]
    assert next(given for step, *given in done if step == "searched_on_ground")[0] == "singles"
    assert [run.id for run in found.session.data] == ["r2", "r4", "r5"]
    assert found.session.left_out == dict.fromkeys(["r1", "r3", "r0"], DIVERGING)


@pytest.mark.parametrize(
    ("verdict", "follows", "few", "same", "again"),
    [
        ("effect", True, False, True, True),
        ("effect", True, False, False, False),  # the others name something else: a question for the whole search
        ("effect", False, False, True, False),
        ("effect", True, True, True, False),
        ("unknown", True, False, True, False),
        ("none", True, False, True, False),
    ],
)
def test_effects_on_open_ground_are_fitted_to_the_runs_that_the_model_follows(
    verdict: str, follows: bool, few: bool, same: bool, again: bool, done: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A part of a log that took another turn trebled the noise: a dead time was told as a late start."""
    answering(monkeypatch, verdict, open_ground=True)
    whole: Any = SimpleNamespace(problem="problem of all", runs=(0, 1, 2))
    part: Any = SimpleNamespace(problem="problem of the part", runs=(0, 2))
    monkeypatch.setattr(module, "searched_on_ground", lambda *_: (part, whole))
    monkeypatch.setattr(
        module, "on_runs_except", lambda search, families, runs: done.append(("rest", search.runs, families, runs))
        or SimpleNamespace(problem="rest", runs=tuple(run for run in search.runs if run not in runs)),
    )  # fmt: skip
    reviews: list[Diagnosis] = []

    def reviewed(found: Diagnosis) -> Diagnosis:
        reviews.append(found)
        chosen = TILT if same or len(reviews) == 1 else frozenset({"scrub-torque"})
        return replace(found, outlying=(2,), follows=follows, chosen=chosen)

    monkeypatch.setattr(module, "reviewed", reviewed)
    monkeypatch.setattr(module, "shortcomings", lambda data, *_: ["few"] if few and len(data) < 4 else [])
    found = diagnosed(session_of(4), no_progress, None)  # type: ignore[arg-type]
    assert found.fit_search is not None
    assert (found.fit_search.runs, found.held_out) == (((0,), (1, 3)) if again else ((0, 2), (1, 3)))
    tried = verdict == "effect" and follows and not few
    rest = [step for step in done if step[0] == "rest"]
    assert rest == ([("rest", (0, 1, 2), 1, (2,)), ("rest", (0, 2), 1, (2,))] if tried else [])


@pytest.mark.parametrize("verdict", ["effect", "none", "unknown", "insufficient", "stopped"])
def test_suspected_runs_are_left_out_only_if_the_others_are_then_explained(
    verdict: str, done: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, "unknown", open_ground=False)
    unknown = deciding.answer(None, None, None)  # type: ignore[arg-type]
    answering(monkeypatch, verdict, open_ground=False)
    then, told = deciding.answer, iter([unknown])

    def answer(*given: Any) -> Any:
        if (first := next(told, None)) is not None:
            return first
        if verdict == "stopped":
            raise SearchStoppedError(7.0, "")
        return then(*given)

    monkeypatch.setattr(deciding, "answer", answer)
    suspected = iter([[1, 2], []])
    monkeypatch.setattr(module, "suspected_runs", lambda part: next(suspected) if part is NAMED else [])
    found = diagnosed(session_of(5), no_progress, None)  # type: ignore[arg-type]
    explained = verdict in ("effect", "none")
    assert found.verdict == (verdict if explained else "unknown")
    assert [step for step, *_ in done].count("search_named") == 2
    assert [run.id for run in found.session.data] == (["r0", "r3", "r4"] if explained else [f"r{k}" for k in range(5)])
    assert found.session.left_out == ({"r1": DIVERGING, "r2": DIVERGING} if explained else {})


@pytest.mark.parametrize("few", [False, True])
def test_runs_that_the_robot_file_cannot_simulate_are_left_out_unless_too_few_remain(
    few: bool, done: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, "none", open_ground=False)
    ready = module.prepared

    def prepared(session: Session, *given: Any) -> Any:
        if failed := [run.id for run in session.data if run.id in ("r1", "r3")]:
            raise NotSimulatedError(failed)
        return ready(session, *given)

    monkeypatch.setattr(module, "prepared", prepared)
    monkeypatch.setattr(module, "shortcomings", lambda data, *_: ["2 usable runs"] if few and len(data) < 3 else [])
    session = replace(session_of(4), robots=("a", "b", "c", "d"))  # type: ignore[arg-type]
    if few:
        with pytest.raises(NotSimulatedError, match="run r1 cannot be simulated"):
            diagnosed(session, no_progress, None)  # type: ignore[arg-type]
        return
    found = diagnosed(session, no_progress, None)  # type: ignore[arg-type]
    assert [step for step, *_ in done] == ON_PLATE
    assert [run.id for run in found.session.data] == ["r0", "r2"]
    assert found.session.left_out == {"r1": UNSIMULATED, "r3": UNSIMULATED}


def test_what_cannot_be_searched_says_why_and_what_concerns_all_runs_first(monkeypatch: pytest.MonkeyPatch) -> None:
    mistakes: Any = tuple(SimpleNamespace(sentence=name, everywhere=name == "mirrored") for name in ("one", "mirrored"))
    monkeypatch.setattr(module, "shortcomings", lambda *_: ["3 usable runs"])
    found = diagnosed(session_of(3, mistakes=mistakes), no_progress, None)  # type: ignore[arg-type]
    assert (found.verdict, found.reason, found.stopped) == (
        "insufficient",
        "a mistake concerns all runs; 3 usable runs",
        False,
    )


def test_a_search_that_is_stopped_has_no_verdict(done: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: Any) -> None:
        raise SearchStoppedError(7.0, "the tilt explains the runs")

    monkeypatch.setattr(module, "prepared", stopped)
    found = diagnosed(session_of(3), no_progress, None)  # type: ignore[arg-type]
    assert (found.verdict, found.stopped, done) == ("insufficient", True, [])
    assert found.reason.startswith("the search was stopped after 7 s of processor time")


@pytest.mark.parametrize("apart", [None, {"a": {"b": 3.0}}])
def test_runs_to_record_next_are_those_of_the_answer_and_none_without_a_search(
    apart: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(whole_module, "best_next_runs", lambda *given: asked.append(given) or "next")
    monkeypatch.setattr(whole_module, "limits", lambda *given: ("limits", *given))
    none = Diagnosis("insufficient", "few", session_of(3))
    assert _completed(none, no_progress) is none
    search: Any = "search"
    standing: Any = "standing"
    found = Diagnosis(
        "effect", "", session_of(3, known=("k",)), search=search, standing=standing, chosen=TILT, separation=apart
    )
    whole = _completed(found, no_progress)
    assert (whole.next_runs, whole.limits) == ("next", ("limits", "search", TILT))
    assert asked == [("search", TILT, "standing", apart or {}, ("k",))]
    assert _completed(replace(found, verdict="unknown"), no_progress).limits == ()
    assert np.isnan(found.confirmation)


@pytest.mark.parametrize(
    ("first", "second", "taken"),
    [
        ("none", "effect", "second"),
        ("effect", "unknown", "second"),
        ("unknown", "none", "second"),
        ("insufficient", "effect", "second"),
        ("unknown", "insufficient", "first"),  # what no model follows may look like a change of anything
        ("insufficient", "unknown", "first"),
    ],
)
def test_values_that_changed_within_the_session_are_freed_and_it_is_diagnosed_again(
    first: Verdict, second: Verdict, taken: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    session, changed = session_of(4), session_of(4, start_sigma_s=1.0)
    search: Any = SimpleNamespace(problem=SimpleNamespace(open_ground=False), fits={frozenset(): "fit"})
    found = {"first": Diagnosis(first, "", session, search=search), "second": Diagnosis(second, "", changed)}
    asked: list[Any] = []
    monkeypatch.setattr(module, "with_changed_values", lambda *given: asked.append(given[:3]) or changed)
    undecided = first in ("unknown", "insufficient")

    def searched(session: Session, *_: object, only_if_explained: bool = False) -> Diagnosis:
        assert session is changed
        assert only_if_explained == undecided
        return found["second"]

    monkeypatch.setattr(module, "_searched", searched)
    assert module._with_changed_values(found["first"], Watch(), None) is found[taken]
    assert asked == [(search, "fit", session)]

    def stopped(*_: object, **__: object) -> Diagnosis:
        raise SearchStoppedError(180.0)

    monkeypatch.setattr(module, "_searched", stopped)
    if undecided:  # it stays so
        assert module._with_changed_values(found["first"], Watch(), None) is found["first"]
    else:
        with pytest.raises(SearchStoppedError):
            module._with_changed_values(found["first"], Watch(), None)
    monkeypatch.setattr(module, "with_changed_values", lambda *_: None)
    assert module._with_changed_values(found["first"], Watch(), None) is found["first"]
    for left_alone in (SimpleNamespace(problem=SimpleNamespace(open_ground=True)), None):
        alone: Any = Diagnosis(first, "", session, search=left_alone)  # type: ignore[arg-type]
        monkeypatch.setattr(module, "with_changed_values", lambda *_: pytest.fail("asked"))
        assert module._with_changed_values(alone, Watch(), None) is alone


@pytest.mark.parametrize(("explained", "goes_on"), [(-np.inf, False), (-812.3, True)])
def test_a_search_for_what_explains_the_runs_ends_where_no_named_effect_does(
    explained: float, goes_on: bool, done: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, "none", open_ground=False)
    monkeypatch.setattr(NAMED, "explained", explained)
    found = module._searched(session_of(4), no_progress, None, only_if_explained=True)  # type: ignore[arg-type]
    assert found.verdict == ("none" if goes_on else "insufficient")
    assert [step for step, *_ in done] == (ON_PLATE if goes_on else ON_PLATE[:1])
