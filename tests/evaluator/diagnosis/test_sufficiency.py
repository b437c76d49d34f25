"""Few runs cannot carry that something without a name is missing: chance between runs does as much."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from evaluator.diagnosis import answer as module
from evaluator.diagnosis.assessment.sufficiency import (
    fewest_runs,
    gathered,
    most_odd,
    not_driven,
    too_few,
    unusual_friction,
)
from tests.evaluator.diagnosis.test_adequacy import with_friction


def left(*excess: float) -> Any:
    """What a model leaves over of each run, mean square in that of the noise."""
    return SimpleNamespace(by_run=np.array(excess))


@pytest.mark.parametrize(("runs", "odd"), [(2, 1), (4, 1), (6, 1), (8, 2), (12, 2), (16, 2), (20, 3), (24, 3)])
def test_as_many_runs_may_be_odd_as_go_wrong_by_themselves(runs: int, odd: int) -> None:
    """Drawn: one recording in twenty goes wrong; more than so many do less often than one time in twenty."""
    wrong = (np.random.default_rng(1).random((40000, runs)) < 0.05).sum(axis=1)
    assert most_odd(runs) == odd
    assert (wrong > odd).mean() < 0.05
    assert odd == 0 or (wrong > odd - 1).mean() > 0.05


@pytest.mark.parametrize(
    ("commands", "lacking"),
    [
        ([(30, 20), (-20, -30)], ["left turns"]),  # clockwise seen from above, forward and backward
        ([(30, 20), (20, 30), (-9, -9)], []),
        ([(30, 30), (20, 20)], ["turns", "backward motion"]),
        ([(20, -20), (-10, 10)], []),  # on the spot: neither forward nor backward
        ([(20, -20), (30, 30)], ["left turns", "backward motion"]),
    ],
)
def test_motions_that_no_run_has_are_named(commands: list[tuple[float, float]], lacking: list[str]) -> None:
    assert not_driven(commands) == lacking


KINDS = [*"aabbccccc", *"defghij"]


@pytest.mark.parametrize(
    ("odd", "kind"),
    [
        ([0, 4, 8], None),  # one of each command
        ([0, 1], "a"),  # both of them
        ([4, 5, 6], "c"),  # three of five
        ([4, 5], None),  # two of five
        ([0, 4, 5, 6, 7], "c"),
        ([], None),
    ],
)
def test_runs_of_one_command_that_disagree_together_are_no_accidents(odd: list[int], kind: str | None) -> None:
    assert gathered(odd, KINDS) == kind


def test_accidents_gather_in_one_command_less_often_than_a_laboratory_has_unknown_physics() -> None:
    wrong = np.random.default_rng(2).random((4000, len(KINDS))) < 0.05
    assert np.mean([gathered(np.flatnonzero(runs).tolist(), KINDS) is not None for runs in wrong]) < 0.05


def test_four_runs_that_the_model_follows_carry_no_law_without_a_name() -> None:
    said = too_few(left(0.9, 1.0, 1.1, 1.2), 1)
    assert "no run contradicts the model individually" in said
    assert said.endswith(f"until there are {fewest_runs(1)} runs")


def test_one_run_of_four_may_be_odd_two_are_physics() -> None:
    assert "1 of 4 runs contradict the model individually" in too_few(left(1.0, 1.0, 1.0, 40.0), 1)
    assert too_few(left(1.0, 1.0, 30.0, 40.0), 1) == ""


def test_one_law_that_mends_several_runs_which_miss_by_themselves_is_no_chance() -> None:
    eight, mended = left(*[1.0] * 6, 30.0, 40.0), left(*[1.0] * 8)
    assert too_few(eight, 2)
    assert too_few(eight, 2, mended) == ""
    assert too_few(eight, 2, left(*[1.0] * 7, 2.0))  # one is not mended
    assert too_few(left(*[1.0] * 7, 40.0), 2, mended)  # a single run may have gone wrong


def test_runs_enough_for_a_test_of_chance_between_them_carry_it_without_a_misfit_of_any() -> None:
    assert too_few(left(*[1.0] * fewest_runs(1)), 1) == ""
    assert too_few(left(*[1.0] * fewest_runs(1)), 2)  # a law of two parameters leaves one freedom less


def test_parameters_of_the_law_are_those_of_its_terms_without_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "adequacy", lambda *_: left(*[1.0] * 8))
    terms = {name: SimpleNamespace(size=size) for name, size in (("mark-offset", 3), ("free:a", 1), ("free:b", 2))}
    search = SimpleNamespace(terms=terms, null=None, fits={})
    session = SimpleNamespace(data=())
    assert module.too_few_runs(search, frozenset({"mark-offset", "free:a"}), session) == ""  # type: ignore[arg-type]
    assert module.too_few_runs(search, frozenset({"free:b"}), session)  # type: ignore[arg-type]
    assert module.too_few_runs(search, frozenset(), session) == ""  # type: ignore[arg-type]


SCATTERED = np.random.default_rng(11).normal(size=16)
SCATTERED = (SCATTERED - SCATTERED.mean()) / SCATTERED.std()
ORDER = np.arange(16.0)


@pytest.mark.parametrize(
    ("friction", "hides"),
    [
        (0.26 * SCATTERED, True),
        (0.1 * SCATTERED, False),
        (0.02 * SCATTERED - 0.05 * ORDER, False),  # dust that gathers
        (0.02 * SCATTERED + 0.6 * (ORDER > 6), False),  # another plate
        (0.02 * SCATTERED + 0.9 * (ORDER == 3), False),  # one sticky run
    ],
)
def test_friction_that_differs_more_than_plates_do_may_hide_an_effect(friction: Any, *, hides: bool) -> None:
    said = unusual_friction(with_friction(friction), ORDER, list(range(16)))
    assert bool(said) == hides
    if hides:
        assert said.startswith("the model explains the runs only if friction differs from run to run by 2")
        assert "repeat runs of several commands" in said


@pytest.mark.parametrize(("of_command", "hides"), [(True, True), (False, False)])
def test_friction_that_differs_between_runs_of_one_command_hides_nothing(*, of_command: bool, hides: bool) -> None:
    """Four commands, each four times: an effect makes those of a command alike, a dirty plate does not."""
    kinds = [k % 4 for k in range(16)]
    friction = 0.3 * np.array([1.0, -1.0, 1.2, -1.2])[kinds] if of_command else 0.3 * SCATTERED
    said = unusual_friction(with_friction(friction + 0.01 * SCATTERED), ORDER, kinds)
    assert bool(said) == hides


@pytest.mark.parametrize(("times", "hides"), [(0.99, False), (1.01, True)])
def test_the_lower_bound_of_a_scatter_decides(times: float, *, hides: bool) -> None:
    """Sixteen runs, three parameters of a change: a 40th of a chi square of 13 is beyond 24.7."""
    line = np.column_stack([np.ones(16), ORDER])
    rest = SCATTERED - line @ np.linalg.lstsq(line, SCATTERED, rcond=None)[0]
    steps = [np.column_stack([at > ORDER, at <= ORDER]).astype(float) for at in ORDER[1:]]
    least = min(float(np.sum((rest - of @ np.linalg.lstsq(of, rest, rcond=None)[0]) ** 2)) for of in (line, *steps))
    friction = times * 0.1 * np.sqrt(24.736 / least) * rest
    assert bool(unusual_friction(with_friction(friction), ORDER, list(range(16)))) == hides


def test_three_degrees_of_freedom_tell_a_scatter() -> None:
    friction = 0.5 * SCATTERED[:6]
    assert unusual_friction(with_friction(friction), ORDER[:6], list(range(6)))
    assert not unusual_friction(with_friction(friction[:5]), ORDER[:5], list(range(5)))
