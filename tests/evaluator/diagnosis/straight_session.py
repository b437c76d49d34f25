"""Runs straight on in closed form, one of which may be odd."""

from __future__ import annotations

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.recognised import Found
from simulator.robot import load_robot

ROBOT = load_robot("barrel")
GREEN, YELLOW = np.array(ROBOT.marks.green_mm), np.array(ROBOT.marks.yellow_mm)
ROLLED_MM_S = 30 * 2 * np.pi * ROBOT.wheels.radius_mm / 60  # of wheels of 30 rpm


def driven(
    number: int = 0, *, speed: np.ndarray | float = 1.5, start_s: float = 0.5, begins_s: float = 0.5, scale: float = 1.0
) -> RunData:
    """Three seconds straight on from a place of its own; begins_s: when it really starts."""
    time = np.arange(180) / 60
    speeds = np.where(time >= begins_s, speed, 0.0)
    along = np.concatenate([[0.0], np.cumsum(speeds[:-1]) / 60])
    place = np.column_stack([along + number, np.full(180, 0.5 * number)])
    noise = 1e-4 * np.random.default_rng(number).normal(size=(180, 4))
    marks = scale * (np.concatenate([place + GREEN, place + YELLOW], axis=1) + noise)
    return RunData(f"r{number}", 30.0, 30.0, start_s, None, time, marks, number)


def session(odd: RunData, count: int = 8) -> list[RunData]:
    return [odd, *(driven(number) for number in range(1, count))]


def kinds(found: list[Found]) -> list[tuple[str, str]]:
    return [(item.run, item.kind) for item in found]
