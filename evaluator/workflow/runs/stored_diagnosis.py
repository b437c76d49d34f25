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
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.results.validity import Record, key_of
from evaluator.workflow.runs.job import jobs_of
from simulator.own_effects.files import load_beside, load_installed, load_named, load_own, text_of

STAGE = "diagnose"
INSTALLED = "installed"  # in place of the file of an effect that a package provides


def key_of_diagnosis(experiment: Experiment, outputs: Outputs, own: Sequence[str] = ()) -> str:
    """Hash of all inputs of a diagnosis: recordings, cameras, commands, robots, user-defined effects, code.

    own: what defines the user-defined effects, see simulator.own_effects.files.text_of.
    Raises InputError for a robot that cannot be read.
    """
    runs = []
    for job in jobs_of(experiment, outputs, simulate=True):
        try:
            runs.append([job.run.id, job.keys()["simulate"]])
        except (OSError, InputError) as error:  # a missing recording: its run is excluded until it exists
            runs.append([job.run.id, str(error)])
    text = read_with(robot_text, Path(experiment.robot))
    known = [experiment.known_to.model_dump(), experiment.relevant.model_dump()]
    return key_of({"runs": runs, "robot": text, "known": known, "own": list(own)})


def own_effect_ids(path: Path, experiment: Experiment, named: Sequence[Path] = ()) -> tuple[str, ...]:
    """Ids of user-defined effects: of installed packages, beside the experiment and its robots, and named.

    Files are named here and in TURNSCOPE_EFFECTS. The effects are registered in this process. Raises InputError,
    SimulationError for a file that is not an effect.
    """
    robots = {run.robot or experiment.robot for run in experiment.run}
    folders = {
        Path(path).resolve().parent,
        *(Path(robot).resolve().parent for robot in robots if Path(robot).is_file()),
    }
    beside = [effect for folder in sorted(folders) for effect in load_beside(folder)]
    found = [*load_installed(), *load_named(), *beside]
    return tuple(dict.fromkeys([*found, *(read_with(load_own, file).id for file in named)]))


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
    own = [_text_now(effect, file) for effect, file in content.get("own_effects", {}).items()]
    outdated = STAGE in record.stages and record.fresh(STAGE, key_of_diagnosis(experiment, outputs, own)) is None
    return StoredDiagnosis(content, outdated)


def _text_now(effect: str, file: str) -> str:
    """What defines an effect of a stored diagnosis today; a Python file is not executed: the user has not named it."""
    if file == INSTALLED:
        return effect
    path = Path(file)
    if not path.is_file():
        return ""
    return text_of(load_own(path).id) if path.suffix == ".toml" else path.read_text(encoding="utf-8")


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
