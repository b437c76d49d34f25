"""A run that alone disagrees with a robot with which all others agree, named once these others have been explained."""

from __future__ import annotations

from collections.abc import Sequence

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.hypotheses import kin, reading_of
from evaluator.diagnosis.mistakes.recognised import Mistake
from simulator.robot import Robot


def has_kin(run: RunData, others: Sequence[RunData]) -> bool:
    """Whether the wheels of another run turn at the same speeds: else a regime of its own may speak in this run."""
    return any(kin(other) == kin(run) for other in others)


def outlying_run(run: RunData, others: Sequence[RunData], robot: Robot) -> Mistake:
    """The mistake of a run that alone disagrees; robot: as recalibrated by the others."""
    alone = f"{run.id} alone disagrees with what the other {len(others)} runs say of the robot"
    reading = reading_of(run, others, robot)
    if reading is None:
        remedy = "none of the usual mistakes explains it; look at the recording, or repeat the run"
        return Mistake((run.id,), "outlying", f"{alone}; {remedy}")
    sentence = f"{alone}: it {reading.seen}; {reading.remedy}"
    return Mistake((run.id,), reading.kind, sentence, equivalent_kinds=reading.equivalent)
