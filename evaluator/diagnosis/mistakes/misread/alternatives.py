"""Hypotheses on a run: as stated in the file, or with one of the usual mistakes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from evaluator.diagnosis.likelihood.run_data import RunData
from evaluator.diagnosis.mistakes.misread.command_unit import Factor, driven
from evaluator.diagnosis.mistakes.misread.typing_slips import before_a_slip
from evaluator.diagnosis.mistakes.motion import Onset, onset
from evaluator.diagnosis.mistakes.recognised import Correction, Kind
from evaluator.diagnosis.mistakes.start.late_start import LATE_S
from evaluator.interchange.commands import RunCommand

FRAMES = 80  # per run in a comparison, which suffice for a smooth path
# Ratios of the frame rates of recordings: 24, 25, 30, 50, 60, 120, slow motion of 240, and fields instead of frames.
RATES = (0.5, 2.0, 0.25, 4.0, 0.125, 8.0, 30 / 25, 25 / 30, 60 / 25, 25 / 60, 30 / 24, 24 / 30, 60 / 24, 24 / 60)
SAME = 1e-6  # of a value of two logs, or of a second or rpm: rounding in a file
# Factors of the speed of one side: a decimal point in a wrong place, a sign forgotten; or wheels that stand.
MISTYPED = {0.1: "the decimal point", 10.0: "the decimal point", -1.0: "the sign", 0.0: "whether a motor is off"}
RATE_TIMES = 5.0  # a start moved by a wrong rate lies within a fifth of the move; a late one does so by chance only
# Tried offsets of the clock of a command log, s: their steps are smaller than a late start.
OFFSETS_S = tuple(float(t) for t in np.setdiff1d(np.round(np.arange(-2.0, 2.05, 0.1), 2), [0.0]))

REMEDIES: dict[Kind, str] = {
    "reversed": "change the signs of left_rpm and right_rpm in experiment.toml",
    "sides-swapped": "exchange left_rpm and right_rpm in experiment.toml",
    "marks-swapped": "exchange the columns of the two marks",
    "mirrored": "mirror the recording, or the x of its marks",
    "wrong-rate": "give the true frame rate (rate_hz), or correct time_s",
    "wrong-unit": "give left_rpm and right_rpm in turns of the wheels per minute, or correct the robot file",
    "wrong-command": "check which command belongs to this recording",
    "late-start": "shift the times of its command log (start_s)",
}
TURN_HEADINGS = "add 180° to its headings"


@dataclass(frozen=True)
class Alternative:
    """A hypothesis on a run; kind None: the run is as stated in the file."""

    kind: Kind | None
    run: RunData
    words: str = ""
    own: bool = False  # whether there is specific evidence for it in this run
    later_s: float = 0.0  # offset of its command log relative to the file
    exact: bool = True  # whether its numbers are known, so that the files can be corrected by them
    wheels: tuple[float, bool] | None = None  # see Correction
    slip: bool = False  # whether its command is the written one before a slip of the keyboard


def alternatives(
    run: RunData,
    data: Sequence[RunData],
    interval_ratio: float | None,
    same_interval: float,
    factor: Factor | None = None,
) -> list[Alternative]:
    """The statement of the file, then every mistake, more common ones first.

    data: runs with the commands that this run may have had, each log once (distinct_commands). interval_ratio: frame
    interval of this run over that of the session, None if all runs have the same within same_interval. factor: of its
    speeds, if its command seems to be in another unit.
    """
    exchanged = replace(run, marks_mm=run.marks_mm[:, [2, 3, 0, 1]])
    mirrored = replace(run, marks_mm=run.marks_mm * np.array([-1.0, 1.0, -1.0, 1.0]))
    # if frames of a run are as far apart as those of the others, the rate is right: then the command is another one
    rates = RATES if interval_ratio is None else [r for r in RATES if abs(interval_ratio / r - 1) < same_interval]
    begins = onset(run)
    return [
        Alternative(None, run),
        *_same_speeds(run),
        Alternative(
            "marks-swapped",
            exchanged,
            f"moves as if its {'headings were turned by 180°' if run.from_poses else 'two marks were exchanged'}",
        ),
        Alternative("mirrored", mirrored, "moves as if seen in a mirror"),
        *(
            Alternative(
                "wrong-rate",
                replace(run, time_s=run.time_s / ratio, start_s=run.start_s),
                f"moves as if the times in its file were {ratio:.3g} times as long as they should be",
                own=interval_ratio is not None or _shows_in_the_start(run, begins, ratio),
            )
            for ratio in rates
        ),
        *(_in_unit(run, factor) if factor else ()),
        *_other_commands(run, data),
        *(_mistyped(run, _fastest_rpm(data)) if run.log is None else _offsets(run)),
    ]


def _shows_in_the_start(run: RunData, begins: Onset | None, ratio: float) -> bool:
    """Whether motion begins where a wrong frame rate moves the start, and not where the file states it.

    A wrong command does not move the start, and a late one does not change the speed by the same factor.
    """
    if begins is None:
        return False
    late_s, left_s = abs(begins.time_s - run.start_s), abs(begins.time_s - ratio * run.start_s)
    return late_s > max(LATE_S, RATE_TIMES * left_s)


def correction_to(way: Alternative, stated: Alternative) -> Correction | None:
    """The correction of the files according to a hypothesis; None if no correction exists."""
    if not way.exact:
        return None
    if way.kind == "marks-swapped":
        return Correction(marks_exchanged=True)
    if way.kind == "mirrored":
        return Correction(marks_times=(-1.0, 1.0))
    if way.kind == "wrong-rate":
        return Correction(seconds_times=float(way.run.time_s[-1] / stated.run.time_s[-1]))
    if way.run.log is not None:
        return Correction(log=way.run.log, wheels=way.wheels)
    of_command = way.kind in ("reversed", "sides-swapped", "wrong-unit", "wrong-command")
    return Correction(command=way.run.command) if of_command and stated.run.log is None else None


def thinned(run: RunData) -> RunData:
    """The run with at most FRAMES of the frames in which both marks were seen."""
    seen = np.flatnonzero(np.isfinite(run.marks_mm).all(axis=1))
    chosen = seen[np.unique(np.linspace(0, len(seen) - 1, min(len(seen), FRAMES)).astype(int))]
    return replace(run, time_s=run.time_s[chosen], marks_mm=run.marks_mm[chosen], systematic={})


def of_wheels(
    run: RunData, kind: Kind, words: str, times: float, *, exchanged: bool = False, exact: bool = True
) -> Alternative:
    """The run with the speeds of its wheels times a factor, left and right exchanged or not."""
    changed = driven(run, times, exchanged=exchanged)
    return Alternative(kind, changed, words, exact=exact, wheels=(times, exchanged))


def _same_speeds(run: RunData) -> list[Alternative]:
    """Hypotheses with the stated wheel speeds, but reversed, or with left and right exchanged."""
    command = run.run_command.command
    found = []
    if command.left_rpm.any() or command.right_rpm.any():
        found.append(of_wheels(run, "reversed", "drives the opposite way to its command", -1.0))
    if (command.left_rpm != command.right_rpm).any():
        found.append(of_wheels(run, "sides-swapped", "turns as if left and right were exchanged", 1.0, exchanged=True))
    return found


def _in_unit(run: RunData, factor: Factor) -> list[Alternative]:
    """The run with its command in another unit."""
    return [of_wheels(run, "wrong-unit", factor.words, factor.times, exact=bool(factor.unit))]


def _other_commands(run: RunData, data: Sequence[RunData]) -> list[Alternative]:
    """The run with commands of other runs, in any direction and to any side: sessions drive most of them so.

    Constant commands count from its own start on, logs in their own time.
    """
    left, right = run.command
    found = []
    own = {(left, right), (-left, -right), (right, left), (-right, -left)}  # the last as if its marks were exchanged
    tried = own if run.log is None else set()
    given = {other.command for other in data if other.log is None}
    sides = [pair for speeds in given for pair in (speeds, speeds[::-1])]
    ways = {(sign * first + 0.0, sign * second + 0.0) for first, second in sides for sign in (1, -1)}  # off is not -0
    for command in sorted(ways - tried):
        words = f"moves as if it were commanded {command[0]:g} / {command[1]:g} rpm"
        words += f", not {left:g} / {right:g}" if run.log is None else ", not as its log says"
        changed = replace(run, left_rpm=command[0], right_rpm=command[1], log=None)
        found.append(Alternative("wrong-command", changed, words))
    for other in data:
        if other.log is None or other.id == run.id or (run.log is not None and _alike(other.log, run.log)):
            continue
        left, right = other.command
        changed = replace(run, left_rpm=left, right_rpm=right, log=other.log, start_s=other.start_s)
        found.append(Alternative("wrong-command", changed, f"moves as the command log of {other.id} says"))
    return found


def _fastest_rpm(data: Sequence[RunData]) -> float:
    """The highest speed of a side, without its sign, at which any run is commanded."""
    driven = [item for run in data for item in run.run_command.driven]
    return max((max(abs(item.left_rpm), abs(item.right_rpm)) for item in driven), default=0.0)


def _mistyped(run: RunData, fastest_rpm: float) -> list[Alternative]:
    """The run with the speed of one side as it is before a slip of the keyboard; no digits make it faster than all."""
    left, right = run.command
    meant = [
        [(times * speed + 0.0, what) for times, what in MISTYPED.items()] for speed in run.command
    ]  # off is not -0
    for ways, speed in zip(meant, run.command, strict=True):
        ways += [item for item in before_a_slip(speed).items() if abs(item[0]) <= fastest_rpm]
    commands = {(speed, right): what for speed, what in meant[0]} | {(left, speed): what for speed, what in meant[1]}
    found = []
    for command, what in commands.items():
        if command not in {(left, right), (-left, -right), (right, left)}:
            words = f"moves as if it were commanded {command[0]:g} / {command[1]:g} rpm, not {left:g} / {right:g}"
            changed = replace(run, left_rpm=command[0], right_rpm=command[1])
            found.append(Alternative("wrong-command", changed, f"{words} (check {what})", slip=True))
    # Nothing drives one robot twice as fast as the others; many things drive one half as fast.
    words = f"moves as if it were commanded {2 * left:g} / {2 * right:g} rpm, not {left:g} / {right:g}"
    twice = replace(run, left_rpm=2 * left, right_rpm=2 * right)
    return [*found, Alternative("wrong-command", twice, f"{words} (check its frame rate, too)")]


def distinct_commands(data: Sequence[RunData]) -> list[RunData]:
    """The runs without those whose command, or whose log of commands, is that of one before."""
    found: list[RunData] = []
    constant: set[tuple[float, float]] = set()
    for run in data:
        if run.log is None:
            is_new = run.command not in constant
            constant.add(run.command)
        else:
            is_new = not any(other.log is not None and _alike(run.log, other.log) for other in found)
        if is_new:
            found.append(run)
    return found


def _alike(first: RunCommand, second: RunCommand) -> bool:
    """Whether two logs hold the same commands."""
    one, other = first.command.knots, second.command.knots
    # np.allclose takes ten times as long, and sessions have hundreds of logs, each compared with all others
    return one.shape == other.shape and bool((np.abs(one - other) <= SAME * (1 + np.abs(other))).all())


def _offsets(run: RunData) -> list[Alternative]:
    """The run with its command log earlier or later."""
    assert run.log is not None
    return [
        Alternative(
            "late-start",
            replace(
                run,
                start_s=run.start_s + offset if run.log.starts_at_rest else run.start_s,
                log=run.log.later(offset),
            ),
            f"follows its command log {abs(offset):.1f} s {'late' if offset > 0 else 'early'}",
            later_s=offset,
        )
        for offset in OFFSETS_S
    ]
