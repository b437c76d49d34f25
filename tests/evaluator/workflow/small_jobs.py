"""What worker processes do in tests: apart from these, whose imports every process would repeat."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from evaluator.files import written_whole
from tests.waiting import HANGS_S


def square(number: int) -> int:
    return number * number


def square_unless_three(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def slow_write(path: Path) -> int:
    with written_whole(path) as temporary:
        temporary.write_text("begun", encoding="utf-8")
        path.with_suffix(".began").touch()
        time.sleep(2 * HANGS_S)
    return 0
