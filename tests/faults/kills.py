"""Kill a batch at each of its changes of files in turn: `python -m tests.faults.kills EXPERIMENT FOLDER`.

Prints as JSON how many moments there were and how many states of the output folder they left, and what was wrong. A
process of its own, without threads, so that it may be forked: a child costs no imports.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import sys
from pathlib import Path
from typing import Any

from evaluator.workflow import analyze
from evaluator.workflow.execution.sharing import one_core

CHANGES = {"open", "os.chmod", "os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.truncate"}  # of Python's audit
WRITES = os.O_WRONLY | os.O_RDWR
MOST_KILLS = 400  # far more than a small batch changes files


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def is_hidden(name: str) -> bool:
    """Whether a file is none of the results: what is not yet whole has a name that begins with a full stop."""
    return Path(name).name.startswith(".")


def is_torn(name: str, left: dict[str, bytes], expected: dict[str, bytes]) -> bool:
    """Whether a file is not what an undisturbed batch makes of it, nor a whole record of some of a run's stages."""
    if is_hidden(name) or left[name] == expected.get(name):
        return False
    try:
        return name not in expected or not json.loads(left[name])
    except ValueError:
        return True


def kill_at(number: int, out: Path) -> None:
    """Have this process killed at its nth change of what is in a folder: a file is then opened and still empty."""
    seen = 0

    def watch(event: str, given: tuple[Any, ...]) -> None:
        nonlocal seen
        if event not in CHANGES or not str(given[0]).startswith(str(out)):
            return
        if event == "open" and not given[2] & WRITES:
            return
        seen += 1
        if seen == number:
            if event == "open":
                os.open(given[0], given[2])
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(watch)


def is_killed(experiment: Path, out: Path, number: int) -> bool:
    """Whether a batch, done in a child process, has an nth change of files to be killed at."""
    if child := os.fork():
        status = os.waitpid(child, 0)[1]
        assert status == 0 or os.WTERMSIG(status) == signal.SIGKILL, status
        return status != 0
    kill_at(number, out)
    analyze(experiment, out, workers=1)
    os._exit(0)


def main() -> None:
    """Kill a batch at every moment, look at what is left, and let it go on."""
    experiment, folder = Path(sys.argv[1]), Path(sys.argv[2])
    with one_core():
        analyze(experiment, folder / "whole", workers=1)
    expected = contents(folder / "whole")
    gc.freeze()  # what the children share is not copied to be looked through
    wrong, states, number = [], set(), 1
    while number < MOST_KILLS and is_killed(experiment, out := folder / str(number), number):
        left = contents(out) if out.exists() else {}
        wrong += [f"{name} is torn at change {number}" for name in left if is_torn(name, left, expected)]
        state = frozenset((name.rpartition("/.")[0] if is_hidden(name) else name, left[name]) for name in left)
        if state not in states:  # the next batch depends on nothing else
            states.add(state)
            with one_core():
                analyze(experiment, out, workers=1)
            after = {name: content for name, content in contents(out).items() if not is_hidden(name)}
            wrong += [] if after == expected else [f"another result after change {number}"]
        number += 1
    sys.stdout.write(json.dumps({"moments": number - 1, "states": len(states), "wrong": wrong}))


if __name__ == "__main__":
    main()
