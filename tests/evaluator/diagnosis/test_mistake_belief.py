"""From where on another reading of a run is believed, from either side."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis.mistakes.misread import belief, hypotheses
from evaluator.diagnosis.mistakes.misread.alternatives import Alternative
from evaluator.diagnosis.mistakes.misread.belief import beyond_the_others, beyond_tolerances, turned_away
from evaluator.diagnosis.mistakes.misread.hypotheses import (
    MISFIT_SHARE,
    _judged,
    _judged_runs,
    _least_shares,
    _usual_kinds,
    misread_runs,
)
from evaluator.diagnosis.mistakes.misread.judgement import BETTER, FEWEST_SIMILAR, Judgement
from evaluator.diagnosis.mistakes.recognised import Correction, Found
from evaluator.interchange.commands import RunCommand
from simulator.command import Command
from tests.evaluator.diagnosis.straight_session import ROBOT, driven, kinds

RUN = driven(0)
WAYS = [Alternative(None, RUN), Alternative("reversed", RUN, "x"), Alternative("mirrored", RUN, "y")]


@pytest.mark.parametrize(
    ("misfits", "kind"),
    [
        ((1.6, 0.1, 9.0), "reversed"),
        ((1.4, 0.1, 9.0), None),  # less than 0.15 of an extent of 10 mm
        ((3.0, 0.99, 9.0), "reversed"),
        ((3.0, 1.01, 9.0), None),  # not three times better
        ((9.0, 0.125, 0.1), "reversed"),  # as good as the best, and the commoner
        ((9.0, 1.35, 1.0), "mirrored"),
        ((9.0, 1.25, 1.0), "reversed"),
        ((np.nan, 0.1, 0.1), None),
        ((9.0, np.nan, np.nan), None),
    ],
)
def test_a_mistake_is_believed_that_fits_three_times_better_than_a_file_that_fits_badly(
    misfits: tuple[float, ...], kind: str | None
) -> None:
    found = _judged(Judgement(WAYS, np.array(misfits), 10.0, ()), set())
    assert (None if found is None else found.kind) == kind


def test_of_mistakes_that_fit_alike_the_usual_one_is_told() -> None:
    near, far = (Judgement(WAYS, np.array(values), 10.0, ()) for values in ([9.0, 1.25, 1.0], [9.0, 5.0, 1.0]))
    assert _usual_kinds([near] * 3 + [far] * 4) == {"mirrored"}
    found = _judged(near, {"mirrored"})
    assert found is not None
    assert found.kind == "mirrored"
    assert found.equivalent == ("reversed",)
    assert _usual_kinds([Judgement(WAYS, np.array([1.4, 0.1, 0.1]), 10.0, ())] * 9) == set()


@pytest.mark.parametrize(("late", "told"), [(2, 2), (3, 0)])
def test_logs_that_are_late_in_most_runs_are_a_lag_and_none_of_them_is_told(
    late: int, told: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = RunCommand(Command.steps([(0.0, 30.0, 20.0)]), logged=True)
    data = [replace(driven(number), log=log) for number in range(4)]
    judgements = [
        Judgement(
            [Alternative(None, run), Alternative("late-start", run, "follows its log late", later_s=0.3)],
            np.array([9.0, 0.1 if number < late else 9.5]),
            10.0,
            ((10.0, 30.0 + number),),
        )
        for number, run in enumerate(data)
    ]
    monkeypatch.setattr(hypotheses, "_judged_runs", lambda *_: judgements)
    monkeypatch.setattr(belief, "misfit_within_tolerances", lambda *_: np.inf)
    assert kinds(misread_runs(data, [ROBOT] * 4)) == [(f"r{number}", "late-start") for number in range(told)]


@pytest.mark.parametrize(
    ("similar", "least"),
    [
        ([0.3], 0.15),  # one similar run says too little
        ([0.1, 0.2], 0.06),  # three times the worse of them, over an extent of 10 mm
        ([0.1, 0.9], 0.15),  # physics bends similar runs: no less than of a run without any
        ([0.1, np.nan], 0.15),
    ],
)
def test_a_run_is_judged_from_a_smaller_misfit_on_where_similar_runs_fit_their_file(
    similar: list[float], least: float
) -> None:
    one = Judgement(WAYS, np.array([1.0, 0.1, 9.0]), 10.0, ((5.0, 30.0),))
    pace = (1.0, 0.7)  # runs with the same ratio of speeds follow the same path
    others = [
        Judgement(WAYS, np.array([value, 9.0, 9.0]), 10.0, ((5.0 * part, 30.0 * part),))
        for value, part in zip(similar, pace, strict=False)
    ]
    stranger = Judgement(WAYS, np.array([9.0, 9.0, 9.0]), 10.0, ((5.0, 60.0),))
    assert _least_shares([one, *others, stranger])[0] == pytest.approx(least)
    assert (_judged(one, set(), least) is not None) == (least < 0.1)


@pytest.mark.parametrize("seed", range(20))
def test_each_run_is_compared_with_the_largest_misfit_of_all_others(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shares = rng.choice([0.002, 0.01, 0.04, 0.2, np.nan], size=rng.integers(2, 7), p=[0.3, 0.3, 0.2, 0.1, 0.1])
    runs = [Judgement(WAYS, np.array([10.0 * share, 0.1, 9.0]), 10.0, ((5.0, 30.0),)) for share in shares]
    expected = []
    for k in range(len(shares)):
        others = np.delete(shares, k)
        known = len(others) >= FEWEST_SIMILAR and np.isfinite(others).all()
        expected.append(min(MISFIT_SHARE, BETTER * others.max()) if known else MISFIT_SHARE)
    assert _least_shares(runs) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("kind", "least", "told"), [("reversed", 0.06, True), ("wrong-command", 0.06, False), ("wrong-command", 0.0, True)]
)
def test_beside_kin_that_fit_only_readings_count_that_change_no_speed(kind: Any, least: float, told: bool) -> None:
    ways = [Alternative(None, RUN), Alternative(kind, RUN, "x")]
    assert (_judged(Judgement(ways, np.array([1.0, 0.01]), 10.0, ()), set(), least) is not None) == told


def test_only_runs_that_misfit_their_file_or_follow_a_log_are_simulated_as_other_mistakes_would_have_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    log = RunCommand(Command.steps([(0.0, 30.0, 20.0)]), logged=True)
    data = [driven(0), driven(1), driven(2), replace(driven(3), log=log)]
    misfits = {"r0": 0.1, "r1": 9.0, "r2": np.nan, "r3": 0.1}  # of an extent of 10 mm

    def judged(ways: list[list[Alternative]], _: Any) -> list[Judgement]:
        ids = [way[0].run.id for way in ways]
        speeds = [((1.0, 2.0 + list(misfits).index(run)),) for run in ids]  # no two in the same ratio
        found = zip(ways, ids, speeds, strict=True)
        return [Judgement(way, np.full(len(way), misfits[run]), 10.0, pair) for way, run, pair in found]

    monkeypatch.setattr(hypotheses, "judgements_of", judged)
    monkeypatch.setattr(hypotheses, "MOST_AT_ONCE", 2)
    found = _judged_runs(data, [ROBOT] * 4, lambda k: [Alternative(None, data[k]), Alternative("mirrored", data[k])])
    assert [(item.ways[0].run.id, len(item.ways)) for item in found] == [("r0", 1), ("r1", 2), ("r2", 2), ("r3", 2)]


@pytest.mark.parametrize(
    ("runs", "odd", "reversed_", "read", "unread"),
    [
        (260, 260, 260, 260, False),  # all are compared with the mistake that explains a sample of 100
        (260, 260, 100, 100, True),  # a sample of 100 of which 38 fit it
        (260, 207, 0, 207, False),  # less than four in five disagree
        (250, 200, 0, 200, False),  # no more than are simulated at once
        (251, 201, 0, 100, True),
    ],
)
def test_of_hundreds_of_runs_that_disagree_a_sample_is_compared_with_all_mistakes_and_the_rest_with_common_ones(
    runs: int, odd: int, reversed_: int, read: int, unread: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of odd runs, reversed_ of all, evenly spread, drive backward."""
    data = [replace(RUN, id=f"r{k}") for k in range(runs)]
    backward = {f"r{k}" for k in range(odd) if k * reversed_ % odd < reversed_}
    kinds: tuple[Any, ...] = (None, "reversed", "mirrored")
    asked: dict[str, list[Any]] = {}

    def judged(ways: list[list[Alternative]], _: Any) -> list[Judgement]:
        found = []
        for of_run in ways:
            run = of_run[0].run.id
            asked[run] = [way.kind for way in of_run]
            back = 0.1 if run in backward else 9.0
            misfits = {None: 9.0 if int(run[1:]) < odd else 0.1, "reversed": back, "mirrored": 9.0}
            found.append(Judgement(of_run, np.array([misfits[way.kind] for way in of_run]), 10.0, ()))
        return found

    monkeypatch.setattr(hypotheses, "judgements_of", judged)
    monkeypatch.setattr(hypotheses, "thinned", lambda run: run)
    monkeypatch.setattr(hypotheses, "alternatives", lambda run, *_: [Alternative(kind, run, "x") for kind in kinds])
    monkeypatch.setattr(hypotheses, "speed_factors", lambda data, _: [None] * len(data))
    monkeypatch.setattr(hypotheses, "misfits_within_tolerances", lambda items, *_: [item.misfits_mm for item in items])
    monkeypatch.setattr(hypotheses, "beyond_tolerances", lambda found, *_: found)
    found = hypotheses.misread(data, [ROBOT] * runs)
    assert sum(len(tried) > 1 for tried in asked.values()) == read
    if reversed_ == runs:
        assert {item.run for item in found.found} == backward
        assert sum("mirrored" in tried for tried in asked.values()) == hypotheses.SAMPLE
    assert found.unread.startswith(f"{odd} of {runs} runs do not move") == unread
    assert bool(found.unread) == unread


def test_a_run_of_another_frame_interval_has_another_rate_though_a_command_fits_a_little_better() -> None:
    ways = [
        Alternative(None, RUN),
        Alternative("wrong-rate", RUN, "x", own=True),
        Alternative("wrong-command", RUN, "y"),
    ]
    found = {misfit: _judged(Judgement(ways, np.array([9.0, misfit, 0.5]), 10.0, ()), set()) for misfit in (1.4, 1.6)}
    assert [item and (item.kind, item.equivalent) for item in found.values()] == [
        ("wrong-rate", ("wrong-command",)),
        ("wrong-command", ()),
    ]


@pytest.mark.parametrize(("moves_as", "told"), [((1, 2, 0), 3), ((1, 0, 3), 2), ((3, 3, 3), 0), ((1, 3, 3), 0)])
def test_runs_that_exchanged_their_commands_are_told_beside_a_large_effect(
    moves_as: tuple[int, ...], told: int
) -> None:
    runs = [replace(RUN, id=f"r{k}", left_rpm=10.0 * k, right_rpm=20.0) for k in range(6)]
    seen = [
        Judgement([Alternative(None, run)], np.array([4.0 if k < 3 else 2.0]), 10.0, ()) for k, run in enumerate(runs)
    ]
    found = [
        Found(f"r{k}", "wrong-command", "moves as if", "look up", correction=Correction(command=runs[as_].command))
        for k, as_ in enumerate(moves_as)
    ]
    assert beyond_the_others(found, seen) == found[:told]


@pytest.mark.parametrize(
    ("misfits", "far"),
    [
        ([6.1, 2.0, 1.0, 1.0], {"r0"}),
        ([5.9, 2.0, 1.0, 1.0], set()),
        ([6.1, 2.0, np.nan, 1.0], None),
        ([6.1, 2.0], None),
    ],
)
def test_a_run_is_far_from_the_others_beyond_three_times_their_largest_misfit(
    misfits: list[float], far: set[str] | None
) -> None:
    runs = [replace(RUN, id=f"r{k}") for k in range(len(misfits))]
    seen = [
        Judgement([Alternative(None, run)], np.array([value]), 10.0, ())
        for run, value in zip(runs, misfits, strict=True)
    ]
    assert belief.far_from_the_others([Found("r0", "reversed", "", "")], seen) == far


def judged(number: int, kind: Any, misfits: tuple[float, float], words: str = "x", **of_way: Any) -> Judgement:
    """A run of an extent of 10 mm with a log, and one other reading of it."""
    run = replace(driven(number), log=RunCommand(Command.steps([(0.0, 30.0, 20.0)]), logged=True))
    return Judgement([Alternative(None, run), Alternative(kind, run, words, **of_way)], np.array(misfits), 10.0, ())


@pytest.mark.parametrize(
    ("rates", "kind", "misfit", "fits"),
    [
        ("aaaab", "wrong-rate", 3.0, True),  # four of five runs, three times better than their files
        ("aaabb", "wrong-rate", 3.0, False),
        ("aaaaa", "wrong-rate", 3.1, False),
        ("aaaaa", "mirrored", 3.0, False),
    ],
)
def test_most_runs_share_a_wrong_clock_if_one_rate_fits_them(rates: str, kind: Any, misfit: float, fits: bool) -> None:
    runs = [judged(number, kind, (9.0, misfit), words) for number, words in enumerate(rates)]
    assert belief.one_rate_fits(runs) == fits


@pytest.mark.parametrize(
    ("later_s", "alike"),
    [
        ((0.3, 0.3, 0.3), 3),
        ((0.3, 0.3), 0),  # two runs are no session
        ((0.3, 0.3, 0.3, 0.0), 3),
        ((0.3, 0.3, 0.0, 0.0), 0),
        ((0.3, 0.3, 0.3, 0.4, 0.5), 4),  # within 0.15 s of their median
        ((-0.3, -0.3, -0.2, 0.3), 3),
        ((0.3, 0.3, 0.3, 0.0, 0.0, 0.9, 0.9), 0),  # most are not
    ],
)
def test_logs_are_late_alike_if_most_of_three_or_more_are_about_as_late(later_s: tuple[float, ...], alike: int) -> None:
    runs = [judged(k, "late-start", (9.0, 1.0 if late else 9.5), later_s=late) for k, late in enumerate(later_s)]
    assert belief.late_alike(runs) == {f"r{k}" for k in range(alike)}


def test_a_log_is_late_that_fits_by_a_third_better_and_runs_without_one_or_a_simulation_do_not_count() -> None:
    late = [judged(k, "late-start", (1.31, 1.0), later_s=0.3) for k in range(3)]
    assert len(belief.late_alike(late)) == 3
    assert belief.late_alike([*late[:2], judged(2, "late-start", (1.29, 1.0), later_s=0.3)]) == set()
    unseen = [judged(k, "late-start", (np.nan, 1.0), later_s=0.9) for k in range(3, 9)]
    without = [Judgement(WAYS, np.array([9.0, 9.5, 9.5]), 10.0, ()) for _ in range(6)]
    assert belief.late_alike([*late, *unseen, *without]) == {"r0", "r1", "r2"}


@pytest.mark.parametrize(
    ("misfit", "others", "kept"),
    [(9.0, (1.0, 2.0), 2), (5.9, (1.0, 2.0), 1), (5.9, (2.0,), 2), (5.9, (2.0, np.nan), 2)],
)
def test_a_wrong_command_misfits_three_times_as_much_as_any_two_or_more_right_ones(
    misfit: float, others: tuple[float, ...], kept: int
) -> None:
    runs = [judged(k, "reversed", (value, 9.0)) for k, value in enumerate((misfit, 9.0, *others))]
    found = [Found("r0", "wrong-command", "", ""), Found("r1", "reversed", "", "")]
    assert belief.beyond_the_others(found, runs) == found[-kept:]


def turned(
    name: str, left: float, right: float, expected_rad: float, turned_rad: float, share: float = 0.4
) -> Judgement:
    """A run that turns so far the way that its file says; its exchanged sides fit 1.5 times better."""
    run = replace(driven(0), id=name, left_rpm=left, right_rpm=right)
    ways = [Alternative(None, run), Alternative("wrong-command", run, "x"), Alternative("sides-swapped", run, "y")]
    return Judgement(ways, np.array([10 * share, 20.0, 10 * share / 1.5]), 10.0, (), (expected_rad, turned_rad))


WIDER = [
    turned("wide", 45, 60, 0.26, 0.27, 0.1),
    turned("tight", 14, 33, 0.36, 0.69, 0.3),
    turned("right", 33, 14, 0.36, 0.63),
    turned("back", -33, -14, 0.36, 0.66),
    turned("straight", 40, 40, 0.01, -0.01),
]


@pytest.mark.parametrize(
    ("odd", "others", "away"),
    [
        (turned("pivot", 5, 30, 0.24, -0.9), WIDER, True),
        (turned("pivot", 5, 30, 0.24, -0.49), WIDER, False),  # a push turns it so far
        (turned("pivot", 5, 30, 0.09, -0.9), WIDER, False),  # scrub lets it hardly turn
        (turned("wide", 50, 60, 0.24, -0.9), WIDER, False),  # a slow wheel turns the widest turn to the other side
        (turned("pivot", 30, 5, 0.24, -0.9), WIDER[:2] + WIDER[3:], False),  # of no other that is known to turn right
        (turned("pivot", 5, 30, 0.24, -0.9), [turned("tight", 14, 33, 0.36, -0.1), *WIDER], False),
    ],
)
def test_a_tight_turn_to_the_other_side_is_exchanged_where_wider_ones_to_its_side_turn_as_stated(
    odd: Judgement, others: list[Judgement], away: bool
) -> None:
    seen = [odd, *others]
    run = odd.ways[0].run.id
    assert turned_away(seen) == ({run} if away else set())
    swapped, command = Found(run, "sides-swapped", "", ""), Found(run, "wrong-command", "", "")
    assert beyond_the_others([swapped, command], seen) == [swapped] * away
    if away:
        assert beyond_tolerances([swapped], seen, [ROBOT] * len(seen)) == [swapped]
        assert _judged(odd, set()) is None
        found = _judged(odd, set(), among=("sides-swapped",), better=1.3)
        assert found is not None
        assert found.kind == "sides-swapped"
        assert _judged(odd, set(), among=("sides-swapped",), better=1.6) is None
        many = [
            replace(odd, ways=[replace(way, run=replace(way.run, id=f"p{k}")) for way in odd.ways]) for k in range(2)
        ]
        assert turned_away([*many, *others]) == set()
