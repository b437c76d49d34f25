"""Series over sessions and their changes: each command by itself, and all turns and all speeds together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evaluator.trends.changes import Change, Level, changes
from evaluator.trends.sessions import Session
from evaluator.turning.pooling import pooled

UNKNOWN = Level(float("nan"), float("nan"), float("nan"))
TOGETHER = {"radius": "all turns together, radius", "speed": "all commands together, speed"}


@dataclass(frozen=True)
class Series:
    """A quantity over the sessions: a level for each (NaN where a session has none) and the changes between them."""

    name: str
    unit: str
    levels: tuple[Level, ...]
    changes: tuple[Change, ...]


def find_series(sessions: Sequence[Session]) -> tuple[Series, ...]:
    """All series that at least two sessions have, beginning with those of all commands together."""
    names = list(dict.fromkeys(name for session in sessions for name in session.levels))
    found = [
        (name, unit, levels) for quantity, name in TOGETHER.items() for unit, levels in _together(sessions, quantity)
    ]
    for name in names:
        levels = tuple(session.levels.get(name, UNKNOWN) for session in sessions)
        if sum(level is not UNKNOWN for level in levels) >= 2:
            unit = next(session.units[name] for session in sessions if name in session.units)
            found.append((name, unit, levels))
    return tuple(Series(name, unit, levels, changes(levels, len(found))) for name, unit, levels in found)


def _together(sessions: Sequence[Session], quantity: str) -> list[tuple[str, tuple[Level, ...]]]:
    """Mean over the commands that every session has, each relative to its own mean over the sessions, in percent."""
    mine = [{key for key in session.levels if key.startswith(f"{quantity},")} for session in sessions]
    common = sorted(set.intersection(*mine)) if mine else []
    if len(common) < 2:
        return []
    values = np.array([[session.levels[key].value for key in common] for session in sessions])
    errors = np.array([[session.levels[key].error for key in common] for session in sessions])
    usual = values.mean(axis=0)
    levels = []
    for session, value, error in zip(sessions, values / usual, errors / usual, strict=True):
        mean = pooled(100 * value, 100 * error)
        one = session.levels[common[0]]
        levels.append(Level(mean.mean, mean.error, mean.freedom, 100 * one.systematic / abs(one.value), one.source))
    return [("%", tuple(levels))]
