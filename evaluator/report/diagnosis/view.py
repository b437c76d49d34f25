"""A diagnosis for the report: diagnosis.json, the residuals of the runs, and whether it is up to date."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from evaluator.diagnosis.assessment.residuals.disagreement import COLUMNS, QUANTITIES
from evaluator.files.csv_tables import read_runs
from evaluator.settings import Experiment
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.runs.stored_diagnosis import earlier_diagnosis

OUTDATED = (
    "the diagnosis is out of date, because recordings, robot or program changed after it: run turnscope diagnose again"
)


@dataclass(frozen=True)
class DiagnosisView:
    """content: of diagnosis.json. pieces: of disagreement.csv, or None. outdated: whether inputs have changed."""

    content: dict[str, Any]
    pieces: pd.DataFrame | None
    outdated: bool


def known_diagnosis(experiment: Experiment, outputs: Outputs) -> DiagnosisView | None:
    """The diagnosis in an output folder; None without one."""
    kept = earlier_diagnosis(experiment, outputs)
    if kept is None:
        return None
    return DiagnosisView(kept.content, _pieces(outputs.disagreement), kept.outdated)


def _pieces(path: Path) -> pd.DataFrame | None:
    """Pieces of the runs; None without a file or for a file in another format."""
    try:
        table = read_runs(path)
    except (OSError, ValueError):
        return None
    needed = {*COLUMNS, *(f"after_{name}" for name in QUANTITIES)}
    return table if needed <= set(table) else None
