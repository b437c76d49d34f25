"""Analysis of a whole experiment: all runs in parallel, then the tables of runs and their provenance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from evaluator.errors import InputError
from evaluator.files import read_with, refuse_to_replace
from evaluator.files.csv_tables import write_table
from evaluator.progress import Progress, no_progress, part_way
from evaluator.settings import Experiment, load_experiment
from evaluator.workflow.execution.answers import answers_of
from evaluator.workflow.results.belonging import claimed
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.results.provenance import write_provenance
from evaluator.workflow.results.unchanged import AsFound
from evaluator.workflow.runs.job import Job, RunResult, jobs_of, known_result, lost_run, outdated_stages, step_of
from evaluator.workflow.runs.mistakes import mistakes_of_marks, with_sentences, without_explained

if TYPE_CHECKING:
    import pandas as pd

    from evaluator.diagnosis.mistakes.recognised import Mistake


MOST_NAMED = 5  # runs, or reasons, in a sentence
# Columns of turning.csv that a notebook shows.
SHOWN = (
    *("run", "left_rpm", "right_rpm", "radius_mm", "radius_low_mm", "radius_high_mm"),
    *("speed_mm_s", "yaw_rate_deg_s", "radius_status"),
)


@dataclass(frozen=True, repr=False)
class Analysis:
    """Results of an analysis: tables with a row per run, and a reason for every run without results.

    notes: peculiarities of the recordings of runs. mistakes: runs that contradict their commands or the robot file.
    pooled: a row per command, its repetitions pooled; directions: a row per command driven both ways. changed: inputs
    that were changed during the analysis.
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
    mistakes: tuple[Mistake, ...] = ()
    changed: tuple[Path, ...] = ()

    @property
    def excluded_runs(self) -> frozenset[str]:
        """Runs with mistakes in the experiment file: measured, but left out of every comparison of runs."""
        return frozenset(run for item in self.mistakes if not item.everywhere for run in item.runs)

    def __repr__(self) -> str:
        """One line: the experiment, its runs and the folder of the results."""
        return f"Analysis({self._title()})"

    def _repr_html_(self) -> str:
        """The first columns of turning.csv, for notebooks."""
        shown = [name for name in SHOWN if name in self.turning]
        table = self.turning[shown].to_html(index=False, float_format="{:.4g}".format, na_rep="")
        return f"<p>{escape(self._title())}</p>{table}"

    def _title(self) -> str:
        lost = f", {len(self.faults)} without results" if self.faults else ""
        return f"{self.experiment.name}: {len(self.turning)} runs{lost}, in {self.outputs.folder}"


def analyze(
    experiment: Path | str,
    out: Path | str = "out",
    *,
    simulate: bool = False,
    workers: int | None = None,
    dask: str | None = None,
    progress: Progress = no_progress,
    command_line: Sequence[str] = (),
) -> Analysis:
    """Measure every run of an experiment.toml (and simulate it), reusing results that are up to date.

    Writes turning.csv, pooled.csv, directions.csv, marks/ and poses/ below out; with simulate also comparison.csv and
    simulated/; and provenance.json. A comparison.csv of earlier results is removed. A run that cannot be analysed is
    listed in `faults` with its reason and does not stop the others.
    workers: processes, by default one per core; dask: address of a Dask scheduler whose workers see the same files
    under the same names. The results depend on neither. If cancelled, the results of completed runs are kept.
    Raises InputError if the experiment or all of its runs cannot be used, or if out holds results of another one.
    """
    path = Path(experiment)
    as_found, text = AsFound.of([path]), read_with(_text_of, path)
    described = read_with(load_experiment, path)
    outputs = Outputs(Path(out))
    inputs = input_files(described)
    refuse_to_replace(inputs, outputs.of_analysis(run.id for run in described.run))
    as_found |= AsFound.of(inputs)
    jobs = jobs_of(described, outputs, simulate=simulate)
    with claimed(outputs, described):
        results = results_of(jobs, workers, dask, progress)
        faults = _faults(described, results)
    turning = _turning(described, results, faults)
    write_table(turning, outputs.turning)
    comparison = None
    if simulate:
        comparison = _table(described, [results[run.id].comparison or ({},) for run in described.run])
        write_table(comparison, outputs.comparison)
    elif any(not result.reused for result in results.values()):
        outputs.comparison.unlink(missing_ok=True)  # it belongs to earlier results
    changed = tuple(as_found.changed())
    write_provenance(outputs.provenance, path, text, inputs, changed, command_line)
    marks = {run.id: outputs.marks(run.id) for run in described.run if run.id not in faults}
    mistakes = without_explained(mistakes_of_marks(described, marks), described, outputs)
    notes = with_sentences(_notes(described, results, mistakes), mistakes)
    reused = sum(result.reused for result in results.values())
    empty = turning.iloc[:0]
    measured = Analysis(described, outputs, turning, empty, empty, comparison, faults, notes, reused, mistakes, changed)
    pooled, directions = _pool(turning[~turning["run"].isin(measured.excluded_runs)], outputs)
    return replace(measured, pooled=pooled, directions=directions)


def compare(
    experiment: Path | str,
    out: Path | str = "out",
    *,
    workers: int | None = None,
    dask: str | None = None,
    progress: Progress = no_progress,
    command_line: Sequence[str] = (),
) -> Analysis:
    """Compare every run of an experiment.toml with its simulation: `analyze` with simulate."""
    return analyze(
        experiment, out, simulate=True, workers=workers, dask=dask, progress=progress, command_line=command_line
    )


def measure(
    experiment: Path | str, out: Path | str = "out", *, workers: int | None = None, progress: Progress = no_progress
) -> Analysis:
    """Measure every run of an experiment.toml without what compares runs with the model: a first part of `analyze`.

    Writes marks/ and poses/ below out, which `analyze` and `compare` reuse; the tables are not written, and mistakes
    are not sought. Raises InputError as `analyze` does.
    """
    described, outputs = read_with(load_experiment, Path(experiment)), Outputs(Path(out))
    refuse_to_replace(input_files(described), outputs.of_analysis(run.id for run in described.run))
    jobs = jobs_of(described, outputs, simulate=False)
    with claimed(outputs, described):
        results = results_of(jobs, workers, progress=progress)
        faults = _faults(described, results)
    turning = _turning(described, results, faults)
    empty = turning.iloc[:0]
    reused = sum(result.reused for result in results.values())
    return Analysis(described, outputs, turning, empty, empty, None, faults, {}, reused)


def _faults(experiment: Experiment, results: dict[str, RunResult]) -> dict[str, str]:
    """Reasons of the runs without results. Raises InputError if that is all of them."""
    faults = {run.id: fault for run in experiment.run if (fault := results[run.id].fault)}
    if len(faults) == len(experiment.run):
        raise InputError(_nothing_left(faults))
    return faults


def _notes(
    experiment: Experiment, results: dict[str, RunResult], mistakes: Sequence[Mistake]
) -> dict[str, tuple[str, ...]]:
    """Notes on the recordings by run id, but of motion before the start only where no mistake explains it.

    What concerns the camera of all runs is said once, of the run where it matters most.
    """
    explained = {run for item in mistakes for run in item.runs}
    notes = {
        run.id: found
        for run in experiment.run
        if (found := (*results[run.id].notes, *(() if run.id in explained else results[run.id].at_rest)))
    }
    readouts = [(*readout, run.id) for run in experiment.run if (readout := results[run.id].readout)]
    if readouts:
        _, note, run = max(readouts)
        notes[run] = (*notes.get(run, ()), note)
    return {run.id: notes[run.id] for run in experiment.run if run.id in notes}


def _turning(experiment: Experiment, results: dict[str, RunResult], faults: dict[str, str]) -> pd.DataFrame:
    """Rows of turning.csv; a run without results has its reason as status."""
    rows = [results[run.id].turning or ({"radius_status": faults[run.id]},) for run in experiment.run]
    return _table(experiment, rows)


def _text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def results_of(
    jobs: Sequence[Job], workers: int | None = None, dask: str | None = None, progress: Progress = no_progress
) -> dict[str, RunResult]:
    """The result of every run by its id, from the cache or computed; `analyze` makes tables of them."""
    results = {job.run.id: result for job in jobs if (result := known_result(job))}
    todo = [job for job in jobs if job.run.id not in results]

    def report() -> None:
        progress("runs", len(results), len(jobs))

    report()
    work: Callable[[Job], RunResult] = _analyse
    if dask is None and (workers == 1 or len(todo) == 1):  # in this process: with progress by frame
        work = partial(_analyse, progress=part_way(progress, "runs", lambda: len(results), len(jobs)))
    with answers_of(work, todo, when_killed=lost_run, workers=workers, dask=dask, waiting=report) as answers:
        for _, result in answers:
            results[result.run] = result
            report()
    return results


def _analyse(job: Job, progress: Progress = no_progress) -> RunResult:
    """Analyse a run; libraries are imported here, because this usually runs in a worker."""
    from evaluator.workflow.runs.analyse import analyse_run

    return analyse_run(job, progress)


def pending(experiment: Path | str, out: Path | str = "out", *, simulate: bool = False) -> dict[str, list[str]]:
    """Names of the steps that `analyze` would execute for each run; empty for a run that is up to date."""
    described = read_with(load_experiment, Path(experiment))
    return {job.run.id: _outdated(job) for job in jobs_of(described, Outputs(Path(out)), simulate=simulate)}


def input_files(experiment: Experiment) -> list[Path]:
    """All existing files that the experiment reads."""
    robots = [Path(name) for run in experiment.run if (name := run.robot or experiment.robot).endswith(".toml")]
    named = [path for run in experiment.run for path in (run.source, run.camera, run.corrections, run.commands) if path]
    return sorted({path for path in (*robots, *named, experiment.tracking) if path and path.is_file()})


def _outdated(job: Job) -> list[str]:
    try:
        return [step_of(job, stage) for stage in outdated_stages(job)]
    except OSError as error:
        return [f"cannot be read: {error.filename}: {error.strerror}"]


def _table(experiment: Experiment, found: Sequence[Sequence[dict[str, Any]]]) -> pd.DataFrame:
    """A row per run, and per phase of a run with a log, in the order of the file.

    Columns are those of a row that has them all.
    """
    import pandas as pd

    rows = [
        {"run": run.id, "left_rpm": run.left_rpm, "right_rpm": run.right_rpm, **row, "group": run.group}
        for run, of_run in zip(experiment.run, found, strict=True)
        for row in of_run
    ]
    complete: dict[str, Any] = max(rows, key=len)
    table = pd.DataFrame(rows, columns=list(complete))
    return table.astype({"left_rpm": float, "right_rpm": float})


def _pool(turning: pd.DataFrame, outputs: Outputs) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Pool repetitions and compare backward with forward turns of the same speeds; write both tables."""
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
    reasons = [f"{', '.join(_first(runs))}: {fault}" for fault, runs in runs_by_reason.items()]
    return f"none of the {len(faults)} runs can be analysed: {'; '.join(_first(reasons))}"


def _first(items: list[str]) -> list[str]:
    """A list that fits a sentence: its first items, and how many there are besides."""
    return items if len(items) <= MOST_NAMED else [*items[: MOST_NAMED - 1], f"{len(items) - MOST_NAMED + 1} others"]
