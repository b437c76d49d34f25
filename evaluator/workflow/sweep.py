"""Execution of a sweep.toml in parts that are saved as they complete."""

from __future__ import annotations

import hashlib
import shutil
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from evaluator.errors import InputError
from evaluator.files import read_with, written_whole
from evaluator.progress import Progress, no_progress
from evaluator.workflow.execution.answers import answers_of
from simulator.robot import Robot
from simulator.sweep import Sweep, load_sweep, robot_of_sweep, run_part

RUNS_A_PART = 500  # a part takes about a second, so that little is lost by an interruption


@dataclass(frozen=True)
class SweepDone:
    """Result of a sweep: its table, the number of runs, and the number of parts that were reused."""

    output: Path
    runs: int
    parts: int
    reused: int


@dataclass(frozen=True)
class _Part:
    """Runs start to stop of a sweep."""

    sweep: Sweep
    robot: Robot
    start: int
    stop: int


def run_sweep(
    sweep_file: Path | str,
    output: Path | str,
    *,
    workers: int | None = None,
    dask: str | None = None,
    progress: Progress = no_progress,
) -> SweepDone:
    """Simulate every run of a sweep and write a CSV with a row per run.

    Parts are stored in a folder beside the output until all are complete: a sweep that was cancelled or interrupted is
    resumed when it is started again, with the same result. workers, dask: as for `analyze`.
    Raises InputError for a file that cannot be used, SimulationError for an unknown key.
    """
    sweep = read_with(load_sweep, Path(sweep_file))
    robot = read_with(lambda _: robot_of_sweep(sweep), Path(sweep.robot))
    output, total = Path(output), sweep.count()
    folder = _parts_folder(sweep, robot, output)
    parts = [_Part(sweep, robot, start, min(start + RUNS_A_PART, total)) for start in range(0, total, RUNS_A_PART)]
    missing = [part for part in parts if _kept(folder, part) is None]
    lost = _simulate(missing, len(parts), folder, workers, dask, progress)
    if lost:
        raise InputError(
            f"{sweep_file}: {lost} of {len(parts)} parts were not simulated, their processes were killed (out of "
            "memory?); the others are kept, try again with fewer --workers"
        )
    with written_whole(output) as temporary:
        for number, part in enumerate(parts):
            table = _kept(folder, part)
            if table is None:  # another sweep with the same output is done and has removed it
                table = _run(part)
            table.to_csv(temporary, mode="a", header=number == 0, index=False, float_format="%.9g")
    with suppress(FileNotFoundError):  # another sweep with the same output removes it too
        shutil.rmtree(folder)
    return SweepDone(output, total, len(parts), len(parts) - len(missing))


def _simulate(
    missing: list[_Part], count: int, folder: Path, workers: int | None, dask: str | None, progress: Progress
) -> int:
    """Simulate parts and save each on completion; return the number of lost parts."""
    done, lost = count - len(missing), 0

    def report() -> None:
        progress("simulating", done, count)

    report()
    folder.mkdir(parents=True, exist_ok=True)
    with answers_of(_run, missing, when_killed=_lost, workers=workers, dask=dask, waiting=report) as answers:
        for number, table in answers:
            if table is None:
                lost += 1
                continue
            with written_whole(_file(folder, missing[number])) as temporary:
                table.to_csv(temporary, index=False, float_format="%.9g")
            done += 1
            report()
    return lost


def _kept(folder: Path, part: _Part) -> pd.DataFrame | None:
    """The saved table of a part; None if it is not there or not whole, as after a power failure."""
    try:
        table = pd.read_csv(_file(folder, part))
    except (OSError, ValueError):
        return None
    return table if len(table) == part.stop - part.start else None


def _run(part: _Part) -> pd.DataFrame:
    return run_part(part.sweep, part.robot, part.start, part.stop)


def _lost(part: _Part) -> None:
    del part


def _parts_folder(sweep: Sweep, robot: Robot, output: Path) -> Path:
    """Folder of the parts, named by a hash so that parts of another sweep file or robot are not reused."""
    meaning = f"{sweep.model_dump_json()}\n{robot.model_dump_json()}\n{RUNS_A_PART}"
    return output.with_name(f"{output.name}.parts-{hashlib.sha256(meaning.encode()).hexdigest()[:12]}")


def _file(folder: Path, part: _Part) -> Path:
    return folder / f"{part.start:09d}-{part.stop:09d}.csv"
