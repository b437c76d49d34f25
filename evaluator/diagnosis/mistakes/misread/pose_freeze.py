"""Poses that stop for good while the wheels are commanded on: a localisation that hangs, or a robot that is caught."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.disturbances import STANDS_SHARE
from evaluator.diagnosis.mistakes.motion import midpoint_and_heading
from evaluator.diagnosis.mistakes.outrun import rolls_mm_s
from evaluator.diagnosis.mistakes.recognised import Found, recording_of
from simulator.robot import Robot

Floats = NDArray[np.float64]

LEAST_SHARE = 0.2  # of the path of a run, before as well as after: shorter ones may be a stop that its log lacks
MOVED = 3.0  # before, times what counts as standing, and times what the poses scatter afterwards
PLACES = 64  # at which the end may begin
FEWEST = 8  # poses on either side


def frozen(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Found]:
    """Runs whose given poses move and then stand to their end, while their wheels are commanded to roll.

    Of a recording in parts, these are the last ones.
    """
    parts: dict[str, list[tuple[RunData, Robot]]] = {}
    for run, robot in zip(data, robots, strict=True):
        if run.from_poses:
            parts.setdefault(recording_of(run.id), []).append((run, robot))
    found = list[Found]()
    for of_one in parts.values():
        begins = _standing_since(of_one)
        seen = f"its poses stand from {begins:.1f} s to their end, while its wheels are commanded to roll on"
        remedy = "did the localisation hang, or is the robot caught? End it there (stop_s), or record it again"
        found += [Found(run.id, "stuck", seen, remedy) for run, _ in of_one if run.time_s[-1] > begins]
    return found


def _standing_since(parts: Sequence[tuple[RunData, Robot]]) -> float:
    """Time, s, from which a recording stands to its end; infinite if it does not, or has too few poses to tell."""
    times, paths, seen = list[Floats](), list[Floats](), list[Floats]()
    for run, robot in parts:
        time_s, middle_mm, heading = midpoint_and_heading(run)
        left, right = run.run_command.command.at(time_s)
        speed_mm_s = np.maximum(np.abs(left), np.abs(right)) * rolls_mm_s(1.0, 1.0, robot)
        times.append(time_s)
        paths.append(speed_mm_s * np.gradient(time_s) if len(time_s) > 1 else 0 * time_s)
        # a rim gets as far as the middle and half the track times the turn
        seen.append(np.column_stack([middle_mm, robot.track_mm / 2 * heading]))
    time_s, rolled_mm, places = np.concatenate(times), np.cumsum(np.concatenate(paths)), np.concatenate(seen)
    turn_mm = np.pi * parts[0][1].track_mm  # headings of each part begin within one turn
    places[:, 2] = np.unwrap(places[:, 2], period=turn_mm)
    at = _standing_from(rolled_mm, places) if len(time_s) >= 2 * FEWEST else None
    return np.inf if at is None else float(time_s[at])


def _standing_from(rolled_mm: Floats, places: Floats) -> int | None:
    """The first place from which a run stands to its end, after it has moved; None without one."""
    for at in np.linspace(FEWEST, len(rolled_mm) - FEWEST, PLACES).astype(int):
        long = min(rolled_mm[at], rolled_mm[-1] - rolled_mm[at]) >= LEAST_SHARE * rolled_mm[-1]
        moved = _reach_mm(places[:at]) > MOVED * max(STANDS_SHARE * rolled_mm[at], _reach_mm(places[at:]))
        if long and moved and _stands(places[at:], rolled_mm[at:]):
            later = places[(at + len(places)) // 2 :]
            away = np.linalg.norm(places - np.median(later, axis=0), axis=1) > MOVED * _reach_mm(later)
            return max(int(at), int(np.flatnonzero(away[: len(places) - len(later)])[-1]) + 1)
    return None


def _stands(places: Floats, rolled_mm: Floats) -> bool:
    """Whether places stand while the wheels are commanded to roll; a turn on the spot moves the rims."""
    return bool(_reach_mm(places) < STANDS_SHARE * (rolled_mm[-1] - rolled_mm[0]))


def _reach_mm(places: Floats) -> float:
    """How far places (n, 3) get from their median, for 95 % of them."""
    return float(np.percentile(np.linalg.norm(places - np.median(places, axis=0), axis=1), 95))
