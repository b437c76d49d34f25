"""Does a failure in the middle of a command lose anything?

python -m tests.benchmarks.injected --failures 500 [--seed 1] [--only WORDS] [--first 0]

Every command that reads a file of tests/fuzz and writes results is run once undisturbed, which counts its calls of each
kind: opening a file to read or to write, renaming, making a folder, removing, writing bytes, allocating an array. Then
calls are drawn at random, and the command is run again with that one failing as a full disk, a bad sector or a lack of
memory would make it fail, in an empty folder or in one that holds its results. It must end with results or one
sentence; inputs and earlier results must be as before; no file may be half written; what ends with status 0 must have
all results; and the same command, run once more, must give the undisturbed result byte for byte. Exits with 1 where
that does not hold. Failures have numbers, so that a later call goes on with --first.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import gc
import importlib
import json
import multiprocessing
import os
import pkgutil
import random
import resource
import select
import shutil
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import calibration
import evaluator
import simulator
from evaluator.workflow.execution.sharing import one_core
from tests.fuzz.attempt import status_and_fault
from tests.fuzz.entries import ENTRIES, OUT, Entry, lay_out

WRITES = os.O_WRONLY | os.O_RDWR
# Events of Python's audit, and the error that the system would give.
EVENTS = {"os.rename": errno.EIO, "os.mkdir": errno.EROFS, "os.remove": errno.EIO}
READ, WRITE, BYTES, MEMORY = "read", "write", "bytes", "memory"
ERRORS = {**EVENTS, READ: errno.EIO, WRITE: errno.ENOSPC}
ALLOCATORS = ("zeros", "empty", "full", "ones")
LIMIT_S = 400.0  # of a command; the first compiles
LONGEST_S = LIMIT_S + 60.0  # of its process, which ends by itself unless it is stuck
OWN = {"provenance.json"}  # names the time
PARTS = ".csv.parts-"  # in the name of the folder of a sweep under way
Counts = Counter[str]


@dataclass(frozen=True)
class Failure:
    """The nth call of a kind that fails; for BYTES, the size beyond which no file grows."""

    kind: str
    number: int


def watch(counts: Counts, below: Path, failure: Failure | None) -> None:
    """Count the calls of this process that concern a folder, for as long as it lives, and let one of them fail."""

    def seen(kind: str, error: Exception) -> None:
        counts[kind] += 1
        if failure is not None and (kind, counts[kind]) == (failure.kind, failure.number):
            raise error

    def audit(event: str, given: tuple[Any, ...]) -> None:
        kind = event if event != "open" or not isinstance(given[0], str) else WRITE if given[2] & WRITES else READ
        if kind in ERRORS and str(given[0]).startswith(str(below)):
            seen(kind, OSError(ERRORS[kind], os.strerror(ERRORS[kind]), str(given[0])))

    def allocating(original: Callable[..., Any]) -> Callable[..., Any]:
        def allocate(*arguments: Any, **options: Any) -> Any:
            seen(MEMORY, MemoryError("Unable to allocate 8.00 GiB"))
            return original(*arguments, **options)

        return allocate

    if failure is None or failure.kind == MEMORY:
        for name in ALLOCATORS:
            setattr(np, name, allocating(getattr(np, name)))
    if failure is not None and failure.kind == BYTES:
        resource.setrlimit(resource.RLIMIT_FSIZE, (failure.number, resource.RLIM_INFINITY))
    sys.addaudithook(audit)


def run(
    entry: Entry, folder: Path, failure: Failure | None = None, *, watched: bool = True
) -> tuple[str, Counts, int | None]:
    """Run a command in a child process; gives what was wrong with how it ended, the calls counted, and its status."""
    reading, writing = os.pipe()
    if child := os.fork():
        os.close(writing)
        with os.fdopen(reading) as pipe:
            if not select.select([pipe], [], [], LONGEST_S)[0]:
                os.kill(child, signal.SIGKILL)
            told = pipe.read()
        status = os.waitpid(child, 0)[1]
        wrong, _, rest = told.partition("\0")
        died = f"the process died: {status}" if status or not rest else ""
        counted, said = json.loads(rest or "[{}, null]")
        return wrong or died, Counter(counted), said
    counts: Counts = Counter()
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 2)
    with one_core():
        if watched:
            watch(counts, folder.parent, failure)
        said, wrong = status_and_fault(entry, folder, LIMIT_S, (0,) if failure is None else (0, 1, 2))
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    with os.fdopen(writing, "w") as pipe:
        pipe.write(f"{wrong}\0{json.dumps([counts, said])}")
    os._exit(0)


def import_everything() -> None:
    """Import what any command imports, once for all the children."""
    for room in (calibration, simulator, evaluator):
        for module in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
            if not module.name.endswith("__main__"):
                with contextlib.suppress(ImportError):  # of an optional extra
                    importlib.import_module(module.name)


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, but for those that name the time."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.name not in OWN)
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def shown(files: dict[str, bytes]) -> dict[str, bytes]:
    """The files that are results: one that is not yet whole has a name that begins with a full stop."""
    return {name: content for name, content in files.items() if not Path(name).name.startswith(".")}


class Command:
    """A command, what it makes undisturbed, and how many calls of each kind it makes."""

    def __init__(self, entry: Entry, valid: Path, work: Path) -> None:
        self.entry, self.valid, self.work = entry, valid, work
        self.inputs = contents(valid)
        self.whole: dict[str, bytes] = {}
        self.states: set[frozenset[tuple[str, bytes]]] = set()
        place = self.fresh(full=False)
        wrong, self.counts, _ = run(entry, place / "in")
        if wrong:  # numba cannot compile with a changed numpy
            run(entry, self.fresh(full=False) / "in", watched=False)
            place = self.fresh(full=False)
            wrong, self.counts, _ = run(entry, place / "in")
        assert not wrong, f"{entry}: {wrong}"
        self.whole = contents(place / "out")
        self.counts[BYTES] = max(map(len, self.whole.values()), default=0)

    def fresh(self, *, full: bool) -> Path:
        """A folder with the inputs; full: with the results of the undisturbed command as well."""
        place = self.work / "place"  # always of one name, as results may hold it
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(self.valid, place / "in")
        (place / "out").mkdir()
        for name, content in self.whole.items() if full else ():
            (place / "out" / name).parent.mkdir(parents=True, exist_ok=True)
            (place / "out" / name).write_bytes(content)
        return place

    def wrong_with(self, failure: Failure, *, full: bool) -> str:
        """Run with a failure, and once more without; gives what was lost."""
        place = self.fresh(full=full)
        wrong, _, status = run(self.entry, place / "in", failure)
        left = contents(place / "out")
        if wrong := wrong or self._wrong_with_files(left, status, full=full):
            return wrong
        if contents(place / "in") != self.inputs:
            return "an input has changed"
        if (state := frozenset(left.items())) in self.states:  # the next run depends on nothing else
            return ""
        self.states.add(state)
        wrong, _, _ = run(self.entry, place / "in", watched=False)
        others = self._others(contents(place / "out"))
        return f"another result afterwards: {wrong or others}" if wrong or others else ""

    def _wrong_with_files(self, left: dict[str, bytes], status: int | None, *, full: bool) -> str:
        """What is wrong with the files that a command with a failure left."""
        if full and (lost := set(self.whole) - set(left)):
            return f"lost: {sorted(lost)}"
        if cut := [name for name, content in shown(left).items() if self._is_cut(name, content)]:
            return f"half written: {cut}"
        if status == 0 and (others := self._others(left)):
            return f"status 0, but these are not the undisturbed results: {others}"
        return ""

    def _others(self, left: dict[str, bytes]) -> list[str]:
        """Results that are not those of the undisturbed command."""
        found = shown(left)
        return [name for name in {**found, **self.whole} if found.get(name) != self.whole.get(name)]

    def _is_cut(self, name: str, content: bytes) -> bool:
        """Whether a file breaks off; a table without the rows of a run that could not be analysed is whole.

        The parts of a sweep stand in a folder beside the result until it is whole: each is a table of its own.
        """
        whole = self.whole.get(name)
        if whole is None:
            return PARTS not in Path(name).parent.name or not content.endswith(b"\n")
        return content != whole and whole.startswith(content) and not content.endswith(b"\n")


def main() -> None:
    """Draw failures and try them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--failures", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="commands whose line holds this")
    parser.add_argument("--first", type=int, default=0, help="number of the first failure")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        valid, work = Path(name) / "valid", Path(name) / "work"
        valid.mkdir()
        # In a process of its own: encoders and OpenCV leave threads, beside which a forked child can hang.
        laying = multiprocessing.get_context("spawn").Process(target=lay_out, args=(valid,))
        laying.start()
        laying.join()
        chosen = {entry.arguments: entry for entry in ENTRIES if any(OUT in part for part in entry.arguments)}
        chosen = {line: entry for line, entry in chosen.items() if given.only in " ".join(line)}
        import_everything()
        gc.freeze()  # what children share is not copied to be looked through
        commands = [Command(entry, valid, work) for entry in chosen.values()]
        kinds = sorted({kind for command in commands for kind in command.counts})
        tried, faults = Counter[str](), 0
        for number in range(given.first, given.first + given.failures):
            rng = random.Random(f"{given.seed}/{number}")  # noqa: S311  # draws failures, keeps no secrets
            kind = rng.choice(kinds)
            command = rng.choice([one for one in commands if one.counts[kind]])
            failure = Failure(kind, rng.randint(1, command.counts[kind]))
            wrong = command.wrong_with(failure, full=bool(rng.getrandbits(1)))
            tried[kind] += 1
            if number % 25 == 0:
                print(f"{number}: {faults} faults", flush=True)
            if wrong:
                faults += 1
                line = " ".join(command.entry.arguments)
                print(f"--- {number}: {line}, {kind} {failure.number}: {wrong}", flush=True)
    print(
        f"{tried.total()} failures in {len(commands)} commands with seed {given.seed} ({dict(tried)}): {faults} faults"
    )
    raise SystemExit(faults > 0)


if __name__ == "__main__":
    main()
