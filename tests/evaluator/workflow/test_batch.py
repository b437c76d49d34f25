from __future__ import annotations

import os
import signal

from evaluator.workflow.batch import in_processes


def square(number: int) -> int:
    return number * number


def square_unless_three(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def test_every_job_is_answered_once() -> None:
    answers = in_processes(square, range(7), workers=2, when_killed=lambda _: -1)
    assert sorted(answers) == [0, 1, 4, 9, 16, 25, 36]


def test_a_killed_worker_costs_only_its_own_job() -> None:
    answers = in_processes(square_unless_three, range(6), workers=2, when_killed=lambda _: -1)
    assert sorted(answers) == [-1, 0, 1, 4, 16, 25]
