"""The results of the last analysis and the last diagnosis of an experiment, for the plots of a front end."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from evaluator.files import read_with
from evaluator.files.csv_tables import read_runs
from evaluator.settings import load_experiment
from evaluator.workflow.editing.unfinished import read_unfinished
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.runs.stored_diagnosis import load_diagnosis
from evaluator.workflow.viewing.overview import out_folder

MOST_POINTS = 200  # of a drawn path: errors below a tenth of a pixel for a turn that fills its panel
MEASURED = (
    *("radius_mm", "radius_low_mm", "radius_high_mm", "radius_status", "speed_mm_s", "yaw_rate_deg_s", "turned_deg"),
    *("center_x_mm", "center_y_mm", "sustained_from_s", "share_used", "group"),
)
COMPARED = ("simulated_radius_mm", "simulated_speed_mm_s", "simulated_yaw_rate_deg_s", "gap_rms_mm", "gap_end_mm")


@dataclass(frozen=True)
class Results:
    """A row per analysed run: id, command, numbers of turning.csv and comparison.csv, paths thinned, mm.

    gap_mm: RMS of the gaps of all runs, each simulated from its measured start; NaN if there are none.
    """

    name: str
    runs: tuple[dict[str, Any], ...]
    gap_mm: float


@dataclass(frozen=True)
class DiagnosisView:
    """content: of diagnosis.json, None if there is none. pieces: columns of disagreement.csv by name."""

    content: dict[str, Any] | None
    pieces: dict[str, Any] = field(default_factory=dict)
    robot_with_effect: str = ""


def results_view(experiment: Path) -> Results:
    """Measured and simulated values of every run with results. Raises InputError for an unreadable experiment."""
    outputs = Outputs(out_folder(experiment))
    if not outputs.turning.is_file():
        return Results(read_unfinished(experiment).name, (), float("nan"))
    described = read_with(load_experiment, experiment)
    measured = _by_run(outputs.turning)
    compared = _by_run(outputs.comparison) if outputs.comparison.is_file() else {}
    runs = []
    for run in described.run:
        row = measured.get(run.id)
        if row is None or not outputs.poses(run.id).is_file():
            continue
        both = {**{name: row.get(name) for name in MEASURED}, **{n: compared.get(run.id, {}).get(n) for n in COMPARED}}
        runs.append(
            {
                "id": run.id,
                "left_rpm": run.left_rpm,
                "right_rpm": run.right_rpm,
                "has_video": run.video is not None,
                **both,
                "path": _path(outputs.poses(run.id)),
                "simulated": _path(outputs.simulated(run.id)) if outputs.simulated(run.id).is_file() else None,
            }
        )
    gaps = np.array([run["gap_rms_mm"] for run in runs if run["gap_rms_mm"] is not None], float)
    gaps = gaps[np.isfinite(gaps)]
    return Results(described.name, tuple(runs), float(np.sqrt(np.mean(gaps**2))) if len(gaps) else float("nan"))


def diagnosis_view(experiment: Path) -> DiagnosisView:
    """The last diagnosis of an experiment. Raises InputError if its file cannot be read."""
    outputs = Outputs(out_folder(experiment))
    if not outputs.diagnosis.is_file():
        return DiagnosisView(None)
    pieces: dict[str, Any] = {}
    if outputs.disagreement.is_file():
        table = read_runs(outputs.disagreement)
        pieces = {str(name): table[name].tolist() for name in table}
    there = outputs.robot_with_effect
    text = there.read_text(encoding="utf-8") if there.is_file() else ""
    return DiagnosisView(load_diagnosis(outputs.diagnosis), pieces, text)


def _by_run(path: Path) -> dict[str, dict[str, Any]]:
    table = read_runs(path).astype(object)
    rows = table.where(table.notna(), None).to_dict("records")
    return {str(row["run"]): {str(name): value for name, value in row.items()} for row in rows}


def _path(poses: Path) -> dict[str, Any]:
    table = pd.read_csv(poses, usecols=["time_s", "x_mm", "y_mm", "heading_deg"]).dropna()
    step = max(1, -(-len(table) // MOST_POINTS))
    chosen = table.iloc[sorted({*range(0, len(table), step), len(table) - 1})] if len(table) else table
    return {name: chosen[name].round(4).tolist() for name in ("time_s", "x_mm", "y_mm", "heading_deg")}
