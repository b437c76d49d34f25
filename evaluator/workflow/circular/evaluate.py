"""Evaluation of a steady-state circular test: of an experiment (measured and simulated) or of a robot model alone."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from evaluator.errors import InputError
from evaluator.files import write_text
from evaluator.files.csv_tables import write_table
from evaluator.pose import NO_HEADING
from evaluator.progress import Progress, no_progress
from evaluator.turning.circular_test import CircularTest, Series, circular_test
from evaluator.workflow.analysis import Analysis, analyze
from evaluator.workflow.circular.runs import LEVELS_RPM, RATIOS, circular_runs, simulated_turns
from evaluator.workflow.simulation import robot_of
from simulator.robot import Robot

TABLE, RESULT = "circular_test.csv", "circular_test.json"


@dataclass(frozen=True)
class CircularResult:
    """A circular test of an experiment and of its simulated counterpart; measured is None for a robot alone.

    A simulated series has the same runs as the measured one, in the same order.
    """

    measured: CircularTest | None
    simulated: CircularTest
    out: Path | None = None


def evaluate_circular_test(
    experiment: Path | str,
    out: Path | str = "out",
    *,
    workers: int | None = None,
    dask: str | None = None,
    progress: Progress = no_progress,
) -> CircularResult:
    """Analyse an experiment as `analyze` does, evaluate its turns, and write circular_test.csv and .json into out.

    Raises InputError for an experiment that cannot be analysed or in which there is no turn.
    """
    found = analyze(experiment, out, workers=workers, dask=dask, progress=progress, command_line=sys.argv[1:])
    result = circular_test_of(found, robot_of(found.experiment.robot))
    write_table(circular_test_table(result), Path(out) / TABLE)
    write_text(Path(out) / RESULT, json.dumps(circular_test_content(result), indent=1, ensure_ascii=False) + "\n")
    return CircularResult(result.measured, result.simulated, Path(out))


def circular_test_of(analysis: Analysis, robot: Robot) -> CircularResult:
    """The circular test of an analysis: runs with mistakes and runs that failed are left out.

    Raises InputError if there is no turn.
    """
    turns = analysis.turning
    if turns["radius_status"].astype(str).str.startswith(NO_HEADING).all():
        raise InputError(f"{NO_HEADING}; a circular test needs the yaw rate and sideslip, and so two marks or poses")
    right = turns[~turns["run"].isin([*analysis.excluded_runs, *analysis.faults])]
    measured = circular_test(right, _wheelbase(robot), robot.track_mm)
    return CircularResult(measured, _simulated(robot, measured.points, measured))


def simulate_circular_test(
    robot: Robot | Path | str = "barrel",
    *,
    rpm: Sequence[float] = LEVELS_RPM,
    ratios: Sequence[float] = RATIOS,
    radius_mm: float | None = None,
) -> CircularResult:
    """The circular test of a simulated robot, each command once; see circular_runs."""
    described = robot_of(robot)
    runs = circular_runs(described, rpm=rpm, ratios=ratios, radius_mm=radius_mm, repetitions=1)
    commands = pd.DataFrame([(f"s{k:02d}", run.left_rpm, run.right_rpm) for k, run in enumerate(runs, 1)])
    commands.columns = ["run", "left_rpm", "right_rpm"]
    return CircularResult(None, _simulated(described, commands))


def circular_test_table(result: CircularResult) -> pd.DataFrame:
    """A row per turn: measured values, then simulated values at the same command."""
    simulated = result.simulated.points
    if result.measured is None:
        return simulated
    columns = ["speed_mm_s", "yaw_rate_deg_s", "radius_mm", "sideslip_deg", "lateral_acceleration_mm_s2"]
    beside = simulated.set_index("run")[columns].add_prefix("simulated_")
    return result.measured.points.join(beside, on="run")


def circular_test_content(result: CircularResult) -> dict[str, Any]:
    """Content of circular_test.json: every series with its estimates; unknown values are null."""
    sides = {"measured": result.measured, "simulated": result.simulated}
    return {
        "format": 1,
        "unit": {"understeer": "deg/(m/s²)", "sideslip": "deg/(m/s²)", "steering": "1"},
        **{name: [_plain(series) for series in test.series] for name, test in sides.items() if test},
    }


def _plain(series: Series) -> dict[str, Any]:
    content = asdict(series)
    for name in ("steering", "understeer", "sideslip"):
        content[name] = {key: value if np.isfinite(value) else None for key, value in content[name].items()}
    return content


def _simulated(robot: Robot, commands: pd.DataFrame, like: CircularTest | None = None) -> CircularTest:
    turns = simulated_turns(robot, commands[["run", "left_rpm", "right_rpm"]].reset_index(drop=True))
    return circular_test(turns, _wheelbase(robot), robot.track_mm, like)


def _wheelbase(robot: Robot) -> float:
    """Distance of front and rear axle; the track of a robot with one axle."""
    places = [wheel.x_mm for wheel in robot.all_wheels if wheel.grips]
    return max(places) - min(places) or robot.track_mm
