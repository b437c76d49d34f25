"""Whether a stored diagnosis is up to date, by the content of inputs, settings and code."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evaluator.diagnosis.output.robot_file import robot_text
from evaluator.errors import InputError
from evaluator.files import read_with
from evaluator.settings import Experiment
from evaluator.workflow.analysis import jobs_of
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.results.validity import Record, key_of
from simulator.own_effects.files import file_of, load_beside, load_installed, load_own

STAGE = "diagnose"


def key_of_diagnosis(experiment: Experiment, outputs: Outputs, own: Sequence[str] = ()) -> str:
    """Hash of all inputs of a diagnosis: recordings, cameras, commands, robots, user-defined effects, code.

    Raises InputError for a robot that cannot be read.
    """
    runs = []
    for job in jobs_of(experiment, outputs, simulate=True):
        try:
            runs.append([job.run.id, job.keys()["simulate"]])
        except (OSError, InputError) as error:  # a missing recording: its run is excluded until it exists
            runs.append([job.run.id, str(error)])
    text = read_with(robot_text, experiment.robot)  # type: ignore[arg-type]
    known = [experiment.known_to.model_dump(), experiment.relevant.model_dump()]
    return key_of({"runs": runs, "robot": text, "known": known, "own": [_text_of(effect) for effect in own]})


def own_effect_ids(path: Path, experiment: Experiment, named: Sequence[Path] = ()) -> tuple[str, ...]:
    """Ids of user-defined effects: beside the experiment and its robots, of installed packages, and those named.

    They are registered in this process. Raises InputError, SimulationError for a file that is not an effect.
    """
    robots = {run.robot or experiment.robot for run in experiment.run}
    folders = {
        Path(path).resolve().parent,
        *(Path(robot).resolve().parent for robot in robots if Path(robot).is_file()),
    }
    found = [*load_installed(), *(effect for folder in sorted(folders) for effect in load_beside(folder))]
    return tuple(dict.fromkeys([*found, *(read_with(load_own, file).id for file in named)]))


def _text_of(effect: str) -> str:
    source = file_of(effect)
    return effect if source is None else source.read_text(encoding="utf-8")


@dataclass(frozen=True)
class StoredDiagnosis:
    """A stored diagnosis: the content of diagnosis.json, and whether its inputs are unchanged."""

    content: dict[str, Any]
    outdated: bool


def earlier_diagnosis(experiment: Experiment, outputs: Outputs) -> StoredDiagnosis | None:
    """The stored diagnosis of an output folder; None without one.

    A diagnosis.json without a record, from another program, counts as up to date.
    """
    if not outputs.diagnosis.is_file():
        return None
    content = read_with(load_diagnosis, outputs.diagnosis)
    record = Record.load(outputs.diagnosis_record)
    own = [load_own(Path(file)).id for file in content.get("own_effects", {}).values() if Path(file).is_file()]
    outdated = STAGE in record.stages and record.fresh(STAGE, key_of_diagnosis(experiment, outputs, own)) is None
    return StoredDiagnosis(content, outdated)


def load_diagnosis(path: Path) -> dict[str, Any]:
    """Read diagnosis.json. Raises OSError, InputError."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: not valid JSON ({error}); run turnscope diagnose again") from error
    if not isinstance(content, dict) or "verdict" not in content:
        raise InputError(f"{path}: has no verdict; run turnscope diagnose again")
    return content


def keep(outputs: Outputs, key: str, files: list[Path]) -> None:
    """Store the hashes of the inputs and files of a diagnosis."""
    Record(outputs.diagnosis_record).keep(STAGE, key, files, {})


def is_current(outputs: Outputs, key: str) -> bool:
    """Whether the files of a diagnosis exist unchanged and were made from exactly these inputs."""
    return Record.load(outputs.diagnosis_record).fresh(STAGE, key) is not None
