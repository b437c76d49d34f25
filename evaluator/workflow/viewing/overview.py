"""Summaries of the experiments and cameras in a folder, and which results are up to date."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.settings import load_experiment
from evaluator.workflow.editing.experiments import read_experiment
from evaluator.workflow.results.outputs import Outputs

MOST_BYTES = 2_000_000  # of a file that is read as an experiment or a camera


@dataclass(frozen=True)
class ExperimentSummary:
    """An experiment.toml: its name, number of runs, and the fault because of which it cannot be read."""

    path: Path
    name: str
    runs: int
    videos: int
    fault: str = ""


@dataclass(frozen=True)
class CameraSummary:
    """A camera.json: its verdict and the relative uncertainty of lengths at mark height."""

    path: Path
    level: str
    summary: str
    scale_sigma: float


@dataclass(frozen=True)
class ResultsState:
    """State of an experiment's results. outdated: steps to compute by run; diagnosis: none, current, stale."""

    outdated: dict[str, list[str]]
    results: bool
    diagnosis: str
    fault: str = ""


def out_folder(experiment: Path) -> Path:
    """Default folder of results: `out` beside an experiment.toml, `out-NAME` beside a file of another name."""
    return experiment.parent / ("out" if experiment.stem == "experiment" else f"out-{experiment.stem}")


def experiments_among(files: Iterable[Path]) -> list[ExperimentSummary]:
    """The experiment files among some files."""
    return [found for path in files if path.suffix == ".toml" and (found := _experiment(path)) is not None]


def cameras_among(files: Iterable[Path]) -> list[CameraSummary]:
    """The camera files among some files."""
    return [found for path in files if path.suffix == ".json" and (found := _camera(path)) is not None]


def files_named(experiment: Path) -> list[Path]:
    """Every file that an experiment names, whether or not it exists. Raises InputError for an unreadable experiment."""
    described = read_with(load_experiment, experiment)
    robots = [Path(run.robot or described.robot) for run in described.run]
    named = [path for run in described.run for path in (run.source, run.camera, run.corrections, run.commands) if path]
    files = [robot for robot in robots if robot.suffix == ".toml"]
    return sorted({*files, *named, *([described.tracking] if described.tracking else [])})


def results_state(experiment: Path) -> ResultsState:
    """State of an experiment's results by content, which requires reading every recording."""
    from evaluator.workflow.analysis import pending
    from evaluator.workflow.runs.stored_diagnosis import is_current, key_of_diagnosis, own_effect_ids
    from simulator.errors import SimulationError

    out = out_folder(experiment)
    outputs = Outputs(out)
    try:
        outdated = pending(experiment, out, simulate=True)
        diagnosis = "none"
        if outputs.diagnosis.is_file():
            described = read_with(load_experiment, experiment)
            key = key_of_diagnosis(described, outputs, own_effect_ids(experiment, described))
            diagnosis = "current" if is_current(outputs, key) else "stale"
    except (InputError, SimulationError) as error:
        return ResultsState({}, outputs.turning.is_file(), "none", _in_short(experiment, str(error)))
    return ResultsState(outdated, outputs.comparison.is_file(), diagnosis)


def _in_short(experiment: Path, sentence: str) -> str:
    """A short sentence on why an experiment cannot be analysed: a single fault, or the number of faults."""
    try:
        faults = read_experiment(experiment).faults
    except InputError:
        return sentence
    return (
        f"{len(faults)} values are missing or wrong; they are marked in the table of runs"
        if len(faults) > 1
        else sentence
    )


def _experiment(path: Path) -> ExperimentSummary | None:
    try:
        if path.stat().st_size > MOST_BYTES:
            return None
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        said = path.name.startswith("experiment")
        return ExperimentSummary(path, path.parent.name, 0, 0, f"{path.name}: {error}") if said else None
    runs = content.get("run")
    if not isinstance(runs, list) and path.name != "experiment.toml":
        return None
    tables = [run for run in runs or [] if isinstance(run, dict)]
    videos = sum("video" in run for run in tables)
    return ExperimentSummary(path, str(content.get("name", path.stem)), len(tables), videos)


def _camera(path: Path) -> CameraSummary | None:
    try:
        if path.stat().st_size > MOST_BYTES:
            return None
        content = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict) or content.get("kind") != "camera":
            return None
        verdict = content["verdict"]
        return CameraSummary(path, str(verdict["level"]), str(verdict["summary"]), float(verdict["scale_sigma"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
