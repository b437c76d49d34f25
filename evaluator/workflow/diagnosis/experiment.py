"""Diagnosis of an experiment file: from marks or videos to diagnosis.json and a corrected robot file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from evaluator.diagnosis.diagnosis import diagnose as diagnose_session
from evaluator.diagnosis.experiment import Session, session_of
from evaluator.diagnosis.inference.fit_cache import FitCache
from evaluator.diagnosis.inference.watch import USUAL_SECONDS
from evaluator.diagnosis.output.content import DiagnosisContent
from evaluator.diagnosis.output.diagnosis_json import disagreement, record
from evaluator.diagnosis.output.own_effect import own_effects
from evaluator.diagnosis.output.robot_file import robot_text
from evaluator.diagnosis.output.robot_with_effect import robot_with_effect
from evaluator.diagnosis.result import Diagnosis
from evaluator.errors import InputError
from evaluator.files import read_with, refuse_to_replace, write_text
from evaluator.files.csv_tables import write_table
from evaluator.interchange.tracks import program_of
from evaluator.progress import Progress, no_progress
from evaluator.settings import Experiment, Run, load_experiment
from evaluator.workflow.analysis import input_files, results_of
from evaluator.workflow.execution.machine import available_cores
from evaluator.workflow.execution.sharing import one_core
from evaluator.workflow.results.belonging import claimed
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.results.unchanged import CHANGED, AsFound
from evaluator.workflow.runs.implausible import refuse_implausible
from evaluator.workflow.runs.job import jobs_of
from evaluator.workflow.runs.stored_diagnosis import (
    INSTALLED,
    is_current,
    keep,
    key_of_diagnosis,
    load_diagnosis,
    own_effect_ids,
)
from simulator.own_effects.files import file_of, text_of

REASONS_SHOWN = 3  # of runs without marks, in one sentence


@dataclass(frozen=True, repr=False)
class DiagnosisResult:
    """Content of diagnosis.json, its folder, and whether it was computed now or was up to date."""

    experiment: Path
    out: Path
    content: dict[str, Any]
    anew: bool

    @property
    def verdict(self) -> str:
        """`none`, `effect`, `unknown` or `insufficient`."""
        return str(self.content["verdict"])

    @property
    def effects(self) -> tuple[str, ...]:
        """Ids of the effects found."""
        return tuple(effect["id"] for effect in self.content["effects"])

    def __repr__(self) -> str:
        """One line: the verdict and its effects."""
        named = f": {', '.join(self.effects)}" if self.effects else ""
        return f"DiagnosisResult({self.experiment.name}, {self.verdict}{named})"

    def _repr_html_(self) -> str:
        """The verdict and the parameters of its effects as a table, for notebooks."""
        rows = [
            f"<tr><td>{effect['id']}</td><td>{name}</td><td>{value['value']:.4g}</td>"
            f"<td>{value['low']:.4g} to {value['high']:.4g}</td></tr>"
            for effect in self.content["effects"]
            for name, value in effect["parameters"].items()
        ]
        head = "<tr><th>effect</th><th>parameter</th><th>value</th><th>95 %</th></tr>"
        return f"<p>verdict: {self.verdict}</p>" + (f"<table>{head}{''.join(rows)}</table>" if rows else "")


def diagnose(
    experiment: Path | str,
    out: Path | str = "out",
    *,
    workers: int | None = None,
    dask: str | None = None,
    effects: Sequence[Path] = (),
    seconds: float = USUAL_SECONDS,
    progress: Progress = no_progress,
) -> DiagnosisResult:
    """Find the effect that the model lacks; see `diagnose_experiment`.

    effects: files of user-defined effects in addition to those in the folder `effects` beside the experiment; Python
    files among them are executed. seconds: of processor time, after which the search is stopped. If it is cancelled or
    stopped, its fits are stored, and the next call continues with them.
    """
    path, folder = Path(experiment), Path(out)
    found, content = diagnose_experiment(
        path, folder, progress, workers=workers, dask=dask, effects=effects, seconds=seconds
    )
    return DiagnosisResult(path, folder, content, anew=found is not None)


def diagnose_experiment(
    path: Path,
    out: Path,
    progress: Progress = no_progress,
    *,
    workers: int | None = None,
    dask: str | None = None,
    effects: Sequence[Path] = (),
    seconds: float = USUAL_SECONDS,
) -> tuple[Diagnosis | None, dict[str, Any]]:
    """Diagnose an experiment and write the results below out.

    workers: processes that track recordings, and threads that simulate, by default one per core; dask: address of a
    scheduler whose workers track instead. The results depend on neither. A search that was stopped is continued by the
    next call. Returns the diagnosis, or None if the stored one is up to date, and the content of diagnosis.json.
    Raises InputError if the experiment, a robot or all recordings cannot be used, or if out holds results of another
    experiment.
    """
    experiment, outputs = read_with(load_experiment, path), Outputs(Path(out))
    own = own_effect_ids(path, experiment, effects)
    inputs = [*input_files(experiment), *filter(None, map(file_of, own))]
    refuse_to_replace(inputs, outputs.of_diagnosis())
    read = AsFound.of(inputs)

    def key_now() -> str:
        return key_of_diagnosis(experiment, outputs, list(map(text_of, own)))

    with claimed(outputs, experiment):
        key, robot = key_now(), read_with(robot_text, Path(experiment.robot))
        if is_current(outputs, key):
            return None, load_diagnosis(outputs.diagnosis)
        refuse_implausible(experiment)
        session = replace(_session(path, experiment, outputs, progress, workers, dask), own=own)
        if (changed := read.changed()) and key_now() != key:
            raise InputError(f"{changed[0]}: {CHANGED}")  # the key is not that of the content that was read
        try:
            with one_core():  # for libraries; the diagnosis distributes runs among threads
                found = diagnose_session(
                    session,
                    progress,
                    FitCache(outputs.diagnosis_fits, key),
                    seconds=seconds,
                    cores=workers or available_cores(),
                )
        except FloatingPointError as error:
            raise InputError(f"{path}: {error}; are the robot file and the command of that run right?") from error
        content = record(found)
        if own:
            content["own_effects"] = {effect: str(file_of(effect) or INSTALLED) for effect in own}
        if changed := read.changed():
            content["changed_meanwhile"] = [str(file) for file in changed]
        files = _written(found, content, robot, outputs)
        if not found.stopped:
            keep(outputs, key, files)
            outputs.diagnosis_fits.unlink(missing_ok=True)
        return found, dict(content)


def _written(found: Diagnosis, content: DiagnosisContent, robot: str, outputs: Outputs) -> list[Path]:
    """Write the results; other files of an earlier diagnosis are removed.

    robot: text of the robot file that was diagnosed.
    """
    files = [outputs.diagnosis]
    table, added = disagreement(found), bool(found.chosen) and found.follows
    forms = own_effects(found) if found.verdict == "unknown" else []
    written = (
        (outputs.disagreement, table is not None),
        (outputs.robot_with_effect, added),
        *((path, number < len(forms)) for number, path in enumerate(outputs.own_effects)),
    )
    for path, there in written:
        if there:
            files.append(path)
        else:
            path.unlink(missing_ok=True)
    if table is not None:
        write_table(table, outputs.disagreement)
    if outputs.robot_with_effect in files:
        write_text(outputs.robot_with_effect, robot_with_effect(found, robot))
    for path, form in zip(outputs.own_effects, forms, strict=False):
        write_text(path, form)
    for effect in sorted(found.chosen & set(found.session.own)):
        source = file_of(effect)
        if source is not None and source.suffix == ".toml":  # beside the robot file that has it
            files.append(outputs.effects / f"{effect}.toml")
            write_text(files[-1], source.read_text(encoding="utf-8"))
    write_text(outputs.diagnosis, json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    return files


def _session(
    path: Path, experiment: Experiment, outputs: Outputs, progress: Progress, workers: int | None, dask: str | None
) -> Session:
    """Given marks, or marks tracked in videos (results that are up to date are reused)."""
    marks = {run.id: run.marks for run in experiment.run if run.marks is not None and not _to_be_read(run, experiment)}
    faults: dict[str, str] = {}
    cameras: dict[str, Path] = {}
    if len(marks) < len(experiment.run):
        refuse_to_replace(input_files(experiment), outputs.of_analysis(run.id for run in experiment.run))
        jobs = [replace(job, marks_only=True) for job in jobs_of(experiment, outputs, simulate=False)]
        results = results_of(jobs, workers, dask, lambda _, done, total=1.0: progress("tracking", done, total))
        faults = {run: fault for run, result in results.items() if (fault := result.fault)}
        marks |= {run: outputs.marks(run) for run in results if run not in marks and run not in faults}
        placed = {job.run.id: job.camera for job in jobs}
        cameras = {run: camera for run, camera in placed.items() if run in marks and camera is not None}
    session = session_of(experiment, marks, cameras)
    skipped = {**session.skipped, **faults}
    if not session.data and not session.mistakes:
        why = {**skipped, **session.left_out}
        reasons = "; ".join(f"{run}: {reason}" for run, reason in list(why.items())[:REASONS_SHOWN])
        raise InputError(f"{path}: no run can be used ({reasons})")
    return replace(session, skipped=skipped)


def _to_be_read(run: Run, experiment: Experiment) -> bool:
    """Whether a marks file has the format of another program: px, other names, other units."""
    assert run.marks is not None
    return experiment.tracks is not None or (run.marks.is_file() and program_of(run.marks) != "turnscope")
