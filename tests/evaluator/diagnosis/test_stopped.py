"""A search that its time stopped has decided nothing, and says what it had found."""

from __future__ import annotations

import threading
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.diagnosis import diagnosis as module
from evaluator.diagnosis.diagnosis import diagnose
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.inference import watch as watch_module
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.inference.watch import Cores, SearchStoppedError, Watch
from evaluator.diagnosis.output.diagnosis_json import record
from evaluator.diagnosis.result import Diagnosis
from evaluator.progress import no_progress

TILT = frozenset({"plate-tilt"})


def session_of(runs: int) -> Session:
    data: Any = tuple(SimpleNamespace(id=f"r{number}") for number in range(runs))
    return Session(data, (None,) * runs, {})  # type: ignore[arg-type]


def test_a_watch_whose_time_is_over_says_what_was_found() -> None:
    watch = Watch(seconds=0.0)
    watch.so_far = "the tilt explains the runs"
    with pytest.raises(SearchStoppedError, match=r"after 0 s of processor time.*; so far, the tilt explains the runs"):
        watch.look()


def test_a_search_that_explains_the_runs_has_twice_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter([0.0, 7.0, 7.0, 13.9, 14.0])
    monkeypatch.setattr(watch_module, "process_time", lambda: next(now))
    watch = Watch(seconds=7.0)
    with pytest.raises(SearchStoppedError, match="after 7 s"):
        watch.look()
    watch.explained = True
    watch.look()
    watch.look()
    with pytest.raises(SearchStoppedError, match="after 14 s"):
        watch.look()


@pytest.mark.parametrize(
    ("excess", "words"), [(1.1, "explains the runs (its"), (1.6, "does not explain the runs: its")]
)
def test_what_was_found_is_the_most_probable_model_and_what_it_leaves(excess: float, words: str) -> None:
    def fit(log_evidence: float) -> Any:
        return SimpleNamespace(posterior=SimpleNamespace(log_evidence=log_evidence), excess=excess)

    terms: Any = {"plate-tilt": None, "mass-offset": None}
    search = Search(SimpleNamespace(), terms, {}, (0, 1), fits={frozenset(): fit(0.0), TILT: fit(40.0)})  # type: ignore[arg-type]
    assert search.so_far.startswith(f"of 2 fitted models the most probable is plate-tilt, which {words} residuals are")
    search.fits[TILT] = fit(-40.0)
    assert "the model without an effect" in search.so_far


def test_an_effect_that_rests_on_one_run_is_no_verdict_where_the_search_without_it_was_stopped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    session = session_of(20)
    on_plate: Any = SimpleNamespace(problem=SimpleNamespace(open_ground=False))
    whole = Diagnosis("effect", "it pays", session, chosen=TILT, search=on_plate, terms={})
    rest = Diagnosis("insufficient", "the search was stopped", session_of(19), stopped=True)
    monkeypatch.setattr(module, "diagnosed", lambda asked, *_: whole if len(asked.data) == 20 else rest)
    monkeypatch.setattr(module, "sole_run", lambda *_: SimpleNamespace(run=3))
    monkeypatch.setattr(module, "has_similar_runs", lambda *_: True)
    monkeypatch.setattr(module, "shortcomings", lambda _: [])
    found = diagnose(session, no_progress)
    assert (found.verdict, found.stopped, found.search) == ("insufficient", True, None)
    assert record(found).get("stopped") is True
    assert "stopped" not in record(replace(found, stopped=False))
    assert "the finding with r3, effect (plate-tilt), rests on this run alone" in found.reason


def test_threads_of_a_diagnosis_end_with_it_and_results_keep_their_order() -> None:
    before = threading.active_count()
    with Cores(2) as each:
        assert list(each(lambda item: item**2, range(5))) == [0, 1, 4, 9, 16]
        assert threading.active_count() > before
    assert threading.active_count() == before
    assert list(each(lambda item: -item, range(3))) == [0, -1, -2]
