"""The runs of a good experiment, and the effects that they can detect."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from evaluator.errors import InputError
from evaluator.progress import Progress, no_progress
from evaluator.wording import counted
from evaluator.workflow.diagnosis.planned_experiment import write_planned
from evaluator.workflow.simulation import robot_of
from simulator.robot import Robot

if TYPE_CHECKING:
    import pandas as pd

    from evaluator.diagnosis.design.candidate_runs import CandidateRun
    from evaluator.diagnosis.design.plan import Expected


@dataclass(frozen=True, repr=False)
class Plan:
    """Planned runs in their order, and the significance, in sigmas, with which each effect would be detected."""

    runs: tuple[CandidateRun, ...]
    effects: tuple[Expected, ...]

    def __repr__(self) -> str:
        """One line: the numbers of runs and of parameters of effects."""
        return f"Plan({counted(len(self.runs), 'run')}, {counted(len(self.effects), 'parameter')} of effects)"

    def _repr_html_(self) -> str:
        """Both tables, for notebooks."""
        return "".join(table.to_html(float_format="{:.4g}".format) for table in self.tables())

    def tables(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """The runs, and the parameters of the effects; columns are the fields of CandidateRun and of Expected."""
        import pandas as pd

        return pd.DataFrame(map(asdict, self.runs)), pd.DataFrame(map(asdict, self.effects))


def write_plan(found: Plan, robot: str, output: Path | str) -> list[Path]:
    """Write an experiment.toml with the runs of a plan and their command files; see write_planned."""
    starts = [(run.x_mm, run.y_mm, run.heading_deg) for run in found.runs]
    return write_planned(found.runs, "planned experiment", robot, output, starts)


def plan(
    robot: Robot | Path | str = "barrel",
    runs: int = 18,
    *,
    rpm: Sequence[float] = (30.0, 60.0),
    plate_mm: tuple[float, float] = (40.0, 30.0),
    progress: Progress = no_progress,
) -> Plan:
    """Plan the runs of an experiment and predict which effects they can detect.

    rpm: speeds of the faster wheel; plate_mm: visible part of the plate along its x and y.
    Raises InputError for a plate that is too small for the robot, and as load_robot does.
    """
    from evaluator.diagnosis.candidates.coordinates import named_terms
    from evaluator.diagnosis.design.candidate_runs import Room
    from evaluator.diagnosis.design.plan import expected, plan_runs

    described = robot_of(robot)
    half_mm = max(described.body.length_mm, described.body.width_mm) / 2
    if min(plate_mm) <= 2 * half_mm or not all(map(math.isfinite, plate_mm)):
        raise InputError(
            f"a plate of {plate_mm[0]:g} by {plate_mm[1]:g} mm leaves {described.name} no room to drive: the robot is "
            f"{2 * half_mm:g} mm across; give the visible size of the plate in mm (--plate X Y)"
        )
    room = Room.of_plate(plate_mm, half_mm)
    progress("terms", 0.0)
    terms = named_terms(max(room.half_mm), tuple(rpm))
    progress("runs", 0.1)
    chosen = plan_runs(described, terms, rpm, room, runs)
    progress("effects", 0.8)
    shown = expected(described, terms, chosen)
    return Plan(tuple(chosen), tuple(shown))
