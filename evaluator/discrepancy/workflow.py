"""The diagnosis of an experiment file: marks from files or videos in, diagnosis.json and a better robot file out."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from evaluator.discrepancy.added import robot_text, robot_with_effect
from evaluator.discrepancy.diagnosis import Diagnosis, diagnose
from evaluator.discrepancy.experiment import Session, session_of
from evaluator.discrepancy.record import record
from evaluator.errors import InputError
from evaluator.files import read_with, write_text
from evaluator.settings import Experiment, load_experiment
from evaluator.workflow.outputs import Outputs

Progress = Callable[[str, float], None]


def diagnose_experiment(path: Path, out: Path, progress: Progress) -> tuple[Diagnosis, dict[str, Any]]:
    """Diagnose an experiment and write the results below out; gives the diagnosis and the content of diagnosis.json.

    Raises InputError where the experiment, a robot or all recordings cannot be used.
    """
    experiment = read_with(load_experiment, path)
    session = _session(path, experiment, out, progress)
    try:
        found = diagnose(session, progress)
    except FloatingPointError as error:
        raise InputError(f"{path}: {error}; are the robot file and the command of that run right?") from error
    content = record(found)
    if found.verdict in ("effect", "unknown") and found.search is not None and found.chosen:
        text = robot_with_effect(found, read_with(robot_text, experiment.robot))  # type: ignore[arg-type]
        write_text(out / "robot_with_effect.toml", text)
    write_text(Outputs(out).diagnosis, json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    return found, content


def _session(path: Path, experiment: Experiment, out: Path, progress: Progress) -> Session:
    """Marks as given, or tracked where a run is a video (what is up to date is reused)."""
    marks = {run.id: run.marks for run in experiment.run if run.marks is not None}
    faults: dict[str, str] = {}
    if len(marks) < len(experiment.run):
        from evaluator.workflow import analyze

        progress("tracking", 0.0)
        analysis = analyze(path, out, progress=lambda done, total: progress("tracking", done / max(total, 1)))
        faults = dict(analysis.faults)
        marks |= {
            run.id: analysis.outputs.marks(run.id) for run in experiment.run if run.video and run.id not in faults
        }
    session = session_of(experiment, marks)
    if not session.data:
        raise InputError(f"{path}: no run has marks that can be used")
    return Session(session.data, session.robots, {**session.skipped, **faults})
