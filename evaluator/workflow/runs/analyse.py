"""Executing the stages of one run; errors are returned as results."""

from __future__ import annotations

from evaluator.errors import UnwritableError
from evaluator.progress import Progress, no_progress
from evaluator.workflow.runs.job import Job, RunResult, failed
from evaluator.workflow.runs.stages import bring_up_to_date


def analyse_run(job: Job, progress: Progress = no_progress) -> RunResult:
    """Analyse one run; a recording that cannot be used is a result with a reason, not an exception.

    Raises UnwritableError: a disk that is full says nothing of the run, and stops the others too.
    """
    try:
        return bring_up_to_date(job, progress)
    except UnwritableError:
        raise
    except Exception as error:  # noqa: BLE001 - a defect met in one run must not cost the others; it is reported
        return failed(job, error)
