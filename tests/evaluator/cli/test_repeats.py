"""Sentences that differ in names and numbers only are printed once."""

from __future__ import annotations

import pytest

from evaluator.cli.first_steps.check import without_repeats


@pytest.mark.parametrize(
    "names",
    [
        ("r01", "r02", "r03"),
        ("run left", "run right", "run straight"),
        ("/a/one.csv", "/a/two.csv", "/a/three.csv"),
    ],
)
def test_of_three_alike_one_is_told_and_the_others_named(names: tuple[str, ...]) -> None:
    """The first stands as it is, its own numbers and files included."""
    stems = [name.removeprefix("run ").split("/")[-1] for name in names]
    said = [
        f"{name}: {stem.removesuffix('.csv')}_pose.csv ends at {i}.5 s"
        for i, (name, stem) in enumerate(zip(names, stems, strict=True))
    ]
    assert without_repeats(said) == [said[0], f"the same of {stems[1]}, {stems[2]}, with their own names and numbers"]


def test_two_alike_are_told_both() -> None:
    """A second sentence is shorter than its announcement is."""
    said = ["r01: ends at 1 s", "r02: ends at 2 s"]
    assert without_repeats(said) == said


def test_other_sentences_stay_in_the_order_of_the_first_of_their_kind() -> None:
    """Errors of another kind are never hidden behind many alike."""
    said = ["r01: ends at 1 s", "r02: no frames", "r03: ends at 3 s", "r04: ends at 4.25 s", "r05: no time"]
    assert without_repeats(said) == [
        "r01: ends at 1 s",
        "the same of r03, r04, with their own names and numbers",
        "r02: no frames",
        "r05: no time",
    ]


def test_of_two_faults_alike_in_each_of_two_runs_a_run_is_named_once() -> None:
    """Three lines of one table, the first in another run."""
    said = ["r01: line 4: not a number", "r02: line 5: not a number", "r02: line 6: not a number"]
    assert without_repeats(said)[1] == "the same of r02, with their own names and numbers"


def test_sentences_without_a_subject_are_alike_only_as_a_whole() -> None:
    """What stands before no colon is a sentence and no name."""
    said = ["no runs", "no robot", "no gauge"]
    assert without_repeats(said) == said
