"""Mistakes of an experiment for `check`, `analyze` and the report, recognised from existing marks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from evaluator.errors import InputError
from evaluator.settings import Experiment
from evaluator.workflow.results.outputs import Outputs
from evaluator.workflow.runs.stored_diagnosis import earlier_diagnosis
from simulator.errors import SimulationError

if TYPE_CHECKING:
    from evaluator.diagnosis.mistakes.recognised import Mistake
    from evaluator.interchange.tracker_faults import Mended


def mistakes_of_marks(
    experiment: Experiment, marks: Mapping[str, Path], known: Mapping[Path, Mended] | None = None
) -> list[Mistake]:
    """Mistakes of the runs whose marks CSV is given by run id; none if no robot can be simulated.

    known: marks of files that have been read. Does not raise for unreadable files, which are reported elsewhere.
    """
    from evaluator.diagnosis.experiment import mistakes_in

    used = only_runs(experiment, marks)
    if not used.run:
        return []
    try:
        return list(mistakes_in(used, marks, known))
    except (InputError, SimulationError, FloatingPointError):
        return []


def without_explained(mistakes: Sequence[Mistake], experiment: Experiment, outputs: Outputs) -> tuple[Mistake, ...]:
    """The mistakes without those that the diagnosis in the output folder explains by the effects that it found.

    An outdated or unreadable diagnosis explains none.
    """
    if not mistakes or not outputs.diagnosis.is_file():
        return tuple(mistakes)
    try:
        kept = earlier_diagnosis(experiment, outputs)
    except (OSError, InputError):
        return tuple(mistakes)
    if kept is None or kept.outdated:
        return tuple(mistakes)
    explained = {(run, item["kind"]) for item in kept.content.get("explained_mistakes", ()) for run in item["runs"]}
    return tuple(item for item in mistakes if item.everywhere or (item.runs[0], item.kind) not in explained)


def given_marks(experiment: Experiment) -> dict[str, Path]:
    """Marks files that need no camera and no other program's names, by run id."""
    from evaluator.interchange.tracks import program_of

    if experiment.tracks is not None:
        return {}
    return {
        run.id: run.marks
        for run in experiment.run
        if run.marks is not None and run.marks.is_file() and program_of(run.marks) == "turnscope"
    }


def with_sentences(notes: Mapping[str, tuple[str, ...]], mistakes: Sequence[Mistake]) -> dict[str, tuple[str, ...]]:
    """The notes of runs with the mistakes first; those of a part of a recording stand with the recording."""
    from evaluator.diagnosis.mistakes.recognised import named, recording_of

    found = dict(notes)
    for item in mistakes:
        said = item.sentence.removeprefix(f"{named(item.runs)}: ")
        for run in dict.fromkeys(map(recording_of, item.runs[:1] if item.everywhere else item.runs)):
            found[run] = (said, *found.get(run, ()))
    return found


def only_runs(experiment: Experiment, marks: Mapping[str, Path]) -> Experiment:
    """The experiment with only the runs whose marks exist."""
    return experiment.model_copy(update={"run": tuple(run for run in experiment.run if run.id in marks)})
