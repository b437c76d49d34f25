"""Jobs in a separate process, one at a time: progress, cancel, pause, and resumption after a restart.

A resumed job continues where it stopped, because results are reused while they are up to date. Unfinished jobs are
listed in a file of the folder, from which the next studio resumes them.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from evaluator.files import write_text
from evaluator.studio.folder import Folder
from evaluator.studio.work import carry_out
from evaluator.workflow import PROCESSES, Outputs, available_cores, files_named, out_folder

JOURNAL = ".turnscope-studio.json"
TAKEN_UP = ("analyse", "diagnose")  # resumed after a restart; others in the file are ignored, as it may be forged
ENDED = ("done", "failed", "cancelled", "paused")
MOST_KEPT = 20  # ended jobs that are listed
CANCEL_S = 15.0  # jobs check for cancellation every second; after this time they are killed, without incomplete files


@dataclass
class Job:
    """A job with its progress; state: waiting, running or one of ENDED."""

    number: int
    kind: str
    target: str
    experiment: str = ""
    state: str = "waiting"
    stage: str = ""
    share: float = 0.0
    outdated: dict[str, list[str]] = field(default_factory=dict)
    finished: list[str] = field(default_factory=list)
    working: list[str] = field(default_factory=list)  # runs that are being analysed, on one core each
    summary: dict[str, Any] = field(default_factory=dict)
    sentence: str = ""
    began: float = 0.0
    wish: str = ""  # "cancelled" or "paused"


class Jobs:
    """Jobs of a folder, in the order of their requests."""

    def __init__(self, folder: Folder) -> None:
        """Read the unfinished jobs of an earlier studio."""
        self._folder = folder
        self._jobs: dict[int, Job] = {}
        self._orders: dict[int, dict[str, Any]] = {}
        self._done: dict[int, Callable[[], object]] = {}
        self._changed = threading.Condition()
        self._next, self._closing, self.version = 1, False, 0
        self._thread = threading.Thread(target=self._work, name="jobs", daemon=True)

    def start(self) -> None:
        """Start working, first on the unfinished jobs of the last studio."""
        self._thread.start()
        try:
            for order in json.loads((self._folder.root / JOURNAL).read_text(encoding="utf-8"))["running"]:
                if order["kind"] in TAKEN_UP:
                    experiment = self._folder.inside(Path(order["target"]))
                    for path in files_named(experiment):
                        self._folder.inside(path)
                    self.add(order["kind"], experiment)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return  # no unfinished jobs

    def add(
        self,
        kind: str,
        target: Path,
        options: dict[str, Any] | None = None,
        done: Callable[[], object] | None = None,
    ) -> int:
        """Add a job for a file or folder, unless an equal one waits or runs already. done: called afterwards."""
        relative = self._folder.relative(target)
        with self._changed:
            for job in self._jobs.values():
                if (job.kind, job.target) == (kind, relative) and job.state not in ENDED and not job.wish:
                    return job.number
            for one in [n for n, j in self._jobs.items() if (j.kind, j.target, j.state) == (kind, relative, "paused")]:
                del self._jobs[one]  # continued as the new one
            job = Job(self._next, kind, relative, self._folder.id_of(target))
            self._next += 1
            self._jobs[job.number] = job
            self._orders[job.number] = {"kind": kind, "target": relative, "options": options or {}}
            if done is not None:
                self._done[job.number] = done
            for number in [n for n, j in self._jobs.items() if j.state in ENDED][:-MOST_KEPT]:
                del self._jobs[number]
            self._tell()
        return job.number

    def end(self, number: int, how: str) -> None:
        """Cancel or pause a job; completed results are kept in both cases."""
        with self._changed:
            job = self._jobs.get(number)
            if job is None or job.state in ENDED:
                return
            job.wish = how
            if job.state == "waiting":
                job.state = how
            self._tell()

    def view(self) -> list[dict[str, Any]]:
        """All jobs as plain values, newest first."""
        with self._changed:
            return [asdict(job) for job in reversed(self._jobs.values())]

    def close(self) -> None:
        """Stop working; the next studio resumes unfinished jobs."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(CANCEL_S)

    def _tell(self) -> None:
        self.version += 1
        running = [self._orders[n] for n, job in self._jobs.items() if job.state not in ENDED and not job.wish]
        path = self._folder.root / JOURNAL
        if running:
            write_text(path, json.dumps({"format": 1, "running": running}) + "\n")
        elif not self._closing:
            path.unlink(missing_ok=True)
        self._changed.notify_all()

    def _work(self) -> None:
        while True:
            with self._changed:
                waiting = [job for job in self._jobs.values() if job.state == "waiting"]
                if self._closing:
                    return
                if not waiting:
                    self._changed.wait()
                    continue
                job = waiting[0]
                job.state, job.began = "running", time.time()
                self._tell()
            self._run(job)

    def _run(self, job: Job) -> None:
        ours, theirs = PROCESSES.Pipe()
        order = self._orders[job.number]
        # Not a daemon, because it starts worker processes. It ends when this end of the pipe is closed.
        process = PROCESSES.Process(
            target=carry_out, args=(theirs, job.kind, self._folder.root / job.target, order["options"])
        )
        process.start()
        theirs.close()
        told_at = 0.0
        try:
            while True:
                if ours.poll(0.2):
                    self._note(job, ours.recv())
                if (job.wish or self._closing) and not told_at:
                    ours.send("end")
                    told_at = time.monotonic()
                if job.state in ENDED or (told_at and time.monotonic() > told_at + CANCEL_S):
                    break
        except (EOFError, OSError):
            pass
        ours.close()
        process.join(2.0)
        if process.is_alive():
            process.kill()
        with self._changed:
            if job.state not in ENDED:
                job.state = job.wish or ("waiting" if self._closing else "failed")
                job.sentence = "" if job.wish else "its process was ended (out of memory?); start it again to go on"
            if not self._closing:
                self._tell()

    def _note(self, job: Job, message: tuple[str, Any]) -> None:
        kind, value = message
        with self._changed:
            if kind == "progress":
                job.stage, job.share = value
                job.finished = self._finished(job)
                job.working = _first_unfinished(job)
            elif kind == "outdated":
                job.outdated = value
                job.working = _first_unfinished(job)
            elif not (self._closing and kind == "cancelled"):
                job.state = job.wish if kind == "cancelled" else kind
                job.state = job.state or "cancelled"
                job.summary, job.sentence = (value, "") if kind == "done" else ({}, str(value or ""))
                job.share = 1.0 if kind == "done" else job.share
                done = self._done.pop(job.number, None)
                if kind == "done" and done is not None:
                    done()
            if not self._closing:
                self._tell()

    def _finished(self, job: Job) -> list[str]:
        """Runs with a record written since the start of the job."""
        outputs = Outputs(out_folder(self._folder.root / job.target))

        def done(run: str) -> bool:
            path = outputs.record(run)
            return path.is_file() and path.stat().st_mtime >= job.began

        return [run for run, steps in job.outdated.items() if steps and done(run)]


def _first_unfinished(job: Job) -> list[str]:
    """The runs that are being analysed: workers take them in the order of the experiment."""
    waiting = [run for run, steps in job.outdated.items() if steps and run not in job.finished]
    return waiting[: available_cores()]
