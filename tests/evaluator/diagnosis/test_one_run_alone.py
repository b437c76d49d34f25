"""A finding that depends on a single run: the run is excluded as outlying, or the runs do not decide."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis import diagnosis as module
from evaluator.diagnosis.diagnosis import diagnose
from evaluator.diagnosis.experiment import Session
from evaluator.diagnosis.mistakes.recognised import Correction, Mistake
from evaluator.diagnosis.result import Diagnosis
from evaluator.progress import no_progress

TILT = frozenset({"plate-tilt"})
ODD = 3


def session_of(runs: int) -> Session:
    data: Any = tuple(SimpleNamespace(id=f"r{number}") for number in range(runs))
    return Session(data, (None,) * runs, {})  # type: ignore[arg-type]


ON_PLATE: Any = SimpleNamespace(problem=SimpleNamespace(open_ground=False), tolerance={})


def finding(verdict: Any, reason: str = "so", runs: int = 12, **said: Any) -> Diagnosis:
    """A diagnosis of a search on a plate, of which a single run may be the cause."""
    return Diagnosis(verdict, reason, session_of(runs), search=ON_PLATE, terms={}, **said)


def around(
    monkeypatch: pytest.MonkeyPatch,
    *,
    similar: bool = True,
    followed: bool = False,
    suspect: int | None = ODD,
    without: float = 2.0,
) -> None:
    """One run is suspected, with similar ones or not, and followed by the others or not, whose log odds are given."""
    fit = SimpleNamespace(point=SimpleNamespace(nominal={}, per_run=None), runs=tuple(range(12)))
    monkeypatch.setattr(Diagnosis, "fit", fit)
    sole = None if suspect is None else SimpleNamespace(run=suspect, without=without)
    monkeypatch.setattr(module, "sole_run", lambda *_: sole)
    monkeypatch.setattr(module, "has_similar_runs", lambda *_: similar)
    monkeypatch.setattr(module, "turns_like_others", lambda *_: True)
    monkeypatch.setattr(module, "is_followed", lambda *_: followed)
    monkeypatch.setattr(module, "is_needed_without", lambda *_: False)
    monkeypatch.setattr(module, "shortcomings", lambda _: [])
    monkeypatch.setattr(module, "varied_robot", lambda *_: None)
    monkeypatch.setattr(
        module, "withdrawn", lambda found, why: replace(found, verdict="insufficient", reason=why, chosen=frozenset())
    )
    monkeypatch.setattr(module, "outlying_run", lambda run, *_: Mistake((run.id,), "outlying", f"{run.id} alone"))


def diagnosed(
    monkeypatch: pytest.MonkeyPatch,
    whole: Diagnosis,
    rest: Diagnosis,
    *,
    similar: bool,
    followed: bool = False,
    without: float = 2.0,
) -> Diagnosis:
    """The diagnosis of 12 runs, one of which is suspected, where the others say rest, which follows it or not."""
    around(monkeypatch, similar=similar, followed=followed, without=without)
    monkeypatch.setattr(
        module, "diagnosed", lambda asked, *_: whole if len(asked.data) == len(whole.session.data) else rest
    )
    return diagnose(whole.session, no_progress)


NOTHING = Diagnosis("none", "explained", session_of(11), search=ON_PLATE)


@pytest.mark.parametrize(
    ("verdict", "similar", "said"),
    [
        ("unknown", True, "none"),  # a matter of that run
        ("unknown", False, "insufficient"),  # of the run, or of the only drive of its kind
        ("effect", True, "none"),
        ("effect", False, "effect"),  # named by its law, which may act in such a drive only; the reason says so
    ],
)
def test_what_others_do_not_need_is_no_physics_unless_no_other_drives_alike(
    monkeypatch: pytest.MonkeyPatch, verdict: Any, similar: bool, said: str
) -> None:
    chosen = TILT if verdict == "effect" else frozenset[str]()
    found = diagnosed(monkeypatch, finding(verdict, chosen=chosen), NOTHING, similar=similar)
    assert found.verdict == said
    assert ("the evidence rests on r3 alone, and no other run has a similar command" in found.reason) == (not similar)
    assert [item.runs for item in found.session.mistakes] == ([] if said == "effect" else [("r3",)])


@pytest.mark.parametrize(
    ("excess", "chosen", "outlying", "verdict", "said"),
    [
        (1.0, frozenset[str](), (), "unknown", "insufficient"),
        (1.2, frozenset[str](), (), "unknown", "unknown"),  # more than noise is left in the others
        (1.0, TILT, (), "unknown", "unknown"),
        (1.0, frozenset[str](), (2,), "unknown", "unknown"),
        (1.0, frozenset[str](), (), "effect", "effect"),
    ],
)
def test_others_that_decide_nothing_but_leave_noise_show_that_one_run_is_odd(
    monkeypatch: pytest.MonkeyPatch, excess: float, chosen: frozenset[str], outlying: Any, verdict: Any, said: str
) -> None:
    """A pushed run, 0.36 mm off where ten others leave noise, was missing physics: their friction differs by 18 %."""
    rest = replace(NOTHING, verdict="insufficient", chosen=chosen, outlying=outlying)
    rest = replace(rest, leftover=SimpleNamespace(excess=excess))  # type: ignore[arg-type]
    found = diagnosed(monkeypatch, finding(verdict, chosen=TILT), rest, similar=True)
    assert found.verdict == said
    assert [item.runs for item in found.session.mistakes] == ([("r3",)] if said == "insufficient" else [])


@pytest.mark.parametrize(
    ("kind", "corrected", "said"),
    [
        ("wrong-command", True, "none"),  # exactly that of another run
        ("wrong-command", False, "insufficient"),  # about so fast
        ("mirrored", True, "insufficient"),
    ],
)
def test_a_run_that_moves_by_the_command_of_another_is_no_drive_of_its_own(
    monkeypatch: pytest.MonkeyPatch, kind: Any, corrected: bool, said: str
) -> None:
    """A run with a slip of the keyboard in its command was named as that, and yet nothing was decided by the others."""
    corrections = {"r3": Correction(command=(-33.3, -14.4))} if corrected else {}
    whole = finding("unknown")
    around(monkeypatch, similar=False)
    read = Mistake(("r3",), kind, "r3 moves so", False, (), corrections)
    monkeypatch.setattr(module, "outlying_run", lambda *_: read)
    monkeypatch.setattr(module, "diagnosed", lambda asked, *_: whole if len(asked.data) == 12 else NOTHING)
    assert diagnose(whole.session, no_progress).verdict == said


@pytest.mark.parametrize("followed", [False, True])
def test_a_law_that_one_run_alone_needs_and_the_others_deny_is_no_finding(
    monkeypatch: pytest.MonkeyPatch, *, followed: bool
) -> None:
    """A stray magnet of 81 log odds from one slow pivot was named, against which the other 15 runs spoke with 9."""
    whole = finding("effect", chosen=TILT)
    found = diagnosed(monkeypatch, whole, NOTHING, similar=False, followed=followed, without=0.0)
    rests = "rests on r3 alone, and no other run has a similar command: repeat that run"
    said = f"the model is contradicted, but the evidence for plate-tilt {rests}"
    assert (found.verdict, found.reason, found.chosen) == ("insufficient", said, frozenset())
    others = finding("unknown", "too", runs=11)
    found = diagnosed(monkeypatch, whole, others, similar=False, followed=followed, without=0.0)
    assert (found.verdict, found.reason, found.chosen) == ("insufficient", said, frozenset())
    stands = diagnosed(monkeypatch, whole, NOTHING, similar=False, without=1e-9)
    assert (stands.verdict, stands.reason) == ("effect", f"so; the evidence {rests}")


def test_what_the_others_need_as_well_does_not_rest_on_one_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """All runs above 50 rpm were slow, and the only one with its command was told to be the sole evidence."""
    rest = finding("unknown", "too", runs=11)
    found = diagnosed(monkeypatch, finding("unknown", "so"), rest, similar=False)
    assert (found.verdict, found.reason, found.session.mistakes) == ("unknown", "so", ())


def test_such_a_law_is_no_finding_once_as_many_runs_are_left_out_as_may_go_wrong(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rest = finding("effect", "it pays", runs=11, chosen=TILT)
    found = diagnosed(monkeypatch, finding("unknown"), rest, similar=True, without=-9.0)
    rests = "rests on r3 alone, and others are left out already: repeat these runs"
    said = f"the model is contradicted, but the evidence for plate-tilt {rests}"
    assert (found.verdict, found.reason, found.chosen) == ("insufficient", said, frozenset())
    assert [item.runs for item in found.session.mistakes] == [("r3",)]
    supported = diagnosed(monkeypatch, finding("unknown"), rest, similar=True, without=1.0)
    assert (supported.verdict, supported.chosen) == ("effect", TILT)


def test_what_the_others_show_beside_such_a_law_is_found_and_the_run_is_to_be_repeated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = finding("effect", chosen=TILT | {"stray-magnet"})
    rest = Diagnosis("effect", "it pays", session_of(11), search=ON_PLATE, chosen=TILT)
    around(monkeypatch, similar=False)
    sole = SimpleNamespace(run=ODD, without=-9.0)
    monkeypatch.setattr(module, "sole_run", lambda _, chosen, __: sole if chosen == whole.chosen else None)
    monkeypatch.setattr(module, "diagnosed", lambda asked, *_: whole if len(asked.data) == 12 else rest)
    found = diagnose(whole.session, no_progress)
    assert (found.verdict, found.chosen) == ("effect", TILT)
    (odd,) = found.session.mistakes
    assert odd.sentence.endswith(f"r3 alone; {ONLY}")


def test_a_run_that_no_fit_follows_is_excluded_though_the_others_show_the_effect_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rest = Diagnosis("effect", "it pays", session_of(11), search=ON_PLATE, chosen=TILT)
    for outlying, named in (((ODD,), [("r3",)]), ((), [])):
        whole = finding("effect", "it pays", chosen=TILT, outlying=outlying)
        found = diagnosed(monkeypatch, whole, rest, similar=True)
        assert (found.verdict, [item.runs for item in found.session.mistakes]) == ("effect", named)


@pytest.mark.parametrize("turns_alike", [True, False])
def test_an_effect_that_only_the_exclusion_of_the_one_opposite_turn_shows_is_none(
    monkeypatch: pytest.MonkeyPatch, *, turns_alike: bool
) -> None:
    """Of three sharp turns with wrong commands the only right turn was left out, and one-sided magnets were named."""
    rest = Diagnosis("effect", "it pays", session_of(11), search=ON_PLATE, chosen=TILT)
    around(monkeypatch)
    monkeypatch.setattr(module, "turns_like_others", lambda *_: turns_alike)
    whole = finding("unknown")
    monkeypatch.setattr(module, "diagnosed", lambda asked, *_: whole if len(asked.data) == 12 else rest)
    found = diagnose(whole.session, no_progress)
    assert found.verdict == ("effect" if turns_alike else "unknown")
    only = "so; plate-tilt explains all runs but r3, the only one that turns this way: repeat that run"
    assert (found.reason == only) == (not turns_alike)


@pytest.mark.parametrize("followed", [True, False])
def test_runs_that_the_second_search_leaves_out_stay_out_of_the_answer(
    followed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The results by run are those of its session: a report of more runs than results ended in an IndexError."""
    less = session_of(11).leaving_out([4, 5], "diverges")
    whole = finding("unknown")
    found = diagnosed(
        monkeypatch, whole, Diagnosis("none", "explained", less, search=ON_PLATE), similar=True, followed=followed
    )
    assert found.session.data == less.data
    assert {"r4", "r5"} <= found.session.left_out.keys()
    assert [item.runs for item in found.session.mistakes] == ([] if followed else [("r3",)])


def test_a_run_that_the_others_follow_is_left_out_and_not_called_mistaken(monkeypatch: pytest.MonkeyPatch) -> None:
    both = TILT | {"friction-gradient"}
    rest = Diagnosis("effect", "it pays", session_of(11), search=ON_PLATE, chosen=TILT)
    found = diagnosed(monkeypatch, finding("effect", chosen=both), rest, similar=True, followed=True)
    assert (found.verdict, found.chosen, found.session.mistakes) == ("effect", TILT, ())
    why = "it alone needs friction-gradient, because it was disturbed or shows the effect best; repeat it"
    assert found.session.left_out == {"r3": why}


@pytest.mark.parametrize(("outlying", "suspect"), [((ODD,), ODD), ((1, ODD), None), ((), None)])
def test_the_one_run_that_is_not_followed_is_suspected(
    monkeypatch: pytest.MonkeyPatch, outlying: tuple[int, ...], suspect: int | None
) -> None:
    monkeypatch.setattr(module, "sole_run", lambda *_: None)
    search: Any = SimpleNamespace(problem=SimpleNamespace(open_ground=False))
    found = Diagnosis("unknown", "so", session_of(12), search=search, terms={}, outlying=outlying)
    assert module._sole_run_of(found) == suspect


@pytest.mark.parametrize("follows", [True, False])
def test_wheel_speeds_by_a_model_that_follows_no_run_make_none_suspect(
    monkeypatch: pytest.MonkeyPatch, *, follows: bool
) -> None:
    monkeypatch.setattr(module, "sole_run", lambda *_: None)
    monkeypatch.setattr(module, "sole_misfit", lambda *_: None)
    monkeypatch.setattr(module, "sole_gains", lambda *_: ODD)
    on_plate = SimpleNamespace(open_ground=False)
    whole: Any = SimpleNamespace(fits={frozenset(): SimpleNamespace(runs=(*range(12),))}, problem=on_plate)
    left: Any = SimpleNamespace()
    found = Diagnosis(
        "unknown", "so", session_of(12), search=whole, terms={}, outlying=(*range(9),), follows=follows, leftover=left
    )
    assert module._sole_run_of(found) == (ODD if follows else None)


@pytest.mark.parametrize(("runs", "excluded"), [(7, 1), (19, 1), (20, 2), (30, 3)])
def test_one_run_of_ten_may_be_excluded(monkeypatch: pytest.MonkeyPatch, runs: int, excluded: int) -> None:
    """Without each run one effect less is found."""
    around(monkeypatch, suspect=0)
    monkeypatch.setattr(
        module,
        "diagnosed",
        lambda session, *_: replace(
            finding("effect", chosen=frozenset(f"effect {number}" for number in range(len(session.data)))),
            session=session,
        ),
    )
    assert len(diagnose(session_of(runs), no_progress).session.data) == runs - excluded


def test_a_run_is_kept_where_the_others_say_no_more_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = finding("unknown", chosen=frozenset({"free:x"}))
    rest = Diagnosis("unknown", "so as well", session_of(11), search=ON_PLATE)
    assert diagnosed(monkeypatch, whole, rest, similar=True) is whole
    other = Diagnosis("effect", "so", session_of(11), search=ON_PLATE, chosen=frozenset({"command-lag"}))
    effect = finding("effect", chosen=TILT)
    assert diagnosed(monkeypatch, effect, other, similar=True) is effect  # another effect is no simpler one


def test_a_run_is_kept_without_which_too_few_remain(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = finding("unknown")
    diagnosed(monkeypatch, whole, NOTHING, similar=True)
    monkeypatch.setattr(module, "shortcomings", lambda _: ["too few"])
    assert diagnose(whole.session, no_progress) is whole


def test_no_run_is_suspected_on_open_ground(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "sole_run", lambda *_: SimpleNamespace(run=ODD))
    for on_ground, suspect in ((True, None), (False, ODD)):
        search: Any = SimpleNamespace(problem=SimpleNamespace(open_ground=on_ground))
        found = Diagnosis("effect", "so", session_of(12), search=search, terms={}, chosen=TILT)
        assert module._sole_run_of(found) == suspect


def test_a_run_whose_wheels_turn_otherwise_is_described_by_them(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[Any] = []

    def described(run: Any, _others: Any, _robot: Any, gains: Any) -> Mistake:
        told.append(gains)
        return Mistake((run.id,), "outlying", "odd")

    left: Any = SimpleNamespace(random_effects=np.arange(48.0).reshape(12, 4))
    for sole, gains in ((None, None), (ODD, (13.0, 14.0))):  # left and right, of friction, left, right and start
        monkeypatch.setattr(module, "sole_gains", lambda *_, sole=sole: sole)
        whole = finding("unknown", leftover=left)
        diagnosed(monkeypatch, whole, NOTHING, similar=True)
        monkeypatch.setattr(module, "outlying_run", described)
        diagnose(whole.session, no_progress)
        assert told[-1] == gains


ONLY = "no other run has a similar command, so that an effect may act there alone: repeat it"


@pytest.mark.parametrize("rest", ["none", "effect", "unknown"])
@pytest.mark.parametrize("similar", [True, False])
def test_a_run_with_other_wheel_speeds_is_excluded_whatever_the_others_show(
    monkeypatch: pytest.MonkeyPatch, rest: Any, *, similar: bool
) -> None:
    """A speed of 60 rpm in a run whose file says 50 was accepted as scatter of the wheels of all runs."""
    around(monkeypatch, suspect=None, similar=similar)
    monkeypatch.setattr(module, "hiding_run", lambda _, runs, __: ODD if len(runs) == 12 else None)
    monkeypatch.setattr(module, "outlying_run", lambda run, _, __, gains: Mistake((run.id,), "outlying", f"{gains}"))
    left: Any = SimpleNamespace(random_effects=np.arange(48.0).reshape(12, 4))
    whole = finding("none", leftover=left)
    less = Diagnosis(rest, "by the others", session_of(11), search=ON_PLATE, terms={})
    monkeypatch.setattr(module, "diagnosed", lambda asked, *_: whole if len(asked.data) == 12 else less)
    found = diagnose(whole.session, no_progress)
    assert found.verdict == rest
    assert [item.sentence for item in found.session.mistakes] == ["(13.0, 14.0)" + ("" if similar else f"; {ONLY}")]


@pytest.mark.parametrize("needed", [True, False])
def test_the_others_are_not_diagnosed_if_they_need_the_same_free_form_term(
    monkeypatch: pytest.MonkeyPatch, *, needed: bool
) -> None:
    around(monkeypatch)
    families = []
    monkeypatch.setattr(module, "is_needed_without", lambda *said: (families.append(said[3]), needed)[1])
    asked = []
    whole = finding("unknown", chosen=frozenset({"free:x"}))
    whole = replace(whole, terms=dict.fromkeys(("free:x", "free:y", "plate-tilt")))
    monkeypatch.setattr(module, "diagnosed", lambda session, *_: asked.append(len(session.data)) or whole)
    assert diagnose(whole.session, no_progress).verdict == "unknown"
    assert asked == ([12] if needed else [12, 11])
    assert families == [2]  # of free-form terms, whose number counts in the prior of each
