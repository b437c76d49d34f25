"""The self-test: each figure stands beside its claim, and what fails is said, on the page and by the exit status."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from click.testing import CliRunner

from evaluator.cli.first_steps.selftest import selftest
from evaluator.errors import InputError
from evaluator.report.pages.selftest import write_selftest
from evaluator.workflow.selftest import run
from evaluator.workflow.selftest.claims import CLAIMS, Claim
from evaluator.workflow.selftest.run import Outcome, SelfTest, self_test


def middle(claim: Claim) -> float:
    return claim.high if math.isinf(claim.low) else 0.5 * (claim.low + claim.high)


STAGES = ("_render", "_calibrate", "_track", "_fit", "_simulate", "_diagnose")


@pytest.fixture
def reached(monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    """All stages give at once what they must; a test changes it."""
    figures = {claim.id: middle(claim) for claim in CLAIMS}
    for stage in STAGES:
        monkeypatch.setattr(run, stage, lambda *_: figures)
    return figures


def test_all_claims_hold_and_the_exit_status_is_zero(reached: dict[str, float], tmp_path: Path) -> None:
    answer = CliRunner().invoke(selftest, ["-o", str(tmp_path)], standalone_mode=False)
    assert answer.return_value == 0, answer.output
    assert f"All {len(CLAIMS)} claims hold" in answer.output
    assert "FAIL" not in (tmp_path / "selftest.html").read_text(encoding="utf-8")
    assert len(reached) == len(CLAIMS)


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.id)
def test_each_claim_that_does_not_hold_fails_the_test(claim: Claim, reached: dict[str, float], tmp_path: Path) -> None:
    reached[claim.id] = claim.high + 0.5
    answer = CliRunner().invoke(selftest, ["-o", str(tmp_path)], standalone_mode=False)
    assert answer.return_value == 1
    assert "1 of" in answer.output
    assert [line for line in answer.output.splitlines() if "FAIL" in line and claim.what in line]


def test_a_stage_that_fails_says_why_and_the_others_go_on(
    reached: dict[str, float], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refused(*_: object) -> dict[str, float]:
        raise InputError("gauge.png: no dots <found>")

    stage_of = {claim.id: claim.stage for claim in CLAIMS}
    monkeypatch.setattr(run, "_calibrate", refused)
    for stage in ("_render", "_track", "_fit", "_simulate", "_diagnose"):
        others = {key: value for key, value in reached.items() if stage_of[key] == stage[1:]}
        monkeypatch.setattr(run, stage, lambda *_, others=others: others)
    found = self_test(tmp_path)
    # Files of an earlier self-test do not take the place of the camera that is missing.
    failed = {outcome.claim.stage for outcome in found.outcomes if not outcome.holds}
    assert failed == {"calibrate", "track", "fit"}
    write_selftest(found, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "calibrate: gauge.png: no dots &lt;found&gt;" in page


def test_what_was_not_measured_does_not_hold() -> None:
    assert not any(Outcome(claim, math.nan).holds for claim in CLAIMS)


def test_the_page_needs_nothing_else_and_names_machine_versions_and_seed(tmp_path: Path) -> None:
    found = SelfTest(tuple(Outcome(claim, middle(claim)) for claim in CLAIMS), {"render": 1.0}, run.machine_facts(), 5)
    write_selftest(found, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    for words in ("numba", "python", "--seed 5", *(claim.expected for claim in CLAIMS)):
        assert words in page
    assert "http" not in page.replace("http://www.w3.org", "")


def test_the_hidden_effect_is_of_the_catalogue_and_one_run_is_told_with_its_sides_exchanged(tmp_path: Path) -> None:
    import tomllib

    from evaluator.workflow.selftest import laboratory

    messy = laboratory.write_hidden_effect(tmp_path, 3)
    told = {item["id"]: item for item in tomllib.loads(messy.experiment.read_text(encoding="utf-8"))["run"]}
    commands = [(item["left_rpm"], item["right_rpm"]) for item in told.values()]
    assert [k for k, pair in enumerate(commands) if pair != laboratory.COMMANDS_RPM[k]] == [laboratory.SWAPPED]
    assert messy.swapped in told
    assert {item["start_s"] for item in told.values()} == {laboratory.START_S + laboratory.LATE_S}
