"""An experiment as a whole: every run in parallel, then the tables of runs and where they came from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evaluator.errors import InputError
from evaluator.files import read_with, write_table
from evaluator.progress import Progress, no_progress
from evaluator.settings import Experiment, load_experiment
from evaluator.workflow.execution.batch import available_cores, in_processes, on_cluster
from evaluator.workflow.jobs import Job, RunResult, analyse_run, known_result, lost_run, outdated_stages
from evaluator.workflow.outputs import Outputs
from evaluator.workflow.provenance import write_provenance
from simulator.robot import Robot, load_robot

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Analysis:
    """What an analysis leaves: tables with a row per run, and the reason for every run that has no numbers.

    notes: what is odd about the recordings of runs.
    pooled: a row per command, its repetitions pooled; directions: a row per command driven both ways.
    """

    experiment: Experiment
    outputs: Outputs
    turning: pd.DataFrame
    pooled: pd.DataFrame
    directions: pd.DataFrame
    comparison: pd.DataFrame | None
    faults: dict[str, str]
    notes: dict[str, tuple[str, ...]]
    reused: int


def analyze(
    experiment_path: Path,
    out: Path,
    *,
    simulate: bool = False,
    workers: int | None = None,
    dask: str | None = None,
    progress: Progress = no_progress,
    command_line: Sequence[str] = (),
) -> Analysis:
    """Measure every run of an experiment (and simulate its counterpart), reusing what is up to date.

    Writes turning.csv, pooled.csv, directions.csv, marks/ and poses/ below out; with simulate also comparison.csv and
    simulated/; and provenance.json. A comparison.csv of earlier results does not stay beside new ones. A run that
    cannot be analysed is named in `faults` with its reason and does not stop the others.
    workers: processes, by default one per core; dask: address of a Dask scheduler whose workers see the same files
    under the same names. The results depend on neither.
    Raises InputError where the experiment cannot be used, or none of its runs can.
    """
    experiment = read_with(load_experiment, experiment_path)
    outputs = Outputs(Path(out))
    jobs = jobs_of(experiment, outputs, simulate=simulate)
    results = {job.run.id: result for job in jobs if (result := known_result(job))}
    todo = [job for job in jobs if job.run.id not in results]
    progress(len(results), len(jobs))
    for result in _answers(todo, workers, dask):
        results[result.run] = result
        progress(len(results), len(jobs))
    faults = {run.id: fault for run in experiment.run if (fault := results[run.id].fault)}
    if len(faults) == len(jobs):
        raise InputError(_nothing_left(faults))
    turning = _table(
        experiment, [results[run.id].turning or {"radius_status": faults[run.id]} for run in experiment.run]
    )
    write_table(turning, outputs.turning)
    pooled, directions = _pool(turning, outputs)
    comparison = None
    if simulate:
        comparison = _table(experiment, [results[run.id].comparison or {} for run in experiment.run])
        write_table(comparison, outputs.comparison)
    elif any(not result.reused for result in results.values()):
        outputs.comparison.unlink(missing_ok=True)  # it compared what no longer is
    write_provenance(
        outputs.provenance, experiment_path=experiment_path, inputs=input_files(experiment), command_line=command_line
    )
    notes = {run.id: found for run in experiment.run if (found := results[run.id].notes)}
    reused = sum(result.reused for result in results.values())
    return Analysis(experiment, outputs, turning, pooled, directions, comparison, faults, notes, reused)


def _answers(jobs: Sequence[Job], workers: int | None, dask: str | None) -> Iterator[RunResult]:
    if dask is not None:
        return on_cluster(analyse_run, jobs, address=dask, when_killed=lost_run)
    return in_processes(analyse_run, jobs, workers=workers or available_cores(), when_killed=lost_run)


def plan(experiment_path: Path, out: Path, *, simulate: bool = False) -> dict[str, list[str]]:
    """Stages that `analyze` would compute, by run; an empty list where everything is up to date."""
    experiment = read_with(load_experiment, experiment_path)
    return {job.run.id: _outdated(job) for job in jobs_of(experiment, Outputs(Path(out)), simulate=simulate)}


def jobs_of(experiment: Experiment, outputs: Outputs, *, simulate: bool) -> list[Job]:
    """The job of every run. Raises InputError for a robot that cannot be read: it concerns more than one run."""
    robots: dict[str, Robot] = {}
    for run in experiment.run:
        name = run.robot or experiment.robot
        if name not in robots:
            robots[name] = read_with(load_robot, Path(name))
    # Absolute, for workers that were not started where this process was.
    shared = (experiment.tracking, experiment.tracks, outputs.folder.resolve(), simulate)
    return [
        Job(run, robots[run.robot or experiment.robot], *shared, order=order)
        for order, run in enumerate(experiment.run)
    ]


def input_files(experiment: Experiment) -> list[Path]:
    """Every file the experiment reads, that there is."""
    robots = [Path(name) for run in experiment.run if (name := run.robot or experiment.robot).endswith(".toml")]
    named = [path for run in experiment.run for path in (run.video, run.marks, run.camera) if path]
    return sorted({path for path in (*robots, *named, experiment.tracking) if path and path.is_file()})


def _outdated(job: Job) -> list[str]:
    try:
        return outdated_stages(job)
    except OSError as error:
        return [f"cannot be read: {error.filename}: {error.strerror}"]


def _table(experiment: Experiment, found: Sequence[dict[str, Any]]) -> pd.DataFrame:
    """A row per run, in the order of the file; columns in the order of a run that has them all."""
    import pandas as pd

    described = [{"run": run.id, "left_rpm": run.left_rpm, "right_rpm": run.right_rpm} for run in experiment.run]
    rows = [
        {**head, **row, "group": run.group} for head, row, run in zip(described, found, experiment.run, strict=True)
    ]
    complete: dict[str, Any] = max(rows, key=len)
    return pd.DataFrame(rows, columns=list(complete))


def _pool(turning: pd.DataFrame, outputs: Outputs) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Repetitions pooled, and backward set against forward where commands were driven both ways; both written."""
    from evaluator.turning.repetitions import compare_directions, pool_runs

    pooled, directions = pool_runs(turning), compare_directions(turning)
    write_table(pooled, outputs.pooled)
    if directions.empty:
        outputs.directions.unlink(missing_ok=True)
    else:
        write_table(directions, outputs.directions)
    return pooled, directions


def _nothing_left(faults: dict[str, str]) -> str:
    if len(faults) == 1:
        return next(iter(faults.values()))
    runs_by_reason: dict[str, list[str]] = {}
    for run, fault in faults.items():
        runs_by_reason.setdefault(fault, []).append(run)
    reasons = "; ".join(f"{', '.join(runs)}: {fault}" for fault, runs in runs_by_reason.items())
    return f"none of the {len(faults)} runs can be analysed: {reasons}"
