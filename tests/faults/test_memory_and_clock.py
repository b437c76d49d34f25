"""Memory that runs out and a clock that jumps in a batch: whole files, and the identical result."""

from __future__ import annotations

import contextlib
import itertools
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluator.errors import InputError
from evaluator.workflow import analyze
from tests.evaluator.synthetic import circling_marks, write_experiment
from tests.faults.kills import contents


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, bytes]]:
    folder = tmp_path_factory.mktemp("whole")
    experiment = write_experiment(folder, [("r00", 14.4, 33.3, circling_marks(5.0, seconds=0.75))])
    analyze(experiment, folder / "out", workers=1)
    return experiment, contents(folder / "out")


@pytest.mark.parametrize("number", [1, 5, 25, 60])
def test_after_memory_ran_out_the_next_run_gives_the_identical_result(
    number: int, whole: tuple[Path, dict[str, bytes]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The numbers are of calls of np.zeros, of which a batch of one run makes more than 60."""
    experiment, expected = whole
    allocate, calls = np.zeros, [0]

    def failing(*args: Any, **options: Any) -> Any:
        calls[0] += 1
        if calls[0] == number:
            raise MemoryError("Unable to allocate 8.00 GiB")
        return allocate(*args, **options)

    with monkeypatch.context() as patched:
        patched.setattr(np, "zeros", failing)
        with contextlib.suppress(MemoryError, InputError):
            analyze(experiment, tmp_path, workers=1)
    assert calls[0] >= number
    assert set(contents(tmp_path)) <= set(expected)
    analyze(experiment, tmp_path, workers=1)
    assert contents(tmp_path) == expected


def test_a_clock_that_jumps_changes_no_result_and_nothing_is_done_again(
    whole: tuple[Path, dict[str, bytes]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment, expected = whole
    jumps, now = itertools.cycle((0.0, 86400.0, -365 * 86400.0)), time.time
    monkeypatch.setattr(time, "time", lambda: now() + next(jumps))
    analyze(experiment, tmp_path, workers=1)
    assert contents(tmp_path) == expected
    poses = tmp_path / "poses" / "r00.csv"
    for file in (poses, experiment):  # as on a day on which the clock was wrong
        os.utime(file, (0.0, 0.0))
    analyze(experiment, tmp_path, workers=1)
    assert contents(tmp_path) == expected
    assert poses.stat().st_mtime == 0.0
