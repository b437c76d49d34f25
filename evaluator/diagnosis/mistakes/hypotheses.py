"""Each run against what it should be and against what it could be by mistake: the one simulated beside the other.

A path that was simulated may be laid anywhere on the plate, so all that is compared is its shape in time: RMS distance
of both marks after the best rotation and shift. A mistake is believed where the run fits it several times better than
what the file says and the misfit of the file is no small thing; effects of physics make neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluator.diagnosis.likelihood.features import rms_apart
from evaluator.diagnosis.likelihood.run_data import OWN_NUMBERS, RunData, Task
from evaluator.diagnosis.likelihood.simulation import Simulated
from evaluator.diagnosis.mistakes.recognised import Found, Kind
from simulator.robot import Robot

Floats = NDArray[np.float64]

FRAMES = 80  # of a run that are compared: a path is smooth
# The misfit of the file, over the extent of the path, from which on a mistake is looked for. The largest effects of the
# catalogue that keep a robot usable change a path by about a tenth.
MISFIT_SHARE = 0.15
BETTER = 3.0  # times: what the mistake must fit better than the file
ALIKE = 1.3  # times: two mistakes that fit so alike are told by what else is known
# Ratios of frame rates that recordings have: 24, 25, 30, 50, 60, 120, and fields for frames.
RATES = (0.5, 2.0, 0.25, 4.0, 30 / 25, 25 / 30, 60 / 25, 25 / 60, 30 / 24, 24 / 30, 60 / 24, 24 / 60)
SAME_INTERVAL = 0.04  # relative difference of frame intervals that says nothing


@dataclass(frozen=True)
class Alternative:
    """One way in which a run may have come about: kind None is what the file says."""

    kind: Kind | None
    run: RunData
    words: str = ""
    own: bool = False  # something that only this run has speaks for it


def misread_runs(data: Sequence[RunData], robots: Sequence[Robot]) -> list[Found]:
    """Runs that fit another command, or marks or times read otherwise, far better than what the file says."""
    thin = [_thinned(run) for run in data]
    commands = sorted({run.command for run in data})
    intervals = np.array([np.median(np.diff(run.time_s)) for run in data])
    ratios = intervals / np.median(intervals)
    same = bool(np.all(np.abs(ratios - 1) < SAME_INTERVAL))
    ways = [
        _alternatives(run, commands, None if same else float(ratio)) for run, ratio in zip(thin, ratios, strict=True)
    ]
    flat = [way.run for of_run in ways for way in of_run]
    owners = [robot for robot, of_run in zip(robots, ways, strict=True) for _ in of_run]
    predicted = Simulated(owners, flat, {}).marks([Task(k, (0.0,) * OWN_NUMBERS) for k in range(len(flat))])
    found, k = [], 0
    results = []
    for of_run in ways:
        parts = [_misfit(way.run.marks_mm, predicted[k + i]) for i, way in enumerate(of_run)]
        extent = _extent(predicted[k], of_run[0].run.marks_mm)
        k += len(of_run)
        results.append((of_run, np.array(parts), extent))
    usual = _usual_kinds(results)
    for of_run, misfits, extent in results:
        item = _judged(of_run, misfits, extent, usual)
        if item is not None:
            found.append(item)
    at_another_rate = [item for item in found if item.kind == "wrong-rate"]
    if same and len(at_another_rate) <= len(results) / 2:
        # one clock for all runs: where straight runs alone seem too fast, it is the robot that is
        found = [item for item in found if item.kind != "wrong-rate"]
    return found


def _usual_kinds(results: Sequence[tuple[list[Alternative], Floats, float]]) -> set[Kind]:
    """Kinds of mistake that explain most of the runs: a single straight run cannot tell some of them apart."""
    counts: dict[Kind, int] = {}
    for of_run, misfits, extent in results:
        if misfits[0] < MISFIT_SHARE * extent:
            continue
        best = float(np.nanmin(misfits))
        for kind in {way.kind for way, value in zip(of_run, misfits, strict=True) if value < ALIKE * best and way.kind}:
            counts[kind] = counts.get(kind, 0) + 1
    return {kind for kind, count in counts.items() if count > len(results) / 2}


def _judged(of_run: list[Alternative], misfits: Floats, extent: float, usual: set[Kind]) -> Found | None:
    """The mistake that a run fits, if any."""
    stated = float(misfits[0])
    if not np.isfinite(stated) or stated < MISFIT_SHARE * extent or not np.isfinite(misfits[1:]).any():
        return None
    # at the frame intervals of all other runs, one run alone has no other rate
    refused = [way.kind == "wrong-rate" and not way.own and "wrong-rate" not in usual for way in of_run]
    misfits = np.where(refused, np.inf, misfits)
    best = float(np.nanmin(misfits[1:]))
    if stated < BETTER * best:
        return None
    as_good = max(ALIKE * best, 0.02 * stated)
    near = [way for way, value in zip(of_run[1:], misfits[1:], strict=True) if value <= as_good]
    way = next((item for item in near if item.kind in usual), near[0])
    assert way.kind is not None
    seen = f"{way.words} ({best:.2g} mm from its marks; as the file says, {stated:.2g} mm)"
    return Found(of_run[0].run.id, way.kind, seen, REMEDIES[way.kind])


REMEDIES: dict[Kind, str] = {
    "reversed": "change the signs of left_rpm and right_rpm in experiment.toml",
    "sides-swapped": "exchange left_rpm and right_rpm in experiment.toml",
    "marks-swapped": "exchange the columns of the two marks",
    "mirrored": "mirror the recording, or the x of its marks",
    "wrong-rate": "give the true frame rate (rate_hz), or correct time_s",
    "wrong-command": "look up which command belongs to this recording",
}


def _alternatives(
    run: RunData, commands: Sequence[tuple[float, float]], interval_ratio: float | None
) -> list[Alternative]:
    """What the file says, then every mistake, the commoner before the rarer."""
    left, right = run.command
    ways = [Alternative(None, run)]
    if (left, right) != (0, 0):
        ways.append(Alternative("reversed", _commanded(run, -left, -right), "drives the opposite way to its command"))
    if left != right:
        ways.append(
            Alternative("sides-swapped", _commanded(run, right, left), "turns as if left and right were exchanged")
        )
    exchanged = run.marks_mm[:, [2, 3, 0, 1]]
    ways.append(
        Alternative("marks-swapped", replace(run, marks_mm=exchanged), "moves as if its two marks were exchanged")
    )
    mirrored = run.marks_mm * np.array([-1.0, 1.0, -1.0, 1.0])
    ways.append(Alternative("mirrored", replace(run, marks_mm=mirrored), "moves as if seen in a mirror"))
    # frames of one run as far apart as those of the others were taken at their rate: then it is another command
    rates = RATES if interval_ratio is None else [r for r in RATES if abs(interval_ratio / r - 1) < SAME_INTERVAL]
    ways += [
        Alternative(
            "wrong-rate",
            replace(run, time_s=run.time_s / ratio, start_s=run.start_s),
            f"moves as if its seconds were {ratio:.3g} times as long as they are",
            own=interval_ratio is not None,
        )
        for ratio in rates
    ]
    tried = {(left, right), (-left, -right), (right, left)}
    ways += [
        Alternative(
            "wrong-command",
            _commanded(run, *command),
            f"moves as if it were commanded {command[0]:g} / {command[1]:g} rpm, not {left:g} / {right:g}",
        )
        for command in commands
        if command not in tried
    ]
    return ways


def _commanded(run: RunData, left_rpm: float, right_rpm: float) -> RunData:
    return replace(run, left_rpm=left_rpm, right_rpm=right_rpm)


def _thinned(run: RunData) -> RunData:
    """The run with some of its frames only, those in which both marks were seen."""
    seen = np.flatnonzero(np.isfinite(run.marks_mm).all(axis=1))
    chosen = seen[np.unique(np.linspace(0, len(seen) - 1, min(len(seen), FRAMES)).astype(int))]
    return replace(run, time_s=run.time_s[chosen], marks_mm=run.marks_mm[chosen], systematic={})


def _extent(marks: Floats, measured: Floats) -> float:
    """RMS distance of a path from its mean, mm: of the simulated one or the measured one, whichever is larger."""
    return max(float(np.sqrt(np.sum(np.var(part[:, :2], axis=0)))) for part in (marks, measured))


def _misfit(measured: Floats, predicted: Floats) -> float:
    """RMS distance of marks (n, 4) from predicted ones, laid on them by rotation and shift; NaN where not simulated."""
    if not np.isfinite(predicted).all():
        return float("nan")
    return rms_apart(*((part[:, ::2] + 1j * part[:, 1::2]).ravel() for part in (measured, predicted)))
