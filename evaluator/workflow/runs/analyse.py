"""Executing the stages of one run; errors are returned as results."""

from __future__ import annotations

from evaluator.errors import UnwritableError
from evaluator.progress import Progress, no_progress
from evaluator.workflow.runs.job import Job, RunResult, failed
from evaluator.workflow.runs.stages import bring_up_to_date


def analyse_run(job: Job, progress: Progress = no_progress) -> RunResult:
    """Analyse one run; a recording that cannot be used is a result with a reason, not an exception.

    Raises UnwritableError, because a full disk is not a property of the run, and affects all others too.
    """
    try:
        return bring_up_to_date(job, progress)
    except UnwritableError:
        raise
    except Exception as error:  # noqa: BLE001 - a defect in one run must not stop the others; it is reported
        return failed(job, error)
