"""Spoil valid files by the thousand and see that every command ends in results or one sentence.

python -m tests.benchmarks.fuzz --inputs 100000 [--only NAME] [--seed 1] [--keep folder/] [--readers]

With --readers the readers of tables, settings and foreign files are called directly: a million inputs are affordable.
A library that loops without end is ended by the limit of its reader, as in a command; this is counted, and no failure.
Every batch of inputs runs in a process of its own, so that a native crash of a decoder is seen as one and the memory
that a batch took at most is known. A failure is printed once per place, with its input kept for a test.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import random
import resource
import signal
import tempfile
import time
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path

from evaluator.files import time_limit
from tests.fuzz import readers
from tests.fuzz.attempt import LIMIT_S, WAITS, attempt, spoilt
from tests.fuzz.entries import ENTRIES, Entry, lay_out
from tests.fuzz.readers import READERS, Reader

BATCH, READ = 100, 10_000  # inputs per process
READER_S = 2.0  # processor time after which a native library that loops is ended: inputs have some kilobytes
MOST_MB = 2500  # resident memory of a process, libraries included: what one input may take at most


def work(answers: Connection, numbers: range, chosen: list[Entry] | list[Reader], valid: Path, seed: int) -> None:
    """Try inputs by number; sends the number before each, and what was wrong after it."""
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 2)  # decoders write to standard error by themselves
    time_limit.LONGEST_S = READER_S
    for number in numbers:
        answers.send((number, None, 0.0, 0))
        rng = seeded(seed, number)
        entry = chosen[number % len(chosen)]
        began = time.process_time()
        if isinstance(entry, Reader):
            wrong = readers.attempt(entry, readers.spoilt(entry, valid, rng), valid)
        else:
            wrong = attempt(entry, spoilt(entry, valid, rng), valid)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        answers.send((number, wrong, time.process_time() - began, peak))


def seeded(seed: int, number: int) -> random.Random:
    """The randomness of an input."""
    return random.Random(f"{seed}/{number}")  # noqa: S311  # spoils files, keeps no secrets


class Hunt:
    """What was found so far: failures by place, the slowest input, the largest process."""

    def __init__(self, given: argparse.Namespace, valid: Path) -> None:
        self.given, self.valid = given, valid
        self.chosen: list[Entry] | list[Reader] = (
            [reader for reader in READERS if given.only in reader.name]
            if given.readers
            else [entry for entry in ENTRIES if given.only in f"{entry} {' '.join(entry.arguments)}"]
        )
        self.failures: Counter[str] = Counter()
        self.slowest, self.largest_mb, self.ended = (0.0, ""), 0, 0

    def entry(self, number: int) -> Entry | Reader:
        return self.chosen[number % len(self.chosen)]

    def name(self, number: int) -> str:
        entry = self.entry(number)
        return entry.name if isinstance(entry, Reader) else str(entry)

    def batch(self, rest: range) -> range:
        """Try inputs in a fresh process; gives those that are left where it had to be ended."""
        receiving, sending = multiprocessing.Pipe(duplex=False)
        arguments = (sending, rest, self.chosen, self.valid, self.given.seed)
        child = multiprocessing.get_context("spawn").Process(target=work, args=arguments)
        child.start()
        sending.close()
        number, wrong = rest.start, "no end, nor an error at the limit"
        try:
            while rest and receiving.poll(1.5 * WAITS * LIMIT_S):  # also for the process to start
                number, found, seconds, peak_mb = receiving.recv()
                rest = range(number + (found is not None), rest.stop)
                if found is not None and self._is_large(number, found, seconds, peak_mb):
                    break
            else:
                if rest:
                    self.report(number, wrong)
        except EOFError:
            child.join()
            if child.exitcode == -signal.SIGPROF:  # as for a user, who is told in one sentence
                self.ended += 1
            else:
                self.report(number, f"the process died: exit code {child.exitcode}")
            rest = range(number + 1, rest.stop)
        child.kill()
        child.join()
        return rest

    def _is_large(self, number: int, found: str, seconds: float, peak_mb: int) -> bool:
        """Note how an input ended; whether the process has grown too large to go on with."""
        self.slowest = max(self.slowest, (seconds, f"{self.name(number)}, input {number}"))
        self.largest_mb = max(self.largest_mb, peak_mb)
        large = peak_mb > MOST_MB
        if found or large:
            self.report(number, found or f"{peak_mb} MB of memory")
        return large

    def report(self, number: int, wrong: str) -> None:
        """Print a failure where its place is new, and keep its input."""
        entry = self.entry(number)
        lines = [line.strip() for line in wrong.splitlines() if line.strip().startswith('File "')]
        place = lines[-1] if lines else f"{self.name(number)}: {wrong[:80]}"
        self.failures[place] += 1
        if self.failures[place] > 1:
            return
        line = f"{' '.join(entry.arguments)}, {entry.name}" if isinstance(entry, Entry) else entry.name
        print(f"--- input {number}: {line} spoilt\n{wrong}", flush=True)
        if self.given.keep:
            self.given.keep.mkdir(parents=True, exist_ok=True)
            rng = seeded(self.given.seed, number)
            content = (
                readers.spoilt(entry, self.valid, rng) if isinstance(entry, Reader) else spoilt(entry, self.valid, rng)
            )
            (self.given.keep / f"{number}-{Path(entry.name).name}").write_bytes(content)


def main() -> None:
    """Run, and exit with 1 where anything was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=1000)
    parser.add_argument("--only", default="", help="entries whose command line holds this")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for inputs that failed")
    parser.add_argument("--readers", action="store_true", help="call the readers of tables and settings directly")
    given = parser.parse_args()
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        lay_out(Path(name))
        hunt = Hunt(given, Path(name))
        size = READ if given.readers else BATCH
        for first in range(0, given.inputs, size):
            rest = range(first, min(first + size, given.inputs))
            while rest:
                rest = hunt.batch(rest)
    kind = "readers" if given.readers else "commands"
    print(
        f"{given.inputs} inputs to {len(hunt.chosen)} {kind} with seed {given.seed}: {hunt.failures.total()} failures"
        f" at {len(hunt.failures)} places, {hunt.ended} ended by their limit;"
        f" {time.perf_counter() - began:.0f} s, slowest {hunt.slowest[0]:.1f} s CPU"
        f" ({hunt.slowest[1]}), at most {hunt.largest_mb} MB"
    )
    raise SystemExit(bool(hunt.failures))


if __name__ == "__main__":
    main()
