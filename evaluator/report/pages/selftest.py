"""The page of a self-test: machine, versions, and each figure with its claim."""

from __future__ import annotations

import math
from pathlib import Path

from evaluator.files import write_text
from evaluator.report.pages.html import Page, Section, Table, page_html
from evaluator.wording import verb
from evaluator.workflow import SelfTest

HEAD = ("", "step", "figure", "measured", "claimed")


def outcome_rows(found: SelfTest) -> list[tuple[str, ...]]:
    """Pass or fail, step, figure, value and claim as text."""
    return [
        (
            "pass" if outcome.holds else "FAIL",
            outcome.claim.stage,
            outcome.claim.what,
            f"{outcome.value:.3g} {outcome.claim.unit}".strip() if math.isfinite(outcome.value) else "nothing",
            outcome.claim.expected,
        )
        for outcome in found.outcomes
    ]


def sentence_of(found: SelfTest) -> str:
    """The result in one sentence."""
    failed = sum(not outcome.holds for outcome in found.outcomes)
    seconds = sum(found.seconds.values())
    if not failed:
        return f"All {len(found.outcomes)} claims hold on this machine ({seconds:.0f} s)."
    hold = verb(failed, "does", "do")
    return (
        f"{failed} of {len(found.outcomes)} claims {hold} not hold on this machine ({seconds:.0f} s): "
        "please send this page to the maintainers."
    )


def write_selftest(found: SelfTest, path: Path) -> None:
    """Write the page."""
    reasons = dict.fromkeys(f"{outcome.claim.stage}: {outcome.reason}" for outcome in found.outcomes if outcome.reason)
    times = [(stage, f"{seconds:.1f} s") for stage, seconds in found.seconds.items()]
    rows = tuple(outcome_rows(found))
    why = [(outcome.claim.what, outcome.claim.why) for outcome in found.outcomes]
    page = Page(
        kind="self-test",
        title="passed" if found.holds else "failed",
        facts=(f"turnscope {found.machine['turnscope']}", found.machine["system"], f"seed {found.seed}"),
        summary=(sentence_of(found), *reasons),
        sections=(
            Section("claims", "Claims", tables=(Table("Measured here.", HEAD, rows, words=True),)),
            Section(
                "machine",
                "Machine",
                tables=(
                    Table("What it ran on.", ("", "version"), tuple(found.machine.items()), words=True),
                    Table("Time of each step.", ("step", "clock"), tuple(times)),
                ),
            ),
            Section(
                "limits",
                "Where the limits come from",
                tables=(Table("Measured: tests/benchmarks/README.md.", ("figure", "limit"), tuple(why), words=True),),
            ),
        ),
        footer=f"Made by turnscope selftest --seed {found.seed}.",
    )  # fmt: skip
    write_text(path, page_html(page))
