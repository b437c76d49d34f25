"""Comparison of several analysed experiments of one robot over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from evaluator.errors import InputError
from evaluator.trends.series import Series, find_series
from evaluator.trends.sessions import Session, read_sessions

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Trends:
    """Sessions in the order of time, and every quantity that at least two of them have."""

    sessions: tuple[Session, ...]
    series: tuple[Series, ...]

    def table(self) -> pd.DataFrame:
        """A row per series and session: value, its 95 % bounds by noise and scatter, and whether it begins a change."""
        import numpy as np
        import pandas as pd

        rows = [
            (series.name, series.unit, session.name, session.day, level.value, level.reach, at)
            for series in self.series
            for at, (session, level) in enumerate(zip(self.sessions, series.levels, strict=True))
        ]
        begins = {(series.name, change.at) for series in self.series for change in series.changes}
        return pd.DataFrame(
            [
                (name, unit, session, day, value, value - reach, value + reach, (name, at) in begins)
                for name, unit, session, day, value, reach, at in rows
                if np.isfinite(value)  # otherwise the session lacks this quantity
            ],
            columns=["series", "unit", "session", "date", "value", "low", "high", "changed"],
        )


def compare_sessions(folders: Sequence[Path | str]) -> Trends:
    """Compare the results of several sessions: output folders of `analyze`, at least two.

    Raises InputError if a folder cannot be read, or the sessions have nothing in common.
    """
    if len(folders) < 2:
        raise InputError("a trend needs at least two folders of results, from `turnscope analyze` or `report`")
    sessions = read_sessions([Path(folder) for folder in folders])
    series = find_series(sessions)
    if not series:
        raise InputError(
            f"{', '.join(str(folder) for folder in folders)}: no command was driven in two of these sessions; a trend "
            "needs the same left_rpm, right_rpm and group in at least two"
        )
    return Trends(sessions, series)
