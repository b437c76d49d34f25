"""Results for other programs: one JSON file of all runs, and a netCDF file per run in the layout of movement.

Both contain the provenance. The netCDF files have the classic format and are reproducible byte by byte; xarray and
movement open them: position (mm, plate frame) over time, space, keypoints (the marks, then center) and individuals.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.io import netcdf_file

from evaluator.files import refuse_to_replace, write_text, written_whole
from evaluator.marks import mark_names, read_marks
from evaluator.progress import Progress, no_progress
from evaluator.workflow.analysis import Analysis, compare, input_files
from evaluator.workflow.results.outputs import Outputs

CENTER = "center"
DIMENSIONS = ("time", "space", "keypoints", "individuals")


def export(
    experiment: Analysis | Path | str,
    out: Path | str = "out",
    *,
    workers: int | None = None,
    progress: Progress = no_progress,
) -> list[Path]:
    """Write results.json and netcdf/RUN.nc into the output folder; returns their paths.

    experiment: an analysis, or an experiment.toml whose results below out are brought up to date first.
    """
    if isinstance(experiment, Analysis):
        analysis = experiment
    else:
        analysis = compare(experiment, out, workers=workers, progress=progress)
    outputs, runs = analysis.outputs, [run.id for run in analysis.experiment.run]
    refuse_to_replace(input_files(analysis.experiment), outputs.of_export(runs))
    provenance = json.loads(outputs.provenance.read_text(encoding="utf-8"))
    results: dict[str, Any] = {"format": 1, "provenance": provenance, "faults": analysis.faults}
    results["notes"] = analysis.notes
    for name in ("turning", "pooled", "directions"):
        results[name] = records(getattr(analysis, name))
    if analysis.comparison is not None:
        results["comparison"] = records(analysis.comparison)
    write_text(outputs.results, json.dumps(results, indent=1, allow_nan=False) + "\n")
    paths = [outputs.results]
    for run in analysis.experiment.run:
        if run.id not in analysis.faults:
            paths.append(outputs.netcdf(run.id))
            with written_whole(paths[-1]) as temporary:
                write_netcdf(outputs, run.id, temporary, provenance)
    return paths


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """A table as a list of objects; numbers that are not finite become null."""
    found: list[dict[str, Any]] = json.loads(table.to_json(orient="records", double_precision=15))
    return found


def write_netcdf(outputs: Outputs, run: str, path: Path, provenance: dict[str, Any]) -> None:
    """Write marks and poses of one run as a movement dataset of poses."""
    marks, poses = read_marks(outputs.marks(run)), pd.read_csv(outputs.poses(run))
    names = mark_names(marks)
    position = np.stack([*(_place(marks, f"{name}_") for name in names), _place(poses, "")], axis=-1)
    sigma = np.stack([*(_sigma(marks, f"{name}_") for name in names), _sigma(poses, "")], axis=-1)
    with netcdf_file(path, "w", version=2) as file:
        file.createDimension("time", len(marks))
        _variable(file, "time", ("time",), marks["time_s"].to_numpy(), "s")
        for name, labels in (("space", ("x", "y")), ("keypoints", (*names, CENTER)), ("individuals", ("robot",))):
            _labels(file, name, labels)
        _variable(file, "position", DIMENSIONS, position[..., None], "mm")
        _variable(file, "position_sigma", DIMENSIONS, sigma[..., None], "mm")
        # movement requires a confidence of every point; the uncertainty is in position_sigma.
        measured = np.isfinite(position).all(axis=1).astype(float)
        _variable(file, "confidence", DIMENSIONS[:1] + DIMENSIONS[2:], measured[..., None], "1 measured, 0 absent")
        _variable(file, "heading", ("time",), poses["heading_deg"].to_numpy(), "degree")
        attributes = {"ds_type": "poses", "time_unit": "seconds", "source_software": "turnscope", "run": run}
        for key, value in {**attributes, "provenance": json.dumps(provenance, sort_keys=True)}.items():
            setattr(file, key, value)


def _place(table: pd.DataFrame, prefix: str) -> np.ndarray:
    return table[[f"{prefix}x_mm", f"{prefix}y_mm"]].to_numpy(float)


def _sigma(table: pd.DataFrame, prefix: str) -> np.ndarray:
    return table.reindex(columns=[f"{prefix}x_sigma_mm", f"{prefix}y_sigma_mm"]).to_numpy(float)


def _variable(file: netcdf_file, name: str, dimensions: tuple[str, ...], values: np.ndarray, units: str) -> None:
    variable = file.createVariable(name, "d", dimensions)
    variable[:] = values
    setattr(variable, "units", units)  # noqa: B010 - netCDF attributes are Python attributes


def _labels(file: netcdf_file, name: str, labels: tuple[str, ...]) -> None:
    width = max(map(len, labels))
    file.createDimension(name, len(labels))
    file.createDimension(f"{name}_length", width)
    variable = file.createVariable(name, "c", (name, f"{name}_length"))
    variable[:] = np.array([list(label.ljust(width, "\0")) for label in labels], "S1")
    setattr(variable, "_Encoding", "utf-8")  # noqa: B010 - netCDF attributes are Python attributes
