"""Definition of a mistake: runs, kind, evidence, remedy and correction."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from evaluator.interchange.commands import RunCommand

Kind = Literal[
    "reversed",
    "sides-swapped",
    "marks-swapped",
    "mirrored",
    "wrong-rate",
    "wrong-unit",
    "wrong-robot",
    "late-start",
    "wrong-command",
    "stuck",
    "pushed",
    "camera-moved",
    "duplicate",
    "outlying",
]
# Mistakes that hide others come first: a copy has every mistake of its original, a wrong unit hides a wrong command.
ORDER: tuple[Kind, ...] = (
    "duplicate",
    "wrong-unit",
    "wrong-robot",
    "late-start",
    "stuck",
    "camera-moved",
    "wrong-rate",
    "mirrored",
    "marks-swapped",
    "reversed",
    "sides-swapped",
    "wrong-command",
    "pushed",
    "outlying",
)
PART = re.compile(r"(.+)@(-?\d+\.\d)s")  # name of a part of a long recording (long_sessions)
MOST = 0.8  # share of the runs above which a mistake concerns the session and is reported once


@dataclass(frozen=True)
class Correction:
    """Changes to the files of a run; fields that are not given change nothing.

    command: left and right rpm instead of its command; log: instead of its log, in the time of the recording. wheels:
    what is done to a log by that, if it holds for all of it: factor of its speeds, and whether its sides are exchanged.
    later_s: added to start_s. seconds_times: factor of its times. lost_s: times of the file from which on frames were
    lost, and for how long, s. marks_exchanged: the first mark is the second. marks_times: factors of the x and y of its
    marks.
    """

    command: tuple[float, float] | None = None
    log: RunCommand | None = None
    wheels: tuple[float, bool] | None = None
    later_s: float = 0.0
    seconds_times: float = 1.0
    lost_s: tuple[tuple[float, float], ...] = ()
    marks_exchanged: bool = False
    marks_times: tuple[float, float] = (1.0, 1.0)


@dataclass(frozen=True)
class Found:
    """A mistake in one run: the evidence, as the end of a sentence that begins with the run, and the remedy.

    equivalent: other kinds that this run alone does not distinguish. correction: of its files, if there is one. group:
    runs for which it is reported together.
    """

    run: str
    kind: Kind
    seen: str
    remedy: str
    equivalent: tuple[Kind, ...] = ()
    correction: Correction | None = None
    group: tuple[str, ...] = ()


@dataclass(frozen=True)
class Mistake:
    """A mistake of one or several runs; everywhere: of all runs, or nearly all.

    equivalent_kinds: other kinds that the motion of the runs does not distinguish. corrections: of the files, by run,
    if there are any.
    """

    runs: tuple[str, ...]
    kind: Kind
    sentence: str
    everywhere: bool = False
    equivalent_kinds: tuple[Kind, ...] = ()
    corrections: Mapping[str, Correction] = field(default_factory=dict)


def mistakes_of(found: Sequence[Found], runs: int, showing: Mapping[Kind, int] | None = None) -> list[Mistake]:
    """One mistake for each run that has any, the first kind in ORDER; mistakes of most runs are combined.

    runs: total number. showing: number of runs that can show a kind, for kinds that not every run can show.
    """
    first = {
        item.run: item for item in sorted(found, key=lambda item: ORDER.index(item.kind), reverse=True)
    }  # a later one replaces an earlier: the first in ORDER stays
    result = []
    for kind in ORDER:
        of_kind = [item for item in first.values() if item.kind == kind]
        of_kind.sort(key=lambda item: item.run)
        could = (showing or {}).get(kind, runs)
        if could > 2 and len(of_kind) >= MOST * could:
            everyone = "all runs" if len(of_kind) == runs else f"{len(of_kind)} of {runs} runs"
            if len(of_kind) == could < runs:
                everyone += ", all that could show it"
            sentence = f"{everyone}, {named([of_kind[0].run])} for example: {of_kind[0].seen}; {of_kind[0].remedy}"
            concerned = tuple(item.run for item in of_kind)
            alike = tuple(k for k in ORDER if all(k in item.equivalent for item in of_kind))
            result.append(Mistake(concerned, kind, sentence, True, alike, _corrections(of_kind)))
            continue
        parts = _parts_by_recording([item.run for item in of_kind])
        for concerned in dict.fromkeys(item.group or parts.get(item.run, (item.run,)) for item in of_kind):
            first_of = next(item for item in of_kind if item.run in concerned)
            result.append(
                Mistake(
                    *(concerned, kind, f"{named(concerned)}: {first_of.seen}; {first_of.remedy}"),
                    equivalent_kinds=first_of.equivalent,
                    corrections=_corrections([item for item in of_kind if item.run in concerned]),
                )
            )
    return result


def exchanged_commands(found: Sequence[Found], commands: Mapping[str, tuple[float, float]]) -> list[Found]:
    """The mistakes, with the remedy of two runs that each moved by the command of the other; commands: by run."""
    moved = {it.run: it.correction.command for it in found if it.correction is not None and it.kind == "wrong-command"}
    pairs = {
        run: other
        for run, command in moved.items()
        for other, of_other in moved.items()
        if command == commands.get(other) and of_other == commands.get(run) and list(moved.values()).count(command) == 1
    }
    return [
        replace(item, remedy=f"exchange the commands of {item.run} and {pairs[item.run]}")
        if item.run in pairs and item.kind == "wrong-command"
        else item
        for item in found
    ]


def named(runs: Sequence[str]) -> str:
    """Names of runs for people: parts of a long recording are named after it, several of them once."""
    said = []
    for group in dict.fromkeys(_parts_by_recording(runs).get(run, (run,)) for run in runs):
        part = PART.fullmatch(group[0])
        where = f" ({len(group)} parts of it)" if len(group) > 1 else f" (from {part[2]} s on)" if part else ""
        said.append(f"{part[1] if part else group[0]}{where}")
    return ", ".join(said)


def recording_of(run: str) -> str:
    """Name of the recording that a run is, or is a part of."""
    part = PART.fullmatch(run)
    return part[1] if part else run


def by_recording(runs: Iterable[str]) -> list[list[str]]:
    """Names of runs and of parts of recordings, those of one recording together, in their order."""
    found: dict[str, list[str]] = {}
    for run in runs:
        found.setdefault(recording_of(run), []).append(run)
    return list(found.values())


def _parts_by_recording(runs: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """For every part of a long recording among these runs: all parts of the same one."""
    parts = {run: found[1] for run in runs if (found := PART.fullmatch(run))}
    return {run: tuple(other for other, of in parts.items() if of == recording) for run, recording in parts.items()}


def _corrections(found: Sequence[Found]) -> dict[str, Correction]:
    return {item.run: item.correction for item in found if item.correction is not None}
