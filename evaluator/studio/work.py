"""The process of a job: calls workflow, reports progress, and stops on request or when the studio has ended."""

from __future__ import annotations

import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from evaluator.progress import Cancelled

TELL_S = 0.15  # a bar that moves as smoothly as one can see
Json = dict[str, Any]


def carry_out(pipe: Connection, kind: str, target: Path, options: Json) -> None:
    """Do one kind of work; the last message is done, failed or cancelled."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the studio handles interrupts, and stops this process
    progress = _PipeProgress(pipe)
    try:
        pipe.send(("done", KINDS[kind](progress, target, options)))
    except Cancelled:
        progress.finally_say("cancelled", "")
    except (ValueError, OSError) as error:
        named = (
            f"{Path(error.filename).name}: {error.strerror}" if isinstance(error, OSError) and error.filename else error
        )
        progress.finally_say("failed", str(named))
    except Exception as error:  # noqa: BLE001 - the studio reports it, and continues
        progress.finally_say("failed", f"unexpected {type(error).__name__}: {error}")


class _PipeProgress:
    """A Progress that sends over a pipe."""

    def __init__(self, pipe: Connection) -> None:
        self.pipe = pipe
        self._last = 0.0

    def __call__(self, stage: str, done: float, total: float = 1.0, /) -> None:
        """Send progress, at most every TELL_S. Raises Cancelled."""
        try:
            if self.pipe.poll():
                self.pipe.recv()
                raise Cancelled
            now = time.monotonic()
            if now - self._last >= TELL_S or done >= total:
                self._last = now
                self.pipe.send(("progress", (stage, done / total if total else 0.0)))
        except (EOFError, OSError) as error:  # the studio has ended; the next one resumes the job
            raise Cancelled from error

    def finally_say(self, kind: str, value: Any) -> None:
        """Send the last message; the studio may have ended already."""
        try:
            self.pipe.send((kind, value))
        except (OSError, ValueError):
            return


def _analyse(progress: _PipeProgress, experiment: Path, options: Json) -> Json:
    from evaluator.workflow import compare, out_folder, pending

    del options
    out = out_folder(experiment)
    progress.pipe.send(("outdated", pending(experiment, out, simulate=True)))
    found = compare(experiment, out, progress=progress, command_line=("studio",))
    return {"faults": found.faults, "notes": {run: list(said) for run, said in found.notes.items()}}


def _diagnose(progress: _PipeProgress, experiment: Path, options: Json) -> Json:
    from evaluator.workflow import diagnose, out_folder

    summary = _analyse(progress, experiment, options)
    found = diagnose(experiment, out_folder(experiment), progress=progress)
    return {**summary, "verdict": found.verdict, "effects": list(found.effects)}


def _samples(progress: _PipeProgress, folder: Path, options: Json) -> Json:
    from evaluator.workflow import prepare_samples

    del options
    samples = prepare_samples(folder, progress)
    return {"verdict": samples.calibrated.verdict.summary}


def _calibrate(progress: _PipeProgress, gauge: Path, options: Json) -> Json:
    from evaluator.workflow import calibrate

    images = [Path(image) for image in options["images"]]
    found = calibrate(images, gauge, plate=options.get("plate", 0), progress=progress)
    found.save(Path(options["camera"]))
    return {"verdict": found.verdict.summary, "level": found.verdict.level}


KINDS: dict[str, Callable[[_PipeProgress, Path, Json], Json]] = {
    "analyse": _analyse,
    "diagnose": _diagnose,
    "samples": _samples,
    "calibrate": _calibrate,
}
