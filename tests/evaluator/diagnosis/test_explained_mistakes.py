"""A run that was taken for a mistake, and that moves as its file says with the effect found, is none."""

from __future__ import annotations

from dataclasses import replace

import pytest

from evaluator.diagnosis.candidates.coordinates import named_terms
from evaluator.diagnosis.inference.fit import fit_model
from evaluator.diagnosis.inference.search import Search
from evaluator.diagnosis.likelihood.preparation import build_problem
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.mistakes.explained import without_explained_mistakes
from evaluator.diagnosis.mistakes.recognised import Kind, Mistake
from evaluator.diagnosis.result import Diagnosis
from tests.evaluator.diagnosis.hidden import hidden_session

TILT = "plate-tilt"


@pytest.fixture(scope="module")
def tilted(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """A tilt found without the last two runs; in the file of the last one left and right are exchanged."""
    hidden = {TILT: {"angle_deg": 8.0, "azimuth_deg": 60.0}}
    session = hidden_session(tmp_path_factory.mktemp("tilted"), hidden, exact=True)
    right, wrong = session.data[-2:]
    wrong = replace(wrong, left_rpm=wrong.right_rpm, right_rpm=wrong.left_rpm)
    mistakes = tuple(Mistake((run.id,), "wrong-command", f"{run.id}: another command") for run in (right, wrong))
    aside = tuple(zip((right, wrong), session.robots[-2:], strict=True))
    session = replace(session.of_runs(range(len(session.data) - 2)), mistakes=mistakes, aside=aside)
    terms = named_terms(20.0, (30.0, 60.0))
    problem, start = build_problem(session.data, Simulated(session.robots, session.data, terms))
    fit = fit_model(problem, start, [terms[TILT]], session.tolerance)
    chosen = frozenset([TILT])
    search = Search(problem, terms, session.tolerance, fit.runs, fits={chosen: fit})
    return Diagnosis("effect", "", session, search=search, chosen=chosen, terms=terms)


def test_what_an_effect_explains_is_no_mistake_and_a_wrong_file_remains_one(tilted: Diagnosis) -> None:
    right, wrong = tilted.session.mistakes
    found = without_explained_mistakes(tilted).session
    assert found.mistakes == (wrong,)
    assert found.left_out == {
        right.runs[0]: "taken for wrong-command at first; with plate-tilt it moves as its file says"
    }
    assert found.explained == (right,)
    assert found.data == tilted.session.data


@pytest.mark.parametrize("kind", ["duplicate", "wrong-unit"])
def test_mistakes_that_show_without_a_model_remain(tilted: Diagnosis, kind: Kind) -> None:
    mistakes = tuple(replace(item, kind=kind) for item in tilted.session.mistakes)
    shown = replace(tilted, session=replace(tilted.session, mistakes=mistakes))
    assert without_explained_mistakes(shown) is shown


def test_mistakes_remain_without_an_effect_that_explains_the_runs(tilted: Diagnosis) -> None:
    for shown in (replace(tilted, verdict="unknown"), replace(tilted, follows=False)):
        assert without_explained_mistakes(shown) is shown
    everywhere = tuple(replace(item, everywhere=True) for item in tilted.session.mistakes)
    shown = replace(tilted, session=replace(tilted.session, mistakes=everywhere))
    assert without_explained_mistakes(shown) is shown


def test_a_mistake_that_fits_no_better_than_the_file_with_the_effect_is_none(tilted: Diagnosis) -> None:
    """A turn on the spot whose friction across the wheels was half the stated one was told to drive backward."""
    right, wrong = (replace(item, kind="marks-swapped") for item in tilted.session.mistakes)
    found = without_explained_mistakes(
        replace(tilted, session=replace(tilted.session, mistakes=(right, wrong)))
    ).session
    assert found.mistakes == (wrong,)
    assert found.left_out == {
        right.runs[0]: "taken for marks-swapped at first; with plate-tilt that fits it no better than its file, and "
        "neither shows anything"
    }
