"""A batch on a Dask cluster that has lost all its workers says so."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from evaluator.errors import InputError
from evaluator.workflow.execution import cluster


def waited(monkeypatch: pytest.MonkeyPatch, workers: list[bool]) -> tuple[int, int]:
    """How often a wait of 10 s each was asked for and the scheduler was asked, for workers at each question."""
    seconds, waits = [0.0], [0]
    asked = iter(workers)
    count = [0]

    def info() -> dict[str, Any]:
        count[0] += 1
        return {"workers": {"one": 1} if next(asked) else {}}

    def waiting() -> None:
        waits[0] += 1
        seconds[0] += 10.0

    monkeypatch.setattr(cluster, "time", SimpleNamespace(monotonic=lambda: seconds[0]))
    client: Any = SimpleNamespace(scheduler_info=info)
    wait = cluster._noticing_lost_workers(client, "tcp://lab:8786", waiting)
    for _ in workers:
        wait()
    return waits[0], count[0]


def test_a_batch_goes_on_while_workers_come_back_within_two_minutes(monkeypatch: pytest.MonkeyPatch) -> None:
    assert waited(monkeypatch, ([False] * 12 + [True]) * 3) == (39, 39)


def test_a_batch_ends_with_one_sentence_after_two_minutes_without_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(
        InputError, match=r"tcp://lab:8786 has lost all its workers: start some .*finished work is kept"
    ):
        waited(monkeypatch, [True, *[False] * 14])


def test_the_scheduler_is_not_asked_at_every_pulse(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "LOOK_S", 25.0)
    assert waited(monkeypatch, [True] * 9) == (9, 3)
