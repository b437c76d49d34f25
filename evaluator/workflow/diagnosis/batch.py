"""Diagnoses of several experiments in parallel, on all cores or on a cluster."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibration.errors import CalibrationError
from evaluator.diagnosis.inference.watch import USUAL_SECONDS
from evaluator.errors import InputError
from evaluator.progress import Progress, no_progress
from evaluator.workflow.execution.answers import answers_of
from evaluator.workflow.execution.machine import available_cores
from simulator.errors import SimulationError


@dataclass(frozen=True)
class Order:
    """An experiment to diagnose: output folder, number of processes for tracking, and time limit of the search."""

    experiment: Path
    out: Path
    trackers: int
    seconds: float


@dataclass(frozen=True)
class Answer:
    """Content of diagnosis.json and whether it was computed now, or the reason why there is none."""

    experiment: Path
    out: Path
    content: dict[str, Any] | None = None
    anew: bool = False
    fault: str | None = None


def diagnose_each(
    experiments: Sequence[Path],
    out: Path,
    *,
    workers: int | None = None,
    dask: str | None = None,
    seconds: float = USUAL_SECONDS,
    progress: Progress = no_progress,
) -> list[Answer]:
    """Diagnose experiments into separate folders below out; return an answer for each, in order.

    seconds: of processor time, after which the search of an experiment is stopped. The diagnoses do not depend on
    workers or dask. An experiment that cannot be used does not stop the others.
    """
    experiments = tuple(dict.fromkeys(experiments))
    count = workers or available_cores()
    trackers = max(count // len(experiments), 1) if dask is None else 1
    folders = folders_of(experiments, out)
    orders = [Order(path.resolve(), folders[path].resolve(), trackers, seconds) for path in experiments]
    found: dict[int, Answer] = {}

    def report() -> None:
        progress("experiments", len(found), len(orders))

    report()
    with answers_of(_diagnosed, orders, when_killed=_lost, workers=count, dask=dask, waiting=report) as answers:
        for number, answer in answers:
            found[number] = answer
            report()
    return [found[number] for number in range(len(orders))]


def folders_of(experiments: Sequence[Path], out: Path) -> dict[Path, Path]:
    """A folder for each experiment below out, named after its file, and after its folder if files share a name."""
    shared = Counter(path.stem for path in experiments)
    names = {
        path: path.stem if shared[path.stem] == 1 else f"{path.resolve().parent.name}-{path.stem}"
        for path in experiments
    }
    if len(set(names.values())) < len(experiments):
        raise InputError("two experiments have the same name in folders of the same name; diagnose them separately")
    return {path: out / name for path, name in names.items()}


def _diagnosed(order: Order) -> Answer:
    """Diagnose an order in a worker process."""
    from evaluator.workflow.diagnosis.experiment import diagnose_experiment

    try:
        found, content = diagnose_experiment(order.experiment, order.out, workers=order.trackers, seconds=order.seconds)
    except (InputError, CalibrationError, SimulationError) as error:
        return Answer(order.experiment, order.out, fault=str(error))
    except OSError as error:
        return Answer(order.experiment, order.out, fault=f"{error.filename or order.experiment}: {error.strerror}")
    return Answer(order.experiment, order.out, content, anew=found is not None)


def _lost(order: Order) -> Answer:
    reason = f"{order.experiment}: its process was killed (out of memory?); try again with fewer --workers"
    return Answer(order.experiment, order.out, fault=reason)
