"""Every file that turnscope reads, spoilt in a few ways: results or one sentence (the long run: benchmarks/fuzz.py)."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from tests.fuzz.attempt import attempt, spoilt
from tests.fuzz.entries import ENTRIES, Entry, lay_out

EXAMPLES, SLOW_EXAMPLES = 6, 1  # a few seconds in all
LIMIT_S = 400.0  # of an input: the first command of a fresh clone compiles


@pytest.fixture(scope="module")
def valid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("valid")
    lay_out(folder)
    return folder


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: f"{entry}-{ENTRIES.index(entry)}")
def test_a_spoilt_file_ends_in_results_or_one_sentence(entry: Entry, valid: Path) -> None:
    @settings(
        max_examples=SLOW_EXAMPLES if entry.is_slow else EXAMPLES,
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.generate],  # the long run finds more than shrinking here would tell
        suppress_health_check=list(HealthCheck),
    )
    @given(st.randoms(use_true_random=False))
    def holds(rng: random.Random) -> None:
        content = spoilt(entry, valid, rng)
        wrong = attempt(entry, content, valid, limit_s=LIMIT_S)
        assert not wrong, f"{wrong}\nof {content[:300]!r}"

    holds()


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: f"{entry}-{ENTRIES.index(entry)}")
def test_the_valid_file_gives_results(entry: Entry, valid: Path, capfd: pytest.CaptureFixture[str]) -> None:
    del capfd
    if entry.is_slow:
        pytest.skip("takes a second; its command has tests of its own")
    assert attempt(entry, (valid / entry.name).read_bytes(), valid, strict=True, limit_s=LIMIT_S) == ""
