"""From an answer to the verdict: its gap, the runs that it misses, and what contradicts it, with stand-ins."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis import review
from evaluator.diagnosis.assessment.gap import other_turns
from evaluator.diagnosis.likelihood.point import Point
from evaluator.diagnosis.result import Diagnosis
from evaluator.settings import Relevant

TILT, FREE = frozenset({"plate-tilt"}), frozenset({"free:x"})
NOMINAL, FITTED, PER_RUN = (
    Point(np.zeros((4, 7))),
    Point(np.ones((4, 7)), {"start": 0.2, "body.mass_g": 0.1}),
    np.ones((4, 7)),
)


def reviewed(
    monkeypatch: pytest.MonkeyPatch,
    gaps_mm: list[float],
    *,
    chosen: frozenset[str] = TILT,
    held_out: tuple[int, ...] = (),
    beat: str | None = None,
    of_robot: bool = True,
    after_changes: str | None = None,
    by_rival: bool = False,
    open_ground: bool = False,
    before_mm: float = 9.0,
    predicted_mm: tuple[float, float, float, float] = (5.0, 5.0, 5.0, 5.0),
) -> tuple[Diagnosis, dict[str, Any]]:
    """The review of an answer over four runs whose marks it misses by these gaps, and what it began from.

    A run counts as followed within 1 mm; one run of four may be odd.
    """
    session: Any = SimpleNamespace(data=(0,) * 4, robots=("robot",) * 4, known=(5,), one_frame=True)
    problem: Any = SimpleNamespace(of_tracking=SimpleNamespace(), open_ground=open_ground)
    fit = SimpleNamespace(point=FITTED, posterior=SimpleNamespace(scatter=np.ones(4)))
    part: Any = SimpleNamespace(problem=problem, fits={chosen: fit})
    everything: Any = SimpleNamespace(fits={chosen: fit})
    began: dict[str, Any] = {}
    gaps = iter([np.array(gaps_mm), np.array(gaps_mm), np.full(4, before_mm)])
    predicted = iter([(np.array(predicted_mm), {0: "before"}), (np.array(predicted_mm) - 1.0, {1: "after"})])

    def started(_: Any, point: Point, *__: Any) -> str:
        began["gap" if "before" in began else "before"] = point
        return "started"

    parts: dict[str, Any] = {
        "place_runs": lambda _, point, *__: point,
        "place_starts": started,
        "run_gaps": lambda *_: next(gaps),
        "noise_floor": lambda *_: np.full(4, 0.1),
        "farthest_followed": lambda *_: np.full(4, 1.0),
        "pieces": lambda _, point, **__: f"pieces of {point if isinstance(point, str) else 'the fit'}",
        "counting_data": lambda _: "data",
        "as_driven": lambda data, known, _: (data, known),
        "with_session": lambda robot, *_: robot,
        "corrected_robot": lambda robot, *_: f"{robot} with it",
        "predicted_gaps": lambda _, robots, __: began.setdefault("robots", []).append(robots[0]) or next(predicted),
        "confirmation": lambda *_: 7.0,
        "most_telling": lambda seen: [f"most of {seen}"],
        "dependences": lambda seen: [f"all of {seen}"],
        "every_dependence": lambda seen: [f"every of {seen}"],
        "as_taken": lambda item: f"{item} as taken",
        "rhythm": lambda *_: beat,
        "is_of_robot": lambda *_: of_robot,
        "transient": lambda *_: after_changes,
        "_is_open_by_rival": lambda _: by_rival,
        "_doubted": lambda found, course: began.update(course=course) or found,
    }
    for name, part_of in parts.items():
        monkeypatch.setattr(review, name, part_of)
    found = Diagnosis(
        "effect" if chosen else "none",
        "so",
        session,
        held_out,
        chosen=chosen,
        terms={},
        known=(SimpleNamespace(quantity="level"),),
    )  # type: ignore[arg-type]
    more = {"fit_search": part, "search": everything, "known_together": "together", "nominal": NOMINAL}
    found = Diagnosis(**{**vars(found), **more})
    return review.reviewed(found), began


def test_a_review_tells_the_gap_before_and_after_and_what_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    found, began = reviewed(monkeypatch, [0.2, 0.3, 1.1, 0.2], held_out=(3,))
    assert found.gap is not None
    assert found.gap.before_mm.tolist() == [9.0] * 4
    assert found.gap.after_mm.tolist() == [0.2, 0.3, 1.1, 0.2]
    assert (found.gap.predicted_before_mm[0], found.gap.predicted_after_mm[0]) == (5.0, 4.0)
    assert found.gap.not_predicted == {0: "before", 1: "after"}
    assert began["robots"] == ["robot", "robot with it"]
    assert (found.outlying, found.follows, found.confirmation) == ((2,), True, 7.0)
    np.testing.assert_array_equal(began["before"].per_run, PER_RUN)
    assert began["before"].nominal == {}
    # the gap is that of the robot: the start of motion is that of the session, as in the predicted one
    np.testing.assert_array_equal(began["gap"].per_run, PER_RUN)
    assert began["gap"].nominal == {"start": 0.2}
    assert (found.pieces, found.pieces_after) == ("pieces of started", "pieces of the fit")
    assert (found.where, found.left) == (("most of pieces of started",), ("every of pieces of the fit",))
    assert (found.known, found.known_together) == ((SimpleNamespace(quantity="level"),), "together")


def test_on_open_ground_a_run_that_took_another_turn_counts_in_no_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither refitted, where no model follows it, nor predicted, where both predictions are ten times as far off."""
    gaps = [0.2, 0.3, 1.1, 0.2]
    found, _ = reviewed(monkeypatch, gaps, open_ground=True, predicted_mm=(5.0, 5.0, 5.0, 42.0))
    assert found.gap is not None
    assert (found.gap.elsewhere, found.outlying) == ((2,), (2,))
    assert found.gap.not_predicted == {
        0: "before", 1: "after", 3: "the prediction takes another turn, 41 mm away, before and after",
    }  # fmt: skip
    assert np.isnan([found.gap.predicted_before_mm[3], found.gap.predicted_after_mm[3]]).all()
    assert found.gap.predicted_after_mm[:3].tolist() == [4.0] * 3
    assert found.gap.rms(found.gap.after_mm, range(4)) == pytest.approx(np.sqrt((0.2**2 + 0.3**2 + 0.2**2) / 3))
    for changes in ({}, {"open_ground": True, "before_mm": 0.9}):  # a plate; a run that the effect loses
        found, _ = reviewed(monkeypatch, gaps, **changes)  # type: ignore[arg-type]
        assert found.gap is not None
        assert found.gap.elsewhere == ()


def test_a_prediction_takes_another_turn_if_it_is_ten_times_as_far_off_as_most_before_and_after() -> None:
    before, after = np.array([1.0, 2.0, 3.0, 19.0, 30.0, 99.0]), np.array([1.0, 2.0, 50.0, 30.0, 21.0, np.nan])
    assert list(other_turns(before, after)) == []  # three is usual
    after[2:4] = 2.0
    assert list(other_turns(before, after)) == [4]  # two is
    assert other_turns(np.full(2, np.nan), np.full(2, np.nan)) == {}


def test_values_of_a_model_that_misses_more_runs_than_may_be_odd_mean_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    found, began = reviewed(monkeypatch, [0.2, 1.1, 1.1, 0.2])
    assert (found.outlying, found.follows) == ((1, 2), False)
    assert began["before"] is NOMINAL
    assert (found.known, found.known_together) == (("level as taken",), None)
    assert np.isnan(found.confirmation)  # no run was held out


def test_where_nothing_is_added_all_dependences_are_told_and_the_gap_after_is_that_of_the_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, _ = reviewed(monkeypatch, [20.0, 0.2, 20.0, 0.2], chosen=frozenset(), held_out=(3,))
    assert found.gap is not None
    assert found.gap.after_mm.tolist() == found.gap.before_mm.tolist()
    assert found.where == ("all of pieces of started",)
    assert np.isnan(found.confirmation)


@pytest.mark.parametrize("chosen", [TILT, frozenset[str]()])
@pytest.mark.parametrize("of_robot", [True, False])
def test_an_oscillation_of_the_robot_is_told_first_and_one_of_the_camera_not(
    monkeypatch: pytest.MonkeyPatch, chosen: frozenset[str], *, of_robot: bool
) -> None:
    found, began = reviewed(monkeypatch, [0.2] * 4, chosen=chosen, beat="0.9 Hz", of_robot=of_robot)
    assert (found.where[0] == "0.9 Hz") == of_robot
    assert began["course"] == ("0.9 Hz" if of_robot else None)


@pytest.mark.parametrize(("beat", "of_robot", "told"), [("0.9 Hz", True, 0), ("0.9 Hz", False, 1), (None, True, 1)])
def test_what_follows_each_change_of_the_command_is_told_where_no_rhythm_is(
    monkeypatch: pytest.MonkeyPatch, beat: str | None, told: int, *, of_robot: bool
) -> None:
    found, began = reviewed(monkeypatch, [0.2] * 4, beat=beat, of_robot=of_robot, after_changes="it rings")
    assert found.where[0] == began["course"] == ("0.9 Hz", "it rings")[told]


def test_a_course_that_no_rival_explains_ends_what_only_the_rival_leaves_open(monkeypatch: pytest.MonkeyPatch) -> None:
    course: Any = SimpleNamespace(sentence="it rings")
    found, began = reviewed(monkeypatch, [0.2] * 4, after_changes=course, by_rival=True)
    assert (found.verdict, found.reason) == ("unknown", "it rings")
    assert "course" not in began  # nothing else is asked
    found, began = reviewed(monkeypatch, [0.2] * 4, by_rival=True)
    assert (found.verdict, began["course"]) == ("effect", None)


@pytest.mark.parametrize(
    ("verdict", "few", "reason", "left", "is_open"),
    [
        ("insufficient", "", "odds of 9 to 1", True, True),
        ("none", "", "odds of 9 to 1", True, False),
        ("insufficient", "too few", "odds of 9 to 1", True, False),
        ("insufficient", "", "the search was stopped", True, False),
        ("insufficient", "", "odds of 9 to 1", False, False),  # the rival explains it
    ],
)
def test_a_verdict_is_open_by_a_rival_that_leaves_the_course_as_well(
    verdict: Any, few: str, reason: str, monkeypatch: pytest.MonkeyPatch, *, left: bool, is_open: bool
) -> None:
    fits = {TILT: "its fit"}
    monkeypatch.setattr(review, "too_few_runs", lambda *_: few)
    monkeypatch.setattr(review, "undecided", lambda *_: (TILT, "odds of 9 to 1"))
    monkeypatch.setattr(review, "_placed", lambda _, fit: fit)
    monkeypatch.setattr(review, "_shared_course", lambda _, fit: fit if left and fit == "its fit" else None)
    found: Any = SimpleNamespace(
        verdict=verdict, reason=reason, standing="table", search=SimpleNamespace(fits=fits), session="session"
    )
    assert review._is_open_by_rival(found) == is_open


def doubted(
    monkeypatch: pytest.MonkeyPatch,
    found: Diagnosis,
    *,
    missed: str = "",
    grown: str = "",
    few: str = "",
    beyond: float = 0.51,
    beat: str = "",
) -> Diagnosis:
    """What is left of an answer where residuals, the gap, or the number of runs speak against it."""
    monkeypatch.setattr(review, "unexplained", lambda *_: SimpleNamespace(sentence=missed) if missed else None)
    monkeypatch.setattr(review, "beyond_noise", lambda *_: beyond)
    monkeypatch.setattr(review, "grown_gap", lambda *_, **__: grown)
    monkeypatch.setattr(review, "not_shrunk", lambda *_: grown)
    monkeypatch.setattr(review, "too_few_runs", lambda *_: few)
    monkeypatch.setattr(review, "reviewed", lambda again: again)
    monkeypatch.setattr(review, "covariance_of", lambda *_: "of commands")
    for name in ("knowledge", "together", "adequacy"):
        monkeypatch.setattr(review, name, lambda *given, name=name: (f"{name} of {given[name == 'knowledge']}",))
    return review._doubted(found, SimpleNamespace(sentence=beat) if beat else None)  # type: ignore[arg-type]


def answered(verdict: Any, chosen: frozenset[str], **more: Any) -> Diagnosis:
    runs = more.pop("runs", ())
    parts: Any = {"session": SimpleNamespace(relevant=Relevant(), data=runs, known="known"), "gap": "gap"}
    problem = SimpleNamespace(open_ground=False)
    parts["search"] = SimpleNamespace(problem=problem, fits={chosen: "fit"}, null="null", tolerance={})
    return Diagnosis(verdict, "so", chosen=chosen, **parts, **more)


@pytest.mark.parametrize(
    ("verdict", "against", "said", "reason", "kept"),
    [
        ("none", {}, "none", "so", True),
        ("none", {"missed": "yaw"}, "unknown", "significant residuals remain", True),
        ("none", {"missed": "yaw", "few": "too few"}, "insufficient", "yaw; too few", False),
        ("none", {"grown": "grows"}, "none", "so", True),  # nothing was added
        ("effect", {}, "effect", "so", True),
        ("effect", {"grown": "grows"}, "unknown", "grows", True),
        (
            "effect",
            {"grown": "with it, grows", "few": "too few"},
            "insufficient",
            "with plate-tilt, grows; too few",
            False,
        ),
        ("effect", {"missed": "yaw"}, "effect", "so", True),
        ("effect", {"few": "too few"}, "effect", "so", True),
        ("none", {"beat": "it hunts"}, "unknown", "it hunts", True),
        ("effect", {"beat": "it hunts"}, "unknown", "it hunts", True),
        ("effect", {"beat": "it hunts", "grown": "grows"}, "unknown", "grows", True),
        ("insufficient", {"beat": "it hunts"}, "insufficient", "so", True),
        ("unknown", {"grown": "grows"}, "unknown", "so; with free:x, the nearest description, grows", False),
        ("insufficient", {"missed": "yaw"}, "insufficient", "so", True),
    ],
)
def test_what_contradicts_an_answer(
    verdict: str, against: dict[str, str], said: str, reason: str, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = {"effect": TILT, "unknown": FREE}.get(verdict, frozenset())
    found = doubted(monkeypatch, answered(verdict, chosen), **against)
    assert (found.verdict, found.chosen) == (said, chosen if kept else frozenset())
    assert reason in found.reason
    if said == "insufficient" and against.get("few"):  # told of the model without effects
        known: Any = found.known
        assert (known, found.known_together) == (("knowledge of null",), ("together of null",))
        assert found.leftover == ("adequacy of null",)  # type: ignore[comparison-overlap]
    assert found.reason.startswith("with ") == reason.startswith("with ")


def test_a_model_that_follows_no_run_is_unknown_and_effects_that_do_not_matter_leave_no_doubt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = doubted(monkeypatch, answered("effect", TILT, follows=False))
    assert (found.verdict, found.reason.split(" ")[0]) == ("unknown", "neither")
    free = answered("unknown", FREE, follows=False, outlying=(0, 2), runs=(None,) * 3)
    found = doubted(monkeypatch, free)
    told = "even the most probable model does not follow 2 of the 3 runs within noise"
    assert (found.verdict, found.reason) == ("unknown", told)  # not that a free-form term explains them
    small = answered("none", TILT, negligible=TILT)
    assert doubted(monkeypatch, small, missed="yaw").verdict == "none"


def test_a_dependence_of_residuals_within_noise_is_told_and_contradicts_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = doubted(monkeypatch, answered("none", frozenset()), missed="yaw is off", beyond=0.49)
    assert found.verdict == "none"
    told = "all that remains together moves the marks by too little to matter"
    assert found.reason == f"so; detected, but {told}: yaw is off"


@pytest.mark.parametrize(("outlying", "said"), [((0, 1), "unknown"), ((0, 2), "effect")])
def test_an_effect_that_misses_all_runs_of_a_command_is_not_the_answer(
    outlying: tuple[int, ...], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(review, "unsigned_speeds", lambda run: run.id[0])
    runs = [SimpleNamespace(id=name) for name in ("a1", "a2", "b", "c", "d", "e")]
    found = doubted(monkeypatch, answered("effect", TILT, outlying=outlying, runs=runs))
    assert found.verdict == said
    assert ("2 of the 2 runs with the command of a1 (a1, a2;" in found.reason) == (said == "unknown")
