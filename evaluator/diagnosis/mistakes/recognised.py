"""What a mistake is: which runs, of what kind, what shows it, and what to do about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

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
]
# Before this kind another is looked for: a wrong unit hides every other mistake, a wrong command most disturbances.
ORDER: tuple[Kind, ...] = (
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
)
MOST = 0.8  # of the runs: what concerns so many is a habit of the session, said once


@dataclass(frozen=True)
class Found:
    """A mistake in one run: what is seen, as the end of a sentence that begins with the run, and the remedy."""

    run: str
    kind: Kind
    seen: str
    remedy: str


@dataclass(frozen=True)
class Mistake:
    """A mistake of one run or of many; everywhere: of all runs, or nearly all."""

    runs: tuple[str, ...]
    kind: Kind
    sentence: str
    everywhere: bool = False


def mistakes_of(found: Sequence[Found], runs: int) -> list[Mistake]:
    """One mistake for each run that has one, the first kind in ORDER; those of most runs together.

    runs: how many there are in all.
    """
    first = {
        item.run: item for item in sorted(found, key=lambda item: ORDER.index(item.kind), reverse=True)
    }  # a later one replaces an earlier: the first in ORDER stays
    result = []
    for kind in ORDER:
        of_kind = [item for item in first.values() if item.kind == kind]
        of_kind.sort(key=lambda item: item.run)
        if runs > 2 and len(of_kind) >= MOST * runs:
            everyone = "all runs" if len(of_kind) == runs else f"{len(of_kind)} of {runs} runs"
            sentence = f"{everyone}: {of_kind[0].seen} (as in {of_kind[0].run}); {of_kind[0].remedy}"
            result.append(Mistake(tuple(item.run for item in of_kind), kind, sentence, everywhere=True))
            continue
        result += [Mistake((item.run,), kind, f"{item.run}: {item.seen}; {item.remedy}") for item in of_kind]
    return result
