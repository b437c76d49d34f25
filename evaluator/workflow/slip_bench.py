"""Torques of the slip evaluation apparatus, recorded or virtual, to a fitted slip law."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from evaluator.files import read_with
from evaluator.files.csv_tables import read_table
from evaluator.workflow.simulation import robot_of
from simulator.robot import Robot
from simulator.slip.bench import Apparatus, checked_bench, virtual_bench
from simulator.slip.fit import SlipFit, fit_slip_law


@dataclass(frozen=True)
class SlipBench:
    """Torques of a bench and the slip law fitted to them. virtual: the torques were simulated."""

    name: str
    torques: pd.DataFrame
    apparatus: Apparatus
    fit: SlipFit
    virtual: bool = False


def evaluate_slip(bench: Path | str, apparatus: Apparatus | None = None) -> SlipBench:
    """Fit a slip law to a recording BENCH.csv. Raises InputError, SimulationError."""
    path, used = Path(bench), apparatus or Apparatus()
    torques = checked_bench(read_with(read_table, path), str(path))
    return SlipBench(path.stem, torques, used, fit_slip_law(torques, used))


def evaluate_virtual_slip(robot: Robot | Path | str, seed: int = 0, apparatus: Apparatus | None = None) -> SlipBench:
    """Measure the slip law of a robot on a virtual bench, with torque noise of a seed. Raises as load_robot does."""
    described, used = robot_of(robot), apparatus or Apparatus()
    torques = virtual_bench(described.slip, np.random.default_rng(seed), apparatus=used)
    name = described.name if isinstance(robot, Robot) else str(robot)
    return SlipBench(f"{name}, virtual bench", torques, used, fit_slip_law(torques, used), virtual=True)
